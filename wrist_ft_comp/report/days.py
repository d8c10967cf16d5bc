"""What a diary says of its days: the drift of each, what models left of it, what was seen."""

from collections.abc import Iterable, Sequence
from datetime import datetime, timezone
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.calibration.learning.entry import CHALLENGER, DayEntry, Diary, NONE
from wrist_ft_comp.model.signals import NANOSECONDS


class DayFigures(NamedTuple):
    """One day; drifts are RMS of a force, N, tared in the first minute, NaN where unknown."""

    name: str
    #: By its stamps, UTC.
    date: str
    hours: float
    #: Lowest and highest temperature of the first thermometer, °C.
    temperature_c: tuple[float, float]
    #: Without a model, with the live one, with the challenger.
    raw_n: float
    live_n: float
    challenger_n: float
    #: What happened to the sensor, or else why there is a new model or none.
    note: str


def figures(entry: DayEntry) -> DayFigures:
    """Take what people compare from an entry."""
    unknown = (float('nan'), float('nan'))
    models = (NONE, entry.live, CHALLENGER)
    raw_n, live_n, challenger_n = (_force_rms(entry.left.get(each)) for each in models)
    return DayFigures(
        entry.name,
        date_of(entry.first_ns),
        entry.hours,
        entry.temperature_c[0] if entry.temperature_c else unknown,
        raw_n,
        live_n,
        challenger_n,
        entry.incident or entry.verdict,
    )


def _force_rms(left: Sequence[float] | None) -> float:
    """Average over the forces of an entry in the order AXES."""
    known = [value for value in (left or ())[:3] if not np.isnan(value)]
    return float(np.sqrt(np.mean(np.square(known)))) if known else float('nan')


def date_of(stamp_ns: int) -> str:
    """Write the day of a stamp, ns, UTC; one that no calendar has is as it is."""
    try:
        return str(datetime.fromtimestamp(stamp_ns // NANOSECONDS, timezone.utc).date())
    except (OverflowError, ValueError):
        return str(stamp_ns)


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
