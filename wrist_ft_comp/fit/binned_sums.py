"""
Sums that linear fits of an axis need: over the bins of every fold and segment, once for all fits.

    r - w = Σ_τ Σ_f g_τf x_f(H_τ T)  +  w · Σ_τ Σ_f k_τf x_f(H_τ T)  +  s_0 w  +  c_segment

A segment is a recording, or what is between two of its tares. Samples are summed over bins first,
within which features hardly change and loads do. Columns are

    [ 1 | x_f(H_τ T) … | r - w ]                              without load
    [ 1 | x_f(H_τ T) … | w | w x_f(H_τ T) … | r - w ]         with load
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.drift.arx import free_run, relaxation, static_gain
from wrist_ft_comp.drift.arx_pls import ArxPls
from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.axis_data import AxisData
from wrist_ft_comp.series import BoolArray, FloatArray, IntArray, ROUNDING


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
        return [
            np.stack([free_run(lag, means_c) for lag in lags], axis=1)
            for means_c in self.temperature_c
        ]

    def mean_columns(self, recording: int, rows: IntArray, x: FloatArray) -> FloatArray:
        """Put all columns together, means of some bins of a recording: x is (n, K·F)."""
        means = self.moments[recording][rows, 0] / self.moments[recording][rows, 0, :1]
        x = _with_constant(x)
        behind = [x * means[:, [part]] for part in range(means.shape[1] - 1)]
        return np.concatenate((*behind, means[:, -1:]), axis=1)


def _with_constant(x: FloatArray) -> FloatArray:
    """Put the column 1 before others."""
    return np.concatenate((np.ones((len(x), 1)), x), axis=1)


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
        temperature_sums = np.add.reduceat(data.temperature_c[i], starts, axis=0)
        means_c.append(temperature_sums / np.diff(starts, append=len(values))[:, np.newaxis])
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

    def centred(self, keep: BoolArray) -> FloatArray:
        """Sum the products of some pairs, each segment centred by itself: (P, P)."""
        whole = total = np.asarray(self.products[keep].sum(axis=0))
        for segment in np.unique(self.segment[keep]):
            inside = self.products[keep & (self.segment == segment)].sum(axis=0)
            count, sums = inside[0, 0], inside[0]
            total = total - np.outer(sums, sums) / count
        # A column that is constant within each segment holds nothing; rounding must not pretend.
        silent = np.diagonal(total) <= ROUNDING * np.diagonal(whole)
        total[silent] = 0.0
        total[:, silent] = 0.0
        return total


def sum_by_fold(data: BinnedData, features: Sequence[FloatArray]) -> SumsByFold:
    """Sum products of all columns over every fold of every segment; features are (n_i, K·F)."""
    products, pairs = [], []
    for i, x in enumerate(features):
        used = data.moments[i][:, 0, 0] > 0
        pair_of_bin = np.stack((data.segments[i], data.folds[i]), axis=1)
        for pair in np.unique(pair_of_bin[used], axis=0):
            rows = used & (pair_of_bin == pair).all(axis=1)
            moments, columns = data.moments[i][rows], _with_constant(x[rows])
            # What stands behind 1, behind w and behind r - w.
            behind = [columns] * (moments.shape[1] - 1) + [columns[:, :1]]
            products.append(
                np.block(
                    [
                        [
                            (one * moments[:, a, b, np.newaxis]).T @ other
                            for b, other in enumerate(behind)
                        ]
                        for a, one in enumerate(behind)
                    ]
                )
            )
            pairs.append(pair)
    segment, fold = np.transpose(pairs)
    return SumsByFold(np.array(products), segment, fold)


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
