"""
After a day: judge the live model and the sensor on it, and choose a new model where one is due.

The model that is learnt from all good days is taken unless it leaves clearly more of the days that
the live one was not learnt from. Of its own days, what counts is the error of a fit to the others.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.drift.drift_model import DriftModel
from wrist_ft_comp.errors import CalibrationRefusedError, WristFtCompError
from wrist_ft_comp.fit.auto_method import HARMFUL_FOLD
from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.data_checks import drop_stuck_cells
from wrist_ft_comp.fit.result import Calibration, rms_by_fold
from wrist_ft_comp.fit.settings import CalibrationSettings
from wrist_ft_comp.learning import incidents
from wrist_ft_comp.learning.days import (
    CHALLENGER,
    DayEntry,
    good_days,
    LEARNT_FROM,
    NONE,
    worthiest,
)
from wrist_ft_comp.learning.incidents import Day, DAYS_TO_AGREE, describe, incident, left
from wrist_ft_comp.series import FloatArray
from wrist_ft_comp.stream.drift_of_recordings import streamed_drift, thermometer_doubts

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
#: Added to both errors, as a share of a usual drift: where next to nothing is left, neither of the
#: two is better.
_FLOOR = 0.01
#: A day whose separation raises these is unreadable: numbers that no separation has met yet must
#: not end the jobs of all later days.
_UNREADABLE = WristFtCompError, ArithmeticError, IndexError, ValueError

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
class Choice:
    """What was found out after a day."""

    entry: DayEntry
    better: Calibration | None = None
    #: Names of the days that it was learnt from.
    days: tuple[str, ...] = ()


def describe_day(name: str, look: Look, before: Sequence[DayEntry], live: Champion) -> DayEntry:
    """Make a day's entry: what it saw, its incident, and what the live model left."""
    drift: FloatArray | float = 0.0
    distrusted: list[str] = []
    try:
        day = look(name)
        entry = replace(describe(day), name=name, live=live.key)
        if not day.drift.axes_present:
            sentence = 'No cell of the day was free of contact: its drift is unknown.'
            return replace(entry, kind='contacts', incident=sentence)
        drop_stuck_cells([day.drift])  # refuses a reading that froze
        with suppress(WristFtCompError):  # a model for other thermometers, or another period
            if live.model is not None:
                simulated = streamed_drift(live.model, day.drift, day.before)
                drift = simulated.zero
                distrusted = list(thermometer_doubts(live.model, day.drift))
                entry = replace(entry, left={**entry.left, live.key: left(simulated, day)})
        kind, sentence = incident(day, entry, before, drift)
        stated = {} if live.model is None else live.model.day_limits
        left_n = zip(AXES, entry.left.get(live.key, ()), strict=False)
        broken = [axis for axis, rms in left_n if rms > stated.get(axis, np.inf)]
        if broken and not kind:
            sentence = (
                f'The live model left more of {", ".join(broken)} in the mean than it states at '
                'most. Is each thermometer in its place, is it the same sensor, does a cable '
                'pull? Or was it warmer or colder than in its recordings?'
            )
        if distrusted and not kind:
            kind, sentence = 'thermometer', f'On this day {"; ".join(distrusted)}.'
    except _UNREADABLE as error:
        sentence = f'This day cannot be judged: {error}'
        return DayEntry(name, live=live.key, kind='unreadable', incident=sentence)
    return replace(entry, kind=kind, incident=sentence)


def take(  # noqa: PLR0913, PLR0917 -- what the choice depends on
    name: str, look: Look, before: Sequence[DayEntry], champion: Champion, kept: Sequence[str],
    since: str = '', settings: CalibrationSettings | None = None,
) -> Choice:  # fmt: skip
    """
    Judge the newest day, ``name``, and learn a model from all good days where that is due.

    Entries of the days ``before`` come oldest first; ``kept`` are the days with a recording. The
    day ``since``, the newest one before a person's last decision, and older days are learnt from,
    but are no evidence for a change.
    """
    entry = describe_day(name, look, before, champion)
    words, entries = drift_words(entry), [*before, entry]
    if incidents.pause(entries, since) or entry.kind not in LEARNT_FROM:
        return Choice(replace(entry, verdict=f'{words}No model was learnt after this day.'))
    chosen = since if since > champion.newest else ''
    due, why = reason(entries, champion.key, chosen)
    days = [day for day in good_days(entries) if day.name in kept]
    learnt: list[DayEntry] = []
    for day in worthiest(days, MOST_DAYS) if due else ():
        with suppress(*_UNREADABLE):  # a file may have been damaged since
            look(day.name)
            learnt.append(day)
    if len(learnt) < FEWEST_DAYS:
        return Choice(replace(entry, verdict=f'{words}{ANOTHER_DAY if due else why}'))
    settings = replace(settings or CalibrationSettings(), reference='recorded')
    entry = replace(entry, challenged=True)
    try:
        found = calibrate([look(day.name).drift for day in learnt], settings)
        errors = held_out(found, learnt)
        entry = replace(entry, left={**entry.left, CHALLENGER: tuple(errors[-1].tolist())})
        ratio, count = compare(learnt, errors, champion.key, max(since, champion.newest))
    except WristFtCompError as error:
        return Choice(replace(entry, verdict=f'{words}No new model could be learnt: {error}'))
    # It may leave a little more: it knows more days than the fits to the others that it is judged
    # by. With 1, a development world left 8 % more from the tenth day on. Without a limit, another
    # left 0.4 of a usual day's drift instead of 0.01 for a week, after one day separated badly.
    taken = ratio < (HARMFUL_FOLD if champion.key and not chosen else 1)
    is_better = round(ratio, 2) < 1  # as it is printed
    why_so = 'It is better' if is_better else 'It is about as good and has learnt from more days'
    why_not = 'It is not used'
    if taken and champion.model and not covers(found, champion.model):
        taken, why_not = False, (
            'It is not used: its days warmed by less than half of what the live model knows, as '
            'days at rest do'
        )  # fmt: skip
    verdict = (
        f'{words}A new model ({why}) would have left {entry.rms_left(CHALLENGER):.2g} N. On '
        f'{count} {"day" if count == 1 else "days"} that neither knew, it leaves {ratio:.2f} '
        f'times as much drift as {"the live model" if champion.key else "no model"}. '
        f'{why_so if taken else why_not}.'
    )
    entry = replace(entry, verdict=verdict)
    if not taken:
        return Choice(entry)
    settings = replace(settings, reference='payload')
    better = replace(found, payloads=look(name).payloads, settings=settings)
    return Choice(entry, better, tuple(day.name for day in learnt))


def covers(found: Calibration, live: DriftModel) -> bool:
    """Whether a new model knows half as many kelvin as the live one, at least, of its widest."""
    if not live.axes:
        return True
    known_c = np.array([axis.range_c for axis in live.axes.values()])  # (axes, 2, J)
    known_k = known_c[:, 1].max(axis=0) - known_c[:, 0].min(axis=0)
    most = np.argmax(known_k)
    return bool(np.ptp(found.temperature_range_c[most]) >= known_k[most] / 2)


def held_out(found: Calibration, days: Sequence[DayEntry]) -> FloatArray:
    """Compute what fits to the other days leave of every day, N and N m, (n, 6)."""
    left = np.full((len(days), len(AXES)), np.nan)
    for axis, fit in found.fits.items():
        errors, numbers = rms_by_fold(fit.held_out), np.unique(fit.held_out.recording)
        if len(numbers) < len(errors.before):  # what was held out are parts of a day
            continue
        drift = np.array([days[number].left[NONE] for number in numbers])[:, AXES.index(axis)]
        # As a share, because the diary tares in a minute of cells, and a fit in one of bins.
        share = errors.after / np.maximum(errors.before, 1e-12)
        left[numbers, AXES.index(axis)] = share * drift
    return left


def compare(
    days: Sequence[DayEntry], errors: FloatArray, live: str, newest: str
) -> tuple[float, int]:
    """
    Compare what a new model and the live one leave of days that neither was learnt from.

    ``errors``, N and N m, (n, 6), are what the new model left of the days when they were held out;
    ``live`` is the key of the live one, empty where none is. Only days after ``newest`` count.
    Gives the geometric mean over days and axes of the new errors over those of the live model, and
    the number of days; CalibrationRefusedError where the live model cannot be judged on any.
    """
    usual = np.maximum(np.mean([day.left[NONE] for day in days], axis=0), 1e-12)
    logs = [
        np.log((by_new / usual + _FLOOR) / (np.array(day.left[live or NONE]) / usual + _FLOOR))
        for day, by_new in zip(days, errors, strict=True)
        if day.name > newest and (live or NONE) in day.left
    ]
    judged = [log for log in logs if np.isfinite(log).any()]
    if not judged:
        raise CalibrationRefusedError(
            'The live model cannot be judged on these days; it is for other thermometers, or '
            'other thermal cells. Call ~/calibrate.'
        )
    return float(np.exp(np.nanmean(judged))), len(judged)


def drift_words(entry: DayEntry) -> str:
    """Say how far a force drifted on a day, and what the live model left; empty where unknown."""
    drift, live = entry.rms_left(NONE), entry.rms_left(entry.live)
    left = f'left {live:.2g} N' if np.isfinite(live) else 'cannot be judged on this day'
    words = f'the live model {left}' if entry.live else 'no model was live'
    return f'A force drifted by {drift:.2g} N (RMS); {words}. ' if np.isfinite(drift) else ''


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
