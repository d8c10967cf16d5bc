"""What a model leaves of the drift in recordings: errors cell by cell, and their figures."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.drift.drift_model import correct, DriftModel, no_drift
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.payload.at_work import learn_at_work
from wrist_ft_comp.signals import AXES, FloatArray, Recording, Reference, require_recordings
from wrist_ft_comp.stream.offline import simulate_drift, tare_at_start


class TaredErrors(NamedTuple):
    """Tared errors of every cell against the reference, (N, 6); NaN where there is nothing."""

    before: FloatArray
    after: FloatArray


@dataclass(frozen=True)
class AxisEvaluation:
    """What is left of an axis, tared, raw and compensated: RMS and largest of thermal cells."""

    rms_before: float
    rms_after: float
    max_before: float
    max_after: float


def evaluate(
    model: DriftModel,
    recordings: Sequence[Recording],
    *,
    reference: Reference = 'unloaded',
    tare_s: float = 60.0,
) -> dict[str, AxisEvaluation]:
    """Judge a model on recordings: ``tared_errors`` of each, put into figures by axis."""
    require_recordings(recordings)
    return judge_errors(
        [tared_errors(model, recording, reference, tare_s) for recording in recordings]
    )


def tared_errors(
    model: DriftModel, recording: Recording, reference: Reference, tare_s: float = 60.0
) -> TaredErrors:
    """
    Subtract the reference from raw and compensated means of cells, both tared.

    They are tared on the first seconds that hold wrenches. Without a recorded reference they are
    compared with zero; with payload, in cells without contact, with the weight that is found in
    this recording.

    Raises
    ------
    RecordingError
        When the recording does not fit the model, or holds nothing to compare with.

    """
    if reference == 'payload':
        recording, reference = learn_at_work([recording]).drift[0], 'recorded'
    simulated = simulate_drift(model, recording)
    true = recording.reference if reference == 'recorded' else np.zeros_like(recording.wrench)
    before, after = (
        correct(recording.wrench, drift, tare_at_start(recording, true, drift, tare_s)) - true
        for drift in (no_drift(len(recording)), simulated)
    )
    if not (np.isfinite(before) & np.isfinite(after)).any():
        raise RecordingError(
            f'{recording.name} holds no cell with both wrench and reference. Declare the '
            'reference unloaded or constant, or record it.'
        )
    return TaredErrors(before, after)


def judge_errors(recordings: Sequence[TaredErrors]) -> dict[str, AxisEvaluation]:
    """Put errors into figures by axis, those that any recording has: all cells alike."""
    before, after = (np.concatenate(parts) for parts in zip(*recordings, strict=True))
    judged = {}
    for column, axis in enumerate(AXES):
        both = np.stack((before[:, column], after[:, column]))
        both = both[:, np.isfinite(both).all(axis=0)]
        if both.shape[1]:
            rms = np.sqrt(np.mean(both**2, axis=1))
            peak = np.max(np.abs(both), axis=1)
            judged[axis] = AxisEvaluation(*rms.tolist(), *peak.tolist())
    return judged
