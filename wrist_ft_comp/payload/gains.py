"""
Blocks of thermal cells, and gains of specific force beside any slow drift, for given states.

A recording's raw wrench is r(t) = c + o(T) + a_k f(t) + contact + noise, a_k (A, 3) of payload
state k. All of o and c is taken out by a parabola for each block, so that neither temperatures nor
tares have to be understood before payloads are, and what is left are contrasts between poses,
which only payloads and contacts make. Which state holds in a cell is found in ``states``.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrist_ft_comp.payload.directions import rotation_speed
from wrist_ft_comp.payload.rigid_body import blocks, information, rigid_bodies, RigidBodies
from wrist_ft_comp.signals import AXES, BoolArray, FloatArray, IntArray, Recording

#: Length of a block, s, in which a parabola follows the drift.
BLOCK_S = 300.0
#: Length of a block, s, where the drift is about known: a parabola of 300 s follows a press of two
#: minutes, too.
LONG_BLOCK_S = 900.0
#: Coefficients of the polynomial that is a block's level: a parabola follows the drift.
POWERS = 3
#: Cells that turn faster, rad/s, are left out: ω×(ω×c) of the payload is not measured.
FASTEST = 0.5
#: Weight of a cell above which it counts for drift.
COUNTS = 0.5
#: Fewest cells of a block.
_FEWEST_IN_BLOCK = 30
#: Share of usable cells below which a block is left out: a contact would look like its level.
_SPARSE = 0.2
#: Share of the wrench, RMS, below which the noise is never taken to be, or it alone would count.
_NOISELESS = 1e-4
#: Contrasts of the specific force below this, m/s², tell no gain.
_NO_CONTRAST = 0.001
#: Contrasts between poses below this, in units of the noise, need no explanation.
_STANDS_OUT = 10.0
#: Share of cells, the quietest ones, that is taken to be free of contact …
_QUIET_SHARE = 0.3
#: … the norm per axis of six normal variables at that quantile …
_QUIET_NORM = 0.80
#: … and the size of a difference of two normal variables at that quantile.
_QUIET_DIFFERENCE = 0.545
#: Cells are at most so much noisier than their differences say: contacts are no noise.
_LOUDEST = 4.0


@dataclass(frozen=True, eq=False)
class Cells:
    """All recordings in n blocks of B cells, filled up with cells that are not usable."""

    #: Raw wrench of A axes, N and N m, (n, B, A), and specific force, m/s², (n, B, 3).
    wrench: FloatArray
    force: FloatArray
    #: Whether both are known and the sensor does not turn fast, (n, B).
    usable: BoolArray
    #: Cells of each piece that was cut into blocks, by recording.
    pieces: Sequence[Sequence[int]] = ()
    #: Coefficients of a block's level; one where the drift is off already.
    powers: int = POWERS

    def part(self, chosen: IntArray) -> 'Cells':
        """Choose blocks."""
        return Cells(
            self.wrench[chosen], self.force[chosen], self.usable[chosen], powers=self.powers
        )

    def cut(self, parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
        """Cut arrays, one per recording, into the same blocks."""
        return _cut(parts, self.pieces, self.usable.shape[1])

    def join(self, blocked: NDArray[Any]) -> list[NDArray[Any]]:
        """Undo the cutting of an array: one per recording."""
        parts, first, length = [], 0, self.usable.shape[1]
        for sizes in self.pieces:
            joined = []
            for size in sizes:
                count = -(-size // length)
                piece = blocked[first : first + count].reshape(-1, *blocked.shape[2:])
                joined.append(piece[:size])
                first += count
            parts.append(np.concatenate(joined))
        return parts

    @property
    def axes(self) -> int:
        """Count the axes, A."""
        return self.wrench.shape[2]


@dataclass(frozen=True, eq=False)
class Fit:
    """Payload states of cells."""

    #: Of specific force, kg and kg m, (K, 3, A).
    gains: FloatArray
    #: State that holds in a cell, and the cell's robust weight, (n, B).
    states: IntArray
    weights: FloatArray
    #: The parabolas, (n, B, A).
    levels: FloatArray
    #: σ of a cell that is not in contact, N and N m, (A,).
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
    """Cut recordings into blocks, which end at given cells, too; forces (N, 3) are set right."""
    length = max(_FEWEST_IN_BLOCK, round(block_s / recordings[0].period_s))
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
    return Cells(wrench, force, dense(usable), pieces)


def _cut(
    parts: Sequence[NDArray[Any]], pieces: Sequence[Sequence[int]], length: int
) -> NDArray[Any]:
    """Cut arrays into pieces of given sizes, and these into blocks of a length."""
    cuts = chain.from_iterable(
        np.split(part, np.cumsum(sizes)[:-1]) for part, sizes in zip(parts, pieces, strict=True)
    )
    return np.concatenate([blocks(piece, length) for piece in cuts])


def dense(usable: BoolArray) -> BoolArray:
    """Leave out blocks of which too little is usable, (n, B)."""
    return np.asarray(usable & (usable.mean(axis=1, keepdims=True) >= _SPARSE))


def solve(cells: Cells, states: IntArray, weights: FloatArray, count: int) -> FloatArray:
    """Fit gains (K, 3, A) of ``count`` states to weighted cells, parabolas eliminated."""
    size = 3 * count
    z = np.concatenate((_by_state(cells, states, count), cells.wrench), axis=2)
    normal = _eliminated(z, weights, cells.powers)
    gram = normal[:size, :size]
    ridge = (_NO_CONTRAST**2 * weights.sum() + 1e-30) * np.eye(size)
    return np.linalg.solve(gram + ridge, normal[:size, size:]).reshape(count, 3, cells.axes)


def _by_state(cells: Cells, states: IntArray, count: int) -> FloatArray:
    """Write specific force into the columns of the state that holds, else zero, (n, B, 3K)."""
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
    products = np.einsum('nbi,nbj->ij', weighted, z, optimize=True)
    by_parabolas = np.einsum('npi,npj->ij', crossed, np.linalg.solve(inner, crossed))
    return np.asarray(products - by_parabolas)


def leveled(values: FloatArray, weights: FloatArray, powers: int = POWERS) -> FloatArray:
    """Fit parabolas, or constants by one power, to weighted values (n, B, A), and draw them."""
    phi, _ = _parabolas(values.shape[1], powers)
    inner = _normal(weights, powers) + 1e-6 * np.eye(powers)
    return np.asarray(phi @ np.linalg.solve(inner, phi.T @ (weights[..., None] * values)))


def held(by_state: Sequence[FloatArray] | FloatArray, states: IntArray) -> FloatArray:
    """Choose the values of the state that holds in a cell, (n, B, A) or (N, A)."""
    chosen = by_state[0]
    for state, values in enumerate(by_state[1:], 1):
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
    noise = np.sqrt(square) * np.quantile(norm, _QUIET_SHARE) / _QUIET_NORM
    noise = np.minimum(noise, _LOUDEST * _neighbours_noise(cells, rest))
    return replace(fit, noise=np.maximum(noise, least))


def _neighbours_noise(cells: Cells, rest: FloatArray) -> FloatArray:
    """Estimate the noise by the quieter differences of neighbours, which no level spoils, (A,)."""
    pairs = cells.usable[:, 1:] & cells.usable[:, :-1]
    differences = np.abs(np.diff(rest, axis=1))[pairs]
    if not len(differences):  # every other cell may turn too fast
        return np.full(cells.axes, np.inf)
    return np.asarray(np.quantile(differences, _QUIET_SHARE, axis=0) / _QUIET_DIFFERENCE)


def bodies_of(cells: Cells, fit: Fit, scale: FloatArray | None = None) -> RigidBodies:
    """Find the rigid bodies behind gains of six axes; scale is the accelerometer's, (3, 3)."""
    parts = _by_state(cells, fit.states, len(fit.gains)), cells.wrench - weight_of(cells, fit)
    moved, rest = (part - leveled(part, fit.weights, cells.powers) for part in parts)
    # Standard errors come from the scatter of at least twelve blocks.
    length = -(-cells.usable.shape[1] // -(-12 // len(cells.usable)))
    pieces = (
        blocks(part.reshape(-1, *part.shape[2:]), length) for part in (moved, rest, fit.weights)
    )
    return rigid_bodies(fit.gains, *information(*pieces), float(fit.weights.sum()), scale)


def contrast(cells: Cells, weights: FloatArray) -> float:
    """Tell how far the specific force moves within blocks, RMS, m/s²."""
    moved = cells.force - leveled(cells.force, weights, cells.powers)
    total = np.einsum('nb,nbi->', weights, moved**2)
    return float(np.sqrt(total / max(weights.sum(), 1e-9)))


def unexplained_contrast(cells: Cells, fit: Fit) -> float:
    """Share of the contrast between poses that no payload makes, in the median block."""
    middle = np.median(cells.wrench, axis=1, keepdims=True)
    rest = cells.wrench - fit.levels - weight_of(cells, fit)
    full = cells.usable.mean(axis=1) > 0.3
    if not full.any():
        return 0.0
    left, whole = (
        _median_norm(values[full] / fit.noise, cells.usable[full])
        for values in (rest, cells.wrench - middle)
    )
    return float(np.median(left / np.maximum(whole, _STANDS_OUT * np.sqrt(cells.axes))))


def _median_norm(values: FloatArray, usable: BoolArray) -> FloatArray:
    """Median over the usable cells of every block, (n,)."""
    norm = np.linalg.norm(values, axis=2)
    return np.asarray(np.nanmedian(np.where(usable, norm, np.nan), axis=1))
