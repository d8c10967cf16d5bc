"""
What is learnt from recordings at work: payloads, apart from contacts, tares and drift.

The steps are those of docs/algorithm.md, section 9. In the result, readings are NaN where a
contact, a fast turn or a change of the payload was, and the payload's weight is the reference.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.drift.drift_model import DriftModel
from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.payload import mounted_payloads
from wrist_ft_comp.payload.accelerometer_calibration import Accelerometer, calibrated_by_norm
from wrist_ft_comp.payload.mass_and_center import RigidBodies
from wrist_ft_comp.payload.mounted_payloads import BLOCK_S, Cells, COUNTS, Fit, ROUNDS
from wrist_ft_comp.payload.weight import LearntPayloads
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import FloatArray
from wrist_ft_comp.steps_in_recordings import find_steps, Step
from wrist_ft_comp.stream.drift_of_recordings import simulate_drift

#: A shorter recording, s, does not show which changes are slow.
SLOW_S = 7200.0
#: Time on either side of a step that does not count, s, because the step's place may be wrong.
_UNSURE_S = 2.0
#: By TF, which shows no acceleration, a robot that rests for less of the time swings its payload.
_RESTED_SHARE = 0.8


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
    #: Named by numbers; None where none can be identified.
    payloads: LearntPayloads | None = None
    #: Doubts, in sentences.
    warnings: tuple[str, ...] = ()

    def bodies(self) -> RigidBodies:
        """Fit rigid bodies, which RigidBodies.doubts judges."""
        return mounted_payloads.bodies_of(self.cells, self.fit, self.accelerometer.scale)

    def payloads_of(self, bodies: RigidBodies) -> LearntPayloads:
        """Name the bodies that were mounted."""
        named = bodies.named(self.fit.states[self.fit.weights > COUNTS])
        return LearntPayloads(replace(self.accelerometer.frame, rotation=bodies.rotation), named)


def learn_at_work(
    recordings: Sequence[Recording],
    learn_drift: Callable[[list[Recording]], DriftModel] | None = None,
) -> Separation:
    """
    Separate payloads and drift; CalibrationRefusedError where neither can be learnt.

    With ``learn_drift``, which fits a model to recordings without payload, the drift of a first
    separation is taken off, so that weight and contacts are separated better.
    """
    separation = separate(recordings)
    if learn_drift is not None:
        model = learn_drift(separation.drift)
        drift = [simulate_drift(model, recording).zero for recording in recordings]
        separation = separate_again(separation, drift)
    bodies, warnings = separation.bodies(), []
    share = mounted_payloads.unexplained_contrast(separation.cells, separation.fit)
    objections = bodies.doubts(share)
    if not separation.accelerometer.rested:
        warnings.append(
            f'The robot never rests in {", ".join(r.name for r in recordings)}, so that the '
            'accelerometer could not be compared with gravity: masses may be some per cent off. '
            'Let the robot rest for some seconds in several poses.'
        )
    elif separation.accelerometer.by_tf and separation.accelerometer.rested < _RESTED_SHARE:
        warnings.append(
            'TF does not show how the robot accelerates, and it rests in '
            f'{separation.accelerometer.rested:.0%} of the time only: masses may be 10 % off. '
            'Identify payloads by ~/identify_payload, with rests of two seconds.'
        )
    payloads = None if objections else separation.payloads_of(bodies)
    return replace(separation, payloads=payloads, warnings=(*warnings, *objections))


def separate(recordings: Sequence[Recording]) -> Separation:
    """
    Separate payload, contacts, steps and drift.

    CalibrationRefusedError where a recording lacks an axis or specific force, or where too few
    cells hold both.
    """
    for recording in recordings:
        lacking = [axis for axis in AXES if axis not in recording.axes_present]
        if recording.specific_force is None:
            lacking.append('specific force')
        if lacking:
            raise CalibrationRefusedError(
                f'{recording.name} holds no {" and no ".join(lacking)}; the reference payload '
                'needs six axes and specific force. Look whether the IMU, or TF, was recorded, '
                'stamped by the clock of the wrench.'
            )
    accelerometer = calibrated_by_norm(recordings)
    cells = mounted_payloads.cut(recordings, accelerometer.forces)
    least = 4 * mounted_payloads.CELLS_PER_POWER * mounted_payloads.POWERS
    if cells.usable.sum() < least:
        raise CalibrationRefusedError(
            f'Only {cells.usable.sum()} thermal cells of {", ".join(r.name for r in recordings)} '
            f'have wrench and specific force while the robot turns slowly; at least {least} are '
            'needed for the reference payload. Record both at the same time, and more often than '
            'in each thermal cell, or calibrate with a longer --thermal-period.'
        )
    fit, no_steps = mounted_payloads.find_states(cells), [list[Step]() for _ in recordings]
    start = Separation(list(recordings), [], accelerometer, cells, fit, no_steps)
    nothing = [np.zeros_like(recording.wrench) for recording in recordings]
    return separate_again(start, nothing, BLOCK_S)


def slow_drift(separation: Separation) -> list[FloatArray]:
    """
    Estimate drift without a model of it, N and N m, (N, 6) per recording: what is slow is drift.

    A running median over ten bins on both sides follows slow and sudden drift, but no press of a
    few minutes: presses of up to BLOCK_S in 15 % of the time do not harm it. Drift hardly moves
    within a bin, a fifth of BLOCK_S.
    """
    drifts, half = [], 10
    for recording in separation.drift:
        residual = recording.wrench - recording.reference
        length = mounted_payloads.cells_in(BLOCK_S / 5, recording.period_s)
        bins = np.pad(residual, ((0, -len(residual) % length), (0, 0)), constant_values=np.nan)
        bins = bins.reshape(-1, length, len(AXES))
        # A few free cells of a bin may be of a long press that looks like drift.
        free = np.isfinite(bins[..., :1]).mean(axis=1) > mounted_payloads.LEAST_FREE_SHARE
        bins = np.where(free, mounted_payloads.medians(bins), np.nan)
        bins = np.pad(bins, ((half, half), (0, 0)), constant_values=np.nan)
        windows = np.lib.stride_tricks.sliding_window_view(bins, 2 * half + 1, axis=0)
        path = mounted_payloads.medians(windows.transpose(0, 2, 1))
        measured = np.isfinite(windows[:, 0]).any(axis=1)
        middles = (np.flatnonzero(measured) + 0.5) * length
        cells = np.arange(len(residual)) + 0.5
        slow = [np.interp(cells, middles, axis[measured]) for axis in path.T if measured.any()]
        drifts.append(np.stack(slow, axis=1) if slow else np.zeros_like(residual))
    return drifts


def separate_again(
    start: Separation, drift: Sequence[FloatArray], block_s: float = 3 * BLOCK_S
) -> Separation:
    """Find steps, states and weights by turns, with the estimated drift, (N, 6), taken off."""
    cells, fit, steps, forces = start.cells, start.fit, start.steps, start.accelerometer.forces
    recordings = start.recordings
    wrenches = [r.wrench - d for r, d in zip(recordings, drift, strict=True)]
    for number in range(1, ROUNDS + 1):
        # How far a step goes is not known well before contacts are found: a block ends at it.
        cells_before, ends = cells, [[step.cell for step in found] for found in steps]
        stepless = [_without_steps(*pair) for pair in zip(wrenches, steps, strict=True)]
        cells = mounted_payloads.cut(recordings, forces, ends, block_s, stepless)
        if not cells.usable.any():
            raise CalibrationRefusedError(
                f'{", ".join(r.name for r in recordings)}: the readings step so often that no '
                'stretch is left to learn a payload from. Does the specific force belong to this '
                'sensor and time?'
            )
        states, weights, levels = (
            np.concatenate(cells_before.join(part))[cells.rows]
            for part in (fit.states, fit.weights, fit.levels)
        )
        fit = replace(fit, states=states, weights=weights * cells.usable, levels=levels)
        fit = mounted_payloads.fit_again(cells, fit)
        mounted, counts = cells.join(fit.states), cells.join(fit.weights > COUNTS)
        if number == ROUNDS:
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
        unsure = mounted_payloads.cells_in(_UNSURE_S, recording.period_s)
        for cell in ends[n]:
            counts[n][max(0, cell - unsure) : cell + unsure] = False
        wrench = np.where(counts[n][:, None], _without_steps(recording.wrench, steps[n]), np.nan)
        weight = mounted_payloads.of_state(forces[n] @ fit.gains, mounted[n])
        drifts.append(replace(recording, wrench=wrench, reference=weight, steps=tuple(ends[n])))
    return Separation(recordings, drifts, start.accelerometer, cells, fit, steps)


def _without_steps(wrench: FloatArray, steps: Sequence[Step]) -> FloatArray:
    stepless = wrench.copy()
    for step in steps:
        stepless[step.cell :] -= step.jump
    return stepless
