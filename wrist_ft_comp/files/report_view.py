"""What a report shows: one type, filled from a calibration or from an evaluation."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from wrist_ft_comp.core.axis_fit import Candidate
from wrist_ft_comp.core.chamber_fit import ChamberFigures
from wrist_ft_comp.core.coverage import Coverage
from wrist_ft_comp.core.recording import FloatArray, IntArray
from wrist_ft_comp.core.verdict import Verdict


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
