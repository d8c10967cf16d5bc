"""Sums over samples, all that least squares needs: made once, for every candidate and fold."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrist_ft_comp.drift.arx import free_run
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.bins import BinnedData, Sums
from wrist_ft_comp.signals import BoolArray, FloatArray, IntArray

#: Share of a column's sum of squares below which what centring leaves is rounding.
_SILENT = 1e-12


@dataclass(frozen=True, eq=False)
class Moments:
    """Sums over the samples of every fold: B entries, of P columns and, last, r - w."""

    # What no temperature has to explain are N nuisances with a prior, the first of them a one.

    #: Grid of τ, s, shape (K,); the first is 0 (static).
    time_constants_s: FloatArray
    #: Sums of products of the columns, shape (B, P + 1, P + 1).
    products: FloatArray
    #: … of the nuisances with the columns, (B, N, P + 1), and with themselves, (B, N, N).
    nuisance_products: FloatArray
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

    def columns(
        self, grid: Sequence[int], inputs: int, gain_inputs: int | None = None
    ) -> IntArray:
        """Find the columns of the first inputs on the grid: zero, sensitivity drift, the load."""
        zero = [k * self.inputs + f for k in grid for f in range(inputs)]
        if not self.loaded:
            return np.array(zero)
        half = len(self.time_constants_s) * self.inputs
        gained = inputs if gain_inputs is None else gain_inputs
        gain = [half + k * self.inputs + f for k in grid for f in range(gained)]
        return np.array([*zero, *gain, 2 * half])

    def centred(self, keep: BoolArray | None = None) -> FloatArray:
        """Sum products of entries, all or a mask's, less each recording's nuisances, (P + 1)²."""
        keep = np.ones(len(self.fold), dtype=bool) if keep is None else keep
        total: FloatArray = self.products[keep].sum(axis=0)
        for recording in np.unique(self.recording[keep]):
            inside = keep & (self.recording == recording)
            crossed = self.nuisance_products[inside].sum(axis=0)
            total = total - crossed.T @ np.linalg.solve(self._penalised(inside), crossed)
        # A column that is constant within each recording holds nothing; rounding must not pretend.
        silent = np.diagonal(total) <= _SILENT * np.diagonal(self.products[keep].sum(axis=0))
        total[silent] = 0.0
        total[:, silent] = 0.0
        return total

    def _penalised(self, inside: BoolArray) -> FloatArray:
        """Sum the products of a recording's nuisances, and add their prior, (N, N)."""
        gram: FloatArray = self.nuisance_gram[inside].sum(axis=0)
        return np.asarray(gram + np.diag(gram[0, 0] * self.precision))

    def fit_nuisances(self, inside: BoolArray, thetas: FloatArray) -> FloatArray:
        """Fit a recording's nuisances, (N, S), to combinations of columns, (S, P + 1)."""
        crossed = self.nuisance_products[inside].sum(axis=0)
        return np.asarray(np.linalg.solve(self._penalised(inside), crossed @ thetas.T))


def bank_inputs(
    data: BinnedData, features: Features, time_constants_s: FloatArray
) -> list[FloatArray]:
    """Compute the features behind every relaxation of a grid (eq. 11), by these, (n_i, K·F)."""
    bank = [data.relaxation(float(tau)) for tau in time_constants_s]
    # A relaxation stays within the range of its input, from which the features were built.
    banked: list[FloatArray] = []
    for temperature_c in data.temperature_c:
        columns = features.expand_within(temperature_c).shape[1]
        x = np.empty((len(temperature_c), len(bank), columns))  # without a copy: it is large
        for k, h in enumerate(bank):
            x[:, k] = features.expand_within(free_run(h, temperature_c))
        banked.append(x.reshape(len(x), -1))
    return banked


def accumulate(
    data: BinnedData, banked: Sequence[FloatArray], time_constants_s: FloatArray
) -> Moments:
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
    inputs = banked[0].shape[1] // len(time_constants_s)
    known = products, explained, gram, data.nuisance_precision(), recording, fold
    return Moments(time_constants_s, *known, inputs, data.loaded)


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
    # Cells with one sample each need no weights, and a symmetric product is twice as quick.
    weighted = x if (count == 1).all() else x * count[:, np.newaxis]
    plain, crossed = weighted.T @ x, y @ x
    if not loaded:
        total = np.block([[plain, crossed[:, np.newaxis]], [crossed, yy.sum()]])
        return total, np.column_stack((counted @ x, phi.T @ y)), gram
    mixed, doubled = (x * w[:, np.newaxis]).T @ x, (x * ww[:, np.newaxis]).T @ x
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
