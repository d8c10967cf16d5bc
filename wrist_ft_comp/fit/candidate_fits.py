"""The many fits that method ``auto`` averages, and what they leave of recordings held out."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.drift.arx import free_run
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.axis_data import AxisData
from wrist_ft_comp.fit.bins import (
    bin_axis_data,
    BinnedData,
    start_transients,
    tare,
    TRANSIENT_VARIANCE,
)
from wrist_ft_comp.fit.cross_validation import bin_means
from wrist_ft_comp.fit.feature_banks import build_features
from wrist_ft_comp.fit.moments import accumulate, Moments
from wrist_ft_comp.fit.pool import FreeTimeConstants, GRID_S, near, RidgeBank
from wrist_ft_comp.fit.settings import IdentificationSettings
from wrist_ft_comp.signals import FloatArray

_STRENGTHS = (1e-2, 1e-4, 1e-6)
#: Candidates are compared by means over so long, s, or all look alike where a robot moves; so many
#: there are at least.
_COMPARED_S, _FEWEST_COMPARED = 120.0, 8
_BANKS = {
    'bank to 3000 s': near(0, 30, 100, 300, 1000, 3000),
    'bank to 60 s': near(0, 20, 60),
    'bank to 600 s': near(0, 100, 600),
}


class Kind(NamedTuple):
    """What is combined: a name, whether every start was soaked, and how it is fitted."""

    name: str
    soaked: bool
    fit: RidgeBank | FreeTimeConstants

    @property
    def fits(self) -> int:
        """How many fits it gives."""
        return len(self.fit.strengths) if isinstance(self.fit, RidgeBank) else 1


def _kinds(highest: int, thermometers: int) -> list[Kind]:
    """List what is combined, with names for people."""
    kinds = []
    for degree in range(1, highest + 1):
        shape = (degree, thermometers)
        fits: dict[str, RidgeBank | FreeTimeConstants] = {
            'static': RidgeBank(*shape, near(0), (1e-6,)),
            '1 time constant': FreeTimeConstants(*shape, 1),
            **{name: RidgeBank(*shape, bank, _STRENGTHS) for name, bank in _BANKS.items()},
        }
        both = [(name, soaked) for name in fits for soaked in (True, False)]
        if degree < 3:
            fits['2 time constants'] = FreeTimeConstants(*shape, 2)
            both.append(('2 time constants', False))
        kinds += [Kind(f'{name}, degree {degree}', soaked, fits[name]) for name, soaked in both]
    return kinds


class HeldOutForms(NamedTuple):
    """Mean square error in a fold as quadratic forms of gains: start set aside, and tared."""

    cleaned: FloatArray
    tared: FloatArray


@dataclass(frozen=True, eq=False)
class Axis:
    """An axis of the body: its bins, its moments, and its errors fold by fold."""

    data: AxisData
    binned: BinnedData
    moments: Moments
    forms: dict[int, HeldOutForms]


class Body:
    """All axes of a sensor, which share temperatures and time constants, and their candidates."""

    def __init__(self, axes: Sequence[AxisData], settings: IdentificationSettings) -> None:
        binned = [bin_axis_data(data, data.bin_cells[0]) for data in axes]
        self.bins = binned[0]
        self.features = build_features(self.bins.temperature_c, settings, beyond='tangents')
        self.kinds = _kinds(settings.highest_degree, self.features.thermometers)
        relaxations = [self.bins.relaxation(float(tau)) for tau in GRID_S]
        #: Temperatures of each recording behind every relaxation, (n_i, K, J).
        self.relaxed_c = [
            np.stack([free_run(each, temperature_c) for each in relaxations], axis=1)
            for temperature_c in self.bins.temperature_c
        ]
        self.inputs = [self._expand(self.features, i) for i in range(len(self.relaxed_c))]
        self.axes = [
            Axis(data, each, accumulate(each, self.inputs, GRID_S), {})
            for data, each in zip(axes, binned, strict=True)
        ]
        self.folds = np.unique(np.concatenate(self.bins.folds)).tolist()
        for fold in self.folds:
            for design, axis in self.designs(fold):
                if len(design):
                    axis.forms[fold] = HeldOutForms(
                        _cleaned_form(design, self.bins.period_s),
                        _form(tare(design, self.bins.period_s)),
                    )

    def _expand(self, features: Features, recording: int) -> FloatArray:
        """Compute the pool's columns, without load, of a recording, (n, K·F)."""
        relaxed_c = self.relaxed_c[recording]
        return features.expand(relaxed_c).reshape(len(relaxed_c), -1)

    def recording_of(self, fold: int) -> int:
        """Find the recording that a fold is of."""
        return next(i for i, folds in enumerate(self.bins.folds) if (folds == fold).any())

    def designs(self, fold: int) -> Iterator[tuple[FloatArray, 'Axis']]:
        """Draw columns and r - w of a fold, in the range that the others know, (n, P + 1)."""
        #   [ x_f(H_τ T) … | w x_f(H_τ T) … | w | r - w ]     with load
        i = self.recording_of(fold)
        pairs = zip(self.bins.temperature_c, self.bins.folds, strict=True)
        others = np.concatenate([each_c[folds != fold] for each_c, folds in pairs])
        known = replace(self.features, lower_c=others.min(axis=0), upper_c=others.max(axis=0))
        x = self._expand(known, i)
        for axis in self.axes:
            sums = axis.binned.sums[i]
            rows = (axis.binned.folds[i] == fold) & (sums.count > 0)
            count = sums.count[rows, np.newaxis]
            w, y = sums.load[rows, np.newaxis] / count, sums.residual[rows, np.newaxis] / count
            load = (w * x[rows], w) if axis.binned.loaded else ()
            yield np.concatenate((x[rows], *load, y), axis=1), axis

    def fit(
        self, skip: int | None, starts: Mapping[Kind, FloatArray]
    ) -> tuple[list[FloatArray], dict[Kind, FloatArray]]:
        """Fit none and all candidates to all folds but one, lags from a start if known."""
        # Gains of the pool for every axis, (C, P + 1), -1 for r - w, and the ln τ that were found.
        moments = [axis.moments for axis in self.axes]
        normals = {}
        for soaked in (True, False):
            precision = self.bins.nuisance_precision(soaked=soaked)
            normals[soaked] = [
                replace(each, precision=precision).centred(each.fold != skip) for each in moments
            ]
        gains = [[np.append(np.zeros(len(n) - 1), -1.0)[np.newaxis]] for n in normals[True]]
        logs = {}
        for kind in self.kinds:
            theirs = normals[kind.soaked]
            pairs = list(zip(moments, theirs, strict=True))
            if isinstance(kind.fit, RidgeBank):
                fits = [kind.fit.fit(*pair) for pair in pairs]
            else:
                start = starts[kind] if kind in starts else kind.fit.first_guess(moments, theirs)
                logs[kind] = kind.fit.search(moments, theirs, start)
                fits = [kind.fit.fit(*pair, logs[kind]) for pair in pairs]
            for own, fit in zip(gains, fits, strict=True):
                own.append(fit)
        return [np.concatenate(own) for own in gains], logs


def _form(design: FloatArray) -> FloatArray:
    """Mean square of a combination of columns, as a quadratic form of its gains."""
    return np.asarray(design.T @ design / len(design))


def _cleaned_form(design: FloatArray, period_s: float) -> FloatArray:
    """Mean square around a constant and a start transient, of means that noise says little in."""
    time_s = np.arange(len(design)) * period_s
    phi = np.concatenate((np.ones((len(design), 1)), start_transients(time_s)), axis=1)
    precision = np.full(phi.shape[1], len(design) / TRANSIENT_VARIANCE)
    precision[0] = 0.0
    crossed = phi.T @ design
    level = np.linalg.solve(phi.T @ phi + np.diag(precision), crossed)
    rest = design - phi @ level
    together = max(1, min(round(_COMPARED_S / period_s), len(rest) // _FEWEST_COMPARED))
    prior = level.T @ (precision[:, np.newaxis] * level) / len(design)
    return np.asarray(_form(bin_means(rest, np.arange(len(rest)), together)) + prior)
