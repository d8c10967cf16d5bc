"""Finds wrenches that no healthy sensor gives: frozen, or saturated on some axes."""

from collections.abc import Sequence

import numpy as np

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.series import FloatArray, IntArray
from wrist_ft_comp.stream.clock import StampWatch

#: A reading is frozen after this many looks in a row with the same value.
LOOKS = 50


class SensorWatch(StampWatch):
    """Watches a sensor's readings; the same value in ``looks`` looks in a row is suspicious."""

    def __init__(self, looks: int = LOOKS) -> None:
        super().__init__()
        self._looks = looks
        #: Per axis: the newest reading, how often it was the same, and its least and largest.
        self._raw: FloatArray = np.full(len(AXES), np.nan)
        self._same: IntArray = np.zeros(len(AXES), np.int64)
        self._least: FloatArray = self._raw
        self._most: FloatArray = self._raw

    def look(self, stamp_ns: int, raw: Sequence[float]) -> None:
        """Look at another wrench, N and N m, and its stamp, ns; 0 when it has none."""
        before, self._raw = self._raw, np.array(raw)
        self._same = np.where(self._raw == before, self._same + 1, 0)
        self._least = np.fmin(self._least, self._raw)
        self._most = np.fmax(self._most, self._raw)
        self.look_at_stamp(stamp_ns)

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
