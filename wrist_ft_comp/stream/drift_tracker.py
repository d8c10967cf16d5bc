"""From temperatures to drift: here the model is stepped, once per thermal cell."""

import numpy as np

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.drift import drift_model
from wrist_ft_comp.drift.drift_model import Drift, DriftModel, DriftState, no_drift
from wrist_ft_comp.series import BoolArray, FloatArray, NANOSECONDS
from wrist_ft_comp.stream import (
    drift_uncertainty,
    exchanged_thermometers,
    failed_thermometers,
    gaps_and_restarts,
)
from wrist_ft_comp.stream.clock import Leap, Sample, SourceClocks
from wrist_ft_comp.stream.drift_uncertainty import span_cells, SPAN_S, Uncertainty
from wrist_ft_comp.stream.failed_thermometers import ThermometerState
from wrist_ft_comp.stream.gaps_and_restarts import ThermalMemory, why_forgotten
from wrist_ft_comp.stream.temperature_jumps import FASTEST_K_S, Jump, JUMP_K, SpikeFilter
from wrist_ft_comp.stream.thermal_cells import ThermalCell, ThermalGrid

#: A shorter gap is not reported, s, though the model may remember less: a thermometer may be read
#: every five minutes.
_REPORTED_GAP_S = 600.0
#: What one of several thermometers missed while it was silent for longer is remembered, s.
_SILENT_S = 60.0
#: Origin of the drift of a model that has seen no temperature.
_NOT_YET = 'no temperatures yet'
#: Origin of the drift of a restarted stream before its first temperature.
_HELD = 'the drift saved before the restart is held until a temperature comes'
_STARTS_ANEW = 'so the drift starts at the steady state of the present temperatures'


class DriftTracker:
    """Follows the temperatures with a model, cell by cell; a model brings its own period."""

    def __init__(self, thermometers: int, period_ns: int, patience_s: float) -> None:
        self.model: DriftModel | None = None
        #: For how long the model remembers a temperature, s.
        self.memory_s = gaps_and_restarts.longest_gap_s(None)
        #: What was read in the last completed cell, °C, (J,).
        self.reading_c: FloatArray | None = None
        #: Where the last completed cell ended, ns.
        self.end_ns = 0
        #: What the model says now, arrays of shape (6,).
        self.drift = no_drift()
        #: Where the drift comes from, a sentence; it changes when the drift starts or goes on.
        self.origin = _NOT_YET
        #: Whether a thermal state could not be used after a gap, or was of wrong readings.
        self.forgot = False
        self.clocks = SourceClocks(thermometers)
        #: Of each thermometer.
        self.spikes = [SpikeFilter() for _ in range(thermometers)]
        self.grid = ThermalGrid(period_ns, thermometers, patience_s)
        #: What is known of the thermometers; None where the model does not predict them.
        self.thermometers: ThermometerState | None = None
        #: What is said of pairs that are exchanged, by their numbers, from 0.
        self._exchanged: dict[tuple[int, int], str] = {}
        #: How many there are, and for how long one may be silent, s.
        self._count, self.patience_s = thermometers, patience_s
        #: After the newest cell that was run; None before there are a model and a temperature.
        self.state: DriftState | None = None
        #: Memory to continue from at the first cell, and its age by the system's clock, s; None
        #: when that has come, or where no other stream was before.
        self.awaited: tuple[ThermalMemory, float] | None = None
        self._forget()

    def _forget(self) -> None:
        """Let the sensor have soaked at the temperatures of the next cell."""
        #: The newest cells, as they were believed, °C, (n, J), for a model that goes live later.
        self.history_c: FloatArray = np.zeros((0, self._count))
        #: Which of these nobody measured, because of a gap.
        self._missing: BoolArray = np.zeros(0, dtype=bool)
        #: The cell that comes next; None before the first.
        self._next: int | None = None
        #: The cells that the model starts from, °C, (n, J).
        self._start_c: FloatArray = self.history_c
        #: How far the drift may be off, because temperatures were missing, or warm at the start.
        self.uncertainty: Uncertainty | None = None

    @property
    def temperature_c(self) -> FloatArray | None:
        """What the drift follows, of the last completed cell, °C, (J,)."""
        return self.reading_c if self.thermometers is None else self.thermometers.believed_c

    @property
    def replaced(self) -> list[int]:
        """Which thermometers are replaced by their predictions, counted from 0."""
        state = self.thermometers
        return [] if state is None else np.flatnonzero(state.replaced).tolist()

    @property
    def thermometer_doubts(self) -> list[str]:
        """Say which thermometers are replaced and why, and which are exchanged."""
        state = self.thermometers
        return [] if state is None else state.sentences + list(self._exchanged.values())

    def add(self, sample: Sample) -> list[ThermalCell]:
        """Take one temperature; step the model by the cells that it completes."""
        samples = self.clocks.admit(sample)
        if self.clocks.leap is not None:
            self._follow_clock(self.clocks.leap)
        completed = []
        for source, at_ns, value_c, _ in samples:
            spikes = self.spikes[source]
            wrong_starts = spikes.wrong_starts
            if not spikes.admit(at_ns, value_c):
                continue
            if spikes.wrong_starts > wrong_starts:
                self._forget()
                self.grid.hold_before(at_ns // self.grid.period_ns)
                if self.state is not None:
                    self.forgot = True
                    self.origin = (
                        f'the first readings of thermometer {source + 1}, such as '
                        f'{spikes.strange_c:.1f} °C, were wrong; {_STARTS_ANEW}'
                    )
            if spikes.went_back is not None:
                self._doubt_loose(source, *spikes.went_back)
                spikes.went_back = None
            for cell in self.grid.add(source, at_ns, value_c):
                self._take(cell)
                completed.append(cell)
        return completed

    def _doubt_loose(self, source: int, off_k: float, lasted_s: float) -> None:
        """Doubt the drift by what the model remembers of a thermometer that was loose."""
        if self.model is not None and len(self.history_c):
            read_c = self.history_c[-max(round(lasted_s * NANOSECONDS / self.grid.period_ns), 1) :]
            true_c = read_c - off_k * np.eye(self._count)[source]
            self._doubt(drift_uncertainty.doubt_read(self.model, read_c, true_c, true_c[-1]))

    def _doubt(self, off: FloatArray) -> None:
        """Take that the drift may be off by more, N and N m, (6,)."""
        if off.any():
            if self.uncertainty is not None:
                off = off + self.uncertainty.left(self.end_ns, self.memory_s)
            self.uncertainty = Uncertainty(self.end_ns, off)

    def effect(self, off_k: FloatArray) -> FloatArray:
        """How far temperatures that are off, K, (J,), move the drift in the end, N, N m, (6,)."""
        if self.model is None or self.temperature_c is None:
            return np.zeros(len(AXES))
        right, wrong = (
            drift_model.step(self.model, drift_model.start(self.model, celsius), celsius)[1].zero
            for celsius in (self.temperature_c, self.temperature_c + off_k)
        )
        return np.abs(wrong - right)

    def _follow_clock(self, leap: Leap) -> None:
        """Go on where the clock does: what is remembered moves along if it is known how far."""
        period_ns = self.grid.period_ns
        cell = leap.to_ns // period_ns
        if leap.passed_ns is not None:
            cells = cell - leap.from_ns // period_ns - leap.passed_ns // period_ns
            for spikes in self.spikes:
                spikes.move_clock(cells * period_ns)
            if self._next is not None:
                self._next += cells
                self.end_ns += cells * period_ns
                cell = self._next
                if self.uncertainty is not None:
                    since_ns = self.uncertainty.since_ns + cells * period_ns
                    self.uncertainty = self.uncertainty._replace(since_ns=since_ns)
        self.grid.move_to(cell)

    def _take(self, cell: ThermalCell) -> None:
        period_s = self.grid.period_ns / NANOSECONDS
        gap = 0 if self._next is None else cell.number - self._next
        gap_s, history_c, state_before = gap * period_s, self.history_c, self.state
        why = self._stood_still(cell, gap_s) if self.awaited else ''
        allowed_s = 0.0 if self.awaited else self.patience_s
        moved_k = np.nan if self.reading_c is None else cell.temperature_c - self.reading_c
        # In a silence that is allowed, thermometers that report on change move by a step.
        longest_s = max(self.memory_s, allowed_s * bool((np.abs(moved_k) < JUMP_K).all()))
        goes_on = self._goes_on(gap_s, longest_s, why) if gap or self.awaited else True
        gap_s = 2.0 * self.memory_s if why else gap_s
        # A pause of thermometers that report seldom, or that is allowed, is none.
        usual_s = 2 * period_s * max(map(self.grid.spacing, range(self._count)))
        is_long = gap_s > max(gaps_and_restarts.LEAST_GAP_S, usual_s, allowed_s)
        is_doubtful = not goes_on or is_long
        gap = max(gap, 0) if goes_on else 0

        if gap_s > 0 and self.reading_c is not None:
            after = cell.number * self.grid.period_ns, cell.temperature_c
            exchanged_thermometers.note_exchange(self.spikes, (self.end_ns, self.reading_c), after)

        before_c = self.temperature_c
        believed_c, off = self._believe(cell, gap * period_s, usual_s, history_c)

        # Run the model through the gap, on a straight line, and through the cell.
        line_c = believed_c[np.newaxis]
        if gap and before_c is not None:
            line_c = np.linspace(before_c, believed_c, gap + 2)[1:].astype(float)
        missing = is_long & (np.arange(len(line_c)) < len(line_c) - 1)
        most = max(round(gaps_and_restarts.MOST_GAP_S / period_s), 1)
        self.history_c = np.concatenate((self.history_c, line_c))[-most:]
        self._missing = np.concatenate((self._missing, missing))[-most:]
        self._next = cell.number + 1
        self.end_ns = self._next * self.grid.period_ns
        if (model := self.model) is None:
            return
        self._run(model, line_c)

        # The model remembers what nobody knows of a gap, and of the time before the start.
        # After longer gaps than it remembers, such as nights, a sensor as cold as a room soaked.
        if gap_s > longest_s:
            is_doubtful = bool((believed_c > drift_uncertainty.warmest_room_c(model)).any())
        if is_doubtful and state_before is not None and len(history_c):
            bounds = drift_uncertainty.bound_drift(
                model, state_before, history_c, believed_c, gap_s, self.memory_s
            )
            off = off + np.abs(bounds - self.drift.zero).max(axis=0)
        off = off + self._off_at_start(model, len(self.history_c) - len(line_c))
        self._doubt(off + self._off_behind_gap(model, len(line_c)))

    def _believe(
        self, cell: ThermalCell, gap_s: float, usual_s: float, history_c: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """
        Decide which thermometers are believed in a cell; the others are predicted.

        Gives the temperatures, °C, (J,), and how far the model's memory of what was predicted, and
        of what thermometers missed that were silent, puts the drift off, N and N m, (6,).
        """
        model, believed_c = self.model, cell.temperature_c
        prediction = None if model is None else model.prediction
        off: FloatArray = np.zeros(len(AXES))
        if model is not None and prediction is not None:
            state, period_s = self.thermometers, model.period_ns / NANOSECONDS
            if state is None or self._next is None:
                state = failed_thermometers.start(prediction, believed_c, state)
            now = self.thermometers = failed_thermometers.step(
                prediction, state, believed_c, cell.measured, period_s, gap_s, model.stands_s
            )
            self._exchanged = exchanged_thermometers.exchanged(prediction, now, self._exchanged)
            believed_c = now.believed_c
            for spikes, is_replaced in zip(self.spikes, now.replaced.tolist(), strict=True):
                spikes.replace(self.end_ns, is_replaced=is_replaced)
            if (believed_again := state.replaced & ~now.replaced).any():
                agreed_k = np.where(believed_again, prediction.agree_k, 0.0)
                off = off + self.effect(agreed_k)
            # The last value of one that was silent, or seemed frozen, was held, while it moved.
            held_s = np.where(state.suspicious(prediction, 0.5), state.still_s, state.silent_s)
            silent_s = np.where(cell.measured & ~state.replaced, held_s, 0.0)
            is_back = silent_s > max(_SILENT_S, usual_s)
            missed_k = np.where(is_back, cell.temperature_c - state.reading_c, 0.0)
            if missed_k.any() and len(history_c):
                held_c = history_c[-round(float(silent_s.max()) / period_s) :]
                line_c = held_c + np.linspace(0.0, missed_k, len(held_c))
                off = off + drift_uncertainty.doubt_read(model, held_c, line_c, believed_c)
        exchanged_thermometers.end_exchange(
            self.spikes, prediction, self.thermometers, self.end_ns
        )
        self.reading_c = cell.temperature_c
        return believed_c, off

    def _off_at_start(self, model: DriftModel, cells_before: int) -> FloatArray:
        """Bound what the start left wrong of the drift, once SPAN_S has come; else 0, (6,)."""
        if not cells_before < span_cells(model) <= len(self.history_c):
            return np.zeros(len(AXES))
        known_k = None if self.uncertainty is None else np.zeros(self._count)
        return drift_uncertainty.doubt_start(model, self.history_c, self.memory_s, known_k)

    def _off_behind_gap(self, model: DriftModel, cells: int) -> FloatArray:
        """Bound the drift where temperatures move otherwise after a gap than in it; else 0."""
        edges = np.flatnonzero(np.diff(self._missing, prepend=False, append=False))
        if not len(edges):
            return np.zeros(len(AXES))
        begin, end = edges[-2:].tolist()
        since = len(self.history_c) - end
        if not since - cells < span_cells(model) <= since:
            return np.zeros(len(AXES))
        slope_k = self.history_c[end] - self.history_c[end - 1]
        gap_s = (end - begin) * model.period_ns / NANOSECONDS
        behind_c = self.history_c[end:]
        return drift_uncertainty.doubt_start(model, behind_c, min(gap_s, self.memory_s), slope_k)

    def _stood_still(self, cell: ThermalCell, gap_s: float) -> str:
        """Say that clocks stood still in a gap: all temperatures moved farther than they can."""
        period_s = self.grid.period_ns / NANOSECONDS
        span = max(round(SPAN_S / period_s), 1)
        if self.reading_c is None or gap_s <= 0 or len(self.history_c) <= span:
            return ''
        seen_k_s = np.abs(self.history_c[span:] - self.history_c[:-span]).max(axis=0)
        seen_k_s = seen_k_s / (span * period_s)
        most_k = JUMP_K + np.maximum(seen_k_s, FASTEST_K_S) * gap_s
        if (np.abs(cell.temperature_c - self.reading_c) <= most_k).any():
            return ''
        return f'all temperatures changed faster in {gap_s:.0f} s than ever: clocks stood still'

    def _goes_on(self, gap_s: float, longest_s: float, why: str) -> bool:
        """Decide whether the drift goes on over a gap, or not, as ``why`` says; say so."""
        memory, by_clock_s = self.awaited or (None, 0.0)
        self.awaited = None
        cell_s = self.grid.period_ns / NANOSECONDS
        problem = why_forgotten(gap_s, longest_s, by_clock_s, cell_s) or why
        if problem:
            self._forget()
            if self.model is not None and (memory or not 0 <= gap_s < _REPORTED_GAP_S):
                self.origin, self.forgot = f'{problem}; {_STARTS_ANEW}', True
        elif memory:
            before_s, self.forgot = max(gap_s, 0.0), False
            self.origin = f'the drift goes on from the thermal state saved {before_s:.0f} s before'
        return not problem

    def _run(self, model: DriftModel, cells_c: FloatArray) -> None:
        if self.origin == _NOT_YET:
            self.origin = 'the drift started at the steady state of the first temperatures'
        if self.state is None or len(self._start_c) < model.start_cells:
            # The start is run again with every cell of it, from the mean of those that have come.
            cells_c = np.concatenate((self._start_c, cells_c))
            self._start_c = cells_c[: model.start_cells]
            self.state = drift_model.at_rest(model, self._start_c)
        self.state, self.drift = drift_model.run_to_end(model, self.state, cells_c)

    def use(self, model: DriftModel | None) -> None:
        """Follow another model, whose state is made from the history; None follows none."""
        if model is not None and model.period_ns != self.grid.period_ns:
            old, before_ns = self.grid, self.grid.period_ns
            self.grid = ThermalGrid(model.period_ns, self._count, self.patience_s)
            # The history is read at the middles of the new cells.
            begin_ns = self.end_ns - len(self.history_c) * before_ns
            cells = np.arange(-(-begin_ns // model.period_ns), self.end_ns // model.period_ns)
            at = (cells * model.period_ns + model.period_ns // 2 - begin_ns) // before_ns
            self.history_c, self._missing = self.history_c[at], self._missing[at]
            if self._next is not None and self.reading_c is not None:  # a dead one never comes
                silent = [n * before_ns // model.period_ns for n in old.silent(self._next)]
                self._next = self.end_ns // model.period_ns
                self.end_ns = self._next * model.period_ns
                self.grid.go_on(self._next, self.reading_c.tolist(), silent)
        self.model, self.state, self.awaited, self._exchanged = model, None, None, {}
        self.memory_s = gaps_and_restarts.longest_gap_s(model)
        self.origin, self.forgot = 'no model is live' if model is None else _NOT_YET, False
        self.drift = no_drift()
        self._start_c = np.zeros((0, self._count))
        if model is not None and len(self.history_c):
            self._run(model, self.history_c)
            self.origin = f'the drift was found from {len(self.history_c)} thermal cells before'
            begun_ns = self.end_ns - len(self.history_c) * model.period_ns
            known, self.uncertainty = self.uncertainty, None
            off = self._off_at_start(model, 0)
            begun = Uncertainty(begun_ns + span_cells(model) * model.period_ns, off)
            self.uncertainty = begun if off.any() else known
            if off.any() and known is not None:  # as a quicker model saw it
                both = (one.left(self.end_ns, self.memory_s) for one in (known, begun))
                self.uncertainty = Uncertainty(self.end_ns, np.maximum(*both))
        before, prediction = self.thermometers, None if model is None else model.prediction
        if prediction is None:
            self.thermometers = None
        elif before is not None and len(prediction.time_constants_s) != len(before.relaxed_c):
            self.thermometers = failed_thermometers.start(prediction, before.reading_c, before)

    def memory(self, compensation: Drift) -> ThermalMemory | None:
        """Give what a restarted stream needs to continue; None before there is a state."""
        if self.awaited is not None:
            return self.awaited[0]
        if self.state is None or self.reading_c is None:
            return None
        period_ns = self.grid.period_ns
        return ThermalMemory(
            self.end_ns, period_ns, self.reading_c, self.grid.silent(self.end_ns // period_ns),
            self.state, compensation, self._start_c,
            gaps_and_restarts.blocks_of(self.history_c, period_ns), self.thermometers,
            self.uncertainty, tuple(spikes.jump for spikes in self.spikes))  # fmt: skip

    def resume(self, memory: ThermalMemory, by_clock_s: float) -> None:
        """
        Continue from the memory of another stream; until the first cell, what it subtracted stays.

        The memory has to belong to this model (``belongs_to``). The gap is ``by_clock_s`` long by
        the system's clock, 0 without one. The first completed cell shows how long it was, and how
        the temperature changed.
        """
        self.awaited = memory, by_clock_s
        self.clocks.expect(memory.end_ns)
        blocks = [np.tile(temperature_c, (cells, 1)) for temperature_c, cells in memory.history]
        self.history_c = np.concatenate((self.history_c, *blocks))
        self._missing = np.zeros(len(self.history_c), dtype=bool)
        self._next = memory.end_ns // memory.period_ns
        self.grid.go_on(self._next, memory.temperature_c.tolist(), memory.silent)
        jumps = memory.jumps or (Jump(),) * self._count
        for spikes, value_c, cells, jump in zip(
            self.spikes, memory.temperature_c.tolist(), memory.silent, jumps, strict=True
        ):
            spikes.go_on(memory.end_ns - cells * memory.period_ns - 1, value_c, jump)
        self.reading_c = memory.temperature_c
        self.thermometers, self.uncertainty = memory.thermometers, memory.uncertainty
        self.end_ns, self._start_c = memory.end_ns, memory.start_c
        self.state, self.drift = memory.filters, memory.compensation
        problem = why_forgotten(max(by_clock_s, 0.0), self.memory_s)
        self.origin, self.forgot = f'{problem}; {_HELD}' if problem else _HELD, bool(problem)
