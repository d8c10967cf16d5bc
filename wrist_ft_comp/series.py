"""
Series of numbers: types, time in integers, noise, stretches, robust weights, numbers for people.

The robust weight of an observation is of Geman and McClure, the same wherever contacts or outliers
must not count: one whose error is e, in units of a width, weighs 1 / (1 + e²)² and costs
e² / (1 + e²), so that an outlier costs at most 1, however far out it is. The weight is the
derivative of the cost by e².
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
#: Reports progress: takes the share of the work that is done, 0 to 1.
Progress = Callable[[float], None]
NANOSECONDS = 1_000_000_000
#: Share of a sum, or of a sum of squares, that is rounding.
ROUNDING = 1e-12
#: Means of equal readings differ by less than this share, because sums are rounded.
_ROUNDING = 1e-9
#: Stamps from this one on are of a clock, ns; those of many logs begin at 0.
CLOCK_NS = 10**9 * NANOSECONDS
#: Samples further apart than this many times the usual distance belong to different stretches.
_GAP_FACTOR = 10.0


def differ(values: FloatArray, others: FloatArray | float) -> BoolArray:
    """Mark means of different readings, and what is not a number."""
    return np.asarray(~(np.abs(values - others) <= _ROUNDING * np.abs(others)))


def noise_level(series: Sequence[FloatArray]) -> float:
    """Estimate the noise of slow series, robust against steps, from neighbours; 0 of none."""
    steps = np.concatenate([np.diff(values[np.isfinite(values)]) for values in series])
    if not len(steps):
        return 0.0
    # A normal variable's median absolute value is 0.6745 σ; a difference has twice the variance.
    return float(np.median(np.abs(steps)) / 0.6745 / np.sqrt(2))


def stretches(present: BoolArray, period_s: float) -> IntArray:
    """Count the stretches of a channel from 0, shape (N,); a gap belongs to the one before it."""
    at = np.flatnonzero(present)
    numbers = np.zeros(len(present), dtype=np.int64)
    if len(at) > 2:
        distance = np.diff(at)
        limit = max(_GAP_FACTOR * float(np.median(distance)), 60.0 / period_s)
        numbers[at[1:][distance > limit]] = 1
    return np.cumsum(numbers)


def robust_weight(square: FloatArray) -> FloatArray:
    """Weigh observations by their squared errors in units of the width squared: 1 to 0."""
    return np.asarray(1 / (1 + square) ** 2)


def robust_cost(weight: FloatArray) -> FloatArray:
    """Tell the cost of observations by their weights: 0 to 1."""
    return np.asarray(1 - np.sqrt(weight))


def part_of(report: Progress, number: int, count: int) -> Progress:
    """Turn the progress of part ``number`` of ``count`` into the progress of the whole."""
    return lambda done: report((number + done) / count)


def rounded(value: float, count: int = 3) -> str:
    """Write a number with some significant figures, and never with an exponent."""
    return np.format_float_positional(value, count, unique=False, fractional=False, trim='-')
