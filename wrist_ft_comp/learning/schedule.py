"""When a node that learns by itself learns a new model: often at first, then ever more rarely."""

from collections.abc import Sequence

import numpy as np

from wrist_ft_comp.learning.diary import Cell, DayEntry, DAYS_TO_AGREE, LEARNT_FROM

#: Fewest days that a model is learnt from.
FEWEST_DAYS = 2
#: Most days that a model is learnt from. They bound the cost, and all seasons fit into them.
MOST_DAYS = 12
#: A model is learnt when the number of good days has grown by this share: on the 2nd, 3rd, 4th,
#: 6th, 8th, 11th, 15th, 20th … good day.
_GROWTH = 1 / 3
#: One is learnt after a day on which the live model left more than this many times what it leaves
#: on the median day ...
_BAD_RATIO = 2.0
#: ... and more than this share of the drift, ...
_BAD_SHARE = 0.1
#: ... and after a day with more than this share of coarse temperatures that are new.
_NEW_TEMPERATURES_SHARE = 0.25
#: Learning may take this much processor time a day in the mean of all days, s. A model of twelve
#: days of 2.5 h takes about 10 s. Days that were only judged do not count.
_BUDGET_S_PER_DAY = 45.0
ANOTHER_DAY = 'Another good day is needed to learn from.'


def reason(entries: Sequence[DayEntry], live: str, chosen: str = '') -> tuple[bool, str]:
    """
    Decide whether a model is learnt after the newest day, and say why, or why not.

    ``live`` is the key of the live model, ``chosen`` the newest day before a person chose it;
    empty where none is live, and where the node did.
    """
    good = [day for day in entries if day.kind in LEARNT_FROM]
    spent_s = sum(day.seconds for day in entries if day.challenged)
    if len(good) < FEWEST_DAYS:
        return False, ANOTHER_DAY
    new = sum(day.name > chosen for day in good)
    if chosen and new < DAYS_TO_AGREE:
        return False, (
            f'A person chose the live model; {new} of {DAYS_TO_AGREE} good days have come since.'
        )
    if spent_s > _BUDGET_S_PER_DAY * len(entries):
        return False, (
            f'No new model was learnt: learning took {spent_s / len(entries):.0f} s of processor '
            f'time a day, and {_BUDGET_S_PER_DAY:.0f} s are allowed.'
        )
    last = max((n for n, day in enumerate(good) if day.challenged), default=0)
    grown, awaited = len(good) - 1 - last, _GROWTH * (last + 1)
    if not live:
        cause = 'no model is live'
    elif grown >= awaited:
        cause = f'{grown} more good {"day" if grown == 1 else "days"}'
    else:
        cause = _surprise(good, last + 1)
    if cause:
        return True, cause
    return False, (
        f'No new model was learnt: {grown} of {np.ceil(awaited):.0f} more good days have come, '
        'and no day with other temperatures or a bad result of the live model.'
    )


def _surprise(good: Sequence[DayEntry], first: int) -> str:
    """Name a good day, from the ``first`` one on, that no model before expected; '' for none."""
    seen: frozenset[Cell] = frozenset().union(*(day.known for day in good[:first]))
    judged = [day for day in good if day.live in day.left]
    shares = {day.name: float(np.nanmean(day.share_left(day.live))) for day in judged}
    bad_share = max(_BAD_RATIO * float(np.median(list(shares.values()) or [1.0])), _BAD_SHARE)
    for day in good[first:]:
        if len(day.known - seen) > _NEW_TEMPERATURES_SHARE * len(day.known):
            return f'{day.name} had other temperatures'
        if shares.get(day.name, 0.0) > bad_share:
            return f'the live model did badly on {day.name}'
    return ''
