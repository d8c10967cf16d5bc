"""
A payload from a minute of motion: cells are collected, and one rigid body is found in them.

Wrenches are less drift, so what is left is a constant, the payload's gains of specific force, and
contacts: outliers of all six axes of a cell at once, which lose their weight by
1 / (1 + (e / c σ)²)², with c falling to _TUNING, as in calibrations at work. A minute holds a few
poses only, and a contact may last for all of one: so the start is chosen among many fits to a few
cells each, by what it says of directions, not of time.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.model.payload.directions import fit_norm, turning_speed
from wrist_ft_comp.model.payload.rigid_body import blocks, CONTRAST, information, rigid_bodies
from wrist_ft_comp.model.payload.weight import ForceFrame, Payload
from wrist_ft_comp.model.signals import AXES, FloatArray, NANOSECONDS

#: How long is collected, and the cells in which it is averaged, s of stamps.
DURATION_S, CELL_S = 60.0, 0.25
#: Cells that turn faster are left out, rad/s: ω × (ω × c) of the payload is not seen.
FASTEST = 0.5
#: So many cells have to be left, and this share of them has to be free of contact.
_LEAST_CELLS, _LEAST_FREE = 40, 0.4
#: The first fit: of so many, to so many cells each, with so little held against large gains. A
#: long rest in one direction, up to so many rad, counts no more than a short one.
_DRAWS, _FEW, _RIDGE, _ALIKE = 300, 5, 1e-3, 0.2
#: Torques count by a lever of 0.1 m; what is below this, N, is none of a contact.
_LEVERS, _FINE = np.repeat([1.0, 0.1], 3), 0.1
#: From there on. No weight is known better than by this share.
_TUNING, _ROUNDS, _KNOWN = 4.0, 20, 0.01
#: This share of cells is taken to be free of contact; norm of six normal variables there.
_QUIETER, _QUIETER_NORM = 0.3, 0.80
#: Errors of so many cells in a row are taken to depend on one another.
_BLOCK = 20


class MotionCells(NamedTuple):
    """Means of n cells: wrench (n, 6), specific force (n, 3), and speed, rad/s, or NaN (n,)."""

    wrench: FloatArray
    force: FloatArray
    speed: FloatArray


class MotionCollector:
    """Averages wrenches and specific force over cells of CELL_S, for DURATION_S of stamps."""

    def __init__(self) -> None:
        self._cells: list[FloatArray] = []
        self._rows: list[tuple[float, ...]] = []
        self._first_ns = self._cell = 0

    @property
    def share(self) -> float:
        """How much of the duration has passed, 0 to 1."""
        return min(self._cell * CELL_S / DURATION_S, 1.0)

    def add(
        self, stamp_ns: int, wrench: Sequence[float], force: Sequence[float], speed: float
    ) -> bool:
        """Take a wrench and its specific force; tell whether it is enough. Speed may be NaN."""
        if not self._rows or stamp_ns < self._first_ns:  # at first, or in a time begun anew
            self._cells, self._rows, self._first_ns, self._cell = [], [], stamp_ns, 0
        cell = int((stamp_ns - self._first_ns) / (CELL_S * NANOSECONDS))
        if cell != self._cell:
            self._cells.append(np.mean(self._rows, axis=0))
            self._rows.clear()
            self._cell = cell
        self._rows.append((*wrench, *force, speed * speed))
        return cell * CELL_S >= DURATION_S

    def cells(self) -> MotionCells:
        """Give the cells that are complete."""
        means = np.array(self._cells).reshape(-1, len(AXES) + 4)
        return MotionCells(means[:, :6], means[:, 6:9], np.sqrt(means[:, 9]))


@dataclass(frozen=True, eq=False)
class Identified:
    """What was found, and the share of the time that was in contact, and that turned too fast."""

    payload: Payload
    frame: ForceFrame
    contact: float
    fast: float


def identify(cells: MotionCells, frame: ForceFrame | None) -> Identified:
    """Find the payload; bias and scale of the accelerometer are a frame's, or found, too."""
    # CalibrationRefusedError when the motion or the wrenches do not tell; it says what to do.
    slow = (
        np.where(np.isnan(cells.speed), turning_speed(cells.force, CELL_S), cells.speed) < FASTEST
    )
    if slow.sum() < _LEAST_CELLS:
        raise CalibrationRefusedError(
            f'The tool turned slower than {FASTEST:g} rad/s for {slow.sum() * CELL_S:.0f} s only; '
            f'at least {_LEAST_CELLS * CELL_S:.0f} s are needed. Move more slowly, or rest in '
            'every pose.'
        )
    fitted, _, scale = fit_norm(cells.force[slow], np.empty((slow.sum(), 0)))
    sensor = fitted if frame is None else replace(frame, rotation=np.eye(3))
    force = sensor.turn(cells.force[slow])
    gains, weights, rest = _fit(cells.wrench[slow], force)
    contrast = force - weights @ force / weights.sum()
    parts = (blocks(each, _BLOCK) for each in (contrast, rest, weights))
    known = *information(*parts), float(weights.sum())
    found = rigid_bodies(gains[np.newaxis], *known, scale if frame is None else None)
    free = float((weights > 0.5).mean())
    if free < _LEAST_FREE and found.contrast[1] > CONTRAST:
        raise CalibrationRefusedError(
            f'In {1 - free:.0%} of the time the wrench did not follow gravity; at least '
            f'{_LEAST_FREE:.0%} have to be free. Move without contact, and look whether gravity '
            'is of this sensor.'
        )
    if doubts := found.doubts():
        raise CalibrationRefusedError(doubts[0])
    turned = replace(sensor, rotation=found.rotation)
    return Identified(found.payload(0), turned, 1 - free, 1 - float(slow.mean()))


def _fit(wrench: FloatArray, force: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Fit a constant and gains (3, 6): the gains, weights of the cells (n,), and the rest."""
    x = np.column_stack((np.ones(len(force)), force))
    found = _start(x, wrench)
    error = np.linalg.norm((wrench - x @ found) / _LEVERS, axis=1)
    weights = 1.0 * (error <= np.quantile(error, _LEAST_FREE))
    for width in np.geomspace(2 * _TUNING, _TUNING, _ROUNDS):
        weighted = x.T * weights
        found = np.linalg.lstsq(weighted @ x, weighted @ wrench, rcond=1e-10)[0]
        rest = wrench - x @ found
        pulled = ((force - force.mean(axis=0)) @ found[1:]).reshape(-1, 2, 3)
        known = _KNOWN * np.repeat(np.sqrt(np.mean(pulled**2, axis=(0, 2))), 3)
        noise = np.sqrt(weights @ rest**2 / weights.sum()) + 1e-9
        quiet = np.quantile(np.sqrt(np.mean((rest / noise) ** 2, axis=1)), _QUIETER)
        noise = np.maximum(noise * quiet / _QUIETER_NORM, known)
        error = np.sqrt(np.mean((rest / noise) ** 2, axis=1))
        weights = 1 / (1 + (error / width) ** 2) ** 2
    return found[1:], weights, rest


def _start(x: FloatArray, wrench: FloatArray) -> FloatArray:
    """Of fits (4, 6) to a few cells each, take the one that is right about most directions."""
    up = x[:, 1:] / np.linalg.norm(x[:, 1:], axis=1, keepdims=True)
    rare = 1 / np.sum(up @ up.T > np.cos(_ALIKE), axis=1)
    rare /= rare.sum()
    few = np.random.default_rng(0).choice(len(x), (_DRAWS, _FEW), p=rare)
    across = np.swapaxes(x[few], 1, 2)
    found = np.linalg.solve(across @ x[few] + _RIDGE * np.eye(4), across @ wrench[few])
    error = np.linalg.norm((wrench - x @ found) / _LEVERS, axis=2)
    return np.asarray(found[np.argmin(np.log(error + _FINE) @ rare)])
