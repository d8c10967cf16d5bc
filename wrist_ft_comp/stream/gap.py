"""
Gaps in the temperatures: one rule for the running stream, for a restarted one and for files.

- A thermometer that was not heard for some cells went along a straight line, from the last cell
  that it measured to the next one. Until that comes, its last value is held.
- When no thermometer was heard for longer than a model remembers, the sensor has soaked at the
  temperatures after the gap.
- When a thermometer comes back that was silent for longer than that, while others were heard, the
  model starts at rest as many cells before as it remembers.

What a file gives differs from the stream in one thing: within a gap it knows the end of the line.
"""

from itertools import pairwise

import numpy as np

from wrist_ft_comp.drift.drift_model import Drift, DriftModel, run_from_rest
from wrist_ft_comp.signals import BoolArray, FloatArray, IntArray, NANOSECONDS

#: After this many time constants a twentieth of what was remembered is left.
TIME_CONSTANTS = 3.0
#: A gap is allowed this long, s, however short a model's memory is.
LEAST_GAP_S = 60.0
#: The stream keeps no more cells than these hours hold either.
MOST_GAP_S = 6 * 3600.0
#: A clock that lost more than this against another one was not running all the time, s.
_SLIP_S = 60.0


def slowest_time_constant_s(model: DriftModel) -> float:
    """Find the time, s, after which a model has forgotten all but 1/e: τ = -h / ln |pole|."""
    radii = np.concatenate([[0.0], *(np.abs(axis.poles) for axis in model.axes.values())])
    period_s = model.period_ns / NANOSECONDS
    return float(-period_s / np.log(radii.max())) if radii.max() > 0 else 0.0


def longest_gap_s(model: DriftModel) -> float:
    """Choose the longest gap, s, after which a model's memory is worth something."""
    remembered_s = min(TIME_CONSTANTS * slowest_time_constant_s(model), MOST_GAP_S)
    return max(remembered_s, LEAST_GAP_S, model.start_s)


def longest_gap_cells(model: DriftModel) -> int:
    """Give ``longest_gap_s`` in whole cells."""
    return int(longest_gap_s(model) * NANOSECONDS / model.period_ns)


def straight_lines(
    measured_cells: IntArray, measured_c: FloatArray, first_cell: int, count: int
) -> FloatArray:
    """
    Find the temperatures of a thermometer in all cells.

    Parameters
    ----------
    measured_cells, measured_c : ndarray, shape (n,)
        Cells that it measured, ascending, and what it measured there, °C.
    first_cell, count : int
        Which cells are wanted.

    Returns
    -------
    ndarray, shape (count,)
        °C; behind the last measured cell its value is held.

    """
    cells = first_cell + np.arange(count)
    return np.asarray(np.interp(cells, measured_cells, measured_c))


def starts(measured: BoolArray, longest: int) -> list[tuple[int, int]]:
    """
    Find where the memory of what was before is of no use.

    Parameters
    ----------
    measured : ndarray, shape (N, J)
        Which thermometers measured in which cells.
    longest : int
        The longest gap over which a model's memory holds, cells.

    Returns
    -------
    list of (int, int)
        From which cell on to run the model from rest, and from which cell on what it then says
        counts; in order, beginning with (0, 0).

    """
    heard: BoolArray = np.logical_or.reduce(measured, axis=1)
    soaked = np.unique(np.append(0, _ends_of_gaps(heard, longest)))
    ends = [_ends_of_gaps(measured[:, j], longest) for j in range(measured.shape[1])]
    cells = np.unique(np.concatenate((soaked, *ends)))
    last_soaked = soaked[np.searchsorted(soaked, cells, side='right') - 1]
    first = np.maximum(cells - longest, last_soaked)
    return list(zip(first.tolist(), cells.tolist(), strict=True))


def _ends_of_gaps(measured: BoolArray, longest: int) -> IntArray:
    """List the measured cells, of N, that follow a gap of more cells than the longest."""
    at = np.concatenate(([-1], np.flatnonzero(measured)))
    return np.asarray(at[1:][np.diff(at) > longest + 1])


def simulate(model: DriftModel, temperature_c: FloatArray, measured: BoolArray) -> Drift:
    """Run a model freely over N cells on straight lines, (N, J), and over gaps: drift (N, 6)."""
    at = starts(measured, longest_gap_cells(model))
    parts = []
    for (first, cell), (_, end) in pairwise([*at, (0, len(measured))]):
        drift = run_from_rest(model, temperature_c[first:end])[1]
        parts.append(Drift(*(part[cell - first :] for part in drift)))
    return Drift(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def doubt(gap_s: float, longest_s: float, at_least_s: float = 0.0) -> str:
    """
    Judge a gap between a thermal state and the first temperature after it.

    Parameters
    ----------
    gap_s : float
        How long it is by the stamps, s; negative when they ran back.
    longest_s : float
        The longest gap over which the state holds, s.
    at_least_s : float
        How long it was by another clock, s; 0 without one.

    Returns
    -------
    str
        The first half of a sentence that says why the state is of no use; empty when it is.

    """
    if gap_s < -_SLIP_S:
        return (
            f'the thermal state is {-gap_s:.0f} s ahead of the temperatures: their stamps are of '
            'another clock, or time ran back'
        )
    if gap_s < at_least_s - _SLIP_S:
        return (
            f'the stamps of the temperatures moved on by {gap_s:.0f} s while {at_least_s:.0f} s '
            'passed since the thermal state was saved: their clock was set'
        )
    if gap_s > longest_s:
        return f'the thermal state is {gap_s:.0f} s old and this model remembers {longest_s:.0f} s'
    return ''
