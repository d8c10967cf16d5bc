"""
What a calibration learns from recordings at work: drift, payloads, and doubts about them.

Doubts are sentences with numbers, so that nothing fails in silence. Learnt payloads can be taken
off the recordings again, which leaves the external wrench.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrist_ft_comp.drift.drift_model import correct, DriftModel
from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.payload.accelerometer import CONTRAST
from wrist_ft_comp.payload.mass_and_center import RigidBodies
from wrist_ft_comp.payload.payload_states import unexplained_contrast
from wrist_ft_comp.payload.separation import separate, separate_again, Separation
from wrist_ft_comp.payload.weight import LearntPayloads
from wrist_ft_comp.recording import Correction, Recording
from wrist_ft_comp.series import FloatArray, IntArray
from wrist_ft_comp.stream.offline import correct_many, simulate_drift, track_drift

#: Above this share of changes between poses that do not turn with the specific force, no payload
#: is identified, and above three times this share nothing is learnt at all. Poses in a cone of 30°
#: reach 0.59 on drawn days that are well.
_MOST_UNEXPLAINED = 0.2


@dataclass(frozen=True, eq=False)
class AtWork:
    """What was learnt from recordings at work."""

    separation: Separation
    #: Named by numbers; None where none can be identified.
    payloads: LearntPayloads | None
    #: Doubts, in sentences.
    warnings: tuple[str, ...]


def learn_at_work(
    recordings: Sequence[Recording], first: tuple[AtWork, DriftModel] | None = None
) -> AtWork:
    """
    Separate payloads and drift; CalibrationRefusedError where neither can be learnt.

    The second time, ``first`` is the result for the same recordings and the drift model that was
    fitted to it. That drift is taken off, so that weight and contacts are separated better.
    """
    if first:
        drift = [simulate_drift(first[1], recording).zero for recording in recordings]
        separation = separate_again(first[0].separation, drift)
    else:
        separation = separate(recordings)
    bodies, warnings = separation.bodies(), []
    objections = doubts(separation, bodies)
    if not separation.accelerometer.rested:
        warnings.append(
            f'No thermal cell of {", ".join(r.name for r in recordings)} is at rest, so that the '
            'accelerometer could not be compared with gravity: masses may be some per cent off. '
            'Let the robot rest for some thermal cells in several poses.'
        )
    payloads = None if objections else payloads_of(separation, bodies)
    return AtWork(separation, payloads, (*warnings, *objections))


def payloads_of(separation: Separation, bodies: RigidBodies) -> LearntPayloads:
    """Name the payloads that were mounted by numbers, the lightest first."""
    states = np.concatenate(separation.states)
    shares = [float(np.mean(states[states >= 0] == k)) for k in range(len(bodies.mass_kg))]
    mounted = bodies.tangible & (np.array(shares) > 0)
    order = [int(k) for k in np.argsort(bodies.mass_kg) if mounted[k]]
    frame = replace(separation.accelerometer.frame, rotation=bodies.rotation)
    numbered = {str(n): bodies.payload(k, shares[k]) for n, k in enumerate(order, 1)}
    return LearntPayloads(frame, numbered)


def doubts(separation: Separation, bodies: RigidBodies) -> list[str]:
    """
    List the reasons why no payload can be identified; empty where payloads can.

    CalibrationRefusedError when nothing can be learnt, because most of the wrench does not turn
    with the specific force.
    """
    objections = bodies.doubts()
    share = unexplained_contrast(separation.cells, separation.fit)
    if bodies.contrast[0] < CONTRAST or share <= _MOST_UNEXPLAINED:
        return objections
    what = (
        f'{share:.0%} of what changes between poses does not turn with the specific force; at '
        f'most {_MOST_UNEXPLAINED:.0%} are allowed. The specific force is of another frame, or of '
        'another clock than the wrench, or a cable pulls.'
    )
    if share > 3 * _MOST_UNEXPLAINED:
        raise CalibrationRefusedError(
            f'{what} Neither payload nor drift can be learnt. Record the specific force of a '
            'frame fixed to the sensor, by its clock.'
        )
    return [f'{what} No payload was identified.', *objections]


def external_correction(separation: Separation, model: DriftModel, fine: Recording) -> Correction:
    """
    Make the function that turns raw wrenches of a recording into external ones.

    They are zero in free motion, and NaN where no specific force came within a thermal cell.
    Payload states and gains are those of the separation; specific force is that of ``fine``, the
    same recording on a finer grid.
    """
    recording, drift = separation.recordings[0], separation.drift[0]

    def cells_at(stamps_ns: IntArray) -> IntArray:
        """Find the cells of stamps; outside the recording that is its first or last cell."""
        numbers = stamps_ns // recording.period_ns - recording.first_cell
        return np.clip(numbers, 0, len(recording) - 1)

    # Cells in contact take the state of the last free cell before them, or else the first one.
    states = separation.states[0]
    counted = np.flatnonzero(states >= 0)
    last = np.searchsorted(counted, np.arange(len(states)), side='right') - 1
    states = states[counted[np.maximum(last, 0)]]
    force = np.full((len(fine), 3), np.nan) if fine.specific_force is None else fine.specific_force
    finite = np.flatnonzero(np.isfinite(force).all(axis=1))
    force_ns = (fine.first_cell + finite) * fine.period_ns + fine.period_ns // 2
    corrected = separation.accelerometer.frame.turn(force[finite])
    weight = np.einsum('ni,nia->na', corrected, separation.fit.gains[states[cells_at(force_ns)]])
    # The offset between steps of the zero comes from free motion; NaN without any.
    free = np.asarray(np.isfinite(drift.wrench).any(axis=1))
    rest = correct(recording.wrench, simulate_drift(model, recording), 0.0) - drift.reference
    offset = np.full_like(rest, np.nan)
    edges = sorted(step.cell for step in separation.steps[0])
    for part in np.split(np.arange(len(rest)), edges):
        if free[part].any():
            offset[part] = np.median(rest[part[free[part]]], axis=0)
    track = track_drift(model, recording)

    def external(stamps_ns: IntArray, raw: FloatArray) -> FloatArray:
        """Subtract drift, weight and offset."""
        wanted_ns, known_ns = stamps_ns - force_ns[0], force_ns - force_ns[0]
        places = np.interp(wanted_ns, known_ns, np.arange(len(force_ns)))
        apart_ns = np.abs(wanted_ns - known_ns[np.rint(places).astype(np.int64)])
        weights = [np.interp(wanted_ns, known_ns, axis) for axis in weight.T]
        wrench = correct_many(track, stamps_ns, raw) - np.stack(weights, axis=1)
        near = apart_ns[:, None] <= recording.period_ns
        return np.where(near, wrench - offset[cells_at(stamps_ns)], np.nan)

    return external
