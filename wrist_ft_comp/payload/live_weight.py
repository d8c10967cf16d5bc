"""
What the running node does with payloads, in floats instead of arrays.

The weight of the mounted one is taken off, at the newest specific force that fits the wrench. Of
one that is to be identified, a minute of motion is collected, in which a job finds it
(identify_payload.py).
"""

from collections.abc import Sequence
import math

import numpy as np

from wrist_ft_comp.payload.weight import ForceFrame, Payload
from wrist_ft_comp.series import NANOSECONDS

#: Time that is collected, s of stamps.
DURATION_S = 60.0
#: Length of a cell, over which wrenches are averaged, s.
CELL_S = 0.25
#: Mean wrench less drift, N and N m, mean specific force, m/s², and RMS speed of rotation, rad/s,
#: NaN where unknown.
MotionCell = tuple[float, ...]
#: Specific force, m/s².
Force = tuple[float, float, float]


class LivePayload:
    """A payload and the frame of its specific force; ``turned`` says where that was learnt."""

    def __init__(self, name: str, payload: Payload, frame: ForceFrame, turned: str = '') -> None:
        self.name, self.payload, self.frame = name, payload, frame
        #: The same in words for people.
        self.turn = f'specific force is {frame}, {turned}'
        still = payload.weight(frame.turn(np.zeros(3)))
        gains = payload.weight(frame.turn(np.eye(3))) - still
        #: Per axis: gains of the three directions of the specific force, and a constant.
        self._rows: list[list[float]] = np.vstack((gains, still)).T.tolist()

    def __str__(self) -> str:
        center = ', '.join(f'{coordinate:.4f}' for coordinate in self.payload.center_m)
        return f'{self.name}, {self.payload.mass_kg:.4f} kg at ({center}) m'

    def weight(self, force: Force) -> list[float]:
        """Compute its wrench at a specific force, m/s²: N and N m, axis order AXES."""
        return [-value for value in self.taken_off([0.0] * 6, force)]

    def taken_off(self, wrench: Sequence[float], force: Force) -> list[float]:
        """Subtract its wrench at a specific force, m/s², from a wrench, N and N m."""
        x, y, z = force
        return [
            w - (a * x + b * y + c * z + d)
            for w, (a, b, c, d) in zip(wrench, self._rows)  # noqa: B905 -- as in Compensator
        ]


class MotionCollector:
    """Averages wrenches and specific force over cells of CELL_S, for DURATION_S of stamps."""

    def __init__(self) -> None:
        #: Complete cells.
        self.cells: list[MotionCell] = []
        #: Of wrenches, specific forces, and squares of the speed of rotation.
        self._sums: list[float] = []
        self._count = self._first_ns = self._cell = 0

    @property
    def share(self) -> float:
        """Share of the duration that has passed, 0 to 1."""
        return min(self._cell * CELL_S / DURATION_S, 1.0)

    def add(
        self, stamp_ns: int, wrench: Sequence[float], force: Sequence[float], speed: float
    ) -> bool:
        """Add a wrench, its specific force, and its speed or NaN; True when all is collected."""
        if not self._count or stamp_ns < self._first_ns:  # the first one, or the clock was set
            self.cells, self._count = [], 0
            self._first_ns, self._cell = stamp_ns, 0
        cell = int((stamp_ns - self._first_ns) / (CELL_S * NANOSECONDS))
        if cell != self._cell:
            *means, square = (total / self._count for total in self._sums)
            self.cells.append((*means, math.sqrt(square)))
            self._count, self._cell = 0, cell
        row = (*wrench, *force, speed * speed)
        before = self._sums if self._count else [0.0] * len(row)
        self._sums = [total + number for total, number in zip(before, row, strict=True)]
        self._count += 1
        return cell * CELL_S >= DURATION_S
