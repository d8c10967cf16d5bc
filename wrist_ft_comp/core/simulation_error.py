"""
Fits on the simulation error (eq. 16): relaxations with free or fixed time constants.

Thermal diffusion has no other dynamics than relaxations H_τ, so the drift is

    r - w = Σ_τ Σ_f g_τf H_τ(x_f)  +  w · Σ_τ Σ_f k_τf H_τ(x_f)  +  s_0 w  +  constant

and for given time constants everything else is linear (variable projection). All candidates are
fitted from one matrix of moments whose columns hold every input through every relaxation of a grid
of time constants: a candidate is a choice of columns, a held-out block a difference of moments.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.optimize import minimize

from wrist_ft_comp.core.arx import free_run, relaxation
from wrist_ft_comp.core.features import Features
from wrist_ft_comp.core.problem import AxisProblem
from wrist_ft_comp.core.recording import BoolArray, FloatArray, IntArray

#: Ridge that only keeps equations of collinear columns solvable, relative to their variance.
TINY_RIDGE = 1e-9
#: Share of a column's sum of squares below which what centring leaves is rounding.
_SILENT = 1e-12
#: Ridge strengths tried for a bank of relaxations, relative to the variance of the columns.
RIDGE_STRENGTHS = tuple(float(value) for value in 10.0 ** np.arange(-7.0, 0.5, 0.5))


@dataclass(frozen=True)
class Structure:
    """
    A candidate: which columns may explain the drift.

    Attributes
    ----------
    name : str
        For people.
    degree : int
        Powers of temperature that take part; hats count as degree 1.
    free_time_constants : int
        How many time constants are searched; 0 with an empty bank is static.
    bank_s : tuple of float
        Fixed time constants behind a regularised regression, s.

    """

    name: str
    degree: int
    free_time_constants: int = 0
    bank_s: tuple[float, ...] = ()

    @property
    def regularised(self) -> bool:
        """Whether a ridge strength is to be chosen."""
        return bool(self.bank_s)


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
        Number the columns of the first inputs through the given relaxations.

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
    problem: AxisProblem, banked: Sequence[FloatArray], time_constants_s: FloatArray
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
            a = np.concatenate((a, residual[rows, np.newaxis]), axis=1)
            products.append(a.T @ a)
            sums.append(a.sum(axis=0))
            counts.append(float(len(rows)))
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
    Draw the regressors of the module's equation, without the constant.

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


def solve_ridge(
    products: FloatArray, columns: IntArray, strength: float
) -> tuple[FloatArray, FloatArray]:
    """
    Ridge regression of the last column on some others, from centred products.

    Parameters
    ----------
    products : ndarray, shape (P + 1, P + 1)
        From Moments.centred.
    columns : ndarray of int, shape (..., p)
        Which columns explain; leading dimensions are solved one by one.
    strength : float
        Relative to the variance of each column.

    Returns
    -------
    tuple of ndarrays, shapes (..., p) and (...)
        Coefficients, and what they leave of the sum of squares.

    """
    diagonal = np.diagonal(products)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    # (p, p) coefficients of correlation, so that strength means the same for every column
    matrix = (products * scale[:, np.newaxis] * scale)[
        columns[..., :, np.newaxis], columns[..., np.newaxis, :]
    ]
    target = (products[-1] * scale)[columns]
    identity = np.eye(columns.shape[-1])
    scaled = np.linalg.solve(matrix + strength * identity, target[..., np.newaxis])[..., 0]
    fitted = np.einsum(
        '...p,...p', scaled, 2 * target - (matrix @ scaled[..., np.newaxis])[..., 0]
    )
    return scaled * scale[columns], products[-1, -1] - fitted


def fit_columns(
    moments: Moments, structure: Structure, keep: BoolArray, inputs: int, strength: float
) -> tuple[IntArray, FloatArray]:
    """
    Fit a candidate to some of the blocks.

    Parameters
    ----------
    moments : Moments
        Of the axis.
    structure : Structure
        The candidate.
    keep : ndarray of bool, shape (B,)
        Entries to fit.
    inputs : int
        Features that take part.
    strength : float
        Ridge; used only by a regularised structure.

    Returns
    -------
    tuple of ndarrays, shape (p,)
        Columns, and their coefficients.

    """
    products, _ = moments.centred(keep)
    grid = moments.time_constants_s
    if structure.regularised:
        chosen = [int(np.argmin(np.abs(grid - tau))) for tau in structure.bank_s]
        columns = moments.columns(chosen, inputs)
        return columns, solve_ridge(products, columns, strength)[0]
    if structure.free_time_constants == 0:
        columns = moments.columns([0], inputs)
        return columns, solve_ridge(products, columns, TINY_RIDGE)[0]
    choices = list(combinations(range(1, len(grid)), structure.free_time_constants))
    candidates = np.stack([moments.columns(choice, inputs) for choice in choices])
    coefficients, left = solve_ridge(products, candidates, TINY_RIDGE)
    best = int(np.argmin(left))
    return candidates[best], coefficients[best]


def held_out_errors(
    moments: Moments, structure: Structure, inputs: int, strength: float
) -> FloatArray:
    """
    Hold every block out in turn and score the free run on it.

    Parameters
    ----------
    moments, structure, inputs, strength
        As for fit_columns.

    Returns
    -------
    ndarray, shape (blocks,)
        Mean square error of each block, after a free constant per recording.

    """
    errors = []
    for block in np.unique(moments.block):
        inside = moments.block == block
        columns, coefficients = fit_columns(moments, structure, ~inside, inputs, strength)
        theta = np.zeros(moments.sums.shape[1])
        theta[columns] = coefficients
        theta[-1] = -1.0
        errors.append(moments.mean_square(inside, theta))
    return np.array(errors)


def uncompensated_errors(moments: Moments) -> FloatArray:
    """
    Score doing nothing.

    Parameters
    ----------
    moments : Moments
        Of the axis.

    Returns
    -------
    ndarray, shape (blocks,)
        As held_out_errors.

    """
    nothing = np.zeros(moments.sums.shape[1])
    nothing[-1] = 1.0
    blocks = np.unique(moments.block)
    return np.array([moments.mean_square(moments.block == block, nothing) for block in blocks])


def refine_time_constants(
    problem: AxisProblem, features: Features, start_s: Sequence[float]
) -> FloatArray:
    """
    Search the time constants around a start, all gains solved inside (variable projection).

    Parameters
    ----------
    problem : AxisProblem
        The axis.
    features : Features
        The inputs.
    start_s : sequence of float
        Start, s, from the grid.

    Returns
    -------
    ndarray, shape (K,)
        Time constants, s, increasing.

    """

    def left(log_tau: FloatArray) -> float:
        return fit_gains(problem, features, np.exp(log_tau), TINY_RIDGE)[1]

    start = np.log(np.asarray(start_s, dtype=float))
    # Slower than the longest recording cannot be told from a trend, and would run away with it.
    longest_s = max(len(residual) for residual in problem.residual) * problem.period_s
    found = minimize(
        left,
        start,
        method='Nelder-Mead',
        bounds=[(np.log(problem.period_s), np.log(longest_s))] * len(start),
        options={
            'xatol': 1e-3,
            'fatol': 1e-9 * left(start),
            'maxfev': 120 * len(start),
            'initial_simplex': np.concatenate(
                (start[np.newaxis], start + 0.2 * np.eye(len(start)))
            ),
        },
    )
    return np.sort(np.exp(found.x))


def fit_gains(
    problem: AxisProblem, features: Features, time_constants_s: FloatArray, strength: float
) -> tuple[FloatArray, float]:
    """
    Fit all gains for given time constants to every sample.

    Parameters
    ----------
    problem : AxisProblem
        The axis.
    features : Features
        The inputs.
    time_constants_s : ndarray, shape (K,)
        τ, s; 0 for a static part.
    strength : float
        Ridge, relative to the variance of each column.

    Returns
    -------
    tuple of ndarray, shape (K, F, M), and float
        Gains from inputs in their own unit to zero and sensitivity drift; and the sum of squares
        that is left.

    """
    banked = bank_inputs(problem, features, time_constants_s)
    moments = accumulate(problem, banked, time_constants_s)
    products, _ = moments.centred(np.ones(len(moments.counts), dtype=bool))
    columns = moments.columns(range(len(time_constants_s)), moments.inputs)
    coefficients, left = solve_ridge(products, columns, strength)
    outputs = 2 if moments.loaded else 1
    per_output = coefficients[: outputs * banked[0].shape[1]]
    gains = per_output.reshape(outputs, len(time_constants_s), moments.inputs)
    return np.moveaxis(gains, 0, 2), float(left)
