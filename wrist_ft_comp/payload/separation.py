"""
From recordings at work to ones that drift can be learnt from: weight apart, contacts left out.

1. The accelerometer is set right by its norm at rest.
2. Payload states, gains and robust weights are found.
3. Steps that stay, and that no payload explains, are taken out.
4. What is left are readings that are NaN where a contact, a fast turn or a change of state was,
   and the weight as their reference, for gain drift.

2 to 4 are done again with the drift taken off, once it is about known, by its slowness or by a
model that was learnt from it: then neither sudden heat looks like a step, nor a long press like
drift.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.payload.accelerometer import Accelerometer, set_right
from wrist_ft_comp.payload.cells import (
    axes_of,
    BLOCK_S,
    Cells,
    cut,
    LONG_BLOCK_S,
    with_wrench,
)
from wrist_ft_comp.payload.gains import bodies_of, COUNTS, Fit
from wrist_ft_comp.payload.rigid_body import RigidBodies
from wrist_ft_comp.payload.states import find_states, fit_again, follow_closely
from wrist_ft_comp.payload.steps import (
    locate,
    MEAN_S,
    means,
    settled,
    step_size,
    suspect_steps,
)
from wrist_ft_comp.signals import AXES, BoolArray, FloatArray, IntArray, Recording

#: Two steps that are nearer than this, cells, are no tares.
_APART = 60
#: Cells on both sides of a step that do not count, because where it is may not be exact.
_UNSURE = 10
#: Cells with both wrench and specific force that are needed.
_FEWEST = 120


@dataclass(frozen=True, eq=False)
class Step:
    """The first cell after a step, and how far it goes, N and N m (A,)."""

    cell: int
    jump: FloatArray


@dataclass(frozen=True, eq=False)
class Separation:
    """What recordings at work say."""

    #: As they came; and with the wrench NaN where it does not count and without steps, the weight
    #: as reference.
    recordings: list[Recording]
    drift: list[Recording]
    accelerometer: Accelerometer
    #: The first layer.
    cells: Cells
    fit: Fit
    #: By recording.
    steps: list[list[Step]]

    @property
    def states(self) -> list[IntArray]:
        """State of every cell, (N,) by recording, -1 where it does not count."""
        counts = np.where(self.fit.weights > COUNTS, self.fit.states, -1)
        return self.cells.join(counts)

    def bodies(self) -> RigidBodies | None:
        """Find the rigid bodies, whether to be believed or not; None without all six axes."""
        if self.cells.axes < len(AXES):
            return None
        return bodies_of(self.cells, self.fit, self.accelerometer.scale)


def separate(recordings: Sequence[Recording]) -> Separation:
    """Separate payload, contacts, steps and drift; every recording holds specific force."""
    accelerometer = set_right(recordings)
    for recording, force in zip(recordings, accelerometer.forces, strict=True):
        _check_rows(recording, force)
    cells = cut(recordings, accelerometer.forces)
    if cells.usable.sum() < _FEWEST or not cells.axes:
        raise CalibrationRefusedError(
            f'{", ".join(r.name for r in recordings)} hold {cells.usable.sum()} thermal cells '
            'with wrench and specific force that turn slowly; at least '
            f'{_FEWEST} are needed for the reference payload. Record both at the same time.'
        )
    return _separated(recordings, accelerometer, cells, find_states(cells), None)


def _check_rows(recording: Recording, force: FloatArray) -> None:
    """Refuse rows farther apart than cells: contacts are told by what neighbours say."""
    rows = np.column_stack([recording.wrench[:, axes_of([recording])], force])
    there = np.isfinite(rows.sum(axis=1))
    if 2 * np.sum(there[1:] & there[:-1]) < there.sum():
        apart_s = recording.period_s * float(np.median(np.diff(np.flatnonzero(there))))
        raise CalibrationRefusedError(
            f'{recording.name} holds wrench and specific force every {apart_s:g} s; the reference '
            f'payload needs them in most thermal cells, of {recording.period_s:g} s each. Set the '
            f'thermal period to {apart_s:g} s, or record more often.'
        )


def separate_again(found: Separation, drift: Sequence[FloatArray]) -> Separation:
    """Separate anew beside what the drift is about, N and N m, (N, 6) by recording."""
    # Then sudden heat is no step, nor a long press drift.
    return _separated(found.recordings, found.accelerometer, found.cells, found.fit, drift)


def _separated(
    recordings: Sequence[Recording],
    accelerometer: Accelerometer,
    cells: Cells,
    fit: Fit,
    known: Sequence[FloatArray] | None,
) -> Separation:
    """Find steps, states and weights by turns, with the drift that is known, (N, 6), taken off."""
    forces, axes = accelerometer.forces, axes_of(recordings)
    block_s = BLOCK_S if known is None else LONG_BLOCK_S
    off = [0.0 if known is None else known[n][:, axes] for n in range(len(recordings))]
    stepless = [
        with_wrench(each, each.wrench[:, axes] - drift, axes)
        for each, drift in zip(recordings, off, strict=True)
    ]
    steps: list[list[Step]] = [[] for _ in recordings]
    if known is not None:
        cells, fit = _again(cells, fit, cut(stepless, forces, None, block_s))
    while True:
        close = follow_closely(cells, fit) if known is None else fit
        states, counts = cells.join(close.states), cells.join(close.weights > COUNTS)
        found = 0
        for n, recording in enumerate(stepless):
            wrench = recording.wrench[:, axes]
            each = wrench - forces[n] @ fit.gains
            length = max(1, round(MEAN_S / recording.period_s))
            told = states[n], counts[n]
            for step in _steps_of(each, *told, length, fit.noise):
                if any(abs(step.cell - other.cell) < _APART for other in steps[n]):
                    continue
                wrench[step.cell :] -= step.jump
                steps[n].append(step)
                found += 1
            stepless[n] = with_wrench(recording, wrench, axes)
        if not found:
            break
        # How far a step goes is not known well before contacts are told apart: a block ends there.
        ends = [[step.cell for step in each] for each in steps]
        cells, fit = _again(cells, fit, cut(stepless, forces, ends, block_s))
    drift = []
    for n, recording in enumerate(stepless):
        weight = _held((forces[n] @ fit.gains), states[n])
        for step in steps[n]:
            counts[n][max(0, step.cell - _UNSURE) : step.cell + _UNSURE] = False
        wrench = np.where(counts[n][:, None], recording.wrench[:, axes], np.nan)
        for step in steps[n]:
            wrench[step.cell :] -= step_size(wrench - weight, counts[n], step.cell)
        loaded = _loaded(recording, wrench + off[n], weight, axes)
        drift.append(replace(loaded, steps=tuple(step.cell for step in steps[n])))
    return Separation(list(recordings), drift, accelerometer, cells, close, steps)


def _again(cells: Cells, fit: Fit, changed: Cells) -> tuple[Cells, Fit]:
    """Fit cells that have changed a little, or are cut into other blocks."""
    known = {
        name: changed.cut(cells.join(getattr(fit, name)))
        for name in ('states', 'weights', 'levels')
    }
    return changed, fit_again(changed, replace(fit, **known))


def _held(each: FloatArray, states: IntArray) -> FloatArray:
    """Choose what belongs to the state that holds, (K, N, A) to (N, A)."""
    return np.asarray(each[states, np.arange(len(states))])


def _steps_of(
    each: FloatArray, states: IntArray, counts: BoolArray, length: int, noise: FloatArray
) -> list[Step]:
    """Find steps in what each payload leaves, (K, N, A), by means over so many cells."""
    found = []
    rest = np.nan_to_num(_held(each, states))
    averaged = means(rest, counts, length)
    for before, after, jump, slope in suspect_steps(averaged, noise):
        first = max(0, before - 1) * length
        near = np.nan_to_num(each[:, first : (after + 2) * length])
        past = (first + np.arange(near.shape[1]))[:, np.newaxis] / length - before - 0.5
        near = near - past * slope
        at = first + locate(near, averaged[before], jump, noise)
        told = settled(rest, counts, at, jump, noise)
        found += [] if told is None else [Step(at, told)]
    return found


def _loaded(
    recording: Recording, wrench: FloatArray, weight: FloatArray, axes: Sequence[int]
) -> Recording:
    """Give a recording what counts of its wrench, NaN on other axes, and the weight."""
    reference = np.full_like(recording.reference, np.nan)
    reference[:, axes] = weight
    nothing = replace(recording, wrench=np.full_like(recording.wrench, np.nan))
    return replace(with_wrench(nothing, wrench, axes), reference=reference)
