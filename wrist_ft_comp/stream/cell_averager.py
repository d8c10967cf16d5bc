"""Averages of a running stream, a row per thermal cell: what the node's own recording holds."""

from collections.abc import Iterator, Sequence
from math import isnan, sqrt

from wrist_ft_comp.model.signals import (
    AXES,
    FORCE_CHANNELS,
    REFERENCE_CHANNELS,
    ROTATION_CHANNEL,
    temperature_channel,
)
from wrist_ft_comp.model.stream_grid import CompletedCells

_NAN = float('nan')
#: Rows wait at most this many cells for wrenches that are late.
_PATIENCE_CELLS = 50
#: So many cells of wrenches wait for temperatures.
_HELD_CELLS = 600

#: Stamp of a cell's middle, ns, and values in the order of row_channels.
Row = tuple[int, list[float]]


def row_channels(thermometers: int, *, with_force: bool = False) -> tuple[str, ...]:
    """Name a row's columns: raw and reference wrench, J temperatures, perhaps specific force."""
    temperatures = tuple(temperature_channel(j) for j in range(thermometers))
    force = (*FORCE_CHANNELS, ROTATION_CHANNEL) if with_force else ()
    return (*AXES, *REFERENCE_CHANNELS, *temperatures, *force)


class CellAverager:
    """Collects wrenches and completed thermal cells, h = period_ns, into rows."""

    def __init__(self, period_ns: int, thermometers: int, *, with_force: bool = False) -> None:
        self._period_ns, self._thermometers = period_ns, thermometers
        self._with_force = with_force
        self._raw, self._reference = _CellMeans(), _CellMeans()
        self._force, self._square_speed = _CellMeans(3), _CellMeans(1)
        self._all = self._raw, self._reference, self._force, self._square_speed
        self._waiting: list[tuple[int, list[float]]] = []
        #: Whether wrenches got rows of their own since the last temperature.
        self._silent = False

    def add_raw(self, stamp_ns: int, wrench: Sequence[float]) -> None:
        """Take a raw wrench, N and N m, axis order AXES."""
        self._raw.add(stamp_ns // self._period_ns, wrench)

    def add_reference(self, stamp_ns: int, wrench: Sequence[float]) -> None:
        """Take a reference wrench, N and N m, axis order AXES."""
        self._reference.add(stamp_ns // self._period_ns, wrench)

    def add_force(self, stamp_ns: int, force: Sequence[float], speed: float | None) -> None:
        """Take a specific force, m/s², and the speed of rotation, rad/s, where it is known."""
        self._force.add(stamp_ns // self._period_ns, force)
        if speed is not None:
            self._square_speed.add(stamp_ns // self._period_ns, (speed * speed,))

    def add_cells(self, completed: Sequence[CompletedCells]) -> None:
        """Take cells whose temperatures are complete; held values are not written as measured."""
        for cells in completed:
            self._silent = False
            temperatures = [
                float(value) if measured else _NAN
                for value, measured in zip(cells.temperature_c, cells.measured, strict=True)
            ]
            first, end = cells.first_cell, cells.first_cell + cells.count
            self._waiting.append((first, temperatures))
            self._waiting += [(cell, temperatures) for cell in self._raw.between(first + 1, end)]

    def rows(self, *, final: bool = False) -> list[Row]:
        """Take rows that are complete or overdue, but not empty; all, when nothing more comes."""
        return [row for row in self._complete(final=final) if not all(map(isnan, row[1]))]

    def _complete(self, *, final: bool) -> Iterator[Row]:
        """Take complete cells, those without any sample included."""
        yield from self._complete_with_temperatures(final=final)
        absent = [_NAN] * self._thermometers
        held = 0 if final and self._silent else _HELD_CELLS
        for cell in sorted({cell for means in self._all for cell in means.overdue(held)}):
            self._silent = True
            yield self._row(cell, absent)
            for means in self._all:
                means.begin = cell + 1

    def _complete_with_temperatures(self, *, final: bool) -> Iterator[Row]:
        """Take cells whose temperatures are complete, too."""
        while self._waiting:
            cell, temperatures = self._waiting[0]
            overdue = self._waiting[-1][0] - cell > _PATIENCE_CELLS
            # A reference is waited for when there is one at all, and so is specific force.
            others = (self._reference.latest, self._force.latest)
            behind = self._raw.latest <= cell or any(0 <= latest <= cell for latest in others)
            if behind and not overdue and not final:
                return
            del self._waiting[0]
            yield self._row(cell, temperatures)
            for means in self._all:
                means.forget_before(cell)

    def _row(self, cell: int, temperatures: list[float]) -> Row:
        """Make a cell's row of its temperatures, °C, and its means."""
        values = [*self._raw.pop(cell), *self._reference.pop(cell), *temperatures]
        force, square = self._force.pop(cell), *self._square_speed.pop(cell)
        values += [*force, sqrt(square)] if self._with_force else []
        return cell * self._period_ns + self._period_ns // 2, values


class _CellMeans:
    """Sums of one channel of several numbers per cell."""

    def __init__(self, width: int = len(AXES)) -> None:
        self._width = width
        self.latest = -1
        self._cells: dict[int, list[float]] = {}
        #: Cells before it have their row; what comes for them is too late.
        self.begin: int | None = None

    def add(self, cell: int, wrench: Sequence[float]) -> None:
        """Add one wrench to its cell."""
        self.latest = max(self.latest, cell)
        if self.begin is not None and cell < self.begin:
            return
        sums = self._cells.get(cell)
        if sums is None:
            self._cells[cell] = [1.0, *wrench]
            return
        sums[0] += 1.0
        for i, value in enumerate(wrench, start=1):
            sums[i] += value

    def overdue(self, held: int) -> list[int]:
        """List the oldest cells, those that are more than may be held."""
        return sorted(self._cells)[: max(len(self._cells) - held, 0)]

    def between(self, first: int, end: int) -> list[int]:
        """List the cells from first to end, end excluded, that have a wrench."""
        return sorted(cell for cell in self._cells if first <= cell < end)

    def pop(self, cell: int) -> list[float]:
        """Take a cell's means, NaN where there were none."""
        sums = self._cells.pop(cell, None)
        return [_NAN] * self._width if sums is None else [value / sums[0] for value in sums[1:]]

    def forget_before(self, cell: int) -> None:
        """Drop what came too late."""
        for old in [number for number in self._cells if number < cell]:
            del self._cells[old]
