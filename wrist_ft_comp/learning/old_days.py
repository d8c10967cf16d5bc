"""Which days are kept and learnt from, where there are too many; the others are deleted."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from wrist_ft_comp.learning.day_files import days, size_of
from wrist_ft_comp.learning.diary import DayEntry, Diary, good_days
from wrist_ft_comp.stored.documents import writing

#: Most days whose recordings are kept: a month, in which a room's temperatures come round.
_KEPT_DAYS = 30
#: Room for the diary itself, and for the rows between two measurements of the folder, MB.
_SPARE_MB = 10.0


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


def prune(directory: Path, diary: Diary, max_mb: float) -> list[str]:
    """
    Remove recordings of judged days until both limits hold; give the names of the others.

    RecordingError when one cannot be removed.
    """
    paths = {path.name: path for path in days(directory)}
    kept = [entry for entry in diary.days if entry.name in paths]
    room = 1e6 * (max_mb - _SPARE_MB)
    while kept and (
        len(kept) > _KEPT_DAYS or sum(size_of(paths[entry.name]) for entry in kept) > room
    ):
        before, kept = kept, worthiest(kept, len(kept) - 1) if len(kept) > 1 else []
        (name,) = {entry.name for entry in before} - {entry.name for entry in kept}
        with writing(paths[name]):
            paths.pop(name).unlink(missing_ok=True)
    return list(paths)
