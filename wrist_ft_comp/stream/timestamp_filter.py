"""
Temperatures whose stamps leap: one stray stamp must not cost an hour of thermal memory.

A sample far from the one before is kept back until the next samples of its thermometer come. When
one of them goes on from the sample kept back, time did leap (a long silence, a clock that was set,
a simulation that began anew), and both count; it goes on from there if it is a neighbour, or if a
third one rises as they do. When one goes on from before, what was kept back is dropped.
"""

from wrist_ft_comp.signals import NANOSECONDS

#: Thermometer, counted from 0, stamp, ns, and temperature, °C.
Sample = tuple[int, int, float]

#: Stamps that are farther apart than this leap.
_LEAP_NS = 60 * NANOSECONDS
#: Steps of a slow thermometer are always longer; a leap is longer by this factor.
_LEAP_STEPS = 4
#: This many samples in order are a time of their own, however far apart they are.
_CONFIRMING_SAMPLES = 3


class TimestampFilter:
    """Looks at the stamps of several thermometers."""

    def __init__(self, thermometers: int) -> None:
        #: Stray samples that were dropped.
        self.strays = 0
        #: How often time did leap.
        self.leaps = 0
        self._last: list[int | None] = [None] * thermometers
        self._expected: int | None = None
        #: Step between the last two samples, ns; None before the second was taken.
        self._step: list[int | None] = [None] * thermometers
        #: Samples kept back, in the order of their stamps.
        self._kept: list[list[Sample]] = [[] for _ in range(thermometers)]

    def expect(self, stamp_ns: int) -> None:
        """Say where another stream ended: a first sample far from there is kept back, too."""
        self._expected = stamp_ns

    def admit(self, thermometer: int, stamp_ns: int, temperature_c: float) -> list[Sample]:
        """Take a sample; give those that count now: none, this, or some kept back and this."""
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
        """Let the samples kept back count, if time goes on from there."""
        step = self._step[thermometer]
        if not self._leaps(thermometer, kept[-1][1] - kept[-2][1]):
            self.strays += len(kept) - 2
            kept = kept[-2:]
        elif step is not None and len(kept) < _CONFIRMING_SAMPLES:
            return []
        self.leaps += step is not None
        return self._take(kept)

    def _leaps(self, thermometer: int, step_ns: int) -> bool:
        """Tell whether a step between stamps is a leap."""
        return abs(step_ns) > max(_LEAP_NS, _LEAP_STEPS * (self._step[thermometer] or 0))

    def _take(self, samples: list[Sample]) -> list[Sample]:
        """Let samples of a thermometer count."""
        for thermometer, stamp_ns, _ in samples:
            last = self._last[thermometer]
            self._step[thermometer] = None if last is None else stamp_ns - last
            self._last[thermometer] = stamp_ns
        self._kept[samples[0][0]] = []
        return samples
