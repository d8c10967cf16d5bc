"""Finds readings that no healthy sensor gives: frozen, saturated, jumping, leaping stamps."""

from collections.abc import Collection, Sequence

import numpy as np

from wrist_ft_comp.signals import AXES, FloatArray, IntArray, NANOSECONDS
from wrist_ft_comp.stream.stream_grid import ThermalCell
from wrist_ft_comp.stream.temperature_spikes import jumps

#: A reading is frozen after this many looks in a row with the same value.
LOOKS = 50
#: Stamps stand still after this many looks in a row at the same one.
_STAMP_LOOKS = 5
#: Stamps have leapt where they move by more between two looks, ns ...
_LEAP_NS = 60 * NANOSECONDS
#: ... and by more than this many times the step before.
_LEAP_STEPS = 10


class SensorWatch:
    """Watches a sensor's readings; the same value in ``looks`` looks in a row is suspicious."""

    def __init__(self, looks: int = LOOKS) -> None:
        #: How often stamps ran back, and leapt ahead.
        self.ran_back = self.leapt = 0
        #: Whether the newest wrench had no stamp.
        self.unstamped = False
        self._looks = looks
        #: Per axis: the newest reading, how often it was the same, and its least and largest.
        self._raw: FloatArray = np.full(len(AXES), np.nan)
        self._same: IntArray = np.zeros(len(AXES), np.int64)
        self._least: FloatArray = self._raw
        self._most: FloatArray = self._raw
        self._stamp_ns: int | None = None
        self._step_ns = 0
        self._same_stamps = 0

    def look(self, stamp_ns: int, raw: Sequence[float]) -> None:
        """Look at another wrench, N and N m, and its stamp, ns; 0 when it has none."""
        before, self._raw = self._raw, np.array(raw)
        self._same = np.where(self._raw == before, self._same + 1, 0)
        self._least = np.fmin(self._least, self._raw)
        self._most = np.fmax(self._most, self._raw)
        self.unstamped = not stamp_ns
        if stamp_ns:
            self._look_at_stamp(stamp_ns)

    def _look_at_stamp(self, stamp_ns: int) -> None:
        """Compare a stamp with the one before."""
        if self._stamp_ns is not None:
            step_ns = stamp_ns - self._stamp_ns
            self._same_stamps = self._same_stamps + 1 if step_ns == 0 else 0
            self.ran_back += step_ns < 0
            usual_ns = self._step_ns
            self.leapt += step_ns > max(_LEAP_NS, _LEAP_STEPS * usual_ns) and usual_ns > 0
            self._step_ns = max(step_ns, 1)
        self._stamp_ns = stamp_ns

    @property
    def stamps_stand_still(self) -> bool:
        """Whether new wrenches come with an old stamp."""
        return self._same_stamps >= _STAMP_LOOKS

    @property
    def frozen(self) -> bool:
        """Whether the reading has been the same, to the last bit, on all axes."""
        return bool(self._same.min() >= self._looks)

    @property
    def saturated(self) -> tuple[str, ...]:
        """Axes that moved once and stay exactly at their largest or least value; others move."""
        if self.frozen:
            return ()
        extreme = (self._raw == self._least) | (self._raw == self._most)
        stuck = (self._same >= self._looks) & (self._least < self._most) & extreme
        return tuple(AXES[i] for i in np.flatnonzero(stuck))


class ThermometerWatch:
    """Watches the thermal cells of several thermometers for jumps."""

    def __init__(self, thermometers: int) -> None:
        #: Jumps of each thermometer.
        self.jumps: IntArray = np.zeros(thermometers, np.int64)
        #: The newest jump of each, K.
        self.last_jump_k: FloatArray = np.zeros(thermometers)
        self._before: FloatArray | None = None
        #: The cells in which each was heard.
        self._heard_in: IntArray = np.zeros(thermometers, np.int64)

    def look(self, cell: ThermalCell, period_ns: int, replaced: Collection[int] = ()) -> None:
        """Look at a completed cell of a period, ns, of all thermometers that are not replaced."""
        before, self._before = self._before, cell.temperature_c
        heard_in = cell.number - np.array(cell.silent)
        apart = np.maximum(heard_in - self._heard_in, 1)  # less where a clock was set back
        self._heard_in = heard_in
        if before is None:
            return
        step_k = cell.temperature_c - before
        jumped = jumps(step_k, apart * period_ns / NANOSECONDS)
        jumped[list(replaced)] = False
        self.jumps += jumped
        self.last_jump_k[jumped] = step_k[jumped]
