"""
Sums of products of columns, one set for each segment and fold: all that a ridge fit needs.

Samples are summed over bins first, within which features hardly change and loads do; then products
of columns are summed over the bins of every fold. A segment is a recording, or what is between two
of its tares; it has a constant of its own.

    r - w = Σ_τ Σ_f g_τf x_f(H_τ T)  +  w · Σ_τ Σ_f k_τf x_f(H_τ T)  +  s_0 w  +  c_segment
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrist_ft_comp.drift.arx import Arx, mean_relaxation, relaxation
from wrist_ft_comp.fit.axis_data import AxisData
from wrist_ft_comp.series import BoolArray, FloatArray, IntArray

#: Share of a column's sum of squares below which what centring leaves is rounding.
_SILENT = 1e-12


@dataclass(frozen=True, eq=False)
class BinSums:
    """Sums of w, r - w and their products over a recording's bins, (n,); 0 where count is 0."""

    count: FloatArray
    load: FloatArray
    load_square: FloatArray
    residual: FloatArray
    residual_square: FloatArray
    product: FloatArray


@dataclass(frozen=True, eq=False)
class BinnedData:
    """One axis over several recordings in bins: as AxisData, with the sums of each recording."""

    #: Length of a bin, s, and how many cells it has.
    period_s: float
    cells: int
    #: Means of each bin, °C, shape (n_i, J).
    temperature_c: tuple[FloatArray, ...]
    sums: tuple[BinSums, ...]
    folds: tuple[IntArray, ...]
    #: Number of the segment that each bin is in, (n_i,), counted through all recordings.
    segments: tuple[IntArray, ...]
    loaded: bool

    def relaxation(self, time_constant_s: float) -> Arx:
        """First-order lag of the bins' temperatures: what runs, averaged over each bin."""
        if self.cells == 1:
            return relaxation(time_constant_s, self.period_s)
        return mean_relaxation(time_constant_s, self.period_s / self.cells, self.cells)


def bin_axis_data(data: AxisData, cells: int) -> BinnedData:
    """Sum an axis over bins of some cells."""
    sums, segments, means_c, first_segment = [], [], [], 0
    for i, residual in enumerate(data.residual):
        w = np.zeros_like(residual) if data.load is None else data.load[i]
        present = np.isfinite(residual) & np.isfinite(w)
        y, w = np.where(present, residual, 0.0), np.where(present, w, 0.0)
        rows = [present.astype(float), w, w * w, y, y * y, w * y]
        starts = np.arange(0, len(y), cells)
        sums.append(BinSums(*(np.add.reduceat(row, starts) for row in rows)))
        temperature_sums = np.add.reduceat(data.temperature_c[i], starts, axis=0)
        means_c.append(temperature_sums / np.diff(starts, append=len(y))[:, np.newaxis])
        middle = (np.arange(len(sums[-1].count)) + 0.5) * cells
        segments.append(first_segment + np.searchsorted(sorted(data.steps[i]), middle))
        first_segment += len(data.steps[i]) + 1
    return BinnedData(
        period_s=cells * data.period_s, cells=cells,
        temperature_c=tuple(means_c),
        sums=tuple(sums), folds=tuple(folds[::cells] for folds in data.folds),
        segments=tuple(segments), loaded=data.load is not None)  # fmt: skip


@dataclass(frozen=True, eq=False)
class SumsByFold:
    """Sums over the samples of B pairs of segment and fold: of P columns and, last, of r - w."""

    #: Samples, (B,), sums of the columns, (B, P + 1), and of their products, (B, P + 1, P + 1).
    count: FloatArray
    sums: FloatArray
    products: FloatArray
    #: Segment and fold, (B,).
    segment: IntArray
    fold: IntArray

    def centred(self, keep: BoolArray) -> FloatArray:
        """Sum the products of some pairs, each segment centred by itself: (P + 1, P + 1)."""
        whole = total = np.asarray(self.products[keep].sum(axis=0))
        for segment in np.unique(self.segment[keep]):
            inside = keep & (self.segment == segment)
            column_sums = self.sums[inside].sum(axis=0)
            total = total - np.outer(column_sums, column_sums) / self.count[inside].sum()
        # A column that is constant within each segment holds nothing; rounding must not pretend.
        silent = np.diagonal(total) <= _SILENT * np.diagonal(whole)
        total[silent] = 0.0
        total[:, silent] = 0.0
        return total


def sum_by_fold(data: BinnedData, columns: Sequence[FloatArray]) -> SumsByFold:
    """Sum products of columns, (n_i, C), over every fold of every segment."""
    #   [ x_f(H_τ T) … | w x_f(H_τ T) … | w | y ]     with load, y = r - w
    #   [ x_f(H_τ T) … | y ]                          without
    pairs = []
    for i, of_recording in enumerate(columns):
        bins, folds = data.sums[i], data.folds[i]
        used = bins.count > 0
        for segment in np.unique(data.segments[i][used]):
            for fold in np.unique(folds[used]):
                rows = np.flatnonzero(used & (data.segments[i] == segment) & (folds == fold))
                if not len(rows):
                    continue
                x, count, y = of_recording[rows], bins.count[rows], bins.residual[rows]
                plain, xy, yy = _square(x, count), y @ x, bins.residual_square[rows].sum()
                sums = np.append(count @ x, y.sum())
                products = np.block([[plain, xy[:, np.newaxis]], [xy, yy]])
                if data.loaded:
                    w, ww, wy = bins.load[rows], bins.load_square[rows], bins.product[rows]
                    sums = np.concatenate((count @ x, w @ x, [w.sum(), y.sum()]))
                    mixed, doubled = (x * w[:, np.newaxis]).T @ x, _square(x, ww)
                    with_w = np.concatenate((w @ x, ww @ x))[:, np.newaxis]
                    with_y = np.concatenate((xy, wy @ x))[:, np.newaxis]
                    products = np.block(
                        [
                            [np.block([[plain, mixed], [mixed, doubled]]), with_w, with_y],
                            [with_w.T, ww.sum(), wy.sum()],
                            [with_y.T, wy.sum(), yy],
                        ]
                    )
                pairs.append((float(count.sum()), sums, products, int(segment), int(fold)))
    return SumsByFold(*map(np.array, zip(*pairs, strict=True)))


def _square(x: FloatArray, weights: FloatArray) -> FloatArray:
    """Sum weighted products xᵀ diag(weights) x: a matrix with itself takes half the time."""
    weighted = x * np.sqrt(weights)[:, np.newaxis]
    return np.asarray(weighted.T @ weighted)
