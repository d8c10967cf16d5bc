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

from wrist_ft_comp.drift.arx_pls import Arx, ArxPls, free_run
from wrist_ft_comp.errors import TooShortError
from wrist_ft_comp.fit.axis_data import AxisData
from wrist_ft_comp.fit.folds import fold_means, simplest_good
from wrist_ft_comp.fit.pls import fit_pls, Pls, stack, XyBlock
from wrist_ft_comp.fit.settings import Orders, STATIC
from wrist_ft_comp.series import FloatArray, ROUNDING

#: Poles are kept inside this radius: at h = 1 s, a time constant of 28 h.
MAX_POLE_RADIUS = 0.99999
#: Orders that compete for each latent, the simplest first. A delay of 30 s beside them left no
#: less of drawn days.
_COMPETING = [
    Orders(n, m, direct=direct)
    for n, m in ((0, 1), (1, 1), (1, 2), (2, 2))
    for direct in (True, False)
]
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
    inner = zip(latent_segments(block, outer), orders, strict=False)
    for r, (segments, of_latent) in enumerate(inner, 1):
        fitted, j = fit_one_step(segments, of_latent)
        latent, moved = stabilise(fitted)
        note = f'latent {r}: {of_latent}; J_{r} = {j:.4g} (eq. 19)'
        if moved:
            radius = float(np.abs(fitted.poles).max())
            note += f'; a pole of radius {radius:.6f} was moved inside the unit circle'
        latents.append(latent)
        notes.append(note)
    return block.model(outer, latents), tuple(notes)


def latent_segments(block: XyBlock, outer: Pls) -> list[list[Segment]]:
    """Compute t_r (eq. 4) and u_r = F_{r-1} q_r by latent, then by recording, shapes (N_i,)."""
    scores = [scaled @ outer.rotations for scaled in block.inputs]  # eq. 4
    segments, outputs = [], block.outputs
    for r, (b, q) in enumerate(zip(outer.inner, outer.output_loadings.T, strict=True)):
        segments.append([(t[:, r], f @ q) for t, f in zip(scores, outputs, strict=True)])
        outputs = tuple(f - b * np.outer(t[:, r], q) for f, t in zip(outputs, scores, strict=True))
    return segments


def choose_orders(data: AxisData, block: XyBlock, latents: int) -> tuple[Orders, ...]:
    """
    Choose orders of R latents by what the free run of H_r leaves of u_r on held-out folds.

    They are fewer where a block is exhausted, and static where nothing can be held out.
    """
    by_fold = dict[tuple[int, int], list[list[Segment]]]()
    for i, fold in data.folds_by_recording:
        pairs = zip(data.folds, block.outputs, strict=True)
        others = tuple(np.where((folds == fold)[:, np.newaxis], np.nan, y) for folds, y in pairs)
        inside = block.outputs[i][data.folds[i] == fold]
        if np.isfinite(inside).any() and any(np.isfinite(y).any() for y in others):
            seen_x, seen_y = stack(block.inputs, others), stack(others, others)
            by_fold[i, fold] = latent_segments(block, fit_pls(seen_x, seen_y, latents))
    if not by_fold:
        return (STATIC,) * latents
    chosen: list[Orders] = []
    for r in range(min(map(len, by_fold.values()))):
        scored = []
        for orders in _COMPETING:
            with suppress(TooShortError):  # what is too long for the recordings does not compete
                left = [_left(data, *at, of_fold[r], orders) for at, of_fold in by_fold.items()]
                scored.append((orders, float(np.mean(left))))
        if not scored:
            return (*chosen, STATIC)
        chosen.append(scored[simplest_good([left for _, left in scored])][0])
    return tuple(chosen)


def _left(data: AxisData, i: int, fold: int, segments: Sequence[Segment], orders: Orders) -> float:
    """Fit H_r to what is not in a fold; mean square of what its free run leaves there."""
    pairs = zip(segments, data.folds, strict=True)
    seen = [(t, np.where(folds == fold, np.nan, u)) for (t, u), folds in pairs]
    h, _ = stabilise(fit_one_step(seen, orders)[0])
    t, u = segments[i]
    both = (fold_means(data, i, fold, values)[1] for values in (u - free_run(h, t), u))
    left, whole = (float(np.mean(means**2)) for means in both)
    # What leaves less than rounding of u_r is equally good.
    return max(left, ROUNDING * whole)


def fit_one_step(segments: Sequence[Segment], orders: Orders) -> tuple[Arx, float]:
    """
    Fit by least squares on the one-step error over one or several recordings (eq. 20 to 22).

    Gives the model and J_r, half the sum of squares of its one-step error. With g, the first lag,
    rows φ(k) stand in a recording of N cells as drawn; those that touch a NaN are left out, and
    each recording is centred by itself:

        k = L:    u(L-1) … u(L-n) | t(L-g) … t(L-g-m+1)
        …
        k = N-1:  u(N-2) …        | t(N-1-g) …

    Measurement noise biases the fit, and its poles may lie outside the unit circle: see
    ``stabilise``. TooShortError is raised where too few rows are complete.
    """
    first = orders.first_lag
    longest = max(orders.n, first + orders.m - 1)  # L: how many past cells u(k) depends on
    parts = []
    for t, u in segments:
        if len(t) <= longest:
            continue
        columns = [u[longest - j : len(u) - j] for j in range(orders.n + 1)]
        columns += [t[longest - j : len(t) - j] for j in range(first, first + orders.m)]
        values = np.stack(columns, axis=1)  # u(k), then φ(k)
        values = values[np.isfinite(values).all(axis=1)]
        parts.append(values - values.mean(axis=0) if len(values) else values)
    if sum(map(len, parts)) <= orders.n + orders.m:
        raise TooShortError(
            f'An ARX with {orders.n + orders.m} coefficients needs more than as many stretches of '
            f'{longest + 1} consecutive thermal cells. Record without gaps, use a longer thermal '
            'period, or choose a static method.'
        )
    target, phi = np.split(np.concatenate(parts), [1], axis=1)
    # θ (n + m,) = (φᵀφ)⁻¹ φᵀ u  (eq. 22), by an orthogonal factorisation
    theta = np.linalg.lstsq(phi, target[:, 0], rcond=None)[0]
    j = 0.5 * float(np.sum((target[:, 0] - phi @ theta) ** 2))  # eq. 19 and 21
    return Arx(a=-theta[: orders.n], b=theta[orders.n :], first_lag=first), j


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
    # Mirrored at the circle, 1/|z - p| keeps its shape and grows by |p|.
    b = arx.b / np.prod(np.maximum(radius, 1.0))
    return Arx(a=np.real(np.poly(inside))[1:], b=b, first_lag=arx.first_lag), True
