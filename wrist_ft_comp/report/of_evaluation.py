"""The view of an evaluation: what a model leaves of the drift in recordings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from wrist_ft_comp.drift.drift_model import StoredModel
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.fit.result import FoldErrors
from wrist_ft_comp.recordings.chamber import ChamberFigures
from wrist_ft_comp.report.advice import what_was_not_learnt
from wrist_ft_comp.report.coverage import cover
from wrist_ft_comp.report.evaluation import judge_errors, TaredErrors
from wrist_ft_comp.report.verdict import Evidence
from wrist_ft_comp.report.view import axis_view, ErrorSeries, one_after_the_other, ReportView
from wrist_ft_comp.signals import AXES, noise_level, Recording, Reference


@dataclass(frozen=True, eq=False)
class EvaluatedRecording:
    """A recording on the model's grid, what it was compared with, and what came out."""

    recording: Recording
    reference: Reference
    errors: TaredErrors
    #: Of a chamber table, by title.
    figures: Mapping[str, ChamberFigures] = field(default_factory=dict)


def evaluation_view(
    stored: StoredModel, evaluated: Sequence[EvaluatedRecording], tare_s: float
) -> ReportView:
    """Fill a report's view from an evaluation; RecordingError when units differ."""
    recordings = [each.recording for each in evaluated]
    if len({recording.unit for recording in recordings}) > 1:
        raise RecordingError(
            'These recordings are in different units. Evaluate chamber tables and other '
            'recordings apart.'
        )
    coverage = cover(recordings)
    series = _series(evaluated, coverage.leading)
    pooled = judge_errors([each.errors for each in evaluated])
    named = [(each.recording.name, judge_errors([each.errors])) for each in evaluated]
    axes = []
    for axis, errors in pooled.items():
        parts = [(name, judged[axis]) for name, judged in named if axis in judged]
        after, part = series[axis].after, series[axis].part
        compared = [
            each.recording.temperature_c[np.isfinite(each.errors.after[:, AXES.index(axis)])]
            for each in evaluated
        ]
        evidence = Evidence(
            unit=recordings[0].unit_of(axis), before=errors.rms_before, after=errors.rms_after,
            noise=noise_level([after[part == each] for each in np.unique(part)]),
            moved_k=max(float(np.ptp(each, axis=0).max()) for each in compared if len(each)),
            compensated=axis in stored.model.axes, block_name='recording',
            blocks=FoldErrors(
                np.array([each.rms_before for _, each in parts]),
                np.array([each.rms_after for _, each in parts])))  # fmt: skip
        axes.append(axis_view(stored, axis, evidence, errors, series[axis], parts=parts))
    ranges_c = [tuple(each['range_c']) for each in stored.document['thermometers']]
    references = ', '.join(dict.fromkeys(each.reference for each in evaluated))
    return ReportView(
        kind='evaluation', stored=stored, recordings=recordings, coverage=coverage,
        explanation='The model ran on the temperatures of these recordings alone. Raw and '
        f'compensated wrenches were both tared on the first {tare_s:g} s. Reference: '
        f'{references}.',
        axes=tuple(axes), advice=(what_was_not_learnt(coverage, ranges_c),),
        warnings=tuple(dict.fromkeys(w for each in recordings for w in each.warnings)),
        tables={each.recording.name: each.figures for each in evaluated if each.figures},
    )  # fmt: skip


def _series(evaluated: Sequence[EvaluatedRecording], leading: int) -> dict[str, ErrorSeries]:
    """Lay errors of all recordings out over time and temperature, by axis."""
    hours, temperature_c, part = one_after_the_other([each.recording for each in evaluated])
    errors = zip(*(each.errors for each in evaluated), strict=True)
    at, before, after = temperature_c[:, leading], *map(np.concatenate, errors)
    series = {}
    for column, axis in enumerate(AXES):
        rows = np.isfinite(before[:, column]) & np.isfinite(after[:, column])
        series[axis] = ErrorSeries(
            hours[rows], at[rows], before[rows, column], after[rows, column], part[rows]
        )
    return series
