"""
Temperatures whose stamps leap: one stray stamp must not cost an hour of thermal memory.

A stamp that is hours off would let the drift run through hours that never were. So a sample far
from the one before is kept back until the next one of its thermometer tells: goes it on from
there, time did leap (a long silence, a clock that was set, a simulation that began anew) and both
count; goes it on from before, the stray one is dropped.
"""

from wrist_ft_comp.model.signals import NANOSECONDS

Sample = tuple[int, int, float]


#: Stamps that are farther apart than this leap.
_LEAP_NS = 60 * NANOSECONDS


#: A slow thermometer's samples are that far apart always; a leap is several times as far.
_STEPS = 4


class TimestampFilter:
    """
    Looks at the stamps of several thermometers.

    Parameters
    ----------
    thermometers : int
        Number of thermometers J.

    """

    def __init__(self, thermometers: int) -> None:
        #: Stray samples that were dropped.
        self.strays = 0
        #: Times that time did leap.
        self.leaps = 0
        self._last: list[int | None] = [None] * thermometers
        #: Step between the last two samples, ns; None before the first was taken.
        self._step: list[int | None] = [None] * thermometers
        self._kept: list[Sample | None] = [None] * thermometers

    def expect(self, stamp_ns: int) -> None:
        """
        Say where the stamps are to go on, before the first sample.

        Parameters
        ----------
        stamp_ns : int
            Where another stream ended, ns; a first sample far from it is kept back, too, but going
            on from there is no leap: it may have ended long ago.

        """
        self._last = [stamp_ns] * len(self._last)

    def admit(self, thermometer: int, stamp_ns: int, temperature_c: float) -> list[Sample]:
        """
        Take one sample.

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
        list of tuples of int, int and float
            The samples that count now, in their order: none, this one, or the one that was kept
            back and this one.

        """
        sample = (thermometer, stamp_ns, temperature_c)
        last, kept = self._last[thermometer], self._kept[thermometer]
        if last is None or not self._leaps(thermometer, stamp_ns - last):
            self.strays += kept is not None
            return self._take(sample)
        if kept is None or stamp_ns <= kept[1]:
            self.strays += kept is not None
            self._kept[thermometer] = sample
            return []
        self.leaps += self._step[thermometer] is not None
        return self._take(kept) + self._take(sample)

    def _leaps(self, thermometer: int, step_ns: int) -> bool:
        """Tell whether a step between stamps is a leap."""
        return abs(step_ns) > max(_LEAP_NS, _STEPS * (self._step[thermometer] or 0))

    def _take(self, sample: Sample) -> list[Sample]:
        """Let a sample count."""
        thermometer, stamp_ns, _ = sample
        last = self._last[thermometer]
        self._step[thermometer] = 0 if last is None else stamp_ns - last
        self._last[thermometer], self._kept[thermometer] = stamp_ns, None
        return [sample]
