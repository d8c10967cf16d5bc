"""
Find how many payloads there are, which one is mounted in every cell, and which cells are contacts.

A cell in contact is an outlier in all axes at once, and loses its robust weight. Gains, states and
weights are fitted by turns, while the width of the weight falls to WIDTH. Another state is added
where it explains more of blocks that it was not fitted to.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.payload.mass_and_center import CONTRAST, LIGHTEST_KG, MISFIT
from wrist_ft_comp.payload.weight_gains import (
    BLOCK_S,
    bodies_of,
    Cells,
    contrast,
    Fit,
    fitted_levels,
    medians,
    of_state,
    payload_wrench,
    solve,
    with_new_noise,
)
from wrist_ft_comp.series import BoolArray, FloatArray, IntArray, robust_cost, robust_weight

#: Width of the robust weight in the last rounds, in standard deviations of an axis.
WIDTH = 4.0
#: Widths of a fit's rounds, in the same unit, where nothing is known before.
_NARROWING = (40.0, 24.0, 14.0, 9.0, 5.0, WIDTH, WIDTH, WIDTH, WIDTH, WIDTH)
#: Up to this number of rounds follow: cells of 10 s, half of which hold contact or motion, settle
#: slowly. Without, drift is separated as well, but masses were off by 1.5 % instead of 0.8 % ...
_MORE_ROUNDS = 4
#: ... while a gain still moves by more than this share of the largest one.
_SETTLED_SHARE = 1e-3
#: Most payloads that are distinguished.
_MOST_STATES = 4
#: Share of the cells that another state was not fitted to, and has to explain. Where a payload is
#: changed within a cell, the cell shows a mean of two. In 24 runs with cells of 10 s, such means
#: gained up to 0.05, so that at 0.02 five runs had a payload too many; real payloads gain 0.13.
_LEAST_GAIN = 0.06
#: Two states weigh the same where their gains differ by a smaller share.
_SAME_GAINS_SHARE = 0.03
#: Payloads are searched for in this time, s, which shows as much as a month does.
_SEARCHED_S = 36000.0
#: Parts of a block whose medians are tried as its level: a contact does not fill them all.
_PARTS = 8
#: Quantiles of weight by which a state is split in two.
_SPLITS = (0.3, 0.5, 0.7)


def find_states(cells: Cells) -> Fit:
    """
    Find how many payload states there are, and fit them to all blocks.

    States are added while the next one explains more of every second block, which is held out.
    """
    count = min(len(cells.wrench), round(_SEARCHED_S / BLOCK_S))
    spread = np.linspace(0, len(cells.wrench) - 1, count).astype(int)
    learnt, held_out = cells.part(spread[::2]), cells.part(spread[1::2])
    fit = _fit_states(learnt, np.zeros(learnt.usable.shape, dtype=np.int64), 1)
    moved = contrast(cells, cells.usable.astype(float)) > CONTRAST
    while moved and len(fit.gains) < _MOST_STATES:
        more = _one_more(learnt, fit)
        if more is None:
            break
        noise = np.minimum(fit.noise, more.noise)
        gained = _unexplained(held_out, fit, noise) - _unexplained(held_out, more, noise)
        # A state also explains a press that returns in the same pose, but no rigid body does.
        pressed = _misfit(learnt, more) > MISFIT >= _misfit(learnt, fit)
        if gained < _LEAST_GAIN or _two_are_alike(more.gains) or pressed:
            break
        fit = more
    return _settle(cells, _assigned_anywhere(cells, fit.gains, fit.noise), _NARROWING)


def _fit_states(
    cells: Cells, states: IntArray, count: int, widths: Sequence[float] = _NARROWING
) -> Fit:
    """Fit ``count`` states by turns, from states to start with."""
    weights = cells.usable.astype(float)
    gains = solve(cells, states, weights, count)
    fit = Fit(gains, states, weights, np.zeros_like(cells.wrench), np.ones(cells.axes))
    fit = replace(fit, levels=_present_levels(cells, fit) * fit.noise)
    return _settle(cells, fit, widths)


def fit_again(cells: Cells, fit: Fit) -> Fit:
    """
    Fit again to blocks that have changed; the gains are nearly right.

    A long contact draws a block's level to itself, so that of every part of the block is tried.
    """
    starts = [_present_levels(cells, fit), *_levels_of_parts(cells, fit)]
    return _settle(cells, _assign(cells, fit, WIDTH, starts, 4), _NARROWING[-4:])


def _settle(cells: Cells, fit: Fit, widths: Sequence[float]) -> Fit:
    """Fit states, weights, levels and gains by turns, once with each width of the weight."""
    for number, width in enumerate((*widths, *[WIDTH] * _MORE_ROUNDS), 1):
        before = fit.gains
        fit = with_new_noise(cells, fit)
        starts = _levels_by_state(cells, fit) if number % 4 == 1 else ()
        fit = _assign(cells, fit, width, [_present_levels(cells, fit), *starts], 4)
        fit = replace(fit, gains=solve(cells, fit.states, fit.weights, len(fit.gains)))
        moved = np.abs(fit.gains - before).max()
        if number >= len(widths) and moved < _SETTLED_SHARE * np.abs(fit.gains).max():
            break
    return with_new_noise(cells, fit)


def _assigned_anywhere(cells: Cells, gains: FloatArray, noise: FloatArray) -> Fit:
    """Assign cells to states whose gains were fitted to other cells."""
    states = np.zeros(cells.usable.shape, dtype=np.int64)
    weights = cells.usable.astype(float)
    start = Fit(gains, states, weights, np.zeros_like(cells.wrench), noise)
    return _assign(cells, start, WIDTH, _levels_by_state(cells, start), 8)


def _present_levels(cells: Cells, fit: Fit) -> FloatArray:
    """Fit levels, in units of the noise, with the states and weights of a fit."""
    residual = (cells.wrench - payload_wrench(cells, fit)) / fit.noise
    return fitted_levels(residual, fit.weights, cells.powers)


def _levels_by_state(cells: Cells, fit: Fit) -> list[FloatArray]:
    """Fit levels, in units of the noise, once per state, as if all cells were in that state."""
    weights = cells.usable.astype(float)
    return [fitted_levels(residual, weights, cells.powers) for residual in _residuals(cells, fit)]


def _levels_of_parts(cells: Cells, fit: Fit) -> Iterator[FloatArray]:
    """Fit levels, in units of the noise, to what is near the median of a part of the block."""
    residuals = _residuals(cells, fit)
    for residual in residuals:
        measured = np.where(cells.usable[..., None], residual, np.nan)
        for part in np.array_split(measured, _PARTS, axis=1):
            level = medians(part)[:, None]
            states, weights = _assign_cells(residuals, cells.usable, level, 4 * WIDTH)
            yield fitted_levels(of_state(residuals, states), weights, cells.powers)


def _residuals(cells: Cells, fit: Fit) -> list[FloatArray]:
    """Subtract the weight of every state: wrenches, (n, B, A), in units of the noise."""
    return [(cells.wrench - cells.force @ gains) / fit.noise for gains in fit.gains]


def _assign_cells(
    residuals: Sequence[FloatArray], usable: BoolArray, levels: FloatArray, width: float
) -> tuple[IntArray, FloatArray]:
    """Choose every cell's state, the one that explains it best, and its weight, (n, B) each."""
    errors = (residual - levels for residual in residuals)
    squares = [np.einsum('nbi,nbi->nb', error, error) for error in errors]
    states, least = np.zeros(usable.shape, dtype=np.int64), squares[0]
    for state, square in enumerate(squares[1:], 1):
        states = np.where(square < least, state, states)
        least = np.minimum(square, least)
    return states, usable * robust_weight(least / (residuals[0].shape[2] * width**2))


def _assign(cells: Cells, fit: Fit, width: float, starts: Iterable[FloatArray], turns: int) -> Fit:
    """Choose states, weights and levels by turns; every block takes the start that costs least."""
    residuals, usable = _residuals(cells, fit), cells.usable
    best_states, best_weights, best_levels = fit.states, fit.weights, fit.levels / fit.noise
    least_cost: FloatArray = np.full(len(cells.wrench), np.inf)
    for start in starts:
        levels = start
        states, weights = _assign_cells(residuals, usable, levels, width)
        for _ in range(turns - 1):
            levels = fitted_levels(of_state(residuals, states), weights, cells.powers)
            states, weights = _assign_cells(residuals, usable, levels, width)
        cost = _cost(weights, usable)
        better = (cost < least_cost - 1.0)[:, None]
        least_cost = np.where(better[:, 0], cost, least_cost)
        best_states = np.where(better, states, best_states)
        best_weights = np.where(better, weights, best_weights)
        best_levels = np.where(better[..., None], levels, best_levels)
    return replace(fit, states=best_states, weights=best_weights, levels=best_levels * fit.noise)


def _cost(weights: FloatArray, usable: BoolArray) -> FloatArray:
    """Sum the robust costs of every block's usable cells, (n,)."""
    return np.asarray((usable * robust_cost(weights)).sum(axis=1))


def _one_more(cells: Cells, fit: Fit) -> Fit | None:
    """Fit another state, from the split that explains most; None where no state can be split."""
    count = len(fit.gains) + 1
    candidates = [
        _fit_states(cells, start, count, _NARROWING[:6]) for start in _splits(cells, fit)
    ]
    if not candidates:
        return None
    noise = np.min([candidate.noise for candidate in candidates], axis=0)
    best = min(candidates, key=lambda candidate: _unexplained(cells, candidate, noise))
    return _settle(cells, best, _NARROWING[-4:])


def _splits(cells: Cells, fit: Fit) -> list[IntArray]:
    """Split every state in two: cells that weigh more than the state does get a new state."""
    starts = []
    without_level = cells.wrench - fit.levels
    for state, gains in enumerate(fit.gains):
        weight = cells.force @ gains
        excess = np.sum((without_level - weight) * weight, axis=2)
        excess = excess / np.maximum(np.sum(weight**2, axis=2), 1e-9)
        cells_of_state = cells.usable & (fit.states == state)
        if cells_of_state.any():
            for limit in np.quantile(excess[cells_of_state], _SPLITS):
                cut_off = cells_of_state & (excess > limit)
                starts.append(np.where(cut_off, len(fit.gains), fit.states))
    return starts


def _unexplained(cells: Cells, fit: Fit, noise: FloatArray) -> float:
    """Compute the share of usable cells that the states of a fit do not explain."""
    fit = _assigned_anywhere(cells, fit.gains, noise)
    return float(_cost(fit.weights, cells.usable).sum() / max(cells.usable.sum(), 1))


def _misfit(cells: Cells, fit: Fit) -> float:
    """Compute the share of the weight that no rigid body explains; 0 without all six axes."""
    return bodies_of(cells, fit).misfit if cells.axes == len(AXES) else 0.0


def _two_are_alike(gains: FloatArray) -> bool:
    pairs = [(np.linalg.norm(a - b), np.linalg.norm(a)) for a, b in combinations(gains, 2)]
    return any(apart < max(_SAME_GAINS_SHARE * whole, LIGHTEST_KG) for apart, whole in pairs)
