"""
Thermometers that die or freeze: what the others predict takes their place, until they agree again.

    dead      silent while others report, for longer than a healthy one is
    frozen    silent, or the same to the last bit, while its prediction moves by more than that of
              a healthy one does meanwhile
    believed  it reports, has moved, and was near its prediction for half an hour

Judged is every thermal cell in which a thermometer was heard, by the same rule in the running
stream and in files. No earlier cell is changed: the drift follows a wrong reading until it is
found, and ``Limits`` bounds how fast it moves then.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.drift.drift_model import DriftModel
from wrist_ft_comp.drift.thermometer_prediction import ThermometerPrediction
from wrist_ft_comp.series import BoolArray, FloatArray, NANOSECONDS
from wrist_ft_comp.stream.gap import longest_gap_cells, reporting_cells

#: A thermometer has to read the same for this time before it is taken for frozen, s. A coarse one
#: that is read once a minute does so on healthy days.
STILL_S = 180.0
#: A thermometer that was replaced has to agree for this time before it is believed, s.
AGREED_S = 1800.0
#: Predictions are compared after a relaxation with this time constant, s, against their noise.
_SMOOTHING_S = 60.0
#: A start takes the body as soaked at the temperatures after this time, s, because a first reading
#: may be of nothing.
_START_S = 10.0
#: A gap of all thermometers counts as silence of one for this time at most, s.
_MOST_COUNTED_S = 60.0


class Readings(NamedTuple):
    """A thermal cell in which one of J thermometers was heard."""

    #: As they were read last, °C, (J,), and who was heard in this cell, (J,).
    temperature_c: FloatArray
    heard: BoolArray
    #: Length of the cell, and time before it in which none was heard, s.
    period_s: float
    gap_s: float


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

    def reports(self, prediction: ThermometerPrediction) -> BoolArray:
        """Which thermometers are neither silent nor frozen, (J,)."""
        moved_k = self.highest_c - self.lowest_c
        silent = self.silent_s > prediction.silence_s
        return np.asarray(~silent & (moved_k <= prediction.still_k))

    @property
    def sentences(self) -> list[str]:
        """Say which thermometers are replaced and why, and what the drift follows."""
        return [
            f'thermometer {number} {why}; what the others predict of it is used until it agrees '
            'again'
            for number, why in enumerate(self.reasons, start=1)
            if why
        ]


def start(
    prediction: ThermometerPrediction,
    reading_c: FloatArray,
    before: ThermometerState | None = None,
    past_c: FloatArray | None = None,
    time_s: float = 0.0,
) -> ThermometerState:
    """
    Begin as the thermometers read, (J,): soaked, or after a past of means over some time, (n, J).

    Those that were replaced in a state before stay so.
    """
    past_c = reading_c[np.newaxis] if past_c is None else past_c
    relaxed_c = np.tile(past_c[0], (len(prediction.time_constants_s), 1))
    for mean_c in past_c:
        relaxed_c = prediction.relax(relaxed_c, mean_c, time_s)
    predicted_c, reasons = prediction.predict(relaxed_c), ('',) * len(reading_c)
    if before is not None:
        reasons = before.reasons
        relaxed_c[:, before.replaced] = predicted_c[before.replaced]
    none = np.zeros(len(reading_c))
    return ThermometerState(
        reading_c=reading_c, together_c=np.tile(reading_c, (len(reading_c), 1)),
        relaxed_c=relaxed_c, predicted_c=predicted_c, smooth_c=predicted_c, lowest_c=predicted_c,
        highest_c=predicted_c, silent_s=none, still_s=none, agreed_s=none,
        age_s=len(past_c) * time_s, reasons=reasons)  # fmt: skip


def step(
    prediction: ThermometerPrediction, before: ThermometerState, cell: Readings
) -> ThermometerState:
    """Judge the thermometers after a thermal cell in which one was heard."""
    reading_c, heard, replaced = cell.temperature_c, cell.heard, before.replaced
    lost = replaced & ~before.reports(prediction)

    # Advance the predictions. Those that are lost are predicted from those that report. Several
    # that are lost would be predicted from each other, which can run away: they move along with
    # the others since they were last read anew.
    inputs_c = np.where(lost, before.predicted_c, reading_c)
    relaxed_c = before.relaxed_c
    if cell.gap_s > 0:
        relaxed_c = prediction.relax(relaxed_c, (before.believed_c + inputs_c) / 2, cell.gap_s)
    relaxed_c = prediction.relax(relaxed_c, inputs_c, cell.period_s)
    predicted_c = prediction.predict(relaxed_c)
    if lost.sum() > 1 and not lost.all():
        change_k = (reading_c - before.together_c)[:, ~lost].mean(axis=1)
        predicted_c = np.where(lost, before.reading_c + change_k, predicted_c)
    rough = np.exp(-cell.period_s / _SMOOTHING_S)
    smooth_c = predicted_c + rough * (before.smooth_c - predicted_c)

    # Count for how long each is silent, and has stood still while its prediction moved.
    time_s = min(cell.gap_s + cell.period_s, max(cell.period_s, _MOST_COUNTED_S))
    silent_s = np.where(heard, 0.0, before.silent_s + time_s)
    changed = heard & (reading_c != before.reading_c)
    together_c = np.where(changed[:, np.newaxis], reading_c, before.together_c)
    still_s = np.where(changed, 0.0, before.still_s + time_s)
    lowest_c = np.where(changed, smooth_c, np.minimum(before.lowest_c, smooth_c))
    highest_c = np.where(changed, smooth_c, np.maximum(before.highest_c, smooth_c))
    age_s = before.age_s + cell.gap_s + cell.period_s
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
                    f'by {highest_c[j] - lowest_c[j]:.1f} K'
                )
    for j in np.flatnonzero(agreed_s >= AGREED_S).tolist():
        reasons[j] = ''
    return replace(state, agreed_s=agreed_s, reasons=tuple(reasons))


def judge(
    model: DriftModel, temperature_c: FloatArray, measured: BoolArray
) -> Iterator[ThermometerState]:
    """
    Judge the thermometers of a file after every cell in which one reports.

    Takes temperatures, °C, held where they were not measured, and where they were, (N, J). Yields
    nothing where nobody predicts them, or where none reads the same for long.
    """
    prediction, period_s = model.prediction, model.period_ns / NANOSECONDS
    if prediction is None or not _stands_still(temperature_c, max(round(STILL_S / period_s), 1)):
        return
    cells = reporting_cells(measured, model.period_ns)
    longest = longest_gap_cells(model, model.period_ns)
    state, last = start(prediction, temperature_c[cells[0]]), int(cells[0]) - 1
    for cell in cells.tolist():
        reading_c, missing = temperature_c[cell], cell - last - 1
        if missing > longest:
            state, missing = start(prediction, reading_c, state), 0
        readings = Readings(reading_c, measured[cell], period_s, missing * period_s)
        state = step(prediction, state, readings)
        last = cell
        yield state


def _stands_still(temperature_c: FloatArray, cells: int) -> bool:
    """Whether any of J thermometers, (N, J), reads the same in more cells in a row than some."""
    changes = np.diff(temperature_c, axis=0) != 0
    ends = [np.flatnonzero(column) for column in changes.T]
    return any(np.diff(end, prepend=-1, append=len(changes)).max() >= cells for end in ends)
