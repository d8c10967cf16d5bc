"""
ARX-PLS, identified as the paper does it: PLS, then an ARX for each latent (eq. 15 to 22).

The outer model comes first (eq. 3 to 10) and deflates by its own b_r t_r q_rᵀ. So u_r is known
before any H_r, and J of eq. 19 is a sum of terms that are minimised one by one:

    u_r = F_{r-1} q_r,   F_r = F_{r-1} - b_r t_r q_rᵀ                eq. 5, 10
    J_r = ½ Σ (u_r(k) - φ_r(k) θ_r)²,   J = J_1 + … + J_R            eq. 19, 21
    φ(k) = [u(k-1) … u(k-n), t(k-d-1) … t(k-d-m)],  θ = [-a_1 … -a_n, b_1 … b_m]ᵀ    eq. 20

With a direct term φ's second half begins one cell later in time, at t(k-d).
"""

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from wrist_ft_comp.drift.arx import Arx, free_run
from wrist_ft_comp.drift.arx_pls import ArxPls
from wrist_ft_comp.errors import TooShortError
from wrist_ft_comp.fit.axis_data import AxisData
from wrist_ft_comp.fit.folds import fold_bins, part_errors, simplest_good
from wrist_ft_comp.fit.pls import fit_pls, Pls, XyBlock
from wrist_ft_comp.fit.settings import Orders, STATIC
from wrist_ft_comp.series import FloatArray, ROUNDING

#: Poles are kept inside this radius: at h = 1 s, a time constant of 28 h.
MAX_POLE_RADIUS = 0.99999
#: Orders n = m up to this compete for each latent, and n = 1 with two inputs, ...
_HIGHEST_ORDER = 2
#: ... each with a direct term, without delay, and with this one, s: heat takes as long at most.
_DELAY_S = 30.0
#: Score t_r and output u_r of a recording, shapes (N_i,), u_r with an unknown constant.
Segment = tuple[FloatArray, FloatArray]


def fit_arx_pls(block: XyBlock, orders: Sequence[Orders]) -> tuple[ArxPls | None, tuple[str, ...]]:
    """
    Fit a latent for each of the orders, n_r, m_r and d_r, or fewer where a block is exhausted.

    The model is None where the inputs explain nothing; beside it stand orders and J_r of each
    latent, in words. TooShortError is raised where an ARX finds too few consecutive samples.
    """
    outer = fit_pls(block.x, block.y, len(orders))
    latents: list[Arx] = []
    notes: list[str] = []
    inner = zip(latent_segments(block, outer, block.scaled_outputs), orders, strict=False)
    for r, (segments, of_latent) in enumerate(inner, 1):
        fitted = fit_one_step(segments, of_latent)
        latent, moved = stabilise(fitted)
        j = one_step_error(segments, of_latent, latent)
        note = f'latent {r}: {of_latent}; J_{r} = {j:.4g} (eq. 19)'
        if moved:
            radius = float(np.abs(fitted.poles).max())
            note += f'; a pole of radius {radius:.6f} was moved inside the unit circle'
        latents.append(latent)
        notes.append(note)
    return block.model(outer.rotations, latents, outer.output_loadings), tuple(notes)


def latent_segments(
    block: XyBlock, outer: Pls, outputs: Sequence[FloatArray]
) -> list[list[Segment]]:
    """
    Compute t_r (eq. 4) and u_r = F_{r-1} q_r by latent, then by recording, shapes (N_i,).

    The outer model was fitted to the block; outputs are F_0, (N_i, M), scaled by W_y, and where
    they are NaN, u_r is.
    """
    scores = [scaled @ outer.rotations for scaled in block.scaled_inputs]  # eq. 4
    segments = []
    for r, (b, q) in enumerate(zip(outer.inner, outer.output_loadings.T, strict=True)):
        segments.append([(t[:, r], f @ q) for t, f in zip(scores, outputs, strict=True)])
        outputs = [f - b * np.outer(t[:, r], q) for f, t in zip(outputs, scores, strict=True)]
    return segments


def choose_orders(data: AxisData, block: XyBlock, latents: int) -> tuple[Orders, ...]:
    """
    Choose orders of R latents by what the free run of H_r leaves of u_r on held-out folds.

    They are fewer where a block is exhausted, and static where nothing can be held out.
    """
    by_fold = dict[int, list[list[Segment]]]()
    for fold in data.fold_numbers:
        pairs = zip(data.folds, block.outputs, strict=True)
        others = tuple(np.where((folds == fold)[:, np.newaxis], np.nan, y) for folds, y in pairs)
        seen = XyBlock(block.inputs, others)
        if seen.observed:
            everywhere = [y * seen.output_weight for y in block.outputs]
            by_fold[fold] = latent_segments(seen, fit_pls(seen.x, seen.y, latents), everywhere)
    if not by_fold:
        return (STATIC,) * latents
    delays = sorted({0, round(_DELAY_S / data.period_s)})
    competing = [
        orders
        for n in range(_HIGHEST_ORDER + 1)
        for m in range(max(n, 1), max(n, 1) + (_HIGHEST_ORDER if n == 1 else 1))
        for orders in (Orders(n, m, direct=True), *(Orders(n, m, d) for d in delays))
    ]
    chosen: list[Orders] = []
    for r in range(min(map(len, by_fold.values()))):
        scored = []
        for orders in competing:
            with suppress(TooShortError):  # what is too long for the recordings does not compete
                left = [_left_held_out(data, fold, by_fold[fold][r], orders) for fold in by_fold]
                scored.append((orders, np.concatenate(left)))
        if not scored:
            return (*chosen, STATIC)
        chosen.append(scored[simplest_good([errors for _, errors in scored])][0])
    return tuple(chosen)


def _left_held_out(
    data: AxisData, fold: int, segments: Sequence[Segment], orders: Orders
) -> FloatArray:
    """Fit H_r to what is not in a fold; mean squares of what its free run leaves there."""
    seen = [
        (t, np.where(folds == fold, np.nan, u))
        for (t, u), folds in zip(segments, data.folds, strict=True)
    ]
    h, _ = stabilise(fit_one_step(seen, orders))
    left = part_errors(fold_bins(data, [u - free_run(h, t) for t, u in segments], fold))
    whole = part_errors(fold_bins(data, [u for _, u in segments], fold)).mean()
    # What leaves less than rounding of u_r is equally good.
    return np.asarray(np.maximum(left, ROUNDING * whole))


def regressors(t: FloatArray, u: FloatArray, orders: Orders) -> tuple[FloatArray, FloatArray]:
    """
    Stack the rows φ(k) of eq. 20 and 22, one per predicted sample, and the outputs u(k).

    Score t and measured output u have shape (N,); where N <= L, TooShortError is raised. With g,
    the first lag:

        k = L:    u(L-1) … u(L-n) | t(L-g) … t(L-g-m+1)
        …
        k = N-1:  u(N-2) …        | t(N-1-g) …
    """
    longest, first = orders.longest_lag, orders.first_lag
    rows = len(t) - longest
    if rows <= 0:
        raise TooShortError(
            f'An ARX with a longest lag of {longest} cells needs more samples than that; '
            f'got {len(t)}. Record longer, or lower the orders.'
        )
    columns = [u[longest - j : longest - j + rows] for j in range(1, orders.n + 1)]
    columns += [t[longest - first - i : longest - first - i + rows] for i in range(orders.m)]
    return np.stack(columns, axis=1), u[longest:]


def stack_regressors(segments: Sequence[Segment], orders: Orders) -> tuple[FloatArray, FloatArray]:
    """
    Stack φ, (K, n + m), and u, (K,), of several recordings, each centred by itself.

    Rows that touch a NaN are left out. TooShortError is raised where a segment is shorter than
    the longest lag, or where too few rows are complete.
    """
    parts = []
    for t, u in segments:
        rows, outputs = regressors(t, u, orders)
        complete = np.isfinite(rows).all(axis=1) & np.isfinite(outputs)
        if complete.any():
            rows, outputs = rows[complete], outputs[complete]
            parts.append((rows - rows.mean(axis=0), outputs - outputs.mean()))
    if sum(len(outputs) for _, outputs in parts) <= orders.n + orders.m:
        raise TooShortError(
            f'An ARX with {orders.n + orders.m} coefficients needs more runs of '
            f'{orders.longest_lag + 1} consecutive cells with samples than that. '
            'Record without gaps, use a longer thermal period, or choose a static method.'
        )
    phi, target = (np.concatenate(part) for part in zip(*parts, strict=True))
    return phi, target


def fit_one_step(segments: Sequence[Segment], orders: Orders) -> Arx:
    """
    Fit by least squares on the one-step error over one or several recordings (eq. 21 and 22).

    Segments and errors are those of ``stack_regressors``. Measurement noise biases the fit, and
    its poles may lie outside the unit circle: see ``stabilise``.
    """
    phi, target = stack_regressors(segments, orders)
    # θ (n + m,) = (φᵀφ)⁻¹ φᵀ u  (eq. 22), by an orthogonal factorisation
    theta = np.asarray(np.linalg.lstsq(phi, target, rcond=None)[0], dtype=np.float64)
    return Arx(a=-theta[: orders.n], b=theta[orders.n :], first_lag=orders.first_lag)


def one_step_error(segments: Sequence[Segment], orders: Orders, arx: Arx) -> float:
    """Compute J_r of eq. 19 and 21: half the sum of squares of the one-step error."""
    phi, target = stack_regressors(segments, orders)
    return 0.5 * float(np.sum((target - phi @ np.concatenate((-arx.a, arx.b))) ** 2))


def stabilise(arx: Arx) -> tuple[Arx, bool]:
    """
    Mirror poles outside the unit circle into it; tell whether any was moved.

    The magnitude of the frequency response stays, and with it that of the static gain. A real
    pole above 1 turns the static gain's sign: the sign in which the response sets out stays.
    """
    poles = arx.poles
    radius = np.abs(poles).clip(1e-300)  # a pole at 0 has no direction, and stays
    if not len(poles) or radius.max() <= MAX_POLE_RADIUS:
        return arx, False
    inside = poles / radius * np.minimum(np.minimum(radius, 1 / radius), MAX_POLE_RADIUS)
    a = np.real(np.poly(inside))[1:]
    # Mirrored at the circle, 1/|z - p| keeps its shape and grows by |p|.
    b = arx.b / np.prod(np.maximum(radius, 1.0))
    return Arx(a=a, b=b, first_lag=arx.first_lag), True
