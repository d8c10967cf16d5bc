"""The view of an evaluation: what a model leaves of the drift in recordings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from wrist_ft_comp.core.advice import what_was_not_learnt
from wrist_ft_comp.core.axis_fit import Candidate
from wrist_ft_comp.core.chamber_fit import ChamberFigures
from wrist_ft_comp.core.coverage import cover
from wrist_ft_comp.core.evaluation import AxisEvaluation, evaluate, tared_errors
from wrist_ft_comp.core.held_out import BlockErrors
from wrist_ft_comp.core.pooling import pool
from wrist_ft_comp.core.problem import noise_level, Reference
from wrist_ft_comp.core.recording import AXES, axis_unit, Recording
from wrist_ft_comp.core.verdict import Evidence, judge
from wrist_ft_comp.files.model_file import StoredModel
from wrist_ft_comp.files.report_parts import (
    drifts_removed,
    model_provenance,
    model_sources,
    recording_starts_h,
    thermometer_series,
)
from wrist_ft_comp.files.report_view import AxisView, ErrorSeries, ReportView, Source


@dataclass(frozen=True, eq=False)
class EvaluatedRecording:
    """
    A recording and what to compare it with.

    Attributes
    ----------
    recording : Recording
        On the model's grid.
    reference : {'unloaded', 'constant', 'recorded'}
        What the true wrench was.
    figures : mapping of str to ChamberFigures
        Of a chamber table, by title.

    """

    recording: Recording
    reference: Reference
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
        As for evaluate, s.

    Returns
    -------
    ReportView
        Ready to be written.

    Raises
    ------
    RecordingError
        When a recording does not fit the model, or holds nothing to compare with.

    """
    recordings = [each.recording for each in evaluated]
    judged = [evaluate(stored.model, e.recording, e.reference, tare_s) for e in evaluated]
    pooled = pool(judged, [len(recording) for recording in recordings])
    coverage = cover(recordings)
    series = _series(stored, evaluated, tare_s, coverage.leading)
    ranges_c = [tuple(each['range_c']) for each in stored.document['thermometers']]
    return ReportView(
        kind='evaluation',
        model=stored.path.name,
        explanation=_explanation(stored, evaluated, tare_s),
        axes=tuple(
            _axis_view(stored, axis, pooled[axis], series[axis], judged) for axis in pooled
        ),
        thermometers=thermometer_series(recordings),
        sources=tuple(Source(each.name, each.duration_s / 3600) for each in recordings),
        coverage=coverage,
        advice=tuple(what_was_not_learnt(coverage, ranges_c)),
        warnings=tuple(dict.fromkeys(w for each in recordings for w in each.warnings)),
        learnt_from=model_sources(stored),
        provenance=model_provenance(stored),
        tables={each.recording.name: each.figures for each in evaluated if each.figures},
    )


def _explanation(
    stored: StoredModel, evaluated: Sequence[EvaluatedRecording], tare_s: float
) -> str:
    """Say how the errors came about, and whether they are a proof."""
    learnt = {Path(source.name).name for source in model_sources(stored)}
    known = [each.recording.name for each in evaluated if each.recording.name in learnt]
    references = ', '.join(dict.fromkeys(each.reference for each in evaluated))
    proof = (
        f'Beware: by its name, {", ".join(known)} is among the recordings that the model was '
        'learnt from, so this is no proof of what it does on another day. '
        if known
        else 'It was not fitted to them. '
    )
    return (
        f'The model ran on the temperatures of these recordings alone. {proof}Raw and '
        f'compensated wrenches were both tared on the first {tare_s:g} s. '
        f'Reference: {references}.'
    )


def _series(
    stored: StoredModel, evaluated: Sequence[EvaluatedRecording], tare_s: float, leading: int
) -> dict[str, ErrorSeries]:
    """Lay errors of all recordings out over time and temperature, by axis."""
    starts = recording_starts_h([each.recording for each in evaluated])
    parts = []
    for number, each in enumerate(evaluated):
        recording = each.recording
        before, after = tared_errors(stored.model, recording, each.reference, tare_s)
        hours = starts[number] + recording.elapsed_s / 3600
        at = recording.temperature_c[:, leading]
        parts.append((hours, at, before, after, np.full(len(recording), number)))
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
    judged: Sequence[dict[str, AxisEvaluation]],
) -> AxisView:
    """Fill the view of one axis; a model need not know it."""
    model = stored.model.axes.get(axis)
    entry = stored.document['axes'].get(axis, {})
    each = [result[axis] for result in judged if axis in result]
    noise = noise_level([series.after[series.part == part] for part in np.unique(series.part)])
    evidence = Evidence(
        unit=axis_unit(axis),
        before=errors.rms_before,
        after=errors.rms_after,
        noise=noise,
        compensated=model is not None,
        blocks=BlockErrors(
            np.array([e.rms_before for e in each]), np.array([e.rms_after for e in each])
        ),
        block_name='recording',
    )
    return AxisView(
        axis=axis,
        unit=axis_unit(axis),
        verdict=judge(evidence),
        rms_before=errors.rms_before,
        rms_after=errors.rms_after,
        peak_before=errors.max_before,
        peak_after=errors.max_after,
        series=series,
        drifts=drifts_removed(model),
        chosen=entry.get('chosen', 'none'),
        time_constants_s=tuple(entry.get('time_constants_s', ())),
        candidates=tuple(Candidate(c['name'], c['rms']) for c in entry.get('candidates', ())),
        notes=tuple(entry.get('notes', ())),
    )
