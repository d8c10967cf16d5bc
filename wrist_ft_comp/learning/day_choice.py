"""
Which days are learnt from: those set aside by an incident, the worthiest, and those deleted.

Two tests find what changes the sensor: the payloads' gains are s · R times those of a day before,
or the reading steps and stays, other than by a tare. That stops learning until three more days
have had no incident, or a person decides. No day is forgotten.
"""

from collections import Counter
from collections.abc import Sequence
from itertools import permutations
from pathlib import Path

import numpy as np

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.drift.axis_model import LEAST_RANGE_K
from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.fit import data_checks
from wrist_ft_comp.fit.thermometer_prediction import UNUSUAL
from wrist_ft_comp.learning import diary
from wrist_ft_comp.learning.day_at_work import Day
from wrist_ft_comp.learning.day_files import days, size_of
from wrist_ft_comp.learning.diary import DayEntry, Diary, IncidentKind, NONE
from wrist_ft_comp.payload.identify_payload import LEAST_FREE
from wrist_ft_comp.payload.mass_and_center import LEVER_M, MISFIT
from wrist_ft_comp.payload.mounted_payloads import cells_in
from wrist_ft_comp.payload.weight import SAME_SHARE
from wrist_ft_comp.recording import Recording, time_in
from wrist_ft_comp.series import FloatArray
from wrist_ft_comp.stored.safe_file import writing
from wrist_ft_comp.zero_steps import BESIDE_S

#: Fewest days that a model is learnt from.
FEWEST_DAYS = 2
#: Most days that a model is learnt from. They bound the cost, and all seasons fit into them.
MOST_DAYS = 12
#: A model is learnt when the number of good days has grown by a third: on the 2nd, 3rd, 4th,
#: 6th, 8th, 11th, 15th, 20th … good day.
_GROWTH_PARTS = 3
#: One is also learnt after a day on which the live model left more than this many times what it
#: leaves on the median day.
_BAD_RATIO = 2.0
ANOTHER_DAY = 'One more good day is needed before a model is learnt.'
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
#: Kind of the incident, and a sentence.
Incident = tuple[diary.IncidentKind, str]
#: Days of these kinds are learnt from, ...
LEARNT_FROM: tuple[IncidentKind, ...] = ('', 'tool')
#: ... and days of these kinds stop learning.
PAUSING: tuple[IncidentKind, ...] = ('zero', 'sensor')
#: Good days that have to come before learning goes on after an incident, before the noise of days
#: is usual, and before a model is judged that a person chose.
DAYS_TO_AGREE = 3


def good_days(entries: Sequence[DayEntry]) -> list[DayEntry]:
    """Choose days without an incident that have as many thermometers as the newest."""
    good = [entry for entry in entries if entry.kind in LEARNT_FROM]
    return [day for day in good if len(day.temperature_c) == len(good[-1].temperature_c)]


def worthiest(entries: Sequence[DayEntry], most: int) -> list[DayEntry]:
    """Choose at most ``most`` days, in order: the newer half, and those with rare temperatures."""
    chosen, newer = list(entries), max(most // 2, 1)
    while len(chosen) > max(most, 1):
        good = good_days(chosen)
        count = Counter(cell for day in good for cell in day.known)
        worth = [
            sum(1 / count[cell] for cell in day.known) if day in good else -1.0
            for day in chosen[:-newer]
        ]
        del chosen[int(np.argmin(worth))]
    return chosen


def prune(directory: Path, diary: Diary, max_mb: float) -> None:
    """Remove the least worthy recordings until the rest fits; RecordingError where one stays."""
    paths = {path.name: path for path in days(directory)}
    kept = [entry for entry in diary.days if entry.name in paths]
    while kept and sum(size_of(paths[entry.name]) for entry in kept) > 1e6 * max_mb:
        before, kept = kept, worthiest(kept, len(kept) - 1) if len(kept) > 1 else []
        (name,) = {entry.name for entry in before} - {entry.name for entry in kept}
        with writing(paths[name]):
            paths[name].unlink(missing_ok=True)


def reason(entries: Sequence[DayEntry], live: str, chosen: str = '') -> tuple[bool, str]:
    """
    Decide whether a model is learnt after the newest day, and say why, or why not.

    ``live`` is the key of the live model, ``chosen`` the newest day before a person chose it;
    empty where none is live, and where the node did.
    """
    good = [day for day in entries if day.kind in LEARNT_FROM]
    if len(good) < FEWEST_DAYS:
        return False, ANOTHER_DAY
    new = sum(day.name > chosen for day in good)
    if chosen and new < DAYS_TO_AGREE:
        return False, (
            f'A person chose the live model. It is kept for {DAYS_TO_AGREE} good days; {new} of '
            'them have passed.'
        )
    last = max((n for n, day in enumerate(good) if day.challenged), default=0)
    grown, awaited = len(good) - 1 - last, (last + 1) / _GROWTH_PARTS
    if not live:
        return True, 'no model is live'
    if grown >= awaited:
        return True, f'{grown} more good {"day" if grown == 1 else "days"}'
    shares = {
        day.name: float(np.nanmean(day.left[day.live] / np.maximum(day.left[NONE], 1e-12)))
        for day in good
        if {day.live, NONE} <= day.left.keys()
    }
    bad_share = _BAD_RATIO * float(np.median(list(shares.values()) or [1.0]))
    for day in good[last + 1 :]:
        if shares.get(day.name, 0.0) > bad_share:
            return True, f'the live model did badly on {day.name}'
    more = int(np.ceil(awaited)) - grown
    return False, (
        f'No new model was learnt. The next one is learnt after {more} more good '
        f'{"day" if more == 1 else "days"}, or after a day on which the live model leaves more '
        f'than {_BAD_RATIO:g} times its usual share of the drift.'
    )


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
            f'Something pushed on the sensor most of the day: {day.contact:.0%} of the time was '
            f'in contact, and no payload explains {day.unexplained:.0%} of the changes between '
            'poses.'
        )
    if found := _other_gains(day, entry, before) or _jump_of_zero(day, entry, drift):
        return found
    past = np.array([other.noise for other in before if other.noise and other.kind in LEARNT_FROM])
    if len(past) < DAYS_TO_AGREE:
        return '', ''
    ratios = np.array(entry.noise) / np.median(past, axis=0)
    axis = int(ratios.argmax())
    # On ordinary days it was up to 1.9; half of the limit would refuse such days.
    if ratios[axis] < UNUSUAL:
        return '', ''
    return 'contacts', (
        f'The scatter of {AXES[axis]} is {entry.noise[axis]:.2g}, {ratios[axis]:.1f} times that '
        'of the days before: noise, or a robot that stands still while its gripper takes parts. '
        'No drift can be found in such readings.'
    )


def pause(entries: Sequence[DayEntry], since: str) -> str:
    """Say why learning has stopped on its own; empty when it has not."""
    why, agreeing = '', 0
    for entry in entries:
        if entry.kind in PAUSING and entry.name > since:
            why, agreeing = f'{entry.name}: {entry.incident}', 0
        elif entry.kind in LEARNT_FROM:
            agreeing += 1
    if not why or agreeing >= DAYS_TO_AGREE:
        return ''
    return (
        f'{why} Learning goes on after {DAYS_TO_AGREE} days without an incident ({agreeing} so '
        'far). To end this pause, call ~/calibrate or ~/adopt; their model is kept for as long.'
    )


def _thermometer_trouble(recording: Recording) -> str:
    """Say which thermometer stands still, is silent, or jumps; empty where none does."""
    moved = np.ptp(recording.temperature_c, axis=0).max() > LEAST_RANGE_K
    if moved and (idle := data_checks.idle_thermometers([recording])):
        return idle[0]
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
    if not today:  # one day without a payload may be chance
        lost = f'The weight of the days before is not found any more: {day.doubt}'
        return ('sensor', lost) if day.doubt and not before[-1].payloads else None
    if any(_are_same(one, other) for one in today for other in past):
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
    found = []
    for mass_kg, *center_m in entry.payloads if entry.rotation else ():
        lever = np.cross(np.array(center_m) / LEVER_M, np.eye(3)).T
        gains = mass_kg * np.concatenate((np.eye(3), lever))
        found.append(gains @ np.reshape(entry.rotation, (3, 3)))
    return found


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
    drift_rms, raw = np.array(entry.left[diary.NONE]), recording.wrench / noise
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
        for weight in _changes_of_weight(day, at, near):
            if np.linalg.norm(weight / noise - jump) < tolerated:
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


def _changes_of_weight(day: Day, at: int, near: int) -> list[FloatArray]:
    """List what the payloads of a day differ by in the pose from a cell on, N and N m, (6,)."""
    force = day.recording.specific_force
    if day.payloads is None or force is None:
        return []
    pose = day.payloads.frame.turn(np.nanmedian(force[at : at + near], axis=0))
    weights = [payload.weight(pose) for payload in day.payloads.payloads.values()]
    return [one - other for one, other in permutations(weights, 2)]
