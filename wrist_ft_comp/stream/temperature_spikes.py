"""
Temperatures that metal cannot have gone to: one rule for the running stream and for files.

A bad contact, a bus error, or the first conversions of a digital thermometer give readings far
from those before. They are left out until metal could have got there: 0 °C instead of 25 °C for
115 s. What stays for longer is believed then, as if it had been reached on a straight line.

The first readings may be the wrong ones. Where others agree with each other for longer than all
that was believed until then, the thermometer begins anew with them.
"""

import math

import numpy as np

from wrist_ft_comp.series import BoolArray, FloatArray, IntArray, NANOSECONDS

#: A thermometer in metal does not change by more than this from sample to sample, K ...
_JUMP_K = 2.0
#: ... plus this for every second between them, K/s.
_JUMP_K_S = 0.2
#: A jump is reported for this time at least, s, with a model that forgets fast.
_REPORTED_S = 10.0

#: Stamp, ns, and temperature, °C.
Reading = tuple[int, float]


def jumps(steps_k: FloatArray, elapsed_s: FloatArray) -> BoolArray:
    """Say which changes, K, are too fast for metal, by the seconds that each took; any shape."""
    return np.asarray(np.abs(steps_k) > _JUMP_K + _JUMP_K_S * elapsed_s)


def _apart(one: Reading, other: Reading) -> bool:
    """Whether temperature cannot have gone from one sample to the other, in whole seconds."""
    elapsed_s = abs(other[0] // NANOSECONDS - one[0] // NANOSECONDS)
    return abs(other[1] - one[1]) > _JUMP_K + _JUMP_K_S * elapsed_s


class SpikeFilter:
    """Leaves out the readings of a thermometer that metal cannot have gone to."""

    def __init__(self) -> None:
        #: How many were left out, and the first of them.
        self.dropped = 0
        self.first: Reading | None = None
        #: The newest that was left out, °C, and what was believed instead.
        self.strange_c = self.believed_c = math.nan
        #: How often the first readings were the wrong ones.
        self.wrong_starts = 0
        #: How often a reading that had been left out was believed, and how far the last one of
        #: these was, K, and when, ns.
        self.jumps, self._jump_k, self._jumped_ns = 0, 0.0, 0
        #: By how much the clock of the stamps was set since the start.
        self.shift_ns = 0
        #: The first and the last reading that were believed, and how many.
        self._begin_ns: float = -math.inf
        self._last: Reading | None = None
        self._count = 0
        #: The first and the last one left out since then, of those that agree with each other.
        self._other_begin_ns = 0
        self._other: Reading | None = None

    @property
    def leaves_out(self) -> bool:
        """Whether the newest reading was left out."""
        return self._other is not None

    def go_on(self, stamp_ns: int, temperature_c: float) -> None:
        """Continue from a temperature that was believed before."""
        self._begin_ns, self._other = -math.inf, None
        self._last = stamp_ns - self.shift_ns, temperature_c

    def admit(self, stamp_ns: int, temperature_c: float) -> bool:
        """Take a sample; whether it counts."""
        stamp_ns -= self.shift_ns
        sample, last, other = (stamp_ns, temperature_c), self._last, self._other
        agrees = other is not None and not _apart(other, sample)
        if last is None:
            self._begin_ns = stamp_ns
        elif _apart(last, sample):
            self._other = sample
            if not agrees:
                self._other_begin_ns = stamp_ns
            if stamp_ns - self._other_begin_ns <= last[0] - self._begin_ns:
                self.dropped += 1
                self.first = self.first or sample
                self.strange_c, self.believed_c = temperature_c, last[1]
                return False
            self.wrong_starts += 1
            self.dropped += self._count
            self.first = int(self._begin_ns), last[1]
            self.strange_c, self.believed_c = last[1], temperature_c
            self._begin_ns, self._count = self._other_begin_ns, 0
        if last is not None and agrees:
            self.jumps += 1
            self._jump_k, self._jumped_ns = temperature_c - last[1], stamp_ns
        self._last, self._other = sample, None
        self._count += 1
        return True

    def admit_all(
        self, stamps_ns: IntArray, temperature_c: FloatArray
    ) -> tuple[IntArray, FloatArray]:
        """Take samples, (n,), as ``admit`` does; those before a new beginning are out, too."""
        before_ns, before_c = self._last or (stamps_ns[0], temperature_c[0])
        elapsed_s = np.diff(stamps_ns // NANOSECONDS, prepend=before_ns // NANOSECONDS)
        jumped = jumps(np.diff(temperature_c, prepend=before_c), elapsed_s)
        if not self.leaves_out and not jumped.any():
            if self._last is None:
                self._begin_ns = int(stamps_ns[0])
            self._last = int(stamps_ns[-1]), float(temperature_c[-1])
            self._count += len(stamps_ns)
            return stamps_ns, temperature_c
        counted = np.zeros(len(stamps_ns), dtype=bool)
        for k, sample in enumerate(zip(stamps_ns.tolist(), temperature_c.tolist(), strict=True)):
            starts = self.wrong_starts
            counted[k] = self.admit(*sample)
            if self.wrong_starts > starts:
                counted[:k] = False
        return stamps_ns[counted], temperature_c[counted]

    def remembered_k(self, now_ns: int, time_constant_s: float) -> float:
        """Tell how far the last jump was, K, while a model remembers it; 0 afterwards."""
        elapsed_s = abs(now_ns - self.shift_ns - self._jumped_ns) / NANOSECONDS
        left_k = self._jump_k * math.exp(-elapsed_s / max(time_constant_s, _REPORTED_S))
        return self._jump_k if abs(left_k) > _JUMP_K else 0.0
