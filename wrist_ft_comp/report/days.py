"""What a diary says of its days: in one sentence, what happened and when, and temperatures."""

from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime, timezone
from itertools import pairwise
import re
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.learning.day_files import DAY_NS
from wrist_ft_comp.learning.diary import (
    CONTACTS,
    DayEntry,
    Diary,
    FORCES,
    NOISE,
    NONE,
    rms_left,
    SENSOR,
    THERMOMETER,
    TOOL,
    TORQUES,
    UNREADABLE,
    ZERO,
)
from wrist_ft_comp.ranges import rounded
from wrist_ft_comp.signals import FloatArray, NANOSECONDS

#: A silence of the robot from this length on is one of the things that happened, days.
_PAUSE_DAYS = 7.0
#: Of a drift up to this one, N or N m, no share is given: no sensor resolves it.
_LEAST_DRIFT = 1e-6
#: Names of incidents; another kind goes by its own name.
NAMES = {
    ZERO: 'zero jumped',
    SENSOR: 'gain or mounting changed',
    NOISE: 'more noise',
    TOOL: 'another tool',
    CONTACTS: 'pushed all day',
    UNREADABLE: 'day not readable',
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

    def words(self, unit: str) -> str:
        """Write what was left, and which share that is."""
        share = f' ({rounded(100 * self.share, 2)} %)' if np.isfinite(self.share) else ''
        return f'{rounded(self.left, 2)} {unit}{share}'


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
    return DriftLeft(rms_left(entry, NONE, axes), rms_left(entry, entry.live, axes))


def judged_drifts(diary: Diary, axes: slice = FORCES) -> FloatArray:
    """Collect what was left on days with a live model, or on all where there are none, (n, 2)."""
    drifts = np.array([drift_left(day, axes) for day in diary.days])
    with_model = np.isfinite(drifts).all(axis=1)
    return np.asarray(drifts[with_model if with_model.any() else np.isfinite(drifts[:, 0])])


def usual_drift(drifts: FloatArray) -> DriftLeft:
    """Take the medians of drifts, (n, 2): one day that was judged wrongly does not move them."""
    return DriftLeft(*(np.median(drifts, axis=0) if len(drifts) else (np.nan, np.nan)))


def summary(diary: Diary) -> tuple[str, str]:
    """Say in one sentence what drifted and what was left of it, and how that was counted."""
    count, judged = len(diary.days), judged_drifts(diary)
    dates = dict.fromkeys(map(when, (diary.days[0], diary.days[-1])))
    head = f'{count} day{"s"[: count > 1]}, {" to ".join(dates)}'
    force, torque = usual_drift(judged), usual_drift(judged_drifts(diary, TORQUES))
    if not len(judged):
        return f'{head}: none is judged yet.', ''
    days = f'{len(judged)} day{"s"[: len(judged) > 1]}'
    counted = f'RMS of a day, tared in its first minute; median of {days}'
    drifted = f'on a usual day a force drifted by {rounded(force.without, 2)} N'
    if np.isnan(force.left):
        return f'{head}: {drifted}; no model was live.', f'{counted}.'
    (without, left), most = judged.mean(axis=0), judged[:, 1].max()
    counted += (
        f' with a model; mean {rounded(without, 2)} and {rounded(left, 2)} N; most left '
        f'{rounded(most, 2)} N.'
    )
    if np.isfinite(torque.left):
        drifts = f'{rounded(torque.without, 2)} N m; the model left {torque.words("N m")}'
        counted += f' A torque drifted by {drifts}.'
    return f'{head}: {drifted}; the model left {force.words("N")}.', counted


def events(diary: Diary) -> list[Event]:
    """List what happened, oldest first: to the sensor, to the robot's days, and to the model."""
    happened = [*_incidents(diary.days), *_pauses(diary.days), *_model_changes(diary)]
    return sorted(happened, key=lambda event: (event.first, event.name in MODEL_CHANGES))


def _incidents(days: Sequence[DayEntry]) -> list[Event]:
    """Find incidents; days in a row with the same one are one event, unless the zero jumped."""
    found: dict[tuple[str, int], Event] = {}  # by name and last day
    weighed = any(day.payloads for day in days)
    for n, day in enumerate(days):
        names = _names(day)
        if weighed and not (names or day.payloads) and np.isfinite(rms_left(day, NONE)):
            names = [NO_PAYLOAD]
        for name in names:
            begun = None if day.kind == ZERO else found.pop((name, n - 1), None)
            found[name, n] = begun._replace(last=n) if begun else Event(name, n, n, day.incident)
    return list(found.values())


def _names(day: DayEntry) -> list[str]:
    """Name the incidents of a day: of thermometers, each that was out."""
    if day.kind == THERMOMETER:
        numbers = re.findall(r'[Tt]hermometer (\d+)', day.incident)
        return [f'thermometer {number} out' for number in dict.fromkeys(numbers)] or [day.kind]
    return [NAMES.get(day.kind, day.kind or 'incident')] if day.kind or day.incident else []


def _pauses(days: Sequence[DayEntry]) -> Iterator[Event]:
    """Find long times without a day, from the day before to the day after."""
    for n, (day, after) in enumerate(pairwise(days)):
        pause_days = (after.first_ns - day.first_ns) / DAY_NS - day.hours / 24
        if day.first_ns and pause_days >= _PAUSE_DAYS:
            yield Event(NO_DAYS, n, n + 1, f'Nothing was recorded for {pause_days:.0f} days.')


def _model_changes(diary: Diary) -> Iterator[Event]:
    """Name changes of the live model, and better models that did not go live by themselves."""
    numbers = {day.name: n for n, day in enumerate(diary.days)}
    for decision in diary.decisions:
        if (n := numbers.get(decision.day)) is not None:
            yield Event(_NAMES_OF_CHANGES[decision.how], n, n, decision.sentence)
    live = {decision.day for decision in diary.decisions if decision.how == 'learnt'}
    for n, day in enumerate(diary.days):
        if day.better and day.name not in live:
            yield Event(OFFERED, n, n, f'{day.better} was learnt. {day.verdict}')


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


def known_temperatures(diary: Diary) -> list[list[tuple[float, float]]]:
    """Merge what the days saw, °C: by thermometer, intervals that do not touch."""
    count = max((len(day.temperature_c) for day in diary.days), default=0)
    return [
        _merged(day.temperature_c[j] for day in diary.days if len(day.temperature_c) > j)
        for j in range(count)
    ]


def _merged(intervals: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """Merge intervals that touch or overlap."""
    merged: list[tuple[float, float]] = []
    for low, high in sorted(intervals):
        if merged and low <= merged[-1][1]:
            merged[-1] = merged[-1][0], max(high, merged[-1][1])
        else:
            merged.append((low, high))
    return merged
