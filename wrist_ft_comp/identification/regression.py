"""
Regressions from moments: least squares, ridge and PLS, the last two at all their strengths.

A bank of relaxations has far more columns than a warm-up can tell apart. Both regressions work on
correlations, so a strength means the same whatever the units of the columns.
"""

from collections.abc import Callable

import numpy as np

from wrist_ft_comp.model.signals import FloatArray, IntArray

#: Ridge that only keeps equations of collinear columns solvable, relative to their variance.
TINY_RIDGE = 1e-9
#: Ridge strengths tried, relative to the variance of the columns, strongest first.
RIDGE_STRENGTHS = tuple(float(value) for value in 10.0 ** np.arange(0.0, -8.25, -0.5))
MAX_LATENTS = 12
#: Below this share of its first value, what is left of the covariance with the target is rounding.
_EXHAUSTED = 1e-12
#: From centred products and columns (p,) to coefficients (S, p), the most regularised first.
Path = Callable[[FloatArray, IntArray], FloatArray]


def _correlations(products: FloatArray, columns: IntArray) -> tuple[FloatArray, FloatArray]:
    """
    Scale centred products so that each column, by the positions (…, p), has variance one.

    Return correlations with the target behind the columns, (…, p + 1, p + 1), and what turns
    coefficients of scaled columns into those of columns, for a target that is not scaled, (…, p).

    """
    diagonal = np.diagonal(products)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    scale[-1] = 1.0
    last = np.full((*columns.shape[:-1], 1), len(products) - 1)
    rows = np.concatenate((columns, last), axis=-1)
    scaled = products * scale[:, np.newaxis] * scale
    return scaled[rows[..., :, np.newaxis], rows[..., np.newaxis, :]], scale[columns]


def least_squares(products: FloatArray, columns: IntArray) -> tuple[FloatArray, FloatArray]:
    """
    Regress the target on columns, shape (…, p), with just enough ridge to be solvable.

    Return coefficients, (…, p), and the residual sum of squares, (…).
    """
    both, scale = _correlations(products, columns)
    matrix, target = both[..., :-1, :-1], both[..., :-1, -1]
    damped = matrix + TINY_RIDGE * np.eye(columns.shape[-1])
    scaled = np.linalg.solve(damped, target[..., np.newaxis])[..., 0]
    fitted = np.einsum(
        '...p,...p', scaled, 2 * target - (matrix @ scaled[..., np.newaxis])[..., 0]
    )
    return scaled * scale, products[-1, -1] - fitted


def ridge_path(products: FloatArray, columns: IntArray) -> FloatArray:
    """Regress the target on columns, (p,), by ridge: coefficients, (len(RIDGE_STRENGTHS), p)."""
    both, scale = _correlations(products, columns)
    values, vectors = np.linalg.eigh(both[:-1, :-1])
    turned = vectors.T @ both[:-1, -1]
    # (S, p) = (S, p) / … · (p, p)
    shrunk = turned / (np.maximum(values, 0.0) + np.array(RIDGE_STRENGTHS)[:, np.newaxis])
    coefficients: FloatArray = (shrunk @ vectors.T) * scale
    return coefficients


def pls_path(products: FloatArray, columns: IntArray) -> FloatArray:
    """
    Regress the target on columns, (p,), by PLS with 1, 2, … latents (eq. 3 to 10).

    The same latents as NIPALS finds in the samples, from XᵀX and Xᵀy alone (Dayal and MacGregor,
    Journal of Chemometrics 11, 1997). Coefficients, shape (MAX_LATENTS, p); those of an exhausted
    block are repeated.
    """
    both, scale = _correlations(products, columns)
    matrix, covariance = both[:-1, :-1], both[:-1, -1].copy()
    size, first = len(covariance), float(np.linalg.norm(covariance))
    loadings: FloatArray = np.zeros((0, size))
    rotations: FloatArray = np.zeros((0, size))
    coefficients: FloatArray = np.zeros(size)
    path = []
    for _ in range(MAX_LATENTS):
        norm = float(np.linalg.norm(covariance))
        if len(rotations) < size and norm > _EXHAUSTED * first:
            weight = covariance / norm
            rotation = weight - (loadings @ weight) @ rotations
            moved = matrix @ rotation
            power = float(rotation @ moved)
            if power > _EXHAUSTED:
                inner = float(rotation @ both[:-1, -1]) / power
                loadings = np.vstack((loadings, moved / power))
                rotations = np.vstack((rotations, rotation))
                coefficients = coefficients + inner * rotation
                covariance = covariance - inner * moved
        path.append(coefficients)
    return np.array(path) * scale
