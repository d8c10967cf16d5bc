"""One lesson: judge the live model and the sensor on the newest day, and try a better model."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from wrist_ft_comp.drift.drift_model import DriftModel
from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.result import Calibration
from wrist_ft_comp.fit.settings import CalibrationSettings
from wrist_ft_comp.learning.challenge import ANOTHER_DAY, evidence, judge, MOST_DAYS, reason
from wrist_ft_comp.learning.creep import shares
from wrist_ft_comp.learning.day import Day, describe, left
from wrist_ft_comp.learning.diary import (
    CHALLENGER,
    DayEntry,
    forces_left,
    good_days,
    LEARNT_FROM,
    NONE,
    THERMOMETER,
    UNREADABLE,
    worthiest,
)
from wrist_ft_comp.learning.incidents import incident, pause
from wrist_ft_comp.signals import FloatArray
from wrist_ft_comp.stream.offline import lies

#: Reads and separates the day of a name; WristFtCompError where that is impossible.
Look = Callable[[str], Day]


@dataclass(frozen=True, eq=False)
class Champion:
    """The live model."""

    #: Its key in ``DayEntry.left``; empty where no model is live.
    key: str = ''
    model: DriftModel | None = None
    #: Name of the newest day that it was learnt from, as far as known.
    newest: str = ''


@dataclass(frozen=True, eq=False)
class Lesson:
    """The result of a lesson."""

    entry: DayEntry
    #: A better model, if there is one.
    better: Calibration | None = None
    #: Names of the days that it was learnt from.
    days: tuple[str, ...] = ()


def describe_day(
    name: str, look: Look, before: Sequence[DayEntry], champion: Champion
) -> DayEntry:
    """Make a day's entry: what it saw, its incident, and what the live model left."""
    drift: FloatArray | float = 0.0
    lying: list[str] = []
    try:
        day = look(name)
        entry = replace(describe(day), name=name, live=champion.key)
        with suppress(WristFtCompError):  # a model for other thermometers, or another period
            if champion.model is not None:
                simulated = day.simulate(champion.model)
                drift, lying = simulated.zero, lies(champion.model, day.drift)
                entry = replace(
                    entry,
                    left={**entry.left, champion.key: left(simulated, day)},
                    creep=shares(day, simulated),
                )
        kind, sentence = incident(day, entry, before, drift)
        if lying and not kind:
            kind, sentence = THERMOMETER, f'On this day {"; ".join(lying)}.'
    except WristFtCompError as error:
        sentence = f'This day cannot be judged: {error}'
        return DayEntry(name, live=champion.key, kind=UNREADABLE, incident=sentence)
    return replace(entry, kind=kind, incident=sentence)


def take(  # noqa: PLR0913, PLR0917 -- what a lesson needs
    name: str,
    look: Look,
    before: Sequence[DayEntry],
    champion: Champion,
    kept: Sequence[str],
    since: str = '',
    settings: CalibrationSettings | None = None,
) -> Lesson:
    """
    Judge the newest day, ``name``, and learn a challenger where one is due.

    Entries of the days ``before`` come oldest first; ``kept`` are the days with a recording. The
    day ``since``, the newest one before a person's last decision, and older days are learnt from,
    but are no evidence for a change.
    """
    entry = describe_day(name, look, before, champion)
    words, entries = drift_words(entry), [*before, entry]
    if pause(entries, since) or entry.kind not in LEARNT_FROM:
        return Lesson(replace(entry, verdict=f'{words}Nothing is learnt from it.'))
    (due, why), good = reason(entries, champion.key), good_days(entries)[:-1]
    learnt = worthiest([day for day in good if day.name in kept], MOST_DAYS)
    if not due or not learnt:
        return Lesson(replace(entry, verdict=f'{words}{ANOTHER_DAY if due else why}'))
    settings = replace(settings or CalibrationSettings(), reference='recorded')
    fair = {day.name: day for day in good if day.name > max(since, champion.newest)}
    entry, better = replace(entry, challenged=True), None
    try:
        learnt = list(_readable(look, learnt))
        challenger = calibrate([look(day.name).drift for day in learnt], settings)
        names = [day.name for day in learnt]
        entry = _judged(entry, challenger, look)
        unseen = [fair[day] for day in kept if day in fair and day not in names]
        direct = [entry, *(_judged(day, challenger, look) for day in _readable(look, unseen))]
        judgement = judge(*evidence(direct, fair, challenger, names, champion.key or NONE))
        if judgement.better:
            learnt = worthiest([*learnt, entry], MOST_DAYS)
            better = calibrate([look(day.name).drift for day in learnt], settings)
            settings = replace(settings, reference='payload')
            better = replace(better, payloads=look(name).payloads, settings=settings)
    except WristFtCompError as error:
        return Lesson(replace(entry, verdict=f'{words}No new model could be learnt: {error}'))
    verdict = (
        f'{words}A new model ({why}) would have left {forces_left(entry)[2]:.2g} N. '
        f'{judgement.words("the live model" if champion.key else "no model")}'
    )
    return Lesson(replace(entry, verdict=verdict), better, tuple(day.name for day in learnt))


def drift_words(entry: DayEntry) -> str:
    """Say how far a force drifted on a day, and what the live model left; empty where unknown."""
    drift, live, _ = forces_left(entry)
    left = f'left {live:.2g} N' if np.isfinite(live) else 'cannot be judged on this day'
    words = f'the live model {left}' if entry.live else 'no model was live'
    return f'A force drifted by {drift:.2g} N (RMS); {words}. ' if np.isfinite(drift) else ''


def _readable(look: Look, days: Sequence[DayEntry]) -> Iterator[DayEntry]:
    """Choose the days that can still be separated: a file may be damaged since."""
    for day in days:
        with suppress(WristFtCompError):
            look(day.name)
            yield day


def _judged(entry: DayEntry, challenger: Calibration, look: Look) -> DayEntry:
    """Add to an entry what a challenger leaves of that day, which it was not learnt from."""
    day = look(entry.name)
    by_challenger = left(day.simulate(challenger.model), day)
    return replace(entry, left={**entry.left, CHALLENGER: by_challenger})
