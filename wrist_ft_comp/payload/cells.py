"""Thermal cells of recordings in blocks of time, and which of them may be learnt from."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrist_ft_comp.payload.directions import turning_speed
from wrist_ft_comp.payload.rigid_body import blocks
from wrist_ft_comp.signals import AXES, BoolArray, FloatArray, IntArray, Recording

#: Length of a block, s, in which a parabola follows the drift; and where the drift is about known:
#: a parabola of 300 s follows a press of two minutes, too.
BLOCK_S, LONG_BLOCK_S = 300.0, 900.0
#: Fewest cells of a block.
_FEWEST = 30
#: Where a smaller share of the cells is usable, a contact looks like the level.
_SPARSE = 0.2
#: Cells that turn faster are left out, rad/s: ω×(ω×c) of the payload is not seen.
FASTEST = 0.5
#: A block's level is a polynomial with as many coefficients: a parabola follows the drift.
POWERS = 3


@dataclass(frozen=True, eq=False)
class Cells:
    """All recordings in n blocks of B cells, filled up with cells that are not usable."""

    #: Raw wrench of A axes, N and N m, (n, B, A), and specific force, m/s², (n, B, 3).
    wrench: FloatArray
    force: FloatArray
    #: Whether they are known and the sensor does not turn fast, (n, B).
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
        """Cut arrays, a part per recording, into the same blocks."""
        return _cut(parts, self.pieces, self.usable.shape[1])

    def join(self, blocked: NDArray[Any]) -> list[NDArray[Any]]:
        """Undo the cutting of an array: a part per recording."""
        parts, at, length = [], 0, self.usable.shape[1]
        for pieces in self.pieces:
            known = []
            for size in pieces:
                count = -(-size // length)
                piece = blocked[at : at + count].reshape(-1, *blocked.shape[2:])
                known.append(piece[:size])
                at += count
            parts.append(np.concatenate(known))
        return parts

    @property
    def axes(self) -> int:
        """A."""
        return self.wrench.shape[2]


def axes_of(recordings: Sequence[Recording]) -> list[int]:
    """Columns of the wrench that every recording holds."""
    return [n for n, axis in enumerate(AXES) if all(axis in r.axes_present for r in recordings)]


def cut(
    recordings: Sequence[Recording],
    forces: Sequence[FloatArray],
    ends: Sequence[Sequence[int]] | None = None,
    block_s: float = BLOCK_S,
) -> Cells:
    """Cut recordings into blocks, each ending at given cells, with forces set right, (N, 3)."""
    length = max(_FEWEST, round(block_s / recordings[0].period_s))
    pieces = [
        np.diff([0, *sorted(cells), len(recording)]).tolist()
        for recording, cells in zip(recordings, ends or [()] * len(recordings), strict=True)
    ]
    axes = axes_of(recordings)
    wrenches, rights, usables = [], [], []
    for recording, force in zip(recordings, forces, strict=True):
        wrench = recording.wrench[:, axes]
        usable = np.isfinite(wrench).all(axis=1) & np.isfinite(force).all(axis=1)
        usable &= rotation_speed(recording) < FASTEST
        wrenches.append(np.where(usable[:, None], wrench, 0))
        rights.append(np.where(usable[:, None], force, 0))
        usables.append(usable)
    wrench, force, usable = (_cut(parts, pieces, length) for parts in (wrenches, rights, usables))
    return Cells(wrench, force, dense(usable), pieces)


def _cut(
    parts: Sequence[NDArray[Any]], pieces: Sequence[Sequence[int]], length: int
) -> NDArray[Any]:
    """Cut arrays into pieces of so many cells, and these into blocks."""
    cuts = chain.from_iterable(
        np.split(part, np.cumsum(sizes)[:-1]) for part, sizes in zip(parts, pieces, strict=True)
    )
    return np.concatenate([blocks(each, length) for each in cuts])


def dense(usable: BoolArray) -> BoolArray:
    """Leave out blocks of which too little is usable, (n, B)."""
    return np.asarray(usable & (usable.mean(axis=1, keepdims=True) >= _SPARSE))


def rotation_speed(recording: Recording) -> FloatArray:
    """Speed of rotation of every cell, rad/s (N,); else what the specific force's turns show."""
    force = recording.specific_force
    if recording.rotation_speed is not None:
        return np.nan_to_num(recording.rotation_speed)
    if force is None:
        return np.zeros(len(recording))
    return np.nan_to_num(turning_speed(force, recording.period_s))


def with_wrench(recording: Recording, wrench: FloatArray, axes: Sequence[int]) -> Recording:
    """Replace some axes' wrench, (N, A)."""
    whole = recording.wrench.copy()
    whole[:, axes] = wrench
    return replace(recording, wrench=whole)
