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

import numpy as np

from wrist_ft_comp.calibration.learning.day import share
from wrist_ft_comp.calibration.learning.entry import Cell, CHALLENGER, DayEntry, NONE
from wrist_ft_comp.calibration.learning.incidents import FORGETTING, LEARNT_FROM
from wrist_ft_comp.calibration.result import Calibration, rms_by_fold
from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.model.signals import AXES, FloatArray

#: Most days that a model is learnt from: what they cost is bounded, and seasons fit in.
MOST_DAYS = 12
#: A challenge comes when the good days have grown by this share, and at least after so many.
_GROWN, _AT_LATEST = 1 / 3, 20
#: … or when the champion left so many times what it usually leaves, and at least this share.
_BADLY, _MUCH = 2.0, 0.1
#: Processor time that learning may take in the last days, s: less than a minute a day.
_SPENT_S, _SPENT_DAYS = 1400.0, 30
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


def good_days(entries: Sequence[DayEntry]) -> list[DayEntry]:
    """Choose days that may be learnt from: of the last one's sensor, and without an incident."""
    start = max((n for n, each in enumerate(entries) if each.kind in FORGETTING), default=-1)
    good = [each for each in entries[start + 1 :] if each.kind in LEARNT_FROM]
    return [each for each in good if len(each.temperature_c) == len(good[-1].temperature_c)]


def reason(entries: Sequence[DayEntry], champion: str) -> str:
    """Say why the newest day is one to learn a challenger; empty when there is no reason."""
    good = [each for each in entries if each.kind in LEARNT_FROM]
    if len(good) < 2 or sum(each.seconds for each in entries[-_SPENT_DAYS:]) > _SPENT_S:
        return ''
    last = max((n for n, each in enumerate(good) if each.challenged), default=0)
    grown = len(good) - 1 - last
    if not champion:
        return 'no model is live'
    if grown >= min(_AT_LATEST, _GROWN * (last + 1)):
        return f'{grown} more good days'
    older = good[: last + 1]
    known: frozenset[Cell] = frozenset().union(*(each.known for each in older))
    lefts = [float(np.nanmean(share(each, champion))) for each in good if champion in each.left]
    badly = max(_BADLY * float(np.median(lefts or [1.0])), _MUCH)
    # The newest one is not learnt from, so that a day like it has to be there.
    for each in good[last + 1 : -1]:
        if len(each.known - known) > len(each.known) / 4:
            return f'{each.name} knew other temperatures'
        if champion in each.left and np.nanmean(share(each, champion)) > badly:
            return f'the live model did badly on {each.name}'
    return ''


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


def judge(champion: FloatArray, challenger: FloatArray) -> tuple[bool, str]:
    """Tell whether a challenger is better, and how sure, by what is left of days (n, 6)."""
    logs = np.nanmean(np.log((challenger + _FLOOR) / (champion + _FLOOR)), axis=1)
    # Rooms and robots change: where that shows on the newest days, older ones do not matter, nor
    # is a day an objection that was before.
    newest, more = _at_most(logs[:_NEWEST]), np.nanmean(challenger - champion, axis=1)
    proof = min(_at_most(logs), newest)
    worse = more[: _NEWEST if newest < -_CHANGED else len(more)].max()
    before, after = (
        float(np.exp(np.nanmean(np.log(each + _FLOOR)))) for each in (champion, challenger)
    )
    return bool(proof < -_MARGIN and worse < _WORSE), (
        f'{after:.2f} of the drift, the live model {before:.2f}, on {len(logs)} '
        f'{"day" if len(logs) == 1 else "days"} that neither was learnt from; with what chance '
        f'may do, it leaves up to {np.exp(proof):.2f} times as much, and at worst {worse:+.2f} of '
        'the drift on a day'
    )


def _at_most(logs: FloatArray) -> float:
    """Bound the mean of logarithms, one a day, from above by what chance may do."""
    spread = _COUNTS * _SPREAD**2 + np.sum((logs - logs.mean()) ** 2)
    error = np.sqrt(spread / (_COUNTS + len(logs) - 1) / len(logs))
    return float(logs.mean() + _SURE * error)
