"""
Separate payload, contacts and tares of the driver from the drift of recordings at work.

1. Bias and scale of the accelerometer are fitted to its norm at rest.
2. Payload states, gains of specific force and robust weights of cells are fitted.
3. Steps that no payload explains are tares of the driver (``steps.py``), and are taken out. Every
   step gives the later fit of the drift a constant of its own, so a step that was suspected
   wrongly costs little.
4. In the result, readings are NaN where a contact, a fast turn or a change of the payload was. The
   payload's weight is the reference, from which gain drift is learnt.

Steps 2 to 4 are done again when the drift is roughly known, from its slowness or from a model that
was learnt from the first result. With that drift subtracted, sudden heat does not look like a
step, and a long press does not look like drift.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.payload.accelerometer import Accelerometer, calibrated_by_norm
from wrist_ft_comp.payload.mass_and_center import RigidBodies
from wrist_ft_comp.payload.payload_states import (
    axes_of,
    BLOCK_S,
    bodies_of,
    Cells,
    cells_in,
    COUNTS,
    cut,
    find_states,
    Fit,
    fit_again,
    LEAST_CELLS_IN_BLOCK,
    LEAST_FREE_SHARE,
    medians,
    of_state,
)
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import FloatArray, IntArray
from wrist_ft_comp.steps import find_steps, Step

#: Time on either side of a step that does not count, s, because the step's place may be wrong.
_UNSURE_S = 2.0
#: Most rounds in which steps and contacts are found by turns.
_MOST_ROUNDS = 4
#: A shorter recording, s, does not show which changes are slow.
SLOW_S = 7200.0
#: Length of a bin of the slow drift, s; drift hardly moves within one.
_BIN_S = 60.0
#: Window of the slow drift's running median, s. With it, presses of up to 300 s in 15 % of the
#: time do no harm: a perfect model leaves as much as without presses.
_WINDOW_S = 1260.0


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

    CalibrationRefusedError when too few cells, or too few neighbours, hold both wrench and
    specific force.
    """
    accelerometer = calibrated_by_norm(recordings)
    for recording, force in zip(recordings, accelerometer.forces, strict=True):
        rows = np.column_stack([recording.wrench[:, axes_of([recording])], force])
        complete = np.isfinite(rows.sum(axis=1))
        # Contacts show in neighbouring cells.
        if 2 * np.sum(complete[1:] & complete[:-1]) < complete.sum():
            apart_s = recording.period_s * float(np.median(np.diff(np.flatnonzero(complete))))
            raise CalibrationRefusedError(
                f'{recording.name} holds wrench and specific force every {apart_s:g} s; the '
                'reference payload needs them in most thermal cells, of '
                f'{recording.period_s:g} s each. Set the thermal period to {apart_s:g} s, or '
                'record more often.'
            )
    cells, least = cut(recordings, accelerometer.forces), 4 * LEAST_CELLS_IN_BLOCK
    if cells.usable.sum() < least or not cells.axes:
        raise CalibrationRefusedError(
            f'{", ".join(r.name for r in recordings)} hold {cells.usable.sum()} thermal cells '
            'with wrench and specific force that turn slowly; at least '
            f'{least} are needed for the reference payload. Record both at the same time.'
        )
    start = Separation(list(recordings), [], accelerometer, cells, find_states(cells), [])
    nothing = [np.zeros_like(recording.wrench) for recording in recordings]
    return _separated(replace(start, steps=[[] for _ in recordings]), nothing, BLOCK_S)


def separate_again(found: Separation, drift: Sequence[FloatArray]) -> Separation:
    """Separate again, with the estimated drift, N and N m, (N, 6) per recording, taken off."""
    return _separated(found, drift, 3 * BLOCK_S)


def slow_drift(separation: Separation) -> list[FloatArray]:
    """
    Estimate the drift before there is a model of it: what is slow is drift.

    A running median follows slow and sudden drift, but no press of a few minutes. Gives N and N m,
    (N, 6) per recording; 0 on axes that are not held.
    """
    axes, drifts = axes_of(separation.recordings), []
    for recording in separation.drift:
        residual = (recording.wrench - recording.reference)[:, axes]
        length = cells_in(_BIN_S, recording.period_s)
        bins = np.pad(residual, ((0, -len(residual) % length), (0, 0)), constant_values=np.nan)
        bins = bins.reshape(-1, length, len(axes))
        # A few free cells of a bin may be of a long press that looks like drift.
        free = np.isfinite(bins[..., 0]).mean(axis=1, keepdims=True) > LEAST_FREE_SHARE
        half = round(_WINDOW_S / _BIN_S / 2)
        bins = np.where(free, medians(bins), np.nan)
        bins = np.pad(bins, ((half, half), (0, 0)), constant_values=np.nan)
        windows = np.lib.stride_tricks.sliding_window_view(bins, 2 * half + 1, axis=0)
        measured = np.flatnonzero(np.isfinite(windows[:, 0]).any(axis=1))
        drift, path = np.zeros_like(recording.wrench), medians(windows.transpose(0, 2, 1))
        for axis, values in zip(axes if len(measured) else (), path[measured].T, strict=False):
            middles = (measured + 0.5) * length
            drift[:, axis] = np.interp(np.arange(len(drift)) + 0.5, middles, values)
        drifts.append(drift)
    return drifts


def _separated(start: Separation, drift: Sequence[FloatArray], block_s: float) -> Separation:
    """Find steps, states and weights by turns, with a known drift, (N, 6), taken off."""
    cells, fit, steps, forces = start.cells, start.fit, start.steps, start.accelerometer.forces
    recordings, axes = start.recordings, axes_of(start.recordings)
    wrenches = [(r.wrench - d)[:, axes] for r, d in zip(recordings, drift, strict=True)]
    for number in range(1, _MOST_ROUNDS + 1):
        # How far a step goes is not known well before contacts are found: a block ends at it.
        cells_before, ends = cells, [[step.cell for step in found] for found in steps]
        stepless = [
            _with_wrench(recording, _without_steps(wrench, found), axes)
            for recording, wrench, found in zip(recordings, wrenches, steps, strict=True)
        ]
        cells = cut(stepless, forces, ends, block_s)
        states, weights, levels = (
            np.concatenate(cells_before.join(part))[cells.rows]
            for part in (fit.states, fit.weights, fit.levels)
        )
        weights = weights * cells.usable
        fit = fit_again(cells, replace(fit, states=states, weights=weights, levels=levels))
        mounted, counts = cells.join(fit.states), cells.join(fit.weights > COUNTS)
        if number == _MOST_ROUNDS:
            break  # states and contacts have to be those of the last steps
        # All steps are judged anew, by the contacts that are known by now.
        steps = [
            find_steps(wrench - force @ fit.gains, state, count, fit.noise, recording.period_s)
            for recording, wrench, force, state, count in zip(
                recordings, wrenches, forces, mounted, counts, strict=True
            )
        ]
        if ends == [[step.cell for step in found] for found in steps]:
            break
    drifts = []
    for n, recording in enumerate(recordings):
        unsure = cells_in(_UNSURE_S, recording.period_s)
        for step in steps[n]:
            counts[n][max(0, step.cell - unsure) : step.cell + unsure] = False
        empty = np.full_like(recording.wrench, np.nan)
        free = replace(recording, wrench=empty, reference=empty.copy())
        wrench = _without_steps(recording.wrench[:, axes], steps[n])
        free = _with_wrench(free, np.where(counts[n][:, None], wrench, np.nan), axes)
        free.reference[:, axes] = of_state(forces[n] @ fit.gains, mounted[n])
        drifts.append(replace(free, steps=tuple(step.cell for step in steps[n])))
    return Separation(recordings, drifts, start.accelerometer, cells, fit, steps)


def _without_steps(wrench: FloatArray, steps: Sequence[Step]) -> FloatArray:
    """Take steps out of a wrench, (N, A)."""
    stepless = wrench.copy()
    for step in steps:
        stepless[step.cell :] -= step.jump
    return stepless


def _with_wrench(recording: Recording, wrench: FloatArray, axes: Sequence[int]) -> Recording:
    """Replace the wrench of some axes, (N, A)."""
    whole = recording.wrench.copy()
    whole[:, axes] = wrench
    return replace(recording, wrench=whole)
