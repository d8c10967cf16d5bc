"""The view of an evaluation: what a model leaves of the drift in recordings."""

from collections.abc import Mapping, Sequence
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
    model_sources,
    recording_starts_h,
    ReportView,
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
    coverage = cover(recordings)
    series = _series(evaluated, coverage.leading)
    pooled = judge_errors([each.errors for each in evaluated])
    parts = [(each.recording.name, judge_errors([each.errors])) for each in evaluated]
    ranges_c = [tuple(each['range_c']) for each in stored.document['thermometers']]
    references = ', '.join(dict.fromkeys(each.reference for each in evaluated))
    learnt = {Path(source.name).name for source in model_sources(stored)}
    no_proof = [
        f'By its name, {recording.name} is among the recordings that the model was learnt from, '
        'so it does not show what the model does on another day.'
        for recording in recordings
        if recording.name in learnt
    ]
    return ReportView(
        kind='evaluation',
        stored=stored,
        recordings=recordings,
        coverage=coverage,
        explanation=(
            'The model ran on the temperatures of these recordings alone. Raw and compensated '
            f'wrenches were both tared on the first {tare_s:g} s. Reference: {references}.'
        ),
        axes=tuple(
            _axis_view(
                stored,
                axis,
                unit=recordings[0].unit_of(axis),
                errors=errors,
                series=series[axis],
                parts=[(name, axes[axis]) for name, axes in parts if axis in axes],
            )
            for axis, errors in pooled.items()
        ),
        advice=(what_was_not_learnt(coverage, ranges_c),),
        warnings=(*no_proof, *dict.fromkeys(w for each in recordings for w in each.warnings)),
        tables={each.recording.name: each.figures for each in evaluated if each.figures},
    )


def _series(evaluated: Sequence[EvaluatedRecording], leading: int) -> dict[str, ErrorSeries]:
    """Lay errors of all recordings out over time and temperature, by axis."""
    starts = recording_starts_h([each.recording for each in evaluated])
    parts = []
    for number, each in enumerate(evaluated):
        hours = starts[number] + each.recording.elapsed_s / 3600
        at = each.recording.temperature_c[:, leading]
        parts.append((hours, at, *each.errors, np.full(len(hours), number)))
    hours, at, before, after, part = map(np.concatenate, zip(*parts, strict=True))
    series = {}
    for column, axis in enumerate(AXES):
        rows = np.isfinite(before[:, column]) & np.isfinite(after[:, column])
        series[axis] = ErrorSeries(
            hours[rows], at[rows], before[rows, column], after[rows, column], part[rows]
        )
    return series


def _axis_view(  # noqa: PLR0913 -- what is known of one axis, each a plain value
    stored: StoredModel,
    axis: str,
    *,
    unit: str,
    errors: AxisEvaluation,
    series: ErrorSeries,
    parts: Sequence[tuple[str, AxisEvaluation]],
) -> AxisView:
    """Fill the view of one axis; a model need not know it."""
    model = stored.model.axes.get(axis)
    entry = stored.document['axes'].get(axis, {})
    evidence = Evidence(
        unit=unit,
        before=errors.rms_before,
        after=errors.rms_after,
        noise=noise_level([series.after[series.part == part] for part in np.unique(series.part)]),
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
