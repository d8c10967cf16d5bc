"""
The stream: drift and tare around a wrench.

Temperatures move the drift once per thermal cell (drift_tracker.py); it is kept within limits, and
every wrench is corrected with the drift of its time, ramped over one cell from where the output
stood, so that it has no steps. The force path itself has no memory: what comes out depends on the
wrench that came in and on the drift, only.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.model.drift_model import Drift, DriftModel
from wrist_ft_comp.model.ranges import check_range, PERIODS_S
from wrist_ft_comp.model.signals import AXES, FloatArray, NANOSECONDS
from wrist_ft_comp.model.stream_grid import CompletedCells
from wrist_ft_comp.stream.drift_tracker import DriftTracker
from wrist_ft_comp.stream.limits import Limits
from wrist_ft_comp.stream.warm_restart import ThermalMemory


class Ramp:
    """
    Zero drift and gain on their way from one thermal cell's values to the next one's.

    Attributes
    ----------
    start_ns : int
        Stamp at which it began, ns; it lasts one cell.
    zero, zero_step : list of 6 floats
        Zero drift at the start, and how much it moves, N and N m, axis order AXES.
    gain, gain_step : list of 6 floats
        1 + sensitivity drift at the start, and how much it moves.

    """

    def __init__(self) -> None:
        self.start_ns = 0
        self.zero: list[float] = [0.0] * len(AXES)
        self.zero_step: list[float] = [0.0] * len(AXES)
        self.gain: list[float] = [1.0] * len(AXES)
        self.gain_step: list[float] = [0.0] * len(AXES)

    def at(self, share: float) -> tuple[FloatArray, FloatArray]:
        """
        Compute where it stands.

        Parameters
        ----------
        share : float
            Share of the ramp that is done, 0 to 1.

        Returns
        -------
        tuple of ndarrays, shape (6,)
            Zero drift and gain.

        """
        return (
            np.array(self.zero) + share * np.array(self.zero_step),
            np.array(self.gain) + share * np.array(self.gain_step),
        )

    def drift_at(self, share: float) -> Drift:
        """
        Compute where it stands, as a drift.

        Parameters
        ----------
        share : float
            Share of the ramp that is done, 0 to 1.

        Returns
        -------
        Drift
            Arrays of shape (6,).

        """
        zero, gain = self.at(share)
        return Drift(zero, gain - 1.0)

    def restart(self, start_ns: int, share: float, target: Drift) -> None:
        """
        Go to a new target from where the ramp stands.

        Parameters
        ----------
        start_ns : int
            Now, ns.
        share : float
            Share of the present ramp that is done, 0 to 1.
        target : Drift
            Arrays of shape (6,).

        """
        zero, gain = self.at(share)
        self.start_ns = start_ns
        self.zero, self.gain = zero.tolist(), gain.tolist()
        self.zero_step = (target.zero - zero).tolist()
        self.gain_step = (1.0 + target.sensitivity - gain).tolist()

    def settle(self, target: Drift) -> None:
        """
        Stand at a target.

        Parameters
        ----------
        target : Drift
            Arrays of shape (6,).

        """
        self.zero, self.gain = target.zero.tolist(), (1.0 + target.sensitivity).tolist()
        self.zero_step, self.gain_step = [0.0] * len(AXES), [0.0] * len(AXES)


@dataclass(frozen=True)
class StreamSettings:
    """
    What a person chose about the stream.

    Attributes
    ----------
    thermal_period_s : float
        Cell length h while there is no model, s; a model brings its own.
    temperature_timeout_s : float
        How long a thermometer may be silent before its last value is held and a warning is due, s.
    max_drift_n : float
        Largest zero drift that is ever subtracted from a force, N; from a torque, a tenth of the
        number in N m.
    max_drift_rate_n_s : float
        How fast the zero drift that is subtracted from a force may move, N/s; from a torque, a
        tenth of the number in N m/s.
    history_s : float
        Temperatures kept for a model that goes live later, s.

    """

    thermal_period_s: float = 1.0
    temperature_timeout_s: float = 5.0
    max_drift_n: float = 200.0
    max_drift_rate_n_s: float = 1.0
    history_s: float = 6 * 3600.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        check_range('thermal_period_s', self.thermal_period_s, *PERIODS_S)
        check_range('max_drift_n', self.max_drift_n, 0.0)
        for name in ('temperature_timeout_s', 'max_drift_rate_n_s', 'history_s'):
            check_range(name, getattr(self, name), 0.0, above=True)


class Compensator:
    """
    Owns what a sensor's stream needs: the grid, the drift state, the tare.

    Parameters
    ----------
    thermometers : int
        Number of thermometers J that will report.
    settings : StreamSettings
        Limits and periods.
    model : DriftModel, optional
        None passes wrenches through, tared, until ``go_live``.

    """

    def __init__(
        self, thermometers: int, settings: StreamSettings, model: DriftModel | None = None
    ) -> None:
        self.settings = settings
        self.thermometers = thermometers
        self.tracker = DriftTracker(
            thermometers,
            round(settings.thermal_period_s * NANOSECONDS),
            settings.temperature_timeout_s,
            settings.history_s,
        )
        self.limits = Limits(settings.max_drift_n, settings.max_drift_rate_n_s)
        self.tare: FloatArray = np.zeros(len(AXES))
        #: What is subtracted when the present ramp ends: the model's drift, within the limits.
        self.compensation = self.tracker.drift
        self._ramp = Ramp()
        self._last: tuple[int, Sequence[float]] | None = None
        #: Whether the first cell may move the output: not after a tare or a change of model.
        self._keep_output = False
        self._correction: list[tuple[float, float, float, float]] = []
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
        return self.tracker.following

    @property
    def newest(self) -> tuple[int, Sequence[float]] | None:
        """The newest wrench's stamp, ns, and its raw values; None before the first."""
        return self._last

    def add_temperature(
        self, thermometer: int, stamp_ns: int, temperature_c: float
    ) -> list[CompletedCells]:
        """
        Take one temperature.

        Parameters
        ----------
        thermometer, stamp_ns, temperature_c
            As DriftTracker.add takes them.

        Returns
        -------
        list of CompletedCells
            Cells that this sample completed; the drift has moved when there are any.

        """
        resting = not self.compensating
        cells = self.tracker.add(thermometer, stamp_ns, temperature_c)
        if cells and self.compensating:
            target = self.limits.saturate(self.tracker.drift)
            if resting:
                self._settle(target, self._reading() if self._keep_output else None)
            share = self._share(stamp_ns)
            period_s = self.tracker.grid.period_ns / NANOSECONDS
            self.compensation = self.limits.rate_limit(
                target, self._ramp.drift_at(share), period_s
            )
            self._ramp.restart(stamp_ns, share, self.compensation)
            self._refresh_correction()
        return cells

    def memory(self) -> ThermalMemory | None:
        """
        Tell what a restarted stream needs to go on from here.

        Returns
        -------
        ThermalMemory or None
            None while there is nothing to go on from.

        """
        return self.tracker.memory(self.compensation)

    def resume(self, memory: ThermalMemory, at_least_s: float) -> None:
        """
        Go on from what another stream left; to be called before the first temperature.

        Its drift is subtracted at once.

        Parameters
        ----------
        memory : ThermalMemory
            Of the same model (``belongs_to``).
        at_least_s : float
            How long the gap is by another clock, s; 0 when there is none.

        """
        self.tracker.resume(memory, at_least_s)
        self._settle(self.limits.saturate(self.tracker.drift), None)

    def _share(self, stamp_ns: int) -> float:
        """Share of the ramp that is done at a stamp, 0 to 1."""
        share = (stamp_ns - self._ramp.start_ns) / self.tracker.grid.period_ns
        return 0.0 if share < 0.0 else min(share, 1.0)

    def _refresh_correction(self) -> None:
        """Lay out what is constant over a ramp, per axis: offset, its step, gain, its step."""
        ramp = self._ramp
        offset = (np.array(ramp.zero) + self.tare).tolist()
        self._correction = list(
            zip(offset, ramp.zero_step, ramp.gain, ramp.gain_step, strict=True)
        )

    def correct(self, stamp_ns: int, raw: Sequence[float]) -> list[float]:
        """
        Correct one wrench.

        Parameters
        ----------
        stamp_ns : int
            Its stamp, ns.
        raw : sequence of 6 floats
            Raw wrench, N and N m, axis order AXES.

        Returns
        -------
        list of 6 floats
            ŵ = (r - o - tare) / (1 + s); without a model, r - tare.

        """
        self._last = (stamp_ns, raw)
        share = self._share(stamp_ns)
        return [
            (r - offset - share * step) / (gain + share * gain_step)
            # Six by six: a strict zip would cost a tenth of all this.
            for r, (offset, step, gain, gain_step) in zip(raw, self._correction)  # noqa: B905
        ]

    def go_live(self, model: DriftModel | None) -> None:
        """
        Swap a model in, without a step in the output.

        The new model's state is made from the kept temperatures, and the tare takes up what its
        zero drift differs by at this moment.

        Parameters
        ----------
        model : DriftModel or None
            None stops compensating.

        Raises
        ------
        SettingsError
            When the model expects another number of thermometers; the running model stays.

        """
        if model is not None and model.thermometers != self.thermometers:
            raise SettingsError(
                f'The model expects {model.thermometers} thermometers, the node has '
                f'{self.thermometers} (temperature_topics). Calibrate with these, or list the '
                "model's topics."
            )
        reading = self._reading()
        self.tracker.use(model)
        self._keep_output = reading is not None
        self._settle(self.limits.saturate(self.tracker.drift), reading)

    def _reading(self) -> tuple[FloatArray, FloatArray] | None:
        """Newest raw wrench and what it is corrected to; what is not finite counts as unloaded."""
        if self._last is None:
            return None
        stamp_ns, raw = self._last
        zero, _ = self._ramp.at(self._share(stamp_ns))
        finite = np.where(np.isfinite(raw), raw, zero + self.tare)
        return finite, np.array(self.correct(stamp_ns, finite.tolist()))

    def _settle(self, target: Drift, reading: tuple[FloatArray, FloatArray] | None) -> None:
        """Stand at a drift at once; the tare takes up what this would move the reading by."""
        self.compensation = target
        self._ramp.settle(target)
        self.limits.too_fast = ()
        if reading is not None:
            raw, corrected = reading
            self.tare = raw - target.zero - (1.0 + target.sensitivity) * corrected
        self._refresh_correction()

    def set_tare(self, raw: FloatArray, stamp_ns: int) -> FloatArray:
        """
        Make a raw wrench read zero.

        Parameters
        ----------
        raw : ndarray, shape (6,)
            Mean raw wrench, N and N m.
        stamp_ns : int
            Its time, ns.

        Returns
        -------
        ndarray, shape (6,)
            The tare, raw wrench minus zero drift.

        """
        zero, _ = self._ramp.at(self._share(stamp_ns))
        self.tare = raw - zero
        self._keep_output = True
        self._refresh_correction()
        return self.tare

    def reset_tare(self) -> None:
        """Forget the tare."""
        self.restore_tare(np.zeros(len(AXES)))

    def restore_tare(self, tare: FloatArray) -> None:
        """
        Subtract a tare that was taken with the same model before.

        Parameters
        ----------
        tare : ndarray, shape (6,)
            As set_tare returned it, N and N m.

        """
        self.tare = tare
        self._keep_output = False
        self._refresh_correction()
