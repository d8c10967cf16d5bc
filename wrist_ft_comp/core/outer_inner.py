"""
The two-step methods: an outer model between observed blocks, then an inner model per latent.

``pcr`` and ``pls`` are static (eq. 3 to 10), ``filtered_pls`` puts a dynamic filter before static
PLS (eq. 11 to 14, Kaspar and Ray), ``arx_pls`` is the paper literally: PLS, then least-squares ARX
per latent (eq. 15 to 22).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from wrist_ft_comp import SettingsError
from wrist_ft_comp.core.arx import Arx, fit_one_step, free_run, relaxation, stabilise, static_gain
from wrist_ft_comp.core.arx_pls import ArxPls
from wrist_ft_comp.core.features import Features
from wrist_ft_comp.core.observation import observe_drift
from wrist_ft_comp.core.pls import fit_pcr, fit_pls, Pls
from wrist_ft_comp.core.problem import AxisProblem
from wrist_ft_comp.core.ranges import check_range
from wrist_ft_comp.core.recording import BoolArray, FloatArray

OuterInnerMethod = Literal['pcr', 'pls', 'filtered_pls', 'arx_pls']


@dataclass(frozen=True)
class Orders:
    """
    Pre-determined orders (the paper's last sentence of section 3).

    Attributes
    ----------
    latents : int
        R.
    outputs, inputs : int
        n and m of eq. 20, for arx_pls.
    first_lag : int
        g: d + 1 of eq. 20, or d with a direct term; cells.
    time_constants_s : tuple of float
        Filters before PLS, s, for filtered_pls; 0 passes the input as it is.

    """

    latents: int = 2
    outputs: int = 2
    inputs: int = 2
    first_lag: int = 1
    time_constants_s: tuple[float, ...] = (0.0, 30.0, 100.0, 300.0, 1000.0, 3000.0)

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name, least in (('latents', 1), ('outputs', 0), ('inputs', 1), ('first_lag', 0)):
            check_range(name, getattr(self, name), least)
        if not self.time_constants_s:
            raise SettingsError('time_constants_s must hold at least one filter; got none.')
        for tau in self.time_constants_s:
            check_range('Each of time_constants_s', tau, 0.0)


@dataclass(frozen=True, eq=False)
class Blocks:
    """
    Input and output block of one axis, scaled, and centred within each recording.

    Attributes
    ----------
    features : Features
        What made the inputs.
    inputs : tuple of ndarrays, shape (N_i, F)
        Features of every cell, not centred and not scaled.
    valid : tuple of ndarrays of bool, shape (N_i,)
        Cells with an observation.
    observed : tuple of ndarrays, shape (N_i, M)
        From observe_drift.
    output_weight : ndarray, shape (M,)
        Diagonal of W_y.

    """

    features: Features
    inputs: tuple[FloatArray, ...]
    valid: tuple[BoolArray, ...]
    observed: tuple[FloatArray, ...]
    output_weight: FloatArray


def identify(
    method: OuterInnerMethod, problem: AxisProblem, features: Features, orders: Orders
) -> tuple[ArxPls | None, tuple[str, ...]]:
    """
    Identify one axis by a two-step method.

    Parameters
    ----------
    method : {'pcr', 'pls', 'filtered_pls', 'arx_pls'}
        Which.
    problem : AxisProblem
        Drift observations.
    features : Features
        The model's inputs.
    orders : Orders
        Structure.

    Returns
    -------
    tuple of ArxPls or None, and tuple of str
        The model (None when the inputs explain nothing), and what had to be mended, in sentences.

    """
    blocks = _build_blocks(problem, features)
    if not any(valid.any() for valid in blocks.valid):
        return None, ()
    if method == 'filtered_pls':
        return _filtered(blocks, orders, problem.period_s), ()
    mean, weight = _moments(blocks.inputs, blocks.valid)
    fit = fit_pcr if method == 'pcr' else fit_pls
    x, y = _stack(blocks, blocks.inputs, weight)
    outer = fit(x, y, orders.latents)
    if not outer.latents:
        return None, ()
    notes: tuple[str, ...] = ()
    latents = tuple(static_gain(gain) for gain in outer.inner)
    if method == 'arx_pls':
        latents, notes = _inner_arx(blocks, outer, mean, weight, orders)
    model = ArxPls(
        input_mean=mean,
        input_weight=weight,
        rotations=outer.rotations,
        latents=latents,
        output_loadings=outer.output_loadings,
        output_weight=blocks.output_weight,
        output_mean=np.zeros(len(blocks.output_weight)),
    )
    return model, notes


def _build_blocks(problem: AxisProblem, features: Features) -> Blocks:
    """Expand the features and scale the observations."""
    observed = tuple(observe_drift(problem))
    valid: tuple[BoolArray, ...] = tuple(np.all(np.isfinite(y), axis=1) for y in observed)
    centred = [
        y[rows] - y[rows].mean(axis=0)
        for y, rows in zip(observed, valid, strict=True)
        if rows.any()
    ]
    deviation = np.std(np.concatenate(centred), axis=0) if centred else np.ones(1)
    return Blocks(
        features=features,
        inputs=tuple(features.expand(temperature_c) for temperature_c in problem.temperature_c),
        valid=valid,
        observed=observed,
        output_weight=1.0 / np.where(deviation > 0, deviation, 1.0),
    )


def _moments(
    inputs: Sequence[FloatArray], valid: Sequence[BoolArray]
) -> tuple[FloatArray, FloatArray]:
    """Mean and one over the deviation of the inputs, shapes (F,); weight 0 for constant ones."""
    rows = np.concatenate([x[keep] for x, keep in zip(inputs, valid, strict=True)])
    mean, deviation = rows.mean(axis=0), rows.std(axis=0)
    constant = deviation <= 1e-9 * np.abs(rows).max(axis=0)
    return mean, np.where(constant, 0.0, 1.0 / np.where(constant, 1.0, deviation))


def _stack(
    blocks: Blocks, inputs: Sequence[FloatArray], weight: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """
    Stack all recordings, each centred by itself: its constant offset is unknown.

    Returns
    -------
    tuple of ndarrays, shapes (N, F) and (N, M)
        X and Y of eq. 3 and 5.

    """
    pairs = [
        (x[rows], y[rows])
        for x, y, rows in zip(inputs, blocks.observed, blocks.valid, strict=True)
        if rows.any()
    ]
    return (
        np.concatenate([x - x.mean(axis=0) for x, _ in pairs]) * weight,
        np.concatenate([y - y.mean(axis=0) for _, y in pairs]) * blocks.output_weight,
    )


def _inner_arx(
    blocks: Blocks, outer: Pls, mean: FloatArray, weight: FloatArray, orders: Orders
) -> tuple[tuple[Arx, ...], tuple[str, ...]]:
    """Fit H_r of eq. 15 for every latent by eq. 22, and keep its poles inside the unit circle."""
    scores = [((x - mean) * weight) @ outer.rotations for x in blocks.inputs]
    remaining = [y * blocks.output_weight for y in blocks.observed]
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


def _filtered(blocks: Blocks, orders: Orders, period_s: float) -> ArxPls | None:
    """
    Put a bank of filters H before static PLS (eq. 11 to 14).

    Each filtered input is a column of the block E of eq. 12. The regression matrix of every filter
    then becomes latents of that filter (eq. 15), so the model runs like any other.
    """
    bank = [relaxation(tau, period_s) for tau in orders.time_constants_s]
    banked = [
        np.concatenate([free_run(h, x) for h in bank], axis=1)  # Ẽ = H(E), eq. 11
        for x in blocks.inputs
    ]
    _, weight = _moments(banked, blocks.valid)
    x, y = _stack(blocks, banked, weight)
    outer = fit_pls(x, y, orders.latents)  # eq. 12
    if not outer.latents:
        return None
    # C (F·K, M) -> (K, F, M): gains of every filter, back in the units of the inputs
    gains = (weight[:, np.newaxis] * outer.coefficients).reshape(len(bank), -1, y.shape[1])
    mean, input_weight = _moments(blocks.inputs, blocks.valid)
    return from_gains(bank, gains, mean, input_weight, blocks.output_weight)


def from_gains(
    bank: Sequence[Arx],
    gains: FloatArray,
    input_mean: FloatArray,
    input_weight: FloatArray,
    output_weight: FloatArray,
) -> ArxPls | None:
    """
    Write a sum of filtered linear maps as an ARX-PLS model, exactly (eq. 15).

    y ∘ W_y = Σ_k G_kᵀ H_k(x): the singular vectors of W_x⁻¹ G_k are latents with the dynamics H_k.

    Parameters
    ----------
    bank : sequence of K Arx
        H_k, with static gain 1.
    gains : ndarray, shape (K, F, M)
        G_k, from inputs in their own unit to outputs times output_weight.
    input_mean, input_weight : ndarray, shape (F,)
        x̄ and diagonal of W_x of the model; inputs of weight 0 must have no gain.
    output_weight : ndarray, shape (M,)
        Diagonal of W_y.

    Returns
    -------
    ArxPls or None
        With zero output mean; None when all gains are zero.

    """
    rotations: list[FloatArray] = []
    loadings: list[FloatArray] = []
    latents: list[Arx] = []
    scale = np.where(input_weight > 0, input_weight, 1.0)
    for dynamics, gain in zip(bank, gains, strict=True):
        # Shapes: (F, M) into (F, R_k), (R_k, R_k) and (R_k, M).
        left, singular, right = np.linalg.svd(gain / scale[:, np.newaxis], full_matrices=False)
        for r in np.flatnonzero(singular > 1e-12 * max(singular[0], 1e-300)):
            rotations.append(left[:, r])
            loadings.append(singular[r] * right[r])
            latents.append(dynamics)
    if not latents:
        return None
    return ArxPls(
        input_mean=input_mean,
        input_weight=input_weight,
        rotations=np.stack(rotations, axis=1),
        latents=tuple(latents),
        output_loadings=np.stack(loadings, axis=1),
        output_weight=output_weight,
        output_mean=np.zeros(len(output_weight)),
    )
