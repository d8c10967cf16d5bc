"""Finds wrenches that no healthy sensor gives: frozen, or saturated on some axes."""

from collections.abc import Sequence

import numpy as np

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.series import FloatArray, IntArray
from wrist_ft_comp.stream.clock import StampWatch

#: A reading is frozen after about this many looks with the same value, 5 s of ten looks a second.
LOOKS = 50
#: Only the same value in a row for this share of those looks counts, 1 s: sensors that are slower
#: than the node's looks, or have coarse steps, repeat themselves for less.
_RUN_SHARE = 0.2
#: A look at a reading that lives takes this much of a look back: what stands still for more than
#: a sixth of the time is found, and what lives is believed again after 25 s.
_RECOVERY = 0.2


class SensorWatch(StampWatch):
    """Watches a sensor's readings; the same value in about ``looks`` looks is suspicious."""

    def __init__(self, looks: int = LOOKS) -> None:
        super().__init__()
        self._looks = looks
        #: Per axis: the newest reading, how often it was the same, and its least and largest.
        self._raw: FloatArray = np.full(len(AXES), np.nan)
        self._same: IntArray = np.zeros(len(AXES), np.int64)
        #: Looks at an axis at its extreme while others moved, and, last, at all that stood still.
        self._still: FloatArray = np.zeros(len(AXES) + 1)
        self._least: FloatArray = self._raw
        self._most: FloatArray = self._raw

    def look(self, stamp_ns: int, raw: Sequence[float]) -> None:
        """Look at another wrench, N and N m, and its stamp, ns; 0 when it has none."""
        before, self._raw = self._raw, np.array(raw)
        self._same = np.where(self._raw == before, self._same + 1, 0)
        self._least = np.fmin(self._least, self._raw)
        self._most = np.fmax(self._most, self._raw)
        extreme = (self._raw == self._least) | (self._raw == self._most)
        held = self._same > _RUN_SHARE * self._looks
        stuck = held & extreme & (self._least < self._most) & ~held.all()
        still = np.append(stuck, held.all())
        change = np.where(still, 1.0, -_RECOVERY)
        self._still = np.clip(self._still + change, 0.0, 2 * self._looks)
        self.look_at_stamp(stamp_ns)

    @property
    def frozen(self) -> bool:
        """Whether the reading stands still, to the last bit, on all axes, again and again."""
        return bool(self._still[-1] >= (1 - _RUN_SHARE) * self._looks)

    @property
    def saturated(self) -> tuple[str, ...]:
        """Axes that stay exactly at their largest or least value again and again; others move."""
        if self.frozen:
            return ()
        stuck = self._still[:-1] >= (1 - _RUN_SHARE) * self._looks
        return tuple(AXES[i] for i in np.flatnonzero(stuck))
