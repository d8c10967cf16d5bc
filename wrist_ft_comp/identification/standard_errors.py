"""How well recordings determine gains and time constants: their fit with standard errors."""

from dataclasses import dataclass, replace

import numpy as np

from wrist_ft_comp.identification.bins import BinnedProblem
from wrist_ft_comp.identification.time_constants import differentiate, Tangent
from wrist_ft_comp.model.features import Features
from wrist_ft_comp.model.signals import BoolArray, FloatArray, IntArray

#: What is left is correlated over about this time; standard errors count it as one sample, s.
_CLUSTER_S = 600.0


_MIN_CLUSTERS = 20


@dataclass(frozen=True, eq=False)
class FreeFit:
    """
    Gains for given time constants.

    Attributes
    ----------
    time_constants_s : ndarray, shape (K,)
        τ, s; 0 for a static part.
    gains : ndarray, shape (K, F, M)
        From features of each relaxation's temperatures to zero and sensitivity drift.
    time_constant_errors_s : ndarray, shape (K,)
        Standard errors, s; NaN where τ is 0.
    gain_errors : ndarray, shape (K, F, M)
        Standard errors, units of the gains.

    """

    time_constants_s: FloatArray
    gains: FloatArray
    time_constant_errors_s: FloatArray
    gain_errors: FloatArray


def fit_free(problem: BinnedProblem, features: Features, time_constants_s: FloatArray) -> FreeFit:
    """
    Fit all gains for given time constants, with standard errors of both.

    The errors allow for what is left being correlated in time: they are those of the sandwich
    estimator, with stretches of ten minutes as the independent samples.

    Parameters
    ----------
    problem : BinnedProblem
        The axis.
    features : Features
        Of one relaxation's temperatures.
    time_constants_s : ndarray, shape (K,)
        τ at their optimum, s; a single 0 is static.

    Returns
    -------
    FreeFit
        Gains and errors.

    """
    clustered = replace(problem, blocks=_clusters(problem))
    tangent = differentiate(clustered, features, time_constants_s)
    free = time_constants_s > 0
    deviations = _standard_errors(tangent, free)
    count, inputs = len(time_constants_s), tangent.moments.inputs
    explaining = len(tangent.columns)
    errors = np.full(count, np.nan)
    errors[free] = deviations[explaining:] * time_constants_s[free]
    return FreeFit(
        time_constants_s,
        by_relaxation(tangent.gains, count, inputs, loaded=tangent.moments.loaded),
        errors,
        by_relaxation(deviations[:explaining], count, inputs, loaded=tangent.moments.loaded),
    )


def by_relaxation(values: FloatArray, count: int, inputs: int, *, loaded: bool) -> FloatArray:
    """
    Sort values per column by relaxation.

    Parameters
    ----------
    values : ndarray, shape (p,)
        In the order of Moments.columns.
    count, inputs : int
        K relaxations, F features of each.
    loaded : bool
        Whether there are columns of sensitivity drift.

    Returns
    -------
    ndarray, shape (K, F, M)
        Without that of the load itself.

    """
    outputs = 2 if loaded else 1
    per_output = values[: outputs * count * inputs].reshape(outputs, count, inputs)
    return np.moveaxis(per_output, 0, 2)


def _clusters(problem: BinnedProblem) -> tuple[IntArray, ...]:
    """Divide into stretches that count as one independent sample each, shapes (N_i,)."""
    whole_s = sum(len(temperature_c) for temperature_c in problem.temperature_c) * problem.period_s
    bins = max(round(min(_CLUSTER_S, whole_s / _MIN_CLUSTERS) / problem.period_s), 1)
    return tuple(np.arange(len(temperature_c)) // bins for temperature_c in problem.temperature_c)


def _standard_errors(tangent: Tangent, free: BoolArray) -> FloatArray:
    """
    Sandwich estimate over clusters, shape (p + free time constants,).

        V = B (Σ_c u_c u_cᵀ) B · C / (C - p),   B = (JᵀJ)⁻¹,   u_c = Σ_{k in c} J_kᵀ e_k

    """
    moments = tangent.moments
    size = moments.products.shape[1]
    # Columns of J as combinations of the columns that were summed, shape (P + 1, p + K').
    copied = np.eye(size)[:, tangent.columns]
    jacobian = np.concatenate((copied, tangent.derivative[free].T), axis=1)
    residual = tangent.residual
    everything = np.ones(len(moments.counts), dtype=bool)
    bread = jacobian.T @ moments.centred(everything)[0] @ jacobian
    scores = np.empty((len(moments.counts), jacobian.shape[1]))
    for group in np.unique(moments.group):
        own = moments.group == group
        beside = moments.beside[own]  # (C, 2, P + 1)
        level = moments.what_time_explains(own, residual[np.newaxis])[:, 0]  # of e, (2,)
        levels = moments.what_time_explains(own, jacobian.T)  # of J, (2, p + K')
        # Σ (J - its level)ᵀ (e - its level) of every cluster, from its sums of products
        scores[own] = (
            moments.products[own] @ residual @ jacobian
            - np.einsum('q,cqp->cp', level, beside) @ jacobian
            - beside @ residual @ levels
            + np.einsum('q,cqr->cr', level, moments.time[own]) @ levels
        )
    used = np.diagonal(bread) > 0
    scale = 1.0 / np.sqrt(np.where(used, np.diagonal(bread), 1.0))
    inverse = (
        scale[:, np.newaxis]
        * np.linalg.pinv(bread * scale * scale[:, np.newaxis], rcond=1e-12, hermitian=True)
        * scale
    )
    spread = scores @ inverse
    clusters, fitted = len(scores), int(used.sum()) + len(np.unique(moments.group))
    if clusters <= fitted:
        return np.full(len(bread), np.nan)
    variance = (spread**2).sum(axis=0) * clusters / (clusters - fitted)
    return np.where(used, np.sqrt(variance), np.nan)
