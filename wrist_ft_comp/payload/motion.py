"""A minute of motion in cells, from which a job finds the payload."""

from collections.abc import Sequence
import math

from wrist_ft_comp.signals import NANOSECONDS

#: Time that is collected, and length of a cell in which it is averaged, s of stamps.
DURATION_S = 60.0
CELL_S = 0.25
#: Numbers of a cell: wrench less drift, specific force, and the square of the speed of rotation.
_NUMBERS = 10

#: Means: N and N m, m/s², and the root mean square of the speed, rad/s, or NaN.
MotionCell = tuple[float, ...]


class MotionCollector:
    """Averages wrenches and specific force over cells of CELL_S, for DURATION_S of stamps."""

    def __init__(self) -> None:
        #: Complete cells.
        self.cells: list[MotionCell] = []
        self._sums = [0.0] * _NUMBERS
        self._count = self._first_ns = self._cell = 0

    @property
    def share(self) -> float:
        """How much of the duration has passed, 0 to 1."""
        return min(self._cell * CELL_S / DURATION_S, 1.0)

    def add(
        self, stamp_ns: int, wrench: Sequence[float], force: Sequence[float], speed: float
    ) -> bool:
        """Take a wrench, its specific force and speed, or NaN; tell whether all is collected."""
        if not self._count or stamp_ns < self._first_ns:  # at first, or in a time begun anew
            self.cells, self._sums, self._count = [], [0.0] * _NUMBERS, 0
            self._first_ns, self._cell = stamp_ns, 0
        cell = int((stamp_ns - self._first_ns) / (CELL_S * NANOSECONDS))
        if cell != self._cell:
            *means, square = (total / self._count for total in self._sums)
            self.cells.append((*means, math.sqrt(square)))
            self._sums, self._count, self._cell = [0.0] * _NUMBERS, 0, cell
        row = (*wrench, *force, speed * speed)
        self._sums = [total + number for total, number in zip(self._sums, row, strict=True)]
        self._count += 1
        return cell * CELL_S >= DURATION_S
