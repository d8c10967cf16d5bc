"""
Method ``auto``: an average of 30 ridge fits, weighted by what they leave of recordings held out.

Picking the best of many fits on three or four recordings is itself an overfit, so none is picked.
All fits are vectors of gains of one pool of columns: powers of temperature behind relaxations,
with load also a temperature behind a relaxation times the load, and the load (``binned_sums``). So
their average is such a vector, too.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.fit.axis_data import AxisData, BINS_PER_FOLD, build_features
from wrist_ft_comp.fit.binned_sums import bin_axis_data, build_axis_model, sum_by_fold
from wrist_ft_comp.fit.competition import is_worth_running, state_fit
from wrist_ft_comp.fit.folds import bin_means, HeldOutFold, tare
from wrist_ft_comp.fit.result import AxisFit
from wrist_ft_comp.fit.settings import IdentificationSettings
from wrist_ft_comp.series import FloatArray, IntArray

COMBINATION = 'combination'
#: Time constants of all banks of relaxations, s; 0 has no memory. With the longest alone 1.18
#: times as much drift was left on 620 drawn days of 31 kinds.
BANKS_S = {
    'bank to 3000 s': (0.0, 30.0, 100.0, 300.0, 1000.0, 3000.0),
    'bank to 60 s': (0.0, 20.0, 60.0),
    'bank to 600 s': (0.0, 100.0, 600.0),
}
LONG_BANK_S = max(BANKS_S.values(), key=len)
#: Time constants of the pool, increasing, s, shape (K,).
POOL_S: FloatArray = np.unique(np.concatenate([*BANKS_S.values()]))
#: Ridge of the banks, relative to the diagonal; the static fit takes the weakest.
STRENGTHS = (1e-2, 1e-4, 1e-6)
#: The variance that a gain has before any data falls by this factor with every degree.
DEGREE_PENALTY = 10.0
#: A fit's weight is what it leaves of the folds to the power of minus this.
_SHARPNESS = 8.0
#: Fits are compared by means over this time, or all look alike where a robot moves, s.
_COMPARED_S = 120.0
#: What a body forgets that did not start at rest is set aside before fits are compared, as far as
#: its variance is below this many times that of the mean of all errors. Without a limit 1.1 times
#: as much drift was left where a single day was learnt from.
_TRANSIENT_VARIANCE = 30.0


class RidgeFit(NamedTuple):
    """A candidate: its name for people, relaxations and highest power, and its ridge."""

    name: str
    bank_s: tuple[float, ...]
    degree: int
    strength: float


def candidates(highest_degree: int) -> list[RidgeFit]:
    """List the candidates, the simplest first: ten for each degree."""
    fits = []
    for degree in range(1, highest_degree + 1):
        fits.append(RidgeFit(f'static, degree {degree}', (0.0,), degree, STRENGTHS[-1]))
        fits += [
            RidgeFit(f'{name}, degree {degree}', bank_s, degree, strength)
            for name, bank_s in BANKS_S.items()
            for strength in STRENGTHS
        ]
    return fits


def fit_ridge(
    candidate: RidgeFit, highest_degree: int, thermometers: int, products: FloatArray
) -> FloatArray:
    """
    Fit a candidate to centred products of all columns, (P, P): gains of them, (P,), -1 of r - w.

    Powers up to the candidate's degree explain zero drift, the first one sensitivity drift.
    """
    # The columns that the candidate uses, and the power of temperature in each. Columns stand by
    # relaxation, power, thermometer, behind the constant; those with load behind all without.
    width, j = highest_degree * thermometers, np.arange(thermometers)
    banks = 1 + np.searchsorted(POOL_S, candidate.bank_s)[:, np.newaxis] * width
    places: IntArray = (banks + np.arange(candidate.degree * thermometers)).ravel()
    powers: IntArray = (places - 1) % width // thermometers + 1
    half = 1 + len(POOL_S) * width
    if len(products) > half + 1:
        places = np.concatenate((places, (half + banks + j).ravel(), [half]))
        powers = np.append(powers, np.ones(len(places) - len(powers), dtype=int))
    diagonal = np.diagonal(products)[places]
    size = 1 / np.sqrt(np.where(diagonal > 0, diagonal, np.inf))
    size = size * DEGREE_PENALTY ** (-(powers - 1) / 2)
    scaled = products[np.ix_(places, places)] * np.outer(size, size)
    ridge = candidate.strength * np.eye(len(places))
    gains = np.zeros(len(products))
    gains[places] = np.linalg.solve(scaled + ridge, products[places, -1] * size) * size
    gains[-1] = -1.0
    return gains


def identify_auto(data: AxisData, settings: IdentificationSettings) -> AxisFit:
    """Learn the drift of an axis from all fits, each as far as it holds unseen."""
    fits = candidates(settings.highest_degree)
    bins = bin_axis_data(data, data.bin_cells)
    relaxed_c = bins.relaxed(POOL_S)
    features = build_features(bins.temperature_c, settings, beyond='tangents')
    sums = sum_by_fold(
        bins, [features.expand(values_c).reshape(len(values_c), -1) for values_c in relaxed_c]
    )

    def fit_all(products: FloatArray) -> FloatArray:
        """Fit no compensation and all candidates: their gains, (C, P)."""
        shape = settings.highest_degree, features.thermometers
        none = np.append(np.zeros(len(products) - 1), -1.0)
        return np.stack([none, *(fit_ridge(fit, *shape, products) for fit in fits)])

    left, compared = [], []
    for i, fold in data.folds_by_recording:
        gains = fit_all(sums.centred(sums.fold != fold))
        # What runs has the range that the other folds saw, so the rule beyond it is judged, too.
        pairs = zip(bins.temperature_c, bins.folds, strict=True)
        others_c = np.concatenate([values_c[folds != fold] for values_c, folds in pairs])
        seen = replace(features, lower_c=others_c.min(axis=0), upper_c=others_c.max(axis=0))
        rows = np.flatnonzero((bins.folds[i] == fold) & (bins.moments[i][:, 0, 0] > 0))
        x = seen.expand(relaxed_c[i][rows]).reshape(len(rows), -1)
        errors = -bins.mean_columns(i, rows, x) @ gains.T
        middles = np.minimum((rows + 0.5) * bins.cells - 0.5, len(data.residual[i]) - 1)
        left.append(HeldOutFold(i, fold, middles, tare(errors, data.bin_s)))
        compared.append(_compared_squares(errors, data.bin_s))
    weights = weigh(left, compared)
    used = weights[0] < 1
    model = None
    if used:
        gains = weights @ fit_all(sums.centred(sums.fold >= 0))
        model = build_axis_model(features, POOL_S, gains[:-1], data.period_s)
    names = ['none', *(fit.name for fit in fits)]
    fit = state_fit(data, model, COMBINATION if used else 'none', left, names, weights)
    before = f'no compensation leaves {fit.rms_before:.3g} {fit.unit} RMS'
    reason = f'Nothing that was tried holds on held-out data: {before}.'
    if used:
        heaviest = sorted(fit.candidates, key=lambda candidate: -candidate.weight)[:2]
        both = ' and '.join(f'{one.name} ({100 * one.weight:.0f} %)' for one in heaviest)
        reason = (
            f'An average of {len(fits)} fits leaves {fit.rms_after:.3g} {fit.unit} on held-out '
            f'data, {before}; most weight have {both}.'
        )
    return replace(fit, reason=reason)


def _compared_squares(errors: FloatArray, bin_s: float) -> FloatArray:
    """Mean squares by which fits are compared, (C,): errors, (n, C), with the start set aside."""
    # A constant, and a start transient of the longest relaxations.
    count = len(errors)
    time_s = bin_s * np.arange(count)
    transients = np.exp(-time_s[:, np.newaxis] / np.array(LONG_BANK_S[-3:]))
    phi = np.concatenate((np.ones((count, 1)), transients), axis=1)
    precision = np.full(phi.shape[1], count / _TRANSIENT_VARIANCE)
    precision[0] = 0.0
    level = np.linalg.solve(phi.T @ phi + np.diag(precision), phi.T @ errors)
    width = max(1, min(round(_COMPARED_S / bin_s), count // BINS_PER_FOLD))
    means = bin_means(errors - phi @ level, np.arange(count), width)
    return np.asarray((means**2).mean(axis=0) + precision @ level**2 / count)


def weigh(left: Sequence[HeldOutFold], compared: Sequence[FloatArray]) -> FloatArray:
    """
    Weigh no compensation and all fits by the squares that they leave of the folds: (C,), of sum 1.

    The mean of a logarithm over folds is a geometric mean of errors: no day outvotes the others.
    """
    logs = np.log(np.maximum(compared, np.finfo(float).tiny)).mean(axis=0) / 2
    weights = np.exp(-_SHARPNESS * (logs - logs[1:].min()))
    weights[0] = 0.0
    weights /= weights.sum()
    none: FloatArray = np.eye(len(weights))[0]
    return weights if is_worth_running(left, weights) else none
