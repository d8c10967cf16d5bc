"""How well recordings determine gains and time constants: their fit with standard errors."""

from dataclasses import dataclass, replace

import numpy as np

from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.bins import BinnedData
from wrist_ft_comp.fit.gains import by_relaxation
from wrist_ft_comp.fit.time_constants import residual_and_gradient, VarPro
from wrist_ft_comp.signals import BoolArray, FloatArray

#: What is left is correlated over about this time; standard errors count it as one sample, s.
_CLUSTER_S = 600.0
_MIN_CLUSTERS = 20


@dataclass(frozen=True, eq=False)
class GainFit:
    """Gains for given time constants, (K,), s, of which 0 is static, with standard errors."""

    # Gains, (K, F, M), lead from features of each relaxation's temperatures to zero and
    # sensitivity drift. What has no error holds NaN.

    time_constants_s: FloatArray
    gains: FloatArray
    time_constant_errors_s: FloatArray
    gain_errors: FloatArray


def fit_gains(data: BinnedData, features: Features, time_constants_s: FloatArray) -> GainFit:
    """Fit all gains for time constants at their optimum, with standard errors of both."""
    # The errors allow for what is left being correlated in time: they are those of the sandwich
    # estimator, with stretches of ten minutes as the independent samples.
    whole_s = sum(map(len, data.temperature_c)) * data.period_s
    bins = max(round(min(_CLUSTER_S, whole_s / _MIN_CLUSTERS) / data.period_s), 1)
    clusters = tuple(np.arange(len(each)) // bins for each in data.temperature_c)
    clustered = replace(data, folds=clusters)
    projection = residual_and_gradient(clustered, features, time_constants_s)
    free = time_constants_s > 0
    deviations = _standard_errors(projection, free)
    count, inputs = len(time_constants_s), projection.moments.inputs
    explaining = len(projection.columns)
    errors = np.full(count, np.nan)
    errors[free] = deviations[explaining:] * time_constants_s[free]
    return GainFit(
        time_constants_s,
        by_relaxation(projection.gains, count, inputs, loaded=projection.moments.loaded),
        errors,
        by_relaxation(deviations[:explaining], count, inputs, loaded=projection.moments.loaded),
    )


def _standard_errors(projection: VarPro, free: BoolArray) -> FloatArray:
    """Sandwich estimate over clusters, shape (p + free time constants,)."""
    #   V = B (Σ_c u_c u_cᵀ) B · C / (C - p),   B = (JᵀJ)⁻¹,   u_c = Σ_{k in c} J_kᵀ e_k
    moments = projection.moments
    size = moments.products.shape[1]
    # Columns of J as combinations of the columns that were summed, shape (P + 1, p + K').
    copied = np.eye(size)[:, projection.columns]
    jacobian = np.concatenate((copied, projection.derivative[free].T), axis=1)
    residual = projection.residual
    bread = jacobian.T @ moments.centred() @ jacobian
    scores = np.empty((len(moments.fold), jacobian.shape[1]))
    for recording in np.unique(moments.recording):
        own = moments.recording == recording
        crossed = moments.nuisance_products[own]  # (C, N, P + 1)
        level = moments.fit_nuisances(own, residual[np.newaxis])[:, 0]  # of e, (N,)
        levels = moments.fit_nuisances(own, jacobian.T)  # of J, (N, p + K')
        # Σ (J - its level)ᵀ (e - its level) of every cluster, from its sums of products
        scores[own] = (
            moments.products[own] @ residual @ jacobian
            - np.einsum('q,cqp->cp', level, crossed) @ jacobian
            - crossed @ residual @ levels
            + np.einsum('q,cqr->cr', level, moments.nuisance_gram[own]) @ levels
        )
    used = np.diagonal(bread) > 0
    scale = 1.0 / np.sqrt(np.where(used, np.diagonal(bread), 1.0))
    scaled = np.linalg.pinv(bread * scale * scale[:, np.newaxis], rcond=1e-12, hermitian=True)
    spread = scores @ (scale[:, np.newaxis] * scaled * scale)
    clusters, fitted = len(scores), int(used.sum()) + len(np.unique(moments.recording))
    if clusters <= fitted:
        return np.full(len(bread), np.nan)
    variance = (spread**2).sum(axis=0) * clusters / (clusters - fitted)
    return np.where(used, np.sqrt(variance), np.nan)
