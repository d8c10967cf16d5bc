"""
Temperatures that stand alone: one rule for the running stream and for files.

A bad contact, or the first conversion of a digital thermometer, gives a reading that metal cannot
have gone to. Such a sample is kept back until the next one of its thermometer. Where that
continues from the time before, the sample kept back is dropped; else temperature did go there.
"""

import numpy as np

from wrist_ft_comp.signals import BoolArray, FloatArray, IntArray, NANOSECONDS

#: A thermometer in metal does not change by more than this from sample to sample, K ...
_JUMP_K = 2.0
#: ... plus this for every second between them, K/s.
_JUMP_K_S = 0.2


def jumps(steps_k: FloatArray, elapsed_s: FloatArray) -> BoolArray:
    """Mark the steps, K, that metal cannot have made in so many seconds; any shape."""
    return np.asarray(np.abs(steps_k) > _JUMP_K + _JUMP_K_S * elapsed_s)


class SpikeFilter:
    """Drops the samples of a thermometer that stand alone."""

    def __init__(self) -> None:
        #: How many were dropped, and the first of them: stamp, ns, and °C.
        self.dropped = 0
        self.first: tuple[int, float] | None = None
        self._last: tuple[int, float] | None = None
        self._kept: tuple[int, float] | None = None

    def admit(self, stamp_ns: int, temperature_c: float) -> list[tuple[int, float]]:
        """Take a sample; give those that count now: none, this one, or one kept back, too."""
        sample, kept = (stamp_ns, temperature_c), self._kept
        jumped = self._jumped(*sample)
        self._kept = sample if jumped and kept is None else None
        if self._kept is not None:
            return []
        self._last = sample
        if kept is None or jumped:
            return [sample] if kept is None else [kept, sample]
        self.dropped += 1
        self.first = self.first or kept
        return [sample]

    def admit_all(
        self, stamps_ns: IntArray, temperature_c: FloatArray
    ) -> tuple[IntArray, FloatArray]:
        """Take samples, (n,), as ``admit`` does one by one; give those that count now."""
        before_ns, before_c = self._last or (stamps_ns[0], temperature_c[0])
        elapsed_s = np.diff(stamps_ns, prepend=before_ns) / NANOSECONDS
        steps_k = np.diff(temperature_c, prepend=before_c)
        if self._kept is None and not jumps(steps_k, elapsed_s).any():
            self._last = int(stamps_ns[-1]), float(temperature_c[-1])
            return stamps_ns, temperature_c
        pairs = zip(stamps_ns.tolist(), temperature_c.tolist(), strict=True)
        counted = [sample for pair in pairs for sample in self.admit(*pair)]
        return (
            np.array([stamp_ns for stamp_ns, _ in counted], dtype=np.int64),
            np.array([value_c for _, value_c in counted], dtype=float),
        )

    def _jumped(self, stamp_ns: int, temperature_c: float) -> bool:
        """Whether temperature cannot have gone to a sample from the last one that counts."""
        if self._last is None:
            return False
        last_ns, last_c = self._last
        elapsed_s = abs(stamp_ns - last_ns) / NANOSECONDS
        return bool(jumps(np.array(temperature_c - last_c), np.array(elapsed_s)))
