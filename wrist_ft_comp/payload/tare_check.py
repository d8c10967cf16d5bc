"""Whether wrench_external was tared with the payload that is taken off, or another one was on."""

from collections import deque
import math

import numpy as np

from wrist_ft_comp.payload.weight_check import DIRECTIONS, distinct, FORCES, MOVED_N, ON_SPHERE
from wrist_ft_comp.series import FloatArray

#: When a payload becomes active after a tare without one, its weight has to show within this, s.
_SHOWN_S = 10.0
#: After a right tare, a free force differs from the weight by less than this, N, or this share of
#: the weight. A tare is certain after this many directions in which it was so.
_NEAR_N, _NEAR_SHARE, _PROOFS = 1.0, 0.05, 3
#: A proven tare is doubted where it was never near for this time, s: tools press for less.
_PRESSED_S = 600.0


class HiddenWeight:
    """Judges whether a payload that becomes active was on at a tare that had none; times in s."""

    def __init__(self) -> None:
        #: Since when the weight of a payload has not shown, and when one did last, which proves
        #: the tare.
        self._hidden_s, self._shown_s = math.inf, -math.inf

    def expect(self, now_s: float, tared_s: float) -> None:
        """Take that a payload is active from now on, and was not at the tare."""
        if self._shown_s <= tared_s:
            self._hidden_s = now_s

    def look(self, now_s: float, tared_s: float, rest_n: FloatArray, weight_n: FloatArray) -> bool:
        """Take the force without the weight, and the weight, (3,); True where it is hidden."""
        if 2 * np.linalg.norm(rest_n) < np.linalg.norm(weight_n):
            self._hidden_s, self._shown_s = math.inf, now_s
        elif tared_s > self._hidden_s:
            self._hidden_s = math.inf
        return now_s - self._hidden_s > _SHOWN_S


class TareCheck:
    """Judges whether the last tare of wrench_external was of the weight that is taken off."""

    def __init__(self) -> None:
        #: Whether this tare has proven itself, and when it was near last, s.
        self._is_right, self._near_s = False, -math.inf
        #: What is left of the force, and the weight, N, (2, 3) each.
        self._looks: deque[FloatArray] = deque(maxlen=FORCES)

    def off_n(self, now_s: float, rest_n: FloatArray, weight_n: FloatArray) -> float:
        """
        Take forces without the weight, and weights, N, (3,) each; say by how much the tare is off.

        A wrong tare is the same in all directions, and so is a zero that moved. So is what a
        force-controlled tool presses with, for some time.
        """
        now = np.stack((rest_n, weight_n))
        if not self._looks or np.linalg.norm(now[1] - self._looks[-1][1]) >= MOVED_N:
            self._looks.append(now)
        rests, weights = np.array(self._looks).swapaxes(0, 1)
        off = np.median(rests, axis=0)
        near_n = max(_NEAR_N, _NEAR_SHARE * float(np.linalg.norm(weight_n)))
        near = np.linalg.norm(rests, axis=1) < near_n
        self._is_right |= len(distinct(weights[near])) >= _PROOFS
        if np.linalg.norm(rest_n) < near_n:
            self._near_s = now_s
        same = np.linalg.norm(rests - off, axis=1) < near_n
        is_same = same.mean() >= ON_SPHERE and len(distinct(weights[same])) >= DIRECTIONS
        off_n = float(np.linalg.norm(off))
        is_proven = self._is_right and now_s - self._near_s < _PRESSED_S
        return off_n if is_same and off_n > near_n and not is_proven else 0.0
