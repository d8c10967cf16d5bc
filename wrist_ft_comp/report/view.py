"""What a page shows: records that are filled from a calibration or from an evaluation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.drift.drift_model import StoredModel
from wrist_ft_comp.payload.learnt import LearntPayloads
from wrist_ft_comp.recordings.chamber import ChamberFigures
from wrist_ft_comp.report.coverage import Coverage
from wrist_ft_comp.report.evaluation import AxisEvaluation
from wrist_ft_comp.report.verdict import Evidence, judge, Verdict
from wrist_ft_comp.signals import FloatArray, IntArray, NANOSECONDS, Recording

#: What a body does later is hardly seen in a warm-up, s.
_RESPONSE_S = 7200.0
#: What a model says of an axis that it does not know.
_NOTHING = {'chosen': 'none', 'reason': '', 'time_constants_s': [], 'candidates': [], 'notes': []}


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


@dataclass(frozen=True, eq=False)
class AxisView:
    """One axis."""

    axis: str
    #: N, N m, or what its recordings are in; so are the figures.
    unit: str
    verdict: Verdict
    errors: AxisEvaluation
    #: What the errors were made of.
    series: ErrorSeries
    #: Each recording and its errors; empty where errors are held out.
    parts: Sequence[tuple[str, AxisEvaluation]]
    #: Which drifts are removed.
    drifts: str
    #: What the model's file says of it (model.schema.json).
    entry: Mapping[str, Any]
    #: How zero drift follows each thermometer that warms by 1 K, at T_ref, and stays there: min
    #: since it warmed, (n,), and what is added, (J, n). Without a model, none.
    responses: tuple[FloatArray, FloatArray] | None


@dataclass(frozen=True, eq=False)
class WorkView:
    """What was learnt at work."""

    #: None where none could be told.
    learnt: LearntPayloads | None
    #: Unit vectors of the specific force, as it was measured, in cells that counted, (n, 3).
    directions: FloatArray
    #: Bins of time, (b,): their middles, which recording, and the shares of them that counted and
    #: that were taken for contact.
    hours: FloatArray
    part: IntArray
    used: FloatArray
    pushed: FloatArray
    #: Tares of the driver that were taken out.
    steps: int


@dataclass(frozen=True, eq=False)
class ReportView:
    """A report's content."""

    kind: Literal['calibration', 'evaluation']
    stored: StoredModel
    #: That the errors are of, with the same thermometers.
    recordings: Sequence[Recording]
    #: Temperatures and loads of these.
    coverage: Coverage
    #: How the errors came about.
    explanation: str
    #: In axis order.
    axes: tuple[AxisView, ...]
    #: What to record next.
    advice: tuple[str, ...]
    #: What a person should know.
    warnings: tuple[str, ...]
    #: Figures of chamber tables, by name, then by title.
    tables: Mapping[str, Mapping[str, ChamberFigures]] = field(default_factory=dict)
    #: What was learnt at work, if it was.
    work: WorkView | None = None

    @property
    def provenance(self) -> dict[str, str]:
        """Where the model came from, for people, by what it says."""
        document = self.stored.document
        provenance = document['provenance']
        ranges = (each['range_c'] for each in document['thermometers'])
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


def axis_view(  # noqa: PLR0913 -- what is known of one axis, each a plain value
    stored: StoredModel,
    axis: str,
    evidence: Evidence,
    errors: AxisEvaluation,
    series: ErrorSeries,
    *,
    parts: Sequence[tuple[str, AxisEvaluation]] = (),
) -> AxisView:
    """Judge an axis, and say of it what the model's file does; a model need not know it."""
    entry = stored.document['axes'].get(axis, _NOTHING)
    model = stored.model.axes.get(axis)
    return AxisView(
        axis=axis, unit=evidence.unit, verdict=judge(evidence), errors=errors, series=series,
        parts=parts, drifts=drifts_removed(model),
        entry={**entry, 'reason': ''} if evidence.refusal else entry,
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
    return 'zero and gain' if len(model.dynamics.output_mean) == 2 else 'zero'


def recording_starts_h(recordings: Sequence[Recording]) -> FloatArray:
    """Put recordings one after the other: where each begins, h, shape (recordings,)."""
    ends_h = np.cumsum([recording.duration_s / 3600 for recording in recordings])
    return np.concatenate(([0.0], ends_h[:-1]))


def one_after_the_other(
    recordings: Sequence[Recording],
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Give times, h, (n,), temperatures, °C, (n, J), and which recording they are of, (n,)."""
    pairs = zip(recording_starts_h(recordings), recordings, strict=True)
    hours = np.concatenate([start + each.elapsed_s / 3600 for start, each in pairs])
    temperature_c = np.concatenate([each.temperature_c for each in recordings])
    part = np.repeat(np.arange(len(recordings)), [len(each) for each in recordings])
    return hours, temperature_c, part


def model_sources(stored: StoredModel) -> list[tuple[str, str]]:
    """List paths and hashes, if known, of what a model was made from; people may have edited."""
    recordings = stored.document['provenance'].get('recordings')
    known = recordings if isinstance(recordings, list) else []
    return [
        (str(each.get('path', '?')), str(each.get('sha256', '')))
        for each in known
        if isinstance(each, dict)
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
