"""
Incidents: what happened to the sensor on a day that differs from the days before.

A day is compared with the days since the sensor was changed last. An incident that changes the
sensor stops learning until three days in a row have no incident, or a person decides.
"""

from collections.abc import Sequence
from itertools import chain, permutations
import warnings

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from wrist_ft_comp.learning.creep import TIME_CONSTANTS_S
from wrist_ft_comp.learning.day import Day, longest_stills
from wrist_ft_comp.learning.diary import (
    CONTACTS,
    CREEP,
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

#: Days without an incident after which learning goes on.
DAYS_TO_RESUME = 3
#: A day is compared with at most this many days before it.
_MOST_COMPARED_DAYS = 20
#: A jump of the zero is an incident from this share of a day's drift on ...
_LEAST_DRIFT_SHARE = 0.2
#: ... and from this many standard deviations of a cell on.
_LEAST_JUMP_SIGMA = 50.0
#: Cells before and after a jump that are examined.
_NEAR_CELLS = 60
#: Levels before and after a jump are compared at every tenth cell, which saves memory.
_LEVEL_STEP = 10
#: A jump is a tare of the driver where it takes the raw reading of all axes to zero but for this
#: share of itself, in a cell near it, because a contact may hide the tare. Of 50 simulated tares
#: that were found, 49 missed zero by up to 0.05 and one in a contact by 0.24, 109 jumps of 20 and
#: 80 N by 0.28 at least.
_TARE_SHARE = 0.25
#: Fewest cells free of contact on either side: what they do not confirm is a long press, or sudden
#: heat.
_FEWEST_FREE = 6
#: They are looked for at most this many cells away: beside a jump a running median is misplaced,
#: and takes minutes for contact.
_FAR_CELLS = 300
#: Their change may differ from the jump by this share of it.
_MOST_DIFFERENCE = 0.5
#: A jump is a long press where the reading steps back but for this share; contacts beside its ends
#: make them differ by up to 0.16.
_UNDONE_SHARE = 0.3
#: A jump is the weight of a part where it differs from that by less than this share.
_SAME_WEIGHT_SHARE = 0.2
#: Largest share of the time in contact on an ordinary day.
_MOST_CONTACT = 0.6
#: Largest share of the changes between poses that no payload explains on an ordinary day.
_MOST_UNEXPLAINED = 0.1
#: Least rotation of the sensor on its mounting that is an incident, degrees.
_LEAST_TURN_DEG = 5.0
#: Least noise that is an incident, in units of the median noise of the days before.
_LEAST_NOISE_RATIO = 3.0
#: The gain changed, and not the payloads, where the ratios of all masses differ by less ...
_SAME_RATIO = 0.03
#: ... and the centres of mass differ by less, m.
_SAME_CENTER_M = 0.005
#: A thermometer has stopped where it stands still for longer than this, s, ...
_LEAST_STILL_S = 900.0
#: ... for longer than this many times the longest time of the good days before ...
_LEAST_STILL_RATIO = 4.0
#: ... while another thermometer moves by more than this, K.
_LEAST_CHANGE_K = 1.0
#: Creep is named where the day, or all days together, show it by this many standard errors;
#: without creep, simulated days showed up to 4.0 ...
_CREEP_SIGMA = 5.0
#: ... and the day itself by this many.
_CREEP_OF_DAY_SIGMA = 2.0
#: Less of the load is no one's trouble: the best of data sheets promise 0.02 %.
_LEAST_CREEP = 3e-4
#: Creep is stated as a share of a load of this duration, s, as on data sheets.
_CREEP_S = 1800.0
#: Kind of the incident, and a sentence.
Incident = tuple[str, str]


def incident(
    day: Day, entry: DayEntry, before: Sequence[DayEntry], drift: FloatArray | float = 0.0
) -> Incident:
    """
    Find the incident of a day; ('', '') without one.

    The days before come oldest first. ``drift``, N and N m, (N, 6), is what the live model
    explains of this day; that is no jump of the zero.
    """
    start = max((n for n, past in enumerate(before) if past.kind in FORGETTING), default=0)
    compared = [past for past in before[start:] if past.hours][-_MOST_COMPARED_DAYS:]
    return (
        _stopped_thermometer(day, entry, compared)
        or _mostly_contact(day)
        or _turned_sensor(entry, compared)
        or _other_payloads(day, entry, compared)
        or _jump_of_zero(day, entry, drift)
        or _noise(day, entry, compared)
        or _creep(entry, compared)
        or ('', '')
    )


def pause(entries: Sequence[DayEntry], since: str) -> str:
    """Say why learning has stopped on its own; empty when it has not."""
    decided = max((n for n, entry in enumerate(entries) if entry.name <= since), default=-1)
    changed = [n for n, entry in enumerate(entries) if entry.kind in PAUSING and n > decided]
    if not changed:
        return ''
    agreeing = sum(entry.kind in LEARNT_FROM for entry in entries[changed[-1] + 1 :])
    if agreeing >= DAYS_TO_RESUME:
        return ''
    return (
        f'{entries[changed[-1]].name}: {entries[changed[-1]].incident} Learning goes on after '
        f'{DAYS_TO_RESUME} days without an incident ({agreeing} so far), or by ~/calibrate or '
        '~/adopt.'
    )


def _stopped_thermometer(
    day: Day, entry: DayEntry, compared: Sequence[DayEntry]
) -> Incident | None:
    """Find a thermometer that stands still or is silent while another one moves."""
    recording = day.recording
    half_s = recording.duration_s / 2
    good = [past.still_s for past in compared if past.kind in LEARNT_FROM]
    for j, run in enumerate(longest_stills(recording)):
        longest_s = max((still_s[j] for still_s in good if j < len(still_s)), default=np.inf)
        usual_s = _LEAST_STILL_RATIO * longest_s
        others = np.delete(recording.temperature_c[run], j, axis=1)
        # A single thermometer cannot be compared, and a robot may rest at one temperature.
        limit_s = min(usual_s, half_s) if others.size else half_s
        moved = not others.size or np.ptp(others, axis=0).max() > _LEAST_CHANGE_K
        if moved and entry.still_s[j] > max(_LEAST_STILL_S, limit_s):
            # A silent run also holds the last reading before it.
            how = 'stood still' if recording.measured[run, j].mean() > 0.5 else 'was silent'
            at_c, hours = recording.temperature_c[run, j][0], entry.still_s[j] / 3600
            return THERMOMETER, (
                f'Thermometer {j + 1} {how} at {at_c:.1f} °C for {hours:.1f} h from '
                f'{clock(recording, run)} on.'
            )
    return None


def _mostly_contact(day: Day) -> Incident | None:
    """Find a day that was in contact for most of the time."""
    if day.contact < _MOST_CONTACT and day.unexplained < _MOST_UNEXPLAINED:
        return None
    return CONTACTS, (
        f'Something pushed on the sensor most of the day: cells in contact are {day.contact:.0%}, '
        f'and {day.unexplained:.0%} of what changes between poses does not turn with the specific '
        'force.'
    )


def _turned_sensor(entry: DayEntry, compared: Sequence[DayEntry]) -> Incident | None:
    """Find a rotation of the specific force's frame that no day before had."""
    rotations = [past.rotation for past in compared if past.rotation] if entry.rotation else []
    cosines = [(float(np.dot(entry.rotation, rotation)) - 1) / 2 for rotation in rotations]
    turns_deg = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    if not rotations or turns_deg.min() < _LEAST_TURN_DEG:
        return None
    return MOUNTING, (
        f'The sensor is turned by {turns_deg[-1]:.0f}° against its accelerometer, or the frame of '
        'the specific force has changed, since the start of the day.'
    )


def _other_payloads(day: Day, entry: DayEntry, compared: Sequence[DayEntry]) -> Incident | None:
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


def _jump_of_zero(day: Day, entry: DayEntry, drift: FloatArray | float) -> Incident | None:
    """Find a large step of the zero that is no tare of the driver."""
    recording, noise = day.recording, day.noise
    present = [axis in recording.axes_present for axis in AXES]
    raw = recording.wrench[:, present]
    drift_rms = np.array(entry.left[NONE])[np.isfinite(entry.left[NONE])]
    reading = (recording.wrench - day.drift.reference - drift)[:, present] / noise
    free = np.isfinite(day.drift.wrench[:, present])
    residual = np.where(free, reading, np.nan)
    parked: Incident | None = None
    for step in sorted(day.steps, key=lambda step: -np.linalg.norm(step.jump / noise)):
        is_loud = np.linalg.norm(step.jump / noise) > _LEAST_JUMP_SIGMA
        is_large = is_loud and np.max(np.abs(step.jump) / drift_rms) > _LEAST_DRIFT_SHARE
        if is_large and not _is_tare(raw, step, noise) and _is_confirmed(residual, step, noise):
            sizes = ', '.join(f'{jump:.2g}' for jump in step.jump)
            time = clock(recording, np.arange(len(recording)) >= step.cell)
            if _is_weight(day, step, present):
                sentence = (
                    f'The reading stepped at {time} by what the payloads of the day differ by, as '
                    'where a robot is parked with a part for long: its drift cannot be learnt.'
                )
                parked = CONTACTS, sentence
                continue
            if _is_undone(reading, step, noise):
                continue
            return ZERO, (
                f'The zero jumped at {time} by {sizes} (N and N m), and no tare of the driver did '
                'that: an overload?'
            )
    return parked


def _is_undone(reading: FloatArray, step: Step, noise: FloatArray) -> bool:
    """Whether the reading, in units of noise, steps back, as a press of half an hour ends."""
    windows = sliding_window_view(reading, _NEAR_CELLS, axis=0)[::_LEVEL_STEP]
    with warnings.catch_warnings():  # of windows without any reading
        warnings.simplefilter('ignore', RuntimeWarning)
        level = np.nanmedian(windows, axis=-1)
    jump, apart = step.jump / noise, _NEAR_CELLS // _LEVEL_STEP
    missed = np.linalg.norm(level[apart:] - level[:-apart] + jump, axis=1)
    return bool((missed < _UNDONE_SHARE * np.linalg.norm(jump)).any())


def _is_weight(day: Day, step: Step, present: list[bool]) -> bool:
    """Tell whether a step is as large as what two payloads of a day differ by in that pose."""
    force = day.recording.specific_force
    if day.payloads is None or force is None:
        return False
    pose = np.nanmedian(force[step.cell : step.cell + _NEAR_CELLS], axis=0)
    turned = day.payloads.frame.turn(pose)
    weights = [payload.weight(turned)[present] for payload in day.payloads.payloads.values()]
    missed = [
        np.linalg.norm((one - other - step.jump) / day.noise)
        for one, other in permutations(weights, 2)
    ]
    return bool(
        min(missed, default=np.inf) < _SAME_WEIGHT_SHARE * np.linalg.norm(step.jump / day.noise)
    )


def _is_tare(raw: FloatArray, step: Step, noise: FloatArray) -> bool:
    """Whether a step takes the raw reading, (N, A), to zero, as a tare of the driver does."""
    cells = np.arange(max(0, step.cell - _NEAR_CELLS), min(step.cell + _NEAR_CELLS, len(raw)))
    after = (raw[cells] + (cells < step.cell)[:, np.newaxis] * step.jump) / noise
    # A robot that moves is between two cells when it is tared: the nearest point between them.
    change = np.diff(after, axis=0)
    share = -np.sum(after[:-1] * change, axis=1) / np.maximum(np.sum(change**2, axis=1), 1e-12)
    missed = np.linalg.norm(after[:-1] + np.clip(share, 0, 1)[:, np.newaxis] * change, axis=1)
    return bool((missed < _TARE_SHARE * np.linalg.norm(step.jump / noise)).any())


def _is_confirmed(residual: FloatArray, step: Step, noise: FloatArray) -> bool:
    """Whether cells free of contact change as the step does; residuals are in units of noise."""
    free = np.flatnonzero(np.isfinite(residual[:, 0]))
    free = free[np.abs(free - step.cell) <= _FAR_CELLS]
    before, after = free[free < step.cell][-_NEAR_CELLS:], free[free >= step.cell][:_NEAR_CELLS]
    if min(len(before), len(after)) < _FEWEST_FREE:
        return False
    jump = step.jump / noise
    change = np.median(residual[after], axis=0) - np.median(residual[before], axis=0)
    return bool(np.linalg.norm(change - jump) < _MOST_DIFFERENCE * np.linalg.norm(jump))


def _noise(day: Day, entry: DayEntry, compared: Sequence[DayEntry]) -> Incident | None:
    """Find noise that is far above that of the days before, or a load that looks like noise."""
    noises = [past.noise for past in compared if past.kind in LEARNT_FROM and past.noise]
    if len(noises) < DAYS_TO_RESUME:
        return None
    ratios = np.array(entry.noise) / np.median(noises, axis=0)
    axis = int(ratios.argmax())
    if ratios[axis] < _LEAST_NOISE_RATIO:
        return None
    scatter = f'{entry.noise[axis]:.2g}, {ratios[axis]:.1f} times that of the days before'
    if not day.moved:  # parts that a gripper takes are told from drift by their weight alone
        return CONTACTS, (
            f'The robot stood still, and the scatter of {AXES[axis]} was {scatter}, as where a '
            'gripper takes parts: drift cannot be told from their weight.'
        )
    return NOISE, f'The noise of {AXES[axis]} is {scatter}, since the start of the day.'


def _creep(entry: DayEntry, compared: Sequence[DayEntry]) -> Incident | None:
    """Find creep or hysteresis that the day shows alone, or together with the days before."""
    days = [past.creep for past in compared if past.creep and past.kind in LEARNT_FROM]
    if not entry.creep:
        return None
    share, error = np.moveaxis(np.array([*days, entry.creep]), -1, 0)
    alone, together = (share[-1], error[-1]), _weighted_mean(share, error)
    mean, mean_error = max(alone, together, key=lambda found: np.max(np.abs(found[0]) / found[1]))
    found = int(np.argmax(np.abs(mean) / mean_error))
    of_day = np.sign(mean[found]) * share[-1, found] / error[-1, found]
    if of_day < _CREEP_OF_DAY_SIGMA or abs(mean[found]) < _CREEP_SIGMA * mean_error[found]:
        return None
    constant_s = TIME_CONSTANTS_S[found]
    lasting = np.isinf(constant_s)
    percent = 100.0 if lasting else 100 * (1 - np.exp(-_CREEP_S / constant_s))
    if abs(percent * mean[found]) < 100 * _LEAST_CREEP:
        return None
    size = f'{percent * mean[found]:.2g} ± {percent * mean_error[found]:.1g} %'
    what = (
        f'keeps {size} of the largest load (hysteresis)'
        if lasting
        else f'creeps by {size} of a load within {_CREEP_S / 60:.0f} min (time constant about '
        f'{constant_s / 60:.0f} min), and back without it'
    )
    return CREEP, f'The reading {what}: this follows the load, and no temperature removes it.'


def _weighted_mean(values: FloatArray, errors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Average days, (D, K), by their standard errors; the error is larger where days disagree."""
    mean = np.average(values, axis=0, weights=errors**-2)
    scatter = np.sqrt(np.mean(((values - mean) / errors) ** 2, axis=0))
    return mean, np.maximum(scatter, 1.0) / np.sqrt(np.sum(errors**-2, axis=0))


def clock(recording: Recording, marked: BoolArray) -> str:
    """Write the time, UTC, of the first cell that is marked."""
    cell = recording.first_cell + int(np.argmax(marked))
    minutes = cell * recording.period_ns // NANOSECONDS // 60
    return f'{minutes // 60 % 24:02}:{minutes % 60:02} UTC'
