"""Runs of the stream benchmark: summing them up, as rows and as a picture."""

from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import matplotlib as mpl

mpl.use('Agg')
import matplotlib.pyplot as plt


@dataclass(frozen=True)
class Run:
    """
    One run.

    Attributes
    ----------
    cpu_us : float
        Processor time of the node per wrench, µs.
    p50_us, p99_us, max_us : float
        Latency from the sensor's stamp to the receiver, µs; of several sensors the worst p99.
    sent, lost : int
        Wrenches that the sensor sent, and those of them that the receiver did not hear.
    lost_before, lost_inside : int or None
        Of these, lost between sensor and node, and in the node; None where nobody counts.
    publisher_late_ms : float
        How far the sensor was behind its own clock at worst, ms.
    calibrated : int
        Calibrations that have ended so far.

    """

    cpu_us: float
    p50_us: float
    p99_us: float
    max_us: float
    sent: int
    lost: int
    lost_before: int | None
    lost_inside: int | None
    publisher_late_ms: float
    calibrated: int


def summary(name: str, rate_hz: float, runs: list[Run]) -> dict[str, Any]:
    """Sum up the runs of one row."""
    counted = [run for run in runs if run.lost_inside is not None]
    return {
        'name': name,
        'rate_hz': rate_hz,
        **{
            key: median(getattr(run, key) for run in runs)
            for key in ('cpu_us', 'p50_us', 'p99_us')
        },
        'max_us': max(run.max_us for run in runs),
        'publisher_late_ms': max(run.publisher_late_ms for run in runs),
        'sent': sum(run.sent for run in runs),
        'lost': sum(run.lost for run in runs),
        'lost_before': sum(run.lost_before or 0 for run in counted) if counted else None,
        'lost_inside': sum(run.lost_inside or 0 for run in counted) if counted else None,
        'cpu_us_of_each_run': [round(run.cpu_us, 1) for run in runs],
    }


def print_header() -> None:
    """Print the names of the columns."""
    print(
        'rate, Hz  through      CPU, µs  p50, µs  p99, µs  max, µs    sent  '
        'lost: before node  in node  behind node  publisher late, ms'
    )


def print_row(row: dict[str, Any]) -> None:
    """Print one row."""
    if row['lost_inside'] is None:
        losses = f'{"":11}{row["lost"]:6} between both ends    '
    else:
        behind = row['lost'] - row['lost_before'] - row['lost_inside']
        losses = f'{row["lost_before"]:17}  {row["lost_inside"]:7}  {behind:11}'
    print(
        f'{row["rate_hz"]:8.0f}  {row["name"]:11}  {row["cpu_us"]:7.1f}  {row["p50_us"]:7.0f}  '
        f'{row["p99_us"]:7.0f}  {row["max_us"]:7.0f}  {row["sent"]:6}  {losses}  '
        f'{row["publisher_late_ms"]:18.1f}',
        flush=True,
    )


def draw(figures: dict[str, Any], path: Path) -> None:
    """Draw processor time and latency against the rate."""
    plot: Any = plt
    picture, (left, right) = plot.subplots(1, 2, figsize=(9, 3.6), layout='constrained')
    for name in dict.fromkeys(row['name'] for row in figures['rates']):
        rows = [row for row in figures['rates'] if row['name'] == name]
        rates = [row['rate_hz'] for row in rows]
        left.plot(rates, [row['cpu_us'] for row in rows], 'o-', label=name)
        right.plot(rates, [row['p99_us'] for row in rows], 'o-', label=f'{name}, p99')
    for axes, title in ((left, 'processor time per wrench, µs'), (right, 'latency, µs')):
        axes.set(xscale='log', xlabel='wrenches per second', ylabel=title)
        axes.set_ylim(bottom=0)
        axes.grid(alpha=0.3)
        axes.legend()
    picture.savefig(path, dpi=120)
