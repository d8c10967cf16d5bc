"""
Sums over samples, all that least squares needs: made once, for every candidate and fold.

A candidate is a choice of columns, a held-out fold a difference of sums.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrist_ft_comp.identification.bins import BinnedData, Sums
from wrist_ft_comp.model.arx import free_run
from wrist_ft_comp.model.features import Features
from wrist_ft_comp.model.signals import BoolArray, FloatArray, IntArray

#: Share of a column's sum of squares below which what centring leaves is rounding.
_SILENT = 1e-12


@dataclass(frozen=True, eq=False)
class Moments:
    """
    Sums over the samples of every fold: B entries, of P columns and, last, r - w.

    What no temperature has to explain, a constant and in long recordings a slow trend, is the
    nuisance: a one and the time, which is zero in short recordings.

    Attributes
    ----------
    time_constants_s : ndarray, shape (K,)
        Grid of τ, s; the first is 0 (static).
    products : ndarray, shape (B, P + 1, P + 1)
        Sums of products of the columns.
    nuisance_products : ndarray, shape (B, 2, P + 1)
        Sums of products of one and time with the columns.
    nuisance_gram : ndarray, shape (B, 2, 2)
        Sums of products of one and time.
    recording : ndarray of int, shape (B,)
        Recording of each entry: entries of one share an unknown constant and trend.
    fold : ndarray of int, shape (B,)
        Cross-validation fold of each entry; a fold may have several entries.
    inputs : int
        F, number of features.
    loaded : bool
        Whether the columns are doubled by the load, and the load itself is a column.

    """

    time_constants_s: FloatArray
    products: FloatArray
    nuisance_products: FloatArray
    nuisance_gram: FloatArray
    recording: IntArray
    fold: IntArray
    inputs: int
    loaded: bool

    def without_trend(self) -> 'Moments':
        """Have temperature explain everything but a constant, also in long recordings."""
        products, gram = self.nuisance_products.copy(), self.nuisance_gram.copy()
        products[:, 1] = 0.0
        gram[:, 1] = gram[:, :, 1] = 0.0
        return replace(self, nuisance_products=products, nuisance_gram=gram)

    @property
    def everything(self) -> BoolArray:
        """Mask that keeps all entries, shape (B,)."""
        return np.ones(len(self.fold), dtype=bool)

    def columns(self, grid: Sequence[int], inputs: int) -> IntArray:
        """
        Find the columns of the first inputs through relaxations at some positions of the grid.

        Zero drift first, then sensitivity drift, then the load.
        """
        zero = [k * self.inputs + f for k in grid for f in range(inputs)]
        if not self.loaded:
            return np.array(zero)
        half = len(self.time_constants_s) * self.inputs
        return np.array([*zero, *(half + column for column in zero), 2 * half])

    def centred(self, keep: BoolArray) -> FloatArray:
        """Sum the products of kept entries without each recording's nuisance, (P + 1, P + 1)."""
        total: FloatArray = self.products[keep].sum(axis=0)
        for recording in np.unique(self.recording[keep]):
            inside = keep & (self.recording == recording)
            crossed = self.nuisance_products[inside].sum(axis=0)
            total = total - crossed.T @ self._inverse_gram(inside) @ crossed
        # A column that is constant within each recording holds nothing; rounding must not pretend.
        silent = np.diagonal(total) <= _SILENT * np.diagonal(self.products[keep].sum(axis=0))
        total[silent] = 0.0
        total[:, silent] = 0.0
        return total

    def _inverse_gram(self, inside: BoolArray) -> FloatArray:
        """Invert the summed products of one and time, shape (2, 2); no time gives no trend."""
        inverse: FloatArray = np.linalg.pinv(
            self.nuisance_gram[inside].sum(axis=0), hermitian=True
        )
        return inverse

    def fit_nuisance(self, inside: BoolArray, thetas: FloatArray) -> FloatArray:
        """Fit constant and slope over time, (2, S), to combinations of columns, (S, P + 1)."""
        crossed = self.nuisance_products[inside].sum(axis=0)
        level: FloatArray = self._inverse_gram(inside) @ (crossed @ thetas.T)
        return level


def bank_inputs(
    data: BinnedData, features: Features, time_constants_s: FloatArray
) -> list[FloatArray]:
    """
    Compute the features of the temperatures behind every relaxation of a grid (eq. 11).

    Of each recording, shape (n_i, K·F): by relaxation, then feature.
    """
    bank = [data.relaxation(float(tau)) for tau in time_constants_s]
    # A relaxation stays within the range of its input, from which the features were built.
    return [
        np.concatenate([features.expand_within(free_run(h, temperature_c)) for h in bank], axis=1)
        for temperature_c in data.temperature_c
    ]


def accumulate(
    data: BinnedData, banked: Sequence[FloatArray], time_constants_s: FloatArray
) -> Moments:
    """Sum products of all columns, from ``bank_inputs``, over every fold of every recording."""
    entries = []
    for i, (x, sums) in enumerate(zip(banked, data.sums, strict=True)):
        for fold in np.unique(data.folds[i]):
            rows = np.flatnonzero((data.folds[i] == fold) & (sums.count > 0))
            if len(rows):
                products = _sum_rows(x[rows], sums, rows, loaded=data.loaded)
                entries.append((*products, i, int(fold)))
    products, nuisance_products, nuisance_gram, recording, folds = zip(*entries, strict=True)
    return Moments(
        time_constants_s=time_constants_s,
        products=np.stack(products),
        nuisance_products=np.stack(nuisance_products),
        nuisance_gram=np.stack(nuisance_gram),
        recording=np.array(recording),
        fold=np.array(folds),
        inputs=banked[0].shape[1] // len(time_constants_s),
        loaded=data.loaded,
    )


def _sum_rows(
    x: FloatArray, sums: Sums, rows: IntArray, *, loaded: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """
    Sum products, nuisance products and nuisance gram of some bins, x of shape (n, C).

        [ x_f(H_τ T) … | w x_f(H_τ T) … | w | y ]     with load, y = r - w
        [ x_f(H_τ T) … | y ]                          without
    """
    time, count = sums.time[rows], sums.count[rows]
    w, ww, y = sums.load[rows], sums.load_square[rows], sums.residual[rows]
    yy, wy = sums.residual_square[rows], sums.product[rows]
    t = np.stack((np.ones(len(rows)), time))
    gram = np.array([[count.sum(), count @ time], [count @ time, count @ time**2]])
    # Cells with one sample each need no weights, and a symmetric product is twice as quick.
    weighted = x if (count == 1).all() else x * count[:, np.newaxis]
    plain, crossed = weighted.T @ x, y @ x
    if not loaded:
        total = np.block([[plain, crossed[:, np.newaxis]], [crossed, yy.sum()]])
        return total, np.column_stack(((t * count) @ x, t @ y)), gram
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
    return total, np.column_stack(((t * count) @ x, (t * w) @ x, t @ w, t @ y)), gram
