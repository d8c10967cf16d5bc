"""
Method ``arx_pls_oe``: free time constants that minimise the error of the free run (eq. 16).

Poles are restricted to relaxations, since heat conduction has no others. For given time constants
every gain is linear, so ln τ alone is searched (variable projection). None, one or two compete.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations
from typing import NamedTuple

import numpy as np
import scipy  # which loads its parts when they are used

from wrist_ft_comp.drift.arx import free_run
from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.axis_data import AxisData
from wrist_ft_comp.fit.cross_validation import (
    fold_bins,
    FoldBins,
    part_errors,
    refit_bins,
    simplest_good,
    unexplained,
)
from wrist_ft_comp.fit.model_building import build_axis_model, build_features
from wrist_ft_comp.fit.named_methods import finish
from wrist_ft_comp.fit.result import AxisFit
from wrist_ft_comp.fit.ridge_bank import POOL_S
from wrist_ft_comp.fit.settings import IdentificationSettings
from wrist_ft_comp.fit.sums_by_fold import bin_axis_data, BinnedData
from wrist_ft_comp.series import FloatArray

#: Where τ is searched, s: below, no sensor is known to lag; above, a day hardly shows it.
_BOUNDS_S = (20.0, 5600.0)
#: A column that a segment's constant explains up to this share holds nothing but rounding.
_ROUNDING = 1e-9


class LagFit(NamedTuple):
    """Drift behind free time constants, fitted."""

    #: Increasing, s, shape (K,); a single 0 is static.
    time_constants_s: FloatArray
    #: None without any drift.
    model: AxisModel | None


def identify_lags(data: AxisData, settings: IdentificationSettings) -> AxisFit:
    """
    Let free time constants compete on the error of the free run.

    A drift that goes on for longer than the recordings is refused.
    """
    features = build_features(data.temperature_c, settings)
    everything = fit_lags(data, features)
    held_out = {
        fold: fit_lags(data.without(fold), features, everything) for fold in data.fold_numbers
    }
    bins: dict[str, Sequence[FoldBins]] = {'none': refit_bins(data, lambda _: (None, ()))}
    for name in everything:
        bins[name] = [
            scored
            for fold, fits in held_out.items()
            for scored in fold_bins(data, unexplained(data, fits[name].model), fold)
        ]
    chosen = [*everything][simplest_good([part_errors(bins[name]) for name in everything])]
    tau_s, model = everything[chosen]
    if tau_s[-1] < data.longest_s:
        notes: tuple[str, ...] = ()
        if tau_s[-1] > 0.99 * _BOUNDS_S[1]:
            longest = f'{_BOUNDS_S[1]:.0f} s'
            notes = (f'its slowest time constant is the longest that is searched, {longest}',)
        fit = finish(data, (model, notes), chosen, bins, [*everything])
        if not tau_s.any():
            return fit
        # The jackknife: how far the fits scatter that were made without each fold in turn.
        others_s = [fits[chosen].time_constants_s for fits in held_out.values()]
        errors_s = np.sqrt((len(others_s) - 1) * np.var(others_s, axis=0))
        return replace(
            fit, time_constants_s=tuple(tau_s.tolist()),
            time_constant_errors_s=tuple(errors_s.tolist()))  # fmt: skip
    slow = (
        f'its slowest time constant is at least {data.longest_s:.0f} s, as long as the longest '
        'recording'
    )
    if simplest_good([part_errors(bins['none']), part_errors(bins[chosen])]) == 0:
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

    A search begins where that of ``starts`` ended, or else at the best of the relaxations of
    ``auto``, or of their pairs.
    """
    bins, cells = bin_axis_data(data, data.bin_cells[0]), bin_axis_data(data, 1)
    bounds, fits = np.log(_BOUNDS_S), {}
    for count in (0, 1, 2):
        for degree in range(1, features.degree + 1):
            lags = f'{count} time constant{"s" if count > 1 else ""}' if count else 'static'
            name = f'{lags}, {"hats" if features.kind == "hats" else f"degree {degree}"}'
            of_degree = replace(features, degree=degree)
            tau_s: FloatArray = np.zeros(1)
            if count:
                left = partial(_left, bins, of_degree)
                if starts:
                    start = np.log(starts[name].time_constants_s)
                else:
                    tried = [np.log(some) for some in combinations(POOL_S[1:], count)]
                    start = tried[int(np.argmin([np.sum(left(some) ** 2) for some in tried]))]
                start = np.clip(start, *bounds)
                found = scipy.optimize.least_squares(left, start, bounds=bounds, diff_step=1e-4)
                tau_s = np.exp(np.sort(found.x))
            # What runs is fitted cell by cell.
            columns = _columns(cells, of_degree, tau_s)
            gains = _project(cells, columns)[1]
            model = build_axis_model(of_degree, tau_s, gains, columns, data.period_s)
            fits[name] = LagFit(tau_s, model)
    return fits


def _left(data: BinnedData, features: Features, logs: FloatArray) -> FloatArray:
    """Leave of r - w what the best gains behind relaxations of some ln τ do not explain, (n,)."""
    return _project(data, _columns(data, features, np.exp(logs)))[0]


def _columns(
    data: BinnedData, features: Features, time_constants_s: FloatArray
) -> list[FloatArray]:
    """Compute the features behind every relaxation (eq. 11), by relaxation, (n_i, K·F)."""
    lags = [data.relaxation(float(tau)) for tau in time_constants_s]
    return [
        np.concatenate([features.expand_within(free_run(lag, own_c)) for lag in lags], axis=1)
        for own_c in data.temperature_c
    ]


def _project(data: BinnedData, columns: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Regress r - w, each segment around its mean, on columns, (n_i, C): rest and gains, (p,)."""
    #   [ x_f(H_τ T) … | w x_f(H_τ T) … | w | r - w ]     with load
    parts, largest = [], 0.0
    for x, sums, segments in zip(columns, data.sums, data.segments, strict=True):
        rows = np.flatnonzero(sums.count > 0)
        w, y = ((of[rows] / sums.count[rows])[:, None] for of in (sums.load, sums.residual))
        load = (w * x[rows], w) if data.loaded else ()
        whole = np.concatenate((x[rows], *load, y), axis=1)
        largest = np.maximum(largest, np.abs(whole).max(axis=0, initial=0.0))
        for segment in np.unique(segments[rows]):
            part = whole[segments[rows] == segment]
            parts.append(part - part.mean(axis=0))
    stacked = np.concatenate(parts)
    size = np.abs(stacked).max(axis=0)
    weight = np.where(size > _ROUNDING * largest, 1 / np.where(size > 0, size, 1.0), 0.0)[:-1]
    scaled, y = stacked[:, :-1] * weight, stacked[:, -1]
    gains = np.linalg.lstsq(scaled, y, rcond=None)[0]
    return np.asarray(y - scaled @ gains), np.asarray(gains * weight)
