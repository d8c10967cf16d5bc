"""What a diary says of its days: in one sentence, what happened and when, and temperatures."""

from collections.abc import Sequence
from contextlib import suppress
from datetime import datetime, timezone
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.learning.diary import DayEntry, Diary, NONE
from wrist_ft_comp.series import NANOSECONDS, rounded
from wrist_ft_comp.stored.safe_file import Output

#: What the picture of days names as its software, by which it is known again.
PAINTER = 'wrist_ft_comp picture'
PICTURE = Output(
    # Header, image header, and the text, before or after the chunk that holds the resolution.
    # Bytes that are no text count as one letter, alone or together.
    name='picture', endings='.png',
    begins=rf'.PNG\r\n\x1a\n.{{20,80}}tEXtSoftware\x00{PAINTER}')  # fmt: skip

#: Of a drift up to this one, N, no share is given: no sensor resolves it.
_LEAST_DRIFT = 1e-6
#: Names of incidents; another kind goes by its own name.
NAMES = {
    'zero': 'zero jumped',
    'thermometer': 'thermometer out',
    'sensor': 'gain or mounting changed',
    'tool': 'another tool',
    'contacts': 'pushed all day',
    'unreadable': 'day not readable',
}
OFFERED = 'better model offered'
#: Names of changes of the model, which happen after a day.
CHANGES = {
    'learnt': 'new model learnt',
    'offered': OFFERED,
    'chosen': 'person chose model',
    'back': 'back to old model',
}


class DriftLeft(NamedTuple):
    """RMS of a force's drift, N: without a model, and what the live one left; NaN if unknown."""

    without: float
    left: float


class Event(NamedTuple):
    """Something that happened on a day, on several in a row, or after one."""

    name: str
    #: Numbers of the first and the last of these days.
    first: int
    last: int
    #: Details; empty where the name says everything.
    sentence: str


def drift_left(entry: DayEntry) -> DriftLeft:
    """Give what was left of a force's drift on a day."""
    return DriftLeft(entry.rms_left(NONE), entry.rms_left(entry.live))


def usual_drift(diary: Diary) -> DriftLeft:
    """Take the medians of days with a live model, if there are any, or else of all."""
    drifts = np.array([drift_left(day) for day in diary.days])
    with_model = np.isfinite(drifts).all(axis=1)
    judged = drifts[with_model if with_model.any() else np.isfinite(drifts[:, 0])]
    return DriftLeft(*(np.median(judged, axis=0) if len(judged) else (np.nan, np.nan)))


def summary(diary: Diary) -> str:
    """Say in one sentence what drifted, and what was left of it."""
    usual, count = usual_drift(diary), len(diary.days)
    dates = dict.fromkeys(map(when, (diary.days[0], diary.days[-1])))
    head = f'{count} {"day" if count == 1 else "days"}, {" to ".join(dates)}'
    if np.isnan(usual.without):
        return f'{head}: none is judged yet.'
    sentence = f'{head}: on a usual day a force drifted by {rounded(usual.without, 2)} N (RMS)'
    if np.isnan(usual.left):
        return f'{sentence}; no model was live.'
    sentence += f'; the model left {rounded(usual.left, 2)} N'
    if usual.without > _LEAST_DRIFT:
        sentence += f' ({rounded(100 * usual.left / usual.without, 2)} %)'
    return f'{sentence}.'


def figures(diary: Diary) -> dict[str, object]:
    """Give days, what was left of their drift, and what happened, for scripts."""
    names = [day.name for day in diary.days]
    return {
        'days': [{**vars(day), 'known': sorted(day.known)} for day in diary.days],
        'paused': diary.paused,
        'summary': {'sentence': summary(diary), 'force_n': usual_drift(diary)},
        'events': [
            event._asdict() | {'first': names[event.first], 'last': names[event.last]}
            for event in events(diary)
        ],
    }


def events(diary: Diary) -> list[Event]:
    """List what happened, oldest first: to the sensor, to the robot's days, and to the model."""
    happened: list[Event] = []
    for n, day in enumerate(diary.days):
        name = NAMES.get(day.kind, day.kind)
        before = happened[-1] if happened else None
        if before and day.kind != 'zero' and (before.name, before.last) == (name, n - 1):
            # Days in a row with the same incident are one event, unless the zero jumped.
            happened[-1] = before._replace(last=n)
        elif name:
            happened.append(Event(name, n, n, day.incident))
    numbers = {day.name: n for n, day in enumerate(diary.days)}
    for change in diary.history:
        if change.day in numbers:
            n = numbers[change.day]
            happened.append(Event(CHANGES[change.how], n, n, change.why))
    went_live = {change.day for change in diary.history if change.how == 'learnt'}
    for n, day in enumerate(diary.days):
        if day.better and day.name not in went_live:
            happened.append(Event(OFFERED, n, n, f'{day.better} was learnt. {day.verdict}'))
    return sorted(happened, key=lambda event: (event.first, event.name in CHANGES.values()))


def when(entry: DayEntry) -> str:
    """Write the date that a day began on by its stamps, UTC, or its name where it has none."""
    with suppress(OverflowError, ValueError):  # no calendar has every stamp
        if entry.first_ns:  # its recording could be read
            return str(datetime.fromtimestamp(entry.first_ns // NANOSECONDS, timezone.utc).date())
    return entry.name.removesuffix('.csv')


def event_line(event: Event, days: Sequence[DayEntry]) -> str:
    """Write the date of an event, or the first and the last one, its name, and details."""
    dates = ' to '.join(dict.fromkeys(when(days[n]) for n in (event.first, event.last)))
    return f'{dates}  {event.name}' + (f': {event.sentence}' if event.sentence else '')
