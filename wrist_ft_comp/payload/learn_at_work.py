"""
What a calibration learns from recordings at work: drift, payloads, and doubts about them.

Doubts are sentences with numbers, so that nothing fails in silence. Learnt payloads can be taken
off the recordings again, which leaves the external wrench.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.drift.drift_model import correct, DriftModel
from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.payload.accelerometer import calibrated_by_norm, CONTRAST
from wrist_ft_comp.payload.mass_and_center import LIGHTEST_KG, RigidBodies
from wrist_ft_comp.payload.payload_states import (
    axes_of,
    contrast,
    cut,
    fitted_levels,
    solve,
    unexplained_contrast,
)
from wrist_ft_comp.payload.separation import separate, separate_again, Separation
from wrist_ft_comp.payload.weight import LearntPayloads
from wrist_ft_comp.recording import Correction, Recording, Reference
from wrist_ft_comp.series import FloatArray, IntArray, NANOSECONDS
from wrist_ft_comp.stream.offline import correct_many, simulate_drift, track_drift

#: Above this share of changes between poses that do not turn with the specific force, no payload
#: is identified, and above three times this share nothing is learnt at all.
_MOST_UNEXPLAINED = 0.2
#: A wrench follows gravity where this share of its changes turns with the specific force.
_FOLLOWS_GRAVITY = 0.5
#: Longer thermal cells, s, are seldom free of contact. With contacts in 40 % of the time, cells of
#: 10 s take contact for noise: drift is then left 1.6 to 4.7 times as much as with cells of 1 s.
_LONG_CELL_S = 5.0
#: A specific force is used for wrenches within this time, ns, or within one and a half of the
#: median distances between its samples, if that is more.
_TIMEOUT_NS = NANOSECONDS // 5


@dataclass(frozen=True, eq=False)
class AtWork:
    """What was learnt from recordings at work."""

    #: All recordings, with the weight as the reference; zero without specific force.
    drift: list[Recording]
    #: Of the recordings that hold specific force; None where none does.
    separation: Separation | None
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
    warnings = [
        f'{recording.name} holds no specific force; its load counts as constant.'
        for recording in recordings
        if recording.specific_force is None
    ]
    # A constant load is taken for zero: it becomes part of the recording's offset.
    constant = [replace(r, reference=np.zeros_like(r.reference)) for r in recordings]
    moved = [recording for recording in recordings if recording.specific_force is not None]
    if not moved:
        return AtWork(constant, None, None, tuple(warnings))
    before = first[0].separation if first else None
    if first and before:
        drift = [simulate_drift(first[1], recording).zero for recording in moved]
        separation = separate_again(before, drift)
    else:
        separation = separate(moved)
    bodies = separation.bodies()
    objections = doubts(separation, bodies)
    if not separation.accelerometer.rested:
        warnings.append(
            f'No thermal cell of {", ".join(r.name for r in moved)} is at rest, so that the '
            'accelerometer could not be compared with gravity: masses may be some per cent off. '
            'Let the robot rest for some thermal cells in several poses.'
        )
    if moved[0].period_s > _LONG_CELL_S:
        warnings.append(
            f'Thermal cells of {moved[0].period_s:g} s are long for a robot at work: where it '
            'touches things often, hardly one is free of contact. Set the thermal period to 1 s.'
        )
    separated = iter(separation.drift)
    return AtWork(
        [r if r.specific_force is None else next(separated) for r in constant],
        separation,
        payloads_of(separation, bodies) if bodies and not objections else None,
        (*warnings, *objections),
    )


def payloads_of(separation: Separation, bodies: RigidBodies) -> LearntPayloads:
    """Name the payloads that were mounted by numbers, the lightest first."""
    states = np.concatenate(separation.states)
    shares = [float(np.mean(states[states >= 0] == k)) for k in range(len(bodies.mass_kg))]
    mounted = bodies.tangible & (np.array(shares) > 0)
    order = [int(k) for k in np.argsort(bodies.mass_kg) if mounted[k]]
    frame = replace(separation.accelerometer.frame, rotation=bodies.rotation)
    numbered = {str(n): bodies.payload(k, shares[k]) for n, k in enumerate(order, 1)}
    return LearntPayloads(frame, numbered)


def doubts(separation: Separation, bodies: RigidBodies | None) -> list[str]:
    """
    List the reasons why no payload can be identified; empty where payloads can.

    CalibrationRefusedError when nothing can be learnt, because most of the wrench does not turn
    with the specific force.
    """
    if bodies:
        objections = bodies.doubts()
    else:
        objections = ['A payload is identified only where all six axes were recorded.']
    share = unexplained_contrast(separation.cells, separation.fit)
    if contrast(separation.cells, separation.fit.weights) < CONTRAST or share <= _MOST_UNEXPLAINED:
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


def follows_gravity(recordings: Sequence[Recording], reference: Reference) -> Iterator[str]:
    """Doubt a wrench that was declared unloaded or constant, but turns with the specific force."""
    for recording in recordings:
        if recording.specific_force is None or not axes_of([recording]):
            continue
        cells = cut([recording], calibrated_by_norm([recording]).forces)
        weights, states = cells.usable.astype(float), np.zeros(cells.usable.shape, dtype=np.int64)
        (gains,) = solve(cells, states, weights, 1)
        before, after = (
            np.einsum('nb,nbi->', weights, (part - fitted_levels(part, weights)) ** 2)
            for part in (cells.wrench, cells.wrench - cells.force @ gains)
        )
        share = 1 - after / before if before > 0 else 0.0
        mass_kg = float(np.linalg.norm(gains) / np.sqrt(3))
        if share > _FOLLOWS_GRAVITY and mass_kg > LIGHTEST_KG:
            yield (
                f'The wrench of {recording.name} follows gravity: {share:.0%} of what changes '
                f'within minutes turns with the specific force, as about {mass_kg:.2g} kg would, '
                f'but the reference is {reference}. Use the reference payload (--reference '
                'payload; calibration.reference of a node).'
            )


def external_correction(separation: Separation, model: DriftModel, fine: Recording) -> Correction:
    """
    Make the function that turns raw wrenches of a recording into external ones.

    They are zero in free motion, and NaN where specific force is missing. Payload states and gains
    are those of the separation; specific force is that of ``fine``, the same recording on a finer
    grid.
    """
    recording, drift = separation.recordings[0], separation.drift[0]
    gains = np.full((len(separation.fit.gains), 3, len(AXES)), np.nan)
    gains[:, :, axes_of([recording])] = separation.fit.gains

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
    weight = np.einsum('ni,nia->na', corrected, gains[states[cells_at(force_ns)]])
    usual_ns = float(np.median(np.diff(force_ns))) if len(force_ns) > 1 else 0.0
    farthest_ns = max(_TIMEOUT_NS, 1.5 * usual_ns)
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
        near = np.abs(wanted_ns - known_ns[np.rint(places).astype(np.int64)]) <= farthest_ns
        weights = [np.interp(wanted_ns, known_ns, axis) for axis in weight.T]
        wrench = correct_many(track, stamps_ns, raw) - np.stack(weights, axis=1)
        return np.where(near[:, None], wrench - offset[cells_at(stamps_ns)], np.nan)

    return external
