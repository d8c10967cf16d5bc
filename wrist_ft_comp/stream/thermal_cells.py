"""
Averages over thermal cells as a stream: of thermometers, and of the rows of the node's recordings.

A cell is complete when every thermometer has sent a sample of a later one, but for those that are
behind by more than the patience, or were lately; their last values are held. Cells in which no
thermometer was heard are left out: what they were like shows when the gap has ended
(``gaps_and_restarts``). The only time is that of stamps, which ascend (``clock``).
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isnan, nan, sqrt

import numpy as np

from wrist_ft_comp.channels import CHANNELS, temperature_channel
from wrist_ft_comp.series import BoolArray, FloatArray
from wrist_ft_comp.stream.gaps_and_restarts import outage_cells

#: A thermometer reports as often as the least of the times between so many reports says: a gap, or
#: a report that is missing, makes none seldom.
_REPORTS = 3
#: Longest patience, s: drift moves little meanwhile, and a gateway may send some seconds at once.
_LONGEST_WAIT_S = 10.0
#: A mean of a minute comes later than its stamp by up to two, s.
_LATEST_S = 120.0
#: First columns of what is averaged: CHANNELS, with the square of the speed of rotation, and the
#: temperatures.
RAW, REFERENCE, FORCE, TEMPERATURE = 0, 6, 12, 16
#: A row waits for each of them for this many cells: a thermometer may be read every five minutes.
_PATIENCE_CELLS = {RAW: 50, REFERENCE: 50, FORCE: 50, TEMPERATURE: 600}

#: Stamp of a cell's middle, ns, and values in the order of row_channels.
Row = tuple[int, list[float]]


@dataclass(frozen=True, eq=False)
class ThermalCell:
    """A completed cell in which a thermometer was heard."""

    #: Number of the cell: stamps divided by the period.
    number: int
    #: Mean or held temperatures, °C, shape (J,).
    temperature_c: FloatArray
    #: Which thermometers had a sample of their own, shape (J,).
    measured: BoolArray


class ThermalGrid:
    """Averages temperatures per cell; waits for a silent one for patience_s, 10 s at most."""

    def __init__(self, period_ns: int, thermometers: int, patience_s: float) -> None:
        self.period_ns = period_ns
        #: Samples that came too late for their cell, and those of them that count in no other.
        self.late = self.rejected = 0
        self._thermometers = thermometers
        self._patience = outage_cells(period_ns, min(patience_s, _LONGEST_WAIT_S))
        #: Where none reports for longer, all were out; all of them may report seldom.
        self._outage = outage_cells(period_ns, patience_s)
        #: What is later is of another clock.
        self._latest = outage_cells(period_ns, max(patience_s, _LATEST_S))
        #: How many cells the last samples of each were apart.
        self._spacings = [deque[int](maxlen=_REPORTS) for _ in range(thermometers)]
        #: The mean of the last cell of each, °C, and that cell.
        self._held_c: list[float] = [nan] * thermometers
        self._held_from = [0] * thermometers
        self._begin_anew()

    def _begin_anew(self) -> None:
        """Wait for all thermometers; the last values stay held."""
        #: The newest cell of each.
        self._newest: dict[int, int] = {}
        #: The newest cell of each by its stamps: late samples count in later ones.
        self._sent: dict[int, int] = {}
        #: While all are waited for, at the beginning and after an outage: the first cell of each.
        self._first: dict[int, int] | None = {}
        #: No cell before this one is emitted any more.
        self._next: float = -inf
        #: Sums and counts of each thermometer, by cell.
        self._open: dict[int, tuple[list[float], list[int]]] = {}

    def go_on(self, cell: int, held_c: Sequence[float], silent: Sequence[int]) -> None:
        """Continue at a cell, with J held temperatures, °C, and the cells since their samples."""
        self._begin_anew()
        self._next, self._first, self._held_c = cell, None, list(held_c)
        self._held_from = [cell - 1 - cells for cells in silent]
        self._newest = dict.fromkeys(range(self._thermometers), cell - 1)
        self._sent = dict(enumerate(at + 1 for at in self._held_from))

    def move_to(self, cell: int) -> None:
        """Continue at a cell of another time, whatever was open."""
        if any(map(isnan, self._held_c)):
            self._begin_anew()
        else:
            self.go_on(cell, self._held_c, self.silent(int(self._next)))

    def add(self, thermometer: int, stamp_ns: int, temperature_c: float) -> list[ThermalCell]:
        """Take a sample of a thermometer, from 0; give the cells that it completed."""
        at = cell = stamp_ns // self.period_ns
        done = list[ThermalCell]()
        if len(self._newest) == self._thermometers:  # all have reported
            if cell < self._next:  # late, but newer than what is held: of the next cell
                self.late += 1
                if cell < max(self._sent[thermometer], self._next - self._latest):
                    self.rejected += 1
                    return []
                cell = int(self._next)
            # What pauses as usual, because all report seldom, was not out.
            usual = 2 * max(map(self.spacing, range(self._thermometers)))
            if cell > max(self._newest.values()) + max(self._outage, usual):
                done, self._first = self._complete(cell), {}
        self._sent[thermometer] = max(self._sent.get(thermometer, at), at)
        if (spacing := cell - self._newest.get(thermometer, cell)) > 0:
            self._spacings[thermometer].append(spacing)
        self._newest[thermometer] = cell
        if self._first is not None:
            self._first.setdefault(thermometer, cell)
        none = [0.0] * self._thermometers, [0] * self._thermometers
        sums, counts = self._open.setdefault(cell, none)
        sums[thermometer] += temperature_c
        counts[thermometer] += 1
        return done + self._complete(cell)

    def spacing(self, thermometer: int, unknown: int = 1) -> int:
        """Tell how many cells the last reports of a thermometer are apart, once it is known."""
        spacings = self._spacings[thermometer]
        return min(spacings) if len(spacings) == _REPORTS else unknown

    def _complete(self, newest: int) -> list[ThermalCell]:
        """Emit all cells that no sample can be expected for any more, now that one is newest."""
        overdue = max(*self._newest.values(), newest) - self._patience
        if len(self._newest) < self._thermometers:
            # What is older than the patience is only held, not kept.
            self.hold_before(overdue)
            return []
        if self._first is not None:
            first = self._first.values()
            if len(first) < self._thermometers and overdue <= min(first):
                return []
            # As in a batch: go on with the first cell by whose end all have reported. One that
            # has a value is waited for no longer than the patience.
            waits = any(map(isnan, self._held_c))
            latest = max(first) if waits else min(first) + self._patience
            self.hold_before(max(cell for cell in first if cell <= latest))
            self._first = None
        # Of one that reports seldom, a cell has one sample only: no other is waited for. Nor does
        # any wait for one that is overdue, or was before its last report.
        heard = {j: at + (self.spacing(j) > 1) for j, at in self._newest.items()}
        last = [spacings[-1] if spacings else 1 for spacings in self._spacings]
        waited = [at for j, at in heard.items() if at >= overdue and last[j] <= self._patience]
        end, done = max(min(waited or heard.values()), overdue), []
        for cell in sorted(cell for cell in self._open if cell < end):
            self.hold_before(cell + 1)
            measured = np.array(self._held_from) == cell
            done.append(ThermalCell(cell, np.array(self._held_c), measured))
        return done

    def hold_before(self, end: int) -> None:
        """Emit no cell before an end; the means of those that are open are held."""
        self._next = max(self._next, end)
        for cell in sorted(cell for cell in self._open if cell < self._next):
            for j, (total_c, count) in enumerate(zip(*self._open.pop(cell), strict=True)):
                if count:
                    self._held_c[j], self._held_from[j] = total_c / count, cell

    def silent(self, end: int) -> tuple[int, ...]:
        """Count the cells before an end since each held value was measured, (J,)."""
        return tuple(max(end - 1 - cell, 0) for cell in self._held_from)


def row_channels(thermometers: int, *, with_force: bool = False) -> tuple[str, ...]:
    """Name a row's columns: raw and reference wrench, J temperatures, perhaps specific force."""
    temperatures = tuple(temperature_channel(j) for j in range(thermometers))
    return CHANNELS[:FORCE] + temperatures + (CHANNELS[FORCE:] if with_force else ())


class CellAverager:
    """
    Averages wrenches and completed thermal cells, h = period_ns, into rows.

    Raw wrenches and temperatures make rows; what else has the stamps of one is added to it. A row
    is taken when all that was heard once has gone on to later cells, or is overdue.
    """

    def __init__(self, period_ns: int, thermometers: int, *, with_force: bool = False) -> None:
        self._period_ns, self._with_force = period_ns, with_force
        self._width = TEMPERATURE + thermometers
        #: Sums and counts by cell, in columns from RAW, REFERENCE, FORCE and TEMPERATURE on.
        self._cells: dict[int, tuple[list[float], list[int]]] = {}
        #: Newest cell by first column, to which more may come; of temperatures, the one after it.
        self._latest: dict[int, int] = {}
        #: Whether a temperature has come: the first may be of before the first wrench.
        self._is_warm = False
        #: Cells before it have their row; their samples come too late, unless time ran back.
        self._begin = -inf

    def add(self, column: int, stamp_ns: int, values: Sequence[float]) -> None:
        """Take a RAW or a REFERENCE wrench, N and N m, or FORCE, m/s², perhaps with speed²."""
        cell = stamp_ns // self._period_ns
        self._latest[column] = cell
        self._latest.setdefault(TEMPERATURE, cell)  # they are waited for from the beginning
        self._sum(cell, column, values)

    def _sum(self, cell: int, column: int, values: Sequence[float]) -> None:
        if cell not in self._cells:
            self._cells[cell] = [0.0] * self._width, [0] * self._width
        sums, counts = self._cells[cell]
        for i, value in enumerate(values, column):
            sums[i] += value
            counts[i] += 1

    def add_cells(self, completed: Sequence[ThermalCell]) -> None:
        """Take cells whose temperatures are complete; held values are not written as measured."""
        for cell in completed:
            end = cell.number + 1
            ran_back = self._is_warm and end < self._latest[TEMPERATURE]
            self._is_warm = True
            if ran_back:  # what waits is of before
                self._cells = {at: sums for at, sums in self._cells.items() if at < self._begin}
                for column, latest in self._latest.items():
                    self._latest[column] = min(latest, cell.number)
                self._begin = cell.number
            self._latest[TEMPERATURE] = end
            for at, (_, counts) in list(self._cells.items()):
                if at < self._begin and not any(counts[TEMPERATURE:]):
                    del self._cells[at]
            for j in np.flatnonzero(cell.measured).tolist():
                self._sum(cell.number, TEMPERATURE + j, cell.temperature_c[j : j + 1].tolist())

    def rows(self, *, final: bool = False) -> list[Row]:
        """Take rows that are complete or overdue; all, when nothing more comes."""
        if not self._latest:
            return []
        heard = self._latest[TEMPERATURE]
        now, near = max(self._latest.get(RAW, heard), heard), _PATIENCE_CELLS[RAW]
        # What makes no row and is far from the newest cells is of another clock.
        for cell, (_, counts) in list(self._cells.items()):
            if abs(cell - now) > near and not (counts[RAW] or any(counts[TEMPERATURE:])):
                del self._cells[cell]
        overdue = {column: now + 1 - cells for column, cells in _PATIENCE_CELLS.items()}
        end = min(max(at, overdue[column]) for column, at in self._latest.items())
        if final:
            end = heard if heard > overdue[TEMPERATURE] else now + 1
        rows = []
        for cell, (sums, counts) in sorted(self._cells.items()):
            # The last temperature before a silence comes after it, and makes a row of its own.
            is_row = any(counts[TEMPERATURE:]) or (counts[RAW] and cell >= self._begin)
            if cell >= end or not is_row:
                continue
            del self._cells[cell]
            self._begin = max(self._begin, cell + 1)
            means = [total / n if n else nan for total, n in zip(sums, counts, strict=True)]
            *force, square = means[FORCE:TEMPERATURE]
            values = means[:FORCE] + means[TEMPERATURE:]
            if self._with_force:
                values += [*force, sqrt(square)]
            rows.append((cell * self._period_ns + self._period_ns // 2, values))
        return rows
