"""
Thermometers that are dead or frozen: what the others predict of one takes its place.

    dead      silent while others report, for longer than a healthy one is
    frozen    silent, or the same to the last bit, while its prediction moves by more than that of
              a healthy one does meanwhile
    believed  it reports, has moved, and was near its prediction for half an hour

One rule for the running stream and for files. No earlier cell is changed: the drift follows a
wrong reading until it is found, and ``Limits`` bounds how fast it moves then.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrist_ft_comp.drift.drift_model import ThermometerPrediction
from wrist_ft_comp.series import BoolArray, differ, FloatArray
from wrist_ft_comp.stream.temperature_jumps import START_S

#: A thermometer has to read the same for this time before it is taken for frozen, s. A coarse one
#: that is read once a minute does so on healthy days.
STILL_S = 180.0
#: One that nobody predicts is doubted after this time, s, at the same value, where that is this
#: many times its longest stand before; if that was above a minute, also the third times its
#: longest stand in the calibration. 270 healthy simulated days and 80 h of a real probe had no
#: false alarm; of 270 freezes 262 were found (without the third).
_STILL_ALONE_S, _STILL_TIMES, _CALIBRATED_TIMES = 600.0, 10.0, 2.0
#: "Before" is this time, s; where less than the second one is known, what the calibration showed.
_KNOWN_S, _LEAST_KNOWN_S = 3600.0, 1800.0
#: A thermometer that was replaced has to agree for this time before it is believed, s.
AGREED_S = 1800.0
#: Predictions are compared after a relaxation with this time constant, s, against their noise.
_SMOOTHING_S = 60.0
#: A gap of all thermometers counts as silence of one for this time at most, s.
_MOST_COUNTED_S = 60.0


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
    heard: BoolArray, period_s: float, gap_s: float, stands_s: Sequence[float | None] = (),
) -> ThermometerState:  # fmt: skip
    """
    Judge the thermometers after a thermal cell of ``period_s`` in which one was heard.

    In the calibration they read the same for ``stands_s`` at most, s: a healthy one may do so.

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
    changed = heard & differ(reading_c, before.reading_c)
    together_c = np.where(changed[:, np.newaxis], reading_c, before.together_c)
    still_s = np.where(changed, 0.0, before.still_s + time_s)
    lowest_c = np.where(changed, smooth_c, np.minimum(before.lowest_c, smooth_c))
    highest_c = np.where(changed, smooth_c, np.maximum(before.highest_c, smooth_c))
    age_s = before.age_s + gap_s + period_s
    state = ThermometerState(
        reading_c, together_c, relaxed_c, predicted_c, smooth_c, lowest_c, highest_c, silent_s,
        still_s, before.agreed_s, age_s, before.reasons)  # fmt: skip
    if age_s < START_S:
        return replace(start(prediction, reading_c, before), age_s=age_s)

    # Replace those that are dead or frozen, where another one is there to predict them. Believe
    # those that have agreed.
    reports = state.reports(prediction)
    usual_s = np.clip([stand_s or 0.0 for stand_s in stands_s] or 0.0, STILL_S, _KNOWN_S)
    is_still = (still_s >= usual_s) | state.suspicious(prediction, 2.0) & (still_s >= STILL_S)
    wrong = ~replaced & ~reports & (is_still | (silent_s > prediction.silence_s))
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


def too_still_s(
    readings_c: FloatArray, period_s: float, calibrated_s: float | None = None
) -> float:
    """
    For how long a thermometer has read the same, s, where that is not likely; else 0.

    Takes what it read in the last cells, °C, (n,). It was never still for a tenth of that in the
    hour before, or, soon after a start, in the calibration (``calibrated_s``, where that is
    known): metal does not stop at once. Where a warm-up ends, readings in coarse steps do: then it
    was never still for half of that in the calibration, either.
    """
    stands, usual_s = stands_s(readings_c, period_s), calibrated_s
    before_s, still_s, ended_s = stands[:-1], float(stands[-1]), np.cumsum(stands[:-1])
    if len(before_s) and ended_s[-1] >= _LEAST_KNOWN_S:
        usual_s = float(before_s[ended_s > ended_s[-1] - _KNOWN_S].max())
    if usual_s is None:
        return 0.0
    longest_s = max(_STILL_ALONE_S, _STILL_TIMES * usual_s)
    if longest_s > _STILL_ALONE_S:
        longest_s = max(longest_s, _CALIBRATED_TIMES * (calibrated_s or 0.0))
    return still_s if still_s > longest_s else 0.0
