"""
A day at work: payload, contacts and drift, what models leave of the drift, and its incident.

Two tests find what changes the sensor: the payloads' gains are s · R times those of a day before,
or the reading steps and stays, other than by a tare. That stops learning until three more days
have had no incident, or a person decides.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations, takewhile

import numpy as np

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.drift.drift_model import Drift, LEAST_RANGE_K, no_drift
from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.fit import data_checks
from wrist_ft_comp.fit.folds import averaged_cells, tared_means
from wrist_ft_comp.fit.thermometer_prediction import UNUSUAL
from wrist_ft_comp.learning.days import DayEntry, IncidentKind, LEARNT_FROM, NONE
from wrist_ft_comp.payload import separation as work
from wrist_ft_comp.payload.identify_payload import LEAST_FREE
from wrist_ft_comp.payload.mass_and_center import CONTRAST, gains_of, LEVER_M, MISFIT
from wrist_ft_comp.payload.mounted_payloads import cells_in, COUNTS, unexplained_contrast
from wrist_ft_comp.payload.weight import LearntPayloads, SAME_SHARE
from wrist_ft_comp.recording import Recording, time_in
from wrist_ft_comp.series import FloatArray
from wrist_ft_comp.steps_in_recordings import BESIDE_S, Step

#: Temperatures are the same coarse temperature within this interval, K.
_COARSE_K = 4.0
#: A jump of the zero is an incident from this share of the day's drift on an axis on: a smaller
#: one harms less than the drift that a model leaves.
_LEAST_DRIFT_SHARE = 0.2
#: It is at least this large, in standard deviations of a cell over all axes: on an axis that
#: hardly drifts, noise alone is a large share of the drift. 66 tares and a crash of a simulated
#: year had 400 and more.
_LEAST_JUMP_SIGMA = 50.0
#: A tare misses zero by less than this share of its step, and another step undoes a press, or the
#: weight of a part makes one, but for this share. The 66 tares missed zero by up to 0.13, and one
#: of 50 others, within a contact, by 0.24; 109 jumps by 0.28 and more. Half of it names a tare
#: within a contact; twice of it overlooks jumps toward zero. The cells free of contact beside a
#: jump show all but twice this share of it; the rest may be heat that no model explains: with a
#: model, 0.96 and more of the 66 tares was confirmed; without one, 0.75 overlooks a jump beside
#: four minutes of contact in a fast warm-up.
_JUMP_TOLERANCE = 0.25
#: Good days that have to come before learning goes on after an incident, before the noise of days
#: is usual, and before a model is judged that a person chose.
DAYS_TO_AGREE = 3
#: Days of these kinds stop learning.
_PAUSING: tuple[IncidentKind, ...] = ('zero', 'sensor')
#: Kind of the incident, and a sentence.
Incident = tuple[IncidentKind, str]


@dataclass(frozen=True, eq=False)
class Day:
    """A day that was separated."""

    recording: Recording
    #: The same with the payload's weight as the reference, without contacts and steps.
    drift: Recording
    steps: list[Step]
    #: Share of the time in contact.
    contact: float
    #: Share of the changes between poses that no payload explains.
    unexplained: float
    #: Standard deviation of a cell, N and N m, shape (6,).
    noise: FloatArray
    #: None where no payload can be identified.
    payloads: LearntPayloads | None
    #: Why no payload can be identified; empty where the robot only did not move enough.
    doubt: str
    #: The day before where this one goes on with it: the model was not at rest then.
    before: Recording | None = None


def look_at(recording: Recording, before: Recording | None = None) -> Day:
    """Separate drift from weight and contacts; CalibrationRefusedError where that fails."""
    separation = work.separate([recording])
    if recording.duration_s > work.SLOW_S:  # else a press of over a minute looks like drift
        separation = work.separate_again(separation, work.slow_drift(separation))
    cells, fit, bodies = separation.cells, separation.fit, separation.bodies()
    doubts = bodies.doubts()
    # Gravity has to move enough in the sensor's frame to tell weight from drift.
    moved = bodies.contrast[0] >= CONTRAST
    return Day(
        recording=separation.recordings[0], drift=separation.drift[0], steps=separation.steps[0],
        contact=float(np.mean(fit.weights[cells.usable] < COUNTS)), noise=fit.noise,
        unexplained=unexplained_contrast(cells, fit) if moved else 0.0,
        payloads=None if doubts else separation.payloads_of(bodies),
        doubt=doubts[-1] if doubts and bodies.contrast[1] >= CONTRAST else '',
        before=before)  # fmt: skip


def describe(day: Day) -> DayEntry:
    """Make a day's diary entry: temperatures, payloads, noise, and the drift without a model."""
    recording, learnt = day.recording, day.payloads
    low, high = recording.temperature_c.min(axis=0), recording.temperature_c.max(axis=0)
    payloads = learnt.payloads.values() if learnt else ()
    coarse_c = recording.temperature_c - recording.temperature_c[:, :1]
    coarse_c[:, 0] = recording.temperature_c[:, 0]
    known = np.floor(coarse_c / _COARSE_K).astype(int)
    return DayEntry(
        name=recording.name, first_ns=recording.first_cell * recording.period_ns,
        hours=recording.duration_s / 3600, left={NONE: left(no_drift(len(recording)), day)},
        temperature_c=tuple(zip(low.tolist(), high.tolist(), strict=True)),
        known=tuple(map(tuple, np.unique(known, axis=0).tolist())),
        payloads=tuple((payload.mass_kg, *payload.center_m.tolist()) for payload in payloads),
        rotation=tuple(learnt.frame.rotation.ravel().tolist()) if learnt else (),
        noise=tuple(day.noise.tolist()))  # fmt: skip


def left(simulated: Drift, day: Day) -> tuple[float, ...]:
    """Compute the RMS of what a model leaves of a day's drift, tared in its first minute, (6,)."""
    drift = day.drift
    residual = drift.wrench - simulated.zero - (1 + simulated.sensitivity) * drift.reference
    cells = averaged_cells(drift.period_s)
    errors = [tared_means(values, cells, drift.period_s) for values in residual.T]
    return tuple(float(np.sqrt(np.mean(e**2))) if len(e) else np.nan for e in errors)


def incident(
    day: Day, entry: DayEntry, before: Sequence[DayEntry], drift: FloatArray | float = 0.0
) -> Incident:
    """
    Find the incident of a day; ('', '') without one.

    The days before come oldest first. ``drift``, N and N m, (N, 6), is what the live model
    explains of this day; that is no jump of the zero.
    """
    if trouble := _thermometer_trouble(day.recording):
        return 'thermometer', trouble
    # Simulated days were in contact for 0.20 to 0.30 of the time.
    if day.contact >= 1 - LEAST_FREE or day.unexplained >= MISFIT:
        return 'contacts', (
            f'Something pushed on the sensor for {day.contact:.0%} of the day, and no payload '
            f'explains {day.unexplained:.0%} of the changes between poses.'
        )
    if found := _other_gains(day, entry, before) or _jump_of_zero(day, entry, drift):
        return found
    # Noise of specific force is that of a wrench times the mass: it is that of the payload, too.
    today = _gains(entry)
    past = np.array([
        other.noise for other in before
        if other.noise and other.kind in LEARNT_FROM
        and (not today or _share_one(today, _gains(other)))])  # fmt: skip
    usual = np.median(past, axis=0) if len(past) >= DAYS_TO_AGREE else np.inf
    ratios = np.array(entry.noise) / usual
    axis = int(ratios.argmax())
    # On ordinary days it was up to 1.9; half of the limit would refuse such days.
    if ratios[axis] < UNUSUAL:
        return '', ''
    return 'contacts', (
        f'The scatter of {AXES[axis]} is {entry.noise[axis]:.2g}, {ratios[axis]:.1f} times that '
        'of the days before: noise, or a robot that stands still while its gripper takes parts. '
        'No drift can be found in such readings.'
    )


def _thermometer_trouble(recording: Recording) -> str:
    """Say which thermometer stands still, is silent, or jumps; empty where none does."""
    moved = np.ptp(recording.temperature_c, axis=0).max() > LEAST_RANGE_K
    if moved and (idle := next(data_checks.idle_thermometers([recording]), '')):
        return idle
    try:
        _, sentences = data_checks.drop_unknown_temperatures([recording])
    except CalibrationRefusedError as error:
        return str(error)
    return ' '.join([*sentences, *data_checks.jumping_thermometers([recording])])


def _other_gains(day: Day, entry: DayEntry, before: Sequence[DayEntry]) -> Incident | None:
    """Compare today's gains with s · R times those of the days before."""
    past = [gains for other in before if other.kind != 'contacts' for gains in _gains(other)]
    today = _gains(entry)
    if not past:
        return None
    if not today:  # one day without a payload may be chance; of more, the second one says so
        lost = f'The weight of the days before is not found any more: {day.doubt}'
        since = takewhile(lambda other: not other.payloads, reversed(before))
        kinds = {other.kind for other in since}
        is_second = 'sensor' not in kinds and not kinds.isdisjoint(LEARNT_FROM)
        return ('sensor', lost) if day.doubt and is_second else None
    if _share_one(today, past):
        return None
    masses = ' and '.join(f'{mass_kg:.2f}' for mass_kg, *_ in entry.payloads)
    # The newest of the days before comes first: an older tool may be of another mounting.
    for earlier in reversed(past):
        # today = s · earlier · R by orthogonal Procrustes, in the first payload of today.
        left, size, right = np.linalg.svd(earlier.T @ today[0])
        signs = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
        scale, rotation = float(size @ signs / np.sum(earlier**2)), left * signs @ right
        scaled = [scale * gains @ rotation for gains in past]
        if all(any(_are_same(one, other) for other in scaled) for one in today):
            angle_deg = np.degrees(np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1, 1)))
            return 'sensor', (
                f'All payloads weigh {scale:.2f} times what they did ({masses} kg now), and the '
                f'sensor is turned by {angle_deg:.0f}° against its accelerometer, since the start '
                'of the day: its gain, its mounting or the frame of the specific force changed.'
            )
    newest = [other.payloads for other in before if other.payloads][-1]
    masses_before = ' and '.join(f'{mass_kg:.2f}' for mass_kg, *_ in newest)
    return 'tool', f'Another tool: payloads of {masses} kg, before {masses_before} kg.'


def _gains(entry: DayEntry) -> list[FloatArray]:
    """Make the gains of a day's payloads, kg, (6, 3), torques divided by a lever."""
    if not (entry.payloads and entry.rotation):
        return []
    gains = gains_of(np.array(entry.payloads), np.reshape(entry.rotation, (3, 3)))
    return [*np.swapaxes(gains / np.repeat([1.0, LEVER_M], 3), 1, 2)]


def _share_one(these: Sequence[FloatArray], others: Sequence[FloatArray]) -> bool:
    """Whether one of these gains is that of one of the others."""
    return any(_are_same(one, other) for one in these for other in others)


def _are_same(one: FloatArray, other: FloatArray) -> bool:
    """
    Whether two gains are those of one payload.

    SAME_SHARE is 3 % of the mass, 5 mm at a distance of 0.1 m, or a rotation of 2 degrees. From
    day to day gains differed by up to 0.0035, in contact by 0.023, with another tool by 0.13.
    """
    return bool(np.linalg.norm(one - other) < SAME_SHARE * np.linalg.norm(other))


def _jump_of_zero(day: Day, entry: DayEntry, drift: FloatArray | float) -> Incident | None:
    """
    Find a large step of the zero that stays, and is no tare of the driver.

    A tare is looked for within BESIDE_S of the step, because a contact may hide it, and the change
    of the level is that of the nearest cells free of contact that fill this time. None of these is
    farther away than five times this; a long contact beside a jump leaves none.
    """
    recording, noise = day.recording, day.noise
    drift_rms, raw = np.array(entry.left[NONE]), recording.wrench / noise
    residual = (recording.wrench - day.drift.reference - drift) / noise
    residual[~np.isfinite(day.drift.wrench)] = np.nan
    free = np.flatnonzero(np.isfinite(residual).all(axis=1))
    near, far = (cells_in(time_s, recording.period_s) for time_s in (BESIDE_S, 5 * BESIDE_S))
    for step in sorted(day.steps, key=lambda step: -np.linalg.norm(step.jump / noise)):
        at, jump = step.cell, step.jump / noise
        size = np.linalg.norm(jump)
        tolerated = _JUMP_TOLERANCE * size
        matters = np.abs(step.jump) > _LEAST_DRIFT_SHARE * drift_rms
        if size <= _LEAST_JUMP_SIGMA or not matters.any():
            continue
        if _distance_to_zero(raw[max(0, at - near) : at + near], min(at, near), jump) < tolerated:
            continue  # a tare
        if any(np.linalg.norm(other.jump / noise + jump) <= tolerated for other in day.steps):
            continue  # a press, which ends as it began
        before = free[(free < at) & (free >= at - far)][-near:]
        after = free[(free >= at) & (free < at + far)][:near]
        if not len(before) or not len(after):
            continue  # a press beside which nothing is free of contact
        change = np.median(residual[after], axis=0) - np.median(residual[before], axis=0)
        if np.linalg.norm(change - jump) >= 2 * tolerated:
            continue  # heat, or a press that ends where nothing is free of contact
        if day.payloads is not None:
            force = np.asarray(recording.specific_force)[at : at + near]
            pose = day.payloads.frame.turn(np.nanmedian(force, axis=0))
            weights = [payload.weight(pose) for payload in day.payloads.payloads.values()]
            swaps = [one - other for one, other in permutations(weights, 2)]
            if any(np.linalg.norm(swap / noise - jump) < tolerated for swap in swaps):
                return 'contacts', (
                    f'The reading stepped at {time_in(recording, at)} by what the payloads of '
                    'the day differ by, as where a robot is parked with a part for long: its '
                    'drift cannot be learnt.'
                )
        sizes = ', '.join(f'{axis_jump:.2g}' for axis_jump in step.jump)
        return 'zero', (
            f'The zero jumped at {time_in(recording, at)} by {sizes} (N and N m), and no tare '
            'of the driver did that: an overload?'
        )
    return None


def _distance_to_zero(readings: FloatArray, at: int, jump: FloatArray) -> float:
    """Compute how far a step before cell ``at`` leaves the readings near it, (n, A), from zero."""
    after = readings + (np.arange(len(readings)) < at)[:, np.newaxis] * jump
    # A robot that moves is between two cells when it is tared: the nearest point between them.
    change = np.diff(after, axis=0)
    share = -np.sum(after[:-1] * change, axis=1) / np.maximum(np.sum(change**2, axis=1), 1e-12)
    distance = np.linalg.norm(after[:-1] + np.clip(share, 0, 1)[:, np.newaxis] * change, axis=1)
    return float(np.min(distance, initial=np.inf, where=np.isfinite(distance)))


def pause(entries: Sequence[DayEntry], since: str) -> str:
    """Say why learning has stopped on its own; empty when it has not."""
    why, agreeing = '', 0
    for entry in entries:
        if entry.kind in _PAUSING and entry.name > since:
            why, agreeing = f'{entry.name}: {entry.incident}', 0
        elif entry.kind in LEARNT_FROM:
            agreeing += 1
    if not why or agreeing >= DAYS_TO_AGREE:
        return ''
    return (
        f'{why} Learning goes on after {DAYS_TO_AGREE} days without an incident ({agreeing} so '
        'far). To end this pause, call ~/calibrate or ~/adopt; their model is kept for as long.'
    )
