"""From temperatures to drift: here the model is stepped, once per thermal cell."""

from collections import deque

import numpy as np

from wrist_ft_comp.model import drift_model
from wrist_ft_comp.model.drift_model import DriftModel, DriftState, no_drift
from wrist_ft_comp.model.signals import FloatArray, NANOSECONDS
from wrist_ft_comp.model.stream_grid import CompletedCells, ThermalGrid
from wrist_ft_comp.stream.timestamp_filter import TimestampFilter
from wrist_ft_comp.stream.warm_restart import fill_gap, SPAN_S, ThermalMemory


class History:
    """The temperatures of some hours: cell by cell, and as means over SPAN_S for a restart."""

    def __init__(self, period_ns: int, history_s: float) -> None:
        most = max(round(history_s * NANOSECONDS / period_ns), 1)
        self.cells: deque[FloatArray] = deque(maxlen=most)
        self._cells_per_span = max(round(SPAN_S * NANOSECONDS / period_ns), 1)
        self._full: deque[tuple[FloatArray, int]] = deque(
            maxlen=max(most // self._cells_per_span, 1)
        )
        self._sum: FloatArray = np.zeros(1)
        self._count = 0

    def add(self, temperature_c: FloatArray, count: int) -> int:
        """Add cells of the same temperatures, °C, shape (J,); tell how many have room."""
        count = min(count, self.cells.maxlen or count)
        self.cells.extend([temperature_c] * count)
        for _ in range(count):
            self._sum, self._count = self._sum + temperature_c, self._count + 1
            # The very first cell stays alone: it is where a model starts from.
            if self._count == self._cells_per_span or not self._full:
                self._full.append((self._sum / self._count, self._count))
                self._sum, self._count = np.zeros(1), 0
        return count

    def means(self) -> tuple[tuple[FloatArray, int], ...]:
        """Mean temperatures, °C, and how many cells they are of; oldest first."""
        begun = [(self._sum / self._count, self._count)] if self._count else []
        return (*self._full, *begun)


_NOT_YET = 'no temperatures yet'


class DriftTracker:
    """Follows the temperatures with a model, cell by cell; a model brings its own period."""

    def __init__(
        self, thermometers: int, period_ns: int, patience_s: float, history_s: float
    ) -> None:
        self.model: DriftModel | None = None
        #: Of the last completed cell, °C, shape (J,), and where it ended, ns.
        self.temperature_c: FloatArray | None = None
        self.end_ns = 0
        #: What the model says now, arrays of shape (6,).
        self.drift = no_drift()
        #: How the drift came to be where it is, a sentence; changes when it starts or goes on.
        self.origin = _NOT_YET
        #: Whether another stream's memory was of no use.
        self.forgot = False
        self.timestamp_filter = TimestampFilter(thermometers)
        self.grid = ThermalGrid(period_ns, thermometers, patience_s)
        self.history = History(period_ns, history_s)
        self._thermometers, self._patience_s = thermometers, patience_s
        self._history_s = history_s
        self._state: DriftState | None = None
        #: The first cells of a start that still looks at them.
        self._starting: list[FloatArray] | None = None
        #: What to go on from when the first cell is complete, and its age by another clock, s.
        self._awaited: tuple[ThermalMemory, float] | None = None

    @property
    def following(self) -> bool:
        """Whether there is a model and its thermal state has started."""
        return self._state is not None

    @property
    def awaiting_gap(self) -> bool:
        """Whether a restarted stream still waits for the temperatures behind its gap."""
        return self._awaited is not None

    def add(self, thermometer: int, stamp_ns: int, temperature_c: float) -> list[CompletedCells]:
        """Take one temperature, °C; step the model by the cells that it completes."""
        samples = self.timestamp_filter.admit(thermometer, stamp_ns, temperature_c)
        completed = [cells for sample in samples for cells in self.grid.add(*sample)]
        for cells in completed:
            resting = self._state is None
            if self.model is not None and self._awaited is not None:
                self._fill_gap(self.model, *self._awaited, cells)
            self.temperature_c = cells.temperature_c
            self.end_ns = (cells.first_cell + cells.count) * self.grid.period_ns
            count = self.history.add(cells.temperature_c, cells.count)
            if self.model is None:
                continue
            if self._state is None or count < cells.count:
                # Nothing known before, or a gap longer than any memory: the robot has soaked.
                if resting:
                    self.origin = 'the drift started at the steady state of the first temperatures'
                self._starting, count = [], 1
            if self._state is None or self._starting is not None:
                self._start(self.model, [*(self._starting or []), *[cells.temperature_c] * count])
            elif count == 1:
                self._state, self.drift = drift_model.step(
                    self.model, self._state, cells.temperature_c
                )
            else:
                self._run(self.model, self._state, np.tile(cells.temperature_c, (count, 1)))
        return completed

    def _start(self, model: DriftModel, cells: list[FloatArray]) -> None:
        """Start at rest with the cells that have come, each (J,), as ``run_from_rest``."""
        temperature_c = np.array(cells)
        soaked = temperature_c[: model.start_cells].mean(axis=0)
        self._run(model, drift_model.start(model, soaked), temperature_c)
        self._starting = cells if len(cells) < model.start_cells else None

    def _run(self, model: DriftModel, state: DriftState, temperature_c: FloatArray) -> None:
        """Go on from a state through cells, shape (N, J)."""
        self._state, last = drift_model.run(model, state, temperature_c, last_only=True)
        self.drift = drift_model.Drift(last.zero[0], last.sensitivity[0])

    def _fill_gap(
        self, model: DriftModel, memory: ThermalMemory, at_least_s: float, cells: CompletedCells
    ) -> None:
        """Take the state over the gap behind a restart, or give it up."""
        self._awaited = None
        temperature_c, self.origin = fill_gap(
            model, memory, cells.first_cell, cells.temperature_c, at_least_s
        )
        self.forgot = temperature_c is None
        self._starting = None
        if temperature_c is None:
            self._state = None
            self.history = History(self.grid.period_ns, self._history_s)
            return
        self._state = memory.filters
        if len(temperature_c):
            self._run(model, memory.filters, temperature_c)
            for cell in temperature_c:
                self.history.add(cell, 1)

    def use(self, model: DriftModel | None) -> None:
        """Follow another model, whose state is made from the history; None follows no more."""
        if model is not None and model.period_ns != self.grid.period_ns:
            counted = self.grid.rejected, self.grid.restarts
            self.grid = ThermalGrid(model.period_ns, self._thermometers, self._patience_s)
            self.grid.rejected, self.grid.restarts = counted
            self.history = History(model.period_ns, self._history_s)
        self.model, self._state, self._starting, self._awaited = model, None, None, None
        self.origin = 'no model is live' if model is None else _NOT_YET
        self.forgot = False
        self.drift = no_drift()
        if model is not None and self.history.cells:
            self._start(model, list(self.history.cells))
            self.origin = (
                f'the drift was found from {len(self.history.cells)} thermal cells before'
            )

    def memory(self, compensation: drift_model.Drift) -> ThermalMemory | None:
        """Tell, once there is a state, what a restarted stream needs to go on and subtract."""
        if self._awaited is not None:
            return self._awaited[0]
        if self._state is None or self.temperature_c is None:
            return None
        known = self.end_ns, self.grid.period_ns, self.temperature_c, self._state
        return ThermalMemory(*known, compensation, self.history.means())

    def resume(self, memory: ThermalMemory, at_least_s: float) -> None:
        """Go on from what another stream left, as if its last temperature had been held."""
        # The memory is of the model that is followed (``belongs_to``); by another clock the gap is
        # ``at_least_s`` long, 0 without one. The first completed cell tells how long it was, and
        # what the temperature did.
        if self.model is None:
            return
        self._awaited = memory, at_least_s
        self.timestamp_filter.expect(memory.end_ns)
        # A model that is swapped in before the first temperature starts from these, too.
        for temperature_c, count in memory.history:
            self.history.add(temperature_c, count)
        self.temperature_c, self.end_ns = memory.temperature_c, memory.end_ns
        self._state, self.drift, self._starting = memory.filters, memory.compensation, None
        cells = round(at_least_s * NANOSECONDS / memory.period_ns)
        if cells > 0:
            self._run(self.model, memory.filters, np.tile(memory.temperature_c, (cells, 1)))
        self.origin = 'the drift saved before the restart is held until a temperature comes'
