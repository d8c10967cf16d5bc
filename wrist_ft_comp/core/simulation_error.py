"""
Fits on the simulation error (eq. 16): relaxations with free or fixed time constants.

Thermal diffusion has no other dynamics than relaxations H_τ, so the drift is

    r - w = Σ_τ Σ_f g_τf H_τ(x_f)  +  w · Σ_τ Σ_f k_τf H_τ(x_f)  +  s_0 w  +  constant

and for given time constants everything else is linear (variable projection). All candidates are
fitted from one matrix of moments whose columns hold every input through every relaxation of a grid
of time constants.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.optimize import minimize

from wrist_ft_comp.core.features import Features
from wrist_ft_comp.core.moments import Moments, accumulate, bank_inputs
from wrist_ft_comp.core.problem import AxisProblem
from wrist_ft_comp.core.recording import BoolArray, FloatArray, IntArray

#: Ridge that only keeps equations of collinear columns solvable, relative to their variance.
TINY_RIDGE = 1e-9
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
    moments: Moments,
    judged: Moments,
    structure: Structure,
    inputs: int,
    strength: float,
) -> FloatArray:
    """
    Hold every block out in turn and score the free run on it.

    Parameters
    ----------
    moments : Moments
        Fitted to.
    judged : Moments
        Scored on; the same blocks, averaged over bins.
    structure, inputs, strength
        As for fit_columns.

    Returns
    -------
    ndarray, shape (blocks,)
        Mean square error of each block, after a free constant per recording.

    """
    errors = []
    for block in np.unique(moments.block):
        kept = moments.block != block
        columns, coefficients = fit_columns(moments, structure, kept, inputs, strength)
        theta = np.zeros(moments.sums.shape[1])
        theta[columns] = coefficients
        theta[-1] = -1.0
        errors.append(judged.mean_square(judged.block == block, theta))
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
    problem: AxisProblem, features: Features, start_s: FloatArray
) -> FloatArray:
    """
    Search the time constants around a start, all gains solved inside (variable projection).

    Parameters
    ----------
    problem : AxisProblem
        The axis.
    features : Features
        The inputs.
    start_s : ndarray, shape (K,)
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
