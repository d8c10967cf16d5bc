"""The minute of motion that ``~/identify_payload`` asks for, in floats: each wrench adds to it."""

from collections.abc import Sequence
import math

from wrist_ft_comp.series import NANOSECONDS

#: Motion is collected for this time, s of stamps.
DURATION_S = 60.0
#: Length of a cell, over which wrenches are averaged, s.
CELL_S = 0.25
#: TF shows no acceleration. Where the tool turned slower than this, rad/s, for this time, s, what
#: an arm of 1 m adds is some per cent of the weight.
CALM_RAD_S, CALM_S = 0.2, 1.0


class MotionCollector:
    """Averages wrenches and specific force over cells of CELL_S, for DURATION_S of stamps."""

    def __init__(self) -> None:
        #: Complete ones: mean wrench less drift, N and N m, mean specific force, m/s², and RMS
        #: speed of rotation, rad/s, NaN where unknown.
        self.cells: list[tuple[float, ...]] = []
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
