"""
Clocks, by stamp and by arrival: stray stamps, clocks that leap, run back or stand still.

A stamp is by the clock of a driver, which may be set, or begin anew after a power cycle. Arrival
is by the steady clock of the receiver, which nobody sets; files and simulations have none.

    not later    up to some seconds behind the stamp before: the sample is dropped
    stray        far from the stamps around it: the sample is dropped
    silence      stamps go on elsewhere, and that time passed by arrival, if arrival is known
    clock set    stamps go on elsewhere, and another time passed by arrival
    ran back     stamps go on earlier, and arrival is not known
"""

from dataclasses import dataclass
import math
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.series import BoolArray, IntArray, NANOSECONDS

#: The stamp of a sample that came without one.
NO_TIME = int(np.iinfo(np.int64).min)
#: Stamps leap where they step by more than the first, s, or by more than the second back or beyond
#: what passed by arrival (a bag that is played fast looks so where a thermometer is silent) ...
LEAP_S, _SET_S = 60.0, 5.0
_SET_NS = round(_SET_S * NANOSECONDS)
#: ... and by more usual steps than this, because those of a slow sensor are long.
_LEAP_STEPS = 4
#: Two sources have two clocks where their stamps, less their arrival, differ for this time, s: a
#: busy computer delays for less. Shorter ones would warn of a clock that is being set ...
APART_FOR_S = 30.0
#: ... by more than a thermal cell and this, s. The node looks at wrenches ten times a second.
_LEAST_APART_S = 1.0
#: Specific force that comes farther than this from the wrench, s, is stamped by another clock; so
#: is a topic of a bag whose stamps, less their arrival, are all farther from those of the wrench.
#: 40 s leave about 0.1 N in a warm-up (600 s: 1.8 N); means of a minute have its middle as stamp.
FORCE_APART_S, BAG_APART_S = 2.0, 40.0
#: Only a wrench that came less than this before, s, is compared with.
_FRESH_WRENCH_S = 1.0
#: Stamps of two drivers that lie farther apart come from two clocks, s.
SAME_CLOCK_S = 3600.0


def leaps(step_ns: int, usual_step_ns: int, least_s: float = LEAP_S) -> bool:
    """Whether a step between stamps is longer than a silence that needs no proof."""
    return step_ns > max(least_s * NANOSECONDS, _LEAP_STEPS * usual_step_ns)


class Sample(NamedTuple):
    """A temperature, °C, of a source, counted from 0; arrival is None where it is not known."""

    source: int
    stamp_ns: int
    temperature_c: float
    arrival_ns: int | None = None


class Leap(NamedTuple):
    """Stamps that go on elsewhere; the time that passed is None where nothing shows it."""

    from_ns: int
    to_ns: int
    passed_ns: int | None


@dataclass
class _Clock:
    last: Sample | None = None
    #: Step between the last two samples; None before the second.
    step_ns: int | None = None
    #: A sample far from the last one.
    kept: Sample | None = None


class SourceClocks:
    """
    Checks the stamps of several sources, each against its own last one.

    A sample whose stamp leaps is kept back until the next ones of its source show whether time
    goes on from it, or from the time before.
    """

    def __init__(self, sources: int) -> None:
        #: Samples that were dropped: their stamp was a stray one or not later, or no number.
        self.rejected = 0
        #: How often stamps of a source went on elsewhere.
        self.leaps = 0
        #: A leap of the clock of all sources, at the sample that was taken last.
        self.leap: Leap | None = None
        self._clocks = [_Clock() for _ in range(sources)]
        #: The highest stamp that counted since the last leap.
        self._highest_ns = NO_TIME

    def expect(self, stamp_ns: int) -> None:
        """Set the stamp where another stream ended, with which first samples are compared."""
        self._highest_ns = stamp_ns
        for source, clock in enumerate(self._clocks):
            clock.last = Sample(source, stamp_ns, math.nan)

    def admit(self, sample: Sample) -> list[Sample]:
        """Take a sample; give those that count now: none, this one, or also some kept back."""
        clock, self.leap = self._clocks[sample.source], None
        if not math.isfinite(sample.temperature_c):
            self.rejected += 1
            return []
        last, usual_ns = clock.last, clock.step_ns or 0
        step_ns = 0 if last is None else sample.stamp_ns - last.stamp_ns
        passed_ns = _passed_ns(last, sample)
        ahead_ns = step_ns - (passed_ns or 0)
        if leaps(step_ns, usual_ns):
            step_ns = ahead_ns  # a silence that arrival confirms
        is_known = passed_ns is not None and usual_ns > 0
        is_ahead = leaps(ahead_ns, usual_ns, _SET_S if is_known else LEAP_S)
        kept, clock.kept = clock.kept, None
        if last is None or not (step_ns < -_SET_NS or is_ahead):
            self.rejected += kept is not None
            if last is not None and sample.stamp_ns <= last.stamp_ns:
                self.rejected += 1
                return []
            return self._take(clock, sample)

        if kept is not None:
            # Time goes on from the one that was kept where this one is a step behind it.
            step_ns = sample.stamp_ns - kept.stamp_ns
            usual_ns = max(usual_ns, kept.stamp_ns - last.stamp_ns)
            if step_ns > 0 and (clock.step_ns is None or not leaps(step_ns, usual_ns)):
                self.leap = self._leap_of_all(last, kept, sample)
                ran_back = self.leap is not None and self.leap.to_ns < self.leap.from_ns
                self.leaps += clock.step_ns is not None or ran_back
                return self._take(clock, kept, sample)
            self.rejected += 1
        clock.kept = sample
        return []

    def _leap_of_all(self, last: Sample, first: Sample, second: Sample) -> Leap | None:
        """Find out whether the clock of all was set; one source after the other notices that."""
        passed_ns = _passed_ns(last, first)
        is_silence, follows_others = False, second.stamp_ns >= self._highest_ns - _SET_NS
        if first.stamp_ns > last.stamp_ns:
            is_silence = passed_ns is None
            follows_others = first.stamp_ns <= self._highest_ns + _SET_NS
        if is_silence or follows_others:
            return None
        self._highest_ns = first.stamp_ns
        return Leap(last.stamp_ns, first.stamp_ns, passed_ns)

    def _take(self, clock: _Clock, *samples: Sample) -> list[Sample]:
        for sample in samples:
            clock.step_ns = None if clock.last is None else sample.stamp_ns - clock.last.stamp_ns
            clock.last = sample
            self._highest_ns = max(self._highest_ns, sample.stamp_ns)
        return list(samples)


def _passed_ns(before: Sample | None, after: Sample) -> int | None:
    """Time between two samples by their arrival, ns; None where it is not known."""
    if before is None or before.arrival_ns is None or after.arrival_ns is None:
        return None
    return after.arrival_ns - before.arrival_ns


class ClockComparison:
    """
    Compares the clocks of sources with that of the wrench: how far stamps are ahead of arrival.

    Clocks that leap together are one clock: a source is compared where it reports, with a wrench
    that has just come.
    """

    def __init__(self) -> None:
        #: By how much the stamps of a source are ahead of those of the wrench, s; only sources for
        #: which that has been too much for the whole patience.
        self.ahead_s: dict[str, float] = {}
        #: Stamp and arrival of the newest wrench, ns.
        self._wrench_ns: tuple[float, float] = 0, -math.inf
        self._since_ns: dict[str, int] = {}

    def note_wrench(self, stamp_ns: int, arrival_ns: int) -> None:
        """Take the stamp of a wrench that has just come, and its arrival, ns."""
        self._wrench_ns = stamp_ns, arrival_ns

    def note(self, source: str, stamp_ns: int, arrival_ns: int, limit_s: float) -> None:
        """Take a sample of a source, ns, whose clock may be off by ``limit_s``, or by a second."""
        wrench_ns, came_ns = self._wrench_ns
        if arrival_ns - came_ns > _FRESH_WRENCH_S * NANOSECONDS:
            return
        ahead_s = (stamp_ns - arrival_ns - (wrench_ns - came_ns)) / NANOSECONDS
        if abs(ahead_s) <= max(limit_s, _LEAST_APART_S):
            self._since_ns.pop(source, None)
            self.ahead_s.pop(source, None)
        elif (
            arrival_ns - self._since_ns.setdefault(source, arrival_ns) >= APART_FOR_S * NANOSECONDS
        ):
            self.ahead_s[source] = ahead_s


def in_order(stamps_ns: IntArray, last_ns: int) -> BoolArray:
    """Mark the stamps of a file, (n,), that are no earlier than any before but single strays."""
    before = np.concatenate(([last_ns], stamps_ns))
    this, following, second = stamps_ns[:-2], stamps_ns[1:-1], stamps_ns[2:]
    ahead = (this > following) & (this > second) & (following >= before[:-3])
    before[1:-2][ahead] = NO_TIME
    return (before[1:] > NO_TIME) & (before[1:] >= np.maximum.accumulate(before)[:-1])
