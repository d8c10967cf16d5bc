"""Which days are learnt from, and which of their recordings are deleted for want of room."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from wrist_ft_comp.learning.day_files import days, size_of
from wrist_ft_comp.learning.diary import DayEntry, Diary, LEARNT_FROM
from wrist_ft_comp.stored.safe_file import writing


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
