"""What a diary says of its days: when they were, and which temperatures they saw."""

from collections.abc import Iterable
from datetime import datetime, timezone

from wrist_ft_comp.learning.entry import DayEntry, Diary
from wrist_ft_comp.signals import NANOSECONDS


def date_of(entry: DayEntry) -> str:
    """Write the date that a day began on by its stamps, UTC; what no calendar has is left out."""
    if not entry.first_ns:
        return '-'  # its recording could not be read
    try:
        return str(datetime.fromtimestamp(entry.first_ns // NANOSECONDS, timezone.utc).date())
    except (OverflowError, ValueError):
        return '-'


def known_temperatures(diary: Diary) -> list[list[tuple[float, float]]]:
    """Merge what the days saw, °C: by thermometer, intervals that do not touch."""
    count = max((len(entry.temperature_c) for entry in diary.days), default=0)
    return [
        _merged(each.temperature_c[j] for each in diary.days if len(each.temperature_c) > j)
        for j in range(count)
    ]


def _merged(intervals: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """Merge intervals."""
    merged: list[tuple[float, float]] = []
    for low, high in sorted(intervals):
        if merged and low <= merged[-1][1]:
            merged[-1] = merged[-1][0], max(high, merged[-1][1])
        else:
            merged.append((low, high))
    return merged
