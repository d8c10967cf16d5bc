"""
Least squares from moments: fits on the simulation error (eq. 16) behind relaxations.

    r - w = Σ_τ Σ_f g_τf x_f(H_τ T)  +  w · Σ_τ Σ_f k_τf x_f(H_τ T)  +  s_0 w  +  constant

It works on correlations, so that its ridge means the same whatever the units.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from wrist_ft_comp.fit.moments import Moments
from wrist_ft_comp.signals import FloatArray, IntArray

#: Ridge that only keeps equations of collinear columns solvable, relative to their variance.
TINY_RIDGE = 1e-9


def _correlations(products: FloatArray, columns: IntArray) -> tuple[FloatArray, FloatArray]:
    """Scale centred products so that each column, by the positions (…, p), has variance one."""
    # Return correlations, the target behind the columns and not scaled, (…, p + 1, p + 1), and
    # what turns coefficients of scaled columns into those of columns, (…, p).
    diagonal = np.diagonal(products)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    scale[-1] = 1.0
    last = np.full((*columns.shape[:-1], 1), len(products) - 1)
    rows = np.concatenate((columns, last), axis=-1)
    scaled = products * scale[:, np.newaxis] * scale
    return scaled[rows[..., :, np.newaxis], rows[..., np.newaxis, :]], scale[columns]


def least_squares(products: FloatArray, columns: IntArray) -> tuple[FloatArray, FloatArray]:
    """Regress the target on columns, shape (…, p), with just enough ridge to be solvable."""
    # Return coefficients, (…, p), and the residual sum of squares, (…).
    both, scale = _correlations(products, columns)
    matrix, target = both[..., :-1, :-1], both[..., :-1, -1]
    damped = matrix + TINY_RIDGE * np.eye(columns.shape[-1])
    scaled = np.linalg.solve(damped, target[..., np.newaxis])[..., 0]
    explained = (matrix @ scaled[..., np.newaxis])[..., 0]
    fitted = np.einsum('...p,...p', scaled, 2 * target - explained)
    return scaled * scale, products[-1, -1] - fitted


@dataclass(frozen=True)
class Structure:
    """Powers of temperature up to the degree (hats count as 1) behind free time constants."""

    name: str
    degree: int
    free_time_constants: int


def best_on_grid(moments: Moments, structure: Structure, inputs: int) -> FloatArray:
    """Find the time constants on the grid, s, behind which the first inputs explain most."""
    grid = moments.time_constants_s
    choices = list(combinations(range(1, len(grid)), structure.free_time_constants))
    candidates = np.stack([moments.columns(choice, inputs) for choice in choices])
    _, rss = least_squares(moments.centred(), candidates)
    return grid[list(choices[int(np.argmin(rss))])]
