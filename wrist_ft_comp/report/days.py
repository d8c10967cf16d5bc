"""What a diary says of its days: their dates, the temperatures they saw, and a picture."""

from collections.abc import Iterable
from datetime import datetime, timezone

import numpy as np

from wrist_ft_comp.learning.diary import DayEntry, Diary, forces_left
from wrist_ft_comp.signals import NANOSECONDS

#: Most dates that are written below the picture.
_MOST_DATES = 12


def date_of(entry: DayEntry) -> str:
    """Write the date that a day began on by its stamps, UTC; '-' where no calendar has it."""
    if not entry.first_ns:
        return '-'  # its recording could not be read
    try:
        return str(datetime.fromtimestamp(entry.first_ns // NANOSECONDS, timezone.utc).date())
    except (OverflowError, ValueError):
        return '-'


def known_temperatures(diary: Diary) -> list[list[tuple[float, float]]]:
    """Merge what the days saw, °C: by thermometer, intervals that do not touch."""
    count = max((len(day.temperature_c) for day in diary.days), default=0)
    return [
        _merged(day.temperature_c[j] for day in diary.days if len(day.temperature_c) > j)
        for j in range(count)
    ]


def _merged(intervals: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """Merge intervals that touch or overlap."""
    merged: list[tuple[float, float]] = []
    for low, high in sorted(intervals):
        if merged and low <= merged[-1][1]:
            merged[-1] = merged[-1][0], max(high, merged[-1][1])
        else:
            merged.append((low, high))
    return merged


def days_png(diary: Diary) -> bytes:
    """Draw the drift left per day; lines are changes of the live model, crosses incidents."""
    from matplotlib.figure import Figure  # noqa: PLC0415 -- most that ask for days draw none

    from wrist_ft_comp.report import pictures  # noqa: PLC0415

    figure = Figure(figsize=(10.0, 4.0), layout='constrained')
    panel = figure.add_subplot()
    left = np.array([forces_left(day) for day in diary.days])
    styles = (
        (pictures.WITHOUT, '--', 'x', 'no model'),
        (pictures.WITH, '-', 'o', 'live model'),
        (pictures.THERMOMETERS[0], '', '^', 'challenger'),
    )
    for values, (colour, line, marker, label) in zip(left.T, styles, strict=True):
        panel.plot(values, color=colour, ls=line, marker=marker, ms=4, label=label)
    at = {day.name: number for number, day in enumerate(diary.days)}
    for decision in diary.decisions:
        if decision.day in at:
            panel.axvline(at[decision.day] + 0.5, color=pictures.FRAME, lw=0.8)
    hit = [at[day.name] for day in diary.days if day.incident]
    panel.plot(hit, left[hit, 0], ls='', marker='X', ms=10, color='black', label='incident')
    panel.set_yscale('log')
    dated = slice(None, None, max(len(at) // _MOST_DATES, 1))
    panel.set_xticks(range(len(at))[dated], [date_of(day) for day in diary.days[dated]])
    panel.tick_params(axis='x', rotation=30)
    panel.set_ylabel('drift of a force, N RMS')
    panel.grid(alpha=0.3)
    panel.legend(fontsize=8)
    return pictures.png_bytes(figure)
