"""
Sums over samples, all that least squares needs: made once, for every candidate and fold.

A candidate is a choice of columns, a held-out block a difference of sums.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrist_ft_comp.identification.bins import BinnedProblem, Sums
from wrist_ft_comp.model.arx import free_run
from wrist_ft_comp.model.features import Features
from wrist_ft_comp.model.signals import BoolArray, FloatArray, IntArray

#: Share of a column's sum of squares below which what centring leaves is rounding.
_SILENT = 1e-12


@dataclass(frozen=True, eq=False)
class Moments:
    """
    Sums over the samples of every block, all that least squares needs.

    Attributes
    ----------
    time_constants_s : ndarray, shape (K,)
        Grid of τ, s; the first is 0 (static).
    products : ndarray, shape (B, P + 1, P + 1)
        Sum of products of the columns and, last, of r - w.
    beside : ndarray, shape (B, 2, P + 1)
        Sum of each, and of its products with time: what no temperature has to explain is a
        constant and, in long recordings, a slow trend.
    time : ndarray, shape (B, 2, 2)
        Sum of products of a one and the time; zero time in short recordings.
    group : ndarray of int, shape (B,)
        Recording of each entry: entries of a group share an unknown constant and trend.
    block : ndarray of int, shape (B,)
        Cross-validation block of each entry; a block may have several entries.
    inputs : int
        F, number of features.
    loaded : bool
        Whether the columns are doubled by the load, and the load itself is a column.
    tared : bool
        As AxisProblem.tared.

    """

    time_constants_s: FloatArray
    products: FloatArray
    beside: FloatArray
    time: FloatArray
    group: IntArray
    block: IntArray
    inputs: int
    loaded: bool
    tared: bool = True

    @property
    def sums(self) -> FloatArray:
        """Sum of each column, shape (B, P + 1)."""
        return self.beside[:, 0]

    @property
    def counts(self) -> FloatArray:
        """Number of samples, shape (B,)."""
        return self.time[:, 0, 0]

    def without_trend(self) -> 'Moments':
        """Have temperature explain everything but a constant, also in long recordings."""
        beside, time = self.beside.copy(), self.time.copy()
        beside[:, 1] = 0.0
        time[:, 1] = time[:, :, 1] = 0.0
        return replace(self, beside=beside, time=time)

    def columns(self, grid: Sequence[int], inputs: int) -> IntArray:
        """
        Find the columns of the first inputs through the given relaxations.

        Parameters
        ----------
        grid : sequence of int
            Positions in time_constants_s.
        inputs : int
            How many features take part.

        Returns
        -------
        ndarray of int
            Zero drift first, then sensitivity drift, then the load.

        """
        zero = [k * self.inputs + f for k in grid for f in range(inputs)]
        if not self.loaded:
            return np.array(zero)
        half = len(self.time_constants_s) * self.inputs
        return np.array([*zero, *(half + column for column in zero), 2 * half])

    def centred(self, keep: BoolArray) -> tuple[FloatArray, float]:
        """
        Sum the kept entries after removing each group's constant and trend.

        Parameters
        ----------
        keep : ndarray of bool, shape (B,)
            Entries that take part.

        Returns
        -------
        tuple of ndarray, shape (P + 1, P + 1), and float
            Centred products, and the number of samples.

        """
        total = self.products[keep].sum(axis=0)
        for group in np.unique(self.group[keep]):
            inside = keep & (self.group == group)
            beside = self.beside[inside].sum(axis=0)
            total = total - beside.T @ self._inverse_time(inside) @ beside
        # A column that is constant within every group holds nothing; rounding must not pretend so.
        silent = np.diagonal(total) <= _SILENT * np.diagonal(self.products[keep].sum(axis=0))
        total[silent] = 0.0
        total[:, silent] = 0.0
        return total, float(self.counts[keep].sum())

    def _inverse_time(self, inside: BoolArray) -> FloatArray:
        """Invert the summed products of one and time, shape (2, 2); no time gives no trend."""
        inverse: FloatArray = np.linalg.pinv(self.time[inside].sum(axis=0), hermitian=True)
        return inverse

    def what_time_explains(self, inside: BoolArray, thetas: FloatArray) -> FloatArray:
        """
        Fit constant and trend to combinations of columns.

        Parameters
        ----------
        inside : ndarray of bool, shape (B,)
            Entries of one group.
        thetas : ndarray, shape (S, P + 1)
            Combinations.

        Returns
        -------
        ndarray, shape (2, S)
            Constant, and slope over time.

        """
        beside = self.beside[inside].sum(axis=0)
        explained: FloatArray = self._inverse_time(inside) @ (beside @ thetas.T)
        return explained

    def mean_squares(self, held: BoolArray, thetas: FloatArray) -> FloatArray:
        """
        Score combinations of columns on held-out entries.

        Parameters
        ----------
        held : ndarray of bool, shape (B,)
            The held-out entries.
        thetas : ndarray, shape (S, P + 1)
            What each combination leaves of r - w, as coefficients of all columns.

        Returns
        -------
        ndarray, shape (S, held-out entries)
            Mean squares around constant and trend of each recording, in the order of the
            entries.

        """
        # (S, B') = diagonal of θ (P + 1) · products (B', P + 1, P + 1) · θ
        halves = np.tensordot(thetas, self.products[held], axes=(1, 1))  # (S, B', P + 1)
        squares = np.einsum('sp,sbp->sb', thetas, halves)
        left = np.zeros_like(squares)
        for group in np.unique(self.group[held]):
            own = held & (self.group == group)
            basis = own if self.tared else ~held & (self.group == group)
            level = self.what_time_explains(basis, thetas)  # (2, S)
            crossed = np.einsum('qs,bqp,sp->sb', level, self.beside[own], thetas)
            levels = np.einsum('qs,bqr,rs->sb', level, self.time[own], level)
            left[:, own[held]] = squares[:, own[held]] - 2 * crossed + levels
        errors: FloatArray = np.maximum(left, 0.0) / self.counts[held]
        return errors


def bank_inputs(
    problem: BinnedProblem, features: Features, time_constants_s: FloatArray
) -> list[FloatArray]:
    """
    Compute the features of the temperatures behind every relaxation of a grid (eq. 11).

    Parameters
    ----------
    problem : BinnedProblem
        For temperatures and period.
    features : Features
        Of one relaxation's temperatures.
    time_constants_s : ndarray, shape (K,)
        τ, s.

    Returns
    -------
    list of ndarrays, shape (n_i, K·F)
        By relaxation, then feature.

    """
    bank = [problem.relaxation(float(tau)) for tau in time_constants_s]
    # A relaxation stays within the range of its input, from which the features were built.
    return [
        np.concatenate([features.expand_within(free_run(h, temperature_c)) for h in bank], axis=1)
        for temperature_c in problem.temperature_c
    ]


def accumulate(
    problem: BinnedProblem,
    banked: Sequence[FloatArray],
    time_constants_s: FloatArray,
    parts: int = 1,
) -> Moments:
    """
    Sum products of all columns over every block of every recording.

    Parameters
    ----------
    problem : BinnedProblem
        The axis.
    banked : sequence of ndarrays, shape (n_i, K·F)
        From bank_inputs.
    time_constants_s : ndarray, shape (K,)
        What they were made with.
    parts : int
        Entries that each block is divided into, of about the same number of bins.

    Returns
    -------
    Moments
        For all candidates.

    """
    products, beside, time, group, block = [], [], [], [], []
    for i, (columns, of) in enumerate(zip(banked, problem.sums, strict=True)):
        for number in np.unique(problem.blocks[i]):
            rows = np.flatnonzero((problem.blocks[i] == number) & (of.count > 0))
            for part in np.array_split(rows, min(parts, len(rows))) if len(rows) else ():
                total, crossed = _sum_bins(columns[part], of, part, loaded=problem.loaded)
                count, t = of.count[part], of.time[part]
                products.append(total)
                beside.append(crossed)
                time.append([[count.sum(), count @ t], [count @ t, count @ t**2]])
                group.append(i)
                block.append(int(number))
    return Moments(
        time_constants_s=time_constants_s,
        products=np.stack(products),
        beside=np.stack(beside),
        time=np.array(time),
        group=np.array(group),
        block=np.array(block),
        inputs=banked[0].shape[1] // len(time_constants_s),
        loaded=problem.loaded,
        tared=problem.tared,
    )


def _sum_bins(
    x: FloatArray, of: Sums, rows: IntArray, *, loaded: bool
) -> tuple[FloatArray, FloatArray]:
    """
    Sum over some bins the products of the columns of the equation in simulation_error, and them.

        [ x_f(H_τ T) … | w x_f(H_τ T) … | w | y ]     with load, y = r - w
        [ x_f(H_τ T) … | y ]                          without

    Parameters
    ----------
    x : ndarray, shape (n, C)
        Features of the bins.
    of : Sums
        Of all bins of the recording.
    rows : ndarray of int, shape (n,)
        Which bins these are.
    loaded : bool
        Whether there is a load.

    Returns
    -------
    tuple of ndarrays, shapes (P + 1, P + 1) and (2, P + 1)
        Sums of products, of columns, and of columns times time.

    """
    t = np.stack((np.ones(len(rows)), of.time[rows]))
    count, w, ww = of.count[rows], of.load[rows], of.load_square[rows]
    y, yy, wy = of.residual[rows], of.residual_square[rows], of.product[rows]
    # Cells with one sample each need no weights, and a symmetric product is twice as quick.
    weighted = x if (count == 1).all() else x * count[:, np.newaxis]
    plain, crossed = weighted.T @ x, y @ x
    if not loaded:
        total = np.block([[plain, crossed[:, np.newaxis]], [crossed, yy.sum()]])
        return total, np.column_stack(((t * count) @ x, t @ y))
    mixed, doubled = (x * w[:, np.newaxis]).T @ x, (x * ww[:, np.newaxis]).T @ x
    beside_w = np.concatenate((w @ x, ww @ x))[:, np.newaxis]
    beside_y = np.concatenate((crossed, wy @ x))[:, np.newaxis]
    total = np.block(
        [
            [np.block([[plain, mixed], [mixed, doubled]]), beside_w, beside_y],
            [beside_w.T, ww.sum(), wy.sum()],
            [beside_y.T, wy.sum(), yy.sum()],
        ]
    )
    return total, np.column_stack(((t * count) @ x, (t * w) @ x, t @ w, t @ y))
