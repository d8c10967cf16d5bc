"""
Method ``auto``: an average of 30 ridge fits, weighted by what they leave of recordings held out.

Picking the best of many fits on three or four recordings is itself an overfit, so none is picked.
All fits are vectors of gains of one pool of columns, so their average is such a vector, too:

    r - w = Σ_τ Σ_f g_τf x_f(H_τ T)  +  w · Σ_τ Σ_f k_τf x_f(H_τ T)  +  s_0 w  +  c_segment

with powers x_f of temperature behind relaxations H_τ; a segment is a recording, or what is between
two of its tares. Samples are summed over bins first, within which features hardly change and loads
do, and then over every fold of every segment, once for all fits. Columns are

    [ 1 | x_f(H_τ T) … | r - w ]                              without load
    [ 1 | x_f(H_τ T) … | w | w x_f(H_τ T) … | r - w ]         with load
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.drift.arx_pls import ArxPls, free_run, relaxation, static_gain
from wrist_ft_comp.drift.drift_model import AxisModel
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.axis_data import AxisData, BINS_PER_FOLD, build_features
from wrist_ft_comp.fit.day_limit import state_fit
from wrist_ft_comp.fit.folds import hold_out, mean_over, tare
from wrist_ft_comp.fit.result import AxisFit, HeldOut, rms_by_fold
from wrist_ft_comp.fit.settings import IdentificationSettings
from wrist_ft_comp.series import BoolArray, FloatArray, IntArray, ROUNDING

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
#: An average that lowers what is left of held-out recordings by less than this is not run, ...
_WORTH_RUNNING = 0.02
#: ... nor one that leaves this many times more of one of several recordings: it was right by
#: chance on the others. Of 144 axes on which there is nothing to learn one left 1.82 times as much
#: without this rule, with it none more than 1.1 times. Thirds of a single recording say less:
#: there an average that left 3 times more of one of them left 0.11 of another day.
HARMFUL_FOLD = 1.25
#: Of a recording that hardly drifts, as of an idle hour, this share of the mean drift may be left,
#: however many times its own that is.
_LITTLE = 0.1
#: What a body forgets that did not start at rest is set aside before fits are compared, as far as
#: its variance is below this many times that of the mean of all errors. Without a limit 1.1 times
#: as much drift was left where a single day was learnt from.
_TRANSIENT_VARIANCE = 30.0
#: A load varies where its variance is above this share of its mean square: by 10 % in segments, by
#: 30 % between them, whose drift differs for other reasons, too: with less, 18 N were wrong.
_VARIES, _DIFFERS = 0.01, 0.1


class RidgeFit(NamedTuple):
    """A candidate: its name for people, relaxations and highest power, and its ridge."""

    name: str
    bank_s: tuple[float, ...]
    degree: int
    strength: float


def shown_by(longest_s: float, time_constants_s: Sequence[float]) -> tuple[float, ...]:
    """
    Leave out relaxations that last more than a third of the longest recording.

    In a shorter one they are a line, which goes on for hours on another day.
    """
    return tuple(tau_s for tau_s in time_constants_s if tau_s <= longest_s / 3)


def candidates(highest_degree: int, longest_s: float = np.inf) -> list[RidgeFit]:
    """List the candidates, the simplest first: ten for each degree."""
    fits = []
    banks = {name: shown_by(longest_s, bank_s) for name, bank_s in BANKS_S.items()}
    for degree in range(1, highest_degree + 1):
        fits.append(RidgeFit(f'static, degree {degree}', (0.0,), degree, STRENGTHS[-1]))
        fits += [
            RidgeFit(f'{name}, degree {degree}', bank_s, degree, strength)
            for name, bank_s in banks.items()
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
    # Columns stand by relaxation, power (from 0), thermometer, behind the constant; those with
    # load behind all without.
    lag, power, _ = np.indices((len(POOL_S), highest_degree, thermometers)).reshape(3, -1)
    in_bank = np.isin(POOL_S[lag], candidate.bank_s)
    alone, with_load = in_bank & (power < candidate.degree), in_bank & (power == 0)
    used = np.concatenate(([False], alone, [True], with_load))
    places = np.flatnonzero(used[: len(products) - 1])
    powers = np.tile(np.insert(power, 0, 0), 2)[places]
    diagonal = np.diagonal(products)[places]
    size = 1 / np.sqrt(np.where(diagonal > 0, diagonal, np.inf))
    size = size * DEGREE_PENALTY ** (-powers / 2)
    scaled = products[np.ix_(places, places)] * np.outer(size, size)
    ridge = candidate.strength * np.eye(len(places))
    gains = np.zeros(len(products))
    gains[places] = np.linalg.solve(scaled + ridge, products[places, -1] * size) * size
    gains[-1] = -1.0
    return gains


def identify_auto(data: AxisData, settings: IdentificationSettings) -> AxisFit:
    """Learn the drift of an axis from all fits, each as far as it holds unseen."""
    fits = candidates(settings.highest_degree, data.longest_s)
    bins = bin_axis_data(data, data.bin_cells)
    relaxed_c = bins.relaxed(POOL_S)
    observed = [moments[:, 0, 0] > 0 for moments in bins.moments]
    observed_c = [c[at] for c, at in zip(bins.temperature_c, observed, strict=True)]
    features = build_features(observed_c, settings)
    sums = sum_by_fold(bins, [features.expand(c).reshape(len(c), -1) for c in relaxed_c])

    def fit_all(products: FloatArray) -> FloatArray:
        """Fit no compensation and all candidates: their gains, (C, P)."""
        shape = settings.highest_degree, features.thermometers
        none = np.append(np.zeros(len(products) - 1), -1.0)
        return np.stack([none, *(fit_ridge(fit, *shape, products) for fit in fits)])

    cells, errors, compared = [], [], []
    for i, fold in data.folds_by_recording:
        gains = fit_all(sums.centred(sums.fold != fold))
        # What runs has the range that the other folds saw, so the rule beyond it is judged, too.
        parts = zip(observed_c, bins.folds, observed, strict=True)
        others_c = np.concatenate([c[folds[at] != fold] for c, folds, at in parts])
        seen = replace(features, lower_c=others_c.min(axis=0), upper_c=others_c.max(axis=0))
        rows = np.flatnonzero((bins.folds[i] == fold) & observed[i])
        x = seen.expand(seen.clamp(relaxed_c[i][rows])).reshape(len(rows), -1)
        of_fold = -bins.mean_columns(i, rows, x) @ gains.T
        cells.append(np.minimum((rows + 0.5) * bins.cells - 0.5, len(data.residual[i]) - 1))
        segments = bins.segments[i][rows]
        errors.append([tare(of_fold, one, data.bin_s) for one in (segments, 0 * segments)])
        compared.append(_compared_squares(of_fold, data.bin_s))
    # What is left is stated of segments; a model runs where it helps these, or whole folds.
    left, whole = (hold_out(data, cells, np.concatenate(one)) for one in zip(*errors, strict=True))
    weights = min((weigh(one, compared) for one in (left, whole)), key=lambda each: each[0])
    gains = weights @ fit_all(sums.centred(sums.fold >= 0))
    model = build_axis_model(features, POOL_S, gains[:-1], data.period_s)
    names = ['none', *(fit.name for fit in fits)]
    return state_fit(data, model, COMBINATION if model else 'none', left, names, weights)


def _compared_squares(errors: FloatArray, bin_s: float) -> FloatArray:
    """Mean squares by which fits are compared, (C,): errors, (n, C), with the start set aside."""
    # A constant, and a start transient of the longest relaxations.
    count = len(errors)
    transients = np.exp(-bin_s * np.arange(count)[:, np.newaxis] / np.array(LONG_BANK_S[-3:]))
    phi = np.concatenate((np.ones((count, 1)), transients), axis=1)
    precision = np.full(phi.shape[1], count / _TRANSIENT_VARIANCE)
    precision[0] = 0.0
    level = np.linalg.solve(phi.T @ phi + np.diag(precision), phi.T @ errors)
    width = max(1, min(round(_COMPARED_S / bin_s), count // BINS_PER_FOLD))
    means = mean_over(errors - phi @ level, width)
    return np.asarray((means**2).mean(axis=0) + precision @ level**2 / count)


def weigh(left: HeldOut, compared: Sequence[FloatArray]) -> FloatArray:
    """
    Weigh no compensation and all fits by the squares that they leave of the folds: (C,), of sum 1.

    The mean of a logarithm over folds is a geometric mean of errors: no day outvotes the others.
    """
    logs = np.log(np.maximum(compared, np.finfo(float).tiny)).mean(axis=0) / 2
    weights: FloatArray = np.exp(-_SHARPNESS * (logs - logs[1:].min()))
    weights[0] = 0.0
    weights /= weights.sum()
    # An average runs where it leaves less of the folds than no compensation.
    before, after = rms_by_fold(left.averaged(weights))
    several = len(np.unique(left.recording)) > 1
    little = _LITTLE * before.mean()
    harmful = several and (after > np.maximum(HARMFUL_FOLD * before, little)).any()
    if after.mean() < (1 - _WORTH_RUNNING) * before.mean() and not harmful:
        return weights
    return np.asarray(np.eye(len(weights))[0])


@dataclass(frozen=True, eq=False)
class BinnedData:
    """One axis over several recordings in bins: the tuples hold an array for every recording."""

    #: Length of a cell, s, and how many cells a bin has.
    period_s: float
    cells: int
    #: Means of each bin, °C, shape (n_i, J).
    temperature_c: tuple[FloatArray, ...]
    #: Sums over the samples of each bin of the products of 1, w (with load) and r - w, shape
    #: (n_i, 3, 3) or (n_i, 2, 2): moments[:, 0, 0] counts samples.
    moments: tuple[FloatArray, ...]
    folds: tuple[IntArray, ...]
    #: Number of the segment that each bin is in, (n_i,), counted through all recordings.
    segments: tuple[IntArray, ...]

    def relaxed(self, time_constants_s: FloatArray) -> list[FloatArray]:
        """Run the bins' temperatures behind relaxations, as they run cell by cell: (n_i, K, J)."""
        lags = [relaxation(tau, self.period_s, self.cells) for tau in time_constants_s]
        return [np.stack([free_run(lag, c) for lag in lags], axis=1) for c in self.temperature_c]

    def mean_columns(self, recording: int, rows: IntArray, x: FloatArray) -> FloatArray:
        """Put all columns together, means of some bins of a recording: x is (n, K·F)."""
        means = self.moments[recording][rows, 0] / self.moments[recording][rows, 0, :1]
        behind = means[:, :-1, np.newaxis] * np.insert(x, 0, 1.0, axis=1)[:, np.newaxis]
        return np.concatenate((behind.reshape(len(x), -1), means[:, -1:]), axis=1)


def bin_axis_data(data: AxisData, cells: int) -> BinnedData:
    """Sum an axis over bins of some cells."""
    moments, segments, means_c, first_segment = [], [], [], 0
    for i, residual in enumerate(data.residual):
        load = () if data.load is None else (data.load[i],)
        values = np.stack((np.ones_like(residual), *load, residual), axis=1)
        values[~np.isfinite(values).all(axis=1)] = 0.0
        starts = np.arange(0, len(values), cells)
        products = values[:, :, np.newaxis] * values[:, np.newaxis]
        moments.append(np.add.reduceat(products, starts))
        means_c.append(mean_over(data.temperature_c[i], cells))
        middle = starts + (cells - 1) / 2
        segments.append(first_segment + np.searchsorted(sorted(data.steps[i]), middle, 'right'))
        first_segment += len(data.steps[i]) + 1
    return BinnedData(
        data.period_s, cells, tuple(means_c), tuple(moments),
        folds=tuple(folds[::cells] for folds in data.folds), segments=tuple(segments))  # fmt: skip


class SumsByFold(NamedTuple):
    """Sums over the samples of B pairs of segment and fold, of products of all P columns."""

    #: Shape (B, P, P); the first row holds sums of the columns, and first of all their count.
    products: FloatArray
    #: Shape (B,).
    segment: IntArray
    fold: IntArray
    #: Number of the load's column, behind which are those with load; P without load.
    load: int

    def centred(self, keep: BoolArray) -> FloatArray:
        """Sum the products of some pairs, each segment centred by itself: (P, P)."""
        whole = total = np.asarray(self.products[keep].sum(axis=0))
        for segment in np.unique(self.segment[keep]):
            inside = self.products[keep & (self.segment == segment)].sum(axis=0)
            count, sums = inside[0, 0], inside[0]
            total = total - np.outer(sums, sums) / count
        # A column that is constant within each segment holds nothing; rounding must not pretend.
        silent = np.diagonal(total) <= ROUNDING * np.diagonal(whole)
        if self.load < len(total):
            # Under one load, gain drift looks like zero drift, and is taken for that. Where each
            # segment has one of its own, only the constant gain error does not show.
            square = whole[self.load, self.load]
            varies = square * whole[0, 0] - whole[0, self.load] ** 2
            if total[self.load, self.load] < _VARIES * square:
                silent[self.load] = True
                silent[self.load + 1 : -1] |= varies < _DIFFERS * square * whole[0, 0]
        total[silent] = 0.0
        total[:, silent] = 0.0
        return total


def sum_by_fold(data: BinnedData, features: Sequence[FloatArray]) -> SumsByFold:
    """Sum products of all columns over every fold of every segment; features are (n_i, K·F)."""
    products, pairs = [], []
    for i, x in enumerate(features):
        used, segments, folds = data.moments[i][:, 0, 0] > 0, data.segments[i], data.folds[i]
        for pair in sorted(set(zip(segments[used].tolist(), folds[used].tolist(), strict=True))):
            rows = used & (segments == pair[0]) & (folds == pair[1])
            moments, columns = data.moments[i][rows], np.insert(x[rows], 0, 1.0, axis=1)
            # Of 1 and w, each times 1 and x, with one another; then of these with r - w.
            behind = moments[:, :-1, :-1, np.newaxis] * columns[:, np.newaxis, np.newaxis]
            square = np.tensordot(behind, columns, (0, 0)).swapaxes(1, 2)
            last = (moments[:, :-1, -1].T @ columns).reshape(-1, 1)
            corner = moments[:, -1, -1].sum().reshape(1, 1)
            products.append(np.block([[square.reshape(len(last), -1), last], [last.T, corner]]))
            pairs.append(pair)
    segment, fold = np.transpose(pairs)
    width = 1 + features[0].shape[1]
    load = width if data.moments[0].shape[1] > 2 else width + 1
    return SumsByFold(np.array(products), segment, fold, load)


def build_axis_model(
    features: Features, time_constants_s: FloatArray, gains: FloatArray, period_s: float
) -> AxisModel | None:
    """
    Write gains of all columns but r - w in the form that runs; all gains zero give None.

    Relaxations become filters, and all filtered temperatures one set of features. Soaked at T_ref
    there is no zero drift.
    """
    count = len(time_constants_s)
    by_output = gains.reshape(-1, 1 + count * features.width)  # (M, 1 + K·F)
    of_features = by_output[:, 1:]
    if not of_features.any():
        return None
    if features.kind == 'powers':  # from relaxation, power, thermometer to power first
        shape = len(of_features), count, features.degree, features.thermometers
        of_features = of_features.reshape(shape).swapaxes(1, 2).reshape(len(of_features), -1)
    joined = replace(
        features, reference_c=np.tile(features.reference_c, count),
        lower_c=np.tile(features.lower_c, count), upper_c=np.tile(features.upper_c, count),
        knots_c=features.knots_c * count)  # fmt: skip
    outputs, inputs = of_features.shape
    # Each output is a static latent (eq. 10): rotations are its gains, and loadings copy it.
    dynamics = ArxPls(
        input_mean=np.zeros(inputs), input_weight=np.ones(inputs),
        rotations=np.ascontiguousarray(of_features.T), latents=(static_gain(),) * outputs,
        output_loadings=np.eye(outputs), output_weight=np.ones(outputs),
        output_mean=np.zeros(outputs))  # fmt: skip
    bank = tuple(relaxation(tau, period_s) for tau in time_constants_s.tolist())
    model = AxisModel(joined, dynamics, bank if time_constants_s.any() else ())
    x = np.tile(features.expand(features.reference_c), count)
    return model.anchored([0.0, *(by_output[1:, 0] + by_output[1:, 1:] @ x)])
