"""
Champion against challenger: when one is learnt, from which days, and whether it is better.

A challenger is learnt from good days but the newest. Days are the unit of evidence: the errors of
a day are one error. On days since the champion was learnt its error is compared with the
challenger's: directly where the challenger was not learnt from that day, else on the day held out.
The logarithm of what the challenger leaves by what the champion leaves is averaged over axes. Its
mean over all these days, or over the newest six, has to be below zero by two standard errors and a
margin, where the spread between days is not believed to be smaller than two days of a usual spread
say: a single day has to be three times as good, ten days by a quarter. No day may be much worse,
but for those before the newest six where the champion leaves twice as much on these.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.fit.result import Calibration, rms_by_fold
from wrist_ft_comp.learning.day import share
from wrist_ft_comp.learning.entry import Cell, CHALLENGER, DayEntry, NONE
from wrist_ft_comp.learning.incidents import FORGETTING, LEARNT_FROM
from wrist_ft_comp.signals import AXES, FloatArray

#: Most days that a model is learnt from: what they cost is bounded, and seasons fit in.
MOST_DAYS = 12
#: A challenge comes when the good days have grown by this share, and at least after so many.
_GROWN, _AT_LATEST = 1 / 3, 20
#: … or when the champion left so many times what it usually leaves, and at least this share.
_BADLY, _MUCH = 2.0, 0.1
#: Processor time, s, that days with a challenger may take together …
_SPENT_S = 1400.0
#: … among the last days. A day that is only judged takes what its cells take on this computer, and
#: counts for nothing here: on a slow one there would never be a model.
_SPENT_DAYS = 30
#: Usual spread of a day's logarithm, what it counts for, days, and standard errors of a proof.
_SPREAD, _COUNTS, _SURE = 0.5, 2.0, 2.0
#: So many of the newest days are judged by themselves, too; where the champion leaves twice as
#: much there, as a logarithm, something has changed.
_NEWEST, _CHANGED = 6, 0.7
#: What is better by less, as a logarithm, is not worth a change; nor one that leaves more on any
#: day, by this share of a usual day's drift.
_MARGIN, _WORSE = 0.1, 0.15
#: Drift that is left below this share is no difference.
_FLOOR = 0.01
ANOTHER_DAY = 'Another good day is needed to learn from.'


def good_days(entries: Sequence[DayEntry]) -> list[DayEntry]:
    """Choose days that may be learnt from: of the last one's sensor, and without an incident."""
    start = max((n for n, each in enumerate(entries) if each.kind in FORGETTING), default=-1)
    good = [each for each in entries[start + 1 :] if each.kind in LEARNT_FROM]
    return [each for each in good if len(each.temperature_c) == len(good[-1].temperature_c)]


def reason(entries: Sequence[DayEntry], champion: str) -> tuple[bool, str]:
    """Tell whether a challenger is learnt on the newest day, and why, or why not."""
    good = [each for each in entries if each.kind in LEARNT_FROM]
    spent_s = sum(each.seconds for each in entries[-_SPENT_DAYS:] if each.challenged)
    if len(good) < 2 or spent_s > _SPENT_S:
        return False, ANOTHER_DAY if len(good) < 2 else (
            f'No new model was tried: in the last {_SPENT_DAYS} days that took '
            f'{spent_s / 60:.0f} minutes of processor time, and {_SPENT_S / 60:.0f} are allowed.'
        )
    last = max((n for n, each in enumerate(good) if each.challenged), default=0)
    grown, awaited = len(good) - 1 - last, min(_AT_LATEST, _GROWN * (last + 1))
    if not champion:
        return True, 'no model is live'
    if grown >= awaited:
        return True, f'{grown} more good {"day" if grown == 1 else "days"}'
    older = good[: last + 1]
    known: frozenset[Cell] = frozenset().union(*(each.known for each in older))
    lefts = [float(np.nanmean(share(each, champion))) for each in good if champion in each.left]
    badly = max(_BADLY * float(np.median(lefts or [1.0])), _MUCH)
    # The newest one is not learnt from, so that a day like it has to be there.
    for each in good[last + 1 : -1]:
        if len(each.known - known) > len(each.known) / 4:
            return True, f'{each.name} knew other temperatures'
        if champion in each.left and np.nanmean(share(each, champion)) > badly:
            return True, f'the live model did badly on {each.name}'
    return False, (
        f'No new model was tried: {grown} of {np.ceil(awaited):.0f} more good days have come, and '
        'no day with other temperatures or a bad result of the live model.'
    )


def worthiest(days: Sequence[DayEntry], most: int) -> list[DayEntry]:
    """Choose so many days in their order: the newer half, and those that know like no other."""
    chosen, newer = list(days), max(most // 2, 1)
    while len(chosen) > max(most, 1):
        good = good_days(chosen)
        count = Counter(cell for each in good for cell in each.known)
        worth = [
            sum(1 / count[cell] for cell in each.known) if each in good else -1.0
            for each in chosen[:-newer]
        ]
        del chosen[int(np.argmin(worth))]
    return chosen


def evidence(
    unseen: Sequence[DayEntry], before: Mapping[str, DayEntry], calibration: Calibration,
    days: Sequence[str], champion: str,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """
    Collect what both leave of days that none was learnt from, and of held-out ones: (n, 6) each.

    Newest first, in units of what these days drift usually: those that hardly drift prove little.
    """
    told = [(each, share(each, CHALLENGER)) for each in unseen]
    held_out = np.full((len(days), len(AXES)), np.nan)
    for axis, fit in calibration.fits.items():
        if fit.held_out is not None and len(days) > 1:  # of a single day, parts were held out
            errors, rows = rms_by_fold(fit.held_out), np.unique(fit.held_out.recording)
            held_out[rows, AXES.index(axis)] = errors.after / np.maximum(errors.before, 1e-12)
    pairs = zip(days, held_out, strict=True)
    told += [(before[name], ours) for name, ours in pairs if name in before]
    told.sort(key=lambda each: each[0].name, reverse=True)
    both = [(each.left[NONE], share(each, champion), ours) for each, ours in told]
    both = [each for each in both if np.isfinite(each[1] + each[2]).any()]
    if not both:
        raise CalibrationRefusedError(
            'The live model cannot be judged on these days; it is for other thermometers, or '
            'another thermal_period. Call ~/calibrate.'
        )
    drift, theirs, ours = (np.array(each) for each in zip(*both, strict=True))
    usual = drift / np.maximum(np.mean(drift, axis=0), 1e-12)
    return theirs * usual, ours * usual


class Judgement(NamedTuple):
    """Whether a challenger is better than the champion, and by which figures."""

    better: bool
    #: Days that it was judged on.
    days: int
    #: What the challenger leaves by what the champion leaves: the geometric mean, and the most
    #: that it may be but for chance (two standard errors).
    ratio: float
    highest_ratio: float
    #: By how much more it leaves on its worst day, as a share of a usual day's drift.
    worse: float

    def words(self, champion: str) -> str:
        """Say what came out beside a champion of that name, and which figure decided."""
        days = f'{self.days} {"day" if self.days == 1 else "days"}'
        said = (
            f'On {days} that neither was learnt from, it leaves {self.ratio:.2f} times as much as '
            f'{champion}, with 95 % certainty at most {self.highest_ratio:.2f} times'
        )
        if self.better:
            return f'{said}. It is better.'
        if self.worse < _WORSE:
            return f'{said}, and {np.exp(-_MARGIN):.2f} is asked for. It is not used.'
        return (
            f'{said}, but on one day more by {self.worse:.0%} of a usual drift, and '
            f'{_WORSE:.0%} are allowed. It is not used.'
        )


def judge(champion: FloatArray, challenger: FloatArray) -> Judgement:
    """Judge a challenger by what both leave of days, (n, 6), newest first, in usual drifts."""
    logs = np.nanmean(np.log((challenger + _FLOOR) / (champion + _FLOOR)), axis=1)
    # Rooms and robots change: where that shows on the newest days, older ones do not matter, nor
    # is a day an objection that was before.
    newest, more = logs[:_NEWEST], np.nanmean(challenger - champion, axis=1)
    deciding = min(logs, newest, key=_at_most)
    proof, changed = _at_most(deciding), _at_most(newest) < -_CHANGED
    worse = float(more[: _NEWEST if changed else len(more)].max())
    ratios = float(np.exp(deciding.mean())), float(np.exp(proof))
    return Judgement(proof < -_MARGIN and worse < _WORSE, len(deciding), *ratios, worse)


def _at_most(logs: FloatArray) -> float:
    """Bound the mean of logarithms, one a day, from above by what chance may do."""
    spread = _COUNTS * _SPREAD**2 + np.sum((logs - logs.mean()) ** 2)
    error = np.sqrt(spread / (_COUNTS + len(logs) - 1) / len(logs))
    return float(logs.mean() + _SURE * error)
