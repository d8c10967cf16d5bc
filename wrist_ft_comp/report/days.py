"""What a diary says of its days: in one sentence, what happened and when, and temperatures."""

from collections.abc import Sequence
from datetime import datetime, timezone
from itertools import pairwise
import re
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.learning.diary import DayEntry, Diary, FORCES, NONE, TORQUES
from wrist_ft_comp.learning.working_day import DAY_NS
from wrist_ft_comp.ranges import rounded
from wrist_ft_comp.series import FloatArray, NANOSECONDS
from wrist_ft_comp.stored.own_file import Output

#: What the picture of days names as its software, by which it is known again.
PAINTER = 'wrist_ft_comp picture'
PICTURE = Output(
    # Header, image header, and the text, before or after the chunk that holds the resolution;
    # bytes that are no text count as one letter, alone or together.
    name='picture', endings='.png',
    begins=rf'.PNG\r\n\x1a\n.{{20,80}}tEXtSoftware\x00{PAINTER}')  # fmt: skip

#: A silence of the robot from this length on is one of the things that happened, days.
_PAUSE_DAYS = 7.0
#: Of a drift up to this one, N or N m, no share is given: no sensor resolves it.
_LEAST_DRIFT = 1e-6
#: Names of incidents; another kind goes by its own name.
NAMES = {
    'zero': 'zero jumped',
    'sensor': 'gain or mounting changed',
    'tool': 'another tool',
    'contacts': 'pushed all day',
    'unreadable': 'day not readable',
}
NO_PAYLOAD = 'no payload found'
NO_DAYS = 'no days'
#: Names of changes of the model, which happen after a day.
LEARNT, OFFERED, CHOSEN, BACK = MODEL_CHANGES = (
    'new model learnt',
    'better model offered',
    'person chose model',
    'back to old model',
)
_NAMES_OF_CHANGES: dict[str, str] = {'learnt': LEARNT, 'chosen': CHOSEN, 'back': BACK}


class DriftLeft(NamedTuple):
    """RMS of drift, N or N m: without a model, and what the live model left; NaN if unknown."""

    without: float
    left: float

    @property
    def share(self) -> float:
        """Share of the drift that the live model left."""
        return self.left / self.without if self.without > _LEAST_DRIFT else np.nan


class Event(NamedTuple):
    """Something that happened on a day, on several in a row, or after one."""

    name: str
    #: Numbers of the first and the last of these days.
    first: int
    last: int
    #: Details; empty where the name says everything.
    sentence: str


def drift_left(entry: DayEntry, axes: slice = FORCES) -> DriftLeft:
    """Give what was left of a force's drift on a day, or of a torque's."""
    return DriftLeft(entry.rms_left(NONE, axes), entry.rms_left(entry.live, axes))


def usual_drift(diary: Diary, axes: slice = FORCES) -> tuple[DriftLeft, FloatArray]:
    """
    Take the medians of what was left: one day that was judged wrongly does not move them.

    Gives, too, what was left day by day, (n, 2): of days with a live model, if there are any.
    """
    drifts = np.array([drift_left(day, axes) for day in diary.days])
    with_model = np.isfinite(drifts).all(axis=1)
    judged = drifts[with_model if with_model.any() else np.isfinite(drifts[:, 0])]
    return DriftLeft(*(np.median(judged, axis=0) if len(judged) else (np.nan, np.nan))), judged


def summary(diary: Diary) -> tuple[str, str]:
    """Say in one sentence what drifted and what was left of it, and how that was counted."""
    (force, judged), (torque, _) = usual_drift(diary), usual_drift(diary, TORQUES)
    dates = dict.fromkeys(map(when, (diary.days[0], diary.days[-1])))
    head = f'{_days(len(diary.days))}, {" to ".join(dates)}'
    if not len(judged):
        return f'{head}: none is judged yet.', ''
    counted = f'RMS of a day, tared in its first minute; median of {_days(len(judged))}'
    sentence = f'{head}: on a usual day a force drifted by {rounded(force.without, 2)} N'
    if np.isnan(force.left):
        return f'{sentence}; no model was live.', f'{counted}.'
    counted += f' with a model; most left {rounded(judged[:, 1].max(), 2)} N.'
    if np.isfinite(torque.left):
        counted += (
            f' A torque drifted by {rounded(torque.without, 2)} N m; the model left '
            f'{_left_words(torque, "N m")}.'
        )
    return f'{sentence}; the model left {_left_words(force, "N")}.', counted


def figures(diary: Diary) -> dict[str, object]:
    """Give days, what was left of their drift, and what happened, for scripts."""
    (force, judged), (torque, _) = usual_drift(diary), usual_drift(diary, TORQUES)
    sentence, counted = summary(diary)
    names = [day.name for day in diary.days]
    return {
        'days': [{**vars(day), 'known': sorted(day.known)} for day in diary.days],
        'paused': diary.paused,
        'summary': {
            'sentence': sentence, 'counted': counted, 'days': len(judged), 'force_n': force,
            'torque_nm': torque,
        },
        'events': [
            event._asdict() | {'first': names[event.first], 'last': names[event.last]}
            for event in events(diary)
        ],
    }  # fmt: skip


def _days(count: int) -> str:
    return f'{count} {"day" if count == 1 else "days"}'


def _left_words(drift: DriftLeft, unit: str) -> str:
    """Write what was left, and which share that is."""
    share = f' ({rounded(100 * drift.share, 2)} %)' if np.isfinite(drift.share) else ''
    return f'{rounded(drift.left, 2)} {unit}{share}'


def events(diary: Diary) -> list[Event]:
    """List what happened, oldest first: to the sensor, to the robot's days, and to the model."""
    # Days in a row with the same incident are one event, unless the zero jumped.
    found: dict[tuple[str, int], Event] = {}  # by name and last day
    weighed = any(day.payloads for day in diary.days)
    for n, day in enumerate(diary.days):
        # The names of the day's incidents: of thermometers, each that was out.
        thermometers = re.findall(r'hermometer (\d+)', day.incident)
        names = []
        if day.kind == 'thermometer' and thermometers:
            names = [f'thermometer {number} out' for number in dict.fromkeys(thermometers)]
        elif day.kind or day.incident:
            names = [NAMES.get(day.kind, day.kind or 'incident')]
        elif weighed and not day.payloads and np.isfinite(day.rms_left(NONE)):
            names = [NO_PAYLOAD]
        for name in names:
            begun = None if day.kind == 'zero' else found.pop((name, n - 1), None)
            found[name, n] = begun._replace(last=n) if begun else Event(name, n, n, day.incident)
    happened = list(found.values())
    for n, (day, after) in enumerate(pairwise(diary.days)):
        pause_days = (after.first_ns - day.first_ns) / DAY_NS - day.hours / 24
        if day.first_ns and pause_days >= _PAUSE_DAYS:
            nothing = f'Nothing was recorded for {pause_days:.0f} days.'
            happened.append(Event(NO_DAYS, n, n + 1, nothing))
    numbers = {day.name: n for n, day in enumerate(diary.days)}
    for change in diary.history:
        if change.day in numbers:
            n = numbers[change.day]
            happened.append(Event(_NAMES_OF_CHANGES[change.how], n, n, change.why))
    went_live = {change.day for change in diary.history if change.how == 'learnt'}
    for n, day in enumerate(diary.days):
        if day.better and day.name not in went_live:
            happened.append(Event(OFFERED, n, n, f'{day.better} was learnt. {day.verdict}'))
    return sorted(happened, key=lambda event: (event.first, event.name in MODEL_CHANGES))


def when(entry: DayEntry) -> str:
    """Write a day's date, or its name where it has none."""
    return entry.name.removesuffix('.csv') if date_of(entry) == '-' else date_of(entry)


def event_line(event: Event, days: Sequence[DayEntry]) -> str:
    """Write the date of an event, or the first and the last one, its name, and details."""
    dates = ' to '.join(dict.fromkeys(when(days[n]) for n in (event.first, event.last)))
    return f'{dates}  {event.name}' + (f': {event.sentence}' if event.sentence else '')


def date_of(entry: DayEntry) -> str:
    """Write the date that a day began on by its stamps, UTC; '-' where no calendar has it."""
    if not entry.first_ns:
        return '-'  # its recording could not be read
    try:
        return str(datetime.fromtimestamp(entry.first_ns // NANOSECONDS, timezone.utc).date())
    except (OverflowError, ValueError):
        return '-'
