"""
What the benches of accuracy share: seeds, errors of a judged day, and intervals.

It is imported before numpy, which then uses one thread: several would wait for one another.
"""

import argparse
from collections.abc import Callable
import os
from pathlib import Path
import subprocess

for _name in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS'):
    os.environ.setdefault(_name, '1')

import numpy as np

from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import FloatArray, IntArray, NANOSECONDS

ROOT = Path(__file__).resolve().parents[2]
#: The folders that decide how drift is learnt: their last commit draws the worlds.
LEARNING = ('fit', 'payload')
#: First seed of the worlds on which the package is developed.
DEVELOPMENT_SEED = 1000
#: Errors are judged as means over this time, because noise is no drift, s.
BLOCK_S = 10.0
#: A judged day is tared in this time, s.
TARE_S = 60.0
#: How often worlds are drawn again for an interval.
DRAWS = 1000
#: Statistics over axes, NaN left out.
STATISTICS: dict[str, Callable[[FloatArray], float]] = {
    'median': lambda shares: float(np.nanmedian(shares)),
    'mean': lambda shares: float(np.nanmean(shares)),
    '95 %': lambda shares: float(np.nanquantile(shares, 0.95)),
    'worst': lambda shares: float(np.nanmax(shares)),
}


def bench_parser(description: str | None, what: str, count: int) -> argparse.ArgumentParser:
    """Make a parser with the options that every bench has that draws: ``--dev`` and a number."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('--dev', action='store_true', help=f'{what} to develop on')
    parser.add_argument(f'--{what}', type=int, default=count)
    return parser


def first_seed(options: argparse.Namespace, *more: str) -> int:
    """
    Find the first seed to draw with, by the options of a ``bench_parser``.

    That is the development seed, or one of the last commit that touched how drift is learnt;
    ``more`` are further folders of the package that decide it.
    """
    if options.dev:
        return DEVELOPMENT_SEED
    paths = [f'wrist_ft_comp/{room}' for room in (*LEARNING, *more)]
    command = ['git', 'log', '-1', '--format=%H', '--', *paths]
    commit = subprocess.run(command, cwd=ROOT, capture_output=True, check=True, text=True).stdout
    changed = ['git', 'status', '--porcelain', '--', *paths]
    if subprocess.run(changed, cwd=ROOT, capture_output=True, check=True).stdout:
        print('NOT A REPORT: how drift is learnt has changes that are not committed')
    print(f'report seeds from commit {commit[:12]}')
    return int(commit[:8], 16)


def recording_of(
    temperature_c: FloatArray, wrench: FloatArray, reference: FloatArray | None = None
) -> Recording:
    """Make a recording with cells of 1 s; without a reference nobody knows the true load."""
    measured = np.ones(temperature_c.shape, dtype=bool)
    true = np.full_like(wrench, np.nan) if reference is None else reference
    return Recording('day', NANOSECONDS, 0, temperature_c, measured, wrench, true)


def block_means(values: FloatArray, cells: int) -> FloatArray:
    """Average blocks of rows; an incomplete block at the end is left out."""
    whole = values[: len(values) // cells * cells]
    return np.asarray(whole.reshape(-1, cells, values.shape[1]).mean(axis=1))


def tared(error: FloatArray, period_s: float) -> FloatArray:
    """Zero every column on its first minute; its NaN count for nothing."""
    first = error[: max(1, round(TARE_S / period_s))]
    finite = np.isfinite(first)
    mean = np.where(finite, first, 0.0).sum(axis=0) / np.maximum(finite.sum(axis=0), 1)
    return np.asarray(error - mean)


def root_mean_square(values: FloatArray) -> FloatArray:
    """Root of the mean square of every column without its NaN; NaN where nothing is left."""
    finite = np.isfinite(values)
    squares = np.where(finite, values, 0.0) ** 2
    with np.errstate(invalid='ignore'):
        return np.asarray(np.sqrt(squares.sum(axis=0) / finite.sum(axis=0)))


def tared_rms(error: FloatArray, cell_s: float = 1.0) -> FloatArray:
    """RMS of the errors of a day, shape (N, C), as means over BLOCK_S that are tared, (C,)."""
    return root_mean_square(tared(block_means(error, round(BLOCK_S / cell_s)), BLOCK_S))


def with_interval(key: str, *shares: FloatArray) -> str:
    """Write one of STATISTICS, or its ratio between two methods, with its 95 % interval."""

    def of_worlds(rows: IntArray) -> float:
        values = [STATISTICS[key](share[rows]) for share in shares]
        return values[0] / values[1] if len(values) > 1 else values[0]

    rng, worlds, digits = np.random.default_rng(0), len(shares[0]), 4 - len(shares)
    # Worlds are drawn again and again.
    drawn = [of_worlds(rng.integers(worlds, size=worlds)) for _ in range(DRAWS)]
    low, high = np.quantile(drawn, (0.025, 0.975))
    return f'{of_worlds(np.arange(worlds)):.{digits}f} ({low:.{digits}f}–{high:.{digits}f})'
