"""Averages of a running stream, one row per thermal cell, for the node's own recordings."""

from collections.abc import Sequence
from math import inf, isnan, nan, sqrt

from wrist_ft_comp.channels import (
    AXES,
    FORCE_CHANNELS,
    REFERENCE_CHANNELS,
    ROTATION_CHANNEL,
    temperature_channel,
)
from wrist_ft_comp.stream.stream_grid import ThermalCell

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
