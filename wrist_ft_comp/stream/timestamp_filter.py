"""
Temperatures whose stamps leap: one stray stamp must not cost an hour of thermal memory.

A sample whose stamp is far from the one before is kept back until the next samples of its
thermometer come. Where they continue from the sample kept back, time did leap (a long silence, a
clock that was set, a simulation that was restarted), and all of them count. They continue from it
if the next one is near, or if three in a row ascend. Where they continue from the time before, the
sample kept back was a stray one and is dropped.
"""

from wrist_ft_comp.signals import NANOSECONDS

#: Thermometer, counted from 0, stamp, ns, and temperature, °C.
Sample = tuple[int, int, float]

#: A step between stamps is a leap from this length on, ns ...
_LEAP_NS = 60 * NANOSECONDS
#: ... and from this many usual steps on, because those of a slow thermometer are long.
_LEAP_STEPS = 4
#: This many ascending samples confirm a leap, however far apart they are.
_CONFIRMING_SAMPLES = 3


class TimestampFilter:
    """Checks the stamps of several thermometers."""

    def __init__(self, thermometers: int) -> None:
        #: Stray samples that were dropped.
        self.strays = 0
        #: How often time leapt.
        self.leaps = 0
        self._last: list[int | None] = [None] * thermometers
        self._expected: int | None = None
        #: Step between the last two samples, ns; None before the second was taken.
        self._step: list[int | None] = [None] * thermometers
        #: Samples kept back, in the order of their stamps.
        self._kept: list[list[Sample]] = [[] for _ in range(thermometers)]

    def expect(self, stamp_ns: int) -> None:
        """Set the stamp where another stream ended, with which first samples are compared."""
        self._expected = stamp_ns

    def admit(self, thermometer: int, stamp_ns: int, temperature_c: float) -> list[Sample]:
        """Take a sample; give those that count now: none, this one, or also some kept back."""
        sample = (thermometer, stamp_ns, temperature_c)
        last, kept = self._last[thermometer], self._kept[thermometer]
        before = self._expected if last is None else last
        if before is None or not self._leaps(thermometer, stamp_ns - before):
            self.strays += len(kept)
            return self._take([sample])
        if kept and stamp_ns <= kept[-1][1]:
            self.strays += len(kept)
            kept.clear()
        kept.append(sample)
        return self._follow(thermometer, kept) if len(kept) > 1 else []

    def _follow(self, thermometer: int, kept: list[Sample]) -> list[Sample]:
        """Give the samples kept back, if time continues from them."""
        step = self._step[thermometer]
        if not self._leaps(thermometer, kept[-1][1] - kept[-2][1]):
            self.strays += len(kept) - 2
            kept = kept[-2:]
        elif step is not None and len(kept) < _CONFIRMING_SAMPLES:
            return []
        self.leaps += step is not None
        return self._take(kept)

    def _leaps(self, thermometer: int, step_ns: int) -> bool:
        return abs(step_ns) > max(_LEAP_NS, _LEAP_STEPS * (self._step[thermometer] or 0))

    def _take(self, samples: list[Sample]) -> list[Sample]:
        """Give samples of a thermometer, and continue from them."""
        for thermometer, stamp_ns, _ in samples:
            last = self._last[thermometer]
            self._step[thermometer] = None if last is None else stamp_ns - last
            self._last[thermometer] = stamp_ns
        self._kept[samples[0][0]] = []
        return samples
