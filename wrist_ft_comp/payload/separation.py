"""
Separate payload, contacts and tares of the driver from the drift of recordings at work.

1. Bias and scale of the accelerometer are fitted to its norm at rest.
2. Payload states, gains of specific force and robust weights of cells are fitted.
3. Steps that no payload explains are tares of the driver, and are taken out. A step is suspected
   where straight lines through the means before and after it do not meet. It is placed where the
   cells change from one level to the other. Sudden heat changes the level, too, but has a tail.
   Every step gives the later fit of the drift a constant of its own, so a step that was suspected
   wrongly costs little.
4. In the result, readings are NaN where a contact, a fast turn or a change of the payload was. The
   payload's weight is the reference, from which gain drift is learnt.

Steps 2 to 4 are done again when the drift is roughly known, from its slowness or from a model that
was learnt from the first result. With that drift subtracted, sudden heat does not look like a
step, and a long press does not look like drift.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.payload.accelerometer import Accelerometer, calibrated_by_norm
from wrist_ft_comp.payload.gains import (
    axes_of,
    BLOCK_S,
    bodies_of,
    Cells,
    COUNTS,
    cut,
    Fit,
    LONG_BLOCK_S,
    of_state,
)
from wrist_ft_comp.payload.mass_and_center import RigidBodies
from wrist_ft_comp.payload.states import find_states, fit_again, follow_closely, WIDTH
from wrist_ft_comp.robust import robust_cost, robust_weight
from wrist_ft_comp.signals import AXES, BoolArray, FloatArray, IntArray, Recording

#: Fewest cells with both wrench and specific force.
_LEAST_CELLS = 120
#: A tare is not repeated within this many cells: a second step so near is rejected.
_LEAST_DISTANCE_CELLS = 60
#: Cells on either side of a step that do not count, because the step's place may be wrong.
_UNSURE_CELLS = 10
#: Steps are searched for in means over this time, s.
_MEAN_S = 10.0
#: Means in each of the two short lines that meet at a possible step. They find the step.
_SHORT_LINE_MEANS = 6
#: Means in each of the two long lines. They reject drift that bends, which short lines also miss.
_LONG_LINE_MEANS = 12
#: A step is suspected where the lines miss each other by more than this many times the median ...
_SUSPICION_RATIO = 40.0
#: ... and by more than this many standard deviations of a cell.
_LEAST_JUMP_SIGMA = 12.0
#: The medians of this many cells before and after a step have to differ ...
_NEAREST_CELLS = 6
#: ... by this share of the jump: heat takes longer.
_LEAST_SHARE = 0.8
#: Cells on either side from which the size of a step is estimated.
_NEAR_CELLS = 90
#: Behind a longer gap, cells, the nearest cells also have to reach _LEAST_SHARE of that estimate.
_HIDING_GAP_CELLS = 15
#: The tail of heat, whose beginning a contact may hide: the first cells after the contact ...
_TAIL_CELLS = 6
#: ... of this many are below the straight line through the others ...
_TAIL_LINE_CELLS = 30
#: ... by more than this share of the step ...
_TAIL_SHARE = 0.015
#: ... and by more than this many standard deviations of a cell.
_TAIL_SIGMA = 2.0


@dataclass(frozen=True, eq=False)
class Step:
    """A tare of the driver, or another jump of the zero."""

    #: First cell after the step.
    cell: int
    #: By how much the readings change, N and N m, shape (A,).
    jump: FloatArray


@dataclass(frozen=True, eq=False)
class Separation:
    """Recordings at work, and what was found in them; lists have one entry per recording."""

    #: As they were recorded.
    recordings: list[Recording]
    #: Without steps; the wrench is NaN where it does not count, and the weight is the reference.
    drift: list[Recording]
    accelerometer: Accelerometer
    cells: Cells
    fit: Fit
    steps: list[list[Step]]

    @property
    def states(self) -> list[IntArray]:
        """Number of the payload in every cell, (N,) per recording; -1 where none counts."""
        return self.cells.join(np.where(self.fit.weights > COUNTS, self.fit.states, -1))

    def bodies(self) -> RigidBodies | None:
        """Fit rigid bodies, which RigidBodies.doubts judges; None without all six axes."""
        if self.cells.axes < len(AXES):
            return None
        return bodies_of(self.cells, self.fit, self.accelerometer.scale)


def separate(recordings: Sequence[Recording]) -> Separation:
    """
    Separate payload, contacts, steps and drift; every recording has to hold specific force.

    CalibrationRefusedError when too few cells hold both wrench and specific force.
    """
    accelerometer = calibrated_by_norm(recordings)
    for recording, force in zip(recordings, accelerometer.forces, strict=True):
        _check_rows(recording, force)
    cells = cut(recordings, accelerometer.forces)
    if cells.usable.sum() < _LEAST_CELLS or not cells.axes:
        raise CalibrationRefusedError(
            f'{", ".join(r.name for r in recordings)} hold {cells.usable.sum()} thermal cells '
            'with wrench and specific force that turn slowly; at least '
            f'{_LEAST_CELLS} are needed for the reference payload. Record both at the same time.'
        )
    return _separated(recordings, accelerometer, cells, find_states(cells), None)


def separate_again(found: Separation, drift: Sequence[FloatArray]) -> Separation:
    """Separate again, with the estimated drift, N and N m, (N, 6) per recording, taken off."""
    return _separated(found.recordings, found.accelerometer, found.cells, found.fit, drift)


def _check_rows(recording: Recording, force: FloatArray) -> None:
    """Refuse rows that are farther apart than cells: contacts show in neighbouring cells."""
    rows = np.column_stack([recording.wrench[:, axes_of([recording])], force])
    complete = np.isfinite(rows.sum(axis=1))
    if 2 * np.sum(complete[1:] & complete[:-1]) < complete.sum():
        apart_s = recording.period_s * float(np.median(np.diff(np.flatnonzero(complete))))
        raise CalibrationRefusedError(
            f'{recording.name} holds wrench and specific force every {apart_s:g} s; the reference '
            f'payload needs them in most thermal cells, of {recording.period_s:g} s each. Set the '
            f'thermal period to {apart_s:g} s, or record more often.'
        )


def _separated(
    recordings: Sequence[Recording],
    accelerometer: Accelerometer,
    cells: Cells,
    fit: Fit,
    known_drift: Sequence[FloatArray] | None,
) -> Separation:
    """Find steps, states and weights by turns, with a known drift, (N, 6), taken off."""
    forces, axes = accelerometer.forces, axes_of(recordings)
    block_s = BLOCK_S if known_drift is None else LONG_BLOCK_S
    drifts: Sequence[FloatArray | float] = (
        [0.0] * len(recordings) if known_drift is None else [d[:, axes] for d in known_drift]
    )
    stepless = [
        _with_wrench(recording, recording.wrench[:, axes] - drift, axes)
        for recording, drift in zip(recordings, drifts, strict=True)
    ]
    steps: list[list[Step]] = [[] for _ in recordings]
    if known_drift is not None:
        cells, fit = _fit_changed(cells, fit, cut(stepless, forces, None, block_s))
    while True:
        close = follow_closely(cells, fit) if known_drift is None else fit
        states, counts = cells.join(close.states), cells.join(close.weights > COUNTS)
        count = sum(map(len, steps))
        for n, recording in enumerate(stepless):
            wrench = recording.wrench[:, axes]
            residuals = wrench - forces[n] @ fit.gains
            length = max(1, round(_MEAN_S / recording.period_s))
            for step in _find_steps(residuals, states[n], counts[n], length, fit.noise):
                if all(abs(step.cell - s.cell) >= _LEAST_DISTANCE_CELLS for s in steps[n]):
                    wrench[step.cell :] -= step.jump
                    steps[n].append(step)
            stepless[n] = _with_wrench(recording, wrench, axes)
        if sum(map(len, steps)) == count:
            break
        # The size of a step is not well known before contacts are found: a block ends at it.
        ends = [[step.cell for step in of_recording] for of_recording in steps]
        cells, fit = _fit_changed(cells, fit, cut(stepless, forces, ends, block_s))
    drift_alone = []
    for n, recording in enumerate(stepless):
        weight = of_state(forces[n] @ fit.gains, states[n])
        alone = _drift_alone(recording, steps[n], counts[n], weight, drifts[n], axes)
        drift_alone.append(alone)
    return Separation(list(recordings), drift_alone, accelerometer, cells, close, steps)


def _drift_alone(  # noqa: PLR0913, PLR0917 -- what was found in one recording
    stepless: Recording,
    steps: Sequence[Step],
    counts: BoolArray,
    weight: FloatArray,
    drift: FloatArray | float,
    axes: Sequence[int],
) -> Recording:
    """Leave out contacts and steps; weight is the payload's, (N, A), and drift was taken off."""
    for step in steps:
        counts[max(0, step.cell - _UNSURE_CELLS) : step.cell + _UNSURE_CELLS] = False
    wrench = np.where(counts[:, None], stepless.wrench[:, axes], np.nan)
    for step in steps:
        wrench[step.cell :] -= _remaining_step(wrench - weight, counts, step.cell)
    reference = np.full_like(stepless.reference, np.nan)
    reference[:, axes] = weight
    empty = replace(stepless, wrench=np.full_like(stepless.wrench, np.nan))
    whole = _with_wrench(empty, wrench + drift, axes)
    return replace(whole, reference=reference, steps=tuple(step.cell for step in steps))


def _fit_changed(cells: Cells, fit: Fit, changed: Cells) -> tuple[Cells, Fit]:
    """Fit again to cells that have changed a little, or are cut into other blocks."""
    recut = {
        name: changed.cut(cells.join(getattr(fit, name)))
        for name in ('states', 'weights', 'levels')
    }
    return changed, fit_again(changed, replace(fit, **recut))


def _with_wrench(recording: Recording, wrench: FloatArray, axes: Sequence[int]) -> Recording:
    """Replace the wrench of some axes, (N, A)."""
    whole = recording.wrench.copy()
    whole[:, axes] = wrench
    return replace(recording, wrench=whole)


class _Suspicion(NamedTuple):
    """Two neighbouring means between which the lines before and after do not meet."""

    #: Numbers of the last mean before and the first one after.
    before: int
    after: int
    #: By how much the lines miss each other, shape (A,).
    jump: FloatArray
    #: Mean slope of both lines from mean to mean, shape (A,).
    slope: FloatArray


def _find_steps(
    residuals: FloatArray, states: IntArray, counts: BoolArray, length: int, noise: FloatArray
) -> list[Step]:
    """Find steps in wrenches less the weight of each payload, (K, N, A), by means of length."""
    found = []
    residual = np.nan_to_num(of_state(residuals, states))
    means = _means(residual, counts, length)
    for before, after, jump, slope in _suspect(means, noise):
        first = max(0, before - 1) * length
        near = np.nan_to_num(residuals[:, first : (after + 2) * length])
        time = (first + np.arange(near.shape[1]))[:, np.newaxis] / length - before - 0.5
        cell = first + _locate(near - time * slope, means[before], jump, noise)
        size = _confirmed_jump(residual, counts, cell, jump, noise)
        found += [] if size is None else [Step(cell, size)]
    return found


def _means(values: FloatArray, counts: BoolArray, length: int) -> FloatArray:
    """Average the cells that count, (M, A); NaN where a fifth of ``length`` or fewer do."""
    whole = len(values) // length
    counted = counts[: whole * length].reshape(whole, length, 1)
    total = (counted * values[: whole * length].reshape(whole, length, -1)).sum(axis=1)
    number = counted.sum(axis=1)
    # A few may be of a contact that looks like the level behind a step.
    return np.asarray(np.where(number > length // 5, total / np.maximum(number, 1), np.nan))


def _suspect(means: FloatArray, noise: FloatArray) -> list[_Suspicion]:
    """Find where means (M, A) may step, the largest step first."""
    rows = np.flatnonzero(np.isfinite(means[:, 0]))
    if len(rows) < 4 * _LONG_LINE_MEANS:
        return []
    at = np.arange(_LONG_LINE_MEANS, len(rows) - _LONG_LINE_MEANS)
    jumps, slopes = _lines(means, rows, at, _SHORT_LINE_MEANS)
    both = jumps, _lines(means, rows, at, _LONG_LINE_MEANS)[0]
    size = np.min([np.mean((jump / noise) ** 2, axis=1) for jump in both], axis=0) ** 0.5
    limit = max(_LEAST_JUMP_SIGMA, _SUSPICION_RATIO * float(np.median(size)))
    found = []
    while size.max() > limit:
        largest = int(size.argmax())
        before, after = rows[at[largest] - 1 : at[largest] + 1].tolist()
        found.append(_Suspicion(before, after, jumps[largest], slopes[largest]))
        size[max(0, largest - _SHORT_LINE_MEANS) : largest + _SHORT_LINE_MEANS + 1] = 0.0
    return found


def _lines(
    means: FloatArray, rows: IntArray, at: IntArray, count: int
) -> tuple[FloatArray, FloatArray]:
    """
    Fit lines through ``count`` means before and after every place.

    Gives the jumps from the line before to the line after, and the mean slopes of both, (n, A).
    """
    middle = (rows[at - 1] + rows[at]) / 2
    ends, slopes = [], []
    for offsets in (np.arange(-count, 0), np.arange(count)):
        chosen = rows[at[:, None] + offsets]
        time = chosen - middle[:, None]
        centred = time - time.mean(axis=1, keepdims=True)
        slope = np.einsum('nw,nwi->ni', centred, means[chosen])
        slope /= np.sum(centred**2, axis=1)[:, None]
        ends.append(means[chosen].mean(axis=1) - slope * time.mean(axis=1)[:, None])
        slopes.append(slope)
    return np.asarray(ends[1] - ends[0]), np.asarray(sum(slopes) / 2)


def _locate(residuals: FloatArray, level: FloatArray, jump: FloatArray, noise: FloatArray) -> int:
    """
    Find the first cell after a step, in wrenches less the weight of each payload, (K, n, A).

    Each cell is at the level before the step, or at that level plus the jump; level, jump and
    noise of a cell are N and N m, (A,).
    """
    size = np.sqrt(np.sum((jump / noise) ** 2))
    off = (residuals - level) / noise
    along = off @ (jump / noise) / size**2
    aside = np.linalg.norm(off - along[..., None] * jump / noise, axis=2)
    width = np.sqrt(len(noise)) * WIDTH
    distances = (np.min(np.hypot(aside, (along - end) * size), axis=0) for end in (0, 1))
    costs = (robust_cost(robust_weight((distance / width) ** 2)) for distance in distances)
    before, after = (np.concatenate(([0.0], np.cumsum(cost))) for cost in costs)
    return int(np.argmin(before + after[-1] - after))


def _confirmed_jump(
    residual: FloatArray, counts: BoolArray, cell: int, jump: FloatArray, noise: FloatArray
) -> FloatArray | None:
    """Estimate a step's jump, (A,), by the cells near it, of (N, A); None where it may be heat."""
    # Heat goes on behind a contact that hides its front, and lines reach over gaps.
    rows = np.flatnonzero(counts)
    middle = int(np.searchsorted(rows, cell))
    if not 0 < middle < len(rows):
        return None
    path: FloatArray = np.column_stack((residual[rows], rows))
    nearest, near = (
        np.median(path[middle:][:most], axis=0)
        - np.median(path[max(0, middle - most) : middle], axis=0)
        for most in (_NEAREST_CELLS, _NEAR_CELLS)
    )
    size = float(np.linalg.norm(jump / noise))
    along = jump / noise**2 / size**2
    share_nearest, share_near = (float(change[:-1] @ along) for change in (nearest, near))
    hidden = rows[middle] - rows[middle - 1] > _HIDING_GAP_CELLS
    least = _LEAST_SHARE * (max(1.0, share_near) if hidden else 1.0)
    if share_near < 0 or share_nearest < least:
        return None
    line = slice(middle, middle + _TAIL_LINE_CELLS)
    tail = _tail(rows[line], path[line, :-1] @ along)
    if tail > max(_TAIL_SHARE * share_nearest, _TAIL_SIGMA / size):
        return None
    trend = (near - nearest) / max(1.0, near[-1] - nearest[-1])
    return np.asarray(nearest - trend * nearest[-1])[:-1]


def _tail(rows: IntArray, share: FloatArray) -> float:
    """Measure how far the first cells are below the line through the others; 0 for too few."""
    if len(rows) <= 2 * _TAIL_CELLS:
        return 0.0
    line = np.polyfit(rows[_TAIL_CELLS:], share[_TAIL_CELLS:], 1)
    return float(np.median(np.polyval(line, rows[:_TAIL_CELLS]) - share[:_TAIL_CELLS]))


def _remaining_step(drift: FloatArray, counts: BoolArray, cell: int) -> FloatArray:
    """Estimate what is left of a step, (A,), from all cells near it that count, and a parabola."""
    rows = np.arange(max(0, cell - _NEAR_CELLS), min(len(drift), cell + _NEAR_CELLS))
    rows = rows[counts[rows]]
    share = (rows - cell) / _NEAR_CELLS
    x = np.stack((np.ones(len(rows)), share, share**2, 1.0 * (rows >= cell)), axis=1)
    if len(rows) < 20 or not 5 < x[:, 3].sum() < len(rows) - 5:
        return np.zeros(drift.shape[1])
    return np.asarray(np.linalg.lstsq(x, drift[rows], rcond=None)[0][3])
