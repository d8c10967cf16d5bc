"""What a report shows: one record, built from a calibration or from an evaluation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from wrist_ft_comp.channels import AXES, axis_unit
from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.drift.drift_model import StoredModel
from wrist_ft_comp.fit.folds import averaged_cells, averaged_s
from wrist_ft_comp.fit.result import AxisFit, Calibration, FoldErrors, HeldOut, rms_by_fold
from wrist_ft_comp.learning.diary import Diary
from wrist_ft_comp.payload.accelerometer import describe_force, moments_of
from wrist_ft_comp.payload.payload_states import COUNTS
from wrist_ft_comp.payload.weight import LearntPayloads
from wrist_ft_comp.ranges import rounded
from wrist_ft_comp.recording import Recording, Reference
from wrist_ft_comp.report.coverage import (
    cover,
    Coverage,
    what_to_record_next,
    what_was_not_learnt,
)
from wrist_ft_comp.report.evaluation import (
    AxisEvaluation,
    judge_errors,
    mean_over,
    TaredErrors,
)
from wrist_ft_comp.report.summary import another_day, conditions_of_another_day
from wrist_ft_comp.report.verdict import Evidence, judge, Level, Verdict
from wrist_ft_comp.series import FloatArray, IntArray, NANOSECONDS, noise_level

#: Length of the response to a step that is drawn, s: what a body does later is hardly seen in a
#: warm-up.
_RESPONSE_S = 7200.0
#: A recording is named where a model of the others leaves this many times the median of it.
_HARD_RATIO = 1.5
#: The entry of an axis that the model does not know.
_NO_ENTRY = {
    'chosen': 'none', 'reason': '', 'time_constants_s': [], 'candidates': [], 'notes': [],
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class ErrorSeries:
    """Errors of one axis, over time and over temperature; all arrays of shape (n,)."""

    #: Time, h, all recordings one after the other.
    hours: FloatArray
    #: Of the leading thermometer.
    temperature_c: FloatArray
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
    verdict: Verdict
    errors: AxisEvaluation
    #: What the errors were made of.
    series: ErrorSeries
    #: Which drifts are removed.
    drifts: str
    #: What the model's file says of it (model.schema.json).
    entry: Mapping[str, Any]
    #: How zero drift follows each thermometer that warms by 1 K, at T_ref, and stays there: min
    #: since it warmed, (n,), and what is added, (J, n). Without a model, none.
    responses: tuple[FloatArray, FloatArray] | None
    #: What another day is accepted by, a sentence; empty where nothing is stated.
    limit: str = ''
    #: Each recording and its errors; empty where errors are held out.
    parts: Sequence[tuple[str, AxisEvaluation]] = ()


@dataclass(frozen=True, eq=False)
class AtWork:
    """What was learnt at work."""

    #: None where no payload could be identified.
    learnt: LearntPayloads | None
    #: How much of the time counted, and what was seen, in a sentence.
    used: str
    #: Tares of the driver that were taken out.
    steps: int


@dataclass(frozen=True, eq=False)
class EvaluatedRecording:
    """A recording on the model's grid, what it was compared with, and what came out."""

    recording: Recording
    reference: Reference
    errors: TaredErrors

    def averaged(self, values: FloatArray) -> FloatArray:
        """Average values by cell, (N, …), over the time of every error, (n, …)."""
        return mean_over(values, averaged_cells(self.recording.period_s))

    @property
    def temperature_c(self) -> FloatArray:
        """Temperatures of the errors, (n, J)."""
        return self.averaged(self.recording.temperature_c)


@dataclass(frozen=True, eq=False)
class ReportContent:
    """A report's content."""

    kind: Literal['calibration', 'evaluation']
    stored: StoredModel
    #: Which the errors are of, with the same thermometers.
    recordings: Sequence[Recording]
    #: Temperatures and loads of these.
    coverage: Coverage
    #: How the errors came about.
    explanation: str
    #: In axis order.
    axes: tuple[AxisView, ...]
    #: What to record next, most important first.
    advice: tuple[str, ...]
    #: What a person should know.
    warnings: tuple[str, ...]
    #: What was learnt at work, if it was.
    work: AtWork | None = None
    #: Under which conditions the limits of another day hold; empty where none is stated.
    conditions: str = ''
    #: The days of the node that learnt the model by itself, if one did.
    diary: Diary | None = None

    @property
    def provenance(self) -> dict[str, str]:
        """Where the model came from, for people, by name."""
        document = self.stored.document
        provenance = document['provenance']
        ranges = (thermometer['range_c'] for thermometer in document['thermometers'])
        return {
            'model file': str(self.stored.path),
            'SHA-256': self.stored.sha256,
            'made': str(provenance.get('created', 'at an unknown time')),
            'recorded': f'{document["duration_s"] / 3600:.2f} h',
            'temperatures': ', '.join(f'{low:.1f} to {high:.1f} °C' for low, high in ranges),
            'thermal period': f'{self.stored.model.period_ns / NANOSECONDS:g} s',
            'versions': _listed(provenance.get('versions')),
            'settings': _listed(provenance.get('settings')),
        }


def calibration_content(
    calibration: Calibration,
    recordings: Sequence[Recording],
    stored: StoredModel,
    reference: Reference,
) -> ReportContent:
    """Fill a report's view from a calibration."""
    fits, work = calibration.fits, calibration.separation
    # At work, what a payload weighs is the load that was known.
    coverage = cover(recordings if work is None else work.drift)
    durations_s = [recording.duration_s for recording in recordings]
    axes = []
    for axis, fit in fits.items():
        series = _held_out_series(_held_out(fit), recordings, coverage.leading)
        before, after = (float(np.abs(e).max()) for e in (series.before, series.after))
        errors = AxisEvaluation(fit.rms_before, fit.rms_after, before, _widening(fit) * after)
        held_out = _held_out(fit)
        tried = [candidate.rms for candidate in fit.candidates if candidate.name != 'none']
        evidence = Evidence(
            unit=fit.unit, before=fit.rms_before, after=fit.rms_after, noise=series.noise,
            widening=_widening(fit), compensated=fit.model is not None,
            best_candidate=min(tried, default=None), blocks=rms_by_fold(held_out),
            recordings=len(np.unique(held_out.recording)) if held_out.tared else 0,
            slowest_s=_slowest_s(fit), longest_s=max(durations_s), refusal=fit.refusal,
            promised=np.isfinite(fit.day_limit) or np.isnan(fit.largest_drift))  # fmt: skip
        view = _axis_view(stored, axis, evidence, errors, series)
        # Where nothing can be promised, the verdict says so.
        limit = another_day(fit) if evidence.promised else ''
        axes.append(replace(view, limit=limit))
    # An axis that was refused drifts, and is explained no better than a weak one.
    levels: dict[str, Level] = {
        axis.axis: 'weak' if fits[axis.axis].refusal else axis.verdict.level for axis in axes
    }
    slowest_s = max(map(_slowest_s, fits.values()), default=0.0)
    advice = what_to_record_next(coverage, levels, reference, durations_s, slowest_s)
    # A refusal is the verdict of its axis already.
    refusals = tuple(fit.refusal for fit in fits.values() if fit.refusal)
    return ReportContent(
        kind='calibration', stored=stored, recordings=recordings, coverage=coverage,
        conditions=conditions_of_another_day(calibration),
        explanation=_explanation(calibration, recordings, reference), axes=tuple(axes),
        advice=(*_hardest_day(fits, recordings), *advice),
        warnings=tuple(w for w in calibration.warnings if not w.startswith(refusals)),
        work=_at_work(calibration))  # fmt: skip


def evaluation_content(
    stored: StoredModel, evaluated: Sequence[EvaluatedRecording], tare_s: float
) -> ReportContent:
    """Fill a report's view from an evaluation."""
    recordings = [judged.recording for judged in evaluated]
    coverage = cover(recordings)
    by_name = [(e.recording.name, judge_errors([e.errors])) for e in evaluated]
    axes, beyond = [], []
    for axis, errors in judge_errors([judged.errors for judged in evaluated]).items():
        column, limit = AXES.index(axis), stored.model.day_limits.get(axis)
        parts = [(name, figures[axis]) for name, figures in by_name if axis in figures]
        series = _evaluated_series(evaluated, column, coverage.leading)
        # How far a thermometer moved, at most, where the axis was compared.
        compared = (e.temperature_c[np.isfinite(e.errors.after[:, column])] for e in evaluated)
        moved_k = max(float(np.ptp(cells, axis=0).max()) for cells in compared if len(cells))
        evidence = Evidence(
            unit=axis_unit(axis), before=errors.rms_before, after=errors.rms_after,
            noise=series.noise, moved_k=moved_k,
            compensated=axis in stored.model.axes, block_name='recording',
            blocks=FoldErrors(
                np.array([figures.rms_before for _, figures in parts]),
                np.array([figures.rms_after for _, figures in parts])))  # fmt: skip
        view = replace(_axis_view(stored, axis, evidence, errors, series), parts=parts)
        if limit is not None:
            view = replace(view, limit=f'Limit of its peaks: {limit:.2g} {view.unit}.')
            if errors.max_after > limit:
                largest = f'{rounded(errors.max_after)} {view.unit}'
                beyond.append(f'{axis} {largest} (limit {rounded(limit)})')
        axes.append(view)
    warnings = list(dict.fromkeys(w for recording in recordings for w in recording.warnings))
    if beyond:
        warnings.append(
            'The largest error is above the limit that the calibration stated for 95 of 100 days: '
            f'{", ".join(beyond)}. The zero may have jumped (a tare in the driver, a contact, '
            'another tool), a temperature may be missing or beyond those that were learnt, or it '
            'is another sensor. The report (--report) shows when it began.'
        )
    ranges_c = [tuple(entry['range_c']) for entry in stored.document['thermometers']]
    levels = {axis.axis: axis.verdict.level for axis in axes}
    limits = 'Limits of peaks are those that the calibration stated of 95 of 100 days.'
    references = ', '.join(dict.fromkeys(judged.reference for judged in evaluated))
    return ReportContent(
        kind='evaluation', stored=stored, recordings=recordings, coverage=coverage,
        explanation='The model ran on the temperatures of these recordings alone. Raw and '
        f'compensated wrenches were both tared on the first {tare_s:g} s. Errors are means over '
        f'{averaged_s(stored.model):g} s. Reference: {references}.',
        conditions=limits if any(axis.limit for axis in axes) else '', axes=tuple(axes),
        advice=(what_was_not_learnt(coverage, ranges_c, levels),),
        warnings=tuple(warnings))  # fmt: skip


def _axis_view(
    stored: StoredModel, axis: str, evidence: Evidence, errors: AxisEvaluation, series: ErrorSeries
) -> AxisView:
    """Judge an axis, and say of it what the model's file does; a model need not know it."""
    entry, model = stored.document['axes'].get(axis, _NO_ENTRY), stored.model.axes.get(axis)
    return AxisView(
        axis=axis, unit=evidence.unit, verdict=judge(evidence), errors=errors, series=series,
        drifts=drifts_removed(model), entry={**entry, 'reason': ''} if evidence.refusal else entry,
        responses=None if model is None else _step_responses(model, stored.model.period_ns),
    )  # fmt: skip


def _step_responses(model: AxisModel, period_ns: int) -> tuple[FloatArray, FloatArray]:
    """Warm one thermometer after the other."""
    period_s = period_ns / NANOSECONDS
    cells = max(round(_RESPONSE_S / period_s), 2)
    rest = model.start(model.reference_c)
    drift = [
        model.run(rest, np.tile(model.reference_c + kelvin, (cells, 1)))[1][:, 0]
        for kelvin in np.eye(model.thermometers)
    ]
    settled = model.step(rest, model.reference_c)[1][0]
    return (np.arange(cells) + 1) * period_s / 60, np.array(drift) - settled


def drifts_removed(model: AxisModel | None) -> str:
    """Say which drifts an axis' model removes."""
    if model is None:
        return 'none'
    return 'zero and gain' if model.outputs == 2 else 'zero'


def one_after_the_other(
    recordings: Sequence[Recording],
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Give times, h, (n,), temperatures, °C, (n, J), and which recording they are of, (n,)."""
    pairs = zip(_starts_h(recordings), recordings, strict=True)
    hours = np.concatenate([start + recording.elapsed_s / 3600 for start, recording in pairs])
    temperature_c = np.concatenate([recording.temperature_c for recording in recordings])
    part = np.repeat(np.arange(len(recordings)), list(map(len, recordings)))
    return hours, temperature_c, part


def _starts_h(recordings: Sequence[Recording]) -> FloatArray:
    """Put recordings one after the other: where each begins, h, shape (recordings,)."""
    ends_h = np.cumsum([recording.duration_s / 3600 for recording in recordings])
    return np.concatenate(([0.0], ends_h[:-1]))


def _evaluated_series(
    evaluated: Sequence[EvaluatedRecording], column: int, leading: int
) -> ErrorSeries:
    """Lay the errors of an axis out over time and temperature, all recordings together."""
    recordings = [judged.recording for judged in evaluated]
    hours = np.concatenate([
        start_h + judged.averaged(judged.recording.elapsed_s) / 3600
        for start_h, judged in zip(_starts_h(recordings), evaluated, strict=True)
    ])  # fmt: skip
    temperature_c = np.concatenate([judged.temperature_c[:, leading] for judged in evaluated])
    part = np.repeat(np.arange(len(evaluated)), [len(judged.errors.after) for judged in evaluated])
    before = np.concatenate([judged.errors.before[:, column] for judged in evaluated])
    after = np.concatenate([judged.errors.after[:, column] for judged in evaluated])
    rows = np.isfinite(before) & np.isfinite(after)
    columns = hours, temperature_c, before, after, part
    return ErrorSeries(*(values[rows] for values in columns))


def model_sources(stored: StoredModel) -> list[tuple[str, str]]:
    """List paths and hashes of what a model was made from; what people may have edited is ''."""
    recordings = stored.document['provenance'].get('recordings')
    return [
        (str(source.get('path', '?')), str(source.get('sha256', '')))
        for source in (recordings if isinstance(recordings, list) else [])
        if isinstance(source, dict)
    ]


def _listed(values: Any) -> str:
    """Write nested plain values on one line."""
    if isinstance(values, Mapping):
        return ', '.join(
            f'{key} ({_listed(value)})'
            if isinstance(value, Mapping)
            else f'{key} {_listed(value)}'
            for key, value in values.items()
        )
    if isinstance(values, list):
        return ' '.join(_listed(value) for value in values) or 'none'
    return 'none' if values is None else str(values)


def _held_out(fit: AxisFit) -> HeldOut:
    """Return the errors that every identified axis carries."""
    assert fit.held_out is not None  # noqa: S101 -- identify_axis always keeps them
    return fit.held_out


def _widening(fit: AxisFit) -> float:
    """Ratio of the stated error to that of the folds that were held out."""
    held_out = _held_out(fit)
    measured = float(rms_by_fold(held_out).after.mean())
    whole = not held_out.tared or held_out.recording.any()
    return 1.0 if whole or measured == 0 else fit.rms_after / measured


def _slowest_s(fit: AxisFit) -> float:
    """Find the slowest time constant that was searched, s; those of a bank are given."""
    pairs = zip(fit.time_constants_s, fit.time_constant_errors_s, strict=True)
    return max((tau for tau, error in pairs if np.isfinite(error)), default=0.0)


def _held_out_series(
    held_out: HeldOut, recordings: Sequence[Recording], leading: int
) -> ErrorSeries:
    """Lay held-out errors out over time and temperature; every fold of a recording is a part."""
    period_h = recordings[0].period_s / 3600
    temperature_c = [
        recordings[number].temperature_c[round(cell), leading]
        for number, cell in zip(held_out.recording, held_out.cell, strict=True)
    ]
    return ErrorSeries(
        hours=_starts_h(recordings)[held_out.recording] + (held_out.cell + 0.5) * period_h,
        temperature_c=np.array(temperature_c), before=held_out.before, after=held_out.after,
        part=held_out.recording * (held_out.fold.max() + 1) + held_out.fold)  # fmt: skip


def _hardest_day(fits: Mapping[str, AxisFit], recordings: Sequence[Recording]) -> list[str]:
    """Name the recording that the others predict worst: what is like it was seen too little."""
    if len(recordings) < 3:
        return []
    after = {axis: rms_by_fold(_held_out(fit)).after for axis, fit in fits.items() if fit.model}
    shares = [
        left / max(left.mean(), 1e-300) for left in after.values() if len(left) == len(recordings)
    ]
    share = np.mean(shares or [[0.0]], axis=0)
    if share.max() < _HARD_RATIO * np.median(share):
        return []
    hardest = int(np.argmax(share))
    axis = max(after, key=lambda name: after[name][hardest] / max(fits[name].rms_before, 1e-300))
    unit = fits[axis].unit
    sentence = (
        f'{recordings[hardest].name} is predicted worst by the others: {after[axis][hardest]:.3g} '
        f'{unit} of {axis} are left, in the mean of all {after[axis].mean():.3g} {unit}. Another '
        'day like it would help most.'
    )
    return [sentence]


def _explanation(
    calibration: Calibration, recordings: Sequence[Recording], reference: Reference
) -> str:
    """Say what was held out, and from where errors are counted."""
    fits = calibration.fits.values()
    first = _held_out(next(iter(fits)))
    count, widened = len(np.unique(first.fold)), ''
    if len(recordings) > 1:
        blocks = f'Each of the {count} recordings was held out in turn'
        zero = 'its first minute'
    elif first.tared:
        minutes = recordings[0].duration_s / count / 60
        blocks = (
            f'The recording was cut into {count} blocks of {minutes:.0f} min, and each was held '
            'out in turn'
        )
        zero = 'its first minute'
        factors = [_widening(fit) for fit in fits]
        widened = (
            f' What is left is stated {min(factors):.1f} to {max(factors):.1f} times as large as '
            'it was (see the pictures), because drift goes further in a day than in a block.'
        )
    else:
        blocks = f'Each of the {count} plateaus was held out in turn'
        zero = 'the mean of the other plateaus'
    tared = ': as after a tare' if first.tared else ''
    return (
        f'{blocks}: a model that was fitted to the others ran on its temperatures alone. Errors '
        f'are means over {first.bin_s:g} s, counted from {zero}, with compensation and '
        f'without{tared}.{widened} Reference: {reference}.'
    )


def _at_work(calibration: Calibration) -> AtWork | None:
    """Collect payloads and what counted; None where nothing was learnt at work."""
    separation = calibration.separation
    if separation is None:
        return None
    counts, usable = separation.fit.weights > COUNTS, separation.cells.usable
    cells = sum(len(recording) for recording in separation.recordings)
    counted = np.concatenate(separation.cells.join(counts))
    gravity = describe_force(moments_of(np.concatenate(separation.accelerometer.forces)[counted]))
    seen = ('none', 'one', 'two', 'all')[0 if gravity is None else gravity.seen]
    share, pushed = counts.sum() / cells, (usable & ~counts).sum() / cells
    used = (
        f'Learnt from {share:.0%} of the time; {pushed:.0%} were taken for contact, the rest '
        f'turned fast or held no specific force. Gravity moved along {seen} of three directions; '
        'a payload needs two, its centre of mass all.'
    )
    return AtWork(calibration.payloads, used, sum(map(len, separation.steps)))
