"""
Averages over thermal cells as a stream: of thermometers, and of the rows of the node's recordings.

A cell is complete when every thermometer has sent a sample of a later one, or when the others are
ahead of a silent one by more than the patience; that one's last value is held. Cells in which no
thermometer was heard are left out: what they were like shows when the gap has ended
(``thermal_memory``). The only time is that of stamps, which ascend (``clock``).
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isnan, nan, sqrt

import numpy as np

from wrist_ft_comp.channels import (
    AXES,
    FORCE_CHANNELS,
    REFERENCE_CHANNELS,
    ROTATION_CHANNEL,
    temperature_channel,
)
from wrist_ft_comp.series import FloatArray
from wrist_ft_comp.stream.thermal_memory import outage_cells

#: A thermometer reports as often as the least of the times between so many reports says: a gap, or
#: a report that is missing, makes none seldom.
_REPORTS = 3
#: Channels of a row; SPEED is averaged as its square.
RAW, REFERENCE, FORCE, SPEED, TEMPERATURE = range(5)
#: A row waits for each of them for this many cells: a thermometer may be read every five minutes.
_PATIENCE_CELLS = (50, 50, 50, 50, 600)

#: Stamp of a cell's middle, ns, and values in the order of row_channels.
Row = tuple[int, list[float]]


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
        #: How many cells the last samples of each were apart.
        self._spacings = [deque[int](maxlen=_REPORTS) for _ in range(thermometers)]
        #: The mean of the last cell of each, °C, and that cell.
        self._held_c: list[float] = [nan] * thermometers
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
        if self._next is None or any(map(isnan, self._held_c)):
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
        if (spacing := cell - self._newest.get(thermometer, cell)) > 0:
            self._spacings[thermometer].append(spacing)
        self._newest[thermometer] = cell
        self._first.setdefault(thermometer, cell)
        if cell not in self._open:
            self._open[cell] = [0.0] * self._thermometers, [0] * self._thermometers
        sums, counts = self._open[cell]
        sums[thermometer] += temperature_c
        counts[thermometer] += 1
        return done + self._complete(cell)

    def spacing(self, thermometer: int) -> int:
        """Tell how many cells the last reports of a thermometer are apart; 1 at first."""
        spacings = self._spacings[thermometer]
        return min(spacings) if len(spacings) == _REPORTS else 1

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
        # Of one that reports seldom, a cell has one sample only: no other is waited for.
        heard = (at + (self.spacing(j) > 1) for j, at in self._newest.items())
        end = max(min(heard), overdue)
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


def row_channels(thermometers: int, *, with_force: bool = False) -> tuple[str, ...]:
    """Name a row's columns: raw and reference wrench, J temperatures, perhaps specific force."""
    temperatures = tuple(temperature_channel(j) for j in range(thermometers))
    force = (*FORCE_CHANNELS, ROTATION_CHANNEL) if with_force else ()
    return (*AXES, *REFERENCE_CHANNELS, *temperatures, *force)


class CellAverager:
    """
    Averages wrenches and completed thermal cells, h = period_ns, into rows.

    Raw wrenches and temperatures make rows; what else has the stamps of one is added to it. A row
    is taken when all that was heard once has gone on to later cells, or is overdue.
    """

    def __init__(self, period_ns: int, thermometers: int, *, with_force: bool = False) -> None:
        self._period_ns, self._with_force = period_ns, with_force
        self._widths = (len(AXES), len(REFERENCE_CHANNELS), len(FORCE_CHANNELS), 1, thermometers)
        #: By cell: of each channel, the count and the sums; temperatures come as means.
        self._cells: dict[int, list[list[float]]] = {}
        #: By channel, its newest cell, to which more may come; of temperatures, the one after it.
        self._latest: dict[int, int] = {}
        #: Cells before it have their row; their samples come too late, unless time ran back.
        self._begin = -inf

    def add_raw(self, stamp_ns: int, wrench: Sequence[float]) -> None:
        """Take a raw wrench, N and N m, axis order AXES."""
        self._add(RAW, stamp_ns, wrench)

    def add_reference(self, stamp_ns: int, wrench: Sequence[float]) -> None:
        """Take a reference wrench, N and N m, axis order AXES."""
        self._add(REFERENCE, stamp_ns, wrench)

    def add_force(self, stamp_ns: int, force: Sequence[float], speed: float | None) -> None:
        """Take a specific force, m/s², and the speed of rotation, rad/s, where it is known."""
        self._add(FORCE, stamp_ns, force)
        if speed is not None:
            self._sum(SPEED, stamp_ns // self._period_ns, (speed * speed,))

    def _add(self, channel: int, stamp_ns: int, values: Sequence[float]) -> None:
        cell = stamp_ns // self._period_ns
        self._latest[channel] = cell
        self._latest.setdefault(TEMPERATURE, cell)  # they are waited for from the beginning
        self._sum(channel, cell, values)

    def _sum(self, channel: int, cell: int, values: Sequence[float]) -> None:
        if cell not in self._cells:
            self._cells[cell] = [[0.0] * (1 + width) for width in self._widths]
        sums = self._cells[cell][channel]
        sums[0] += 1.0
        for i, value in enumerate(values, start=1):
            sums[i] += value

    def add_cells(self, completed: Sequence[ThermalCell]) -> None:
        """Take cells whose temperatures are complete; held values are not written as measured."""
        for cell in completed:
            end = cell.number + 1
            if end < self._latest.get(TEMPERATURE, end):  # time ran back: what waits is of before
                self._cells = {at: sums for at, sums in self._cells.items() if at < self._begin}
                for channel, latest in self._latest.items():
                    self._latest[channel] = min(latest, cell.number)
                self._begin = cell.number
            self._latest[TEMPERATURE] = end
            self._cells = {
                at: sums for at, sums in self._cells.items() if at >= self._begin or sums[-1][0]
            }
            self._sum(TEMPERATURE, cell.number, ())
            self._cells[cell.number][TEMPERATURE][1:] = [
                float(value_c) if measured else nan
                for value_c, measured in zip(cell.temperature_c, cell.measured, strict=True)
            ]

    def rows(self, *, final: bool = False) -> list[Row]:
        """Take rows that are complete or overdue; all, when nothing more comes."""
        if not self._latest:
            return []
        # What makes no row and is far from the newest cells is of another clock.
        heard = self._latest[TEMPERATURE]
        now = max(self._latest.get(RAW, heard), heard)
        waiting = {cell for cell, sums in self._cells.items() if sums[RAW][0] or sums[-1][0]}
        self._cells = {
            cell: sums
            for cell, sums in self._cells.items()
            if cell in waiting or abs(cell - now) <= _PATIENCE_CELLS[RAW]
        }
        overdue = [now + 1 - patience for patience in _PATIENCE_CELLS]
        end = min(max(at, overdue[channel]) for channel, at in self._latest.items())
        if final:
            end = heard if heard > overdue[TEMPERATURE] else now + 1
        rows = []
        for cell in sorted(waiting):
            # The last temperature before a silence comes after it, and makes a row of its own.
            if cell >= end or (cell < self._begin and not self._cells[cell][TEMPERATURE][0]):
                continue
            self._begin = max(self._begin, cell + 1)
            raw, reference, force, (square,), temperatures_c = (
                [value / count if count else nan for value in sums]
                for count, *sums in self._cells.pop(cell)
            )
            motion = [*force, sqrt(square)] if self._with_force else []
            stamp_ns = cell * self._period_ns + self._period_ns // 2
            rows.append((stamp_ns, [*raw, *reference, *temperatures_c, *motion]))
        return rows
