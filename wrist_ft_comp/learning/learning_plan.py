"""
Which days are learnt from: those without an incident, the worthiest; and those deleted.

What changes the sensor (``incidents``) stops learning until three more days have had no
incident, or a person decides. No day is forgotten.
"""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from wrist_ft_comp.learning.day_files import days, size_of
from wrist_ft_comp.learning.diary import DayEntry, Diary, LEARNT_FROM, NONE, PAUSING
from wrist_ft_comp.learning.incidents import DAYS_TO_AGREE
from wrist_ft_comp.stored.safe_file import writing

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


def good_days(entries: Sequence[DayEntry]) -> list[DayEntry]:
    """Choose days without an incident that have as many thermometers as the newest."""
    good = [entry for entry in entries if entry.kind in LEARNT_FROM]
    return [day for day in good if len(day.temperature_c) == len(good[-1].temperature_c)]


def worthiest(entries: Sequence[DayEntry], most: int) -> list[DayEntry]:
    """Choose at most ``most`` days, in order: the newer half, and those with rare temperatures."""
    chosen, newer = list(entries), max(most // 2, 1)
    while len(chosen) > max(most, 1):
        good = good_days(chosen)
        count = Counter(cell for day in good for cell in day.known)
        worth = [
            sum(1 / count[cell] for cell in day.known) if day in good else -1.0
            for day in chosen[:-newer]
        ]
        del chosen[int(np.argmin(worth))]
    return chosen


def prune(directory: Path, diary: Diary, max_mb: float) -> None:
    """Remove the least worthy recordings until the rest fits; RecordingError where one stays."""
    paths = {path.name: path for path in days(directory)}
    kept = [entry for entry in diary.days if entry.name in paths]
    while kept and sum(size_of(paths[entry.name]) for entry in kept) > 1e6 * max_mb:
        before, kept = kept, worthiest(kept, len(kept) - 1) if len(kept) > 1 else []
        (name,) = {entry.name for entry in before} - {entry.name for entry in kept}
        with writing(paths[name]):
            paths[name].unlink(missing_ok=True)


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


def pause(entries: Sequence[DayEntry], since: str) -> str:
    """Say why learning has stopped on its own; empty when it has not."""
    why, agreeing = '', 0
    for entry in entries:
        if entry.kind in PAUSING and entry.name > since:
            why, agreeing = f'{entry.name}: {entry.incident}', 0
        elif entry.kind in LEARNT_FROM:
            agreeing += 1
    if not why or agreeing >= DAYS_TO_AGREE:
        return ''
    return (
        f'{why} Learning goes on after {DAYS_TO_AGREE} days without an incident ({agreeing} so '
        'far). To end this pause, call ~/calibrate or ~/adopt; their model is kept for as long.'
    )
