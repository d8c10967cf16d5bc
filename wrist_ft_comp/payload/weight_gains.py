"""
Gains of specific force beside any slow drift, for given payload states, in blocks of cells.

A recording's raw wrench is r(t) = c + o(T) + a_k f(t) + contact + noise, with the gains a_k (A, 3)
of payload state k. One parabola per block, its level, stands for o and c together, so that neither
temperatures nor tares have to be understood before the payloads are. What remains are differences
between poses, which only payloads and contacts make. ``payload_states`` finds every cell's state.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfinv, gammaincinv

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.payload.mass_and_center import blocks, information, rigid_bodies, RigidBodies
from wrist_ft_comp.payload.specific_force_motion import rotation_speed
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import BoolArray, FloatArray, IntArray

#: Length of a block, s, in which a parabola follows the drift.
BLOCK_S = 300.0
#: Length of a block, s, where the drift is roughly known already. A parabola of 300 s would follow
#: a press of two minutes, too.
LONG_BLOCK_S = 900.0
#: Coefficients of the polynomial that is the level of a block: a parabola.
POWERS = 3
#: Ten cells for each coefficient: along 10 cells, a parabola fits cells in contact as well as free
#: ones. Blocks are longer for that where cells are longer than 10 s.
LEAST_CELLS_IN_BLOCK = 10 * POWERS
#: Cells that turn faster, rad/s, are left out: the payload's ω×(ω×c) is not measured. It is 0.1 N
#: here at 2 kg and 0.1 m. At 0.5 too few cells of 10 s remain; at 1.0 as much drift is left.
FASTEST = 0.7
#: A cell whose robust weight is larger is free of contact, and counts for the drift.
COUNTS = 0.5
#: A stretch with a smaller share of usable cells is left out: one contact would look like its
#: level.
LEAST_USABLE_SHARE = 0.2
#: This share of the cells, the quietest ones, are taken to be free of contact. With contacts in
#: 15 % of the time, half of the cells of 10 s are free; a share of 0.3 took contact for noise.
_QUIET_SHARE = 0.2
#: The noise of cells is at most this many times the noise of differences between neighbours: what
#: is larger is contact, or a specific force that is not the sensor's.
_MOST_NOISE_RATIO = 4.0
#: Least noise, as a share of the wrench's RMS. Without it, an axis without noise would decide all.
_LEAST_NOISE_SHARE = 1e-4
#: Ridge on the gains, m/s²: smaller changes of the specific force do not determine a gain.
_RIDGE = 0.001
#: Differences between poses need an explanation from this many standard deviations on.
_SIGNIFICANT_SIGMA = 10.0


def cells_in(duration_s: float, period_s: float) -> int:
    """Count the thermal cells in a duration, at least one; all windows here are in seconds."""
    return max(1, round(duration_s / period_s))


@dataclass(frozen=True, eq=False)
class Cells:
    """All recordings in n blocks of up to B cells, filled up with unusable cells."""

    #: Raw wrench of A axes, N and N m, shape (n, B, A).
    wrench: FloatArray
    #: Specific force, m/s², shape (n, B, 3).
    force: FloatArray
    #: Whether a cell holds both and does not turn fast, shape (n, B).
    usable: BoolArray
    #: Number of cells of every piece that was cut into blocks, per recording.
    pieces: Sequence[Sequence[int]] = ()
    #: Coefficients of a block's level; 1, a constant, where the drift was taken off before.
    powers: int = POWERS

    def part(self, chosen: IntArray) -> 'Cells':
        """Choose blocks."""
        return Cells(
            self.wrench[chosen], self.force[chosen], self.usable[chosen], powers=self.powers
        )

    def cut(self, parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
        """Cut arrays, one per recording, into the same blocks as these."""
        return _cut(parts, self.pieces, self.usable.shape[1])

    def join(self, blocked: NDArray[Any]) -> list[NDArray[Any]]:
        """Put the blocks of an array together again: one array per recording."""
        parts, first = [], 0
        for sizes in self.pieces:
            joined = []
            for size in sizes:
                length = _block_length(size, self.usable.shape[1])
                count = -(-size // length)
                piece = blocked[first : first + count, :length].reshape(-1, *blocked.shape[2:])
                joined.append(piece[:size])
                first += count
            parts.append(np.concatenate(joined))
        return parts

    @property
    def axes(self) -> int:
        """Number of axes, A."""
        return self.wrench.shape[2]


@dataclass(frozen=True, eq=False)
class Fit:
    """K payload states, and which of them every cell is in."""

    #: Gains of specific force, kg and kg m, shape (K, 3, A).
    gains: FloatArray
    #: State of every cell, shape (n, B).
    states: IntArray
    #: Robust weight of every cell, shape (n, B); near 0 in contact.
    weights: FloatArray
    #: Level of every cell, N and N m, shape (n, B, A).
    levels: FloatArray
    #: Standard deviation of a cell without contact, N and N m, shape (A,).
    noise: FloatArray


def axes_of(recordings: Sequence[Recording]) -> list[int]:
    """List the columns of the wrench that every recording holds."""
    return [n for n, axis in enumerate(AXES) if all(axis in r.axes_present for r in recordings)]


def cut(
    recordings: Sequence[Recording],
    forces: Sequence[FloatArray],
    ends: Sequence[Sequence[int]] | None = None,
    block_s: float = BLOCK_S,
) -> Cells:
    """
    Cut recordings into blocks of ``block_s``, s; a block also ends at each of the cells ``ends``.

    Specific forces, (N, 3) per recording, are those of the calibrated accelerometer.
    """
    length = max(LEAST_CELLS_IN_BLOCK, cells_in(block_s, recordings[0].period_s))
    pieces = [
        np.diff([0, *sorted(cells), len(recording)]).tolist()
        for recording, cells in zip(recordings, ends or [()] * len(recordings), strict=True)
    ]
    axes = axes_of(recordings)
    wrenches, usable_forces, usables = [], [], []
    for recording, force in zip(recordings, forces, strict=True):
        wrench = recording.wrench[:, axes]
        usable = np.isfinite(wrench).all(axis=1) & np.isfinite(force).all(axis=1)
        usable &= rotation_speed(recording) < FASTEST
        wrenches.append(np.where(usable[:, None], wrench, 0))
        usable_forces.append(np.where(usable[:, None], force, 0))
        usables.append(usable)
    parts = wrenches, usable_forces, usables
    wrench, force, usable = (_cut(part, pieces, length) for part in parts)
    dense = usable.mean(axis=1, keepdims=True) >= LEAST_USABLE_SHARE
    return Cells(wrench, force, usable & dense, pieces)


def _cut(
    parts: Sequence[NDArray[Any]], pieces: Sequence[Sequence[int]], length: int
) -> NDArray[Any]:
    """Cut arrays into pieces of the given sizes, and every piece into equal blocks."""
    cuts = chain.from_iterable(
        np.split(part, np.cumsum(sizes)[:-1]) for part, sizes in zip(parts, pieces, strict=True)
    )
    filled = []
    for piece in cuts:
        equal = blocks(piece, _block_length(len(piece), length))
        widths = [(0, 0), (0, length - equal.shape[1]), *[(0, 0)] * (equal.ndim - 2)]
        filled.append(np.pad(equal, widths))
    return np.concatenate(filled)


def _block_length(size: int, longest: int) -> int:
    """Choose the length of equal blocks: a contact may fill a short one at the end of a piece."""
    count = max(1, -(-size // longest))
    return max(1, -(-size // count))


def solve(cells: Cells, states: IntArray, weights: FloatArray, count: int) -> FloatArray:
    """Fit the gains, (K, 3, A), of ``count`` states to weighted cells, levels eliminated."""
    size = 3 * count
    columns = np.concatenate((_by_state(cells, states, count), cells.wrench), axis=2)
    weighted = weights[..., None] * columns
    phi, inner = _level_equations(weights, cells.powers)
    crossed = phi.T @ weighted
    # Products of the columns over all blocks, less what the levels explain of them.
    normal = np.einsum('nbi,nbj->ij', weighted, columns, optimize=True)
    normal -= np.einsum('npi,npj->ij', crossed, np.linalg.solve(inner, crossed))
    ridge = (_RIDGE**2 * weights.sum() + 1e-30) * np.eye(size)
    gains = np.linalg.solve(normal[:size, :size] + ridge, normal[:size, size:])
    return gains.reshape(count, 3, cells.axes)


def _by_state(cells: Cells, states: IntArray, count: int) -> FloatArray:
    """Put every cell's specific force in the three columns of its state, (n, B, 3K)."""
    chosen = (states[..., None] == np.arange(count))[..., None] * cells.force[:, :, None]
    return np.asarray(chosen.reshape(*states.shape, 3 * count))


def fitted_levels(values: FloatArray, weights: FloatArray, powers: int = POWERS) -> FloatArray:
    """Fit the levels of blocks, polynomials of P powers, to weighted values; both (n, B, A)."""
    phi, inner = _level_equations(weights, powers)
    return np.asarray(phi @ np.linalg.solve(inner, phi.T @ (weights[..., None] * values)))


def _level_equations(weights: FloatArray, powers: int) -> tuple[FloatArray, FloatArray]:
    """Compute the polynomials of a level, (B, P), and their weighted products, (n, P, P)."""
    phi, products = _polynomials(weights.shape[1], powers)
    inner = (weights @ products).reshape(-1, powers, powers)
    return phi, inner + 1e-8 * np.eye(powers)  # a block without weights has a level of 0


@lru_cache(maxsize=8)
def _polynomials(cells: int, powers: int) -> tuple[FloatArray, FloatArray]:
    """Compute the Legendre polynomials of a block, (B, P), and their products, (B, P²)."""
    share = (np.arange(cells) + 0.5) / cells * 2 - 1
    phi = np.asarray(np.polynomial.legendre.legvander(share, powers - 1), dtype=float)
    return phi, (phi[:, :, None] * phi[:, None]).reshape(cells, -1)


def medians(values: FloatArray) -> FloatArray:
    """
    Compute the medians, (n, A), of finite values, (n, B, A); 0 where none is finite.

    That is numpy's nanmedian, but quicker. A cell is NaN in all axes or in none.
    """
    count = np.isfinite(values[..., 0]).sum(axis=1)
    block, values = np.arange(len(values)), np.sort(values, axis=1)
    middle = values[block, np.maximum(count - 1, 0) // 2] + values[block, count // 2]
    return np.asarray(np.where(count[:, None] > 0, middle / 2, 0.0))


def of_state(by_state: Sequence[FloatArray] | FloatArray, states: IntArray) -> FloatArray:
    """Take every cell's values from those of its state, (n, B, A) or (N, A)."""
    chosen = by_state[0]
    for state, values in enumerate(by_state[1:], 1):
        chosen = np.where((states == state)[..., None], values, chosen)
    return chosen


def payload_wrench(cells: Cells, fit: Fit) -> FloatArray:
    """Compute what every cell's payload weighs, N and N m, (n, B, A)."""
    return of_state([cells.force @ gains for gains in fit.gains], fit.states)


def with_new_noise(cells: Cells, fit: Fit) -> Fit:
    """
    Estimate the noise of a cell again.

    The proportions of the axes come from cells free of contact, the scale from the quietest cells.
    """
    residual = cells.wrench - fit.levels - payload_wrench(cells, fit)
    square = np.einsum('nb,nbi->i', fit.weights, residual**2) / max(fit.weights.sum(), 1e-9)
    least = _LEAST_NOISE_SHARE * np.sqrt(np.mean(cells.wrench**2, axis=(0, 1))) + 1e-15
    square = square + least**2
    norm = np.sqrt(np.sum(residual**2 / square, axis=2) / cells.axes)[cells.usable]
    # The norm of standard normal variables, per axis, at the same quantile (of a χ² distribution).
    expected = np.sqrt(2 * gammaincinv(cells.axes / 2, _QUIET_SHARE) / cells.axes)
    noise = np.sqrt(square) * np.quantile(norm, _QUIET_SHARE) / expected
    neighbours = cells.usable[:, 1:] & cells.usable[:, :-1]
    if neighbours.any():  # every second cell may turn too fast
        differences = np.abs(np.diff(residual, axis=1))[neighbours]
        quiet = np.quantile(differences, _QUIET_SHARE, axis=0) / (2 * erfinv(_QUIET_SHARE))
        noise = np.minimum(noise, _MOST_NOISE_RATIO * quiet)
    return replace(fit, noise=np.maximum(noise, least))


def bodies_of(cells: Cells, fit: Fit, scale: FloatArray | None = None) -> RigidBodies:
    """
    Fit rigid bodies to the gains of six axes.

    ``scale`` is the covariance of the accelerometer's scale, (3, 3), relative.
    """
    parts = _by_state(cells, fit.states, len(fit.gains)), cells.wrench - payload_wrench(cells, fit)
    moved, residual = (part - fitted_levels(part, fit.weights, cells.powers) for part in parts)
    # Standard errors come from the scatter of at least twelve blocks.
    length = -(-cells.usable.shape[1] // -(-12 // len(cells.usable)))
    pieces = (
        blocks(part.reshape(-1, *part.shape[2:]), length)
        for part in (moved, residual, fit.weights)
    )
    return rigid_bodies(fit.gains, *information(*pieces), float(fit.weights.sum()), scale)


def contrast(cells: Cells, weights: FloatArray) -> float:
    """Compute how far the specific force moves within blocks, RMS, m/s²."""
    moved = cells.force - fitted_levels(cells.force, weights, cells.powers)
    total = np.einsum('nb,nbi->', weights, moved**2)
    return float(np.sqrt(total / max(weights.sum(), 1e-9)))


def unexplained_contrast(cells: Cells, fit: Fit) -> float:
    """Share of the differences between poses that no payload explains, in the median block."""
    used = cells.usable.any(axis=1)
    if not used.any():
        return 0.0
    middle = np.median(cells.wrench, axis=1, keepdims=True)
    unexplained, whole = (
        np.linalg.norm(values[used] / fit.noise, axis=2)
        for values in (
            cells.wrench - fit.levels - payload_wrench(cells, fit),
            cells.wrench - middle,
        )
    )
    unexplained, whole = (
        np.nanmedian(np.where(cells.usable[used], norm, np.nan), axis=1)
        for norm in (unexplained, whole)
    )
    least = _SIGNIFICANT_SIGMA * np.sqrt(cells.axes)
    return float(np.median(unexplained / np.maximum(whole, least)))
