"""
Champion against challenger: when a challenger is learnt, and whether it is better.

The champion is the live model. A challenger is learnt from all good days but the newest.

Days are the unit of evidence: a day counts as one error. Both are compared on the days since the
champion was learnt. Where the challenger was learnt from such a day, too, its error is that of a
fit with this day held out. Evidence is the logarithm of challenger's over champion's error,
averaged over axes. The mean over all days, or over the newest six, has to be below zero by two
standard errors and a margin. The spread between days is estimated as if two days of a usual spread
had been seen before. So a single day proves something only where the challenger is three times as
good, and ten days where it is better by a quarter.

The challenger may not be much worse on any day. Rooms and robots change: where the champion leaves
twice as much as the challenger on the newest six days, only these six count.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.fit.result import Calibration, rms_by_fold
from wrist_ft_comp.learning.diary import (
    Cell,
    CHALLENGER,
    DayEntry,
    LEARNT_FROM,
    NONE,
    share_left,
)
from wrist_ft_comp.signals import AXES, FloatArray

#: Most days that a model is learnt from. They bound the cost, and all seasons fit into them.
MOST_DAYS = 12
#: A challenger is learnt when the number of good days has grown by this share ...
_GROWTH = 1 / 3
#: ... or by this number, if that is less ...
_MOST_GROWTH_DAYS = 20
#: ... or after a day on which the champion left more than this many times its median ...
_BAD_RATIO = 2.0
#: ... and more than this share of the drift ...
_BAD_SHARE = 0.1
#: ... or after a day with more than this share of coarse temperatures that are new.
_NEW_TEMPERATURES_SHARE = 0.25
#: Most processor time that days with a challenger may take together, s ...
_MOST_SPENT_S = 1400.0
#: ... in this many days. Days that were only judged do not count: on a slow computer, judging
#: alone takes that long, and there would never be a challenger.
_SPENT_DAYS = 30
#: Usual standard deviation of the logarithm of a day.
_SPREAD = 0.5
#: Number of days that the usual standard deviation counts for.
_SPREAD_DAYS = 2.0
#: Standard errors by which the mean has to be below zero.
_SURE_ERRORS = 2.0
#: The newest days that are also judged by themselves.
_NEWEST_DAYS = 6
#: Only the newest days count where the bound of their mean is below the negative of this: there,
#: the champion surely leaves twice as much.
_CHANGED_LOG = 0.7
#: A challenger that is better by less than this logarithm is not worth a change.
_MARGIN_LOG = 0.1
#: A challenger may not leave more on any day by this share of a usual day's drift.
_WORSE_SHARE = 0.15
#: Added to both errors, as a share of a usual drift: where next to nothing is left, neither of the
#: two is better.
_FLOOR = 0.01
ANOTHER_DAY = 'Another good day is needed to learn from.'


def reason(entries: Sequence[DayEntry], champion: str) -> tuple[bool, str]:
    """Decide whether a challenger is learnt on the newest day, and say why, or why not."""
    good = [day for day in entries if day.kind in LEARNT_FROM]
    spent_s = sum(day.seconds for day in entries[-_SPENT_DAYS:] if day.challenged)
    if len(good) < 2:
        return False, ANOTHER_DAY
    if spent_s > _MOST_SPENT_S:
        return False, (
            f'No new model was tried: in the last {_SPENT_DAYS} days, learning took '
            f'{spent_s / 60:.0f} minutes of processor time, and {_MOST_SPENT_S / 60:.0f} are '
            'allowed.'
        )
    last = max((n for n, day in enumerate(good) if day.challenged), default=0)
    grown, awaited = len(good) - 1 - last, min(_MOST_GROWTH_DAYS, _GROWTH * (last + 1))
    if not champion:
        return True, 'no model is live'
    if grown >= awaited:
        return True, f'{grown} more good {"day" if grown == 1 else "days"}'
    older = good[: last + 1]
    seen: frozenset[Cell] = frozenset().union(*(day.known for day in older))
    shares = [float(np.nanmean(share_left(day, champion))) for day in good if champion in day.left]
    bad_share = max(_BAD_RATIO * float(np.median(shares or [1.0])), _BAD_SHARE)
    # A challenger is not learnt from the newest day, so only an earlier one can be the reason.
    for day in good[last + 1 : -1]:
        new = len(day.known - seen) > _NEW_TEMPERATURES_SHARE * len(day.known)
        if new or (champion in day.left and np.nanmean(share_left(day, champion)) > bad_share):
            bad = f'the live model did badly on {day.name}'
            return True, f'{day.name} had other temperatures' if new else bad
    return False, (
        f'No new model was tried: {grown} of {np.ceil(awaited):.0f} more good days have come, and '
        'no day with other temperatures or a bad result of the live model.'
    )


def evidence(
    unseen: Sequence[DayEntry],
    before: Mapping[str, DayEntry],
    calibration: Calibration,
    days: Sequence[str],
    champion: str,
) -> tuple[FloatArray, FloatArray]:
    """
    Compute what champion and challenger leave of days that neither was learnt from, (n, 6) each.

    The newest day is first. The unit is a usual day's drift, so that days that hardly drift count
    little. The challenger was not learnt from the days ``unseen``, which have its error; it was
    learnt from ``days``, in this order, and their errors are those of the calibration when they
    were held out. The champion was not learnt from the days ``before``. CalibrationRefusedError
    when the champion cannot be judged on any of them.
    """
    shares = [(day, share_left(day, CHALLENGER)) for day in unseen]
    held_out = np.full((len(days), len(AXES)), np.nan)
    for axis, fit in calibration.fits.items():
        if fit.held_out is not None and len(days) > 1:  # of a single day, parts were held out
            errors, numbers = rms_by_fold(fit.held_out), np.unique(fit.held_out.recording)
            held_out[numbers, AXES.index(axis)] = errors.after / np.maximum(errors.before, 1e-12)
    pairs = zip(days, held_out, strict=True)
    shares += [(before[name], challenger) for name, challenger in pairs if name in before]
    shares.sort(key=lambda pair: pair[0].name, reverse=True)
    rows = [(day.left[NONE], share_left(day, champion), share) for day, share in shares]
    rows = [row for row in rows if np.isfinite(row[1] + row[2]).any()]
    if not rows:
        raise CalibrationRefusedError(
            'The live model cannot be judged on these days; it is for other thermometers, or '
            'another thermal_period. Call ~/calibrate.'
        )
    drift, by_champion, by_challenger = (np.array(c) for c in zip(*rows, strict=True))
    usual = drift / np.maximum(np.mean(drift, axis=0), 1e-12)
    return by_champion * usual, by_challenger * usual


class Judgement(NamedTuple):
    """Whether a challenger is better than the champion, and the figures behind that."""

    better: bool
    #: Number of days that decided.
    days: int
    #: Geometric mean of challenger's over champion's error.
    ratio: float
    #: The same, with 95 % certainty at most.
    highest_ratio: float
    #: How much more the challenger leaves on its worst day, as a share of a usual day's drift.
    worse: float

    def words(self, champion: str) -> str:
        """Say how the challenger compares with the champion, and what decided."""
        days = f'{self.days} {"day" if self.days == 1 else "days"}'
        result = (
            f'On {days} that neither was learnt from, the new model leaves {self.ratio:.2f} times '
            f'as much drift as {champion}, at most {self.highest_ratio:.2f} times with 95 % '
            'certainty'
        )
        if self.better:
            return f'{result}. It is better.'
        if self.worse < _WORSE_SHARE:
            needed = f'a change needs at most {np.exp(-_MARGIN_LOG):.2f} times'
            return f'{result}; {needed}. It is not used.'
        return (
            f'{result}. But on one day it leaves more by {self.worse:.0%} of a usual drift, and '
            f'at most {_WORSE_SHARE:.0%} are allowed. It is not used.'
        )


def judge(champion: FloatArray, challenger: FloatArray) -> Judgement:
    """Judge a challenger by the errors, (n, 6), that ``evidence`` gives."""
    logs = np.nanmean(np.log((challenger + _FLOOR) / (champion + _FLOOR)), axis=1)
    newest, increases = logs[:_NEWEST_DAYS], np.nanmean(challenger - champion, axis=1)
    deciding = min(logs, newest, key=_upper_bound)
    bound, changed = _upper_bound(deciding), _upper_bound(newest) < -_CHANGED_LOG
    worse = float(increases[: _NEWEST_DAYS if changed else len(increases)].max())
    better = bound < -_MARGIN_LOG and worse < _WORSE_SHARE
    ratio, highest_ratio = float(np.exp(deciding.mean())), float(np.exp(bound))
    return Judgement(better, len(deciding), ratio, highest_ratio, worse)


def _upper_bound(logs: FloatArray) -> float:
    """Compute the largest mean of daily logarithms that is _SURE_ERRORS standard errors away."""
    spread = _SPREAD_DAYS * _SPREAD**2 + np.sum((logs - logs.mean()) ** 2)
    error = np.sqrt(spread / (_SPREAD_DAYS + len(logs) - 1) / len(logs))
    return float(logs.mean() + _SURE_ERRORS * error)
