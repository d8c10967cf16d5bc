"""What report, terminal and service say: one record of a calibration or of an evaluation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
import shlex
from typing import Any, Literal

import numpy as np

from wrist_ft_comp.channels import AXES, axis_unit
from wrist_ft_comp.drift.drift_model import AxisModel, StoredModel
from wrist_ft_comp.fit.folds import averaged_cells, averaged_s, mean_over
from wrist_ft_comp.fit.result import Calibration, HeldOut, rms_by_fold
from wrist_ft_comp.payload.mounted_payloads import COUNTS
from wrist_ft_comp.payload.weight import LearntPayloads
from wrist_ft_comp.recording import elapsed_s, Recording, Reference, Topics
from wrist_ft_comp.report import advice as advices
from wrist_ft_comp.report import verdict as verdicts
from wrist_ft_comp.report.evaluation import AxisEvaluation, judge_errors, TaredErrors
from wrist_ft_comp.series import FloatArray, IntArray, noise_level, rounded

#: Most things to do next that are shown at once: the first ones help most.
MOST_ADVICE = 3
#: What the figures before and left are.
_FIGURES = 'before, left: root mean square.'
#: Errors below this one, N or N m, are written as 0: no sensor resolves them.
RESOLVED = 1e-6
#: The verdict on an axis that the model does not know, and its entry.
_NOT_HELD = 'The recordings that the model was learnt from do not hold this axis'
_NO_ENTRY = {'chosen': 'none', 'time_constants_s': [], 'candidates': [], 'notes': []}


@dataclass(frozen=True, eq=False)
class ErrorSeries:
    """Errors of one axis over time; all arrays of shape (n,)."""

    #: Time, h, all recordings one after the other.
    hours: FloatArray
    #: Time since the first stamp of the file, s, as ``--exclude`` counts.
    elapsed_s: FloatArray
    #: Without and with compensation, in the axis' unit.
    before: FloatArray
    after: FloatArray
    #: Lines are not drawn from one part to the next.
    part: IntArray

    @property
    def noise(self) -> float:
        """Noise of what is left with compensation, in the axis' unit."""
        return noise_level([self.after[self.part == part] for part in np.unique(self.part)])


@dataclass(frozen=True, eq=False)
class AxisView:
    """One axis."""

    axis: str
    #: N or N m; so are the figures.
    unit: str
    verdict: verdicts.Verdict
    errors: AxisEvaluation
    #: What the errors were made of.
    series: ErrorSeries
    #: What the model's file says of it (model.schema.json).
    entry: Mapping[str, Any]
    #: Largest error on 9 of 10 other days, as the calibration stated it; NaN if unknown.
    day_limit: float
    #: Each recording, its error before, and what is left, RMS; empty where errors are held out.
    parts: Sequence[tuple[str, float, float]] = ()


@dataclass(frozen=True, eq=False)
class EvaluatedRecording:
    """A recording on the model's grid, what it was compared with, and what came out."""

    recording: Recording
    reference: Reference
    errors: TaredErrors


@dataclass(frozen=True, eq=False)
class ReportContent:
    """A report's content."""

    kind: Literal['calibration', 'evaluation']
    stored: StoredModel
    #: Which the errors are of, with the same thermometers.
    recordings: Sequence[Recording]
    coverage: advices.Coverage
    #: How the errors came about.
    explanation: str
    #: In axis order.
    axes: tuple[AxisView, ...]
    #: What to do next, the most useful first.
    advice: tuple[str, ...]
    #: What a person should know.
    warnings: tuple[str, ...]
    #: What was learnt at work: payloads, where some could be identified, and what counted.
    payloads: LearntPayloads | None = None
    at_work: str = ''
    #: What the figures of the table are, and where the limits of another day hold.
    legend: str = ''

    #: Columns of the table that says whether it is good.
    titles = ('axis', 'unit', 'verdict', 'before', 'left', 'peak left', 'limit')

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """Give the cells of that table, as texts."""
        return [
            (axis.axis, axis.unit, verdicts.LEVEL_NAMES[axis.verdict.level],
             *('–' if np.isnan(value) else rounded(value) if value > RESOLVED else '0'
               for value in (axis.errors.rms_before, axis.errors.rms_after, axis.errors.max_after,
                             axis.day_limit)))
            for axis in self.axes
        ]  # fmt: skip

    @property
    def footer(self) -> str:
        """Explain the figures of that table."""
        is_unknown = any(row[-1] == '–' for row in self.rows)
        return self.legend + (' –: not known, record another day.' if is_unknown else '')

    def lines(self) -> list[str]:
        """Say it in lines of text: verdicts, payloads, what to do next, warnings."""
        return [
            *(f'{axis.axis}: {verdicts.LEVEL_NAMES[axis.verdict.level]}. {axis.verdict.sentence}'
              for axis in self.axes),
            *(self.payloads.lines() if self.payloads else ()),
            *(f'next: {sentence}' for sentence in self.advice[:MOST_ADVICE]),
            *(f'warning: {sentence}' for sentence in self.warnings),
        ]  # fmt: skip


def calibration_content(
    calibration: Calibration, recordings: Sequence[Recording], stored: StoredModel,
    options: Sequence[str] = (),
) -> ReportContent:  # fmt: skip
    """Fill a report's content from a calibration; ``options`` read another such table."""
    fits, work = calibration.fits, calibration.separation
    reference = calibration.settings.reference if calibration.settings else 'unloaded'
    # At work, what a payload weighs is the load that was known.
    coverage = advices.cover(recordings if work is None else work.drift)
    axes: list[AxisView] = []
    levels: dict[str, verdicts.Level] = {}
    for axis, fit in fits.items():
        held_out = fit.held_out
        # Drift goes further in a day than in a block: what is stated over what was held out.
        measured = float(rms_by_fold(held_out).after.mean())
        widening = fit.rms_after / measured if measured else 1.0
        series = _series(recordings, held_out)
        before, after = (float(np.abs(e).max()) for e in (series.before, series.after))
        errors = AxisEvaluation(fit.rms_before, fit.rms_after, before, widening * after)
        verdict = verdicts.judge(verdicts.Evidence(
            fit.unit, errors, series.noise, compensated=fit.model is not None, widening=widening,
            parts=rms_by_fold(held_out), refusal=fit.refusal,
            promised=np.isfinite(fit.day_limit) or np.isnan(fit.largest_drift)))  # fmt: skip
        entry = stored.document['axes'][axis]
        axes.append(AxisView(axis, fit.unit, verdict, errors, series, entry, fit.day_limit))
        # An axis that drifts and was not learnt is explained no better than a weak one.
        drifts = fit.refusal or fit.rms_before > verdicts.NOISE_MARGIN * series.noise
        levels[axis] = 'weak' if verdict.level == 'uncalibrated' and drifts else verdict.level
    case = advices.Case(
        recordings, coverage, reference, levels, calibration.warnings,
        run=shlex.join(['wrist_ft_comp', 'evaluate', str(stored.path), 'ANOTHER_DAY', *options]),
        explained=[axis for axis in fits if fits[axis].share_left <= verdicts.GOOD_REMAINDER],
    )  # fmt: skip
    legend, first = _FIGURES, next(iter(fits.values())).held_out
    if len(recordings) == 1 and first.tared:
        minutes = recordings[0].duration_s / len(np.unique(first.fold)) / 60
        legend = f'before: RMS in parts of {minutes:.0f} min. left: RMS, enlarged to a day.'
    at_work = ''
    if work is not None:
        counts, cells = work.fit.weights > COUNTS, sum(map(len, work.recordings))
        share, pushed = counts.sum() / cells, (work.cells.usable & ~counts).sum() / cells
        at_work = (
            f'The model was learnt from {share:.0%} of the time. {pushed:.0%} were taken for '
            'contact; in the rest the robot turned fast, or specific force was missing.'
        )
    # A refusal is the verdict of its axis already.
    refusals = tuple(fit.refusal for fit in fits.values() if fit.refusal)
    return ReportContent(
        kind='calibration', stored=stored, recordings=recordings, coverage=coverage,
        legend=f'{legend} {verdicts.conditions_of_another_day(calibration)}'.strip(),
        explanation=f'Each of {len(np.unique(first.fold))} parts was predicted by a model '
        f'of the others. Errors are means over {first.bin_s:g} s. Reference: {reference}.',
        axes=tuple(axes), advice=advices.advise(case),
        warnings=tuple(w for w in calibration.warnings if not w.startswith(refusals)),
        payloads=calibration.payloads, at_work=at_work)  # fmt: skip


def evaluation_content(
    stored: StoredModel, evaluated: Sequence[EvaluatedRecording], tare_s: float,
    paths: Sequence[Path], topics: Topics,
) -> ReportContent:  # fmt: skip
    """Fill one from an evaluation of recordings at some paths; its node hears ``topics``."""
    recordings = [judged.recording for judged in evaluated]
    coverage, period_s = advices.cover(recordings), averaged_s(stored.model)
    # Means of cells: their middles and errors, all recordings together.
    number = np.repeat(np.arange(len(evaluated)), [len(e.errors.after) for e in evaluated])
    over = averaged_cells(recordings[0].period_s)
    cell = np.concatenate([mean_over(np.arange(len(r), dtype=float), over) for r in recordings])
    means_c = np.concatenate([mean_over(r.temperature_c, over) for r in recordings])
    both = np.concatenate([np.stack((e.errors.before, e.errors.after), 2) for e in evaluated])
    axes: list[AxisView] = []
    for axis, errors in judge_errors([judged.errors for judged in evaluated]).items():
        unit, limit = axis_unit(axis), stored.model.day_limits.get(axis, np.nan)
        left = both[:, AXES.index(axis)]
        rows = np.isfinite(left).all(axis=1)
        # Thermometers that moved while the axis was not read judge nothing.
        read_c = [means_c[rows & (number == n)] for n in np.unique(number[rows])]
        moved_k = max(np.ptp(of_one, axis=0).max() for of_one in read_c)
        # Recordings that the model has not seen are folds that were held out.
        held_out = HeldOut(number[rows], number[rows], cell[rows], left[rows], period_s, True)
        series, by_fold = _series(recordings, held_out), rms_by_fold(held_out)
        names = [recordings[n].name for n in np.unique(held_out.fold)]
        parts = list(zip(names, *by_fold, strict=True))
        verdict = verdicts.judge(verdicts.Evidence(
            unit, errors, series.noise, compensated=axis in stored.model.axes,
            moved_k=moved_k, parts=by_fold, limit=limit,
            refusal='' if axis in stored.document['axes'] else _NOT_HELD))  # fmt: skip
        entry = stored.document['axes'].get(axis, _NO_ENTRY)
        axes.append(AxisView(axis, unit, verdict, errors, series, entry, limit, parts))
    warnings = list(dict.fromkeys(w for recording in recordings for w in recording.warnings))
    references = list(dict.fromkeys(judged.reference for judged in evaluated))
    run = advices.run_command(topics, stored.path)
    # A table and a model of tables name no topics.
    if not {**stored.sensor, **recordings[0].sensor}.get('temperature_topics'):
        words = [str(stored.path), str(paths[0]), *topics.options('')]
        run = f'{shlex.join(["wrist_ft_comp", "compensate", *words])} -o compensated.csv --tare 60'
    is_another_day = not any('The model was learnt from' in warning for warning in warnings)
    case = advices.Case(
        recordings, coverage, references[0], {axis.axis: axis.verdict.level for axis in axes},
        warnings, run=run if is_another_day else '',
        beyond=[axis.axis for axis in axes if axis.errors.max_after > axis.day_limit],
        unlearnt=[axis.axis for axis in axes if axis.verdict.level == 'uncalibrated'
                  and axis.errors.rms_before > verdicts.NOISE_MARGIN * axis.series.noise],
        learnt_c=[tuple(entry['range_c']) for entry in stored.document['thermometers']],
    )  # fmt: skip
    limits = ' limit: largest error on 9 of 10 days, as the calibration stated it.'
    return ReportContent(
        kind='evaluation', stored=stored, recordings=recordings, coverage=coverage,
        explanation='The model ran on the temperatures of these recordings alone. Raw and '
        f'compensated wrenches were both tared on the first {tare_s:g} s. Errors are means over '
        f'{period_s:g} s. Reference: {", ".join(references)}.',
        legend=_FIGURES + (limits if np.isfinite([a.day_limit for a in axes]).any() else ''),
        axes=tuple(axes), advice=advices.advise(case), warnings=tuple(warnings))  # fmt: skip


def drifts_removed(model: AxisModel | None) -> str:
    """Say of what an axis' model removes the drift."""
    if model is None:
        return 'nothing'
    return 'zero and gain' if model.outputs == 2 else 'the zero'


def starts_h(recordings: Sequence[Recording]) -> FloatArray:
    """Put recordings one after the other: where each begins, h, shape (recordings,)."""
    return np.cumsum([0.0, *(recording.duration_s / 3600 for recording in recordings[:-1])])


def _series(recordings: Sequence[Recording], held_out: HeldOut) -> ErrorSeries:
    number, since_s = held_out.recording, (held_out.cell + 0.5) * recordings[0].period_s
    origins_s = np.array([elapsed_s(recording, 0) for recording in recordings])
    return ErrorSeries(
        hours=starts_h(recordings)[number] + since_s / 3600, elapsed_s=origins_s[number] + since_s,
        before=held_out.errors[:, 0], after=held_out.errors[:, -1],
        part=number * (held_out.fold.max() + 1) + held_out.fold)  # fmt: skip


def model_sources(stored: StoredModel) -> list[tuple[str, str]]:
    """List paths and hashes of what a model was made from; what people may have edited is ''."""
    recordings = stored.document['provenance'].get('recordings')
    return [
        (str(source.get('path', '?')), str(source.get('sha256', '')))
        for source in (recordings if isinstance(recordings, list) else [])
        if isinstance(source, dict)
    ]
