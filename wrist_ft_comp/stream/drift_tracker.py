"""From temperatures to drift: here the model is stepped, once per thermal cell."""

import numpy as np

from wrist_ft_comp.drift import drift_model
from wrist_ft_comp.drift.drift_model import Drift, DriftModel, DriftState, no_drift
from wrist_ft_comp.signals import FloatArray, NANOSECONDS
from wrist_ft_comp.stream import thermometer_prediction
from wrist_ft_comp.stream.gap import doubt, longest_gap_cells, MOST_GAP_S
from wrist_ft_comp.stream.stream_grid import ThermalCell, ThermalGrid
from wrist_ft_comp.stream.thermal_memory import blocks_of, ThermalMemory
from wrist_ft_comp.stream.thermometer_prediction import Readings, ThermometerState
from wrist_ft_comp.stream.timestamp_filter import TimestampFilter

#: A saved history is averaged over this time, s, so that it takes a few kilobytes.
SPAN_S = 60.0
#: Most cells that the model runs through per temperature, so that none delays the stream for long.
#: After an outage of six hours the model has caught up with the 12th temperature.
_CELLS_AT_ONCE = 1800
#: A shorter gap is not reported, s, though the model may remember less: a thermometer may be read
#: every five minutes.
_REPORTED_GAP_S = 600.0
#: Origin of the drift of a model that has seen no temperature.
_NOT_YET = 'no temperatures yet'
#: Origin of the drift of a restarted stream before its first temperature.
_HELD = 'the drift saved before the restart is held until a temperature comes'


class History:
    """Keeps the newest cells of J thermometers, ``most`` at most."""

    def __init__(self, thermometers: int, most: int) -> None:
        self.most = most
        self._rows: FloatArray = np.zeros((0, thermometers))
        self._end = 0

    def __len__(self) -> int:
        return min(self._end, self.most)

    @property
    def temperature_c(self) -> FloatArray:
        """What was believed, °C, shape (N, J), oldest first."""
        return self._rows[self._end - len(self) : self._end]

    def add(self, temperature_c: FloatArray) -> None:
        """Add cells, °C, shape (n, J)."""
        rows = temperature_c[-self.most :]
        if self._end + len(rows) > len(self._rows):
            kept = self.temperature_c
            self._rows = np.zeros((2 * self.most, rows.shape[1]))
            self._rows[: len(kept)], self._end = kept, len(kept)
        self._rows[self._end : self._end + len(rows)] = rows
        self._end += len(rows)


class DriftTracker:
    """Follows the temperatures with a model, cell by cell; a model brings its own period."""

    def __init__(
        self, thermometers: int, period_ns: int, patience_s: float, history_s: float
    ) -> None:
        self.model: DriftModel | None = None
        #: Of the last completed cell, °C, shape (J,): as it is believed, and as it was read.
        self.temperature_c: FloatArray | None = None
        self.reading_c: FloatArray | None = None
        #: Where the last completed cell ended, ns.
        self.end_ns = 0
        #: What the model says now, arrays of shape (6,).
        self.drift = no_drift()
        #: Where the drift comes from, a sentence; it changes when the drift starts or goes on.
        self.origin = _NOT_YET
        #: Whether a thermal state could not be used after a gap.
        self.forgot = False
        self.timestamp_filter = TimestampFilter(thermometers)
        self.grid = ThermalGrid(period_ns, thermometers, patience_s)
        #: What is known of the thermometers; None where the model does not predict them.
        self.thermometers: ThermometerState | None = None
        self._count, self._patience_s, self._history_s = thermometers, patience_s, history_s
        #: After the newest cell that was run.
        self._state: DriftState | None = None
        #: For how many cells each thermometer has been silent.
        self._silent = (0,) * thermometers
        #: Memory to continue from at the first cell, and its age by the system's clock, s.
        self._awaited: tuple[ThermalMemory, float] | None = None
        #: What was given last to be saved.
        self._memory: ThermalMemory | None = None
        self._forget()

    def _forget(self) -> None:
        """Let the sensor have soaked at the temperatures of the next cell."""
        self.history = History(self._count, self._most_cells())
        #: The cell that comes next; None before the first.
        self._next: int | None = None
        #: Cells that the model has not run through, °C, (n, J).
        self._waiting: FloatArray = np.zeros((0, self._count))
        #: The cells that the model starts from, °C, (n, J).
        self._start_c: FloatArray = self._waiting

    def _most_cells(self) -> int:
        """Count the cells that are kept for a later model."""
        return max(round(self._history_s * NANOSECONDS / self.grid.period_ns), 1)

    @property
    def _longest(self) -> int:
        """Longest gap, cells, after which the drift goes on from its state."""
        if self.model is None:
            return int(MOST_GAP_S * NANOSECONDS / self.grid.period_ns)
        return longest_gap_cells(self.model)

    @property
    def _block_cells(self) -> int:
        """Count the cells over which a saved history is averaged."""
        return max(round(SPAN_S * NANOSECONDS / self.grid.period_ns), 1)

    @property
    def following(self) -> bool:
        """Whether there is a model and its thermal state has started."""
        return self._state is not None

    @property
    def awaiting_gap(self) -> bool:
        """Whether a restarted stream still waits for the first temperatures after its gap."""
        return self._awaited is not None

    @property
    def replaced(self) -> list[int]:
        """Which thermometers are replaced by their predictions, counted from 0."""
        if self.thermometers is None:
            return []
        return [int(j) for j in np.flatnonzero(self.thermometers.replaced)]

    def add(self, thermometer: int, stamp_ns: int, temperature_c: float) -> list[ThermalCell]:
        """Take one temperature, °C; step the model by the cells that it completes."""
        samples = self.timestamp_filter.admit(thermometer, stamp_ns, temperature_c)
        completed = [cell for sample in samples for cell in self.grid.add(*sample)]
        for cell in completed:
            self._take(cell)
        self._follow(_CELLS_AT_ONCE)
        return completed

    def _take(self, cell: ThermalCell) -> None:
        """Let a cell wait for the model, and those of the gap before it."""
        period_s = self.grid.period_ns / NANOSECONDS
        gap = 0 if self._next is None else cell.number - self._next
        if gap or self._awaited:
            self._cross(gap)
        believed_c, before_c = cell.temperature_c, self.temperature_c
        if self._next is None or before_c is None:  # there is nothing before it
            gap, before_c = 0, believed_c
        gap = max(gap, 0)
        prediction = None if self.model is None else self.model.prediction
        if prediction is not None:
            state = self.thermometers
            if state is None or self._next is None:
                reasons = () if state is None else state.reasons
                state = thermometer_prediction.start(prediction, believed_c, reasons)
            readings = Readings(believed_c, np.array(cell.measured), period_s, gap * period_s)
            self.thermometers = thermometer_prediction.step(prediction, state, readings)
            believed_c = self.thermometers.believed_c
        line_c = believed_c[np.newaxis]
        if gap:
            line_c = np.linspace(before_c, believed_c, gap + 2)[1:].astype(float)
        self.history.add(line_c)
        if self.model is not None:
            self._waiting = np.concatenate((self._waiting, line_c))
        self.temperature_c, self.reading_c = believed_c, cell.temperature_c
        self._silent, self._next = cell.silent, cell.number + 1
        self.end_ns = self._next * self.grid.period_ns

    def _cross(self, gap: int) -> None:
        """Decide whether the drift goes on over a gap of some cells, and say so."""
        period_s = self.grid.period_ns / NANOSECONDS
        memory, by_clock_s = self._awaited or (None, 0.0)
        self._awaited = None
        problem = doubt(gap * period_s, self._longest * period_s, by_clock_s)
        if problem:
            self._forget()
        if self.model is None or (0 <= gap * period_s < _REPORTED_GAP_S and not memory):
            return
        if problem:
            start = 'the drift starts at the steady state of the present temperatures'
            self.origin, self.forgot = f'{problem}; so {start}', True
        elif memory:
            before_s, self.forgot = max(gap, 0) * period_s, False
            self.origin = f'the drift goes on from the thermal state saved {before_s:.0f} s before'

    def _follow(self, most: int) -> None:
        """Run the model through the cells that wait, or through the first ones of them."""
        model = self.model
        if model is None or not len(self._waiting):
            return
        cells, self._waiting = self._waiting[:most], self._waiting[most:]
        if self.origin == _NOT_YET:
            self.origin = 'the drift started at the steady state of the first temperatures'
        if self._state is None or len(self._start_c) < model.start_cells:
            # The start is run again with every cell of it, from the mean of those that have come.
            cells = np.concatenate((self._start_c, cells))
            self._start_c = cells[: model.start_cells]
            self._state = drift_model.at_rest(model, self._start_c)
        self._state, drift = drift_model.run(model, self._state, cells, last_only=True)
        if not len(self._waiting):
            self.drift = Drift(drift.zero[0], drift.sensitivity[0])

    def use(self, model: DriftModel | None) -> None:
        """Follow another model, whose state is made from the history; None follows none."""
        if model is not None and model.period_ns != self.grid.period_ns:
            counted = self.grid.rejected, self.grid.restarts, self.grid.spikes
            self.grid = ThermalGrid(model.period_ns, self._count, self._patience_s)
            self.grid.rejected, self.grid.restarts, self.grid.spikes = counted
            self._forget()
        before, self.thermometers = self.thermometers, None
        self.model, self._state, self._awaited = model, None, None
        self.origin = 'no model is live' if model is None else _NOT_YET
        self.forgot = False
        self.drift = no_drift()
        self._start_c = self._waiting = np.zeros((0, self._count))
        self._memory = None
        if model is None or not len(self.history):
            return
        self._waiting = self.history.temperature_c.copy()
        self._follow(len(self._waiting))
        self.origin = f'the drift was found from {len(self.history)} thermal cells before'
        if model.prediction is not None and self.reading_c is not None:
            # Those that were replaced stay so.
            reasons = () if before is None else before.reasons
            blocks = blocks_of(self.history.temperature_c, self._block_cells)
            self.thermometers = thermometer_prediction.start(
                model.prediction, self.reading_c, reasons, np.stack([c for c, _ in blocks]), SPAN_S
            )

    def memory(self, compensation: Drift) -> ThermalMemory | None:
        """
        Give what a restarted stream needs to continue; None before there is a state.

        While the model catches up with a long gap, it is what was given before that.
        """
        if self._awaited is not None:
            return self._awaited[0]
        if len(self._waiting) > _CELLS_AT_ONCE:
            return self._memory
        self._follow(_CELLS_AT_ONCE)
        if self._state is None or self.reading_c is None:
            return None
        period_ns = self.grid.period_ns
        self._memory = ThermalMemory(
            self.end_ns, period_ns, self.reading_c, self._silent, self._state, compensation,
            self._start_c, blocks_of(self.history.temperature_c, self._block_cells),
            self.thermometers)  # fmt: skip
        return self._memory

    def resume(self, memory: ThermalMemory, by_clock_s: float) -> None:
        """
        Continue from the memory of another stream, as if its last temperature had been held.

        The memory has to belong to this model (``belongs_to``). The gap is ``by_clock_s`` long by
        the system's clock, 0 without one. The first completed cell shows how long it was, and how
        the temperature changed. Where the clock shows that the memory cannot be used, the drift
        stays what was subtracted until then.
        """
        if self.model is None:
            return
        self._awaited = memory, by_clock_s
        self.timestamp_filter.expect(memory.end_ns)
        for temperature_c, count in memory.history:
            self.history.add(np.tile(temperature_c, (count, 1)))
        self._next, self._silent = memory.end_ns // memory.period_ns, memory.silent
        self.grid.go_on(self._next, memory.temperature_c.tolist(), memory.silent)
        self.temperature_c = self.reading_c = memory.temperature_c
        self.thermometers = memory.thermometers
        if self.thermometers is not None:
            self.temperature_c = self.thermometers.believed_c
        self.end_ns, self._start_c = memory.end_ns, memory.start_c
        self._state, self.drift = memory.filters, memory.compensation
        longest_s = self._longest * memory.period_ns / NANOSECONDS
        if problem := doubt(max(by_clock_s, 0.0), longest_s, by_clock_s):
            self.origin, self.forgot = f'{problem}; {_HELD}', True
            return
        cells = round(by_clock_s * NANOSECONDS / memory.period_ns)
        if cells > 0:
            held_c = np.tile(self.temperature_c, (cells, 1))
            _, drift = drift_model.run(self.model, self._state, held_c, last_only=True)
            self.drift = Drift(drift.zero[0], drift.sensitivity[0])
        self.origin = _HELD
