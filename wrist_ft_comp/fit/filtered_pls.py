"""
Filtered PLS: each latent has a dynamic filter h_r of its own (eq. 11 to 14, Kaspar and Ray).

    Ẽ = H_r(E_{r-1})                                                (N, F)   eq. 11
    w_r = leading eigenvector of Ẽᵀ F_{r-1} F_{r-1}ᵀ Ẽ              (F,)     eq. 12
    t_r = Ẽ w_r = h_r(E_{r-1} w_r),   p_r = Ẽᵀ t_r / t_rᵀ t_r                eq. 12, 13
    E_r = E_{r-1} (I - w_r p_rᵀ), so H_r(E_r) = Ẽ - t_r p_rᵀ        (N, F)   eq. 3
    F_r = F_{r-1} - b_r t_r q_rᵀ                                    (N, M)   eq. 5, 9, 10
    Y = diag(h_1 … h_R)(E_0 W*) B Qᵀ + F,  W* = W (PᵀW)⁻¹           (N, M)   eq. 14

The filtered block is deflated, and E_r is what it was before h_r: so the next latent's filter is
its own. With all h_r = 1 this is PLS.
"""

from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.drift.arx import Arx, free_run, relaxation
from wrist_ft_comp.drift.arx_pls import ArxPls
from wrist_ft_comp.errors import TooShortError
from wrist_ft_comp.fit.arx_least_squares import fit_one_step, Orders, stabilise
from wrist_ft_comp.fit.axis_data import AxisData
from wrist_ft_comp.fit.cross_validation import fold_bins, part_errors, simplest_good
from wrist_ft_comp.fit.pls import dominant_weights, EXHAUSTED
from wrist_ft_comp.fit.ridge_bank import LONG_BANK_S
from wrist_ft_comp.fit.xy_block import XyBlock
from wrist_ft_comp.series import FloatArray

#: What h_r may be: the time constant of a relaxation, s (0 is h_r = 1), or the orders of an ARX.
Filter = float | Orders
#: The filters that compete for each latent, the simplest first.
FILTERS: tuple[Filter, ...] = (
    *LONG_BANK_S, Orders(n=1, m=2, direct=True), Orders(n=2, m=2, direct=True)
)  # fmt: skip


class _Latent(NamedTuple):
    """One latent, and what it leaves of both blocks."""

    #: b_r h_r.
    arx: Arx
    #: Column r of W (PᵀW)⁻¹, shape (F,), and q_r, shape (M,), of length 1.
    rotation: FloatArray
    loading: FloatArray
    #: E_r = E_0 times this, shape (F, F), and F_r of every cell, (N_i, M).
    deflation: FloatArray
    remaining: tuple[FloatArray, ...]
    #: What h_r is.
    note: str


def fit_filtered_pls(
    block: XyBlock, filters: Sequence[Filter], period_s: float
) -> tuple[ArxPls | None, tuple[str, ...]]:
    """
    Fit a latent behind each filter, h_1 … h_R, or fewer where a block is exhausted.

    The model is None where the inputs explain nothing; beside it stands h_r of each latent, in
    words. TooShortError is raised where an ARX finds too few consecutive samples.
    """
    deflation, remaining = np.eye(len(block.input_weight)), block.scaled_outputs
    latents: list[_Latent] = []
    for chosen in filters:
        latent = _extract(block, chosen, deflation, remaining, period_s)
        if latent is None:
            break
        latents.append(latent)
        deflation, remaining = latent.deflation, latent.remaining
    if not latents:
        return None, ()
    model = block.model(
        np.stack([latent.rotation for latent in latents], axis=1),
        [latent.arx for latent in latents],
        np.stack([latent.loading for latent in latents], axis=1),
    )
    return model, tuple(f'latent {r}: h is {latent.note}' for r, latent in enumerate(latents, 1))


def choose_filters(data: AxisData, block: XyBlock, latents: int) -> tuple[Filter, ...]:
    """
    Choose filters of R latents, each by what its latent leaves of F on held-out folds.

    They are fewer where a block is exhausted, and none where nothing can be held out.
    """
    parts = {fold: block.without(data.folds, fold) for fold in data.fold_numbers}
    seen = {fold: part for fold, part in parts.items() if part.observed}
    if not seen:
        return (0.0,) * latents
    # Deflation and remainder by fold; the latter also where the fold was not seen.
    state = {}
    for fold, part in seen.items():
        outputs = tuple(y * part.output_weight for y in block.outputs)
        state[fold] = np.eye(len(part.input_weight)), outputs
    chosen: list[Filter] = []
    while len(chosen) < latents:
        found: dict[Filter, dict[int, _Latent]] = {}
        left: dict[Filter, FloatArray] = {}
        for option in FILTERS:
            with suppress(TooShortError):  # an ARX that is too long does not compete
                by_fold = {
                    fold: _extract(part, option, *state[fold], data.period_s)
                    for fold, part in seen.items()
                }
                found[option] = {fold: latent for fold, latent in by_fold.items() if latent}
                if len(found[option]) == len(seen):
                    left[option] = np.concatenate(
                        [_left(data, latent.remaining, n) for n, latent in found[option].items()]
                    )
        if not left:
            break
        option = list(left)[simplest_good(list(left.values()))]
        chosen.append(option)
        state = {
            fold: (latent.deflation, latent.remaining) for fold, latent in found[option].items()
        }
    return tuple(chosen)


def _left(data: AxisData, remaining: Sequence[FloatArray], fold: int) -> FloatArray:
    """Mean squares that all outputs, (N_i, M), leave of a fold in sum, by part."""
    outputs = [[values[:, m] for values in remaining] for m in range(remaining[0].shape[1])]
    by_output = [part_errors(fold_bins(data, output, fold)) for output in outputs]
    return np.asarray(np.sum(by_output, axis=0))


def _extract(
    block: XyBlock,
    chosen: Filter,
    deflation: FloatArray,
    remaining: tuple[FloatArray, ...],
    period_s: float,
) -> _Latent | None:
    """Extract the next latent from E_{r-1} and F_{r-1}; None where either is exhausted."""
    e = [scaled @ deflation for scaled in block.scaled_inputs]
    f = block.stack(remaining)
    if np.sum(f**2) <= EXHAUSTED * np.sum(block.y**2):
        return None
    if isinstance(chosen, Orders):
        # The ARX from E_{r-1} w to F_{r-1} q, by eq. 22; w and q are those of the unfiltered
        # block, and b_r takes the scale.
        w = dominant_weights(block.stack(e), f)
        q = f.T @ (block.stack(e) @ w)
        segments = [
            (values @ w, np.where(rows, outputs @ q, np.nan))
            for values, outputs, rows in zip(e, remaining, block.valid, strict=True)
        ]
        h, moved = stabilise(fit_one_step(segments, chosen))
        note = f'an ARX, {chosen}{", its poles moved inside the unit circle" if moved else ""}'
    else:
        h = relaxation(chosen, period_s)
        note = f'a relaxation of {chosen:g} s' if chosen else 'none'
    filtered = [free_run(h, values) for values in e]  # eq. 11
    stacked = block.stack(filtered)
    w = dominant_weights(stacked, f)  # eq. 12
    t = stacked @ w
    tt = float(t @ t)
    if tt <= EXHAUSTED * np.sum(block.x**2):
        return None
    p = stacked.T @ t / tt
    slopes = f.T @ t / tt  # b_r q_r
    b = float(np.linalg.norm(slopes))
    left = (
        y - np.outer(values @ w, slopes) for y, values in zip(remaining, filtered, strict=True)
    )
    return _Latent(
        arx=Arx(h.a, b * h.b, h.first_lag), rotation=deflation @ w, loading=slopes / b,
        deflation=deflation @ (np.eye(len(w)) - np.outer(w, p)), remaining=tuple(left),
        note=note)  # fmt: skip
