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
REPORTS = 3
#: A row waits for late wrenches for this many cells, and what comes without wrenches for a row.
_PATIENCE_CELLS = 50
#: Most cells with wrenches that wait for temperatures.
_HELD_CELLS = 600

#: Channels that are averaged, besides temperatures; SPEED as its square.
RAW, REFERENCE, FORCE, SPEED = range(4)
#: Numbers of these channels.
_WIDTHS = (len(AXES), len(AXES), 3, 1)

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
        self._spacings = [deque[int](maxlen=REPORTS) for _ in range(thermometers)]
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
        return min(spacings) if len(spacings) == REPORTS else 1

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

    Only raw wrenches and temperatures make rows. A reference and specific force are added to the
    rows of their stamps; where their clock is another one, the rows come without them.
    """

    def __init__(self, period_ns: int, thermometers: int, *, with_force: bool = False) -> None:
        self._period_ns, self._thermometers = period_ns, thermometers
        self._with_force = with_force
        #: By cell: of RAW, REFERENCE, FORCE and SPEED, the count and the sums.
        self._cells: dict[int, list[list[float]]] = {}
        #: Cells of the last RAW, REFERENCE, FORCE and SPEED; -1 before the first.
        self._latest = [-1] * len(_WIDTHS)
        #: Cells before it have their row; their samples come too late, unless time ran back.
        self._begin = -inf
        #: Temperatures, °C, of cells that have no row yet.
        self._temperatures: dict[int, list[float]] = {}
        #: The end of the last cell with temperatures.
        self._end = -inf
        #: Whether wrenches got rows of their own since the last temperature.
        self._silent = False

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
            self._add(SPEED, stamp_ns, (speed * speed,))

    def _add(self, channel: int, stamp_ns: int, values: Sequence[float]) -> None:
        cell = stamp_ns // self._period_ns
        self._latest[channel] = cell
        if cell not in self._cells:
            self._cells[cell] = [[0.0] * (1 + width) for width in _WIDTHS]
        sums = self._cells[cell][channel]
        sums[0] += 1.0
        for i, value in enumerate(values, start=1):
            sums[i] += value

    def add_cells(self, completed: Sequence[ThermalCell]) -> None:
        """Take cells whose temperatures are complete; held values are not written as measured."""
        for cell in completed:
            if cell.number < self._end:  # time ran back: what waits is of the time before
                self._cells = {at: sums for at, sums in self._cells.items() if at < self._begin}
                self._temperatures.clear()
                self._latest = [min(latest, cell.number) for latest in self._latest]
            self._end, self._silent = cell.number + 1, False
            if not -inf < self._begin <= self._end:  # at first, and when time ran back
                self._begin = cell.number
            self._cells = {at: sums for at, sums in self._cells.items() if at >= self._begin}
            self._temperatures[cell.number] = [
                float(value_c) if measured else nan
                for value_c, measured in zip(cell.temperature_c, cell.measured, strict=True)
            ]

    def rows(self, *, final: bool = False) -> list[Row]:
        """Take rows that are complete or overdue, but not empty; all, when nothing more comes."""
        # What has no raw wrench beside it and is far from the newest cells is of another clock.
        now = max(self._latest[RAW], self._end)
        self._cells = {
            cell: sums
            for cell, sums in self._cells.items()
            if sums[RAW][0] or abs(cell - now) <= _PATIENCE_CELLS
        }
        wrenches = {cell for cell, sums in self._cells.items() if sums[RAW][0]}
        cells = wrenches | self._temperatures.keys()
        waiting = sorted(cell for cell in cells if cell >= self._begin)
        # A reference is waited for when there is one at all, and so is specific force.
        others = [latest for latest in self._latest[REFERENCE:SPEED] if latest >= 0]
        newest = min([self._latest[RAW], *others])
        rows = []
        for place, cell in enumerate(waiting):
            if cell >= self._end:
                held = len(waiting) - place
                is_due = held > (0 if final and self._silent else _HELD_CELLS)
            else:
                is_due = final or cell < max(newest, self._end - 1 - _PATIENCE_CELLS)
            if not is_due:
                break
            self._begin, self._silent = cell + 1, cell >= self._end
            rows.append((cell * self._period_ns + self._period_ns // 2, self._values(cell)))
        return [row for row in rows if not all(map(isnan, row[1]))]

    def _values(self, cell: int) -> list[float]:
        """Take a cell's means and temperatures, °C; NaN where there are none."""
        means = [[nan] * width for width in _WIDTHS]
        for channel, (count, *sums) in enumerate(self._cells.pop(cell, ())):
            if count:
                means[channel] = [value / count for value in sums]
        raw, reference, force, (square,) = means
        temperatures_c = self._temperatures.pop(cell, [nan] * self._thermometers)
        motion = [*force, sqrt(square)] if self._with_force else []
        return [*raw, *reference, *temperatures_c, *motion]
