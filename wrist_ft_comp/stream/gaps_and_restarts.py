"""
Silence of all thermometers: what is remembered over it, and for how long that can be used.

One rule for the running stream, for a restarted one and for files:

- A thermometer that is silent while others report keeps its last value.
- In cells in which no thermometer reports, temperatures are on the straight line between the cells
  before and after.
- After an outage of all thermometers, these go on with the first cell by whose end all have
  reported that do so within some seconds.
- After a gap of all that is longer than the model's memory, the sensor has soaked at the
  temperatures after the gap.

The stream differs from a file in one thing: it learns of the cells of a gap when the gap has
ended, and holds the drift until then. A restart is a gap like any other: the sensor remembers an
hour of temperatures, and a restart takes seconds.
"""

from dataclasses import dataclass
import math
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.drift.drift_model import Drift, DriftModel, DriftState
from wrist_ft_comp.series import BoolArray, FloatArray, IntArray, NANOSECONDS
from wrist_ft_comp.stream.clock import LEAP_S
from wrist_ft_comp.stream.drift_uncertainty import SPAN_S, TIME_CONSTANTS, Uncertainty
from wrist_ft_comp.stream.failed_thermometers import ThermometerState
from wrist_ft_comp.stream.temperature_jumps import Jump

#: Shortest memory that is assumed of a model, s.
LEAST_GAP_S = 60.0
#: Longest memory that is assumed, s; the stream keeps the temperatures of that time.
MOST_GAP_S = 6 * 3600.0
#: All thermometers were out when none reported for longer, s; and after an outage one is waited
#: for as long. It is the default of temperature_timeout, which the stream uses.
OUTAGE_S = 5.0


def longest_gap_s(model: DriftModel | None) -> float:
    """
    Compute the longest gap, s, after which a model may continue from its state; None keeps most.

    It is three of the slowest time constants, τ = -h / ln |pole|, within bounds.
    """
    if model is None:
        return MOST_GAP_S
    radius = max((np.abs(axis.poles).max(initial=0) for axis in model.axes.values()), default=0)
    period_s = model.period_ns / NANOSECONDS
    slowest_s = -period_s / math.log(radius) if radius > 0 else 0.0
    return max(min(TIME_CONSTANTS * slowest_s, MOST_GAP_S), LEAST_GAP_S, model.start_s)


def outage_cells(period_ns: int, outage_s: float = OUTAGE_S) -> int:
    """Count the cells of the longest silence of all thermometers that is no outage."""
    return max(1, math.ceil(outage_s * NANOSECONDS / period_ns))


def reporting_cells(measured: BoolArray, period_ns: int) -> IntArray:
    """List the cells in which a thermometer reports, of N; ``measured`` says which do, (N, J)."""
    longest = outage_cells(period_ns)
    cells = np.flatnonzero(measured.any(axis=1))
    reports: BoolArray = np.ones(len(cells), dtype=bool)
    for end in np.flatnonzero(np.diff(cells) > longest) + 1:
        first = cells[end]
        back = measured[first : first + longest + 1]
        whole = int(back.argmax(axis=0).max())  # one that is not back yet counts as the first
        reports[end:] &= cells[end:] >= first + whole
    return cells[reports]


def fill_gaps(means_c: FloatArray, before_c: FloatArray, period_ns: int) -> FloatArray:
    """
    Fill the cells without a sample by the rule for gaps: temperatures, °C, (N, J).

    ``means_c``, (N, J), is NaN in them; ``before_c``, (J,), was read before the first cell.
    """
    measured, cells = np.isfinite(means_c), np.arange(len(means_c))
    newest = np.maximum.accumulate(np.where(measured, 1 + cells[:, np.newaxis], 0), axis=0)
    held_c = np.take_along_axis(np.vstack((before_c, means_c)), newest, axis=0)
    at = reporting_cells(measured, period_ns)
    return np.stack([np.interp(cells, at, column[at]) for column in held_c.T], axis=1)


def why_forgotten(
    gap_s: float, longest_s: float, by_clock_s: float = 0.0, cell_s: float = 0.0
) -> str:
    """
    Say why a thermal state cannot be used after a gap, in half a sentence; empty where it can.

    The gap is ``gap_s`` long by the stamps, negative where they ran back, and ``by_clock_s`` by
    the system's clock, 0 without one, as of a bag in a loop. The state can be used for
    ``longest_s``; gaps are known to a cell, s.
    """
    leap_s = max(LEAP_S, cell_s)
    if gap_s < -(leap_s if by_clock_s else OUTAGE_S):
        return (
            f'the thermal state is {-gap_s:.0f} s ahead of the temperatures: their stamps are of '
            'another clock, or time ran back'
        )
    if gap_s < by_clock_s - leap_s:
        return (
            f'the stamps of the temperatures moved on by {gap_s:.0f} s while {by_clock_s:.0f} s '
            'passed since the thermal state was saved: their clock was set'
        )
    if gap_s > longest_s:
        return f'the thermal state is {gap_s:.0f} s old and this model remembers {longest_s:.0f} s'
    return ''


class Block(NamedTuple):
    """Mean temperatures, °C, shape (J,), of a number of consecutive cells."""

    temperature_c: FloatArray
    cells: int


def blocks_of(temperature_c: FloatArray, period_ns: int) -> tuple[Block, ...]:
    """
    Average temperatures, °C, shape (N, J), over blocks of SPAN_S.

    The first cell is a block of its own, because a model starts from it.
    """
    if not len(temperature_c):
        return ()
    cells = max(round(SPAN_S * NANOSECONDS / period_ns), 1)
    begins = np.array([0, *range(1, len(temperature_c), cells)])
    counts = np.diff(begins, append=len(temperature_c))
    means = np.add.reduceat(temperature_c, begins, axis=0) / counts[:, np.newaxis]
    return tuple(map(Block, means, counts.tolist()))


@dataclass(frozen=True, eq=False)
class ThermalMemory:
    """What a stream remembers of the temperatures."""

    #: Stamp at which the last completed thermal cell ended, and cell length h, ns.
    end_ns: int
    period_ns: int
    #: As they were read last, °C, shape (J,).
    temperature_c: FloatArray
    #: For how many cells each thermometer has been silent, shape (J,).
    silent: tuple[int, ...]
    #: State of every modelled axis after the last cell.
    filters: DriftState
    #: What was being subtracted, arrays of shape (6,).
    compensation: Drift
    #: The cells of the start, °C, (n, J): the sensor had soaked at their mean temperature.
    start_c: FloatArray
    #: The cells until now, oldest first, for another model that goes live after the restart.
    history: tuple[Block, ...]
    #: What is known of the thermometers; None where they are not predicted.
    thermometers: ThermometerState | None = None
    #: How far what was subtracted may be off, because temperatures were missing.
    uncertainty: Uncertainty | None = None
    #: How each thermometer has jumped since the last tare.
    jumps: tuple[Jump, ...] = ()
