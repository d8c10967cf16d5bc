"""
Thermometers that are not believed: those that change faster than metal can, or are dead or frozen.

A bad contact, a bus error, or the first conversions of a digital thermometer give readings far
from those before. They are left out until metal could have got there: 0 °C instead of 25 °C for
115 s. What stays for longer is believed then, as if it had been reached on a straight line. The
first readings may be the wrong ones: where others agree with each other for longer than all that
was believed until then, the thermometer begins anew with them.

What the others predict takes the place of one that died or froze, until it agrees again.

    dead      silent while others report, for longer than a healthy one is
    frozen    silent, or the same to the last bit, while its prediction moves by more than that of
              a healthy one does meanwhile
    believed  it reports, has moved, and was near its prediction for half an hour

Both are one rule for the running stream and for files. No earlier cell is changed: the drift
follows a wrong reading until it is found, and ``Limits`` bounds how fast it moves then.
"""

from dataclasses import dataclass, replace
import math
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.drift.drift_model import ThermometerPrediction
from wrist_ft_comp.series import BoolArray, differ, FloatArray, IntArray, NANOSECONDS

#: A thermometer in metal does not change by more than this from sample to sample, K ...
JUMP_K = 2.0
#: ... plus this for every second between them, K/s.
_JUMP_K_S = 0.2

#: A thermometer has to read the same for this time before it is taken for frozen, s. A coarse one
#: that is read once a minute does so on healthy days.
STILL_S = 180.0
#: One that nobody predicts is doubted after this time, s, at the same value, where that is this
#: many times its longest stand before. 270 healthy simulated days and 80 h of a real probe had no
#: false alarm; of 270 freezes 262 were found.
_STILL_ALONE_S, _STILL_TIMES = 600.0, 10.0
#: "Before" is this time, s; where less than the second one is known, what the calibration showed.
_KNOWN_S, _LEAST_KNOWN_S = 3600.0, 1800.0
#: A thermometer that was replaced has to agree for this time before it is believed, s.
AGREED_S = 1800.0
#: Predictions are compared after a relaxation with this time constant, s, against their noise.
_SMOOTHING_S = 60.0
#: A start takes the body as soaked at the temperatures after this time, s, because a first reading
#: may be of nothing.
_START_S = 10.0
#: A gap of all thermometers counts as silence of one for this time at most, s.
_MOST_COUNTED_S = 60.0

#: Stamp, ns, and temperature, °C.
Reading = tuple[int, float]


def jumps(steps_k: FloatArray | float, elapsed_s: FloatArray | float) -> BoolArray:
    """Say which changes, K, are too fast for metal, by the seconds that each took; any shape."""
    return np.asarray(np.abs(steps_k) > JUMP_K + _JUMP_K_S * elapsed_s)


def _apart(one: Reading, other: Reading) -> bool:
    """Whether temperature cannot have gone from one sample to the other, in whole seconds."""
    elapsed_s = abs(other[0] // NANOSECONDS - one[0] // NANOSECONDS)
    return bool(jumps(other[1] - one[1], elapsed_s))


@dataclass
class _Run:
    """Readings in a row that agree with each other: when they began, the last one, how many."""

    begin_ns: float
    last: Reading
    count: int = 1


class Jump(NamedTuple):
    """What a thermometer jumped since the last tare, by readings that were believed at last."""

    #: How far in all, K.
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
        #: Since the start, and those that were left out since the last one that was believed.
        self._believed: _Run | None = None
        self._other: _Run | None = None
        #: Whether the drift follows a prediction instead.
        self._is_replaced = False

    @property
    def stayed_k(self) -> float:
        """How far it has jumped and stayed since the last tare, K; 0 where it came back."""
        return self.jump.by_k if abs(self.jump.by_k) > JUMP_K else 0.0

    def remembered_s(self, now_ns: int, memory_s: float) -> float:
        """For how long a model remembers what it read before it jumped, s; 0 if not."""
        if self.jump.at_ns is None:
            return 0.0
        age_s = (now_ns - self.jump.at_ns) / NANOSECONDS
        return max(memory_s - age_s, 0.0)

    @property
    def leaves_out(self) -> bool:
        """Whether the newest reading was left out."""
        return self._other is not None

    def go_on(self, stamp_ns: int, temperature_c: float, jump: Jump) -> None:
        """Continue from a temperature that was believed before, and what was known of jumps."""
        self.jump = jump
        self._believed = _Run(-math.inf, (stamp_ns, temperature_c))
        self._other = None

    def move_clock(self, by_ns: int) -> None:
        """Follow the clock of the stamps, which was set."""
        for run in (self._believed, self._other):
            if run is not None:
                run.begin_ns += by_ns
                run.last = run.last[0] + by_ns, run.last[1]
        if self.jump.at_ns is not None:
            self.jump = self.jump._replace(at_ns=self.jump.at_ns + by_ns)

    def admit(self, stamp_ns: int, temperature_c: float) -> bool:
        """Take a sample; whether it counts."""
        sample, believed, other = (stamp_ns, temperature_c), self._believed, self._other
        if believed is None:
            self._believed = _Run(stamp_ns, sample)
            return True
        believed_ns, believed_c = believed.last
        agrees = other is not None and not _apart(other.last, sample)
        if not _apart(believed.last, sample):
            self._believed, self._other = _Run(believed.begin_ns, sample, believed.count + 1), None
            if other is not None and agrees:  # over a gap, both may have cooled
                self.note_jump(stamp_ns, other.last[1] - believed_c)
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
        self._believed, self._other = _Run(begin_ns, sample), None
        self.wrong_starts += 1
        self.dropped += believed.count
        self.first = int(believed.begin_ns), believed_c
        self.strange_c, self.believed_c = believed_c, temperature_c
        if lasted_ns > _START_S * NANOSECONDS:  # which of both is the wrong one?
            self.note_jump(stamp_ns, temperature_c - believed_c)
        return True

    def note_jump(self, stamp_ns: int, by_k: float) -> None:
        """Take a jump to a temperature that is believed, unless a prediction is used instead."""
        if not self._is_replaced:
            self.jump = Jump(self.jump.by_k + by_k, stamp_ns, off_k=self.stayed_k)

    def end_jump(self, now_ns: int) -> None:
        """Take that a jump that stayed has ended."""
        if self.stayed_k:
            self.jump = Jump(0.0, now_ns, off_k=self.stayed_k)

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
        jumped = jumps(np.diff(temperature_c, prepend=before.last[1]), elapsed_s)
        if not self.leaves_out and not jumped.any():
            self._believed = _Run(before.begin_ns, last, before.count + len(stamps_ns))
            return stamps_ns, temperature_c
        counted = np.zeros(len(stamps_ns), dtype=bool)
        for k, sample in enumerate(zip(stamps_ns.tolist(), temperature_c.tolist(), strict=True)):
            starts = self.wrong_starts
            counted[k] = self.admit(*sample)
            if self.wrong_starts > starts:
                counted[:k] = False
        return stamps_ns[counted], temperature_c[counted]


@dataclass(frozen=True, eq=False)
class ThermometerState:
    """What the last cell left of J thermometers."""

    #: As they were read last, °C, (J,).
    reading_c: FloatArray
    #: What all of them read when each was last read anew, °C, (J, J).
    together_c: FloatArray
    #: Temperatures behind the K relaxations of the prediction, °C, (K, J).
    relaxed_c: FloatArray
    #: What each should read, °C, (J,), and the same without its noise.
    predicted_c: FloatArray
    smooth_c: FloatArray
    #: Range of the latter since the thermometer read something else, °C, (J,).
    lowest_c: FloatArray
    highest_c: FloatArray
    #: For how long each has been silent, has read the same, and has agreed, s, (J,).
    silent_s: FloatArray
    still_s: FloatArray
    agreed_s: FloatArray
    #: Time since the start, s.
    age_s: float
    #: Why each is replaced by its prediction, (J,); empty for those that are believed.
    reasons: tuple[str, ...]

    @property
    def replaced(self) -> BoolArray:
        """Which thermometers are replaced by their predictions, (J,)."""
        return np.array([bool(why) for why in self.reasons])

    @property
    def believed_c(self) -> FloatArray:
        """What the drift follows, °C, (J,)."""
        return np.where(self.replaced, self.predicted_c, self.reading_c)

    @property
    def moved_k(self) -> FloatArray:
        """How far the predictions moved since the thermometers read something else, K, (J,)."""
        return self.highest_c - self.lowest_c

    def reports(self, prediction: ThermometerPrediction) -> BoolArray:
        """Which thermometers are neither silent nor frozen, (J,)."""
        silent = self.silent_s > prediction.silence_s
        return np.asarray(~silent & (self.moved_k <= prediction.still_k))

    def suspicious(self, prediction: ThermometerPrediction, share: float) -> BoolArray:
        """Which stand still, and should have moved by a share of what replaces them, (J,)."""
        has_moved = self.moved_k > share * prediction.still_k
        return np.asarray((self.still_s >= _SMOOTHING_S) & has_moved & ~self.replaced)

    @property
    def sentences(self) -> list[str]:
        """Say which thermometers are replaced and why, and what the drift follows."""
        sentences, minutes = [], AGREED_S / 60
        for number, why in enumerate(self.reasons, start=1):
            agreed_s = self.agreed_s[number - 1]
            if why and agreed_s > 0:
                sentences.append(
                    f'thermometer {number} agrees with what the others predict of it since '
                    f'{agreed_s / 60:.0f} min; it is believed again after {minutes:.0f} min'
                )
            elif why:
                sentences.append(
                    f'thermometer {number} {why}; what the others predict of it is used until it '
                    f'agrees with that for {minutes:.0f} min'
                )
        return sentences


def start(
    prediction: ThermometerPrediction,
    reading_c: FloatArray,
    before: ThermometerState | None = None,
) -> ThermometerState:
    """Begin soaked as the thermometers read, °C, (J,); those that were replaced stay so."""
    relaxed_c = np.tile(reading_c, (len(prediction.time_constants_s), 1))
    predicted_c, reasons = prediction.predict(relaxed_c), ('',) * len(reading_c)
    if before is not None:
        reasons = before.reasons
        relaxed_c[:, before.replaced] = predicted_c[before.replaced]
    none = np.zeros(len(reading_c))
    return ThermometerState(
        reading_c=reading_c, together_c=np.tile(reading_c, (len(reading_c), 1)),
        relaxed_c=relaxed_c, predicted_c=predicted_c, smooth_c=predicted_c, lowest_c=predicted_c,
        highest_c=predicted_c, silent_s=none, still_s=none, agreed_s=none,
        age_s=0.0, reasons=reasons)  # fmt: skip


def step(  # noqa: PLR0913, PLR0917 -- a cell as it comes
    prediction: ThermometerPrediction, before: ThermometerState, reading_c: FloatArray,
    heard: BoolArray, period_s: float, gap_s: float,
) -> ThermometerState:  # fmt: skip
    """
    Judge the thermometers after a thermal cell of ``period_s`` in which one was heard.

    They were read last as ``reading_c``, (J,); ``heard``, (J,), are those of this cell. None was
    heard for ``gap_s`` before.
    """
    replaced = before.replaced
    lost = replaced & ~before.reports(prediction)

    # Advance the predictions. Those that are lost are predicted from those that report. Several
    # that are lost would be predicted from each other, which can run away: they move along with
    # the others since they were last read anew.
    inputs_c = np.where(lost, before.predicted_c, reading_c)
    relaxed_c = before.relaxed_c
    if gap_s > 0:
        relaxed_c = prediction.relax(relaxed_c, (before.believed_c + inputs_c) / 2, gap_s)
    relaxed_c = prediction.relax(relaxed_c, inputs_c, period_s)
    predicted_c = prediction.predict(relaxed_c)
    if lost.sum() > 1 and not lost.all():
        change_k = (reading_c - before.together_c)[:, ~lost].mean(axis=1)
        predicted_c = np.where(lost, before.reading_c + change_k, predicted_c)
    rough = np.exp(-period_s / _SMOOTHING_S)
    smooth_c = predicted_c + rough * (before.smooth_c - predicted_c)

    # Count for how long each is silent, and has stood still while its prediction moved.
    time_s = min(gap_s + period_s, max(period_s, _MOST_COUNTED_S))
    silent_s = np.where(heard, 0.0, before.silent_s + time_s)
    changed = heard & (reading_c != before.reading_c)
    together_c = np.where(changed[:, np.newaxis], reading_c, before.together_c)
    still_s = np.where(changed, 0.0, before.still_s + time_s)
    lowest_c = np.where(changed, smooth_c, np.minimum(before.lowest_c, smooth_c))
    highest_c = np.where(changed, smooth_c, np.maximum(before.highest_c, smooth_c))
    age_s = before.age_s + gap_s + period_s
    state = ThermometerState(
        reading_c, together_c, relaxed_c, predicted_c, smooth_c, lowest_c, highest_c, silent_s,
        still_s, before.agreed_s, age_s, before.reasons)  # fmt: skip
    if age_s < _START_S:
        return replace(start(prediction, reading_c, before), age_s=age_s)

    # Replace those that are dead or frozen, where another one is there to predict them. Believe
    # those that have agreed.
    reports = state.reports(prediction)
    wrong = ~replaced & ~reports & ((still_s >= STILL_S) | (silent_s > prediction.silence_s))
    agrees = replaced & reports & (np.abs(reading_c - smooth_c) <= prediction.agree_k)
    agreed_s = np.where(agrees, before.agreed_s + time_s, 0.0)
    reasons = list(before.reasons)
    if (heard & ~replaced & ~wrong).any():
        for j in np.flatnonzero(wrong).tolist():
            reasons[j] = 'is silent'
            if silent_s[j] < min(STILL_S, prediction.silence_s[j]):
                reasons[j] = (
                    f'stands still at {reading_c[j]:.1f} °C while the others show that it moved '
                    f'by {state.moved_k[j]:.1f} K'
                )
    for j in np.flatnonzero(agreed_s >= AGREED_S).tolist():
        reasons[j] = ''
    return replace(state, agreed_s=agreed_s, reasons=tuple(reasons))


def stands_s(readings_c: FloatArray, period_s: float) -> FloatArray:
    """Give how long a thermometer read the same, s, one time after the other, the last at last."""
    begins = np.flatnonzero(differ(readings_c[1:], readings_c[:-1])) + 1
    return np.diff(begins, prepend=0, append=len(readings_c)) * period_s


def too_still_s(readings_c: FloatArray, period_s: float, usual_s: float | None = None) -> float:
    """
    For how long a thermometer has read the same, s, where that is not likely; else 0.

    Takes what it read in the last cells, °C, (n,). It was never still for a tenth of that in the
    hour before, or, soon after a start, in the calibration (``usual_s``, where that is known).
    Metal does not stop at once.
    """
    *before, still_s = stands_s(readings_c, period_s).tolist()
    ended_s = np.cumsum(before)
    if before and ended_s[-1] >= _LEAST_KNOWN_S:
        usual_s = max(np.array(before)[ended_s > ended_s[-1] - _KNOWN_S].tolist())
    is_likely = usual_s is None or still_s <= max(_STILL_ALONE_S, _STILL_TIMES * usual_s)
    return 0.0 if is_likely else still_s
