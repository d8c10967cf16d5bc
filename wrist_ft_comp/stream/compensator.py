"""Corrects a stream of wrenches: drift, limits and tare. No wrench changes the next one."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from wrist_ft_comp.channels import AXES, axis_unit
from wrist_ft_comp.drift.drift_model import check_fits, Drift, DriftModel, no_drift
from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.ranges import check_range, PERIODS_S
from wrist_ft_comp.series import FloatArray, NANOSECONDS
from wrist_ft_comp.stream import thermometer_faults
from wrist_ft_comp.stream.clock import Sample
from wrist_ft_comp.stream.drift_tracker import DriftTracker
from wrist_ft_comp.stream.limits import axis_limits, Limits
from wrist_ft_comp.stream.live_cells import ThermalCell
from wrist_ft_comp.stream.thermal_memory import ThermalMemory

#: A tare holds what drifted between it and the first temperature; said from this time on, s.
_LATE_TEMPERATURE_S = 30.0
#: A tare jumps to the end of a ramp that moves the drift by more than this, N.
_RAMP_N = 0.1
#: Drift that may be off by fewer standard deviations of the model than this is not doubted.
_CERTAIN = 3.0

#: Stamp, ns, and raw values, N and N m, axis order AXES.
Wrench = tuple[int, Sequence[float]]


@dataclass(frozen=True)
class StreamSettings:
    """What a person chose about the stream."""

    #: Cell length h while there is no model, s; a model brings its own.
    thermal_period_s: float = 1.0
    #: How long a thermometer may be silent before its last value is held and a warning is due, s.
    temperature_timeout_s: float = 5.0
    #: Largest zero drift that is subtracted from a force, N; from a torque, a tenth of it in N m.
    max_drift_n: float = 200.0
    #: How fast that drift may change, N/s; of a torque, a tenth of it in N m/s.
    max_drift_rate_n_s: float = 1.0

    def __post_init__(self) -> None:
        check_range('thermal_period_s', self.thermal_period_s, *PERIODS_S)
        check_range('max_drift_n', self.max_drift_n, 0.0)
        for name in ('temperature_timeout_s', 'max_drift_rate_n_s'):
            check_range(name, getattr(self, name), 0.0, above=True)


class Compensator:
    """
    Owns the drift tracker, the limits, the ramp and the tare of a sensor with J thermometers.

    Without a model, wrenches pass through, tared, until ``go_live``.
    """

    def __init__(
        self,
        thermometers: int,
        settings: StreamSettings | None = None,
        model: DriftModel | None = None,
    ) -> None:
        self.settings = settings = settings or StreamSettings()
        self.thermometers = thermometers
        period_ns = round(settings.thermal_period_s * NANOSECONDS)
        self.tracker = DriftTracker(thermometers, period_ns, settings.temperature_timeout_s)
        self.limits = Limits(settings.max_drift_n, settings.max_drift_rate_n_s)
        #: Of the wrench, and of the external wrench; raw, N and N m, shape (6,).
        self.tare: FloatArray = np.zeros(len(AXES))
        self.external_tare: FloatArray = np.zeros(len(AXES))
        #: Whether somebody tared; else a tare is what keeps the output at a change of model.
        self.tared = False
        #: What has been said since the last tare on why the zero may have moved.
        self._said: list[str] = []
        #: What is subtracted at the end of the present ramp, which lasts one cell: the drift of
        #: the model, within the limits.
        self.compensation = no_drift()
        #: What is subtracted at the beginning of the ramp, and its stamp, ns.
        self._begun, self._begun_ns = self.compensation, 0
        #: How long the present ramp lasts, ns, and where one of a seldom report is to end.
        self._ramp_ns, self._end_ns = period_ns, 0
        #: How far the last report of each thermometer moved the drift, N and N m, (6,).
        self._moves: dict[int, FloatArray] = {}
        #: When a tare was taken before the drift begins: it takes up the drift then, so that the
        #: output stays. None where none waits, -inf before a restart; inf where there is no tare,
        #: but a model that was changed.
        self._waits_since_ns: float | None = None
        self._refresh_correction()
        if model is not None:
            self.go_live(model)

    @property
    def model(self) -> DriftModel | None:
        """The live model."""
        return self.tracker.model

    @property
    def _memory_s(self) -> float:
        """For how long the model remembers a temperature, s; 0 without one."""
        return 0.0 if self.model is None else self.tracker.memory_s

    @property
    def compensating(self) -> bool:
        """Whether there is a model and its thermal state has started."""
        return self.tracker.state is not None

    @property
    def zero_doubts(self) -> list[str]:
        """Sentences on what has happened since the last tare that may have moved the zero."""
        return self._said + self._jumps()

    def _jumps(self) -> list[str]:
        time_ns, memory_s = self.tracker.end_ns, self._memory_s
        doubts = [spikes.doubt(time_ns, memory_s) for spikes in self.tracker.spikes]
        return [f'thermometer {j} {doubt}' for j, doubt in enumerate(doubts, 1) if doubt]

    def add_temperature(
        self,
        thermometer: int,
        stamp_ns: int,
        temperature_c: float,
        keep_output_of: Wrench | None = None,
        arrival_ns: int | None = None,
    ) -> list[ThermalCell]:
        """
        Take one temperature of a thermometer, counted from 0; give the cells that it completes.

        The compensation has moved when there are any. Where the drift begins under a tare or after
        a change of the model, the output of the newest wrench, ``keep_output_of``, stays: the tare
        takes the difference up. Arrival, ns, by a clock that is never set, shows how much time
        passed where that of the stamps was. SettingsError without such a thermometer.
        """
        if not 0 <= thermometer < self.thermometers:
            last = self.thermometers - 1
            raise SettingsError(f'Thermometers are counted from 0 to {last}; got {thermometer}.')
        had_drift = self.compensating
        cells = self.tracker.add(Sample(thermometer, stamp_ns, temperature_c, arrival_ns))
        if not cells or not self.compensating:
            return cells
        target = self.limits.saturate(self.tracker.drift)
        since_ns, self._waits_since_ns = self._waits_since_ns, None
        if since_ns is not None:
            self._doubt_tare_before_drift(since_ns, stamp_ns, 'temperatures came')
            unloaded = stamp_ns, [np.nan] * len(AXES)  # where no wrench has come
            self._settle(target, keep_output_of or unloaded)
        elif not had_drift:
            self._settle(target, None)
        self._begun, self._begun_ns = self.compensation_at(stamp_ns), stamp_ns
        # The ramp lasts a cell, or until a thermometer that reports seldom does so again.
        grid = self.tracker.grid
        spacings_ns = [grid.spacing(j) * grid.period_ns for j in range(self.thermometers)]
        for j, spacing_ns in enumerate(spacings_ns):
            if any(cell.measured[j] for cell in cells):
                self._moves[j] = np.abs(target.zero - self._begun.zero)
                if spacing_ns > grid.period_ns:
                    self._end_ns = stamp_ns + spacing_ns
        self._ramp_ns = max(grid.period_ns, min(self._end_ns - stamp_ns, max(spacings_ns)))
        ramp_s = self._ramp_ns / NANOSECONDS
        self.compensation = self.limits.rate_limit(target, self._begun, ramp_s)
        self._refresh_correction()
        return cells

    def correct(
        self, stamp_ns: int, raw: Sequence[float], *, external: bool = False
    ) -> list[float]:
        """
        Correct one wrench: ŵ = (r - o - tare) / (1 + s); without a model, r - tare.

        The external one has a tare of its own, and still the payload's weight in it.
        """
        share = self._share(stamp_ns)
        return [
            (r - offset - share * step) / (gain + share * gain_step)
            # Six by six: a strict zip would cost a tenth of all this.
            for r, (offset, step, gain, gain_step) in zip(  # noqa: B905
                raw, self._external if external else self._correction
            )
        ]

    def compensation_at(self, stamp_ns: int) -> Drift:
        """Compute what is subtracted at a stamp, ns, arrays of shape (6,)."""
        share, ends = self._share(stamp_ns), zip(self._begun, self.compensation, strict=True)
        return Drift(*(before + share * (after - before) for before, after in ends))

    def go_live(self, model: DriftModel | None, keep_output_of: Wrench | None = None) -> None:
        """
        Swap a model in, with a state made from the kept temperatures; None stops compensating.

        The output of the newest wrench, ``keep_output_of``, stays where it was: the tare takes up
        the difference of the drifts. SettingsError when the model is for another number of
        thermometers, ModelFileError when it is in another unit; the running model stays then.
        """
        if model is not None:
            check_fits(model, self.thermometers)
        self.tracker.use(model)
        if self._waits_since_ns is not None and self.compensating:
            begun_ns = self.tracker.end_ns
            self._doubt_tare_before_drift(self._waits_since_ns, begun_ns, 'model went live')
        if keep_output_of is None or self.compensating:
            self._waits_since_ns = None
        elif self._waits_since_ns is None:
            self._waits_since_ns = math.inf
        self._settle(self.limits.saturate(self.tracker.drift), keep_output_of)

    def set_tare(
        self, raw: FloatArray, stamp_ns: int, weight: FloatArray | None = None
    ) -> FloatArray:
        """
        Make a mean raw wrench, shape (6,), of a time read zero; give raw minus zero drift.

        The external wrench reads zero, too: of a sensor that carries the payload's mean weight,
        N and N m, or nothing.
        """
        drift, target = self.compensation_at(stamp_ns), self.limits.saturate(self.tracker.drift)
        if (np.abs(target.zero - drift.zero) > axis_limits(_RAMP_N)).any():
            # As after a night: later, the output would move by the rest of the ramp.
            self._settle(target, None)
            drift = target
        self.tare = np.nan_to_num(raw - drift.zero)  # axes that the sensor has not
        carried = np.zeros(len(AXES)) if weight is None else weight
        self.external_tare = self.tare - (1.0 + drift.sensitivity) * carried
        self.tared = True
        self._forget_doubts()
        # A drift that is held, as no temperature comes, is none to tare with.
        grid, held_ns = self.tracker.grid, stamp_ns - self.tracker.end_ns
        usual_ns = [
            max(_LATE_TEMPERATURE_S * NANOSECONDS, 2 * grid.period_ns * grid.spacing(j))
            for j in range(self.thermometers)
        ]
        is_held = held_ns > max(usual_ns)
        has_drift = self.compensating and self.tracker.awaited is None and not is_held
        self._waits_since_ns = None if has_drift else stamp_ns
        silent = grid.silent(self.tracker.end_ns // grid.period_ns) if has_drift else ()
        for j, cells in enumerate(silent):
            if cells * grid.period_ns > usual_ns[j] and j not in self.tracker.replaced:
                self.doubt_zero(
                    f'the tare was taken while thermometer {j + 1} was silent, and holds what '
                    'drifted since; call ~/tare when it reports'
                )
        for j, spikes in enumerate(self.tracker.spikes, start=1):
            if wait_s := spikes.remembered_s(self.tracker.end_ns, self._memory_s):
                self.doubt_zero(
                    f'the tare was taken while the model remembers that thermometer {j} jumped; '
                    f'tare again in {wait_s / 60:.0f} min'
                )
        if self.gap_doubts() or self.frozen_doubts():
            self.doubt_zero(
                'the tare was taken while the thermal state was uncertain; call ~/tare when the '
                'status temperature is OK'
            )
        self._refresh_correction()
        return self.tare

    def gap_doubts(self) -> list[str]:
        """Say how far the drift may be off, because temperatures were missing."""
        uncertainty, tracker = self.tracker.uncertainty, self.tracker
        if uncertainty is None:
            return []
        worst = self._doubt(uncertainty.left(tracker.end_ns, tracker.memory_s), _CERTAIN)
        sentence = (
            'the thermal state is uncertain, because temperatures moved at the start, were '
            f'missing, or their clock was set: {worst} off, and less and less from now on'
        )
        return [sentence] if worst else []

    def frozen_doubts(self) -> list[str]:
        """Say which thermometers may be frozen, and how far the drift is off then."""
        tracker, sentences = self.tracker, list[str]()
        state, prediction = tracker.thermometers, None
        if self.model is not None:
            prediction = self.model.prediction
        if state is None or prediction is None:
            period_ns = tracker.grid.period_ns
            silent = tracker.grid.silent(tracker.end_ns // period_ns)
            for j, readings_c in enumerate(tracker.history_c.T):
                still_s = thermometer_faults.too_still_s(readings_c, period_ns / NANOSECONDS)
                if still_s and not silent[j]:
                    sentences.append(
                        f'thermometer {j + 1} has read the same for {still_s / 60:.0f} min, ten '
                        'times as long as in the hour before; is it frozen? The drift follows it'
                    )
            return sentences
        for j in tracker.replaced:
            # Held-out predictions were off by a third of this at most.
            off_k = np.where(np.arange(self.thermometers) == j, prediction.agree_k / 3, 0.0)
            if worst := self._doubt(tracker.effect(off_k), _CERTAIN):
                sentences.append(f'by what is predicted of thermometer {j + 1}, {worst} off')
        for j in np.flatnonzero(state.suspicious(prediction)).tolist():
            moved_k = np.where(np.arange(self.thermometers) == j, state.moved_k, 0.0)
            if worst := self._doubt(tracker.effect(moved_k), _CERTAIN):
                sentences.append(
                    f'thermometer {j + 1} has read the same for {state.still_s[j]:.0f} s while '
                    f'the others show that it moved by {state.moved_k[j]:.1f} K; is it frozen? '
                    f'Then {worst} off'
                )
        return sentences

    def _doubt(self, off: FloatArray, times: float) -> str:
        """Say how far the drift may be off, N and N m, (6,), beyond deviations of the model."""
        if self.model is None:
            return ''
        excess = off - [times * self.model.deviation.get(axis, 0.0) for axis in AXES]
        worst = int(np.argmax(excess / axis_limits(1.0)))
        if excess[worst] <= 0:
            return ''
        return f'the drift of {AXES[worst]} may be {off[worst]:.2g} {axis_unit(AXES[worst])}'

    def doubt_zero(self, why: str) -> None:
        """Say until the next tare, in a sentence, why the zero may be another one."""
        if why not in self._said:
            self._said.append(why)

    def _forget_doubts(self) -> None:
        self._said.clear()
        for spikes in self.tracker.spikes:
            spikes.jump = spikes.jump._replace(by_k=0.0, off_k=0.0)

    def _doubt_tare_before_drift(self, since_ns: float, begun_ns: int, because: str) -> None:
        """Say that a tare, which keeps the output now that the drift begins, was taken before."""
        late_s = (begun_ns - since_ns) / NANOSECONDS
        if late_s > _LATE_TEMPERATURE_S:
            before = 'some time' if math.isinf(late_s) else f'{late_s:.0f} s'
            self.doubt_zero(
                f'the tare was taken {before} before the {because}, and holds what drifted since; '
                'call ~/tare'
            )

    def reset_tare(self) -> None:
        """Forget both tares."""
        self._waits_since_ns = None
        self._forget_doubts()
        self.restore_tare(np.zeros(len(AXES)), np.zeros(len(AXES)))

    def restore_tare(
        self, tare: FloatArray, external: FloatArray, *, before_drift: bool = False
    ) -> None:
        """
        Subtract tares, N and N m, that ``set_tare`` made with the same model before.

        Those that were made ``before_drift``, without a temperature, take up the drift when it
        begins.
        """
        self.tare, self.external_tare = tare, external
        self.tared = bool(tare.any() or external.any())
        if before_drift:
            self._waits_since_ns = -math.inf
        self._refresh_correction()

    def memory(self) -> ThermalMemory | None:
        """Give what a restarted stream needs; None before the first cell."""
        return self.tracker.memory(self.compensation)

    def resume(self, memory: ThermalMemory, by_clock_s: float) -> None:
        """Continue from a memory, before the first temperature, as DriftTracker.resume does."""
        self.tracker.resume(memory, by_clock_s)
        # What the memory says of jumps ends when they do.
        self._said = [why for why in self._said if why not in self._jumps()]
        self._settle(self.limits.saturate(self.tracker.drift), None)

    def seldom_doubts(self) -> list[str]:
        """Say whose seldom reports leave more of the drift than the model does."""
        sentences, grid = [], self.tracker.grid
        for j, behind in self._moves.items():
            worst, spacing = self._doubt(behind, 1.0), grid.spacing(j)
            if spacing > 1 and worst:
                spacing_s = spacing * grid.period_ns / NANOSECONDS
                sentences.append(
                    f'thermometer {j + 1} reports every {spacing_s:.3g} s, so that {worst} '
                    'behind; let it report each second'
                )
        return sentences

    def _share(self, stamp_ns: int) -> float:
        """Share of the ramp that is done at a stamp, 0 to 1."""
        share = (stamp_ns - self._begun_ns) / self._ramp_ns
        return 0.0 if share < 0.0 else min(share, 1.0)

    def _settle(self, target: Drift, keep_output_of: Wrench | None) -> None:
        """Jump to a drift; the tares take up the jump of a wrench; unloaded where it is NaN."""
        if keep_output_of is not None:
            stamp_ns, raw = keep_output_of
            before = self.compensation_at(stamp_ns)
            gain = (1.0 + target.sensitivity) / (1.0 + before.sensitivity)
            finite = np.where(np.isfinite(raw), raw, before.zero + self.tare)
            self.tare, self.external_tare = (
                finite - target.zero - gain * (finite - before.zero - tare)
                for tare in (self.tare, self.external_tare)
            )
        self.compensation = self._begun = target
        self.limits.too_fast, self._end_ns = (), 0
        self._moves.clear()
        self._refresh_correction()

    def _refresh_correction(self) -> None:
        """Precompute what is constant over a ramp, per axis: offset, its step, gain, its step."""
        zero, gain = self._begun.zero, 1.0 + self._begun.sensitivity
        zero_step, gain_step = np.subtract(self.compensation, self._begun)
        self._correction, self._external = (
            np.stack((zero + tare, zero_step, gain, gain_step), axis=1).tolist()
            for tare in (self.tare, self.external_tare)
        )
