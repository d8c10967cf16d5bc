"""
The stream: thermal grid, drift state and tare around a wrench.

Temperatures move the drift once per thermal cell; every wrench is corrected with the drift of its
time, ramped over one cell from where the output stood, so that it has no steps. The force path
itself has no memory: what comes out depends on the wrench that came in and on the drift, only.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrist_ft_comp import SettingsError
from wrist_ft_comp.core import drift
from wrist_ft_comp.core.drift import Drift, DriftModel, DriftState
from wrist_ft_comp.core.ramp import Ramp
from wrist_ft_comp.core.recording import AXES, FloatArray, NANOSECONDS
from wrist_ft_comp.core.thermal_grid import CompletedCells, ThermalGrid

#: Limits for torques are limits for forces times this lever arm, m.
TORQUE_LEVER_M = 0.1
#: Sensitivity drift beyond this is no sensor's; it is clamped.
MAX_SENSITIVITY = 0.5


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
    history_s : float
        Temperatures kept for a model that goes live later, s.

    """

    thermal_period_s: float = 1.0
    temperature_timeout_s: float = 5.0
    max_drift_n: float = 200.0
    history_s: float = 6 * 3600.0


def axis_limits(force_limit: float) -> FloatArray:
    """
    Spread a limit for forces over the six axes.

    Parameters
    ----------
    force_limit : float
        N.

    Returns
    -------
    ndarray, shape (6,)
        N, and N m after multiplication by TORQUE_LEVER_M.

    """
    return np.array(
        [force_limit * (1.0 if axis.startswith('force') else TORQUE_LEVER_M) for axis in AXES]
    )


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
        self.model: DriftModel | None = None
        self.tare: FloatArray = np.zeros(len(AXES))
        self.temperature_c: FloatArray | None = None
        self.drift = Drift(np.zeros(len(AXES)), np.zeros(len(AXES)))
        self.limited: tuple[str, ...] = ()
        self._limits = axis_limits(settings.max_drift_n)
        self._state: DriftState | None = None
        self._ramp = Ramp()
        self._last: tuple[int, Sequence[float]] | None = None
        #: Whether the first cell may move the output: not after a tare or a change of model.
        self._keep_output = False
        self._correction: list[tuple[float, float, float, float]] = []
        self._use_period(round(settings.thermal_period_s * NANOSECONDS))
        self._refresh_correction()
        if model is not None:
            self.go_live(model)

    @property
    def compensating(self) -> bool:
        """Whether there is a model and its thermal state has started."""
        return self._state is not None

    @property
    def grid(self) -> ThermalGrid:
        """The thermal grid, for its counts."""
        return self._grid

    def _use_period(self, period_ns: int) -> None:
        """Start a grid of this period, without history."""
        self._grid = ThermalGrid(period_ns, self.thermometers, self.settings.temperature_timeout_s)
        cells = round(self.settings.history_s * NANOSECONDS / period_ns)
        self._history: deque[FloatArray] = deque(maxlen=max(cells, 1))

    def add_temperature(
        self, thermometer: int, stamp_ns: int, temperature_c: float
    ) -> list[CompletedCells]:
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
        cells = self._grid.add(thermometer, stamp_ns, temperature_c)
        for completed in cells:
            self._advance(completed)
        if cells and self._state is not None:
            self._ramp.restart(stamp_ns, self._share(stamp_ns), self.drift)
            self._refresh_correction()
        return cells

    def _advance(self, cells: CompletedCells) -> None:
        """Move history, state and drift on by completed cells."""
        self.temperature_c = cells.temperature_c
        count = min(cells.count, self._history.maxlen or cells.count)
        self._history.extend([cells.temperature_c] * count)
        if self.model is None:
            return
        if self._state is None or count < cells.count:
            # Nothing known before, or a gap longer than any memory: the robot has soaked.
            first = self._state is None
            self._state = drift.start(self.model, cells.temperature_c)
            self._state, target = drift.step(self.model, self._state, cells.temperature_c)
            self._set_drift(target)
            if first:
                self._settle(self._reading() if self._keep_output else None)
        elif count == 1:
            self._state, target = drift.step(self.model, self._state, cells.temperature_c)
            self._set_drift(target)
        else:
            held = np.repeat(cells.temperature_c[np.newaxis], count, axis=0)
            self._state, track = drift.run(self.model, self._state, held)
            self._set_drift(Drift(track.zero[-1], track.sensitivity[-1]))

    def _set_drift(self, target: Drift) -> None:
        """Keep the drift within its limits, and remember which axes were limited."""
        zero = np.clip(target.zero, -self._limits, self._limits)
        sensitivity = np.clip(target.sensitivity, -MAX_SENSITIVITY, MAX_SENSITIVITY)
        beyond = (zero != target.zero) | (sensitivity != target.sensitivity)
        self.limited = tuple(axis for axis, hit in zip(AXES, beyond, strict=True) if hit)
        self.drift = Drift(zero, sensitivity)

    def _share(self, stamp_ns: int) -> float:
        """Share of the ramp that is done at a stamp, 0 to 1."""
        share = (stamp_ns - self._ramp.start_ns) / self._grid.period_ns
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
        if model is not None and model.period_ns != self._grid.period_ns:
            self._use_period(model.period_ns)
        self.model, self._state = model, None
        self._set_drift(Drift(np.zeros(len(AXES)), np.zeros(len(AXES))))
        if model is not None and self._history:
            temperature_c = np.array(self._history)
            resting = drift.start(model, temperature_c[0])
            self._state, track = drift.run(model, resting, temperature_c)
            self._set_drift(Drift(track.zero[-1], track.sensitivity[-1]))
        self._keep_output = reading is not None
        self._settle(reading)

    def _reading(self) -> tuple[FloatArray, FloatArray] | None:
        """Newest raw wrench and what it is corrected to; what is not finite counts as unloaded."""
        if self._last is None:
            return None
        stamp_ns, raw = self._last
        zero, _ = self._ramp.at(self._share(stamp_ns))
        finite = np.where(np.isfinite(raw), raw, zero + self.tare)
        return finite, np.array(self.correct(stamp_ns, finite.tolist()))

    def _settle(self, reading: tuple[FloatArray, FloatArray] | None) -> None:
        """Stand at the drift at once; the tare takes up what this would move the reading by."""
        self._ramp.settle(self.drift)
        if reading is not None:
            raw, corrected = reading
            self.tare = raw - self.drift.zero - (1.0 + self.drift.sensitivity) * corrected
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
        self.tare = np.zeros(len(AXES))
        self._refresh_correction()
