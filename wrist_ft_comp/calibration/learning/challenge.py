"""
Champion against challenger: when one is learnt, from which days, and whether it is better.

A challenger is learnt from good days but the newest. Days are the unit of evidence: the errors of
a day are one error. On the newest day both are judged directly; on other days since the champion
was learnt, its own error of that day is compared with the challenger's on the same day held out.
The logarithm of what the challenger leaves by what the champion leaves is averaged over axes. Its
mean over days has to be below zero by two standard errors and a margin, where the spread between
days is not believed to be smaller than two days of a usual spread say: a single day has to be
three times as good, ten days by a quarter.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.calibration.learning.day import share
from wrist_ft_comp.calibration.learning.entry import Cell, CHALLENGER, DayEntry
from wrist_ft_comp.calibration.learning.incidents import FORGETTING, LEARNT_FROM
from wrist_ft_comp.calibration.result import Calibration, rms_by_fold
from wrist_ft_comp.model.signals import AXES, FloatArray

#: Most days that a model is learnt from: what they cost is bounded, and seasons fit in.
MOST_DAYS = 12
#: A challenge comes when the good days have grown by this share, and at least after so many.
_GROWN, _AT_LATEST = 1 / 3, 7
#: … or when the champion left so many times what it usually leaves, and at least this share.
_BADLY, _MUCH = 2.0, 0.1
#: Processor time that learning may take in the last days, s: less than a minute a day.
_SPENT_S, _SPENT_DAYS = 1500.0, 30
#: Usual spread of a day's logarithm, what it counts for, days, and standard errors of a proof.
_SPREAD, _COUNTS, _SURE = 0.5, 2.0, 2.0
#: What is better by less, as a logarithm, is not worth a change; nor one that leaves more on any
#: day, by this share of the drift.
_MARGIN, _WORSE = 0.1, 0.15
#: Drift that is left below this share is no difference.
_FLOOR = 0.01


class Evidence(NamedTuple):
    """Shares of the drift that champion and challenger left, by day, each (n, 6)."""

    champion: FloatArray
    challenger: FloatArray

    @property
    def better(self) -> bool:
        """Whether the challenger leaves less by more than chance."""
        return self.proof < -_MARGIN and bool(np.nanmax(self._worse) < _WORSE)

    @property
    def proof(self) -> float:
        """Logarithm that the ratio is not above of, as far as can be told."""
        logs, n = self._logs, len(self._logs)
        spread = (_COUNTS * _SPREAD**2 + np.sum((logs - logs.mean()) ** 2)) / (_COUNTS + n - 1)
        return float(logs.mean() + _SURE * np.sqrt(spread / n))

    @property
    def _logs(self) -> FloatArray:
        """Logarithm of every day, the mean of its axes."""
        ratio = (self.challenger + _FLOOR) / (self.champion + _FLOOR)
        return np.asarray(np.nanmean(np.log(ratio), axis=1))

    @property
    def _worse(self) -> FloatArray:
        """By how much more of the drift the challenger leaves, every day."""
        return np.asarray(np.nanmean(self.challenger - self.champion, axis=1))

    def sentence(self) -> str:
        """Say what was compared."""
        left, days = [np.exp(np.nanmean(np.log(each + _FLOOR))) for each in self], len(self._logs)
        return (
            f'{left[1]:.2f} of the drift, the live model {left[0]:.2f}, on {days} '
            f'{"day" if days == 1 else "days"} that neither was learnt from; with what chance may '
            f'do, it leaves up to {np.exp(self.proof):.2f} times as much'
        )


def good_days(entries: Sequence[DayEntry]) -> list[DayEntry]:
    """Choose the days that may be learnt from: of this sensor, and without an incident."""
    start = max((n for n, each in enumerate(entries) if each.kind in FORGETTING), default=-1)
    return [each for each in entries[start + 1 :] if each.kind in LEARNT_FROM]


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
    """Choose so many days, in their order: the newest, and those that know what no other does."""
    chosen = list(days)
    while len(chosen) > max(most, 1):
        count = Counter(cell for each in chosen if each.kind in LEARNT_FROM for cell in each.known)
        chosen.remove(min(chosen[:-1], key=lambda each: _worth(each, count)))
    return chosen


def _worth(entry: DayEntry, count: Mapping[Cell, int]) -> float:
    """Tell how much is known by a day alone, where others know it, too."""
    if entry.kind not in LEARNT_FROM:
        return -1.0
    return sum(1 / count[cell] for cell in entry.known)


def compare(
    newest: DayEntry, before: Mapping[str, DayEntry], calibration: Calibration,
    days: Sequence[str], champion: str,
) -> Evidence:  # fmt: skip
    """Collect evidence: the newest day, and days before since the champion, held out of others."""
    pairs = [(share(newest, champion), share(newest, CHALLENGER))]
    pairs += [
        (share(before[name], champion), theirs)
        for name, theirs in _held_out(calibration, days)
        if name in before
    ]
    told = [pair for pair in pairs if np.isfinite(pair[0] + pair[1]).any()]
    return Evidence(*(np.array([pair[n] for pair in told]) for n in range(2)))


def _held_out(calibration: Calibration, days: Sequence[str]) -> Iterator[tuple[str, FloatArray]]:
    """Give the share of the drift, (6,), that is left of each day by a fit to the others."""
    if len(days) < 2:
        return  # parts of a single day were held out, which is easier
    shares = np.full((len(days), len(AXES)), np.nan)
    for axis, fit in calibration.fits.items():
        if fit.held_out is not None:
            errors = rms_by_fold(fit.held_out)
            rows = np.unique(fit.held_out.recording)
            shares[rows, AXES.index(axis)] = errors.after / np.maximum(errors.before, 1e-12)
    yield from zip(days, shares, strict=True)
