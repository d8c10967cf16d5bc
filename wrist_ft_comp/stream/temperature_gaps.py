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

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.drift import drift_model
from wrist_ft_comp.drift.drift_model import Drift, DriftModel, DriftState
from wrist_ft_comp.series import BoolArray, FloatArray, IntArray, NANOSECONDS
from wrist_ft_comp.stream import thermometer_faults
from wrist_ft_comp.stream.clock import LEAP_S
from wrist_ft_comp.stream.thermometer_faults import Jump, ThermometerState

#: A model's memory in slowest time constants: after three, 5 % of a change are left.
TIME_CONSTANTS = 3.0
#: Shortest memory that is assumed of a model, s.
LEAST_GAP_S = 60.0
#: Longest memory that is assumed, s; the stream keeps the temperatures of that time.
MOST_GAP_S = 6 * 3600.0
#: All thermometers were out when none reported for longer, s; and after an outage one is waited
#: for as long. It is the default of temperature_timeout, which the stream uses.
OUTAGE_S = 5.0
#: A saved history is averaged over this time, s, so that it takes a few kilobytes; and over it is
#: measured how fast temperatures move.
SPAN_S = 60.0
#: Temperatures that move by less over SPAN_S stand still, K: rooms, or rounding, move by 0.1.
_MOVES_K = 0.15
#: A room is warmer by this on one day than on another, K.
_ROOMS_K = 5.0
#: Steps of a path that temperatures may have taken in a gap: more change the bound by percents.
_PATH_STEPS = 64


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
    newest = np.maximum.accumulate(np.where(measured, cells[:, np.newaxis], -1), axis=0)
    held_c = np.where(
        newest < 0, before_c, np.take_along_axis(means_c, np.maximum(newest, 0), axis=0)
    )
    at = reporting_cells(measured, period_ns)
    return np.stack([np.interp(cells, at, column[at]) for column in held_c.T], axis=1)


def why_forgotten(gap_s: float, longest_s: float, by_clock_s: float = 0.0) -> str:
    """
    Say why a thermal state cannot be used after a gap, in half a sentence; empty where it can.

    The gap is ``gap_s`` long by the stamps, negative where they ran back, and ``by_clock_s`` by
    the system's clock, 0 without one. The state can be used for ``longest_s``.
    """
    if gap_s < -LEAP_S:
        return (
            f'the thermal state is {-gap_s:.0f} s ahead of the temperatures: their stamps are of '
            'another clock, or time ran back'
        )
    if gap_s < by_clock_s - LEAP_S:
        return (
            f'the stamps of the temperatures moved on by {gap_s:.0f} s while {by_clock_s:.0f} s '
            'passed since the thermal state was saved: their clock was set'
        )
    if gap_s > longest_s:
        return f'the thermal state is {gap_s:.0f} s old and this model remembers {longest_s:.0f} s'
    return ''


class Uncertainty(NamedTuple):
    """How far the zero drift may be off at a stamp, and less and less from then on."""

    since_ns: int
    #: N and N m, (6,).
    bound: FloatArray

    def left(self, now_ns: int, memory_s: float) -> FloatArray:
        """Compute the bound at a later stamp, N and N m, (6,): the model forgets in memory_s."""
        age_s = (now_ns - self.since_ns) / NANOSECONDS
        return np.asarray(self.bound * np.exp(-TIME_CONSTANTS * age_s / memory_s))


def bound_drift(  # noqa: PLR0913, PLR0917 -- what a gap is between
    model: DriftModel, state: DriftState, history_c: FloatArray, after_c: FloatArray,
    gap_s: float, memory_s: float,
) -> FloatArray:  # fmt: skip
    """
    Bound the zero drift after a gap, N and N m: the least and the largest, (2, 6).

    Takes the state before it, the temperatures until then, °C, (n, J), and those of the first cell
    after it, (J,). In between, temperatures may have gone up and come back, or down, as fast as
    they ever moved over SPAN_S, but not beyond all that the model was learnt from.
    """
    period_s, before_c = model.period_ns / NANOSECONDS, history_c[-1]
    span = min(max(round(SPAN_S / period_s), 1), len(history_c) - 1)
    rate_k_s = np.abs(after_c - before_c) / max(gap_s, period_s)
    if span:  # a node may be killed after its first cell
        moves_k = np.abs(history_c[span:] - history_c[:-span]).max(axis=0)
        rate_k_s = np.maximum(moves_k / (span * period_s), rate_k_s)
    known_c = [history_c.min(axis=0), history_c.max(axis=0), after_c]
    for axis in model.axes.values():
        known_c += axis.range_c
    remembered_s = min(max(gap_s, 0.0), memory_s)
    cells = max(round(remembered_s / period_s / _PATH_STEPS), 1)
    until_s = np.arange(remembered_s, 0.0, -cells * period_s)[:, np.newaxis]
    since_k, until_k = rate_k_s * (gap_s - until_s), rate_k_s * until_s
    highest_c = np.minimum(np.minimum(before_c + since_k, after_c + until_k), np.max(known_c, 0))
    lowest_c = np.maximum(np.maximum(before_c - since_k, after_c - until_k), np.min(known_c, 0))
    ends = [drift_model.skip(model, state, path_c, cells) for path_c in (lowest_c, highest_c)]
    return np.stack([drift_model.step(model, end, after_c)[1].zero for end in ends])


def warmest_room_c(model: DriftModel) -> FloatArray:
    """Give what thermometers may read in a room, °C, (J,), by the coldest of the calibration."""
    coldest_c = [axis.range_c[0] for axis in model.axes.values()] or [np.full(1, np.inf)]
    return np.asarray(np.min(coldest_c, axis=0) + _ROOMS_K)


def doubt_start(
    model: DriftModel, start_c: FloatArray, memory_s: float, slope_k: FloatArray | None = None
) -> FloatArray:
    """
    Bound how far the zero drift is off where the sensor had not soaked, N and N m, (6,).

    Takes the first temperatures, °C, (n, J), of SPAN_S. Where they move, they may have done so
    before, from the coldest room or the hottest work that the model was learnt from. A robot that
    was switched on just now warms from the temperature of its room, and had soaked. What is warmer
    than a room may have come up in the slowest time constant, unless it is known, and taken into
    account, how fast temperatures moved before on the mean, K per cell, (J,).
    """
    if slope_k is not None:
        start_c = start_c - slope_k * np.arange(len(start_c))[:, np.newaxis]
    some = max(len(start_c) // 6, 1)
    moved_k = start_c[-some:].mean(axis=0) - start_c[:some].mean(axis=0)
    rates_k = [np.where(np.abs(moved_k) < _MOVES_K, 0.0, moved_k) / max(len(start_c) - some, 1)]
    remembered = round(memory_s * NANOSECONDS / model.period_ns)
    coldest_c = np.minimum(warmest_room_c(model), start_c[0])
    if slope_k is None:
        rates_k.append(TIME_CONSTANTS * (start_c[0] - coldest_c) / remembered)
    cells = max(remembered // _PATH_STEPS, 1)
    before = np.arange(remembered, 0, -cells)[:, np.newaxis]
    hottest_c = np.max([start_c[0], *(axis.range_c[1] for axis in model.axes.values())], axis=0)

    def end_of(path_c: FloatArray) -> FloatArray:
        state = drift_model.skip(model, drift_model.at_rest(model, path_c[:1]), path_c, cells)
        return np.asarray(drift_model.run(model, state, start_c)[1].zero[-1])

    paths_c = [np.clip(start_c[0] - k * before, coldest_c, hottest_c) for k in rates_k if k.any()]
    soaked = drift_model.run(model, drift_model.at_rest(model, start_c), start_c)[1].zero[-1]
    off = [np.abs(end_of(path_c) - soaked) for path_c in paths_c]
    return np.asarray(np.max([np.zeros(len(AXES)), *off], axis=0))


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


def belongs_to(model: DriftModel, memory: ThermalMemory) -> bool:
    """Whether a memory, perhaps from a file, has the shapes of a model, so that it can be used."""
    shape, start_c, reading_c = (model.thermometers,), memory.start_c, memory.temperature_c
    rows = (reading_c, *start_c, *(mean_c for mean_c, _ in memory.history))
    if len(memory.silent) != model.thermometers or any(row.shape != shape for row in rows):
        return False
    if len(memory.jumps) not in {0, model.thermometers}:
        return False
    if memory.period_ns != model.period_ns or not 0 < len(start_c) <= model.start_cells:
        return False
    thermometers = None
    if model.prediction is not None:
        thermometers = thermometer_faults.start(model.prediction, reading_c)
    expected = _shapes(drift_model.start(model, reading_c), thermometers)
    if _shapes(memory.filters, memory.thermometers) != expected:
        return False
    with np.errstate(all='ignore'):
        _, drift = drift_model.run(model, memory.filters, reading_c[np.newaxis])
    return bool(np.isfinite(drift).all())


def _shapes(
    filters: DriftState, thermometers: ThermometerState | None
) -> dict[str, tuple[int, ...]]:
    parts = {**filters, **(vars(thermometers) if thermometers else {})}
    return {name: np.shape(part) for name, part in parts.items()}
