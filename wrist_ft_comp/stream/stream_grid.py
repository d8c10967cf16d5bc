"""
The thermal grid as a stream: samples of several thermometers in, completed cells out.

A cell is complete when every thermometer has sent a sample of a later one, or when the others are
ahead of a silent one by more than the patience; that one's last value is held. Cells in which no
thermometer was heard are left out: what they were like shows when the gap has ended (``gap``). The
only time is that of stamps, which ascend (``clock``).
"""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from wrist_ft_comp.series import FloatArray
from wrist_ft_comp.stream.gap import outage_cells


@dataclass(frozen=True, eq=False)
class ThermalCell:
    """A completed cell in which a thermometer was heard."""

    #: Number of the cell: stamps divided by the period.
    number: int
    #: Mean or held temperatures, °C, shape (J,).
    temperature_c: FloatArray
    #: For how many cells, up to this one, each thermometer had no sample, shape (J,).
    silent: tuple[int, ...]

    @property
    def measured(self) -> tuple[bool, ...]:
        """Which thermometers had a sample of their own."""
        return tuple(cells == 0 for cells in self.silent)


class ThermalGrid:
    """Averages temperatures per cell as they come; waits for a silent one for patience_s."""

    def __init__(self, period_ns: int, thermometers: int, patience_s: float) -> None:
        self.period_ns = period_ns
        #: Samples that came too late for their cell.
        self.rejected = 0
        self._thermometers = thermometers
        self._patience = outage_cells(period_ns, patience_s)
        #: The mean of the last cell of each, °C, and that cell.
        self._held_c: list[float] = [math.nan] * thermometers
        self._held_from = [0] * thermometers
        self._begin()

    def _begin(self) -> None:
        """Wait for all thermometers; the last values stay held."""
        #: The first and the newest cell of each since the beginning, or an outage of all.
        self._first: dict[int, int] = {}
        self._newest: dict[int, int] = {}
        self._outage = False
        #: The cell that is emitted next; None before the first.
        self._next: int | None = None
        #: No cell before this one is emitted.
        self._earliest: int | None = None
        #: Sums and counts of each thermometer, by cell.
        self._open: dict[int, tuple[list[float], list[int]]] = {}

    def go_on(self, cell: int, held_c: Sequence[float], silent: Sequence[int]) -> None:
        """Continue at a cell, with J held temperatures, °C, and the cells since their samples."""
        self._begin()
        self._next, self._held_c = cell, list(held_c)
        self._held_from = [cell - 1 - cells for cells in silent]
        self._first = dict.fromkeys(range(self._thermometers), cell - 1)
        self._newest = dict(self._first)

    def move_to(self, cell: int) -> None:
        """Continue at a cell of another time, whatever was open."""
        if self._next is None or any(map(math.isnan, self._held_c)):
            self._begin()
        else:
            self.go_on(cell, self._held_c, self._silent(self._next))

    def begin_at(self, cell: int) -> None:
        """Emit no cell before this one."""
        self._hold_before(cell)
        if self._next is not None:
            self._next = cell

    def add(self, thermometer: int, stamp_ns: int, temperature_c: float) -> list[ThermalCell]:
        """Take a sample of a thermometer, from 0; give the cells that it completed."""
        cell, done = stamp_ns // self.period_ns, list[ThermalCell]()
        if self._next is not None:
            if cell < self._next:
                self.rejected += 1
                return []
            if cell > max(self._newest.values()) + self._patience:
                done = self._complete(cell)
                self._first, self._outage = {}, True
        self._newest[thermometer] = cell
        self._first.setdefault(thermometer, cell)
        if cell not in self._open:
            self._open[cell] = [0.0] * self._thermometers, [0] * self._thermometers
        sums, counts = self._open[cell]
        sums[thermometer] += temperature_c
        counts[thermometer] += 1
        return done + self._complete(cell)

    def _complete(self, newest: int) -> list[ThermalCell]:
        """Emit all cells that no sample can be expected for any more, now that one is newest."""
        overdue = max(*self._newest.values(), newest) - self._patience
        if len(self._newest) < self._thermometers:
            # One never reported: what is older than the patience is only held, not kept.
            self._hold_before(overdue)
            return []
        first = self._first.values()
        if self._next is None:
            # As in a batch: begin with the first cell by whose end all have reported.
            self._next = max(first)
            if self._earliest is not None:
                self._next = max(self._next, self._earliest)
            self._hold_before(self._next)
        if self._outage:
            # Go on as at the beginning, but wait for none for longer than the patience.
            if len(first) < self._thermometers and overdue <= min(first):
                return []
            self._outage = False
            self._hold_before(max(f for f in first if f <= min(first) + self._patience))
        done = []
        end = max(min(self._newest.values()), overdue)
        for cell in sorted(cell for cell in self._open if cell < end):
            self._hold_before(cell + 1)
            done.append(ThermalCell(cell, np.array(self._held_c), self._silent(cell + 1)))
            self._next = cell + 1
        return done

    def _hold_before(self, end: int) -> None:
        """Make the means of the open cells before an end the held values."""
        self._earliest = end
        for cell in sorted(cell for cell in self._open if cell < end):
            for j, (total_c, count) in enumerate(zip(*self._open.pop(cell), strict=True)):
                if count:
                    self._held_c[j], self._held_from[j] = total_c / count, cell

    def _silent(self, end: int) -> tuple[int, ...]:
        """Count the cells before an end since each held value was measured."""
        return tuple(end - 1 - cell for cell in self._held_from)
