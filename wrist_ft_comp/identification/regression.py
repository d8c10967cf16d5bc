"""Least squares from moments, on correlations: so its ridge means the same whatever the units."""

import numpy as np

from wrist_ft_comp.model.signals import FloatArray, IntArray

#: Ridge that only keeps equations of collinear columns solvable, relative to their variance.
TINY_RIDGE = 1e-9


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
