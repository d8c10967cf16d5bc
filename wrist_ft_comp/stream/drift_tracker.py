"""
From temperatures to drift: the thermal grid, the history of temperatures, and the model's state.

Temperatures move the drift once per thermal cell. What is subtracted of it, and how fast, is the
compensator's business.
"""

from collections import deque
from collections.abc import Iterator

import numpy as np

from wrist_ft_comp.model import drift_model
from wrist_ft_comp.model.drift_model import Drift, DriftModel, DriftState
from wrist_ft_comp.model.signals import AXES, FloatArray, NANOSECONDS
from wrist_ft_comp.model.stream_grid import CompletedCells, ThermalGrid
from wrist_ft_comp.stream.timestamp_filter import TimestampFilter
from wrist_ft_comp.stream.warm_restart import BLOCK_S, fill_gap, ThermalMemory


class Blocks:
    """
    Averages temperatures over blocks as cells complete.

    Parameters
    ----------
    cells : int
        Cells per block.
    history_cells : int
        How many cells are remembered.

    """

    def __init__(self, cells: int, history_cells: int) -> None:
        self._cells = cells
        self._done: deque[tuple[FloatArray, int]] = deque(maxlen=max(history_cells // cells, 1))
        self._sum: FloatArray = np.zeros(0)
        self._count = 0

    def add(self, temperature_c: FloatArray, count: int) -> None:
        """
        Take completed cells.

        Parameters
        ----------
        temperature_c : ndarray, shape (J,)
            Their temperatures, °C.
        count : int
            How many cells.

        """
        while count:
            part = min(count, self._cells - self._count)
            self._sum = part * temperature_c + (self._sum if self._count else 0.0)
            self._count += part
            count -= part
            # The very first cell stays alone: it is where a model starts from.
            if self._count == self._cells or not self._done:
                self._done.append((self._sum / self._count, self._count))
                self._count = 0

    def __iter__(self) -> Iterator[tuple[FloatArray, int]]:
        """
        Give the blocks, the one that is being filled included.

        Yields
        ------
        tuple of ndarray, shape (J,), and int
            Mean temperatures, °C, and how many cells they are of; oldest first.

        """
        yield from self._done
        if self._count:
            yield self._sum / self._count, self._count


_NOT_YET = 'no temperatures yet'


class DriftTracker:
    """
    Follows the temperatures with a model, cell by cell.

    Parameters
    ----------
    thermometers : int
        Number of thermometers J that will report.
    period_ns : int
        Cell length h while there is no model, ns; a model brings its own.
    patience_s : float
        How long a thermometer may be silent before its last value is held, s.
    history_s : float
        Temperatures kept for a model that comes later, s.

    """

    def __init__(
        self, thermometers: int, period_ns: int, patience_s: float, history_s: float
    ) -> None:
        self.model: DriftModel | None = None
        #: Of the last completed cell, °C, shape (J,).
        self.temperature_c: FloatArray | None = None
        #: What the model says now, arrays of shape (6,).
        self.drift = Drift(np.zeros(len(AXES)), np.zeros(len(AXES)))
        self.timestamp_filter = TimestampFilter(thermometers)
        #: How the drift came to be where it is, a sentence; changes when it starts or goes on.
        self.origin = _NOT_YET
        #: Whether another stream's memory was of no use.
        self.forgot = False
        #: End of the last completed cell, ns.
        self.end_ns = 0
        self._thermometers = thermometers
        self._patience_s = patience_s
        self._history_s = history_s
        self._state: DriftState | None = None
        #: What to go on from when the first cell is complete, and its age by another clock, s.
        self._awaited: tuple[ThermalMemory, float] | None = None
        self._use_period(period_ns)

    @property
    def following(self) -> bool:
        """Whether there is a model and its thermal state has started."""
        return self._state is not None

    @property
    def awaiting_gap(self) -> bool:
        """Whether a restarted stream still waits for the temperatures behind its gap."""
        return self._awaited is not None

    def _use_period(self, period_ns: int) -> None:
        """Start a grid of this period, without history."""
        self.grid = ThermalGrid(period_ns, self._thermometers, self._patience_s)
        self._forget()

    def _forget(self) -> None:
        """Start an empty history."""
        period_ns = self.grid.period_ns
        cells = max(round(self._history_s * NANOSECONDS / period_ns), 1)
        self._history: deque[FloatArray] = deque(maxlen=cells)
        self._blocks = Blocks(max(round(BLOCK_S * NANOSECONDS / period_ns), 1), cells)

    def add(self, thermometer: int, stamp_ns: int, temperature_c: float) -> list[CompletedCells]:
        """
        Take one temperature.

        Parameters
        ----------
        thermometer : int
            Which one, counted from 0.
        stamp_ns : int
            Its stamp, ns.
        temperature_c : float
            °C.

        Returns
        -------
        list of CompletedCells
            Cells that this sample completed; the drift has moved when there are any.

        """
        samples = self.timestamp_filter.admit(thermometer, stamp_ns, temperature_c)
        cells = [completed for sample in samples for completed in self.grid.add(*sample)]
        for completed in cells:
            self._advance(completed)
        return cells

    def _advance(self, cells: CompletedCells) -> None:
        """Move history, state and drift on by completed cells."""
        resting = self._state is None
        if self.model is not None and self._awaited is not None:
            self._cross_gap(self.model, *self._awaited, cells)
        self.temperature_c = cells.temperature_c
        count = min(cells.count, self._history.maxlen or cells.count)
        self._remember(cells.temperature_c, count)
        self.end_ns = (cells.first_cell + cells.count) * self.grid.period_ns
        if self.model is None:
            return
        if self._state is None or count < cells.count:
            # Nothing known before, or a gap longer than any memory: the robot has soaked.
            if resting:
                self.origin = 'the drift started at the steady state of the first temperatures'
            self._state = drift_model.start(self.model, cells.temperature_c)
            count = 1
        if count == 1:
            self._state, self.drift = drift_model.step(
                self.model, self._state, cells.temperature_c
            )
        else:
            self._hold(self.model, cells.temperature_c, count)

    def _remember(self, temperature_c: FloatArray, count: int) -> None:
        """Add cells of one temperature to the history."""
        self._history.extend([temperature_c] * count)
        self._blocks.add(temperature_c, count)

    def _hold(self, model: DriftModel, temperature_c: FloatArray, count: int) -> None:
        """Move the state on by cells of one temperature."""
        self._run(model, np.repeat(temperature_c[np.newaxis], count, axis=0))

    def _run(self, model: DriftModel, temperature_c: FloatArray) -> None:
        """Move the state on by cells, shape (N, J)."""
        assert self._state is not None  # noqa: S101 -- the caller has started it
        self._state, track = drift_model.run(model, self._state, temperature_c)
        self.drift = Drift(track.zero[-1], track.sensitivity[-1])

    def _cross_gap(
        self, model: DriftModel, memory: ThermalMemory, at_least_s: float, cells: CompletedCells
    ) -> None:
        """Take the state over the gap behind a restart, or give it up."""
        self._awaited = None
        temperature_c, self.origin = fill_gap(
            model, memory, cells.first_cell, cells.temperature_c, at_least_s
        )
        self.forgot = temperature_c is None
        if temperature_c is None:
            self._state = None
            self._forget()
            return
        self._state = memory.filters
        if len(temperature_c):
            self._run(model, temperature_c)
            for cell in temperature_c:
                self._remember(cell, 1)

    def use(self, model: DriftModel | None) -> None:
        """
        Follow another model; its state is made from the temperatures that are kept.

        Parameters
        ----------
        model : DriftModel or None
            None follows no more.

        """
        if model is not None and model.period_ns != self.grid.period_ns:
            counted = self.grid.rejected, self.grid.restarts
            self._use_period(model.period_ns)
            self.grid.rejected, self.grid.restarts = counted
        self.model, self._state, self._awaited = model, None, None
        self.origin = 'no model is live' if model is None else _NOT_YET
        self.forgot = False
        self.drift = Drift(np.zeros(len(AXES)), np.zeros(len(AXES)))
        if model is not None and self._history:
            temperature_c = np.array(self._history)
            self._state = drift_model.start(model, temperature_c[0])
            self._run(model, temperature_c)
            self.origin = f'the drift was found from {len(temperature_c)} thermal cells before'

    def memory(self, subtracted: Drift) -> ThermalMemory | None:
        """
        Tell what a restarted stream needs to go on from here.

        Parameters
        ----------
        subtracted : Drift
            What is being subtracted, arrays of shape (6,).

        Returns
        -------
        ThermalMemory or None
            None while there is nothing to go on from.

        """
        if self._awaited is not None:
            return self._awaited[0]
        if self._state is None or self.temperature_c is None:
            return None
        return ThermalMemory(
            self.end_ns,
            self.grid.period_ns,
            self.temperature_c,
            self._state,
            subtracted,
            tuple(self._blocks),
        )

    def resume(self, memory: ThermalMemory, at_least_s: float) -> None:
        """
        Go on from what another stream left, as if its last temperature had been held until now.

        The first completed cell tells how long the gap was, and what the temperature did.

        Parameters
        ----------
        memory : ThermalMemory
            Of the model that is followed (``belongs_to``).
        at_least_s : float
            How long the gap is by another clock, s; 0 when there is none.

        """
        if self.model is None:
            return
        self._awaited = memory, at_least_s
        self.timestamp_filter.expect(memory.end_ns)
        for temperature_c, count in memory.history:
            self._remember(temperature_c, count)
        # A model that is swapped in before the first temperature starts from these, too.
        self.temperature_c, self.end_ns = memory.temperature_c, memory.end_ns
        self._state, self.drift = memory.filters, memory.compensation
        cells = round(at_least_s * NANOSECONDS / memory.period_ns)
        if cells > 0:
            self._hold(self.model, memory.temperature_c, cells)
        self.origin = 'the drift saved before the restart is held until a temperature comes'
