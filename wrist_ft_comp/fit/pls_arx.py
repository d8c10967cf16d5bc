"""
The paper's methods: an outer model between observed blocks, then an inner model per latent.

``pcr`` and ``pls`` are static (eq. 3 to 10), ``filtered_pls`` puts a dynamic filter before static
PLS (eq. 11 to 14, Kaspar and Ray), ``arx_pls`` is the paper literally: PLS, then least-squares ARX
per latent (eq. 15 to 22).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from wrist_ft_comp.drift.arx import (
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
from wrist_ft_comp.fit.pls import fit_pcr, fit_pls, Pls
from wrist_ft_comp.signals import BoolArray, FloatArray, stretches

#: Longest stretch of constant sensitivity assumed when it is observed directly, s.
OBSERVATION_WINDOW_S = 300.0

PaperMethod = Literal['pcr', 'pls', 'filtered_pls', 'arx_pls']


@dataclass(frozen=True, eq=False)
class XyBlock:
    """Input and output block of one axis, recording by recording."""

    # Features of every cell, (N_i, F), neither centred nor scaled; what is observed of the
    # outputs, (N_i, M), and where; and the diagonal of W_y.

    inputs: tuple[FloatArray, ...]
    valid: tuple[BoolArray, ...]
    observed: tuple[FloatArray, ...]
    output_weight: FloatArray


def identify(
    method: PaperMethod, data: AxisData, features: Features, orders: Orders
) -> tuple[ArxPls | None, tuple[str, ...]]:
    """Identify an axis by one of the paper's methods; None where inputs explain nothing."""
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
    known = outer.output_loadings, xy_block.output_weight, output_mean
    return ArxPls(mean, weight, outer.rotations, latents, *known), notes


def observe_drift(data: AxisData) -> list[FloatArray]:
    """Observe zero drift and, when there is load, sensitivity drift directly in r - w."""
    # Sensitivity is a least-squares slope over windows of at most OBSERVATION_WINDOW_S that do not
    # cross gaps: "coefficients recorded at discrete temperatures" (the paper's 3.2). Shapes (N_i,
    # M), up to a constant; NaN where either is not known.
    if data.load is None:
        return [residual[:, np.newaxis] for residual in data.residual]
    deviation = np.std(np.concatenate([w[np.isfinite(w)] for w in data.load]))
    return [
        _observe_windows(residual, load, data.period_s, 0.2 * float(deviation))
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
    starts = at[np.searchsorted(parts, parts)]  # first sample of each one's stretch
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
