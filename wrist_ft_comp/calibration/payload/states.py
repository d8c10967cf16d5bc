"""
First layer, states and weights: which payload is on in a cell, and whether something else pushes.

Contacts are outliers of all axes of a cell at once, and lose their weight by
1 / (1 + (e / c σ)²)², with c falling to 4. Gains, states and weights are found by turns. One state
more is believed where it explains more of blocks that it was not fitted to.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrist_ft_comp.calibration.payload.cells import Cells
from wrist_ft_comp.calibration.payload.gains import (
    bodies_of,
    contrast,
    Fit,
    leveled,
    rescaled,
    residual_norms,
    solve,
    weight_of,
)
from wrist_ft_comp.model.payload.rigid_body import CONTRAST, LIGHTEST_KG, MISFIT
from wrist_ft_comp.model.signals import AXES, BoolArray, FloatArray, IntArray

TUNING, _START, _ROUNDS = 4.0, 40.0, 25
#: Most payloads, and the share of cells not fitted to that another one has to explain.
#: Two states that weigh the same up to this share are one.
_MOST, _SHARE, _ALIKE = 4, 0.02, 0.03
#: So many blocks are searched for payloads at most: ten hours say as much as a month.
_SEARCHED = 120
#: A block is cut into the first of these that it can be cut into, to follow sudden heat.
_PARTS = (4, 3, 2, 1)
#: Parts of a block whose medians are tried as levels.
_WINDOWS = 8
#: A state is cut in two only where it holds in so many cells.
_FEWEST = 100


def find_states(cells: Cells) -> Fit:
    """Fit as many states as explain blocks that they were not fitted to, and then all blocks."""
    spread = np.linspace(0, len(cells.wrench) - 1, min(len(cells.wrench), _SEARCHED)).astype(int)
    learnt, held = cells.part(spread[::2]), cells.part(spread[1::2])
    fit = fit_states(learnt, np.zeros(learnt.usable.shape, dtype=np.int64), 1)
    moved = contrast(cells, cells.usable.astype(float)) > CONTRAST
    while moved and len(fit.gains) < _MOST and (more := _one_more(learnt, fit)) is not None:
        noise = np.minimum(fit.noise, more.noise)
        gained = _unexplained(held, fit, noise) - _unexplained(held, more, noise)
        # A press that comes again in the same pose is explained by a state, too, but by no body.
        pressed = _misfit(learnt, more) > MISFIT >= _misfit(learnt, fit)
        if gained < _SHARE or _alike(more.gains) or pressed:
            break
        fit = more
    states = explained(cells, fit.gains, fit.noise).states
    return fit_states(cells, states, len(fit.gains), rounds=12)


def fit_states(cells: Cells, states: IntArray, count: int, *, rounds: int = _ROUNDS) -> Fit:
    """Fit so many states by turns from a start, contacts losing their weight on the way."""
    weights = cells.usable.astype(float)
    gains = solve(cells, states, weights, count)
    fit = Fit(gains, states, weights, np.zeros_like(cells.wrench), np.ones(cells.axes))
    fit = _assign(cells, fit, 1e9, [_followed(cells, fit)], 1)
    for step in range(rounds):
        fit = rescaled(cells, fit)
        width = max(TUNING, _START * 0.8**step)
        fit = _assign(cells, fit, width, [_followed(cells, fit)], 2)
        if step % 5 == 4:
            starts = _anew(cells, fit, width) if step > 5 else _everywhere(cells, fit)
            fit = _assign(cells, fit, width, [_followed(cells, fit), *starts], 6)
        fit = replace(fit, gains=solve(cells, fit.states, fit.weights, count))
    return fit


def fit_again(cells: Cells, fit: Fit) -> Fit:
    """Fit cells anew that have changed a little, from gains and weights that are about right."""
    for step in range(4):
        starts = _anew(cells, fit, TUNING) if step == 0 else []
        fit = _assign(cells, fit, TUNING, [_followed(cells, fit), *starts], 4)
        fit = replace(fit, gains=solve(cells, fit.states, fit.weights, len(fit.gains)))
        fit = rescaled(cells, fit)
    return fit


def follow_closely(cells: Cells, fit: Fit) -> Fit:
    """Give states and weights anew along shorter parabolas: sudden heat is no contact."""
    blocks, length = cells.usable.shape
    parts = next(p for p in _PARTS if length % p == 0)

    def cut(values: NDArray[Any]) -> NDArray[Any]:
        return values.reshape(blocks * parts, length // parts, *values.shape[2:])

    short = Cells(cut(cells.wrench), cut(cells.force), cut(cells.usable))
    found = _turn(short, replace(fit, states=cut(fit.states)), cut(fit.levels), 4 * TUNING)
    for width in (2 * TUNING, TUNING, TUNING):
        found = _turn(short, found, _followed(short, found), width)
    return replace(
        fit,
        states=found.states.reshape(blocks, length),
        weights=found.weights.reshape(blocks, length),
    )


def _anew(cells: Cells, fit: Fit, width: float) -> list[FloatArray]:
    """Start from all levels that are worth a trial."""
    return [*_everywhere(cells, fit), *_windows(cells, fit, width)]


def explained(cells: Cells, gains: FloatArray, noise: FloatArray) -> Fit:
    """Assign cells to states whose gains were not fitted to them."""
    nowhere = np.zeros(cells.usable.shape, dtype=np.int64)
    weights = cells.usable.astype(float)
    start = Fit(gains, nowhere, weights, np.zeros_like(cells.wrench), noise)
    return _assign(cells, start, TUNING, _everywhere(cells, start), 8)


def _followed(cells: Cells, fit: Fit) -> FloatArray:
    """Start from levels that the states and weights of a fit give."""
    return leveled(cells.wrench - weight_of(cells, fit), fit.weights)


def _everywhere(cells: Cells, fit: Fit) -> list[FloatArray]:
    """Start from the levels that each state gives if it is on everywhere."""
    return [leveled(cells.wrench - cells.force @ a, cells.usable.astype(float)) for a in fit.gains]


def _windows(cells: Cells, fit: Fit, width: float) -> Iterator[FloatArray]:
    """Start from medians over parts of the blocks: contacts are not in all of them."""
    for gains in fit.gains:
        rest = np.where(cells.usable[..., None], cells.wrench - cells.force @ gains, np.nan)
        for window in np.array_split(rest, _WINDOWS, axis=1):
            some = np.isfinite(window[..., 0]).any(axis=1)
            level = np.zeros((len(rest), 1, cells.axes))
            level[some, 0] = np.nanmedian(window[some], axis=1)
            yield _followed(cells, _turn(cells, fit, level, 4 * width))


def _turn(cells: Cells, fit: Fit, levels: FloatArray, width: float) -> Fit:
    """Give every cell the state that explains it best, and a weight."""
    each = residual_norms(cells, fit, levels)
    weights = _redescend(each.min(axis=0), cells.usable, width)
    return replace(fit, states=each.argmin(axis=0), weights=weights, levels=levels)


def _assign(cells: Cells, fit: Fit, width: float, starts: Iterable[FloatArray], turns: int) -> Fit:
    """Give every cell the state that explains it best, in each block from the best levels."""
    best = fit
    cost: FloatArray = np.full(len(cells.wrench), np.inf)
    for levels in starts:
        found = _turn(cells, fit, levels, width)
        for _ in range(turns - 1):
            found = _turn(cells, fit, _followed(cells, found), width)
        lost = _loss(found.weights, cells.usable)
        better = (lost < cost - 1.0)[:, None]
        cost = np.where(better[:, 0], lost, cost)
        best = replace(
            best,
            states=np.where(better, found.states, best.states),
            weights=np.where(better, found.weights, best.weights),
            levels=np.where(better[..., None], found.levels, best.levels),
        )
    return best


def _redescend(norm: FloatArray, usable: BoolArray, width: float) -> FloatArray:
    """Robust weights of cells, (n, B)."""
    return np.asarray(usable / (1 + (norm / width) ** 2) ** 2)


def _loss(weights: FloatArray, usable: BoolArray) -> FloatArray:
    """Sum over the cells of a block what is not explained: 1 each far out, (n,)."""
    return np.asarray((usable * (1 - np.sqrt(weights))).sum(axis=1))


def _one_more(cells: Cells, fit: Fit) -> Fit | None:
    """Fit one state more, from the split that explains most."""
    count = len(fit.gains) + 1
    tried = [fit_states(cells, start, count, rounds=10) for start in _splits(cells, fit)]
    if not tried:
        return None
    noise = np.min([each.noise for each in tried], axis=0)
    best = min(tried, key=lambda each: _unexplained(cells, each, noise))
    return fit_states(cells, best.states, count)


def _splits(cells: Cells, fit: Fit) -> list[IntArray]:
    """Start one state more: cut each in two where cells weigh more or less than it says."""
    starts = []
    rest = cells.wrench - fit.levels
    for k, gains in enumerate(fit.gains):
        pull = cells.force @ gains
        excess = np.sum((rest - pull) * pull, axis=2) / np.maximum(np.sum(pull**2, axis=2), 1e-9)
        mine = cells.usable & (fit.states == k)
        for share in (0.3, 0.5, 0.7):
            if mine.sum() > _FEWEST:
                limit = np.quantile(excess[mine], share)
                starts.append(np.where(mine & (excess > limit), len(fit.gains), fit.states))
    return starts


def _unexplained(cells: Cells, fit: Fit, noise: FloatArray) -> float:
    """Share of usable cells that the states do not explain, the gains left as they are."""
    fit = explained(cells, fit.gains, noise)
    return float(_loss(fit.weights, cells.usable).sum() / max(cells.usable.sum(), 1))


def _misfit(cells: Cells, fit: Fit) -> float:
    """Share of the weight that is no rigid body's; 0 without all six axes."""
    return bodies_of(cells, fit).misfit if cells.axes == len(AXES) else 0.0


def _alike(gains: FloatArray) -> bool:
    """Tell whether two states weigh the same."""
    pairs = [(np.linalg.norm(a - b), np.linalg.norm(a)) for a, b in combinations(gains, 2)]
    return any(apart < max(_ALIKE * whole, LIGHTEST_KG) for apart, whole in pairs)
