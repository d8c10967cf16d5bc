"""One lesson: what the newest day says of the live model, of the sensor, and of a better model."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from wrist_ft_comp.drift.drift_model import DriftModel
from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.result import Calibration
from wrist_ft_comp.fit.settings import CalibrationSettings
from wrist_ft_comp.learning.challenge import (
    ANOTHER_DAY,
    evidence,
    good_days,
    judge,
    MOST_DAYS,
    reason,
    worthiest,
)
from wrist_ft_comp.learning.day import Day, describe, left
from wrist_ft_comp.learning.entry import CHALLENGER, DayEntry, forces_left, NONE
from wrist_ft_comp.learning.incidents import incident, LEARNT_FROM, pause, UNREADABLE
from wrist_ft_comp.signals import FloatArray
from wrist_ft_comp.stream.offline import simulate_drift

#: Reads and separates a day by its name.
Look = Callable[[str], Day]


@dataclass(frozen=True, eq=False)
class Champion:
    """The live model: what its figures stand under, and the newest day that it may know."""

    key: str = ''
    model: DriftModel | None = None
    newest: str = ''


@dataclass(frozen=True, eq=False)
class Lesson:
    """The newest day's entry, and a better model with the names of its days, if there is one."""

    entry: DayEntry
    better: Calibration | None = None
    days: tuple[str, ...] = ()


def describe_day(
    name: str, look: Look, before: Sequence[DayEntry], champion: Champion
) -> DayEntry:
    """Write a day's entry: what it saw, what happened, and what the live model left."""
    known: FloatArray | float = 0.0
    try:
        day = look(name)
        entry = replace(describe(day), name=name, live=champion.key)
        with suppress(WristFtCompError):  # a model for other thermometers, or another period
            if champion.model is not None:
                simulated = simulate_drift(champion.model, day.drift)
                known, theirs = simulated.zero, left(simulated, day)
                entry = replace(entry, left={**entry.left, champion.key: theirs})
        kind, what = incident(day, entry, before, known)
    except WristFtCompError as error:
        what = f'Nothing can be told of this day: {error}'
        return DayEntry(name, live=champion.key, kind=UNREADABLE, incident=what)
    return replace(entry, kind=kind, incident=what)


def take(  # noqa: PLR0913, PLR0917 -- what a lesson needs
    name: str,
    look: Look,
    before: Sequence[DayEntry],
    champion: Champion,
    there: Sequence[str],
    since: str = '',
    settings: CalibrationSettings | None = None,
) -> Lesson:
    """
    Learn from the newest day: ``there`` are the names of days whose recordings are kept.

    Days up to ``since`` are no evidence for a change any more; they may still be learnt from.
    """
    entry = describe_day(name, look, before, champion)
    said, entries = drift_words(entry), [*before, entry]
    if pause(entries, since) or entry.kind not in LEARNT_FROM:
        return Lesson(replace(entry, verdict=f'{said}Nothing is learnt from it.'))
    (due, why), good = reason(entries, champion.key), good_days(entries)[:-1]
    learnt = worthiest([each for each in good if each.name in there], MOST_DAYS)
    if not due or not learnt:
        return Lesson(replace(entry, verdict=f'{said}{ANOTHER_DAY if due else why}'))
    settings = replace(settings or CalibrationSettings(), reference='recorded')
    asked = {each.name: each for each in good if each.name > max(since, champion.newest)}
    entry, better = replace(entry, challenged=True), None
    try:
        learnt = list(_readable(look, learnt))
        challenger = calibrate([look(each.name).drift for each in learnt], settings)
        days = [each.name for each in learnt]
        entry = _judged(entry, challenger, look)
        unseen = [asked[each] for each in there if each in asked and each not in days]
        readable = _readable(look, unseen)
        direct = [entry, *(_judged(each, challenger, look) for each in readable)]
        judgement = judge(*evidence(direct, asked, challenger, days, champion.key or NONE))
        if judgement.better:
            learnt = worthiest([*learnt, entry], MOST_DAYS)
            better = calibrate([look(each.name).drift for each in learnt], settings)
            settings = replace(settings, reference='payload')
            better = replace(better, payloads=look(name).payloads, settings=settings)
    except WristFtCompError as error:
        return Lesson(replace(entry, verdict=f'{said}No new model could be learnt: {error}'))
    verdict = (
        f'{said}A new model ({why}) would have left {forces_left(entry)[2]:.2g} N. '
        f'{judgement.words("the live model" if champion.key else "no model")}'
    )
    return Lesson(replace(entry, verdict=verdict), better, tuple(each.name for each in learnt))


def drift_words(entry: DayEntry) -> str:
    """Say how far a force drifted on a day, and what the live model left; empty if unknown."""
    drift, live, _ = forces_left(entry)
    left = f'left {live:.2g} N' if np.isfinite(live) else 'cannot be judged on this day'
    words = f'the live model {left}' if entry.live else 'no model was live'
    return f'A force drifted by {drift:.2g} N (RMS); {words}. ' if np.isfinite(drift) else ''


def _readable(look: Look, days: Sequence[DayEntry]) -> Iterator[DayEntry]:
    """Choose the days that can still be looked at: files get damaged, and cells shorter."""
    for each in days:
        with suppress(WristFtCompError):
            look(each.name)
            yield each


def _judged(entry: DayEntry, challenger: Calibration, look: Look) -> DayEntry:
    """Write down what a challenger leaves of a day that it was not learnt from."""
    day = look(entry.name)
    theirs = left(simulate_drift(challenger.model, day.drift), day)
    return replace(entry, left={**entry.left, CHALLENGER: theirs})
