"""
X and Y of one axis, and the paper's methods that filter X at most (eq. 3 to 14): PLS, PCR.

    X = T Pᵀ + E      (N, F) = (N, R)(R, F) + (N, F)      eq. 3
    T = X W (Pᵀ W)⁻¹  (N, R) = (N, F)(F, R)               eq. 4, with deflation accounted for
    Y = T B Qᵀ + F    (N, M) = (N, R)(R, R)(R, M) + …     eq. 8, columns of Q of length 1

X is the input block and Y the output block; both are centred and scaled. In filtered PLS (Kaspar
and Ray) each latent has a dynamic filter h_r of its own; with all h_r = 1 it is PLS:

    Ẽ = H_r(E_{r-1})                                                (N, F)   eq. 11
    w_r = leading eigenvector of Ẽᵀ F_{r-1} F_{r-1}ᵀ Ẽ              (F,)     eq. 12
    t_r = Ẽ w_r = h_r(E_{r-1} w_r),   p_r = Ẽᵀ t_r / t_rᵀ t_r                eq. 12, 13
    E_r = E_{r-1} (I - w_r p_rᵀ), so H_r(E_r) = Ẽ - t_r p_rᵀ        (N, F)   eq. 3
    F_r = F_{r-1} - b_r t_r q_rᵀ                                    (N, M)   eq. 5, 9, 10
    Y = diag(h_1 … h_R)(E_0 W*) B Qᵀ + F,  W* = W (PᵀW)⁻¹           (N, M)   eq. 14

The filtered block is deflated, and E_r is what it was before h_r: so the next latent's filter is
its own.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from wrist_ft_comp.drift.arx_pls import Arx, ArxPls, free_run, relaxation
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.axis_data import AxisData
from wrist_ft_comp.series import FloatArray, ROUNDING, stretches

#: Longest stretch of constant sensitivity assumed when it is observed directly, s.
OBSERVATION_WINDOW_S = 300.0
#: A window shows sensitivity when its load varies by this share of the load's whole deviation.
_LOADED_SHARE = 0.2


@dataclass(frozen=True, eq=False)
class XyBlock:
    """Input and output block, recording by recording; X is the input (3.2 swaps the words)."""

    #: E_0 of every cell, (N_i, F): centred by x̄, scaled by W_x.
    inputs: tuple[FloatArray, ...]
    #: F_0, (N_i, M), scaled by W_y, up to a constant of each recording; NaN where nothing was
    #: observed.
    outputs: tuple[FloatArray, ...]
    #: X of eq. 3, (N, F), and Y of eq. 5, (N, M): observed cells, each recording centred.
    x: FloatArray
    y: FloatArray
    #: x̄ over the observed cells, and the diagonal of W_x: one over the inputs' deviation, 0 for
    #: constant inputs, shape (F,).
    input_mean: FloatArray
    input_weight: FloatArray
    #: Diagonal of W_y: one over the outputs' deviation, shape (M,); 1 for constant outputs.
    output_weight: FloatArray

    def model(self, outer: 'Pls', latents: Sequence[Arx]) -> ArxPls | None:
        """Put an identified model together, in the block's units; None without any latent."""
        if not len(latents):
            return None
        return ArxPls(
            input_mean=self.input_mean, input_weight=self.input_weight,
            rotations=outer.rotations, latents=tuple(latents),
            output_loadings=outer.output_loadings, output_weight=self.output_weight,
            output_mean=np.zeros(len(self.output_weight)))  # fmt: skip


def stack(series: Sequence[FloatArray], outputs: Sequence[FloatArray]) -> FloatArray:
    """Join the observed cells of (N_i, K), each recording centred for its unknown offset."""
    rows = [np.isfinite(y).all(axis=1) for y in outputs]
    parts = [values[seen] for values, seen in zip(series, rows, strict=True) if seen.any()]
    return np.concatenate([part - part.mean(axis=0) for part in parts])


def scale_block(inputs: Sequence[FloatArray], outputs: Sequence[FloatArray]) -> XyBlock | None:
    """Centre and scale inputs, (N_i, F), and outputs, (N_i, M); None where none is observed."""
    rows = [np.isfinite(y).all(axis=1) for y in outputs]
    seen = np.concatenate([x[observed] for x, observed in zip(inputs, rows, strict=True)])
    if not len(seen):
        return None
    mean, deviation = seen.mean(axis=0), seen.std(axis=0)
    varies = deviation > 1e-9 * np.abs(seen).max(axis=0)
    input_weight = np.divide(1.0, deviation, out=np.zeros_like(deviation), where=varies)
    x, y = stack(inputs, outputs), stack(outputs, outputs)
    spread = np.std(y, axis=0)
    output_weight = np.divide(1.0, spread, out=np.ones_like(spread), where=spread > 0)
    return XyBlock(
        inputs=tuple((values - mean) * input_weight for values in inputs),
        outputs=tuple(values * output_weight for values in outputs),
        x=x * input_weight, y=y * output_weight,
        input_mean=mean, input_weight=input_weight, output_weight=output_weight)  # fmt: skip


def build_xy_block(data: AxisData, features: Features) -> XyBlock | None:
    """Expand the temperatures of an axis to features, and observe its drift; None without any."""
    inputs = [features.expand(temperature_c) for temperature_c in data.temperature_c]
    return scale_block(inputs, observe_drift(data))


def observe_drift(data: AxisData) -> list[FloatArray]:
    """
    Observe zero drift and, when there is load, sensitivity drift directly in r - w, (N_i, M).

    Sensitivity is a least-squares slope over windows of at most OBSERVATION_WINDOW_S that do not
    cross gaps: "coefficients recorded at discrete temperatures" (the paper's 3.2). Observations
    hold up to a constant of each recording, and are NaN where either is not known.
    """
    if data.load is None:
        return [residual[:, np.newaxis] for residual in data.residual]
    deviation = float(np.std(np.concatenate([w[np.isfinite(w)] for w in data.load])))
    cells = max(round(OBSERVATION_WINDOW_S / data.period_s), 1)
    drifts = list[FloatArray]()
    for residual, load in zip(data.residual, data.load, strict=True):
        observed = np.full((len(residual), 2), np.nan)
        present = np.isfinite(residual) & np.isfinite(load)
        at = np.flatnonzero(present)
        # A window belongs to one stretch, so none crosses a gap.
        windows = np.stack((stretches(present, data.period_s)[at], at // cells), axis=1)
        window = np.unique(windows, axis=0, return_inverse=True)[1].reshape(-1)
        count = np.bincount(window)
        w = load[at] - (np.bincount(window, load[at]) / count)[window]
        power = np.bincount(window, w**2)
        shown = (count > 2) & (np.sqrt(power / count) >= _LOADED_SHARE * deviation)
        slopes = np.bincount(window, w * residual[at]) / np.where(shown, power, 1.0)
        slope, rows = slopes[window], shown[window]
        observed[at[rows]] = np.stack((residual[at] - slope * load[at], slope), axis=1)[rows]
        drifts.append(observed)
    return drifts


@dataclass(frozen=True, eq=False)
class Pls:
    """A fitted outer model with R latents, F inputs and M outputs."""

    #: R = W (PᵀW)⁻¹, shape (F, R), so that T = X R (eq. 4).
    rotations: FloatArray
    #: Diagonal of B (eq. 9), shape (R,).
    inner: FloatArray
    #: Q, columns of length 1, shape (M, R).
    output_loadings: FloatArray


def dominant_weights(e: FloatArray, f: FloatArray) -> FloatArray:
    """
    Find the next latent's weights, what NIPALS converges to, shape (F,), of length 1.

    They are the leading eigenvector of EᵀF FᵀE, E of shape (N, F), F of shape (N, M), whose
    largest component is positive. Where E explains nothing of F but rounding errors, they are 0.
    """
    covariance = e.T @ f  # (F, M)
    if np.linalg.norm(covariance) <= ROUNDING * np.linalg.norm(e) * np.linalg.norm(f):
        return np.zeros(len(covariance))
    weights = np.linalg.svd(covariance, full_matrices=False)[0][:, 0]
    return np.asarray(weights * np.sign(weights[np.argmax(np.abs(weights))]))


def fit_pls(
    x: FloatArray,
    y: FloatArray,
    latents: int,
    behind: Callable[[int, FloatArray], FloatArray] | None = None,
    weights: Callable[[FloatArray, FloatArray], FloatArray] = dominant_weights,
) -> Pls:
    """
    Fit PLS by NIPALS (eq. 3 to 10) to x, (N, F), and y, (N, M), until either is exhausted.

    ``behind(r, D)`` gives E_r = X D, (N, F), behind the filter of latent r, counted from 0, for a
    deflation D, (F, F); without it there are no filters. ``weights(E, F)`` gives those of the next
    latent, (F,).
    """
    f, deflation = y.copy(), np.eye(x.shape[1])  # F_r of eq. 5; E_r = E_0 D
    # A block of which no more than rounding remains is exhausted.
    x_limit, y_limit = (ROUNDING**2 * float(np.sum(block**2)) for block in (x, y))
    components: list[tuple[FloatArray, ...]] = []
    while len(components) < latents and np.sum(f**2) > y_limit:
        e = behind(len(components), deflation) if behind else x @ deflation  # eq. 11
        w = weights(e, f)  # eq. 12
        t = e @ w
        tt = float(t @ t)
        if tt <= x_limit:
            break
        p = e.T @ t / tt  # eq. 13
        slopes = f.T @ t / tt  # b_r q_r of eq. 9
        b = np.linalg.norm(slopes)
        f -= np.outer(t, slopes)  # eq. 5 with eq. 10
        deflation = deflation @ (np.eye(len(w)) - np.outer(w, p))  # eq. 3
        components.append((w, p, slopes / b, np.array([b])))
    w_, p_, q_, b_ = (
        np.reshape([latent[part] for latent in components], (-1, size)).T  # (0, size) without any
        for part, size in enumerate((x.shape[1], x.shape[1], y.shape[1], 1))
    )
    # (F, R) = (F, R) (R, R)⁻¹
    return Pls(w_ @ np.linalg.inv(p_.T @ w_), inner=b_[0], output_loadings=q_)


def fit_pcr(x: FloatArray, y: FloatArray, latents: int) -> Pls:
    """Fit principal component regression, the paper's starting point: its weights are X's own."""
    return fit_pls(x, y, latents, weights=lambda e, _: dominant_weights(e, e))


def fit_filtered_pls(
    block: XyBlock, time_constants_s: Sequence[float], period_s: float
) -> tuple[ArxPls | None, tuple[str, ...]]:
    """
    Fit a latent behind each relaxation, 0 is none, or fewer where a block is exhausted.

    Without any relaxation it is PLS. The model is None where the inputs explain nothing; beside it
    stands h_r of each latent that has one, in words.
    """
    filters = [relaxation(time_constant_s, period_s) for time_constant_s in time_constants_s]

    def behind(r: int, deflation: FloatArray) -> FloatArray:
        """Deflate the inputs of all cells, and filter each recording by itself (eq. 11)."""
        return stack([free_run(filters[r], e @ deflation) for e in block.inputs], block.outputs)

    outer = fit_pls(block.x, block.y, len(filters), behind)
    notes = [
        f'latent {r}: h is a relaxation of {tau:g} s'
        for r, tau in enumerate(time_constants_s[: len(outer.inner)], 1)
        if tau
    ]
    # u_r = b_r h_r(t_r) (eq. 10 and 14)
    latents = [Arx(h.a, b * h.b) for h, b in zip(filters, outer.inner, strict=False)]
    return block.model(outer, latents), tuple(notes)
