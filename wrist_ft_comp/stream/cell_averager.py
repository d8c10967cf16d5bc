"""
Reducing a running stream to one row per thermal cell: what the node's own recording holds.

The fit works on cell means, so a row per cell loses nothing that it would use, and an hour at
1 kHz is 3600 rows.
"""

from collections.abc import Iterator, Sequence
from math import isnan

from wrist_ft_comp.model.signals import AXES, REFERENCE_CHANNELS, temperature_channel
from wrist_ft_comp.model.stream_grid import CompletedCells

_NAN = float('nan')


#: Rows wait at most this many cells for wrenches that are late.
_PATIENCE_CELLS = 50


Row = tuple[int, list[float]]


def row_channels(thermometers: int) -> tuple[str, ...]:
    """
    Name the columns of a row.

    Parameters
    ----------
    thermometers : int
        Number of thermometers J.

    Returns
    -------
    tuple of str, length 12 + J
        Raw wrench, reference wrench, temperatures.

    """
    temperatures = tuple(temperature_channel(j) for j in range(thermometers))
    return (*AXES, *REFERENCE_CHANNELS, *temperatures)


class _CellMeans:
    """Sums of one wrench channel per cell."""

    def __init__(self) -> None:
        self.latest = -1
        self._cells: dict[int, list[float]] = {}

    def add(self, cell: int, wrench: Sequence[float]) -> None:
        """Add one wrench to its cell."""
        self.latest = max(self.latest, cell)
        sums = self._cells.get(cell)
        if sums is None:
            self._cells[cell] = [1.0, *wrench]
            return
        sums[0] += 1.0
        for i, value in enumerate(wrench, start=1):
            sums[i] += value

    def between(self, first: int, end: int) -> list[int]:
        """List the cells from first to end, end excluded, that have a wrench."""
        return sorted(cell for cell in self._cells if first <= cell < end)

    def pop(self, cell: int) -> list[float]:
        """Take a cell's means, NaN where there were none."""
        sums = self._cells.pop(cell, None)
        return [_NAN] * len(AXES) if sums is None else [value / sums[0] for value in sums[1:]]

    def forget_before(self, cell: int) -> None:
        """Drop what came too late."""
        for old in [number for number in self._cells if number < cell]:
            del self._cells[old]


class CellAverager:
    """
    Collects wrenches and completed thermal cells into rows.

    Parameters
    ----------
    period_ns : int
        Cell length h, ns.

    """

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._raw = _CellMeans()
        self._reference = _CellMeans()
        self._waiting: list[tuple[int, list[float]]] = []

    def add_raw(self, stamp_ns: int, wrench: Sequence[float]) -> None:
        """Take a raw wrench, N and N m, axis order AXES."""
        self._raw.add(stamp_ns // self._period_ns, wrench)

    def add_reference(self, stamp_ns: int, wrench: Sequence[float]) -> None:
        """Take a reference wrench, N and N m, axis order AXES."""
        self._reference.add(stamp_ns // self._period_ns, wrench)

    def add_cells(self, completed: Sequence[CompletedCells]) -> None:
        """Take cells whose temperatures are complete; held values are not written as measured."""
        for cells in completed:
            temperatures = [
                float(value) if measured else _NAN
                for value, measured in zip(cells.temperature_c, cells.measured, strict=True)
            ]
            first, end = cells.first_cell, cells.first_cell + cells.count
            self._waiting.append((first, temperatures))
            self._waiting += [(cell, temperatures) for cell in self._raw.between(first + 1, end)]

    def rows(self, *, final: bool = False) -> list[Row]:
        """
        Take the rows that are complete: later wrenches have come, or they are overdue.

        Parameters
        ----------
        final : bool
            Take all, because nothing more will come.

        Returns
        -------
        list of tuples of int and list of float
            Stamp of the cell's middle, ns, and values in the order of row_channels; cells
            without any sample are left out.

        """
        return [row for row in self._complete(final=final) if not all(map(isnan, row[1]))]

    def _complete(self, *, final: bool) -> Iterator[Row]:
        """Take complete cells, those without any sample included."""
        while self._waiting:
            cell, temperatures = self._waiting[0]
            overdue = self._waiting[-1][0] - cell > _PATIENCE_CELLS
            # A reference is waited for when there is one at all.
            behind = self._raw.latest <= cell or 0 <= self._reference.latest <= cell
            if behind and not overdue and not final:
                return
            del self._waiting[0]
            values = [*self._raw.pop(cell), *self._reference.pop(cell), *temperatures]
            yield cell * self._period_ns + self._period_ns // 2, values
            self._raw.forget_before(cell)
            self._reference.forget_before(cell)
