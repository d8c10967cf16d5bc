"""
Days that are not like the ones before: what happened to the sensor, with size and time.

A day is compared with days since the sensor was last changed. Incidents that change the sensor
stop the learning until three days agree again, or a person decides.
"""

from collections.abc import Sequence
from itertools import chain, permutations

import numpy as np

from wrist_ft_comp.learning.day import Day, longest_stills
from wrist_ft_comp.learning.diary import (
    CONTACTS,
    DayEntry,
    FORGETTING,
    GAIN,
    LEARNT_FROM,
    MOUNTING,
    NOISE,
    NONE,
    PAUSING,
    THERMOMETER,
    TOOL,
    ZERO,
)
from wrist_ft_comp.payload.learnt import same_payload
from wrist_ft_comp.payload.separation import Step
from wrist_ft_comp.payload.weight import Payload
from wrist_ft_comp.signals import AXES, BoolArray, FloatArray, NANOSECONDS, Recording

#: Days that have to agree before learning goes on.
AGREE = 3
#: Days before that one is compared with.
_COMPARED = 20
#: A step of the zero matters where it is larger than this share of a day's drift …
_LEAST_OF_DRIFT = 0.2
#: … and than so many times the noise.
_LEAST_OF_NOISE = 50.0
#: Cells before and behind a step that are looked at.
_NEAR = 60
#: A step is the driver's tare where it brings the reading nearer to zero than this share of it …
_TARE = 0.8
#: … in cells that are nearer to the step than this …
_BESIDE = 4
#: … or than this share in cells farther from it: a contact may hide the tare.
_HIDDEN_TARE = 0.3
#: A step is no press that lasts and no sudden heat where this share of the cells is free of
#: contact …
_FREE = 0.1
#: … and they go as far as the step does, up to this share of it.
_OFF = 0.5
#: A step is the weight of a part where it differs from that by less than this share.
_SAME_STEP = 0.2
#: Share of the time in contact, and of the contrast that no payload makes, on an ordinary day.
_CONTACT = 0.6
_UNEXPLAINED = 0.1
#: Turn of the sensor on its mounting that is told, deg.
_TURNED_DEG = 5.0
#: Noise that is told, by what is usual.
_LOUD = 3.0
#: Payloads weigh more or less by another gain where the ratios of their masses differ by less …
_SAME_RATIO = 0.03
#: … and their centres of mass are nearer, m.
_SAME_CENTER_M = 0.005
#: A thermometer has stopped where it stands still for longer than this, s, …
_STOPPED_S = 900.0
#: … and than so many times what is usual …
_UNUSUAL = 4.0
#: … while another one moves by more than this, K.
_MOVED_K = 1.0
#: Kind, and a sentence.
Incident = tuple[str, str]


def incident(
    day: Day, entry: DayEntry, before: Sequence[DayEntry], drift: FloatArray | float = 0.0
) -> Incident:
    """
    Tell what happened on a day, ('', '') where nothing did; days before come oldest first.

    What is known of the day's drift, N and N m (N, 6), is no jump of the zero.
    """
    start = max((n for n, past in enumerate(before) if past.kind in FORGETTING), default=0)
    compared = [past for past in before[start:] if past.hours][-_COMPARED:]
    found = (
        _stopped(day, entry, compared)
        or _pressed(day)
        or _remounted(entry, compared)
        or _reweighed(day, entry, compared)
        or _jumped(day, entry, drift)
        or _loud(entry, compared)
    )
    return found or ('', '')


def pause(entries: Sequence[DayEntry], since: str) -> str:
    """Say why learning has stopped on its own; empty when it has not."""
    decided = max((n for n, entry in enumerate(entries) if entry.name <= since), default=-1)
    changed = [n for n, entry in enumerate(entries) if entry.kind in PAUSING and n > decided]
    if not changed:
        return ''
    agreeing = sum(entry.kind in LEARNT_FROM for entry in entries[changed[-1] + 1 :])
    if agreeing >= AGREE:
        return ''
    return (
        f'{entries[changed[-1]].name}: {entries[changed[-1]].incident} Learning goes on after '
        f'{AGREE} days that agree ({agreeing} so far), or by ~/calibrate or ~/adopt.'
    )


def _stopped(day: Day, entry: DayEntry, compared: Sequence[DayEntry]) -> Incident | None:
    """Find thermometers that stand still or are silent while others move."""
    recording = day.recording
    half_s = recording.duration_s / 2
    good = [past.still_s for past in compared if past.kind in LEARNT_FROM]
    for j, run in enumerate(longest_stills(recording)):
        longest_s = max((still_s[j] for still_s in good if j < len(still_s)), default=np.inf)
        usual_s = _UNUSUAL * longest_s
        others = np.delete(recording.temperature_c[run], j, axis=1)
        # A single thermometer has none beside it that moves; a soaked robot may rest for long.
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
    """Find a day that was in contact for most of the time."""
    if day.contact < _CONTACT and day.unexplained < _UNEXPLAINED:
        return None
    return CONTACTS, (
        f'Something pushed on the sensor most of the day: cells in contact are {day.contact:.0%}, '
        f'and {day.unexplained:.0%} of what changes between poses does not turn with the specific '
        'force.'
    )


def _remounted(entry: DayEntry, compared: Sequence[DayEntry]) -> Incident | None:
    """Find a rotation of the payload's frame that no day before had."""
    rotations = [past.rotation for past in compared if past.rotation] if entry.rotation else []
    cosines = [(float(np.dot(entry.rotation, rotation)) - 1) / 2 for rotation in rotations]
    turns_deg = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    if not rotations or turns_deg.min() < _TURNED_DEG:
        return None
    return MOUNTING, (
        f'The sensor is turned by {turns_deg[-1]:.0f}° against its accelerometer, or the frame of '
        'the specific force has changed, since the start of the day.'
    )


def _reweighed(day: Day, entry: DayEntry, compared: Sequence[DayEntry]) -> Incident | None:
    """Find payloads that no day before had: another gain, where only masses differ; or a tool."""
    free = [past.payloads for past in compared if past.kind != CONTACTS]
    before, today = (
        [Payload(mass_kg, np.array(center_m)) for mass_kg, *center_m in figures]
        for figures in (chain(*free), entry.payloads)
    )
    if not before or any(same_payload(one, other) for one in today for other in before):
        return None
    if not today:  # one day without a payload may be chance
        lost = f'The weight of the days before is not found any more: {day.doubt}'
        return (GAIN, lost) if day.doubt and not compared[-1].payloads else None
    apart_m = np.array(
        [[np.linalg.norm(one.center_m - other.center_m) for other in before] for one in today]
    )
    nearest = [before[n] for n in apart_m.argmin(axis=1)]
    ratios = [one.mass_kg / other.mass_kg for one, other in zip(today, nearest, strict=True)]
    masses = ' and '.join(f'{payload.mass_kg:.2f}' for payload in today)
    if apart_m.min(axis=1).max() < _SAME_CENTER_M and np.ptp(ratios) < _SAME_RATIO:
        return GAIN, (
            f'All payloads weigh {np.mean(ratios):.2f} times what they did before ({masses} kg): '
            'another gain, or a tool with the same centre of mass.'
        )
    yesterday = ' and '.join(f'{mass_kg:.2f}' for mass_kg, *_ in compared[-1].payloads) or 'others'
    return TOOL, f'Another tool: payloads of {masses} kg, on the day before {yesterday}.'


def _jumped(day: Day, entry: DayEntry, drift: FloatArray | float) -> Incident | None:
    """Find steps of the zero that no tare of the driver made, and that matter."""
    recording, noise = day.recording, day.noise
    present = [axis in recording.axes_present for axis in AXES]
    raw = recording.wrench[:, present]
    drifted = np.array(entry.left[NONE])[np.isfinite(entry.left[NONE])]
    rest = (recording.wrench - day.drift.reference - drift)[:, present] / noise
    rest[np.isnan(day.drift.wrench[:, present])] = np.nan
    parked: Incident | None = None
    for step in sorted(day.steps, key=lambda step: -np.linalg.norm(step.jump / noise)):
        cell, size = step.cell, np.linalg.norm(step.jump / noise)
        matters = size > _LEAST_OF_NOISE and np.max(np.abs(step.jump) / drifted) > _LEAST_OF_DRIFT
        if matters and not _tared(raw, step, noise) and _stays(rest, step, noise):
            sizes = ', '.join(f'{jump:.2g}' for jump in step.jump)
            time = clock(recording, np.arange(len(recording)) >= cell)
            if _is_weight(day, step, present):
                sentence = (
                    f'The reading stepped at {time} by what the payloads of the day differ by, as '
                    'where a robot is parked with a part for long: its drift cannot be told.'
                )
                parked = CONTACTS, sentence
                continue
            return ZERO, (
                f'The zero jumped at {time} by {sizes} (N and N m), and no tare of the driver did '
                'that: an overload?'
            )
    return parked


def _is_weight(day: Day, step: Step, present: list[bool]) -> bool:
    """Tell whether a step is as large as what two payloads of a day differ by in that pose."""
    force = day.recording.specific_force
    if day.payloads is None or force is None:
        return False
    pose = np.nanmedian(force[step.cell : step.cell + _NEAR], axis=0)
    turned = day.payloads.frame.turn(pose)
    weights = [payload.weight(turned)[present] for payload in day.payloads.payloads.values()]
    missed = [
        np.linalg.norm((one - other - step.jump) / day.noise)
        for one, other in permutations(weights, 2)
    ]
    return bool(min(missed, default=np.inf) < _SAME_STEP * np.linalg.norm(step.jump / day.noise))


def _tared(raw: FloatArray, step: Step, noise: FloatArray) -> bool:
    """Tell whether a step brings a raw reading, (N, A), about to zero, as a tare does."""
    cells = np.arange(max(0, step.cell - _NEAR), min(step.cell + _NEAR, len(raw)))
    behind = raw[cells] + (cells < step.cell)[:, np.newaxis] * step.jump
    beside = np.abs(cells - step.cell + 1) < _BESIDE
    limit = np.linalg.norm(step.jump / noise) * np.where(beside, _TARE, _HIDDEN_TARE)
    return bool((np.linalg.norm(behind / noise, axis=1) < limit).any())


def _stays(rest: FloatArray, step: Step, noise: FloatArray) -> bool:
    """Tell whether cells that are free of contact go where a step does; rest is by the noise."""
    before = rest[max(0, step.cell - _NEAR) : step.cell]
    after = rest[step.cell : step.cell + _NEAR]
    if min(np.isfinite(part[:, 0]).mean() for part in (before, after)) < _FREE:
        return False
    jump = step.jump / noise
    change = np.nanmedian(after, axis=0) - np.nanmedian(before, axis=0)
    return bool(np.linalg.norm(change - jump) < _OFF * np.linalg.norm(jump))


def _loud(entry: DayEntry, compared: Sequence[DayEntry]) -> Incident | None:
    """Find noise that is far above that of the days before."""
    quiet = [past.noise for past in compared if past.kind in LEARNT_FROM and past.noise]
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
