"""The view of an evaluation: what a model leaves of the drift in recordings."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
import math
from pathlib import Path

import numpy as np

from wrist_ft_comp.calibration.chamber import ChamberFigures
from wrist_ft_comp.calibration.result import Candidate, FoldErrors
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.model.drift_model import StoredModel
from wrist_ft_comp.model.signals import AXES, noise_level, Recording, Reference
from wrist_ft_comp.report.advice import what_was_not_learnt
from wrist_ft_comp.report.coverage import cover
from wrist_ft_comp.report.evaluation import AxisEvaluation, judge_errors, TaredErrors
from wrist_ft_comp.report.verdict import Evidence, judge
from wrist_ft_comp.report.view import (
    AxisView,
    drifts_removed,
    ErrorSeries,
    model_provenance,
    model_sources,
    recording_starts_h,
    ReportView,
    Source,
    thermometer_series,
)


@dataclass(frozen=True, eq=False)
class EvaluatedRecording:
    """
    A recording, what it was compared with, and what came out.

    Attributes
    ----------
    recording : Recording
        On the model's grid.
    reference : {'unloaded', 'constant', 'recorded'}
        What the true wrench was.
    errors : TaredErrors
        What the model leaves of the drift in it.
    figures : mapping of str to ChamberFigures
        Of a chamber table, by title.

    """

    recording: Recording
    reference: Reference
    errors: TaredErrors
    figures: Mapping[str, ChamberFigures] = field(default_factory=dict)


def evaluation_view(
    stored: StoredModel, evaluated: Sequence[EvaluatedRecording], tare_s: float
) -> ReportView:
    """
    Fill a report's view from an evaluation.

    Parameters
    ----------
    stored : StoredModel
        The model.
    evaluated : sequence of EvaluatedRecording
        At least one.
    tare_s : float
        How long they were tared, s.

    Returns
    -------
    ReportView
        Ready to be written.

    Raises
    ------
    RecordingError
        When a recording is in another unit than the others.

    """
    recordings = [each.recording for each in evaluated]
    if len({recording.unit for recording in recordings}) > 1:
        raise RecordingError(
            'These recordings are in different units. Evaluate chamber tables and other '
            'recordings apart.'
        )
    judged = [judge_errors([each.errors]) for each in evaluated]
    each = tuple(zip(recordings, judged, strict=True))
    pooled = judge_errors([each.errors for each in evaluated])
    coverage = cover(recordings)
    series = _series(evaluated, coverage.leading)
    ranges_c = [tuple(each['range_c']) for each in stored.document['thermometers']]
    return ReportView(
        kind='evaluation',
        model=stored.path.name,
        explanation=_explanation(evaluated, tare_s),
        axes=tuple(_axis_view(stored, axis, pooled[axis], series[axis], each) for axis in pooled),
        thermometers=thermometer_series(recordings),
        sources=tuple(Source(each.name, each.duration_s / 3600) for each in recordings),
        coverage=coverage,
        advice=tuple(what_was_not_learnt(coverage, ranges_c)),
        warnings=(
            *_no_proof(stored, recordings),
            *dict.fromkeys(w for each in recordings for w in each.warnings),
        ),
        learnt_from=model_sources(stored),
        provenance=model_provenance(stored),
        tables={each.recording.name: each.figures for each in evaluated if each.figures},
    )


def _no_proof(stored: StoredModel, recordings: Sequence[Recording]) -> Iterator[str]:
    """Say which recordings the model was learnt from: on those it has to be good."""
    learnt = {Path(source.name).name for source in model_sources(stored)}
    for recording in recordings:
        if recording.name in learnt:
            yield (
                f'By its name, {recording.name} is among the recordings that the model was learnt '
                'from, so it does not show what the model does on another day.'
            )


def _explanation(evaluated: Sequence[EvaluatedRecording], tare_s: float) -> str:
    """Say how the errors came about."""
    references = ', '.join(dict.fromkeys(each.reference for each in evaluated))
    return (
        'The model ran on the temperatures of these recordings alone. Raw and compensated '
        f'wrenches were both tared on the first {tare_s:g} s. Reference: {references}.'
    )


def _series(evaluated: Sequence[EvaluatedRecording], leading: int) -> dict[str, ErrorSeries]:
    """Lay errors of all recordings out over time and temperature, by axis."""
    starts = recording_starts_h([each.recording for each in evaluated])
    parts = []
    for number, each in enumerate(evaluated):
        recording = each.recording
        hours = starts[number] + recording.elapsed_s / 3600
        at = recording.temperature_c[:, leading]
        parts.append((hours, at, *each.errors, np.full(len(recording), number)))
    hours, at, before, after, part = (
        np.concatenate(columns) for columns in zip(*parts, strict=True)
    )
    found = {}
    for column, axis in enumerate(AXES):
        rows = np.isfinite(before[:, column]) & np.isfinite(after[:, column])
        found[axis] = ErrorSeries(
            hours[rows], at[rows], before[rows, column], after[rows, column], part[rows]
        )
    return found


def _axis_view(
    stored: StoredModel,
    axis: str,
    errors: AxisEvaluation,
    series: ErrorSeries,
    each: Sequence[tuple[Recording, dict[str, AxisEvaluation]]],
) -> AxisView:
    """Fill the view of one axis; a model need not know it."""
    model = stored.model.axes.get(axis)
    entry = stored.document['axes'].get(axis, {})
    unit = each[0][0].unit_of(axis)
    parts = [(recording.name, found[axis]) for recording, found in each if axis in found]
    noise = noise_level([series.after[series.part == part] for part in np.unique(series.part)])
    evidence = Evidence(
        unit=unit,
        before=errors.rms_before,
        after=errors.rms_after,
        noise=noise,
        compensated=model is not None,
        blocks=FoldErrors(
            np.array([part.rms_before for _, part in parts]),
            np.array([part.rms_after for _, part in parts]),
        ),
        block_name='recording',
    )
    return AxisView(
        axis=axis,
        unit=unit,
        verdict=judge(evidence),
        rms_before=errors.rms_before,
        rms_after=errors.rms_after,
        peak_before=errors.max_before,
        peak_after=errors.max_after,
        series=series,
        drifts=drifts_removed(model),
        chosen=entry.get('chosen', 'none'),
        reason=entry.get('reason', ''),
        time_constants_s=tuple(entry.get('time_constants_s', ())),
        time_constant_errors_s=tuple(
            math.nan if error is None else error
            for error in entry.get('time_constant_errors_s', ())
        ),
        candidates=tuple(Candidate(c['name'], c['rms']) for c in entry.get('candidates', ())),
        notes=tuple(entry.get('notes', ())),
        parts=tuple((name, part.rms_before, part.rms_after) for name, part in parts),
    )
