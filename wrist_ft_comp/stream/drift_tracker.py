"""From temperatures to drift: here the model is stepped, once per thermal cell."""

from collections.abc import Sequence
import sys

import numpy as np

from wrist_ft_comp.drift import drift_model
from wrist_ft_comp.drift.drift_model import Drift, DriftModel, DriftState, no_drift
from wrist_ft_comp.signals import BoolArray, FloatArray, NANOSECONDS
from wrist_ft_comp.stream.agreement import Agreement, Offsets, Rewrite
from wrist_ft_comp.stream.gap import doubt, longest_gap_cells, starts, straight_lines
from wrist_ft_comp.stream.stream_grid import CompletedCells, ThermalGrid
from wrist_ft_comp.stream.thermal_memory import blocks_of, Distrust, OpenCells, ThermalMemory
from wrist_ft_comp.stream.timestamp_filter import TimestampFilter

#: A saved history is averaged over this time, s, so that it takes a few kilobytes.
SPAN_S = 60.0
#: Most blocks in which open cells are saved, which takes some ten kilobytes.
_MOST_OPEN_BLOCKS = 600
#: Most cells that the model runs through per temperature, so that none delays the stream for long.
#: After an outage of six hours the model has caught up with the 12th temperature.
_CELLS_AT_ONCE = 1800
#: Up to this many cells are stepped one by one, which is faster than a run.
_STEPS = 6
#: A shorter gap is not reported, s, though the model may remember less: a thermometer may be read
#: every five minutes.
_REPORTED_GAP_S = 600.0
#: Origin of the drift of a model that has seen no temperature.
_NOT_YET = 'no temperatures yet'
#: Origin of the drift of a restarted stream before its first temperature.
_HELD = 'the drift saved before the restart is held until a temperature comes'


class History:
    """Keeps the newest cells of J thermometers, ``most`` at most, as a recording would."""

    def __init__(self, thermometers: int, most: int) -> None:
        self.most = most
        self._temperature_c: FloatArray = np.zeros((0, thermometers))
        self._measured: BoolArray = np.zeros((0, thermometers), dtype=bool)
        self._end = 0

    def __len__(self) -> int:
        return min(self._end, self.most)

    @property
    def temperature_c(self) -> FloatArray:
        """°C, shape (N, J), oldest first; held since a thermometer was last heard."""
        return self._temperature_c[self._end - len(self) : self._end]

    @property
    def measured(self) -> BoolArray:
        """Which thermometers measured in which cells, shape (N, J)."""
        return self._measured[self._end - len(self) : self._end]

    def add(self, temperature_c: FloatArray, measured: Sequence[bool], count: int) -> None:
        """Add cells of the same temperatures, °C, shape (J,)."""
        count = min(count, self.most)
        if self._end + count > len(self._measured):
            kept_c, kept = self.temperature_c, self.measured
            room = 2 * self.most, len(measured)
            self._temperature_c, self._measured = np.zeros(room), np.zeros(room, dtype=bool)
            self._end = len(kept)
            self._temperature_c[: self._end], self._measured[: self._end] = kept_c, kept
        new = slice(self._end, self._end + count)
        self._temperature_c[new], self._measured[new] = temperature_c, measured
        self._end = new.stop

    def bridge(self, thermometer: int, silent: int) -> None:
        """Put the cells of a silence, which the last cell ended, on a straight line."""
        if silent and len(self) > 1:
            column = self.temperature_c[-silent - 1 :, thermometer]
            ends = np.array([0, silent + 1]), column[-2:].copy()
            column[:-1] = straight_lines(*ends, silent + 2 - len(column), len(column) - 1)


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
        #: Where the drift comes from, a sentence; it changes when the drift starts or goes on.
        self.origin = _NOT_YET
        #: Whether a thermal state could not be used after a gap.
        self.forgot = False
        self.timestamp_filter = TimestampFilter(thermometers)
        self.grid = ThermalGrid(period_ns, thermometers, patience_s)
        #: Judges the thermometers; and the offsets since one was replaced, with their age, s.
        self.agreement = Agreement(None, thermometers)
        self._offsets, self._offsets_s = Offsets(), 0.0
        #: Of the last completed cell as it was read, °C, shape (J,).
        self.reading_c: FloatArray | None = None
        self._thermometers, self._patience_s = thermometers, patience_s
        self._history_s = history_s
        #: Longest gap after which the model may continue from its state, cells.
        self._longest = sys.maxsize
        #: After the newest cell that was run; held temperatures are in it.
        self._state: DriftState | None = None
        #: Memory to continue from at the first cell, and its age by the system's clock, s.
        self._awaited: tuple[ThermalMemory, float] | None = None
        self._forget()

    def _forget(self) -> None:
        """Begin with no cells."""
        self.agreement.forget()
        self.history = History(self._thermometers, self._most_cells())
        #: The cell that comes next; None before the first.
        self._next: int | None = None
        #: For how many cells each thermometer has been silent.
        self._silent = (0,) * self._thermometers
        self._soak()

    def _soak(self) -> None:
        """Let the model start at rest with the next cell."""
        #: Number of cells at the end that are open, because a thermometer is silent in them.
        self._open = 0
        #: State before the open cells; None when the model starts at rest with the first of them.
        self._settled: DriftState | None = None
        #: Number of open cells that the state was stepped through.
        self._run_open = 0
        self._since_soaked = 0

    def _most_cells(self) -> int:
        """Count the cells that are kept, for a later model and for the longest gap."""
        most = round(self._history_s * NANOSECONDS / self.grid.period_ns)
        return max(most, 1, 0 if self.model is None else self._longest + 2)

    @property
    def following(self) -> bool:
        """Whether there is a model and its thermal state has started."""
        return self._state is not None

    @property
    def awaiting_gap(self) -> bool:
        """Whether a restarted stream still waits for the first temperatures after its gap."""
        return self._awaited is not None

    def add(self, thermometer: int, stamp_ns: int, temperature_c: float) -> list[CompletedCells]:
        """Take one temperature, °C; step the model by the cells that it completes."""
        samples = self.timestamp_filter.admit(thermometer, stamp_ns, temperature_c)
        completed = [cells for sample in samples for cells in self.grid.add(*sample)]
        for cells in completed:
            self._take(cells)
        catching_up = self._settled is not None and self._open > max(self._silent)
        if (completed or catching_up) and not self.awaiting_gap:
            self._follow(_CELLS_AT_ONCE)
        return completed

    def _take(self, cells: CompletedCells) -> None:
        """Add completed cells, and judge the gap before them."""
        gap = 0 if self._next is None else cells.first_cell - self._next
        if gap > 0 and self.temperature_c is not None:
            silent = tuple(cells_silent + gap for cells_silent in self._silent)
            held = self.temperature_c
            self._append(CompletedCells(cells.first_cell - gap, gap, held, silent))
        gap = min(gap, 0) or min(self._silent)
        if gap < 0 or (0 in cells.silent and (self._awaited or gap > self._longest)):
            self._cross(gap)
        self._append(cells)

    def _cross(self, gap: int) -> None:
        """Continue over a gap of some cells, or let the model start again after it."""
        period_s = self.grid.period_ns / NANOSECONDS
        memory, by_clock_s = self._awaited or (None, 0.0)
        self._awaited = None
        problem = doubt(gap * period_s, self._longest * period_s, by_clock_s)
        if gap > self._longest:
            self._soak()
        elif problem:  # the cells before are of another clock
            self._forget()
        if self.model is None or (0 <= gap * period_s < _REPORTED_GAP_S and not memory):
            return
        if problem:
            start = 'the drift starts at the steady state of the present temperatures'
            self.origin, self.forgot = f'{problem}; so {start}', True
        elif memory:
            before_s, self.forgot = max(gap, 0) * period_s, False
            self.origin = f'the drift goes on from the thermal state saved {before_s:.0f} s before'

    def _append(self, cells: CompletedCells) -> None:
        """Add cells as far as they are believed; bins may end in them."""
        agreement, left = self.agreement, cells.count
        self.reading_c = cells.temperature_c
        # Clocks leap by years: of a silence of all, what the model forgets is not compared.
        forgotten = 0 if any(cells.measured) else max(left - self._longest, 0)
        while left:
            count = forgotten or (min(left, agreement.room) if agreement.able else left)
            left -= count
            shape = count, self._thermometers
            believed_c, rewrite = np.broadcast_to(cells.temperature_c, shape), None
            if not forgotten:
                heard = np.broadcast_to(cells.measured, shape)
                believed_c, rewrite = agreement.add(believed_c, heard)
            forgotten = 0
            silent = [max(silent - left, 0) for silent in cells.silent]
            others = [s for j, s in enumerate(silent) if j not in agreement.replaced]
            for j in agreement.replaced:
                silent[j] = min(others)
            first = cells.first_cell + cells.count - left - count
            self._keep(CompletedCells(first, count, believed_c[-1], tuple(silent)))
            if rewrite is not None:
                self._rewrite(rewrite)

    def _keep(self, cells: CompletedCells) -> None:
        """Add cells to the history; a thermometer that was heard ends its silence."""
        self.history.add(cells.temperature_c, cells.measured, cells.count)
        for thermometer, measured in enumerate(cells.measured):
            if measured:
                self.history.bridge(thermometer, self._silent[thermometer])
        self.temperature_c, self._silent = cells.temperature_c, cells.silent
        self._next = cells.first_cell + cells.count
        self.end_ns = self._next * self.grid.period_ns
        self._offsets_s += cells.count * self.grid.period_ns / NANOSECONDS
        self._open += cells.count
        self._since_soaked += cells.count
        if max(self._silent) > self._longest:
            too_old = max(self._open - self._longest, 0)
            self._open, self._settled = self._open - too_old, None
            self._run_open = max(self._run_open - too_old, 0)

    def _rewrite(self, rewrite: Rewrite) -> None:
        """Run through the corrected history again; the drift goes on from where it is."""
        model = self.model
        assert model is not None  # noqa: S101 -- without one nothing is doubted
        self._follow(self._open)
        begin, _ = starts(self.history.measured, self._longest)[-1]
        start_c = self.history.temperature_c[begin : begin + model.start_cells]
        rested_c = drift_model.rest_c(start_c)
        rewrite.apply(self.history.temperature_c, self.history.measured)
        before, offsets, self._offsets = self.drift, self._offsets, Offsets()
        silent = list(self._silent)
        silent[rewrite.thermometer] = 0
        self._silent = tuple(silent)
        self._run_history()
        rests_c = rested_c, drift_model.rest_c(start_c)
        self._offsets = offsets.going_on(model, rests_c, before, self.drift)
        self.drift, self._offsets_s = before, 0.0

    def _run_history(self) -> None:
        """Make the state from the history."""
        self._soak()
        begin, _ = starts(self.history.measured, self._longest)[-1]
        self._open = self._since_soaked = len(self.history) - begin
        self._follow(self._open)

    def _follow(self, most: int) -> None:
        """Run the model up to the last cell, or through the next ``most`` cells."""
        model = self.model
        if model is None or not self._open or min(self._silent) > most:
            return
        cells = self.history.temperature_c[-self._open :]
        if self.origin == _NOT_YET:
            self.origin = 'the drift started at the steady state of the first temperatures'
        settled = self._open - max(self._silent)
        can_settle = settled >= (model.start_cells if self._settled is None else 1)
        if self._settled is None and self._open <= model.start_cells:
            self._run_open = 0  # the mean that it started at has changed
        if can_settle or not self._run_open:
            from_rest = self._settled is None
            self._state = drift_model.at_rest(model, cells) if from_rest else self._settled
        drift = None
        if can_settle:
            settled = min(settled, most)
            drift = self._run(model, cells[:settled])
            self._settled = self._state
            self._open, self._run_open = self._open - settled, 0
            cells, most = cells[settled:], most - settled
        cells = cells[self._run_open :][:most]
        if len(cells):
            drift = self._run(model, cells)
            self._run_open += len(cells)
        if drift is not None and self._run_open == self._open:
            self.drift = self._offsets.on(drift, self._offsets_s)

    def _run(self, model: DriftModel, temperature_c: FloatArray) -> Drift:
        """Step the state through cells, shape (N, J), N > 0; give the drift of the last one."""
        assert self._state is not None  # noqa: S101 -- for mypy
        if len(temperature_c) > _STEPS:
            self._state, last = drift_model.run(model, self._state, temperature_c, last_only=True)
            return Drift(last.zero[0], last.sensitivity[0])
        for cell_c in temperature_c:
            self._state, drift = drift_model.step(model, self._state, cell_c)
        return drift

    def use(self, model: DriftModel | None) -> None:
        """Follow another model, whose state is made from the history; None follows none."""
        if model is not None and model.period_ns != self.grid.period_ns:
            counted = self.grid.rejected, self.grid.restarts, self.grid.spikes
            self.grid = ThermalGrid(model.period_ns, self._thermometers, self._patience_s)
            self.grid.rejected, self.grid.restarts, self.grid.spikes = counted
            self._forget()
        self.model, self._state, self._awaited = model, None, None
        self._longest = sys.maxsize if model is None else longest_gap_cells(model)
        self.history.most = self._most_cells()
        self.origin = 'no model is live' if model is None else _NOT_YET
        self.forgot = False
        self.drift = no_drift()
        self._soak()
        self._offsets, self.agreement = Offsets(), Agreement(model, self._thermometers)
        if model is not None and len(self.history):
            self.agreement.replay(self.history.temperature_c, self.history.measured)
            self._run_history()
            self.origin = f'the drift was found from {self._since_soaked} thermal cells before'

    def memory(self, compensation: Drift) -> ThermalMemory | None:
        """Give what a restarted stream needs to continue; None before there is a state."""
        if self._awaited is not None:
            return self._awaited[0]
        if self._state is None or self.temperature_c is None:
            return None
        # Cells at the end without any sample are a gap for the stream that continues.
        unheard, period_ns = min(self._silent), self.grid.period_ns
        cells = self.history.temperature_c[-self._since_soaked :]
        cells = cells[: max(len(cells) - unheard, 0)]
        end = len(cells) - max(self._open - unheard, 0)
        open_cells = None
        if end < len(cells):
            open_cells = OpenCells(
                self._settled is None,
                tuple(silent - unheard for silent in self._silent),
                blocks_of(cells[end:], -(-(len(cells) - end) // _MOST_OPEN_BLOCKS)),
            )
        history = blocks_of(cells[:end], max(round(SPAN_S * NANOSECONDS / period_ns), 1))
        filters = self._state if self._settled is None else self._settled
        stamps = self.end_ns - unheard * period_ns, period_ns
        return ThermalMemory(
            *stamps, self.temperature_c, filters, compensation, history, open_cells,
            self._distrust(),
        )  # fmt: skip

    def _distrust(self) -> Distrust | None:
        """Give what a restart needs of replaced thermometers; None where none ever was."""
        offsets, replaced = self._offsets.after(self._offsets_s), self.agreement.replaced
        if not (replaced or offsets.kept.any() or offsets.released.any()):
            return None
        return Distrust({str(j + 1): why for j, why in replaced.items()}, **vars(offsets))

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
        later = memory.open_cells or OpenCells(False, self._silent, ())
        for temperature_c, count in (*memory.history, *later.blocks):
            self.history.add(temperature_c, (True,) * self._thermometers, count)
        self._open = min(sum(block.cells for block in later.blocks), len(self.history))
        self._settled = None if later.from_rest else memory.filters
        self._silent, self._since_soaked = later.silent, len(self.history)
        if memory.distrust is not None:
            named = memory.distrust.replaced
            self.agreement.replaced = {int(number) - 1: why for number, why in named.items()}
            self._offsets = Offsets(memory.distrust.kept, memory.distrust.released)
            self._offsets_s = 0.0
        self.agreement.replay(self.history.temperature_c, self.history.measured)
        self._next = memory.end_ns // memory.period_ns
        self.grid.go_on(self._next, memory.temperature_c.tolist(), later.silent)
        self.temperature_c, self.end_ns = memory.temperature_c, memory.end_ns
        self.reading_c = memory.temperature_c
        self._state = memory.filters
        self._follow(self._open)
        self.drift = memory.compensation
        longest_s = self._longest * memory.period_ns / NANOSECONDS
        if problem := doubt(max(by_clock_s, 0.0), longest_s, by_clock_s):
            self.origin, self.forgot = f'{problem}; {_HELD}', True
            return
        cells = round(by_clock_s * NANOSECONDS / memory.period_ns)
        if cells > 0:
            held = np.tile(memory.temperature_c, (cells, 1))
            ended = drift_model.run(self.model, self._state, held, last_only=True)[1]
            ended = Drift(ended.zero[0], ended.sensitivity[0])
            self.drift = self._offsets.on(ended, by_clock_s)
        self.origin = _HELD
