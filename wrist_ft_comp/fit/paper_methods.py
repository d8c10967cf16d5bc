"""
The paper's methods: an outer model between observed blocks, then an inner model per latent.

Source: "Design of Temperature Compensation Module of the Industrial Robot Wrist Force Sensor Based
on Multivariate Regression Method", Sensors & Transducers, 2014. X is the input block and Y the
output block (the text under 3.2 swaps the words). Both are centred and scaled before PLS.

    X = T Pᵀ + E      (N, F) = (N, R)(R, F) + (N, F)      eq. 3
    T = X W (Pᵀ W)⁻¹  (N, R) = (N, F)(F, R)               eq. 4, with deflation accounted for
    Y = T B Qᵀ + F    (N, M) = (N, R)(R, R)(R, M) + …     eq. 8, columns of Q of length 1

``pcr`` and ``pls`` are static (eq. 3 to 10), ``filtered_pls`` puts a dynamic filter before static
PLS (eq. 11 to 14, Kaspar and Ray), ``arx_pls`` is the paper literally: PLS, then least-squares ARX
per latent (eq. 15 to 22).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from wrist_ft_comp.drift.arx_filter import (
    Arx,
    fit_one_step,
    free_run,
    Orders,
    relaxation,
    stabilise,
    static_gain,
)
from wrist_ft_comp.drift.arx_pls import ArxPls, from_gains
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.axis_data import AxisData
from wrist_ft_comp.signals import BoolArray, FloatArray, stretches

#: A block whose remaining sum of squares is below this share of the original is exhausted.
_EXHAUSTED = 1e-24
#: Turns of NIPALS for one latent, at most.
_MAX_ITERATIONS = 2000
#: Longest stretch of constant sensitivity assumed when it is observed directly, s.
OBSERVATION_WINDOW_S = 300.0
#: A window shows sensitivity when its load varies by this share of the load's whole deviation.
_LOADED_SHARE = 0.2

PaperMethod = Literal['pcr', 'pls', 'filtered_pls', 'arx_pls']


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
    x_limit, y_limit = (_EXHAUSTED * float(np.sum(block**2)) for block in (x, y))
    components: list[tuple[FloatArray, ...]] = []
    while len(components) < latents and np.sum(e**2) > x_limit and np.sum(f**2) > y_limit:
        w = _dominant_weights(e, f)
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


def _dominant_weights(e: FloatArray, f: FloatArray) -> FloatArray:
    """Find the next latent's weights, shape (F,), of length 1; 0 if x explains nothing."""
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
    rank = int(np.count_nonzero(singular**2 > _EXHAUSTED * np.sum(singular**2)))
    kept = directions[: min(latents, rank) if np.any(y) else 0]
    weights = np.reshape([fix_signs(v) for v in kept], (-1, x.shape[1])).T
    scores = x @ weights
    # slopes (M, R): each output on each score; scores are orthogonal, so one at a time
    slopes = y.T @ scores / np.sum(scores**2, axis=0)
    inner = np.linalg.norm(slopes, axis=0)
    output_loadings = np.divide(slopes, inner, out=np.zeros_like(slopes), where=inner > 0)
    return Pls(weights, weights, inner, output_loadings, scores)


@dataclass(frozen=True, eq=False)
class XyBlock:
    """Input and output block of one axis, recording by recording."""

    #: Features of every cell, (N_i, F), neither centred nor scaled.
    inputs: tuple[FloatArray, ...]
    #: Cells in which all outputs are observed, (N_i,), and what is observed, (N_i, M).
    valid: tuple[BoolArray, ...]
    observed: tuple[FloatArray, ...]
    #: Diagonal of W_y, (M,).
    output_weight: FloatArray


def identify(
    method: PaperMethod, data: AxisData, features: Features, orders: Orders
) -> tuple[ArxPls | None, tuple[str, ...]]:
    """
    Identify an axis by one of the paper's methods; None where the inputs explain nothing.

    Beside the model, sentences say what had to be mended. TooShortError is raised where an ARX
    does not find enough consecutive samples.
    """
    xy_block = _build_xy_block(data, features)
    if not any(valid.any() for valid in xy_block.valid):
        return None, ()
    if method == 'filtered_pls':
        return _filtered(xy_block, orders, data.period_s), ()
    mean, weight = _mean_and_weight(xy_block.inputs, xy_block.valid)
    fit = fit_pcr if method == 'pcr' else fit_pls
    x, y = _stack(xy_block, xy_block.inputs, weight)
    outer = fit(x, y, orders.latents)
    if not outer.latents:
        return None, ()
    notes: tuple[str, ...] = ()
    latents = tuple(static_gain(gain) for gain in outer.inner)
    if method == 'arx_pls':
        latents, notes = _inner_arx(xy_block, outer, mean, weight, orders)
    output_mean = np.zeros(len(xy_block.output_weight))
    output = outer.output_loadings, xy_block.output_weight, output_mean
    return ArxPls(mean, weight, outer.rotations, latents, *output), notes


def observe_drift(data: AxisData) -> list[FloatArray]:
    """
    Observe zero drift and, when there is load, sensitivity drift directly in r - w, (N_i, M).

    Sensitivity is a least-squares slope over windows of at most OBSERVATION_WINDOW_S that do not
    cross gaps: "coefficients recorded at discrete temperatures" (the paper's 3.2). Observations
    hold up to a constant of each recording, and are NaN where either is not known.
    """
    if data.load is None:
        return [residual[:, np.newaxis] for residual in data.residual]
    deviation = np.std(np.concatenate([w[np.isfinite(w)] for w in data.load]))
    return [
        _observe_windows(residual, load, data.period_s, _LOADED_SHARE * float(deviation))
        for residual, load in zip(data.residual, data.load, strict=True)
    ]


def _observe_windows(
    residual: FloatArray, load: FloatArray, period_s: float, min_deviation: float
) -> FloatArray:
    """Slope and zero drift of one recording, shape (N, 2)."""
    observed = np.full((len(residual), 2), np.nan)
    present = np.isfinite(residual) & np.isfinite(load)
    cells = max(round(OBSERVATION_WINDOW_S / period_s), 1)
    at = np.flatnonzero(present)
    parts = stretches(present, period_s)[at]
    starts = at[np.searchsorted(parts, parts)]  # first cell of the stretch that a cell is in
    # Windows count anew in each stretch, so none crosses a gap.
    windows = np.stack((parts, (at - starts) // cells))
    for window in np.unique(windows, axis=1).T:
        rows = at[(windows == window[:, np.newaxis]).all(axis=0)]
        w = load[rows] - load[rows].mean()
        if len(rows) > 2 and np.std(w) >= min_deviation:
            slope = float(w @ residual[rows] / (w @ w))
            observed[rows, 0] = residual[rows] - slope * load[rows]
            observed[rows, 1] = slope
    return observed


def _build_xy_block(data: AxisData, features: Features) -> XyBlock:
    """Expand the features and scale the observations."""
    observed = tuple(observe_drift(data))
    valid: tuple[BoolArray, ...] = tuple(np.all(np.isfinite(y), axis=1) for y in observed)
    centred = [
        y[rows] - y[rows].mean(axis=0)
        for y, rows in zip(observed, valid, strict=True)
        if rows.any()
    ]
    deviation = np.std(np.concatenate(centred), axis=0) if centred else np.ones(1)
    return XyBlock(
        inputs=tuple(features.expand(temperature_c) for temperature_c in data.temperature_c),
        valid=valid,
        observed=observed,
        output_weight=1.0 / np.where(deviation > 0, deviation, 1.0),
    )


def _mean_and_weight(
    inputs: Sequence[FloatArray], valid: Sequence[BoolArray]
) -> tuple[FloatArray, FloatArray]:
    """Mean and one over the deviation of the inputs, shapes (F,); weight 0 for constant ones."""
    rows = np.concatenate([x[keep] for x, keep in zip(inputs, valid, strict=True)])
    mean, deviation = rows.mean(axis=0), rows.std(axis=0)
    constant = deviation <= 1e-9 * np.abs(rows).max(axis=0)
    return mean, np.where(constant, 0.0, 1.0 / np.where(constant, 1.0, deviation))


def _stack(
    xy_block: XyBlock, inputs: Sequence[FloatArray], weight: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Stack all recordings, each centred by itself for its unknown offset: X, Y of eq. 3 and 5."""
    pairs = [
        (x[rows], y[rows])
        for x, y, rows in zip(inputs, xy_block.observed, xy_block.valid, strict=True)
        if rows.any()
    ]
    return (
        np.concatenate([x - x.mean(axis=0) for x, _ in pairs]) * weight,
        np.concatenate([y - y.mean(axis=0) for _, y in pairs]) * xy_block.output_weight,
    )


def _inner_arx(
    xy_block: XyBlock, outer: Pls, mean: FloatArray, weight: FloatArray, orders: Orders
) -> tuple[tuple[Arx, ...], tuple[str, ...]]:
    """Fit H_r of eq. 15 for every latent by eq. 22, and keep its poles inside the unit circle."""
    scores = [((x - mean) * weight) @ outer.rotations for x in xy_block.inputs]
    remaining = [y * xy_block.output_weight for y in xy_block.observed]
    latents: list[Arx] = []
    notes: list[str] = []
    for r in range(outer.latents):
        loading = outer.output_loadings[:, r]
        segments = [(t[:, r], f @ loading) for t, f in zip(scores, remaining, strict=True)]
        fitted = fit_one_step(segments, orders.outputs, orders.inputs, orders.first_lag)
        latent, moved = stabilise(fitted)
        if moved:
            radius = float(np.abs(fitted.poles).max())
            notes.append(
                f'latent {r + 1}: a pole of radius {radius:.6f} was moved inside the unit circle'
            )
        latents.append(latent)
        # F_r = F_{r-1} - û_r q_rᵀ (eq. 5), û_r by the free run so that the next latent sees it
        remaining = [
            f - np.outer(free_run(latent, t[:, r]), loading)
            for f, t in zip(remaining, scores, strict=True)
        ]
    return tuple(latents), tuple(notes)


def _filtered(xy_block: XyBlock, orders: Orders, period_s: float) -> ArxPls | None:
    """Put a bank of filters H before static PLS (eq. 11 to 14); as latents they run (eq. 15)."""
    bank = [relaxation(tau, period_s) for tau in orders.time_constants_s]
    banked = [
        np.concatenate([free_run(h, x) for h in bank], axis=1)  # Ẽ = H(E), eq. 11
        for x in xy_block.inputs
    ]
    _, weight = _mean_and_weight(banked, xy_block.valid)
    x, y = _stack(xy_block, banked, weight)
    outer = fit_pls(x, y, orders.latents)  # eq. 12
    if not outer.latents:
        return None
    # C (F·K, M) -> (K, F, M): gains of every filter, back in the units of the inputs
    gains = (weight[:, np.newaxis] * outer.coefficients).reshape(len(bank), -1, y.shape[1])
    mean, input_weight = _mean_and_weight(xy_block.inputs, xy_block.valid)
    return from_gains(bank, gains, mean, input_weight, xy_block.output_weight)
