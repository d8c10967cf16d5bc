"""
ARX-PLS, identified as the paper does it: PLS, then an ARX for each latent (eq. 15 to 22).

The outer model comes first (eq. 3 to 10) and deflates by its own b_r t_r q_rᵀ. So u_r is known
before any H_r, and J of eq. 19 is a sum of terms that are minimised one by one:

    u_r = F_{r-1} q_r,   F_r = F_{r-1} - b_r t_r q_rᵀ                eq. 5, 10
    J_r = ½ Σ (u_r(k) - φ_r(k) θ_r)²,   J = J_1 + … + J_R            eq. 19, 21
"""

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from wrist_ft_comp.drift.arx import Arx, free_run
from wrist_ft_comp.drift.arx_pls import ArxPls
from wrist_ft_comp.errors import TooShortError
from wrist_ft_comp.fit.arx_least_squares import (
    fit_one_step,
    one_step_error,
    Orders,
    Segment,
    stabilise,
    STATIC,
)
from wrist_ft_comp.fit.axis_data import AxisData
from wrist_ft_comp.fit.cross_validation import fold_bins, part_errors, simplest_good
from wrist_ft_comp.fit.pls import fit_pls, Pls
from wrist_ft_comp.fit.xy_block import XyBlock
from wrist_ft_comp.series import FloatArray

#: (n, m) that compete for each latent, the simplest first, ...
_ORDERS = ((0, 1), (1, 1), (1, 2), (2, 2))
#: ... each with a direct term, and with these delays, s: heat takes half a minute at most.
_DELAYS_S = (0.0, 10.0, 30.0)
#: Orders that leave less than this share of u_r's RMS are equally good: it is rounding.
_ROUNDING = 1e-6


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
    by_fold = {}
    for fold in data.fold_numbers:
        seen = block.without(data.folds, fold)
        if seen.observed:
            outer = fit_pls(seen.x, seen.y, latents)
            everywhere = [y * seen.output_weight for y in block.outputs]
            by_fold[fold] = latent_segments(seen, outer, everywhere)
    if not by_fold:
        return (STATIC,) * latents
    delays = sorted({round(delay_s / data.period_s) for delay_s in _DELAYS_S})
    competing = [
        orders
        for n, m in _ORDERS
        for orders in (Orders(n, m, 0, direct=True), *(Orders(n, m, d) for d in delays))
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
    return np.asarray(np.maximum(left, _ROUNDING**2 * whole))
