"""
Sums over samples, all that least squares needs: made once, for every candidate and every fold.

Samples are summed over bins of cells first, within which features hardly change and loads do;
then products of columns are summed over the bins of every fold.

    r - w = Σ_τ Σ_f g_τf x_f(H_τ T)  +  w · Σ_τ Σ_f k_τf x_f(H_τ T)  +  s_0 w  +  nuisances
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrist_ft_comp.drift.arx_filter import Arx, free_run, mean_relaxation, relaxation
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.axis_data import AxisData
from wrist_ft_comp.signals import BoolArray, FloatArray, IntArray

#: Cosines that span a random walk over a recording.
_COSINES = 16
#: What a body forgets that did not start at rest, s.
_TRANSIENTS_S = (300.0, 1000.0, 3000.0)
#: Prior variance of a transient over that of the mean of all noise.
TRANSIENT_VARIANCE = 30.0
#: Prior precision of a transient where every start was soaked: there is none.
_SOAKED_PRECISION = 1e12
#: Prior precision of the constants after a tare, which may be anything.
_FREE_PRECISION = 1e-9
#: Share of a column's sum of squares below which what centring leaves is rounding.
_SILENT = 1e-12


@dataclass(frozen=True, eq=False)
class Sums:
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

    #: Length of a bin, s, and how many cells it has; with one cell, relaxations are those of the
    #: running model.
    period_s: float
    cells: int
    #: Means of each bin, °C, shape (n_i, J).
    temperature_c: tuple[FloatArray, ...]
    sums: tuple[Sums, ...]
    folds: tuple[IntArray, ...]
    steps: tuple[tuple[int, ...], ...]
    loaded: bool
    tared: bool

    def nuisances(self, recording: int) -> FloatArray:
        """
        Draw what no temperature has to explain in a recording, shape (n, N).

        A constant; where a fold has one of its own, also a random walk in cosines, so that slow
        errors are not taken for many independent witnesses, the transients of a start that was
        not soaked, and one more constant from every step on.
        """
        bins = len(self.sums[recording].count)
        middle = (np.arange(bins) + 0.5)[:, np.newaxis]
        if not self.tared:
            return np.ones((bins, 1))
        walk = np.cos(np.pi * middle / bins * np.arange(_COSINES + 1))
        steps = np.full(self._most_steps, bins * self.cells)
        steps[: len(self.steps[recording])] = self.steps[recording]
        after = middle * self.cells > steps
        return np.concatenate(
            (walk, start_transients(middle[:, 0] * self.period_s), after), axis=1
        )

    @property
    def _most_steps(self) -> int:
        """Number of steps of the recording that has most."""
        return max(len(steps) for steps in self.steps)

    def nuisance_precision(self, *, soaked: bool = False) -> FloatArray:
        """Prior precision of each nuisance, over that of all cells of its recording, (N,)."""
        if not self.tared:
            return np.zeros(1)
        start = _SOAKED_PRECISION if soaked else 1.0 / TRANSIENT_VARIANCE
        walk = np.arange(_COSINES + 1) ** 2.0
        steps = np.full(self._most_steps, _FREE_PRECISION)
        return np.concatenate((walk, np.full(len(_TRANSIENTS_S), start), steps))

    def relaxation(self, time_constant_s: float) -> Arx:
        """First-order lag of the bins' temperatures: what runs, averaged over each bin."""
        if self.cells == 1:
            return relaxation(time_constant_s, self.period_s)
        return mean_relaxation(time_constant_s, self.period_s / self.cells, self.cells)


def bin_axis_data(data: AxisData, cells: int) -> BinnedData:
    """Sum an axis over bins of some cells."""
    sums = []
    for i, residual in enumerate(data.residual):
        w = np.zeros_like(residual) if data.load is None else data.load[i]
        present = np.isfinite(residual) & np.isfinite(w)
        y, w = np.where(present, residual, 0.0), np.where(present, w, 0.0)
        rows = [present.astype(float), w, w * w, y, y * y, w * y]
        sums.append(Sums(*(_sum_bins(row, cells) for row in rows)))
    return BinnedData(
        period_s=cells * data.period_s, cells=cells,
        temperature_c=tuple(_mean_bins(values, cells) for values in data.temperature_c),
        sums=tuple(sums), folds=tuple(folds[::cells] for folds in data.folds),
        steps=data.steps, loaded=data.load is not None, tared=data.tared)  # fmt: skip


def start_transients(time_s: NDArray[np.floating[Any]]) -> FloatArray:
    """Draw what a body that did not start at rest forgets, (n, 3), from times since then, (n,)."""
    return np.asarray(np.exp(-time_s[:, np.newaxis] / np.array(_TRANSIENTS_S)))


def _sum_bins(values: FloatArray, cells: int) -> FloatArray:
    """Sum over bins, shapes (N, …) to (n, …)."""
    if cells == 1:
        return values
    return np.asarray(np.add.reduceat(values, np.arange(0, len(values), cells), axis=0))


def _mean_bins(values: FloatArray, cells: int) -> FloatArray:
    """Average over bins, shapes (N, J) to (n, J)."""
    counts = np.diff(np.arange(0, len(values), cells), append=len(values))
    return np.asarray(_sum_bins(values, cells) / counts[:, np.newaxis])


@dataclass(frozen=True, eq=False)
class Moments:
    """
    Sums over the samples of every fold: B entries, of P columns and, last, r - w.

    What no temperature has to explain are N nuisances with a prior, the first of them a one.
    """

    #: Number of relaxations K of the bank, the first of them static.
    relaxations: int
    #: Sums of products of the columns, shape (B, P + 1, P + 1).
    products: FloatArray
    #: Sums of products of the nuisances with the columns, (B, N, P + 1).
    nuisance_products: FloatArray
    #: Sums of products of the nuisances with themselves, (B, N, N).
    nuisance_gram: FloatArray
    #: Prior precision of the nuisances, over that of all cells of a recording, shape (N,).
    precision: FloatArray
    #: Recording and fold of each entry, shape (B,): entries of one recording share their
    #: nuisances, and a fold may have several entries.
    recording: IntArray
    fold: IntArray
    #: F, number of features.
    inputs: int
    #: Whether the columns are doubled by the load, and the load itself is a column.
    loaded: bool

    def columns(self, bank: Sequence[int], inputs: int, gain_inputs: int) -> IntArray:
        """
        Find the columns of the first inputs behind some relaxations of the bank.

        First those that explain zero drift; with load also the first ``gain_inputs`` behind each,
        which explain sensitivity drift, and the load.
        """
        zero = [k * self.inputs + f for k in bank for f in range(inputs)]
        if not self.loaded:
            return np.array(zero)
        half = self.relaxations * self.inputs
        gain = [half + k * self.inputs + f for k in bank for f in range(gain_inputs)]
        return np.array([*zero, *gain, 2 * half])

    def centred(self, keep: BoolArray | None = None) -> FloatArray:
        """Sum products of entries, all or a mask's, less each recording's nuisances, (P + 1)²."""
        keep = np.ones(len(self.fold), dtype=bool) if keep is None else keep
        whole = total = np.asarray(self.products[keep].sum(axis=0))
        for recording in np.unique(self.recording[keep]):
            inside = keep & (self.recording == recording)
            crossed = self.nuisance_products[inside].sum(axis=0)
            gram = self.nuisance_gram[inside].sum(axis=0)
            penalised = gram + np.diag(gram[0, 0] * self.precision)
            total = total - crossed.T @ np.linalg.solve(penalised, crossed)
        # A column that is constant within each recording holds nothing; rounding must not pretend.
        silent = np.diagonal(total) <= _SILENT * np.diagonal(whole)
        total[silent] = 0.0
        total[:, silent] = 0.0
        return total


def bank_inputs(
    data: BinnedData, features: Features, time_constants_s: FloatArray
) -> list[FloatArray]:
    """
    Compute the features behind every relaxation of a bank (eq. 11), shapes (n_i, K·F).

    Columns are sorted by relaxation, then by feature. Temperatures need no clamping: a relaxation
    stays within the range of its input, from which the features were built.
    """
    bank = [data.relaxation(float(tau)) for tau in time_constants_s]
    banked: list[FloatArray] = []
    for temperature_c in data.temperature_c:
        columns = features.expand_within(temperature_c).shape[1]
        x = np.empty((len(temperature_c), len(bank), columns))  # without a copy: it is large
        for k, h in enumerate(bank):
            x[:, k] = features.expand_within(free_run(h, temperature_c))
        banked.append(x.reshape(len(x), -1))
    return banked


def accumulate(data: BinnedData, banked: Sequence[FloatArray], relaxations: int) -> Moments:
    """Sum products of all columns, from ``bank_inputs``, over every fold of every recording."""
    entries = []
    for i, (x, sums) in enumerate(zip(banked, data.sums, strict=True)):
        nuisances = data.nuisances(i)
        for fold in np.unique(data.folds[i]):
            rows = np.flatnonzero((data.folds[i] == fold) & (sums.count > 0))
            if len(rows):
                summed = _sum_rows(x[rows], sums, rows, nuisances[rows], loaded=data.loaded)
                entries.append((*summed, i, int(fold)))
    products, explained, gram, recording, fold = map(np.array, zip(*entries, strict=True))
    return Moments(
        relaxations, products, explained, gram, data.nuisance_precision(), recording, fold,
        inputs=banked[0].shape[1] // relaxations, loaded=data.loaded)  # fmt: skip


def _square(x: FloatArray, weights: FloatArray) -> FloatArray:
    """Sum weighted products xᵀ diag(weights) x: a matrix with itself takes half the time."""
    weighted = x * np.sqrt(weights)[:, np.newaxis]
    return np.asarray(weighted.T @ weighted)


def _sum_rows(
    x: FloatArray, sums: Sums, rows: IntArray, phi: FloatArray, *, loaded: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Sum products, nuisance products and nuisance gram of some bins, x (n, C) and phi (n, N)."""
    #   [ x_f(H_τ T) … | w x_f(H_τ T) … | w | y ]     with load, y = r - w
    #   [ x_f(H_τ T) … | y ]                          without
    count, w, ww = sums.count[rows], sums.load[rows], sums.load_square[rows]
    y, yy, wy = sums.residual[rows], sums.residual_square[rows], sums.product[rows]
    counted = phi.T * count
    gram = counted @ phi
    plain, crossed = _square(x, count), y @ x
    if not loaded:
        total = np.block([[plain, crossed[:, np.newaxis]], [crossed, yy.sum()]])
        return total, np.column_stack((counted @ x, phi.T @ y)), gram
    mixed, doubled = (x * w[:, np.newaxis]).T @ x, _square(x, ww)
    with_w = np.concatenate((w @ x, ww @ x))[:, np.newaxis]
    with_y = np.concatenate((crossed, wy @ x))[:, np.newaxis]
    total = np.block(
        [
            [np.block([[plain, mixed], [mixed, doubled]]), with_w, with_y],
            [with_w.T, ww.sum(), wy.sum()],
            [with_y.T, wy.sum(), yy.sum()],
        ]
    )
    nuisance_products = (counted @ x, (phi.T * w) @ x, phi.T @ w, phi.T @ y)
    return total, np.column_stack(nuisance_products), gram
