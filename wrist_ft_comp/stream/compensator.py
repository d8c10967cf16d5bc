"""Corrects a stream of wrenches: drift, limits and tare. No wrench changes the next one."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.drift.drift_model import check_fits, Drift, DriftModel, no_drift
from wrist_ft_comp.errors import check_range, SettingsError
from wrist_ft_comp.recording import PERIODS_S
from wrist_ft_comp.series import FloatArray, NANOSECONDS
from wrist_ft_comp.stream.clock import Sample
from wrist_ft_comp.stream.drift_limits import axis_limits, Limits
from wrist_ft_comp.stream.drift_tracker import DriftTracker
from wrist_ft_comp.stream.drift_uncertainty import SPAN_S
from wrist_ft_comp.stream.drift_warnings import frozen_doubts, gap_doubts, jump_doubts
from wrist_ft_comp.stream.exchanged_thermometers import exchanged_by_jumps
from wrist_ft_comp.stream.gaps_and_restarts import ThermalMemory
from wrist_ft_comp.stream.tare import early_tare_doubts, tare_doubts, usual_silences_ns
from wrist_ft_comp.stream.thermal_cells import ThermalCell

#: A tare jumps to the end of a ramp that moves the drift by more than this, N.
_RAMP_N = 0.1
#: Stamp, ns, and raw values, N and N m, axis order AXES.
Wrench = tuple[int, Sequence[float]]


@dataclass(frozen=True)
class StreamSettings:
    """What a person chose about the stream."""

    #: Cell length h while there is no model, s; a model brings its own.
    thermal_period_s: float = 1.0
    #: How long a thermometer may be silent before a warning is due, s. Its last value is held from
    #: then on, or from 10 s on.
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
        #: How far models that were live before may have left it off, as ``deviation``.
        self.tare_deviation: FloatArray = np.zeros(len(AXES))
        #: Those of ``zero_doubts`` that nothing but a tare ends.
        self.lasting_doubts: list[str] = []
        #: What is subtracted at the end of the present ramp, which lasts one cell: the drift of
        #: the model, within the limits.
        self.compensation = no_drift()
        #: What is subtracted at the beginning of the ramp, and its stamp, ns.
        self._begun, self._begun_ns = self.compensation, 0
        #: How long the present ramp lasts, ns.
        self._ramp_ns = period_ns
        #: How far the last report of each thermometer moved the drift, N and N m, (6,).
        self.moves: dict[int, FloatArray] = {}
        #: When the last tare was taken, ns.
        self._tared_ns: float = -math.inf
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
    def compensating(self) -> bool:
        """Whether there is a model and its thermal state has started."""
        return self.tracker.state is not None

    @property
    def deviation(self) -> FloatArray:
        """Standard deviation of the drift that is left in the output, N and N m, (6,), or NaN."""
        if self.model is None or self.tracker.temperature_c is None:
            return np.full(len(AXES), np.nan)
        return np.hypot(self.model.uncertainty(self.tracker.temperature_c), self.tare_deviation)

    @property
    def zero_doubts(self) -> list[str]:
        """Sentences on what has happened since the last tare that may have moved the zero."""
        said = self.lasting_doubts + jump_doubts(self.tracker)
        if self.compensating and self.tared and self._waits_since_ns is not None:
            said += early_tare_doubts(-math.inf, 0, 'next temperatures')
        return said

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
        had_drift, uncertainty = self.compensating, self.tracker.uncertainty
        spikes = self.tracker.spikes[thermometer]
        wrong_starts = spikes.wrong_starts
        cells = self.tracker.add(Sample(thermometer, stamp_ns, temperature_c, arrival_ns))
        leap = self.tracker.clocks.leap
        if leap is not None and leap.passed_ns is not None:  # the clock of all was set
            self._tared_ns += leap.to_ns - leap.from_ns - leap.passed_ns
        if self.tared and spikes.wrong_starts > wrong_starts:
            self.doubt_zero(
                f'the tare was taken while thermometer {thermometer + 1} read '
                f'{spikes.strange_c:.1f} °C, which was wrong; call ~/tare'
            )
        if not cells or not self.compensating:
            return cells
        # How far a start, or a gap, was off is known a minute, or a cell, later.
        known_ns = 2 * (SPAN_S * NANOSECONDS + self.tracker.grid.period_ns)
        lately = 0 <= stamp_ns - self._tared_ns <= known_ns
        if lately and self.tracker.uncertainty is not uncertainty:
            self._doubt_uncertain('the tare was taken', stamp_ns)
        target = self.target
        since_ns = self._waits_since_ns
        if had_drift and since_ns is not None and self.tracker.end_ns < since_ns < math.inf:
            since_ns = None  # a cell from before the tare, as of a clock that stood still
        else:
            self._waits_since_ns = None
        if since_ns is not None:
            self.doubt_zero(*early_tare_doubts(since_ns, stamp_ns, 'temperatures came'))
            unloaded = stamp_ns, [np.nan] * len(AXES)  # where no wrench has come
            self._settle(target, keep_output_of or unloaded)
        elif not had_drift:
            self._settle(target, None)
        self._begun, self._begun_ns = self.compensation_at(stamp_ns), stamp_ns
        # The ramp lasts a cell, or, where only seldom ones have reported, until one is due again.
        grid = self.tracker.grid
        reported = np.flatnonzero(np.any([cell.measured for cell in cells], axis=0)).tolist()
        self.moves |= dict.fromkeys(reported, np.abs(target.zero - self._begun.zero))
        self._ramp_ns = grid.period_ns * min(map(grid.spacing, reported), default=1)
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

    @property
    def target(self) -> Drift:
        """What the model says now, within the limits; the compensation moves there."""
        return self.limits.saturate(self.tracker.drift)

    def _lags(self, drift: Drift) -> bool:
        """Whether what is subtracted has yet to catch up with the model."""
        return bool((np.abs(self.target.zero - drift.zero) > axis_limits(_RAMP_N)).any())

    def compensation_at(self, stamp_ns: int) -> Drift:
        """Compute what is subtracted at a stamp, ns, arrays of shape (6,)."""
        share, ends = self._share(stamp_ns), zip(self._begun, self.compensation, strict=True)
        return Drift(*(before + share * (after - before) for before, after in ends))

    def tared_with(self, stamp_ns: int) -> Drift:
        """Give the drift for a tare at a stamp, ns: what is subtracted, unless that lags."""
        drift = self.compensation_at(stamp_ns)
        return self.target if self._lags(drift) else drift

    def go_live(self, model: DriftModel | None, keep_output_of: Wrench | None = None) -> None:
        """
        Swap a model in, with a state made from the kept temperatures; None stops compensating.

        The output of the newest wrench, ``keep_output_of``, stays where it was: the tare takes up
        the difference of the drifts. SettingsError when the model is for another number of
        thermometers, ModelFileError when it is in another unit; the running model stays then.
        """
        if model is not None:
            check_fits(model, self.thermometers)
        if keep_output_of is not None:
            self._doubt_uncertain('the model went live', keep_output_of[0])
            if self._lags(self.compensation_at(keep_output_of[0])):
                self.doubt_zero('the drift lagged behind when the model was changed; call ~/tare')
            if self.tared and self.model:
                self.tare_deviation = np.nan_to_num(self.deviation)
            if self.tared and self.model and model:
                known = {*self.model.axes, *self.model.deviation}
                if new := [axis for axis in model.axes if axis not in known]:
                    self.doubt_zero(
                        f'the model before knew nothing of {", ".join(new)}, and the tare holds '
                        'what they drifted since; call ~/tare'
                    )
        self.tracker.use(model)
        if keep_output_of is not None:
            self._doubt_uncertain('the model went live', keep_output_of[0])
        if self._waits_since_ns is not None and self.compensating:
            since_ns, begun_ns = self._waits_since_ns, self.tracker.end_ns
            self.doubt_zero(*early_tare_doubts(since_ns, begun_ns, 'model went live'))
        if keep_output_of is None or self.compensating:
            self._waits_since_ns = None
        elif self._waits_since_ns is None:
            self._waits_since_ns = keep_output_of[0] if self.tared else math.inf
        self._settle(self.target, keep_output_of)

    def set_tare(
        self, raw: FloatArray, stamp_ns: int, weight: FloatArray | None = None
    ) -> FloatArray:
        """
        Make a mean raw wrench, shape (6,), of a time read zero; give raw minus zero drift.

        The external wrench reads zero, too: of a sensor that carries the payload's mean weight,
        N and N m, or nothing.
        """
        drift = self.tared_with(stamp_ns)
        if self._lags(self.compensation_at(stamp_ns)):
            # As after a night: later, the output would move by the rest of the ramp.
            self._settle(drift, None)
        self.tare = np.nan_to_num(raw - drift.zero)  # axes that the sensor has not
        carried = np.zeros(len(AXES)) if weight is None else weight
        self.external_tare = self.tare - (1.0 + drift.sensitivity) * carried
        self.tared, self._tared_ns, self.tare_deviation = True, stamp_ns, np.zeros(len(AXES))
        self._forget_doubts(but=exchanged_by_jumps(self.tracker.spikes))
        # A drift that is held, as no temperature comes, is none to tare with.
        held_ns = stamp_ns - self.tracker.end_ns
        silences_ns = dict(enumerate(usual_silences_ns(self.tracker)))
        is_held = held_ns > min(silences_ns[j] for j in silences_ns.keys() - self.tracker.replaced)
        has_drift = self.compensating and self.tracker.awaited is None and not is_held
        self._waits_since_ns = None if has_drift else stamp_ns
        self.doubt_zero(*tare_doubts(self.tracker, has_drift=has_drift))
        self._doubt_uncertain('the tare was taken', stamp_ns)
        self._refresh_correction()
        return self.tare

    def doubt_zero(self, *sentences: str) -> None:
        """Say until the next tare, once each, why the zero may be another one."""
        self.lasting_doubts += [why for why in sentences if why not in self.lasting_doubts]

    def _doubt_uncertain(self, made: str, at_ns: int) -> None:
        """Say that a zero that is made at a stamp, in words, is of a drift that may be off."""
        if gap_doubts(self.tracker, at_ns) or frozen_doubts(self.tracker):
            self.doubt_zero(
                f'{made} while the thermal state was uncertain; call ~/tare when the status '
                'temperature is OK'
            )

    def _forget_doubts(self, but: Sequence[tuple[int, int]] = ()) -> None:
        self.lasting_doubts.clear()
        kept = {j for pair in but for j in pair}
        for spikes in (one for j, one in enumerate(self.tracker.spikes) if j not in kept):
            spikes.jump = spikes.jump._replace(by_k=0.0, off_k=0.0)

    def reset_tare(self) -> None:
        """Forget both tares."""
        self._waits_since_ns, self.tare_deviation = None, np.zeros(len(AXES))
        self._forget_doubts()
        self.restore_tare(np.zeros(len(AXES)), np.zeros(len(AXES)), tared=False)

    def restore_tare(
        self, tare: FloatArray, external: FloatArray, *, tared: bool, before_drift: bool = False
    ) -> None:
        """
        Subtract tares, N and N m, that were made with the same model before; not all are a tare.

        Those that were made ``before_drift``, without a temperature, take up the drift when it
        begins.
        """
        self.tare, self.external_tare = tare, external
        self.tared = tared
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
        of_jumps = jump_doubts(self.tracker)
        self.lasting_doubts = [why for why in self.lasting_doubts if why not in of_jumps]
        self._settle(self.target, None)

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
            kept = np.abs((gain - 1.0) * (finite - before.zero - self.tare))
            if self.tared and (kept > np.fmax(3 * self.deviation, axis_limits(_RAMP_N))).any():
                self.doubt_zero(
                    'a model with another gain went live under a load, and the tare holds the '
                    'difference; call ~/tare'
                )
            self.tare, self.external_tare = (
                finite - target.zero - gain * (finite - before.zero - tare)
                for tare in (self.tare, self.external_tare)
            )
        self.compensation = self._begun = target
        self.limits.too_fast = ()
        self.moves.clear()
        self._refresh_correction()

    def _refresh_correction(self) -> None:
        """Precompute what is constant over a ramp, per axis: offset, its step, gain, its step."""
        zero, gain = self._begun.zero, 1.0 + self._begun.sensitivity
        zero_step, gain_step = np.subtract(self.compensation, self._begun)
        self._correction, self._external = (
            np.stack((zero + tare, zero_step, gain, gain_step), axis=1).tolist()
            for tare in (self.tare, self.external_tare)
        )
