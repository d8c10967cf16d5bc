"""
Readings of thermometers that changed faster than metal can.

A bad contact, a bus error, or the first conversions of a digital thermometer give readings far
from those before. They are left out until metal could have got there: 0 °C instead of 25 °C for
115 s. What stays for longer is believed then, as if it had been reached on a straight line. The
first readings may be the wrong ones: where others agree with each other for longer than all that
was believed until then, the thermometer begins anew with them.
"""

from dataclasses import dataclass
import math
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.series import BoolArray, FloatArray, IntArray, NANOSECONDS

#: A thermometer in metal does not change by more than this from sample to sample, K ...
JUMP_K = 2.0
#: ... plus this for every second between them, K/s.
JUMP_K_S = 0.2
#: A smaller step than this between two readings is never called a jump, K, ...
_LEAST_JUMP_K = 0.5
#: ... nor one below this many times the largest step that the thermometer usually makes, ...
_USUAL_STEPS = 3.0
#: ... which is forgotten by this factor with each reading that differs from the one before.
_FORGET = 0.97
#: So is the change in this time, s: a driver may average, or report often.
_AVERAGED_S = 10.0
#: Within this time, s, a jump may come back by itself, as after a draught.
#: What comes back no faster than a wrist warms is a loose thermometer in a warm-up.
_COMES_BACK_S = 180.0
#: Wrists warm and cool by no more than this, K/s, unless they were seen to.
FASTEST_K_S = 0.02
#: A start takes the body as soaked at the temperatures after this time, s, because a first reading
#: may be of nothing.
START_S = 10.0
#: Stamp, ns, and temperature, °C.
Reading = tuple[int, float]


def jumps(
    steps_k: FloatArray | float,
    elapsed_s: FloatArray | float,
    fastest_k_s: FloatArray | float = JUMP_K_S,
) -> BoolArray:
    """Say which changes, K, are too fast for metal, by the seconds that each took; any shape."""
    return np.asarray(np.abs(steps_k) > JUMP_K + fastest_k_s * elapsed_s)


def _apart(one: Reading, other: Reading, fastest_k_s: float = JUMP_K_S) -> bool:
    """Whether temperature cannot have gone from one sample to the other, in whole seconds."""
    elapsed_s = abs(other[0] // NANOSECONDS - one[0] // NANOSECONDS)
    return bool(jumps(other[1] - one[1], elapsed_s, fastest_k_s))


@dataclass
class _Run:
    """Readings in a row that agree with each other: when they began, the last one, how many."""

    begin_ns: float
    last: Reading
    count: int = 1


class Jump(NamedTuple):
    """What a thermometer jumped since the last tare, by readings that were believed at last."""

    #: How far in all, K; 0 where it came back.
    by_k: float = 0.0
    #: When last, ns, None if never, and how far it was off until then, K.
    at_ns: int | None = None
    off_k: float = 0.0


class SpikeFilter:
    """Leaves out the readings of a thermometer that changed faster than metal can."""

    def __init__(self) -> None:
        #: How many were left out, and the first of them.
        self.dropped = 0
        self.first: Reading | None = None
        #: The newest that was left out, °C, and what was believed instead.
        self.strange_c = self.believed_c = math.nan
        #: How often the first readings were the wrong ones.
        self.wrong_starts = 0
        self.jump = Jump()
        #: How far it was off, K, until it went back by itself just now, and for how long, s.
        self.went_back: tuple[float, float] | None = None
        #: How far it steps from reading to reading, where it does, K: noise, or its resolution.
        self._usual_k = JUMP_K / _USUAL_STEPS
        #: What was read before a jump from which it may come back by itself.
        self._before: Reading | None = None
        #: What was read up to _AVERAGED_S ago.
        self._earlier: Reading = (0, math.nan)
        #: Since the start, and those that were left out since the last one that was believed.
        self._believed: _Run | None = None
        self._other: _Run | None = None
        #: Whether the drift follows a prediction instead.
        self._is_replaced = False

    def remembered_s(self, now_ns: int, memory_s: float) -> float:
        """For how long a model remembers what it read before it jumped, s; 0 if not."""
        if self.jump.at_ns is None:
            return 0.0
        age_s = max((now_ns - self.jump.at_ns) / NANOSECONDS, 0.0)  # a jump ends no cell
        return max(memory_s - age_s, 0.0)

    @property
    def leaves_out(self) -> bool:
        """Whether the newest reading was left out."""
        return self._other is not None

    def go_on(self, stamp_ns: int, temperature_c: float, jump: Jump) -> None:
        """Continue from a temperature that was believed before, and what was known of jumps."""
        self.jump = jump
        self._earlier = stamp_ns, temperature_c
        self._believed, self._other = _Run(-math.inf, self._earlier), None

    def move_clock(self, by_ns: int) -> None:
        """Follow the clock of the stamps, which was set."""
        for run in (self._believed, self._other):
            if run is not None:
                run.begin_ns += by_ns
                run.last = run.last[0] + by_ns, run.last[1]
        self._earlier = self._earlier[0] + by_ns, self._earlier[1]
        if self._before is not None:
            self._before = self._before[0] + by_ns, self._before[1]
        if self.jump.at_ns is not None:
            self.jump = self.jump._replace(at_ns=self.jump.at_ns + by_ns)

    def admit(self, stamp_ns: int, temperature_c: float) -> bool:
        """Take a sample; whether it counts."""
        sample, believed, other = (stamp_ns, temperature_c), self._believed, self._other
        if believed is None:
            self._believed, self._earlier = _Run(stamp_ns, sample), sample
            return True
        believed_ns, believed_c = believed.last
        agrees = other is not None and not _apart(other.last, sample)
        if not _apart(believed.last, sample):
            self._believed, self._other = _Run(believed.begin_ns, sample, believed.count + 1), None
            before, earlier = believed.last, self._earlier
            by_k = self._jumped_k(before, sample)  # believed, but no wrist does so
            is_due = abs(stamp_ns - earlier[0]) >= _AVERAGED_S * NANOSECONDS
            if is_due and not by_k:
                before, by_k = earlier, self._jumped_k(earlier, sample)
            if is_due or by_k:
                self._earlier = sample
            if other is not None and agrees:  # over a gap, both may have cooled
                by_k = other.last[1] - believed_c
            if by_k:
                self.note_jump(stamp_ns, by_k)
                self._before = self._before or before
            self._look_back(sample)
            return True
        begin_ns = other.begin_ns if other is not None and agrees else stamp_ns
        lasted_ns = believed_ns - believed.begin_ns
        if stamp_ns - begin_ns <= lasted_ns:
            self._other = _Run(begin_ns, sample)
            self.dropped += 1
            self.first = self.first or sample
            self.strange_c, self.believed_c = temperature_c, believed_c
            return False
        # Others agree for longer than all that was believed: that was the wrong one.
        self._believed, self._other, self._earlier = _Run(begin_ns, sample), None, sample
        self.wrong_starts += 1
        self.dropped += believed.count
        self.first = int(believed.begin_ns), believed_c
        self.strange_c, self.believed_c = believed_c, temperature_c
        if lasted_ns > START_S * NANOSECONDS:  # which of both is the wrong one?
            self.note_jump(stamp_ns, temperature_c - believed_c)
        return True

    def _jumped_k(self, before: Reading, sample: Reading) -> float:
        """By how much a thermometer moved, if farther than usually, and than a wrist warms, K."""
        moved_k, elapsed_s = sample[1] - before[1], abs(sample[0] - before[0]) / NANOSECONDS
        step_k = abs(moved_k)
        usual_k = max(_USUAL_STEPS * self._usual_k, _LEAST_JUMP_K)
        if step_k:  # one that gets noisy gets usual
            self._usual_k = max(step_k, _FORGET * self._usual_k)
        # A motor's thermometer may be faster than a wrist; one that is read seldom is not known.
        limit_k = min(usual_k + 2 * FASTEST_K_S * elapsed_s, JUMP_K + FASTEST_K_S * elapsed_s)
        return moved_k if step_k > limit_k else 0.0

    def _look_back(self, sample: Reading) -> None:
        """Forget a jump where readings come back by themselves to what was read before."""
        if self._before is None:
            return
        lasted_s = (sample[0] - self._before[0]) / NANOSECONDS
        size_k = abs(self.jump.by_k or self.jump.off_k)
        if lasted_s > min(_COMES_BACK_S, size_k / FASTEST_K_S):
            self._before = None
        elif abs(sample[1] - self._before[1]) < _LEAST_JUMP_K:
            self.went_back = self.jump.by_k or self.jump.off_k, lasted_s
            self.jump, self._before = Jump(), None

    def note_jump(self, stamp_ns: int, by_k: float) -> None:
        """Take a jump to a temperature that is believed, unless a prediction is used instead."""
        if self._is_replaced:
            return
        off_k, sum_k = self.jump.by_k, self.jump.by_k + by_k
        # It may have warmed meanwhile.
        lasted_s = (stamp_ns - (self.jump.at_ns or stamp_ns)) / NANOSECONDS
        warmed_k = min(_LEAST_JUMP_K + FASTEST_K_S / 2 * lasted_s, JUMP_K)
        came_back = off_k * by_k < 0 and abs(sum_k) < warmed_k
        self.jump = Jump(0.0 if came_back else sum_k, stamp_ns, off_k)

    def end_jump(self, now_ns: int) -> None:
        """Take that a jump that stayed has ended."""
        if self.jump.by_k:
            self.jump = Jump(0.0, now_ns, off_k=self.jump.by_k)

    def replace(self, now_ns: int, *, is_replaced: bool) -> None:
        """Let the drift follow a prediction, or the readings again; a jump that stayed ends so."""
        if is_replaced and not self._is_replaced:
            self.end_jump(now_ns)
        self._is_replaced = is_replaced

    def admit_all(
        self, stamps_ns: IntArray, temperature_c: FloatArray
    ) -> tuple[IntArray, FloatArray]:
        """Take samples, (n,), as ``admit`` does; those before a new beginning are out, too."""
        first, last = ((int(stamps_ns[k]), float(temperature_c[k])) for k in (0, -1))
        before = self._believed or _Run(first[0], first, 0)
        elapsed_s = np.diff(stamps_ns // NANOSECONDS, prepend=before.last[0] // NANOSECONDS)
        steps_k = np.diff(temperature_c, prepend=before.last[1])
        if not self.leaves_out and not jumps(steps_k, elapsed_s, FASTEST_K_S).any():
            self._believed, self._earlier = (
                _Run(before.begin_ns, last, before.count + len(stamps_ns)),
                last,
            )
            return stamps_ns, temperature_c
        counted = np.zeros(len(stamps_ns), dtype=bool)
        for k, sample in enumerate(zip(stamps_ns.tolist(), temperature_c.tolist(), strict=True)):
            starts = self.wrong_starts
            counted[k] = self.admit(*sample)
            if self.wrong_starts > starts:
                counted[:k] = False
        return stamps_ns[counted], temperature_c[counted]
