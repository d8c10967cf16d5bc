"""
The outer model: partial least squares by NIPALS (eq. 3 to 10), and principal components.

    X = T Pᵀ + E      (N, F) = (N, R)(R, F) + (N, F)      eq. 3
    T = X W (Pᵀ W)⁻¹  (N, R) = (N, F)(F, R)               eq. 4, with deflation accounted for
    Y = T B Qᵀ + F    (N, M) = (N, R)(R, R)(R, M) + …     eq. 8, columns of Q of length 1

X is the input block and Y the output block; both are centred and scaled.
"""

from dataclasses import dataclass

import numpy as np

from wrist_ft_comp.series import FloatArray

#: A block whose remaining sum of squares is below this share of the original is exhausted.
EXHAUSTED = 1e-24
#: Turns of NIPALS for one latent, at most.
_MAX_ITERATIONS = 2000


@dataclass(frozen=True, eq=False)
class Pls:
    """A fitted outer model with R latents, F inputs and M outputs."""

    #: W, columns of length 1, and P, shapes (F, R).
    weights: FloatArray
    loadings: FloatArray
    #: Diagonal of B (eq. 9), shape (R,).
    inner: FloatArray
    #: Q, columns of length 1, shape (M, R).
    output_loadings: FloatArray
    #: T of the data that were fitted, shape (N, R).
    scores: FloatArray

    @property
    def latents(self) -> int:
        """Number of latents R; fewer than asked for when the data have no more."""
        return int(self.weights.shape[1])

    @property
    def rotations(self) -> FloatArray:
        """R = W (PᵀW)⁻¹, shape (F, R), so that T = X R (eq. 4)."""
        # (F, R) = (F, R) (R, R)⁻¹
        return self.weights @ np.linalg.inv(self.loadings.T @ self.weights)

    @property
    def coefficients(self) -> FloatArray:
        """Regression matrix C, shape (F, M), with Y ≈ X C (eq. 8)."""
        return (self.rotations * self.inner) @ self.output_loadings.T


def fix_signs(weights: FloatArray) -> FloatArray:
    """Resolve the sign freedom of a weight vector: its largest component becomes positive."""
    return weights if weights[np.argmax(np.abs(weights))] >= 0 else -weights


def fit_pls(x: FloatArray, y: FloatArray, latents: int) -> Pls:
    """Fit PLS by NIPALS (eq. 3 to 10) to x, (N, F), and y, (N, M), until either is exhausted."""
    e, f = x.copy(), y.copy()  # E_r and F_r of eq. 3 and 5
    x_limit, y_limit = (EXHAUSTED * float(np.sum(block**2)) for block in (x, y))
    components: list[tuple[FloatArray, ...]] = []
    while len(components) < latents and np.sum(e**2) > x_limit and np.sum(f**2) > y_limit:
        w = dominant_weights(e, f)
        t = e @ w
        tt = float(t @ t)
        if w @ w == 0 or tt <= x_limit:
            break
        q = f.T @ t
        q /= np.linalg.norm(q)
        u = f @ q
        p = e.T @ t / tt
        b = float(u @ t) / tt  # eq. 9
        e -= np.outer(t, p)  # eq. 3
        f -= b * np.outer(t, q)  # eq. 5 with eq. 10
        components.append((w, p, q, t, np.array(b)))
    w_, p_, q_, t_ = (
        np.reshape([latent[part] for latent in components], (-1, size)).T  # (0, size) without any
        for part, size in enumerate((x.shape[1], x.shape[1], y.shape[1], len(x)))
    )
    inner = np.array([float(latent[4]) for latent in components])
    return Pls(weights=w_, loadings=p_, inner=inner, output_loadings=q_, scores=t_)


def dominant_weights(e: FloatArray, f: FloatArray) -> FloatArray:
    """
    Find the next latent's weights: the leading eigenvector of EᵀF FᵀE, shape (F,), of length 1.

    E has shape (N, F), F shape (N, M). Where E explains nothing of F, the weights are 0.
    """
    covariance = e.T @ f  # (F, M)
    w = covariance[:, np.argmax(np.sum(covariance**2, axis=0))]
    for _ in range(_MAX_ITERATIONS):
        norm = np.linalg.norm(w)
        if norm == 0:
            return w
        w = w / norm
        # u = F q with q ∝ Fᵀ t and w ∝ Eᵀ u: one turn of NIPALS, without its two N-vectors.
        turned = covariance @ (covariance.T @ w)
        turned_norm = np.linalg.norm(turned)
        if turned_norm == 0 or np.linalg.norm(turned / turned_norm - w) < 1e-15:
            break
        w = turned
    return fix_signs(w)


def fit_pcr(x: FloatArray, y: FloatArray, latents: int) -> Pls:
    """Fit principal component regression, the paper's starting point, as ``fit_pls``."""
    _, singular, directions = np.linalg.svd(x, full_matrices=False)
    rank = int(np.count_nonzero(singular**2 > EXHAUSTED * np.sum(singular**2)))
    kept = directions[: min(latents, rank) if np.any(y) else 0]
    weights = np.reshape([fix_signs(v) for v in kept], (-1, x.shape[1])).T
    scores = x @ weights
    # slopes (M, R): each output on each score; scores are orthogonal, so one at a time
    slopes = y.T @ scores / np.sum(scores**2, axis=0)
    inner = np.linalg.norm(slopes, axis=0)
    output_loadings = np.divide(slopes, inner, out=np.zeros_like(slopes), where=inner > 0)
    return Pls(weights, weights, inner, output_loadings, scores)
