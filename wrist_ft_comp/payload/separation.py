"""
From recordings at work to ones that drift can be learnt from: weight apart, contacts left out.

1. The accelerometer is set right by its norm at rest.
2. Payload states, gains and robust weights are found.
3. Steps that stay and that no payload explains are taken out: tares of the driver. They are
   suspected where lines over windows of means before and after do not meet, and located where the
   cells go over; heat goes over, too, but leaves a tail. A fit of the drift gets a constant of its
   own after each step, so that a step that is none costs little.
4. What is left are readings that are NaN where a contact, a fast turn or a change of state was,
   and the weight as their reference, for gain drift.

2 to 4 are done again with the drift taken off, once it is about known, by its slowness or by a
model that was learnt from it: then neither sudden heat looks like a step, nor a long press like
drift.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.payload.accelerometer import Accelerometer, set_right
from wrist_ft_comp.payload.gains import (
    axes_of,
    BLOCK_S,
    bodies_of,
    Cells,
    COUNTS,
    cut,
    Fit,
    held,
    LONG_BLOCK_S,
)
from wrist_ft_comp.payload.rigid_body import RigidBodies
from wrist_ft_comp.payload.states import find_states, fit_again, follow_closely, WIDTH
from wrist_ft_comp.robust import robust_cost, robust_weight
from wrist_ft_comp.signals import AXES, BoolArray, FloatArray, IntArray, Recording

#: Fewest cells with both wrench and specific force.
_FEWEST_CELLS = 120
#: Two steps that are nearer than this, cells, are no tares.
_STEPS_APART = 60
#: Cells on both sides of a step that do not count, because its place may not be exact.
_UNSURE = 10
#: Length of a mean, s; the lines of a suspicion run over means.
_MEAN_S = 10.0
#: Means of a line on either side: the short lines find a step, the long ones reject what bends.
_SHORT_LINE, _LONG_LINE = 6, 12
#: How far two lines miss each other at a step, by what they usually do …
_SUSPICION = 40.0
#: … and at least, by the noise of a cell.
_SMALLEST_STEP = 12.0
#: Nearest cells that count on either side of a step, which go over by _GONE_OVER of the step …
_NEAREST = 6
_GONE_OVER = 0.8
#: … and cells on either side from which a step's size is told. Behind a gap of more cells than
#: _HIDDEN, the nearest ones go over by the same share of that size, too.
_NEAR = 90
_HIDDEN = 15
#: Heat has a tail: behind a contact that hides its front, the first of the following cells are
#: short of the line through the others …
_FIRST, _FOLLOWING = 6, 30
#: … by more than this share of the step, and by more than so many times the noise.
_TAIL_SHARE, _TAIL_NOISE = 0.015, 2.0


@dataclass(frozen=True, eq=False)
class Step:
    """The first cell after a step, and how far it goes, N and N m (A,)."""

    cell: int
    jump: FloatArray


@dataclass(frozen=True, eq=False)
class Separation:
    """What recordings at work say."""

    #: As they came …
    recordings: list[Recording]
    #: … and without steps, the wrench NaN where it does not count, the weight as reference.
    drift: list[Recording]
    accelerometer: Accelerometer
    cells: Cells
    fit: Fit
    #: By recording.
    steps: list[list[Step]]

    @property
    def states(self) -> list[IntArray]:
        """State of every cell, (N,) by recording, -1 where it does not count."""
        return self.cells.join(np.where(self.fit.weights > COUNTS, self.fit.states, -1))

    def bodies(self) -> RigidBodies | None:
        """Find the rigid bodies, whether to be believed or not; None without all six axes."""
        if self.cells.axes < len(AXES):
            return None
        return bodies_of(self.cells, self.fit, self.accelerometer.scale)


def separate(recordings: Sequence[Recording]) -> Separation:
    """
    Separate payload, contacts, steps and drift; every recording holds specific force.

    CalibrationRefusedError where too few cells hold both wrench and specific force.
    """
    accelerometer = set_right(recordings)
    for recording, force in zip(recordings, accelerometer.forces, strict=True):
        _check_rows(recording, force)
    cells = cut(recordings, accelerometer.forces)
    if cells.usable.sum() < _FEWEST_CELLS or not cells.axes:
        raise CalibrationRefusedError(
            f'{", ".join(r.name for r in recordings)} hold {cells.usable.sum()} thermal cells '
            'with wrench and specific force that turn slowly; at least '
            f'{_FEWEST_CELLS} are needed for the reference payload. Record both at the same time.'
        )
    return _separated(recordings, accelerometer, cells, find_states(cells), None)


def separate_again(found: Separation, drift: Sequence[FloatArray]) -> Separation:
    """Separate anew beside what the drift is about, N and N m, (N, 6) by recording."""
    return _separated(found.recordings, found.accelerometer, found.cells, found.fit, drift)


def _check_rows(recording: Recording, force: FloatArray) -> None:
    """Refuse rows farther apart than cells: contacts are told by what neighbours say."""
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
    """Find steps, states and weights by turns, with the drift that is known, (N, 6), taken off."""
    forces, axes = accelerometer.forces, axes_of(recordings)
    block_s = BLOCK_S if known_drift is None else LONG_BLOCK_S
    off: Sequence[FloatArray | float] = (
        [0.0] * len(recordings) if known_drift is None else [d[:, axes] for d in known_drift]
    )
    stepless = [
        _with_wrench(recording, recording.wrench[:, axes] - drift, axes)
        for recording, drift in zip(recordings, off, strict=True)
    ]
    steps: list[list[Step]] = [[] for _ in recordings]
    if known_drift is not None:
        cells, fit = _fit_changed(cells, fit, cut(stepless, forces, None, block_s))
    while True:
        close = follow_closely(cells, fit) if known_drift is None else fit
        states, counts = cells.join(close.states), cells.join(close.weights > COUNTS)
        found = 0
        for n, recording in enumerate(stepless):
            wrench = recording.wrench[:, axes]
            rests = wrench - forces[n] @ fit.gains
            length = max(1, round(_MEAN_S / recording.period_s))
            for step in _find_steps(rests, states[n], counts[n], length, fit.noise):
                if all(abs(step.cell - other.cell) >= _STEPS_APART for other in steps[n]):
                    wrench[step.cell :] -= step.jump
                    steps[n].append(step)
                    found += 1
            stepless[n] = _with_wrench(recording, wrench, axes)
        if not found:
            break
        # How far a step goes is not known well before contacts are told apart: a block ends at it.
        ends = [[step.cell for step in of_recording] for of_recording in steps]
        cells, fit = _fit_changed(cells, fit, cut(stepless, forces, ends, block_s))
    told_apart = []
    for n, recording in enumerate(stepless):
        weight = held(forces[n] @ fit.gains, states[n])
        for step in steps[n]:
            counts[n][max(0, step.cell - _UNSURE) : step.cell + _UNSURE] = False
        wrench = np.where(counts[n][:, None], recording.wrench[:, axes], np.nan)
        for step in steps[n]:
            wrench[step.cell :] -= _step_size(wrench - weight, counts[n], step.cell)
        reference = np.full_like(recording.reference, np.nan)
        reference[:, axes] = weight
        empty = replace(recording, wrench=np.full_like(recording.wrench, np.nan))
        drift = _with_wrench(empty, wrench + off[n], axes)
        at = tuple(step.cell for step in steps[n])
        told_apart.append(replace(drift, reference=reference, steps=at))
    return Separation(list(recordings), told_apart, accelerometer, cells, close, steps)


def _fit_changed(cells: Cells, fit: Fit, changed: Cells) -> tuple[Cells, Fit]:
    """Fit cells that have changed a little, or are cut into other blocks."""
    recut = {
        name: changed.cut(cells.join(getattr(fit, name)))
        for name in ('states', 'weights', 'levels')
    }
    return changed, fit_again(changed, replace(fit, **recut))


def _with_wrench(recording: Recording, wrench: FloatArray, axes: Sequence[int]) -> Recording:
    """Replace some axes' wrench, (N, A)."""
    whole = recording.wrench.copy()
    whole[:, axes] = wrench
    return replace(recording, wrench=whole)


class _Suspicion(NamedTuple):
    """Means between which lines do not meet."""

    #: Numbers of the last mean before and the first one after.
    before: int
    after: int
    #: How far the lines miss each other, and their mean slope from mean to mean, (A,).
    jump: FloatArray
    slope: FloatArray


def _find_steps(
    rests: FloatArray, states: IntArray, counts: BoolArray, length: int, noise: FloatArray
) -> list[Step]:
    """Find steps in what each payload leaves, (K, N, A), by means over ``length`` cells."""
    found = []
    rest = np.nan_to_num(held(rests, states))
    means = _means(rest, counts, length)
    for before, after, jump, slope in _suspect(means, noise):
        first = max(0, before - 1) * length
        near = np.nan_to_num(rests[:, first : (after + 2) * length])
        past = (first + np.arange(near.shape[1]))[:, np.newaxis] / length - before - 0.5
        cell = first + _locate(near - past * slope, means[before], jump, noise)
        size = _settled(rest, counts, cell, jump, noise)
        found += [] if size is None else [Step(cell, size)]
    return found


def _means(values: FloatArray, counts: BoolArray, length: int) -> FloatArray:
    """Average the cells that count, (M, A); NaN where a tenth of ``length`` or fewer do."""
    whole = len(values) // length
    counted = counts[: whole * length].reshape(whole, length, 1)
    total = (counted * values[: whole * length].reshape(whole, length, -1)).sum(axis=1)
    number = counted.sum(axis=1)
    return np.asarray(np.where(number > length // 10, total / np.maximum(number, 1), np.nan))


def _suspect(means: FloatArray, noise: FloatArray) -> list[_Suspicion]:
    """Find where means (M, A) may step, largest first."""
    rows = np.flatnonzero(np.isfinite(means[:, 0]))
    if len(rows) < 4 * _LONG_LINE:
        return []
    at = np.arange(_LONG_LINE, len(rows) - _LONG_LINE)
    jumps, slopes = _lines(means, rows, at, _SHORT_LINE)
    both = jumps, _lines(means, rows, at, _LONG_LINE)[0]
    size = np.min([np.mean((jump / noise) ** 2, axis=1) for jump in both], axis=0) ** 0.5
    limit = max(_SMALLEST_STEP, _SUSPICION * float(np.median(size)))
    found = []
    while size.max() > limit:
        best = int(size.argmax())
        before, after = rows[at[best] - 1 : at[best] + 1].tolist()
        found.append(_Suspicion(before, after, jumps[best], slopes[best]))
        size[max(0, best - _SHORT_LINE) : best + _SHORT_LINE + 1] = 0.0
    return found


def _lines(
    means: FloatArray, rows: IntArray, at: IntArray, count: int
) -> tuple[FloatArray, FloatArray]:
    """Jumps between lines through ``count`` means on either side, and mean slopes, (n, A)."""
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


def _locate(rests: FloatArray, level: FloatArray, jump: FloatArray, noise: FloatArray) -> int:
    """
    Find the first cell after a step, counted in what each payload leaves, (K, n, A).

    Level before the step, how far it goes, and noise of a cell are N and N m, (A,).
    """
    size = np.sqrt(np.sum((jump / noise) ** 2))
    off = (rests - level) / noise
    along = off @ (jump / noise) / size**2
    aside = np.linalg.norm(off - along[..., None] * jump / noise, axis=2)
    width = np.sqrt(len(noise)) * WIDTH
    distances = (np.min(np.hypot(aside, (along - end) * size), axis=0) for end in (0, 1))
    costs = (robust_cost(robust_weight((distance / width) ** 2)) for distance in distances)
    before, after = (np.concatenate(([0.0], np.cumsum(cost))) for cost in costs)
    return int(np.argmin(before + after[-1] - after))


def _settled(
    rest: FloatArray, counts: BoolArray, at: int, jump: FloatArray, noise: FloatArray
) -> FloatArray | None:
    """Tell how far (A,) a step goes by cells near it, of (N, A); None where heat may go so far."""
    # Heat goes on behind a contact that hides its front, and lines reach over gaps.
    rows = np.flatnonzero(counts)
    middle = int(np.searchsorted(rows, at))
    if not 0 < middle < len(rows):
        return None
    path: FloatArray = np.column_stack((rest[rows], rows))
    nearest, near = (
        np.median(path[middle:][:most], axis=0)
        - np.median(path[max(0, middle - most) : middle], axis=0)
        for most in (_NEAREST, _NEAR)
    )
    size = float(np.linalg.norm(jump / noise))
    along = jump / noise**2 / size**2
    share_nearest, share_near = (float(change[:-1] @ along) for change in (nearest, near))
    hidden = rows[middle] - rows[middle - 1] > _HIDDEN
    least = _GONE_OVER * (max(1.0, share_near) if hidden else 1.0)
    if share_near < 0 or share_nearest < least:
        return None
    following = slice(middle, middle + _FOLLOWING)
    missing = _missing(rows[following], path[following, :-1] @ along)
    if missing > max(_TAIL_SHARE * share_nearest, _TAIL_NOISE / size):
        return None
    trend = (near - nearest) / max(1.0, near[-1] - nearest[-1])
    return np.asarray(nearest - trend * nearest[-1])[:-1]


def _missing(rows: IntArray, share: FloatArray) -> float:
    """Tell how far the first of some cells are short of the line through the others."""
    if len(rows) <= 2 * _FIRST:
        return 0.0
    line = np.polyfit(rows[_FIRST:], share[_FIRST:], 1)
    return float(np.median(np.polyval(line, rows[:_FIRST]) - share[:_FIRST]))


def _step_size(drift: FloatArray, counts: BoolArray, at: int) -> FloatArray:
    """Estimate a step (A,) at a cell from all that count near it, beside a parabola."""
    rows = np.arange(max(0, at - _NEAR), min(len(drift), at + _NEAR))
    rows = rows[counts[rows]]
    share = (rows - at) / _NEAR
    x = np.stack((np.ones(len(rows)), share, share**2, 1.0 * (rows >= at)), axis=1)
    if len(rows) < 20 or not 5 < x[:, 3].sum() < len(rows) - 5:
        return np.zeros(drift.shape[1])
    return np.asarray(np.linalg.lstsq(x, drift[rows], rcond=None)[0][3])
