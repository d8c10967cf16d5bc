"""
Which payload is on in a cell, and whether something else pushes.

Contacts are outliers of all axes of a cell at once, and lose their robust weight, whose width
falls to WIDTH. Gains, states and weights are found by turns. One state more is believed where it
explains more of blocks that it was not fitted to.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrist_ft_comp.payload.gains import (
    bodies_of,
    Cells,
    contrast,
    dense,
    Fit,
    held,
    leveled,
    rescaled,
    solve,
    weight_of,
)
from wrist_ft_comp.payload.rigid_body import CONTRAST, LIGHTEST_KG, MISFIT
from wrist_ft_comp.robust import robust_cost, robust_weight
from wrist_ft_comp.signals import AXES, BoolArray, FloatArray, IntArray

#: Width of the robust weight in the end, in units of the noise of an axis …
WIDTH = 4.0
#: … and in the first round; it narrows by a factor in each.
_FIRST_WIDTH, _NARROWER = 40.0, 0.8
#: Rounds of a fit by turns.
_ROUNDS = 25
#: Most payloads that are told apart.
_MOST_STATES = 4
#: Share of the cells it was not fitted to that another state has to explain.
_LEAST_GAIN = 0.02
#: Two states whose gains differ by a smaller share weigh the same.
_ALIKE = 0.03
#: Blocks that are searched for payloads at most: ten hours say as much as a month.
_SEARCHED_BLOCKS = 120
#: To follow sudden heat, a block is cut into the first number of parts that divides it.
_PARTS = (4, 3, 2, 1)
#: Parts of a block whose medians are tried as levels.
_WINDOWS = 8
#: Fewest cells of a state that is cut in two.
_FEWEST_TO_SPLIT = 100


def find_states(cells: Cells) -> Fit:
    """Fit as many states as explain blocks that they were not fitted to, and then all blocks."""
    count = min(len(cells.wrench), _SEARCHED_BLOCKS)
    spread = np.linspace(0, len(cells.wrench) - 1, count).astype(int)
    learnt, held_out = cells.part(spread[::2]), cells.part(spread[1::2])
    fit = fit_states(learnt, np.zeros(learnt.usable.shape, dtype=np.int64), 1)
    moved = contrast(cells, cells.usable.astype(float)) > CONTRAST
    while moved and len(fit.gains) < _MOST_STATES:
        more = _one_more(learnt, fit)
        if more is None:
            break
        noise = np.minimum(fit.noise, more.noise)
        gained = _unexplained(held_out, fit, noise) - _unexplained(held_out, more, noise)
        # A press that comes again in the same pose is explained by a state, too, but by no body.
        pressed = _misfit(learnt, more) > MISFIT >= _misfit(learnt, fit)
        if gained < _LEAST_GAIN or _alike(more.gains) or pressed:
            break
        fit = more
    states = _explained(cells, fit.gains, fit.noise).states
    return fit_states(cells, states, len(fit.gains), rounds=12)


def fit_states(cells: Cells, states: IntArray, count: int, *, rounds: int = _ROUNDS) -> Fit:
    """Fit ``count`` states by turns from a start, contacts losing their weight on the way."""
    weights = cells.usable.astype(float)
    gains = solve(cells, states, weights, count)
    fit = Fit(gains, states, weights, np.zeros_like(cells.wrench), np.ones(cells.axes))
    fit = _assign(cells, fit, 1e9, [_followed(cells, fit)], 1)
    for step in range(rounds):
        fit = rescaled(cells, fit)
        width = max(WIDTH, _FIRST_WIDTH * _NARROWER**step)
        fit = _assign(cells, fit, width, [_followed(cells, fit)], 2)
        if step % 5 == 4:
            starts = _all_starts(cells, fit, width) if step > 5 else _everywhere(cells, fit)
            fit = _assign(cells, fit, width, [_followed(cells, fit), *starts], 6)
        fit = replace(fit, gains=solve(cells, fit.states, fit.weights, count))
    return fit


def fit_again(cells: Cells, fit: Fit) -> Fit:
    """Fit cells anew that have changed a little, from gains and weights that are about right."""
    for step in range(4):
        starts = _all_starts(cells, fit, WIDTH) if step == 0 else []
        fit = _assign(cells, fit, WIDTH, [_followed(cells, fit), *starts], 4)
        fit = replace(fit, gains=solve(cells, fit.states, fit.weights, len(fit.gains)))
        fit = rescaled(cells, fit)
    return fit


def follow_closely(cells: Cells, fit: Fit) -> Fit:
    """Give states and weights anew along shorter parabolas: sudden heat is no contact."""
    count, length = cells.usable.shape
    parts = next(p for p in _PARTS if length % p == 0)

    def cut(values: NDArray[Any]) -> NDArray[Any]:
        return values.reshape(count * parts, length // parts, *values.shape[2:])

    usable, rests = dense(cut(cells.usable)), [cut(rest) for rest in _rests(cells, fit)]
    states, weights = _turn(rests, usable, cut(fit.levels / fit.noise), 4 * WIDTH)
    for width in (2 * WIDTH, WIDTH, WIDTH):
        states, weights = _turn(rests, usable, leveled(held(rests, states), weights), width)
    shape = count, length
    return replace(fit, states=states.reshape(shape), weights=weights.reshape(shape))


def _explained(cells: Cells, gains: FloatArray, noise: FloatArray) -> Fit:
    """Assign cells to states whose gains were not fitted to them."""
    states = np.zeros(cells.usable.shape, dtype=np.int64)
    weights = cells.usable.astype(float)
    start = Fit(gains, states, weights, np.zeros_like(cells.wrench), noise)
    return _assign(cells, start, WIDTH, _everywhere(cells, start), 8)


def _followed(cells: Cells, fit: Fit) -> FloatArray:
    """Start from levels that the states and weights of a fit give, by the noise."""
    rest = (cells.wrench - weight_of(cells, fit)) / fit.noise
    return leveled(rest, fit.weights, cells.powers)


def _everywhere(cells: Cells, fit: Fit) -> list[FloatArray]:
    """Start from the levels that each state gives if it is on everywhere, by the noise."""
    weights = cells.usable.astype(float)
    return [leveled(rest, weights, cells.powers) for rest in _rests(cells, fit)]


def _all_starts(cells: Cells, fit: Fit, width: float) -> Iterator[FloatArray]:
    """Start from each state everywhere, and from medians over parts of the blocks."""
    yield from _everywhere(cells, fit)
    rests = _rests(cells, fit)
    for rest in rests:
        measured = np.where(cells.usable[..., None], rest, np.nan)
        for window in np.array_split(measured, _WINDOWS, axis=1):  # contacts are not in all
            level = medians(window)[:, None]
            states, weights = _turn(rests, cells.usable, level, 4 * width)
            yield leveled(held(rests, states), weights, cells.powers)


def medians(values: FloatArray) -> FloatArray:
    """Median over the cells (n, B, A) that are no NaN, 0 where all are: nanmedian, but quick."""
    count = np.isfinite(values[..., 0]).sum(axis=1)
    block, values = np.arange(len(values)), np.sort(values, axis=1)
    middle = values[block, np.maximum(count - 1, 0) // 2] + values[block, count // 2]
    return np.asarray(np.where(count[:, None] > 0, middle / 2, 0.0))


def _rests(cells: Cells, fit: Fit) -> list[FloatArray]:
    """Give the wrench without the weight of each state, by the noise, (n, B, A) each."""
    return [(cells.wrench - cells.force @ gains) / fit.noise for gains in fit.gains]


def _turn(
    rests: Sequence[FloatArray], usable: BoolArray, levels: FloatArray, width: float
) -> tuple[IntArray, FloatArray]:
    """Give every cell the state that explains it best, and a weight, (n, B) each."""
    errors = (rest - levels for rest in rests)
    squares = [np.einsum('nbi,nbi->nb', error, error) for error in errors]
    states, least = np.zeros(usable.shape, dtype=np.int64), squares[0]
    for state, square in enumerate(squares[1:], 1):
        states = np.where(square < least, state, states)
        least = np.minimum(square, least)
    return states, usable * robust_weight(least / (rests[0].shape[2] * width**2))


def _assign(cells: Cells, fit: Fit, width: float, starts: Iterable[FloatArray], turns: int) -> Fit:
    """Give every cell the state that explains it best, in each block from the best levels."""
    rests, usable = _rests(cells, fit), cells.usable
    best_states, best_weights, best_levels = fit.states, fit.weights, fit.levels / fit.noise
    least_cost: FloatArray = np.full(len(cells.wrench), np.inf)
    for start in starts:
        levels = start
        states, weights = _turn(rests, usable, levels, width)
        for _ in range(turns - 1):
            levels = leveled(held(rests, states), weights, cells.powers)
            states, weights = _turn(rests, usable, levels, width)
        cost = _cost(weights, usable)
        better = (cost < least_cost - 1.0)[:, None]
        least_cost = np.where(better[:, 0], cost, least_cost)
        best_states = np.where(better, states, best_states)
        best_weights = np.where(better, weights, best_weights)
        best_levels = np.where(better[..., None], levels, best_levels)
    return replace(fit, states=best_states, weights=best_weights, levels=best_levels * fit.noise)


def _cost(weights: FloatArray, usable: BoolArray) -> FloatArray:
    """Sum the cost of a block's usable cells, (n,)."""
    return np.asarray((usable * robust_cost(weights)).sum(axis=1))


def _one_more(cells: Cells, fit: Fit) -> Fit | None:
    """Fit one state more, from the split that explains most; None where there is no split."""
    count = len(fit.gains) + 1
    tried = [fit_states(cells, start, count, rounds=10) for start in _splits(cells, fit)]
    if not tried:
        return None
    noise = np.min([candidate.noise for candidate in tried], axis=0)
    best = min(tried, key=lambda candidate: _unexplained(cells, candidate, noise))
    return fit_states(cells, best.states, count)


def _splits(cells: Cells, fit: Fit) -> list[IntArray]:
    """Start one state more: cut each in two where cells weigh more or less than it says."""
    starts = []
    rest = cells.wrench - fit.levels
    for state, gains in enumerate(fit.gains):
        weight = cells.force @ gains
        excess = np.sum((rest - weight) * weight, axis=2)
        excess = excess / np.maximum(np.sum(weight**2, axis=2), 1e-9)
        cells_of_state = cells.usable & (fit.states == state)
        if cells_of_state.sum() > _FEWEST_TO_SPLIT:
            for limit in np.quantile(excess[cells_of_state], (0.3, 0.5, 0.7)):
                cut_off = cells_of_state & (excess > limit)
                starts.append(np.where(cut_off, len(fit.gains), fit.states))
    return starts


def _unexplained(cells: Cells, fit: Fit, noise: FloatArray) -> float:
    """Share of usable cells that the states do not explain, the gains left as they are."""
    fit = _explained(cells, fit.gains, noise)
    return float(_cost(fit.weights, cells.usable).sum() / max(cells.usable.sum(), 1))


def _misfit(cells: Cells, fit: Fit) -> float:
    """Share of the weight that is no rigid body's; 0 without all six axes."""
    return bodies_of(cells, fit).misfit if cells.axes == len(AXES) else 0.0


def _alike(gains: FloatArray) -> bool:
    """Tell whether two states weigh the same."""
    pairs = [(np.linalg.norm(a - b), np.linalg.norm(a)) for a, b in combinations(gains, 2)]
    return any(apart < max(_ALIKE * whole, LIGHTEST_KG) for apart, whole in pairs)
