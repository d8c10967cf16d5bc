"""
Temperatures that stand alone: one rule for the running stream and for files.

A bad contact, or the first conversion of a digital thermometer, gives a reading that metal cannot
have gone to. Such a sample is kept back until the next one of its thermometer. Where that
continues from the time before, the sample kept back is dropped; else temperature did go there.

A first sample, such as 0 °C before the first conversion, stands alone where the next two agree
against it. Then a file leaves it out; a stream starts from what most of its first cells say.
"""

import numpy as np

from wrist_ft_comp.signals import BoolArray, FloatArray, IntArray, NANOSECONDS

#: A thermometer in metal does not change by more than this from sample to sample, K ...
_JUMP_K = 2.0
#: ... plus this for every second between them, K/s.
_JUMP_K_S = 0.2


def jumps(steps_k: FloatArray, elapsed_s: FloatArray) -> BoolArray:
    """Say which changes, K, are too fast for metal, by the seconds that each took; any shape."""
    return np.asarray(np.abs(steps_k) > _JUMP_K + _JUMP_K_S * elapsed_s)


#: Stamp, ns, and temperature, °C.
Reading = tuple[int, float]


class SpikeFilter:
    """Drops the samples of a thermometer that stand alone."""

    def __init__(self) -> None:
        #: How many stood alone, and the first of them.
        self.dropped = 0
        self.first: Reading | None = None
        #: Samples that counted.
        self._count = 0
        self._last: Reading | None = None
        self._kept: Reading | None = None

    def go_on(self, stamp_ns: int, temperature_c: float) -> None:
        """Continue from a temperature that was believed before."""
        self._last, self._kept, self._count = (stamp_ns, temperature_c), None, 2

    def admit(self, stamp_ns: int, temperature_c: float) -> list[Reading]:
        """Take a sample; give those that count now: none, this one, or one kept back, too."""
        sample, last, kept = (stamp_ns, temperature_c), self._last, self._kept
        apart = last is not None and _apart(last, sample)
        self._kept = sample if apart and kept is None else None
        if self._kept:
            return []
        self._last = sample
        if kept is None or not apart:
            self._count += 1
            self._drop(kept)
            return [sample]
        if self._count == 1 and not _apart(kept, sample):
            self._drop(last)
        self._count += 2
        return [kept, sample]

    def _drop(self, sample: Reading | None) -> None:
        """Count a sample that stood alone, if there was one."""
        self.dropped += sample is not None
        self.first = self.first or sample

    def admit_all(
        self, stamps_ns: IntArray, temperature_c: FloatArray
    ) -> tuple[IntArray, FloatArray]:
        """Take samples, (n,), as ``admit`` does; a first one that stood alone is out, too."""
        before_ns, before_c = self._last or (stamps_ns[0], temperature_c[0])
        elapsed_s = np.diff(stamps_ns, prepend=before_ns) / NANOSECONDS
        steps_k = np.diff(temperature_c, prepend=before_c)
        if self._kept is None and not jumps(steps_k, elapsed_s).any():
            self._last = int(stamps_ns[-1]), float(temperature_c[-1])
            self._count += len(stamps_ns)
            return stamps_ns, temperature_c
        pairs = zip(stamps_ns.tolist(), temperature_c.tolist(), strict=True)
        counted = [sample for pair in pairs for sample in self.admit(*pair)]
        if counted and counted[0] == self.first:
            del counted[0]
        return (
            np.array([stamp_ns for stamp_ns, _ in counted], dtype=np.int64),
            np.array([value_c for _, value_c in counted], dtype=float),
        )


def _apart(one: Reading, other: Reading) -> bool:
    """Whether temperature cannot have gone from one sample to the other."""
    elapsed_s = abs(other[0] - one[0]) / NANOSECONDS
    return bool(jumps(np.array(other[1] - one[1]), np.array(elapsed_s)))
