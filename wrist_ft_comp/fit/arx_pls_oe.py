"""
Method ``arx_pls_oe``: free time constants that minimise the error of the free run (eq. 16).

Poles are restricted to relaxations, since heat conduction has no others. For given time constants
every gain is linear, so ln τ alone is searched (variable projection). None, one or two compete.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
import scipy  # which loads its parts when they are used

from wrist_ft_comp.drift.arx import free_run
from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.axis_data import AxisData
from wrist_ft_comp.fit.competition import finish
from wrist_ft_comp.fit.cross_validation import (
    fold_bins,
    FoldBins,
    part_errors,
    refit_bins,
    simplest_good,
    unexplained,
)
from wrist_ft_comp.fit.model_building import (
    anchored,
    build_axis_model,
    build_features,
    by_relaxation,
)
from wrist_ft_comp.fit.result import AxisFit, OUTPUTS, Term
from wrist_ft_comp.fit.settings import IdentificationSettings
from wrist_ft_comp.fit.sums_by_fold import bin_axis_data, BinnedData, sum_by_fold
from wrist_ft_comp.signals import FloatArray

#: Most free time constants that compete.
_MAX_TIME_CONSTANTS = 2
#: Where τ is searched, s: below, no sensor is known to lag; above, a day hardly shows it.
_BOUNDS_S = (20.0, 5600.0)
#: The search begins at the best of these, or of their pairs, s.
_STARTS_S = np.geomspace(30.0, 4000.0, 8)
#: Errors below this share of no compensation's are those of the bins, and count as equal.
_BIN_ERROR = 1e-3
#: A time constant above this share of the longest that is searched may be a longer one.
_AT_BOUND = 0.99
#: Just enough ridge to solve for the gains, relative to the diagonal.
_TINY_RIDGE = 1e-7


class LagFit(NamedTuple):
    """Drift behind free time constants, fitted."""

    #: Features of the temperatures behind one relaxation.
    features: Features
    #: Increasing, s, shape (K,); a single 0 is static.
    time_constants_s: FloatArray
    #: From the features behind each to zero and sensitivity drift, shape (K, F, M).
    gains: FloatArray
    #: None without any drift.
    model: AxisModel | None


def identify_lags(data: AxisData, settings: IdentificationSettings) -> AxisFit:
    """
    Let free time constants compete on the error of the free run.

    Standard errors are those of the jackknife over the folds that were held out. A drift that goes
    on for longer than the recordings is refused.
    """
    features = build_features(data.temperature_c, settings)
    everything = fit_lags(data, features)
    held_out = {}
    for fold in data.fold_numbers:
        held_out[fold] = fit_lags(data.without(fold), features, everything)
    bins: dict[str, Sequence[FoldBins]] = {'none': refit_bins(data, lambda _: (None, ()))}
    for name in everything:
        bins[name] = [
            scored
            for fold, fits in held_out.items()
            for scored in fold_bins(data, unexplained(data, fits[name].model), fold)
        ]
    competing = list(everything)
    none = part_errors(bins['none'])
    least = _BIN_ERROR**2 * none.mean()
    errors = [np.maximum(part_errors(bins[name]), least) for name in competing]
    chosen = competing[simplest_good(errors)]
    lags = everything[chosen]
    if lags.time_constants_s[-1] < data.longest_s:
        fit = finish(data, (lags.model, ()), chosen, bins, competing)
        return state_errors(fit, lags, [fits[chosen] for fits in held_out.values()])
    slow = (
        f'its slowest time constant is at least {data.longest_s:.0f} s, as long as the longest '
        'recording'
    )
    if simplest_good([none, part_errors(bins[chosen])]) == 0:
        # No drift is found, so there is none that could be too slow.
        nothing = None, (f'{chosen} was left out: {slow}',)
        return finish(data, nothing, 'none', bins, ['none', chosen])
    refusal = (
        f'{data.axis} drifts too slowly for these recordings: {chosen} explains it best, but '
        f'{slow}. Record at least {2 * data.longest_s / 3600:.1f} h from cold, or choose the '
        'method pls'
    )
    fit = finish(data, (None, ()), 'none', bins, ['none'])
    return replace(fit, reason=f'{refusal}.', refusal=refusal)


def fit_lags(
    data: AxisData, features: Features, starts: Mapping[str, LagFit] | None = None
) -> dict[str, LagFit]:
    """
    Fit all candidates by name, the simplest first; features are of the highest degree.

    A search begins where that of ``starts`` ended, or else at the best of _STARTS_S.
    """
    bins, cells = bin_axis_data(data, data.bin_cells[0]), bin_axis_data(data, 1)
    fits = {}
    for count in range(_MAX_TIME_CONSTANTS + 1):
        for degree in range(1, features.degree + 1):
            lags = f'{count} time constant{"s" if count > 1 else ""}' if count else 'static'
            name = f'{lags}, {"hats" if features.kind == "hats" else f"degree {degree}"}'
            of_degree = replace(features, degree=degree)
            tau_s: FloatArray = np.zeros(1)
            if count:
                start_s = starts[name].time_constants_s if starts else None
                tau_s = _search(bins, of_degree, count, start_s)
            # What runs is fitted cell by cell.
            fits[name] = _fit_gains(cells, of_degree, tau_s)
    return fits


def _search(
    bins: BinnedData, features: Features, count: int, start_s: FloatArray | None
) -> FloatArray:
    """Find the time constants, increasing, s, whose best gains leave the least (eq. 16)."""

    def left(logs: FloatArray) -> FloatArray:
        """Leave r - w, means of bins around each segment's, less what the best gains explain."""
        parts = []
        for i, x in enumerate(_columns(bins, features, np.exp(logs))):
            sums = bins.sums[i]
            rows = np.flatnonzero(sums.count > 0)
            w, y = ((of[rows] / sums.count[rows])[:, None] for of in (sums.load, sums.residual))
            whole = np.concatenate(
                (x[rows], *((w * x[rows], w) if bins.loaded else ()), y), axis=1
            )
            segments = bins.segments[i][rows]
            for segment in np.unique(segments):
                part = whole[segments == segment]
                parts.append(part - part.mean(axis=0))
        stacked = np.concatenate(parts)
        columns, y = stacked[:, :-1], stacked[:, -1]
        size = np.abs(columns).max(axis=0)
        scaled = columns / np.where(size > 0, size, 1.0)
        return np.asarray(y - scaled @ np.linalg.lstsq(scaled, y, rcond=None)[0])

    if start_s is None:
        start_s = min(
            (np.array(some) for some in combinations(_STARTS_S, count)),
            key=lambda some: float(np.sum(left(np.log(some)) ** 2)),
        )
    bounds = np.log(_BOUNDS_S)
    start = np.clip(np.log(start_s), *bounds)
    found = scipy.optimize.least_squares(left, start, bounds=bounds, diff_step=1e-4)
    return np.asarray(np.exp(np.sort(found.x)))


def _columns(
    data: BinnedData, features: Features, time_constants_s: FloatArray
) -> list[FloatArray]:
    """Compute the features behind every relaxation (eq. 11), by relaxation, (n_i, K·F)."""
    lags = [data.relaxation(float(tau)) for tau in time_constants_s]
    return [
        np.concatenate([features.expand_within(free_run(lag, own_c)) for lag in lags], axis=1)
        for own_c in data.temperature_c
    ]


def _fit_gains(data: BinnedData, features: Features, time_constants_s: FloatArray) -> LagFit:
    """Fit gains for given time constants, and write what runs."""
    columns = _columns(data, features, time_constants_s)
    sums = sum_by_fold(data, columns)
    normal = sums.centred(sums.fold >= 0)
    power = np.diagonal(normal)[:-1]
    size = np.sqrt(np.where(power > 0, power, np.inf))
    scaled = normal[:-1, :-1] / np.outer(size, size) + _TINY_RIDGE * np.eye(len(size))
    values = np.linalg.solve(scaled, normal[:-1, -1] / size) / size
    shape = len(time_constants_s), len(features.names)
    gains = by_relaxation(values, *shape, loaded=data.loaded)
    model = build_axis_model(features, time_constants_s, gains, columns, data.period_s)
    if model is not None and data.loaded:
        at_rest = features.expand(features.reference_c) @ gains[:, :, 1].sum(axis=0) + values[-1]
        model = anchored(model, [0.0, float(at_rest)])
    return LagFit(features, time_constants_s, gains, model)


def state_errors(fit: AxisFit, lags: LagFit, held_out: Sequence[LagFit]) -> AxisFit:
    """Add time constants and gains, with the standard errors that fits without a fold tell."""
    tau_s = lags.time_constants_s
    errors_s = _jackknife([other.time_constants_s for other in held_out])
    errors = _jackknife([other.gains for other in held_out])
    terms = tuple(
        Term(output, float(tau), feature, float(lags.gains[k, f, m]), float(errors[k, f, m]))
        for m, output in enumerate(OUTPUTS[: lags.gains.shape[2]])
        for k, tau in enumerate(tau_s)
        for f, feature in enumerate(lags.features.names)
    )
    if not tau_s.any():
        return replace(fit, terms=terms)
    notes = fit.notes
    if tau_s[-1] > _AT_BOUND * _BOUNDS_S[1]:
        longest = (
            f'its slowest time constant is the longest that is searched, {_BOUNDS_S[1]:.0f} s'
        )
        notes = longest, *notes
    return replace(
        fit, time_constants_s=tuple(tau_s.tolist()),
        time_constant_errors_s=tuple(errors_s.tolist()), terms=terms, notes=notes)  # fmt: skip


def _jackknife(estimates: Sequence[FloatArray]) -> FloatArray:
    """Estimate standard errors of what was fitted without each fold in turn, shapes (…) to (…)."""
    return np.asarray(np.sqrt((len(estimates) - 1) * np.var(estimates, axis=0)))
