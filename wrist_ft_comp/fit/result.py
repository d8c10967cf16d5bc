"""What a calibration found: records for the model file, the report and the summary."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.channels import SensorNames
from wrist_ft_comp.drift.drift_model import AxisModel, DriftModel
from wrist_ft_comp.fit.settings import CalibrationSettings
from wrist_ft_comp.payload.separation import Separation
from wrist_ft_comp.payload.weight import LearntPayloads
from wrist_ft_comp.series import FloatArray, IntArray


@dataclass(frozen=True)
class Candidate:
    """A name, the root mean square error on held-out folds, N or N m, and the share that runs."""

    name: str
    rms: float
    weight: float = 0.0


class FoldErrors(NamedTuple):
    """Root mean square errors fold by fold, N or N m, shapes (folds,)."""

    before: FloatArray
    after: FloatArray


@dataclass(frozen=True, eq=False)
class HeldOut:
    """
    Errors of one axis on held-out folds, means of n bins by recording and time.

    They are counted from the first minute of the fold, as if the sensor had been tared in it, or,
    for plateaus of a chamber test, from the mean of the other plateaus.
    """

    #: Which recording, counted from 0, and which fold was held out.
    recording: IntArray
    fold: IntArray
    #: Mean number of the bin's cells, counted from the recording's first.
    cell: FloatArray
    #: Without compensation, then of candidates fitted to the other folds, N or N m, shape (n, C);
    #: in a result the last one runs.
    errors: FloatArray
    #: Length of a bin, s.
    bin_s: float
    #: Whether they are counted from the fold's first minute.
    tared: bool

    def averaged(self, weights: FloatArray) -> 'HeldOut':
        """Add the errors of an average of candidates, weights (C,)."""
        return replace(self, errors=np.column_stack((self.errors, self.errors @ weights)))

    def squares(self) -> FloatArray:
        """Mean squares fold by fold, in increasing order of the fold's number, (folds, C)."""
        folds = [self.fold == fold for fold in np.unique(self.fold)]
        return np.array([np.mean(self.errors[inside] ** 2, axis=0) for inside in folds])


def rms_by_fold(held_out: HeldOut) -> FoldErrors:
    """Sum held-out errors up fold by fold, in increasing order of the fold's number."""
    rms = np.sqrt(held_out.squares())
    return FoldErrors(rms[:, 0], rms[:, -1])


@dataclass(frozen=True, eq=False)
class AxisFit:
    """What was found for one axis."""

    #: None is "no compensation".
    model: AxisModel | None
    #: The winning candidate.
    chosen: str
    #: All that were tried, simplest first.
    candidates: tuple[Candidate, ...]
    #: Root mean square error of no compensation, mean over held-out folds, in the unit.
    rms_before: float
    #: The same of the winner, as it is stated of a day (``day_over_blocks``).
    rms_after: float
    #: Root mean square that another day is expected to keep. It is larger where the averaged fits
    #: disagree, and where a day goes further than the recordings.
    expected_rms: float
    #: The errors behind rms_before and rms_after, for pictures.
    held_out: HeldOut
    #: Time constants that were searched, increasing, s.
    time_constants_s: tuple[float, ...] = ()
    #: What had to be mended, and what could not be learnt, in sentences.
    notes: tuple[str, ...] = ()
    #: Standard errors of the time constants, s.
    time_constant_errors_s: tuple[float, ...] = ()
    #: Why this axis could not be learnt although it drifts; empty when it was.
    refusal: str = ''
    #: N or N m.
    unit: str = ''
    #: Error that another day stays below on 9 of 10 days; NaN where nothing can be promised.
    day_limit: float = np.nan
    #: Largest drift without compensation since a recording's first minute, in means over 10 s; NaN
    #: where nothing is tared, as for a chamber test.
    largest_drift: float = np.nan

    @property
    def share_left(self) -> float:
        """Share of the drift that is left; 1 where nothing drifted."""
        return self.rms_after / self.rms_before if self.rms_before else 1.0


@dataclass(frozen=True, eq=False)
class Calibration:
    """A model that is ready to run, and its evidence: by axis what was chosen and why."""

    model: DriftModel
    fits: dict[str, AxisFit]
    #: Lowest and highest temperature of each thermometer, °C, shape (J, 2).
    temperature_range_c: FloatArray
    #: Of all recordings together, s.
    duration_s: float
    #: What a person should know, in sentences.
    warnings: tuple[str, ...]
    #: Names of the recordings.
    sources: tuple[str, ...] = ()
    settings: CalibrationSettings | None = None
    #: With the reference payload: those that were learnt, and what they rest on.
    payloads: LearntPayloads | None = None
    separation: Separation | None = None
    #: What the recordings call the sensor, the first one where they differ.
    sensor: SensorNames = field(default_factory=dict)

    def __repr__(self) -> str:
        lines = [f'Calibration of {self.duration_s / 3600:.2f} h, RMS of held-out errors:']
        for axis, fit in self.fits.items():
            line = f'{axis}: {fit.rms_before:.3g} -> {fit.rms_after:.3g} {fit.unit} ({fit.chosen})'
            limit = '' if np.isnan(fit.day_limit) else f', limit {fit.day_limit:.2g} {fit.unit}'
            lines.append(line + limit)
        lines += self.payloads.lines() if self.payloads else []
        return '\n'.join([*lines, *(f'warning: {warning}' for warning in self.warnings)])
