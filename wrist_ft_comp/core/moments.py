"""
Sums over samples, all that least squares needs: made once, for every candidate and fold.

A candidate is a choice of columns, a held-out block a difference of sums.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrist_ft_comp.core.arx import free_run
from wrist_ft_comp.core.binned import BinnedProblem, Sums
from wrist_ft_comp.core.features import Features
from wrist_ft_comp.core.recording import BoolArray, FloatArray, IntArray

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
    sums : ndarray, shape (B, P + 1)
        Sum of each.
    counts : ndarray, shape (B,)
        Number of samples.
    group : ndarray of int, shape (B,)
        Recording of each entry: entries of a group share an unknown constant.
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
    sums: FloatArray
    counts: FloatArray
    group: IntArray
    block: IntArray
    inputs: int
    loaded: bool
    tared: bool = True

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
        Sum the kept entries after removing each group's constant.

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
            sums = self.sums[inside].sum(axis=0)
            total = total - np.outer(sums, sums) / self.counts[inside].sum()
        # A column that is constant within every group holds nothing; rounding must not pretend so.
        silent = np.diagonal(total) <= _SILENT * np.diagonal(self.products[keep].sum(axis=0))
        total[silent] = 0.0
        total[:, silent] = 0.0
        return total, float(self.counts[keep].sum())

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
            Mean squares around the constant of each recording, in the order of the entries.

        """
        sums = thetas @ self.sums.T  # (S, B)
        # (S, B') = diagonal of θ (P + 1) · products (B', P + 1, P + 1) · θ
        halves = np.tensordot(thetas, self.products[held], axes=(1, 1))  # (S, B', P + 1)
        squares = np.einsum('sp,sbp->sb', thetas, halves)
        constants = np.zeros_like(squares)
        for group in np.unique(self.group[held]):
            own = self.group == group
            basis = own & (held if self.tared else ~held)
            mean = sums[:, basis].sum(axis=1) / self.counts[basis].sum()
            constants[:, own[held]] = mean[:, np.newaxis]
        counts = self.counts[held]
        left = squares - 2 * constants * sums[:, held] + counts * constants**2
        errors: FloatArray = np.maximum(left, 0.0) / counts
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
    products, sums, counts, group, block = [], [], [], [], []
    for i, (columns, of) in enumerate(zip(banked, problem.sums, strict=True)):
        for number in np.unique(problem.blocks[i]):
            rows = np.flatnonzero((problem.blocks[i] == number) & (of.count > 0))
            for part in np.array_split(rows, min(parts, len(rows))) if len(rows) else ():
                total, summed = _sum_bins(columns[part], of, part, loaded=problem.loaded)
                products.append(total)
                sums.append(summed)
                counts.append(float(of.count[part].sum()))
                group.append(i)
                block.append(int(number))
    return Moments(
        time_constants_s=time_constants_s,
        products=np.stack(products),
        sums=np.stack(sums),
        counts=np.array(counts),
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
    tuple of ndarrays, shapes (P + 1, P + 1) and (P + 1,)
        Sums of products, and of columns.

    """
    count, w, ww = of.count[rows], of.load[rows], of.load_square[rows]
    y, yy, wy = of.residual[rows], of.residual_square[rows], of.product[rows]
    # Cells with one sample each need no weights, and a symmetric product is twice as quick.
    weighted = x if (count == 1).all() else x * count[:, np.newaxis]
    plain, crossed = weighted.T @ x, y @ x
    if not loaded:
        total = np.block([[plain, crossed[:, np.newaxis]], [crossed, yy.sum()]])
        return total, np.append(count @ x, y.sum())
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
    return total, np.concatenate((count @ x, w @ x, [w.sum(), y.sum()]))
