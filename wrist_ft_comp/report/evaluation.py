"""What a model leaves of the drift in recordings: errors in means over 10 s, and their figures."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from wrist_ft_comp import errors as refusals
from wrist_ft_comp.channels import AXES
from wrist_ft_comp.drift.drift_model import correct, DriftModel, no_drift, StoredModel
from wrist_ft_comp.fit.data_checks import drop_stuck_cells, silent_stretches
from wrist_ft_comp.fit.folds import averaged_cells, mean_over
from wrist_ft_comp.fit.outliers_and_steps import segment
from wrist_ft_comp.payload.separation import learn_at_work
from wrist_ft_comp.recording import Recording, Reference
from wrist_ft_comp.series import FloatArray, rounded
from wrist_ft_comp.stream import drift_of_recordings as replayed
from wrist_ft_comp.stream.drift_warnings import start_doubts
from wrist_ft_comp.stream.tare import tare_at_start

#: Temperatures that leave a range by less than this do not leave it, K.
SAME_K = 0.5


class TaredErrors(NamedTuple):
    """Tared errors against the reference, (n, 6); NaN where there is nothing."""

    before: FloatArray
    after: FloatArray
    #: What was left out or taken out of the recording, in sentences.
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class AxisEvaluation:
    """What is left of an axis, tared, raw and compensated: RMS and largest error."""

    rms_before: float
    rms_after: float
    max_before: float
    max_after: float


def evaluate(
    model: DriftModel, recordings: Sequence[Recording], *,
    reference: Reference = 'unloaded', tare_s: float = 60.0,
) -> dict[str, AxisEvaluation]:  # fmt: skip
    """
    Judge a model on recordings: ``tared_errors`` of each, put into figures by axis.

    Errors are means over 10 s, or over a thermal cell where that is longer: the same that a
    calibration states its figures of.
    """
    return judge_errors([tared_errors(model, one, reference, tare_s) for one in recordings])


def reference_of(recording: Recording, learnt_with: str) -> Reference:
    """Choose what a model was learnt with, where the recording holds it, too, or else unloaded."""
    if learnt_with == 'payload' and recording.specific_force is not None:
        return 'payload'
    if learnt_with == 'recorded' and np.isfinite(recording.reference).any():
        return 'recorded'
    return 'unloaded'


def tared_errors(
    model: DriftModel, recording: Recording, reference: Reference, tare_s: float = 60.0
) -> TaredErrors:
    """
    Subtract the reference from raw and compensated wrenches, both tared, in means over 10 s.

    The correction of a cell comes one cell later, as it does in operation. They are tared on the
    first seconds that hold wrenches; steps of a still load are taken out. Without a recorded
    reference they are compared with zero; with payload, in cells without contact, with the weight
    that is found in this recording. RecordingError where the recording does not fit the model, is
    shorter than the tare, or holds nothing to compare with, CalibrationRefusedError where every
    axis is stuck.
    """
    refusals.check_range('tare_s', tare_s, 0.0, above=True)
    warnings: tuple[str, ...] = ()
    if reference == 'payload':
        work = learn_at_work([recording])
        recording, reference, warnings = work.drift[0], 'recorded', work.warnings
    (recording,), stuck = drop_stuck_cells([recording])
    warnings += tuple(stuck)
    # A load that moves is left as it is.
    with suppress(refusals.CalibrationRefusedError):
        (recording,), sentences = segment([recording], reference)
        if recording.steps:
            sentences.append(
                f'{recording.name} is judged as if ~/tare had been called at each step. Live, the '
                'force is off by all of it until then: do not tare in the driver while it runs.'
            )
        warnings += tuple(sentences)
    true = recording.reference if reference == 'recorded' else np.zeros_like(recording.wrench)
    before, after = (
        correct(recording.wrench, drift, tare_at_start(recording, true, drift, tare_s)) - true
        for drift in (no_drift(len(recording)), replayed.streamed_drift(model, recording))
    )
    if not (np.isfinite(before) & np.isfinite(after)).any():
        raise refusals.RecordingError(
            f'{recording.name} holds no cell with both wrench and reference. Declare the '
            'reference unloaded or constant, or record it.'
        )
    cells = averaged_cells(recording.period_s)
    return TaredErrors(mean_over(before, cells), mean_over(after, cells), warnings)


def judge_errors(recordings: Sequence[TaredErrors]) -> dict[str, AxisEvaluation]:
    """Put errors into figures by axis, those that any recording has: all errors alike."""
    before = np.concatenate([errors.before for errors in recordings])
    after = np.concatenate([errors.after for errors in recordings])
    judged = {}
    for axis, *errors in zip(AXES, before.T, after.T, strict=True):
        both = np.stack(errors)[:, np.isfinite(errors).all(axis=0)]
        if both.size:
            rms = np.sqrt(np.mean(both**2, axis=1))
            judged[axis] = AxisEvaluation(*rms.tolist(), *np.abs(both).max(axis=1).tolist())
    return judged


def range_warnings(stored: StoredModel, recording: Recording) -> Iterator[str]:
    """Say where thermometers leave the range of a model, are silent for long, or are doubted."""
    pairs = zip(recording.temperature_c.T, stored.document['thermometers'], strict=False)
    for number, (column, thermometer) in enumerate(pairs, start=1):
        low, high = thermometer['range_c']
        share = float(np.mean((column < low - SAME_K) | (column > high + SAME_K)))
        if share > 0:
            yield (
                f'Thermometer {number} of {recording.name} goes from {column.min():.1f} to '
                f'{column.max():.1f} °C; the model was learnt from {low:.1f} to {high:.1f} °C. '
                f'For {rounded(100 * share, 2)} % of the time the correction is a guess.'
            )
    yield from start_doubts(stored.model, recording)
    heard = recording.measured
    if stored.model.prediction is not None:  # one that is silent is predicted by the others
        heard = np.broadcast_to(heard.any(axis=1, keepdims=True), heard.shape)
    yield from silent_stretches(replace(recording, measured=heard))
    for find in (replayed.thermometer_doubts, replayed.exchange_doubts):
        for doubt, share in find(stored.model, recording).items():
            yield f'In {recording.name}, for {rounded(100 * share, 2)} % of the time, {doubt}.'
