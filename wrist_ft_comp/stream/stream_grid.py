"""
The thermal grid as a stream: samples of several thermometers in, completed cells out.

A cell is complete when every thermometer has sent a sample of a later one, or when the others are
ahead of a silent one by more than the patience; that one's last value is held. Cells in which no
thermometer was heard are left out: what they were like shows when the gap has ended (``gap``). The
only time is that of stamps.
"""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from wrist_ft_comp.signals import FloatArray
from wrist_ft_comp.stream.gap import outage_cells
from wrist_ft_comp.stream.temperature_spikes import SpikeFilter


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
        #: Samples that were dropped.
        self.rejected = 0
        #: How often time ran back.
        self.restarts = 0
        #: Of each thermometer.
        self.spikes = [SpikeFilter() for _ in range(thermometers)]
        self._thermometers = thermometers
        self._patience = outage_cells(period_ns, patience_s)
        self._held: list[float] = [math.nan] * thermometers
        #: The cells that the held values were measured in.
        self._held_from = [0] * thermometers
        self._begin()

    def _begin(self) -> None:
        """Wait for all thermometers; the last values stay held."""
        #: The first cell of each since the beginning, or since an outage of all.
        self._first: list[int | None] = [None] * self._thermometers
        self._outage = False
        self._latest: list[int | None] = [None] * self._thermometers
        self._last_stamp_ns: list[int | None] = [None] * self._thermometers
        #: The cell that is emitted next; None before the first.
        self._next: int | None = None
        #: Cells before this one are not kept.
        self._forgotten: int | None = None
        #: Sums and counts by cell.
        self._open: dict[int, tuple[list[float], list[int]]] = {}

    def go_on(self, cell: int, held_c: Sequence[float], silent: Sequence[int]) -> None:
        """Continue at a cell, with J held temperatures, °C, and the cells since their samples."""
        self._begin()
        self._next, self._held = cell, list(held_c)
        self._held_from = [cell - 1 - cells for cells in silent]
        self._first = [cell - 1] * self._thermometers
        self._latest = [cell - 1] * self._thermometers
        self._last_stamp_ns = [cell * self.period_ns - 1] * self._thermometers
        for spikes, value_c, at in zip(self.spikes, held_c, self._held_from, strict=True):
            spikes.go_on((at + 1) * self.period_ns - 1, value_c)

    def add(self, thermometer: int, stamp_ns: int, temperature_c: float) -> list[ThermalCell]:
        """Take a sample of a thermometer, from 0; give the cells that it completed."""
        if not math.isfinite(temperature_c):
            self.rejected += 1
            return []
        cell = stamp_ns // self.period_ns
        last = self._last_stamp_ns[thermometer]
        if last is not None and stamp_ns <= last:
            if cell >= last // self.period_ns - self._patience:
                self.rejected += 1
                return []
            self.restarts += 1
            if self._next is None or any(map(math.isnan, self._held)):
                self._begin()
            else:
                self.go_on(cell, self._held, self._silent(self._next))
        self._last_stamp_ns[thermometer] = stamp_ns
        samples = self.spikes[thermometer].admit(stamp_ns, temperature_c)
        return [cells for sample in samples for cells in self._count(thermometer, *sample)]

    def _count(self, thermometer: int, stamp_ns: int, temperature_c: float) -> list[ThermalCell]:
        """Add a sample to its cell; give the cells that it completed."""
        cell = stamp_ns // self.period_ns
        if self._next is not None and cell < self._next:
            self.rejected += 1
            return []
        done: list[ThermalCell] = []
        if self._next is not None and cell > max(self._known(self._latest)) + self._patience:
            done = self._complete(cell)
            self._first, self._outage = [None] * self._thermometers, True
        self._latest[thermometer] = cell
        if self._first[thermometer] is None:
            self._first[thermometer] = cell
        sums, counts = self._open.setdefault(
            cell, ([0.0] * self._thermometers, [0] * self._thermometers)
        )
        sums[thermometer] += temperature_c
        counts[thermometer] += 1
        return done + self._complete(cell)

    @staticmethod
    def _known(cells: Sequence[int | None]) -> list[int]:
        """Leave out those that are not known."""
        return [cell for cell in cells if cell is not None]

    def _complete(self, newest: int) -> list[ThermalCell]:
        """Emit all cells that no sample can be expected for any more, now that one is newest."""
        latest, first = self._known(self._latest), self._known(self._first)
        overdue = max(*latest, newest) - self._patience
        if len(latest) < self._thermometers:
            # One never reported: what is older than the patience is only held, not kept.
            self._forget_before(overdue)
            return []
        if self._next is None:
            # As in a batch: begin with the first cell by whose end all have reported.
            if self._forgotten is not None:
                first.append(self._forgotten)
            self._next = max(first)
            self._forget_before(self._next)
        if self._outage:
            # Go on as at the beginning, but wait for none for longer than the patience.
            if len(first) < self._thermometers and overdue <= min(first):
                return []
            self._outage = False
            self._forget_before(max(f for f in first if f <= min(first) + self._patience))
        done = []
        for cell in sorted(cell for cell in self._open if cell < max(min(latest), overdue)):
            self._hold(cell)
            silent = self._silent(cell + 1)
            done.append(ThermalCell(cell, np.array(self._held), silent))
            self._next = cell + 1
        return done

    def _forget_before(self, end: int) -> None:
        """Keep only the values of cells that will not be emitted."""
        self._forgotten = end
        for cell in sorted(cell for cell in self._open if cell < end):
            self._hold(cell)

    def _hold(self, cell: int) -> None:
        """Make the means of an open cell the held values."""
        sums, counts = self._open.pop(cell)
        for j, count in enumerate(counts):
            if count:
                self._held[j], self._held_from[j] = sums[j] / count, cell

    def _silent(self, end: int) -> tuple[int, ...]:
        """Count the cells before an end since each held value was measured."""
        return tuple(end - 1 - cell for cell in self._held_from)
