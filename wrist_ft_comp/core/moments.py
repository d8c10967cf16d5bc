"""
Sums over samples, all that least squares needs: made once, for every candidate and fold.

A candidate is a choice of columns, a held-out block a difference of sums.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrist_ft_comp.core.arx import free_run, relaxation
from wrist_ft_comp.core.features import Features
from wrist_ft_comp.core.problem import AxisProblem
from wrist_ft_comp.core.recording import BoolArray, FloatArray, IntArray
from wrist_ft_comp.core.scoring import bin_means

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
        Cross-validation block of each entry.
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

    def mean_square(self, inside: BoolArray, theta: FloatArray) -> float:
        """
        Score a combination of columns on held-out entries.

        Parameters
        ----------
        inside : ndarray of bool, shape (B,)
            The held-out entries.
        theta : ndarray, shape (P + 1,)
            What the combination leaves of r - w, as coefficients of all columns.

        Returns
        -------
        float
            Mean square around the constant of each recording.

        """
        total = 0.0
        for group in np.unique(self.group[inside]):
            held = inside & (self.group == group)
            others = held if self.tared else ~inside & (self.group == group)
            count = self.counts[held].sum()
            constant = float(theta @ self.sums[others].sum(axis=0)) / self.counts[others].sum()
            square = float(theta @ self.products[held].sum(axis=0) @ theta)
            linear = float(theta @ self.sums[held].sum(axis=0))
            total += max(square - 2 * constant * linear + count * constant**2, 0.0)
        return total / float(self.counts[inside].sum())


def bank_inputs(
    problem: AxisProblem, features: Features, time_constants_s: FloatArray
) -> list[FloatArray]:
    """
    Pass every feature through every relaxation of the grid.

    Parameters
    ----------
    problem : AxisProblem
        For temperatures and period.
    features : Features
        The inputs.
    time_constants_s : ndarray, shape (K,)
        τ, s.

    Returns
    -------
    list of ndarrays, shape (N_i, K·F)
        By relaxation, then feature.

    """
    bank = [relaxation(float(tau), problem.period_s) for tau in time_constants_s]
    inputs = [features.expand(temperature_c) for temperature_c in problem.temperature_c]
    return [np.concatenate([free_run(h, x) for h in bank], axis=1) for x in inputs]


def accumulate(
    problem: AxisProblem,
    banked: Sequence[FloatArray],
    time_constants_s: FloatArray,
    bin_cells: int = 1,
) -> Moments:
    """
    Sum products of all columns over every block of every recording.

    Parameters
    ----------
    problem : AxisProblem
        The axis.
    banked : sequence of ndarrays, shape (N_i, K·F)
        From bank_inputs.
    time_constants_s : ndarray, shape (K,)
        What they were made with.
    bin_cells : int
        Average so many cells into one sample first: what is judged is drift, not noise.

    Returns
    -------
    Moments
        For all candidates.

    """
    products, sums, counts, group, block = [], [], [], [], []
    for i, (columns, residual) in enumerate(zip(banked, problem.residual, strict=True)):
        for number in np.unique(problem.blocks[i]):
            rows = np.flatnonzero((problem.blocks[i] == number) & np.isfinite(residual))
            if not len(rows):
                continue
            a = design(columns[rows], None if problem.load is None else problem.load[i][rows])
            a = bin_means(np.concatenate((a, residual[rows, np.newaxis]), axis=1), rows, bin_cells)
            products.append(a.T @ a)
            sums.append(a.sum(axis=0))
            counts.append(float(len(a)))
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
        loaded=problem.load is not None,
        tared=problem.tared,
    )


def design(columns: FloatArray, load: FloatArray | None) -> FloatArray:
    """
    Draw the regressors of the equation in simulation_error, without the constant.

        [ H_τ(x_f) … | w H_τ(x_f) … | w ]     with load
        [ H_τ(x_f) … ]                        without

    Parameters
    ----------
    columns : ndarray, shape (n, C)
        Filtered features.
    load : ndarray, shape (n,), or None
        w, N or N m.

    Returns
    -------
    ndarray, shape (n, C) or (n, 2 C + 1)
        One row per sample.

    """
    if load is None:
        return columns
    w = load[:, np.newaxis]
    return np.concatenate((columns, w * columns, w), axis=1)
