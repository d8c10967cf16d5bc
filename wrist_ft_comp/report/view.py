"""What the views of a calibration and of an evaluation have in common."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from wrist_ft_comp.calibration.chamber import ChamberFigures
from wrist_ft_comp.calibration.result import Candidate
from wrist_ft_comp.model.axis_model import AxisModel
from wrist_ft_comp.model.drift_model import StoredModel
from wrist_ft_comp.model.signals import FloatArray, IntArray, NANOSECONDS, Recording
from wrist_ft_comp.report.coverage import Coverage
from wrist_ft_comp.report.verdict import Verdict


@dataclass(frozen=True, eq=False)
class ErrorSeries:
    """
    Errors of one axis, over time and over temperature.

    Attributes
    ----------
    hours : ndarray, shape (n,)
        Time, h, all recordings one after the other.
    temperature_c : ndarray, shape (n,)
        Of the leading thermometer, °C.
    before, after : ndarray, shape (n,)
        Error without and with compensation, N or N m.
    part : ndarray of int, shape (n,)
        Lines are not drawn from one part to the next.

    """

    hours: FloatArray
    temperature_c: FloatArray
    before: FloatArray
    after: FloatArray
    part: IntArray


@dataclass(frozen=True, eq=False)
class AxisView:
    """
    One axis.

    Attributes
    ----------
    axis, unit : str
        Name, and N, N m, or what its recordings are in.
    verdict : Verdict
        Level and sentence.
    rms_before, rms_after, peak_before, peak_after : float
        In the unit.
    series : ErrorSeries
        What the figures were made of.
    drifts : str
        Which drifts are removed.
    chosen : str
        Name of the candidate that was chosen.
    reason : str
        Why it was chosen; empty if that is not known.
    time_constants_s, time_constant_errors_s : tuple of float
        And their standard errors, s; NaN where unknown.
    candidates : tuple of Candidate
        All that were tried.
    notes : tuple of str
        What could not be learnt, and the like.
    parts : tuple of (str, float, float)
        Name of each recording, and root mean square without and with compensation; empty where
        errors are held out.

    """

    axis: str
    unit: str
    verdict: Verdict
    rms_before: float
    rms_after: float
    peak_before: float
    peak_after: float
    series: ErrorSeries
    drifts: str
    chosen: str
    reason: str = ''
    time_constants_s: tuple[float, ...] = ()
    time_constant_errors_s: tuple[float, ...] = ()
    candidates: tuple[Candidate, ...] = ()
    notes: tuple[str, ...] = ()
    parts: tuple[tuple[str, float, float], ...] = ()


@dataclass(frozen=True, eq=False)
class ThermometerSeries:
    """
    One thermometer over time.

    Attributes
    ----------
    name : str
        For people.
    hours, temperature_c : ndarray, shape (n,)
        Time, h, and temperature, °C.
    part : ndarray of int, shape (n,)
        Recording.

    """

    name: str
    hours: FloatArray
    temperature_c: FloatArray
    part: IntArray


@dataclass(frozen=True)
class Source:
    """
    A recording.

    Attributes
    ----------
    name : str
        Path or name.
    hours : float
        Its length, h; NaN if unknown.
    sha256 : str
        Of its bytes; empty if unknown.

    """

    name: str
    hours: float
    sha256: str = ''


@dataclass(frozen=True, eq=False)
class ReportView:
    """
    A report's content.

    Attributes
    ----------
    kind : {'calibration', 'evaluation'}
        What it reports on.
    model : str
        Name of the model file.
    explanation : str
        How the errors came about.
    axes : tuple of AxisView
        In axis order.
    thermometers : tuple of ThermometerSeries
        The one inside the sensor first.
    sources : tuple of Source
        The recordings that the errors are of.
    coverage : Coverage
        Temperatures and loads of these.
    advice : tuple of str
        What to record next.
    warnings : tuple of str
        What a person should know.
    tables : mapping of str to mapping of str to ChamberFigures
        Figures of chamber tables, by name, then by title.
    learnt_from : tuple of Source
        What the model was made of.
    provenance : mapping of str to str
        Hash, versions, settings.

    """

    kind: Literal['calibration', 'evaluation']
    model: str
    explanation: str
    axes: tuple[AxisView, ...]
    thermometers: tuple[ThermometerSeries, ...]
    sources: tuple[Source, ...]
    coverage: Coverage
    advice: tuple[str, ...]
    warnings: tuple[str, ...]
    learnt_from: tuple[Source, ...]
    provenance: Mapping[str, str]
    tables: Mapping[str, Mapping[str, ChamberFigures]] = field(default_factory=dict)


def drifts_removed(model: AxisModel | None) -> str:
    """Say which drifts an axis' model removes."""
    if model is None:
        return 'none'
    return 'zero and gain' if len(model.dynamics.output_mean) == 2 else 'zero'


def recording_starts_h(recordings: Sequence[Recording]) -> FloatArray:
    """
    Put recordings one after the other.

    Parameters
    ----------
    recordings : sequence of Recording
        In order.

    Returns
    -------
    ndarray, shape (recordings,)
        Where each begins, h.

    """
    ends_h = np.cumsum([recording.duration_s / 3600 for recording in recordings])
    return np.concatenate(([0.0], ends_h[:-1]))


def thermometer_series(recordings: Sequence[Recording]) -> tuple[ThermometerSeries, ...]:
    """
    Lay temperatures out over time.

    Parameters
    ----------
    recordings : sequence of Recording
        With the same thermometers.

    Returns
    -------
    tuple of ThermometerSeries
        One per thermometer.

    """
    starts = recording_starts_h(recordings)
    hours = np.concatenate(
        [start + each.elapsed_s / 3600 for start, each in zip(starts, recordings, strict=True)]
    )
    part = np.concatenate([np.full(len(each), i) for i, each in enumerate(recordings)])
    columns = np.concatenate([each.temperature_c for each in recordings]).T
    return tuple(
        ThermometerSeries(f'thermometer {j + 1}', hours, column, part)
        for j, column in enumerate(columns)
    )


def model_sources(stored: StoredModel) -> tuple[Source, ...]:
    """
    List what a model was made from; people may have edited its provenance.

    Parameters
    ----------
    stored : StoredModel
        The model.

    Returns
    -------
    tuple of Source
        Without lengths, which a model file does not hold.

    """
    recordings = stored.document['provenance'].get('recordings')
    if not isinstance(recordings, list):
        return ()
    return tuple(
        Source(str(each.get('path', '?')), float('nan'), str(each.get('sha256', '')))
        for each in recordings
        if isinstance(each, dict)
    )


def model_provenance(stored: StoredModel) -> dict[str, str]:
    """
    Say where a model came from, for people.

    Parameters
    ----------
    stored : StoredModel
        The model.

    Returns
    -------
    dict of str to str
        By what it says.

    """
    provenance = stored.document['provenance']
    ranges = (each['range_c'] for each in stored.document['thermometers'])
    return {
        'model file': str(stored.path),
        'SHA-256': stored.sha256,
        'made': str(provenance.get('created', 'at an unknown time')),
        'recorded': f'{stored.document["duration_s"] / 3600:.2f} h',
        'temperatures': ', '.join(f'{low:.1f} to {high:.1f} °C' for low, high in ranges),
        'thermal period': f'{stored.model.period_ns / NANOSECONDS:g} s',
        'versions': _listed(provenance.get('versions')),
        'settings': _listed(provenance.get('settings')),
    }


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
