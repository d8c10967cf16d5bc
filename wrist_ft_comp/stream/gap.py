"""
Gaps in the temperatures: one rule for the running stream, for a restarted one and for files.

- In cells without a sample of a thermometer, its temperature is on the straight line between the
  cells before and after. Until the cell after is there, the last value is held.
- After a gap of all thermometers that is longer than the model's memory, the sensor has soaked at
  the temperatures after the gap.
- After such a gap of one thermometer, while others reported, the model starts at rest. It starts
  before the end of the gap, by the length of its memory.

The stream differs from a file in one thing: within a gap it does not know the end of the line.
"""

from itertools import pairwise

import numpy as np

from wrist_ft_comp.drift.drift_model import Drift, DriftModel, rest_c, run_from_rest
from wrist_ft_comp.signals import BoolArray, FloatArray, IntArray, NANOSECONDS
from wrist_ft_comp.stream.agreement import Agreement, Offsets

#: A model's memory in slowest time constants: after three, 5 % of a change are left.
TIME_CONSTANTS = 3.0
#: Shortest memory that is assumed of a model, s.
LEAST_GAP_S = 60.0
#: Longest memory that is assumed, s; the stream keeps as many cells.
MOST_GAP_S = 6 * 3600.0
#: Two clocks disagree where their times since the save differ by more than this, s.
_SLIP_S = 60.0


def slowest_time_constant_s(model: DriftModel) -> float:
    """Find the time, s, after which a model has forgotten all but 1/e: τ = -h / ln |pole|."""
    radii = np.concatenate([[0.0], *(np.abs(axis.poles) for axis in model.axes.values())])
    period_s = model.period_ns / NANOSECONDS
    return float(-period_s / np.log(radii.max())) if radii.max() > 0 else 0.0


def longest_gap_s(model: DriftModel) -> float:
    """Compute the longest gap, s, after which a model may continue from its state."""
    remembered_s = min(TIME_CONSTANTS * slowest_time_constant_s(model), MOST_GAP_S)
    return max(remembered_s, LEAST_GAP_S, model.start_s)


def longest_gap_cells(model: DriftModel) -> int:
    """Compute ``longest_gap_s`` in whole cells."""
    return int(longest_gap_s(model) * NANOSECONDS / model.period_ns)


def straight_lines(
    measured_cells: IntArray, measured_c: FloatArray, first_cell: int, count: int
) -> FloatArray:
    """
    Fill the cells of a thermometer: ``count`` temperatures, °C, from ``first_cell`` on.

    Takes the numbers of the cells with a sample, ascending, and their temperatures, °C, (n,).
    After the last of them its value is held.
    """
    cells = first_cell + np.arange(count)
    return np.asarray(np.interp(cells, measured_cells, measured_c))


def starts(measured: BoolArray, longest: int) -> list[tuple[int, int]]:
    """
    List where the model has to start from rest, because of gaps longer than ``longest``, cells.

    ``measured``, (N, J), marks the cells with a sample of each thermometer. A start is the cell
    from which to run the model, and the cell from which its drift counts; (0, 0) is the first.
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
    """
    Run a model freely over N cells on straight lines, (N, J), and over gaps: drift (N, 6).

    A wrong thermometer is replaced from where the stream would have found it.
    """
    agreement = Agreement(model, temperature_c.shape[1])
    if not agreement.able:
        return _run_over_gaps(model, temperature_c, measured)
    believed_c, heard, longest = temperature_c.copy(), measured.copy(), longest_gap_cells(model)
    parts, offsets, begin = [], Offsets(), 0

    def run(end: int) -> Drift:
        return _run_over_gaps(model, believed_c[:end], heard[:end])

    def newest(end: int) -> Drift:
        seconds = (np.arange(end - begin)[:, np.newaxis] + 1) * model.period_ns / NANOSECONDS
        return offsets.on(Drift(*(values[begin:] for values in run(end))), seconds)

    for first in range(0, len(measured), agreement.cells):
        end = min(first + agreement.cells, len(measured))
        part = slice(first, end)
        believed_c[part], rewrite = agreement.add(temperature_c[part], measured[part])
        heard[part, list(agreement.replaced)] |= measured[part].any(axis=1, keepdims=True)
        if rewrite is not None:
            parts.append(newest(end))
            soaked = starts(heard[:end], longest)[-1][0]
            rest = slice(soaked, soaked + model.start_cells)
            rested_c = rest_c(believed_c[rest])
            rewrite.apply(believed_c[:end], heard[:end])
            before, now = (Drift(*(v[-1] for v in drift)) for drift in (parts[-1], run(end)))
            rests_c = rested_c, rest_c(believed_c[rest])
            offsets = offsets.going_on(model, rests_c, before, now)
            begin = end
    parts.append(newest(len(measured)))
    return Drift(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def _run_over_gaps(model: DriftModel, temperature_c: FloatArray, measured: BoolArray) -> Drift:
    """Run a model over N cells, (N, J), from rest, and again after gaps: drift (N, 6)."""
    at = starts(measured, longest_gap_cells(model))
    parts = []
    for (first, cell), (_, end) in pairwise([*at, (0, len(measured))]):
        drift = run_from_rest(model, temperature_c[first:end])[1]
        parts.append(Drift(*(part[cell - first :] for part in drift)))
    return Drift(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def doubt(gap_s: float, longest_s: float, by_clock_s: float = 0.0) -> str:
    """
    Say why a thermal state cannot be used after a gap, in half a sentence; empty where it can.

    The gap is ``gap_s`` long by the stamps and ``by_clock_s`` by the system's clock, s, negative
    where they ran back, 0 without such a clock. The state can be used for ``longest_s``.
    """
    if by_clock_s < -_SLIP_S:
        return (
            f'the saved state is from {-by_clock_s:.0f} s in the future: the system clock was set '
            'back'
        )
    if gap_s < -_SLIP_S:
        return (
            f'the thermal state is {-gap_s:.0f} s ahead of the temperatures: their stamps are of '
            'another clock, or time ran back'
        )
    if gap_s < by_clock_s - _SLIP_S:
        return (
            f'the stamps of the temperatures moved on by {gap_s:.0f} s while {by_clock_s:.0f} s '
            'passed since the thermal state was saved: their clock was set'
        )
    if gap_s > longest_s:
        return f'the thermal state is {gap_s:.0f} s old and this model remembers {longest_s:.0f} s'
    return ''
