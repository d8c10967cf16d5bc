"""
Champion against challenger: when a challenger is learnt, and whether it is better.

A challenger is learnt from all good days but the newest. Days are the unit of evidence: the errors
of a day are one error. On days since the champion was learnt its error is compared with the
challenger's: directly where the challenger was not learnt from that day, else with that day held
out. The logarithm of their ratio is averaged over axes. Its mean over all these days, or over the
newest six, has to be below zero by two standard errors and a margin. The spread between days is
estimated beside two days of a usual spread, so that a single day proves something only where the
challenger is three times as good, ten days where it is better by a quarter. No day may be much
worse; older days than the newest six are no objection where the champion leaves twice as much as
the challenger on these six.
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

#: Most days that a model is learnt from: what they cost is bounded, and seasons fit in.
MOST_DAYS = 12
#: A challenge comes when the good days have grown by this share, …
_GROWN = 1 / 3
#: … or by this number …
_AT_LATEST = 20
#: … or when the champion left so many times what it usually leaves, …
_BADLY = 2.0
#: … and at least this share of the drift.
_MUCH = 0.1
#: Days like those before know this share of new coarse temperatures at most.
_NEW_TEMPERATURES = 0.25
#: Processor time, s, that days with a challenger may take together …
_SPENT_S = 1400.0
#: … among the last days. A day that is only judged takes what its cells take on this computer, and
#: counts for nothing here: on a slow one there would never be a model.
_SPENT_DAYS = 30
#: Usual spread of a day's logarithm …
_SPREAD = 0.5
#: … and the number of days that it counts for.
_SPREAD_DAYS = 2.0
#: Standard errors of a proof.
_SURE = 2.0
#: The newest days are judged by themselves, too.
_NEWEST = 6
#: Something has changed where the champion leaves twice as much on these, as a logarithm.
_CHANGED = 0.7
#: A challenger that is better by less than this, as a logarithm, is not worth a change …
_MARGIN = 0.1
#: … nor one that leaves more on any day by this share of a usual day's drift.
_WORSE = 0.15
#: Drift that is left below this share is no difference.
_FLOOR = 0.01
ANOTHER_DAY = 'Another good day is needed to learn from.'


def reason(entries: Sequence[DayEntry], champion: str) -> tuple[bool, str]:
    """Tell whether a challenger is learnt on the newest day, and why, or why not."""
    good = [day for day in entries if day.kind in LEARNT_FROM]
    spent_s = sum(day.seconds for day in entries[-_SPENT_DAYS:] if day.challenged)
    if len(good) < 2 or spent_s > _SPENT_S:
        return False, ANOTHER_DAY if len(good) < 2 else (
            f'No new model was tried: in the last {_SPENT_DAYS} days that took '
            f'{spent_s / 60:.0f} minutes of processor time, and {_SPENT_S / 60:.0f} are allowed.'
        )
    last = max((n for n, day in enumerate(good) if day.challenged), default=0)
    grown, awaited = len(good) - 1 - last, min(_AT_LATEST, _GROWN * (last + 1))
    if not champion:
        return True, 'no model is live'
    if grown >= awaited:
        return True, f'{grown} more good {"day" if grown == 1 else "days"}'
    older = good[: last + 1]
    seen: frozenset[Cell] = frozenset().union(*(day.known for day in older))
    shares = [float(np.nanmean(share_left(day, champion))) for day in good if champion in day.left]
    badly = max(_BADLY * float(np.median(shares or [1.0])), _MUCH)
    # The newest day is not learnt from, so that a day before has to be the reason.
    for day in good[last + 1 : -1]:
        if len(day.known - seen) > _NEW_TEMPERATURES * len(day.known):
            return True, f'{day.name} knew other temperatures'
        if champion in day.left and np.nanmean(share_left(day, champion)) > badly:
            return True, f'the live model did badly on {day.name}'
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
    Collect what both leave of days that none was learnt from, and of held-out ones: (n, 6) each.

    Newest first, in units of what these days usually drift: those that hardly drift prove little.
    ``unseen`` are days that the challenger was not learnt from, with what it leaves of them,
    ``before`` those that the champion was not learnt from, ``days`` the challenger's, in order.
    CalibrationRefusedError where the champion cannot be judged on any of them.
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
    rows = [(day.left[NONE], share_left(day, champion), mine) for day, mine in shares]
    rows = [row for row in rows if np.isfinite(row[1] + row[2]).any()]
    if not rows:
        raise CalibrationRefusedError(
            'The live model cannot be judged on these days; it is for other thermometers, or '
            'another thermal_period. Call ~/calibrate.'
        )
    drift, theirs, mine = (np.array(column) for column in zip(*rows, strict=True))
    usual = drift / np.maximum(np.mean(drift, axis=0), 1e-12)
    return theirs * usual, mine * usual


class Judgement(NamedTuple):
    """Whether a challenger is better than the champion, and by which figures."""

    better: bool
    #: Number of days that it was judged on.
    days: int
    #: What the challenger leaves over what the champion leaves: the geometric mean …
    ratio: float
    #: … and with 95 % certainty at most.
    highest_ratio: float
    #: How much more the challenger leaves on its worst day, as a share of a usual day's drift.
    worse: float

    def words(self, champion: str) -> str:
        """Say in a sentence how it compares with a champion of that name, and what decided."""
        days = f'{self.days} {"day" if self.days == 1 else "days"}'
        result = (
            f'On {days} that neither was learnt from, it leaves {self.ratio:.2f} times as much as '
            f'{champion}, with 95 % certainty at most {self.highest_ratio:.2f} times'
        )
        if self.better:
            return f'{result}. It is better.'
        if self.worse < _WORSE:
            return f'{result}, and {np.exp(-_MARGIN):.2f} is asked for. It is not used.'
        return (
            f'{result}, but on one day more by {self.worse:.0%} of a usual drift, and '
            f'{_WORSE:.0%} are allowed. It is not used.'
        )


def judge(champion: FloatArray, challenger: FloatArray) -> Judgement:
    """Judge a challenger by what both leave of days, (n, 6), newest first, in usual drifts."""
    logs = np.nanmean(np.log((challenger + _FLOOR) / (champion + _FLOOR)), axis=1)
    # Rooms and robots change: where that shows on the newest days, older ones neither decide nor
    # object.
    newest, more = logs[:_NEWEST], np.nanmean(challenger - champion, axis=1)
    deciding = min(logs, newest, key=_upper_bound)
    proof, changed = _upper_bound(deciding), _upper_bound(newest) < -_CHANGED
    worse = float(more[: _NEWEST if changed else len(more)].max())
    ratios = float(np.exp(deciding.mean())), float(np.exp(proof))
    return Judgement(proof < -_MARGIN and worse < _WORSE, len(deciding), *ratios, worse)


def _upper_bound(logs: FloatArray) -> float:
    """Bound the mean of logarithms, one a day, from above by _SURE standard errors."""
    spread = _SPREAD_DAYS * _SPREAD**2 + np.sum((logs - logs.mean()) ** 2)
    error = np.sqrt(spread / (_SPREAD_DAYS + len(logs) - 1) / len(logs))
    return float(logs.mean() + _SURE * error)
