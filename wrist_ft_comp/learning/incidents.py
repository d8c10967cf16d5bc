"""
Days that are not like the ones before: what happened to the sensor, with size and time.

A day is compared with days since the sensor was last changed. Those that change the sensor stop
the learning until three days agree again, or a person decides.
"""

from collections.abc import Sequence
from itertools import chain

import numpy as np

from wrist_ft_comp.learning.day import Day, longest_stills
from wrist_ft_comp.learning.entry import DayEntry, NONE
from wrist_ft_comp.payload.learnt import same_payload
from wrist_ft_comp.payload.weight import Payload
from wrist_ft_comp.signals import AXES, BoolArray, FloatArray, NANOSECONDS, Recording

#: Kinds of incidents: nothing can be told of a day (UNREADABLE), or only of the sensor …
UNREADABLE, CONTACTS, THERMOMETER = 'unreadable', 'contacts', 'thermometer'
#: … another tool, whose drift can be learnt as well …
TOOL = 'tool'
#: … and what changes the sensor.
ZERO, GAIN, NOISE, MOUNTING = 'zero', 'gain', 'noise', 'mounting'
LEARNT_FROM = ('', TOOL)
PAUSING = (ZERO, GAIN, NOISE, MOUNTING)
#: After these, older days are of another sensor.
FORGETTING = (GAIN, MOUNTING)
#: Days that have to agree, and days that one is compared with.
AGREE, _COMPARED = 3, 20
#: A step is the driver's tare where the reading goes to zero, up to this share of the step, or of
#: the other where contacts may hide the tare; it is the sensor's where it is larger than so much
#: of the drift of a day, and times the noise.
_TO_ZERO, _HIDDEN, _OF_DRIFT, _OF_NOISE = 0.8, 0.3, 0.2, 50.0
#: … and where of so many cells before and behind it this share is free of contact, and they differ
#: by the step, up to this share: a press that lasts and sudden heat look like steps, too.
_NEAR, _FREE, _OFF = 60, 0.1, 0.5
#: Shares of the time in contact and of what no payload explains; turn of the mounting, deg; noise
#: by what is usual; payloads of another gain: their ratios alike, centres of mass as near, m.
_CONTACT, _UNEXPLAINED, _TURNED_DEG, _LOUD, _GAIN, _NEAR_M = 0.6, 0.1, 5.0, 3.0, 0.03, 0.005
#: Shortest time for which a thermometer that stopped stands still, s, by what is usual, and what
#: others move meanwhile, K.
_STOPPED_S, _UNUSUAL, _MOVED_K = 900.0, 4.0, 1.0
#: Kind, and a sentence.
Incident = tuple[str, str]


def incident(
    day: Day, entry: DayEntry, before: Sequence[DayEntry], known: FloatArray | float = 0.0
) -> Incident:
    """
    Tell what happened on a day, ('', '') where nothing did; days before come oldest first.

    What is known of its drift, N and N m (N, 6), is no jump of the zero.
    """
    start = max((n for n, each in enumerate(before) if each.kind in FORGETTING), default=0)
    like = [each for each in before[start:] if each.hours][-_COMPARED:]
    found = (
        _stopped(day, entry, like)
        or _pressed(day)
        or _remounted(entry, like)
        or _reweighed(day, entry, like)
        or _jumped(day, entry, known)
        or _loud(entry, like)
    )
    return found or ('', '')


def pause(entries: Sequence[DayEntry], since: str) -> str:
    """Say why learning has stopped on its own; empty when it has not."""
    decided = max((n for n, each in enumerate(entries) if each.name <= since), default=-1)
    changed = [n for n, each in enumerate(entries) if each.kind in PAUSING and n > decided]
    if not changed:
        return ''
    agreeing = sum(each.kind in LEARNT_FROM for each in entries[changed[-1] + 1 :])
    if agreeing >= AGREE:
        return ''
    return (
        f'{entries[changed[-1]].name}: {entries[changed[-1]].incident} Learning goes on after '
        f'{AGREE} days that agree ({agreeing} so far), or by ~/calibrate or ~/adopt.'
    )


def _stopped(day: Day, entry: DayEntry, like: Sequence[DayEntry]) -> Incident | None:
    """Find thermometers that stand still or are silent while others move."""
    recording = day.recording
    for j, run in enumerate(longest_stills(recording)):
        good = [each.still_s for each in like if each.kind in LEARNT_FROM]
        usual_s = _UNUSUAL * max((each[j] for each in good if j < len(each)), default=np.inf)
        half_s = recording.duration_s / 2
        others = np.delete(recording.temperature_c[run], j, axis=1)
        # Nothing else moves where there is nothing else; a soaked robot may rest for long.
        limit_s = min(usual_s, half_s) if others.size else half_s
        moved = not others.size or np.ptp(others, axis=0).max() > _MOVED_K
        if moved and entry.still_s[j] > max(_STOPPED_S, limit_s):
            # The last reading before a silence is in the run, too.
            how = 'stood still' if recording.measured[run, j].mean() > 0.5 else 'was silent'
            at_c, hours = recording.temperature_c[run, j][0], entry.still_s[j] / 3600
            return THERMOMETER, (
                f'Thermometer {j + 1} {how} at {at_c:.1f} °C for {hours:.1f} h from '
                f'{clock(recording, run)} on.'
            )
    return None


def _pressed(day: Day) -> Incident | None:
    """Find a day that was in contact most of the time."""
    if day.contact < _CONTACT and day.unexplained < _UNEXPLAINED:
        return None
    return CONTACTS, (
        f'Something pushed on the sensor most of the day: cells in contact are {day.contact:.0%}, '
        f'and {day.unexplained:.0%} of what changes between poses does not turn with the specific '
        'force.'
    )


def _remounted(entry: DayEntry, like: Sequence[DayEntry]) -> Incident | None:
    """Find a rotation of the payload's frame that no day before had."""
    known = [each.rotation for each in like if each.rotation] if entry.rotation else []
    cosines = [(float(np.dot(entry.rotation, each)) - 1) / 2 for each in known]
    turns_deg = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    if not known or turns_deg.min() < _TURNED_DEG:
        return None
    return MOUNTING, (
        f'The sensor is turned by {turns_deg[-1]:.0f}° against its accelerometer, or the frame of '
        'the specific force has changed, since the start of the day.'
    )


def _reweighed(day: Day, entry: DayEntry, like: Sequence[DayEntry]) -> Incident | None:
    """Find payloads that no day before had: another gain, where only masses differ; or a tool."""
    free = [each.payloads for each in like if each.kind != CONTACTS]
    known, today = (
        [Payload(each[0], np.array(each[1:])) for each in figures]
        for figures in (chain(*free), entry.payloads)
    )
    if not known or any(same_payload(one, other) for one in today for other in known):
        return None
    if not today:  # one such day may be chance
        lost = f'The weight of the days before is not found any more: {day.doubt}'
        return (GAIN, lost) if day.doubt and not like[-1].payloads else None
    apart_m = np.array(
        [[np.linalg.norm(one.center_m - other.center_m) for other in known] for one in today]
    )
    nearest = [known[n] for n in apart_m.argmin(axis=1)]
    ratios = [one.mass_kg / other.mass_kg for one, other in zip(today, nearest, strict=True)]
    masses = ' and '.join(f'{each.mass_kg:.2f}' for each in today)
    if apart_m.min(axis=1).max() < _NEAR_M and np.ptp(ratios) < _GAIN:
        return GAIN, (
            f'All payloads weigh {np.mean(ratios):.2f} times what they did before ({masses} kg): '
            'another gain, or a tool with the same centre of mass.'
        )
    before = ' and '.join(f'{each[0]:.2f}' for each in like[-1].payloads) or 'others'
    return TOOL, f'Another tool: payloads of {masses} kg, on the day before {before}.'


def _jumped(day: Day, entry: DayEntry, known: FloatArray | float) -> Incident | None:
    """Find steps of the zero that no tare of the driver made, and that matter."""
    recording, noise = day.recording, day.noise
    present = [axis in recording.axes_present for axis in AXES]
    raw = recording.wrench[:, present]
    drift = np.array(entry.left[NONE])[np.isfinite(entry.left[NONE])]
    rest = (recording.wrench - day.drift.reference - known)[:, present] / noise
    rest[np.isnan(day.drift.wrench[:, present])] = np.nan
    for step in sorted(day.steps, key=lambda each: -np.linalg.norm(each.jump / noise)):
        at, size = step.cell, np.linalg.norm(step.jump / noise)
        cells = np.arange(max(0, at - _NEAR), min(at + _NEAR, len(raw)))
        reached = raw[cells] + (cells < at)[:, np.newaxis] * step.jump
        zero = size * np.where(np.abs(cells - at + 1) < 4, _TO_ZERO, _HIDDEN)
        if (
            not (np.linalg.norm(reached / noise, axis=1) < zero).any()
            and size > _OF_NOISE
            and np.max(np.abs(step.jump) / drift) > _OF_DRIFT
            and _goes(rest, at, step.jump / noise)
        ):
            sizes = ', '.join(f'{each:.2g}' for each in step.jump)
            time = clock(recording, np.arange(len(recording)) >= at)
            return ZERO, (
                f'The zero jumped at {time} by {sizes} (N and N m), and no tare of the driver did '
                'that: an overload?'
            )
    return None


def _goes(rest: FloatArray, at: int, jump: FloatArray) -> bool:
    """Tell whether cells that are free of contact go where a step does, both by the noise."""
    before, after = rest[max(0, at - _NEAR) : at], rest[at : at + _NEAR]
    if min(np.isfinite(each[:, 0]).mean() for each in (before, after)) < _FREE:
        return False
    gone = np.nanmedian(after, axis=0) - np.nanmedian(before, axis=0)
    return bool(np.linalg.norm(gone - jump) < _OFF * np.linalg.norm(jump))


def _loud(entry: DayEntry, like: Sequence[DayEntry]) -> Incident | None:
    """Find noise that is far above that of the days before."""
    quiet = [each.noise for each in like if each.kind in LEARNT_FROM and each.noise]
    if len(quiet) < AGREE:
        return None
    louder = np.array(entry.noise) / np.median(quiet, axis=0)
    axis = int(louder.argmax())
    if louder[axis] < _LOUD:
        return None
    return NOISE, (
        f'The noise of {AXES[axis]} is {entry.noise[axis]:.2g}, {louder[axis]:.1f} times that of '
        'the days before, since the start of the day.'
    )


def clock(recording: Recording, marked: BoolArray) -> str:
    """Tell the time of the first cell that is marked, UTC."""
    cell = recording.first_cell + int(np.argmax(marked))
    minutes = cell * recording.period_ns // NANOSECONDS // 60
    return f'{minutes // 60 % 24:02}:{minutes % 60:02} UTC'
