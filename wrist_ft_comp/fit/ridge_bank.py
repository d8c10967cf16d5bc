"""
The 30 candidates of ``auto``: ridge regressions on one pool of columns, each a vector of gains.

A column of the pool is a power of temperature behind a relaxation; with load also a temperature
behind a relaxation times the load, and the load. So every average of fits is such a vector, too.

    r - w = Σ_τ Σ_f g_τf x_f(H_τ T)  +  w · Σ_τ Σ_f k_τf x_f(H_τ T)  +  s_0 w  +  c_segment

A segment is a recording, or what is between two of its tares. Samples are summed over bins first,
within which features hardly change and loads do; then products of columns are summed over the bins
of every fold and segment, which is all that a ridge fit needs.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.drift.arx import Arx, free_run, mean_relaxation, relaxation, static_gain
from wrist_ft_comp.drift.arx_pls import ArxPls
from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.axis_data import AxisData
from wrist_ft_comp.series import BoolArray, FloatArray, IntArray, ROUNDING

#: A relaxation without memory, s, which every bank holds.
STATIC_S = 0.0
#: Time constants of the longest bank of relaxations, s.
LONG_BANK_S = (STATIC_S, 30.0, 100.0, 300.0, 1000.0, 3000.0)
#: Time constants of all banks, s. With the longest alone 1.18 times as much drift was left on 620
#: drawn days of 31 kinds.
BANKS_S = {
    'bank to 3000 s': LONG_BANK_S,
    'bank to 60 s': (STATIC_S, 20.0, 60.0),
    'bank to 600 s': (STATIC_S, 100.0, 600.0),
}
#: Time constants of the pool, increasing, s, shape (K,).
POOL_S: FloatArray = np.unique(np.concatenate([*BANKS_S.values()]))
#: Ridge of the banks, relative to the diagonal; the static fit takes the weakest.
STRENGTHS = (1e-2, 1e-4, 1e-6)
#: The variance that a gain has before any data falls by this factor with every degree.
DEGREE_PENALTY = 10.0


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
        fits.append(RidgeFit(f'static, degree {degree}', (STATIC_S,), degree, STRENGTHS[-1]))
        fits += [
            RidgeFit(f'{name}, degree {degree}', bank_s, degree, strength)
            for name, bank_s in BANKS_S.items()
            for strength in STRENGTHS
        ]
    return fits


class Pool(NamedTuple):
    """How the columns of the pool are laid out: by relaxation, power, thermometer; then loads."""

    highest_degree: int
    thermometers: int
    loaded: bool

    def fit(self, candidate: RidgeFit, normal: FloatArray) -> FloatArray:
        """
        Fit a candidate to centred sums of products, (P + 1, P + 1).

        The result, (P + 1,), holds gains of the whole pool and, last, -1 for r - w. Powers up to
        the degree explain zero drift, the first one sensitivity drift.
        """
        # The columns that the candidate uses, and the power of temperature in each.
        width, j = self.highest_degree * self.thermometers, np.arange(self.thermometers)
        banks = np.searchsorted(POOL_S, candidate.bank_s)[:, np.newaxis] * width
        places: IntArray = (banks + np.arange(candidate.degree * self.thermometers)).ravel()
        powers: IntArray = places % width // self.thermometers + 1
        if self.loaded:
            half = len(POOL_S) * width
            places = np.concatenate((places, (half + banks + j).ravel(), [2 * half]))
            powers = np.append(powers, np.ones(len(places) - len(powers), dtype=int))
        diagonal = np.diagonal(normal)[places]
        size = 1 / np.sqrt(np.where(diagonal > 0, diagonal, np.inf))
        size = size * DEGREE_PENALTY ** (-(powers - 1) / 2)
        scaled = normal[np.ix_(places, places)] * np.outer(size, size)
        ridge = candidate.strength * np.eye(len(places))
        gains = np.zeros(len(normal))
        gains[places] = np.linalg.solve(scaled + ridge, normal[places, -1] * size) * size
        gains[-1] = -1.0
        return gains

    def fit_all(self, candidates: Sequence[RidgeFit], normal: FloatArray) -> FloatArray:
        """Fit no compensation and all candidates: their gains, (C, P + 1)."""
        none = np.append(np.zeros(len(normal) - 1), -1.0)
        return np.stack([none, *(self.fit(candidate, normal) for candidate in candidates)])


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

    def relaxed(self, time_constants_s: FloatArray) -> list[FloatArray]:
        """Run the bins' temperatures behind relaxations, as they run cell by cell: (n_i, K, J)."""
        lags: list[Arx] = []
        for tau_s in time_constants_s.tolist():
            if self.cells == 1:
                lags.append(relaxation(tau_s, self.period_s))
            else:
                lags.append(mean_relaxation(tau_s, self.period_s / self.cells, self.cells))
        return [
            np.stack([free_run(lag, own_c) for lag in lags], axis=1)
            for own_c in self.temperature_c
        ]

    def regression(self, recording: int, rows: IntArray, x: FloatArray) -> FloatArray:
        """Put features, (n, C), of some bins of a recording beside what they explain."""
        #   [ x_f(H_τ T) … | r - w ]                              without load
        #   [ x_f(H_τ T) … | w x_f(H_τ T) … | w | r - w ]         with load
        sums, count = self.sums[recording], self.sums[recording].count[rows, np.newaxis]
        w, y = sums.load[rows, np.newaxis] / count, sums.residual[rows, np.newaxis] / count
        load = (w * x, w) if self.loaded else ()
        return np.concatenate((x, *load, y), axis=1)


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
        silent = np.diagonal(total) <= ROUNDING * np.diagonal(whole)
        total[silent] = 0.0
        total[:, silent] = 0.0
        return total


def sum_by_fold(data: BinnedData, columns: Sequence[FloatArray]) -> SumsByFold:
    """Sum products of columns, (n_i, C), over every fold of every segment."""
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


def build_axis_model(
    features: Features,
    time_constants_s: FloatArray,
    gains: FloatArray,
    inputs: Sequence[FloatArray],
    period_s: float,
) -> AxisModel | None:
    """
    Write gains of the features of K relaxed temperatures in the form that runs.

    Gains, (K·F,), are those of the zero drift, by relaxation; or (2·K·F + 1,), with those of the
    sensitivity drift and its constant behind. Relaxations become filters, and all filtered
    temperatures one set of features; inputs, (n_i, K·F), say how far they move. Soaked at T_ref
    there is no zero drift. All gains zero give None.
    """
    count, width = len(time_constants_s), inputs[0].shape[1]
    joined = replace(
        features, reference_c=np.tile(features.reference_c, count),
        lower_c=np.tile(features.lower_c, count), upper_c=np.tile(features.upper_c, count),
        knots_c=features.knots_c * count)  # fmt: skip
    everything = np.concatenate(inputs)
    outputs = 2 if len(gains) > width else 1
    by_output = gains[: outputs * width].reshape(outputs, width)
    rows = np.stack((everything.mean(axis=0), everything.std(axis=0), *by_output))
    if features.kind == 'powers':  # from relaxation, power, thermometer to power first
        shape = len(rows), count, features.degree, features.thermometers
        rows = rows.reshape(shape).swapaxes(1, 2).reshape(len(rows), width)
    mean, deviation = rows[:2]
    weight = 1.0 / np.where(deviation > 0, deviation, 1.0)
    flat = np.ascontiguousarray(rows[2:].T)
    # Singular vectors of W_x⁻¹ G, shapes (F, R), (R,) and (R, M), are static latents (eq. 15).
    inner, singular, outer = np.linalg.svd(flat / weight[:, np.newaxis], full_matrices=False)
    kept = singular > ROUNDING * singular[0]
    if not kept.any():
        return None
    dynamics = ArxPls(
        input_mean=mean, input_weight=weight, rotations=np.ascontiguousarray(inner[:, kept]),
        latents=(static_gain(),) * int(kept.sum()),
        output_loadings=np.ascontiguousarray((singular[kept, np.newaxis] * outer[kept]).T),
        output_weight=np.ones(outputs), output_mean=np.zeros(outputs))  # fmt: skip
    bank = tuple(relaxation(tau, period_s) for tau in time_constants_s.tolist())
    model = AxisModel(joined, dynamics, bank if time_constants_s.any() else ())
    if outputs == 1:
        return model.anchored([0.0])
    x = features.expand(features.reference_c)
    sensitivity = x @ by_output[1].reshape(count, -1).sum(axis=0) + gains[-1]
    return model.anchored([0.0, float(sensitivity)])
