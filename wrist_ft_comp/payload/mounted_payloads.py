"""
Find how many payloads there are, which one is mounted in every cell, and which cells are contacts.

The raw wrench is r(t) = c + o(T) + a_k f(t) + contact + noise, with the gains a_k (6, 3) of the
payload state k. In blocks of minutes a parabola, the level, stands for c + o(T). What remains are
differences between poses, of payloads and of contacts: outliers of all axes at once. Gains,
states, levels and robust weights are fitted by turns.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
import scipy  # which loads its parts when they are used

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.payload.accelerometer_calibration import repeats_itself, rotation_speed
from wrist_ft_comp.payload.mass_and_center import CONTRAST, MISFIT, rigid_bodies, RigidBodies
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import BoolArray, FloatArray, IntArray, robust_cost, robust_weight
from wrist_ft_comp.steps_in_recordings import SMALLEST_SIGMA, WIDTH_SIGMA

#: Length of a block, s, in which a parabola follows the drift. It would follow a press of two
#: minutes, too: where the drift is roughly known already, blocks are three times as long.
BLOCK_S = 300.0
#: Coefficients of the polynomial that is the level of a block: a parabola.
POWERS = 3
#: Cells of a block for each coefficient: along 10 cells, a parabola fits cells in contact as well
#: as free ones. Blocks are longer for that where cells are longer than 10 s.
CELLS_PER_POWER = 10
#: Cells that turn faster, rad/s, are left out: the payload's ω×(ω×c) is not measured. It is 0.1 N
#: here at 2 kg and 0.1 m. At 0.5 too few cells of 10 s remain; at 1.0 as much drift is left.
FASTEST = 0.7
#: A cell whose robust weight is larger is free of contact, and counts for the drift.
COUNTS = 0.5
#: This share of the cells, the quietest ones, are taken to be free of contact. With contacts in
#: 15 % of the time, half of the cells of 10 s are free; a share of 0.3 took contact for noise. A
#: stretch with a smaller share of usable cells is left out: one contact would look like its level.
LEAST_FREE_SHARE = 0.2
#: Rounds with WIDTH_SIGMA, and rounds in which steps and contacts are found by turns: cells of 10
#: s, half of which hold contact or motion, settle slowly.
ROUNDS = 5
#: Share of the cells that another state was not fitted to, and has to explain. Where a payload is
#: changed within a cell, the cell shows a mean of two. In 24 runs with cells of 10 s, such means
#: gained up to 0.05, so that at 0.02 five runs had a payload too many; real payloads gain 0.13.
_LEAST_GAIN = 0.06
#: Payloads are searched for in this time, s, spread over all recordings. In six development runs
#: of 36 000 s, all of it finds the same.
_SEARCHED_S = 21600.0
#: Parts of a block whose medians are tried as its level: a contact does not fill them all. With
#: twice as many nothing changes; with half as many, one contact of minutes fills both.
_PARTS = 4
#: Standard errors of gains come from the scatter of at least this many parts of the recordings.
_LEAST_PARTS = 12
#: Quantiles of weight by which a state is split in two. One at 0.5 overlooks what is mounted
#: rarely.
_SPLITS = (0.3, 0.7)


@dataclass(frozen=True, eq=False)
class Cells:
    """All recordings in n blocks of up to B cells, filled up with unusable cells."""

    #: Raw wrench, N and N m, axis order AXES, shape (n, B, 6).
    wrench: FloatArray
    #: Specific force, m/s², shape (n, B, 3).
    force: FloatArray
    #: Whether a cell holds both and does not turn fast, shape (n, B).
    usable: BoolArray
    #: Coefficients of a block's level; 1, a constant, where the drift was taken off before.
    powers: int = POWERS
    #: Row of every cell in all recordings, one after the other, (n, B); -1 where it is filled up.
    rows: IntArray = field(default_factory=lambda: np.empty((0, 0), dtype=np.int64))
    #: Number of rows of each recording.
    lengths: tuple[int, ...] = ()

    def part(self, chosen: IntArray) -> 'Cells':
        """Choose blocks."""
        return Cells(self.wrench[chosen], self.force[chosen], self.usable[chosen], self.powers)

    def join(self, blocked: NDArray[Any]) -> list[NDArray[Any]]:
        """Put the blocks of an array together again: one array per recording."""
        joined = np.zeros((sum(self.lengths), *blocked.shape[2:]), blocked.dtype)
        joined[self.rows[self.rows >= 0]] = blocked[self.rows >= 0]
        return np.split(joined, np.cumsum(self.lengths)[:-1])


@dataclass(frozen=True, eq=False)
class Fit:
    """K payload states, and which of them every cell is in."""

    #: Gains of specific force, kg and kg m, shape (K, 3, 6).
    gains: FloatArray
    #: State of every cell, shape (n, B).
    states: IntArray
    #: Robust weight of every cell, shape (n, B); near 0 in contact.
    weights: FloatArray
    #: Level of every cell, N and N m, shape (n, B, 6).
    levels: FloatArray
    #: Standard deviation of a cell without contact, N and N m, shape (6,).
    noise: FloatArray

    def residuals(self, cells: Cells) -> FloatArray:
        """Subtract the weight of each of K states, in units of the noise: (K, n, B, 6)."""
        return np.asarray((cells.wrench - cells.force @ self.gains[:, None]) / self.noise)

    def rest(self, cells: Cells) -> FloatArray:
        """Subtract levels and payloads from the wrench, N and N m, (n, B, 6)."""
        weight = of_state(cells.force @ self.gains[:, None], self.states)
        return np.asarray(cells.wrench - self.levels - weight)


def cells_in(duration_s: float, period_s: float) -> int:
    """Count the thermal cells in a duration, at least one; all windows here are in seconds."""
    return max(1, round(duration_s / period_s))


def cut(
    recordings: Sequence[Recording],
    forces: Sequence[FloatArray],
    ends: Sequence[Sequence[int]] | None = None,
    block_s: float = BLOCK_S,
    wrenches: Sequence[FloatArray] = (),
) -> Cells:
    """
    Cut recordings into blocks of ``block_s``, s; a block also ends at each of the cells ``ends``.

    Specific forces, (N, 3) per recording, are those of the calibrated accelerometer. Wrenches, N
    and N m, (N, 6), replace those that were recorded.
    """
    longest = max(CELLS_PER_POWER * POWERS, cells_in(block_s, recordings[0].period_s))
    blocks, first = [], 0
    for recording, cells in zip(recordings, ends or [()] * len(recordings), strict=True):
        for begin, end in pairwise([0, *sorted(cells), len(recording)]):
            # Equal blocks, because a contact may fill a short one at the end of a piece.
            count = max(1, -(-(end - begin) // longest))
            blocks += np.array_split(np.arange(first + begin, first + end), count)
        first += len(recording)
    rows = np.full((len(blocks), longest), -1)
    for row, block in zip(rows, blocks, strict=True):
        row[: len(block)] = block
    wrench = np.concatenate(wrenches or [recording.wrench for recording in recordings])
    force = np.concatenate(forces)
    speed = np.concatenate([rotation_speed(recording) for recording in recordings])
    holds = np.isfinite(wrench).all(axis=1) & np.isfinite(force).all(axis=1) & (speed < FASTEST)
    holds &= ~repeats_itself(recordings)
    usable = holds[rows] & (rows >= 0)
    wrench, force = (np.where(usable[..., None], part[rows], 0.0) for part in (wrench, force))
    usable &= usable.mean(axis=1, keepdims=True) >= LEAST_FREE_SHARE
    return Cells(wrench, force, usable, rows=rows, lengths=tuple(map(len, recordings)))


def find_states(cells: Cells) -> Fit:
    """
    Find how many payload states there are, and fit them to all blocks.

    States are added while the next one explains more of every second block, which is held out.
    """
    used = np.flatnonzero(cells.usable.any(axis=1))
    count = min(len(used), round(_SEARCHED_S / BLOCK_S))
    spread = used[np.linspace(0, len(used) - 1, count).astype(int)]
    learnt, held_out = cells.part(spread[::2]), cells.part(spread[1::2])
    fit = _fit_states(learnt, np.zeros(learnt.usable.shape, dtype=np.int64), 1)
    moved = bodies_of(learnt, fit).contrast[0] > CONTRAST
    while moved and (starts := _splits(learnt, fit)):
        candidates = [_fit_states(learnt, start, len(fit.gains) + 1, 1) for start in starts]
        noise = np.min([candidate.noise for candidate in candidates], axis=0)
        more = min(candidates, key=partial(_unexplained, learnt, noise))
        more = _settle(learnt, more)
        noise = np.minimum(fit.noise, more.noise)
        gained = _unexplained(held_out, noise, fit) - _unexplained(held_out, noise, more)
        # A state also explains a press that returns in the same pose, but no rigid body does.
        pressed = bodies_of(learnt, more).misfit > MISFIT >= bodies_of(learnt, fit).misfit
        if gained < _LEAST_GAIN or pressed:
            break
        fit = more
    return _settle(cells, _assigned_anywhere(cells, fit), 10 * WIDTH_SIGMA)


def fit_again(cells: Cells, fit: Fit) -> Fit:
    """
    Fit again to blocks that have changed; the gains are nearly right.

    A long contact draws a block's level to itself, so that of every part of the block is tried.
    """
    starts = [_present_levels(cells, fit)]
    residuals = fit.residuals(cells)
    for residual in residuals:
        measured = np.where(cells.usable[..., None], residual, np.nan)
        for part in np.array_split(measured, _PARTS, axis=1):
            level = medians(part)[:, None]
            states, weights = _assign_cells(residuals, cells.usable, level, 4 * WIDTH_SIGMA)
            starts.append(fitted_levels(of_state(residuals, states), weights, cells.powers))
    return _settle(cells, _assign(cells, fit, WIDTH_SIGMA, starts, 4))


def _splits(cells: Cells, fit: Fit) -> list[IntArray]:
    """Split every state in two: cells that weigh more than most get a new state."""
    starts = []
    for state, gains in enumerate(fit.gains):
        weight = cells.force @ gains
        excess = np.sum((cells.wrench - fit.levels - weight) * weight, axis=2)
        excess = excess / np.maximum(np.sum(weight**2, axis=2), 1e-9)
        cells_of_state = cells.usable & (fit.states == state)
        if cells_of_state.any():
            for limit in np.quantile(excess[cells_of_state], _SPLITS):
                heavier = cells_of_state & (excess > limit)
                starts.append(np.where(heavier, len(fit.gains), fit.states))
    return starts


def _fit_states(cells: Cells, states: IntArray, count: int, rounds: int = ROUNDS) -> Fit:
    """Fit ``count`` states by turns, from states to start with; ``rounds`` are as in _settle."""
    weights = cells.usable.astype(float)
    gains = solve(cells, states, weights, count)
    fit = Fit(gains, states, weights, np.zeros_like(cells.wrench), np.ones(len(AXES)))
    fit = replace(fit, levels=_present_levels(cells, fit))
    return _settle(cells, fit, 10 * WIDTH_SIGMA, rounds)


def _settle(cells: Cells, fit: Fit, widest: float = WIDTH_SIGMA, rounds: int = ROUNDS) -> Fit:
    """Fit states, weights, levels and gains by turns, in ever narrower widths and then rounds."""
    narrowing = math.ceil(math.log2(widest / WIDTH_SIGMA))
    for number in range(narrowing + rounds):
        width = max(widest / 2**number, WIDTH_SIGMA)
        fit = with_new_noise(cells, fit)
        starts = _levels_by_state(cells, fit) if number % 4 == 0 else ()
        fit = _assign(cells, fit, width, [_present_levels(cells, fit), *starts], 4)
        fit = replace(fit, gains=solve(cells, fit.states, fit.weights, len(fit.gains)))
    return with_new_noise(cells, fit)


def _assigned_anywhere(cells: Cells, fit: Fit) -> Fit:
    """Assign cells to states whose gains were fitted to other cells."""
    return _assign(cells, fit, WIDTH_SIGMA, _levels_by_state(cells, fit), 8)


def _unexplained(cells: Cells, noise: FloatArray, fit: Fit) -> float:
    """Compute the share of usable cells that the states of a fit do not explain."""
    weights = _assigned_anywhere(cells, replace(fit, noise=noise)).weights
    return float((cells.usable * robust_cost(weights)).sum() / max(cells.usable.sum(), 1))


def _present_levels(cells: Cells, fit: Fit) -> FloatArray:
    """Fit levels, in units of the noise, with the states and weights of a fit."""
    return fitted_levels(of_state(fit.residuals(cells), fit.states), fit.weights, cells.powers)


def _levels_by_state(cells: Cells, fit: Fit) -> list[FloatArray]:
    """Fit levels, in units of the noise, once per state, as if all cells were in that state."""
    weights = cells.usable.astype(float)
    return [fitted_levels(residual, weights, cells.powers) for residual in fit.residuals(cells)]


def _assign(cells: Cells, fit: Fit, width: float, starts: Iterable[FloatArray], turns: int) -> Fit:
    """Choose states, weights and levels by turns; every block takes the start that costs least."""
    residuals, usable, found = fit.residuals(cells), cells.usable, []
    for start in starts:
        levels = start
        states, weights = _assign_cells(residuals, usable, levels, width)
        for _ in range(turns - 1):
            levels = fitted_levels(of_state(residuals, states), weights, cells.powers)
            states, weights = _assign_cells(residuals, usable, levels, width)
        found.append((states, weights, levels))
    states, weights, levels = map(np.stack, zip(*found, strict=True))
    cost = (usable * robust_cost(weights)).sum(axis=2)
    # The first start that costs hardly more than the best.
    first = np.argmax(cost <= cost.min(axis=0) + 1.0, axis=0)
    at = first, np.arange(len(usable))
    return replace(fit, states=states[at], weights=weights[at], levels=levels[at] * fit.noise)


def _assign_cells(
    residuals: FloatArray, usable: BoolArray, levels: FloatArray, width: float
) -> tuple[IntArray, FloatArray]:
    """Choose every cell's state, the one that explains it best, and its weight, (n, B) each."""
    squares = np.mean((residuals - levels) ** 2, axis=3)
    return squares.argmin(axis=0), usable * robust_weight(squares.min(axis=0) / width**2)


def solve(cells: Cells, states: IntArray, weights: FloatArray, count: int) -> FloatArray:
    """Fit the gains, (K, 3, 6), of ``count`` states to weighted cells, levels eliminated."""
    size = 3 * count
    columns = np.concatenate((_by_state(cells, states, count), cells.wrench), axis=2)
    weighted = weights[..., None] * columns
    phi, inner = _level_equations(weights, cells.powers)
    crossed = phi.T @ weighted
    # Products of the columns over all blocks, less what the levels explain of them.
    normal = np.einsum('nbi,nbj->ij', weighted, columns, optimize=True)
    normal -= np.einsum('npi,npj->ij', crossed, np.linalg.solve(inner, crossed))
    # Changes of the specific force below 0.001 m/s² do not determine a gain.
    ridge = (1e-6 * weights.sum() + 1e-30) * np.eye(size)
    gains = np.linalg.solve(normal[:size, :size] + ridge, normal[:size, size:])
    return gains.reshape(count, 3, len(AXES))


def _by_state(cells: Cells, states: IntArray, count: int) -> FloatArray:
    """Put every cell's specific force in the three columns of its state, (n, B, 3K)."""
    chosen = (states[..., None] == np.arange(count))[..., None] * cells.force[:, :, None]
    return np.asarray(chosen.reshape(*states.shape, 3 * count))


def fitted_levels(values: FloatArray, weights: FloatArray, powers: int = POWERS) -> FloatArray:
    """Fit the levels of blocks, polynomials of P powers, to weighted values; both (n, B, A)."""
    phi, inner = _level_equations(weights, powers)
    return np.asarray(phi @ np.linalg.solve(inner, phi.T @ (weights[..., None] * values)))


def _level_equations(weights: FloatArray, powers: int) -> tuple[FloatArray, FloatArray]:
    """Compute Legendre polynomials of blocks, (B, P), and their weighted products, (n, P, P)."""
    share = (np.arange(weights.shape[1]) + 0.5) / weights.shape[1] * 2 - 1
    phi = np.asarray(np.polynomial.legendre.legvander(share, powers - 1), dtype=float)
    products = (phi[:, :, None] * phi[:, None]).reshape(len(phi), -1)
    inner = (weights @ products).reshape(-1, powers, powers)
    return phi, inner + 1e-8 * np.eye(powers)  # a block without weights has a level of 0


def medians(values: FloatArray) -> FloatArray:
    """Compute medians, (n, A), of finite values, (n, B, A), or 0, quicker than nanmedian."""
    count = np.isfinite(values[..., 0]).sum(axis=1)  # a cell is NaN in all axes or in none
    block, values = np.arange(len(values)), np.sort(values, axis=1)
    middle = values[block, np.maximum(count - 1, 0) // 2] + values[block, count // 2]
    return np.asarray(np.where(count[:, None] > 0, middle / 2, 0.0))


def of_state(by_state: FloatArray, states: IntArray) -> FloatArray:
    """Take every cell's values, (…, A), from those of its state, (K, …, A)."""
    return np.asarray(np.take_along_axis(by_state, states[None, ..., None], axis=0)[0])


def with_new_noise(cells: Cells, fit: Fit) -> Fit:
    """
    Estimate the noise of a cell again.

    The proportions of the axes come from cells free of contact, the scale from the quietest cells.
    """
    residual = fit.rest(cells)
    square = np.einsum('nb,nbi->i', fit.weights, residual**2) / max(fit.weights.sum(), 1e-9)
    # Without a least share of the wrench, an axis without noise would decide all.
    least = 1e-4 * np.sqrt(np.mean(cells.wrench**2, axis=(0, 1))) + 1e-15
    square = square + least**2
    norm = np.sqrt(np.sum(residual**2 / square, axis=2) / len(AXES))[cells.usable]
    # The norm of standard normal variables, per axis, at the same quantile (of a χ² distribution).
    expected = np.sqrt(2 * scipy.special.gammaincinv(len(AXES) / 2, LEAST_FREE_SHARE) / len(AXES))
    noise = np.sqrt(square) * np.quantile(norm, LEAST_FREE_SHARE) / expected
    neighbours = cells.usable[:, 1:] & cells.usable[:, :-1]
    if neighbours.any():  # every second cell may turn too fast
        differences = np.abs(np.diff(residual, axis=1))[neighbours]
        quiet = np.quantile(differences, LEAST_FREE_SHARE, axis=0)
        quiet /= 2 * scipy.special.erfinv(LEAST_FREE_SHARE)
        # What is larger is contact, or a specific force that is not the sensor's.
        noise = np.minimum(noise, WIDTH_SIGMA * quiet)
    return replace(fit, noise=np.maximum(noise, least))


def bodies_of(cells: Cells, fit: Fit, scale: FloatArray | None = None) -> RigidBodies:
    """Fit rigid bodies to the gains; ``scale`` is as in rigid_bodies."""
    count, weights = len(fit.gains), fit.weights
    moved, rest = (
        (part - fitted_levels(part, weights, cells.powers)).reshape(-1, part.shape[2])
        for part in (_by_state(cells, fit.states, count), fit.rest(cells) + fit.levels)
    )
    weighted = weights.reshape(-1, 1) * moved
    normal = weighted.T @ moved
    # Errors within a part of the recordings may depend on one another.
    length = -(-weights.shape[1] // -(-_LEAST_PARTS // len(weights)))
    products = weighted[:, :, None] * rest[:, None]
    scores = np.add.reduceat(products, np.arange(0, len(moved), length), axis=0)
    spread = np.einsum('nia,nja->aij', scores, scores)
    inverse = np.linalg.pinv(normal, rcond=1e-6, hermitian=True)
    rank = max(1, np.linalg.matrix_rank(normal, tol=1e-6 * np.trace(normal), hermitian=True))
    variance = np.einsum('ij,aji->a', inverse, spread) / rank
    return rigid_bodies(fit.gains, normal, variance, float(weights.sum()), scale)


def unexplained_contrast(cells: Cells, fit: Fit) -> float:
    """Share of the differences between poses that no payload explains, in the median block."""
    used = cells.usable.any(axis=1)
    wrench = np.where(cells.usable[..., None], cells.wrench, np.nan)[used]
    whole = wrench - np.nanmedian(wrench, axis=1, keepdims=True)
    rest = np.where(cells.usable[..., None], fit.rest(cells), np.nan)[used]
    unexplained, changes = (
        np.nanmedian(np.linalg.norm(part / fit.noise, axis=2), axis=1) for part in (rest, whole)
    )
    # Smaller differences between poses need no explanation.
    least = SMALLEST_SIGMA * np.sqrt(len(AXES))
    return float(np.median(unexplained / np.maximum(changes, least)))
