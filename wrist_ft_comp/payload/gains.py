"""
First layer, for given states and weights: gains of specific force beside any slow drift.

A recording's raw wrench is r(t) = c + o(T) + a_k f(t) + contact + noise, a_k (A, 3) of payload
state k. All of o and c is taken out by a parabola for each block, so that neither temperatures nor
tares have to be understood before payloads are, and what is left are contrasts between poses,
which only payloads and contacts make.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from wrist_ft_comp.payload.cells import Cells, POWERS
from wrist_ft_comp.payload.rigid_body import (
    blocks,
    information,
    rigid_bodies,
    RigidBodies,
)
from wrist_ft_comp.signals import BoolArray, FloatArray, IntArray

#: A cell is not known better than to this share of the wrench, or nothing else would count.
_NOISELESS = 1e-4
#: Contrasts of the specific force below this tell no gain, m/s².
_SAYS_NOTHING = 0.001
#: A contrast between poses of so many times the noise is one.
_STANDS_OUT = 10.0
#: A cell counts for drift where its weight is above this.
COUNTS = 0.5
#: This share of cells is taken to be free of contact; a norm per axis of normal variables there.
_QUIETER, _QUIETER_NORM = 0.3, 0.80
#: … and a difference of two of them; cells are louder than their differences by this at most, or
#: contacts would be taken for noise.
_QUIETER_STEP, _LOUDEST = 0.545, 4.0


@dataclass(frozen=True, eq=False)
class Fit:
    """Payload states of cells."""

    #: Of specific force, kg and kg m, (K, 3, A).
    gains: FloatArray
    #: Which one holds in a cell, and its robust weight, (n, B).
    states: IntArray
    weights: FloatArray
    #: The parabolas, (n, B, A).
    levels: FloatArray
    #: σ of a cell that is not in contact, N and N m, (A,).
    noise: FloatArray


def solve(cells: Cells, states: IntArray, weights: FloatArray, count: int) -> FloatArray:
    """Fit gains (K, 3, A) to weighted cells, parabolas eliminated."""
    size = 3 * count
    z = np.concatenate((_by_state(cells, states, count), cells.wrench), axis=2)
    normal = _eliminated(z, weights, cells.powers)
    gram = normal[:size, :size]
    ridge = (_SAYS_NOTHING**2 * weights.sum() + 1e-30) * np.eye(size)
    return np.linalg.solve(gram + ridge, normal[:size, size:]).reshape(count, 3, cells.axes)


def _by_state(cells: Cells, states: IntArray, count: int) -> FloatArray:
    """Specific force in the columns of the state that holds, zero in the others, (n, B, 3K)."""
    chosen = (states[..., None] == np.arange(count))[..., None] * cells.force[:, :, None]
    return np.asarray(chosen.reshape(*states.shape, 3 * count))


@lru_cache(maxsize=8)
def _parabolas(cells: int, powers: int) -> tuple[FloatArray, FloatArray]:
    """Draw Legendre polynomials over a block, (B, P), and their products, (B, P²)."""
    share = (np.arange(cells) + 0.5) / cells * 2 - 1
    phi = np.asarray(np.polynomial.legendre.legvander(share, powers - 1), dtype=float)
    return phi, (phi[:, :, None] * phi[:, None]).reshape(cells, -1)


def _normal(weights: FloatArray, powers: int) -> FloatArray:
    """Sum weighted products of the polynomials over every block, (n, P, P)."""
    _, products = _parabolas(weights.shape[1], powers)
    return np.asarray((weights @ products).reshape(-1, powers, powers))


def _eliminated(z: FloatArray, weights: FloatArray, powers: int) -> FloatArray:
    """Sum products of columns over blocks, parabolas eliminated in each."""
    phi, _ = _parabolas(z.shape[1], powers)
    weighted = weights[..., None] * z
    crossed = phi.T @ weighted
    inner = _normal(weights, powers) + 1e-9 * np.eye(powers)
    own = np.einsum('nbi,nbj->ij', weighted, z, optimize=True)
    taken = np.einsum('npi,npj->ij', crossed, np.linalg.solve(inner, crossed))
    return np.asarray(own - taken)


def leveled(values: FloatArray, weights: FloatArray, powers: int = POWERS) -> FloatArray:
    """Fit parabolas, or constants by one power, to weighted values (n, B, A), and draw them."""
    phi, _ = _parabolas(values.shape[1], powers)
    inner = _normal(weights, powers) + 1e-6 * np.eye(powers)
    return np.asarray(phi @ np.linalg.solve(inner, phi.T @ (weights[..., None] * values)))


def held(each: Sequence[FloatArray], states: IntArray) -> FloatArray:
    """Choose what belongs to the state that holds in a cell, (n, B, A)."""
    chosen = each[0]
    for state, values in enumerate(each[1:], 1):
        chosen = np.where((states == state)[..., None], values, chosen)
    return chosen


def weight_of(cells: Cells, fit: Fit) -> FloatArray:
    """Weigh every cell's payload, (n, B, A)."""
    return held([cells.force @ gains for gains in fit.gains], fit.states)


def rescaled(cells: Cells, fit: Fit) -> Fit:
    """Estimate the noise of a cell from those that count, and from the quieter ones of all."""
    rest = cells.wrench - fit.levels - weight_of(cells, fit)
    square = np.einsum('nb,nbi->i', fit.weights, rest**2) / max(fit.weights.sum(), 1e-9)
    least = _NOISELESS * np.sqrt(np.mean(cells.wrench**2, axis=(0, 1))) + 1e-15
    square = square + least**2
    norm = np.sqrt(np.sum(rest**2 / square, axis=2) / cells.axes)[cells.usable]
    noise = np.sqrt(square) * np.quantile(norm, _QUIETER) / _QUIETER_NORM
    noise = np.minimum(noise, _LOUDEST * _neighbours_noise(cells, rest))
    return replace(fit, noise=np.maximum(noise, least))


def _neighbours_noise(cells: Cells, rest: FloatArray) -> FloatArray:
    """Estimate the noise by the quieter differences of neighbours, which no level spoils, (A,)."""
    pairs = cells.usable[:, 1:] & cells.usable[:, :-1]
    steps = np.abs(np.diff(rest, axis=1))[pairs]
    if not len(steps):  # every other cell may turn too fast
        return np.full(cells.axes, np.inf)
    return np.asarray(np.quantile(steps, _QUIETER, axis=0) / _QUIETER_STEP)


def bodies_of(cells: Cells, fit: Fit, scale: FloatArray | None = None) -> RigidBodies:
    """Find the rigid bodies behind gains of six axes; scale is the accelerometer's, (3, 3)."""
    parts = _by_state(cells, fit.states, len(fit.gains)), cells.wrench - weight_of(cells, fit)
    contrast, rest = (each - leveled(each, fit.weights, cells.powers) for each in parts)
    # Errors are told by the scatter of at least twelve blocks.
    length = -(-cells.usable.shape[1] // -(-12 // len(cells.usable)))
    pieces = (
        blocks(each.reshape(-1, *each.shape[2:]), length) for each in (contrast, rest, fit.weights)
    )
    return rigid_bodies(fit.gains, *information(*pieces), float(fit.weights.sum()), scale)


def contrast(cells: Cells, weights: FloatArray) -> float:
    """Tell the RMS of what changes of the specific force within blocks, m/s²."""
    moved = cells.force - leveled(cells.force, weights, cells.powers)
    total = np.einsum('nb,nbi->', weights, moved**2)
    return float(np.sqrt(total / max(weights.sum(), 1e-9)))


def unexplained_contrast(cells: Cells, fit: Fit) -> float:
    """Share of the contrast between poses that no payload makes, in the median block."""
    middle = np.median(cells.wrench, axis=1, keepdims=True)
    rest = cells.wrench - fit.levels - weight_of(cells, fit)
    blocks = cells.usable.mean(axis=1) > 0.3
    if not blocks.any():
        return 0.0
    left, there = (
        _median_norm(each[blocks] / fit.noise, cells.usable[blocks])
        for each in (rest, cells.wrench - middle)
    )
    # Of what does not stand out of the noise, nothing is to be explained.
    return float(np.median(left / np.maximum(there, _STANDS_OUT * np.sqrt(cells.axes))))


def _median_norm(values: FloatArray, usable: BoolArray) -> FloatArray:
    """Median over the usable cells of every block, (n,)."""
    norm = np.linalg.norm(values, axis=2)
    return np.asarray(np.nanmedian(np.where(usable, norm, np.nan), axis=1))
