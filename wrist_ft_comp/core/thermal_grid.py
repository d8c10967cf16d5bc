"""
The thermal grid as a stream: samples of several thermometers in, completed cells out.

It gives the temperatures that GridBuilder gives for the same samples. A cell is complete when every
thermometer has delivered a later one, or when the others are ahead of a silent one by more than the
patience. Time comes in with the samples.
"""

import math
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.core.recording import FloatArray


class CompletedCells(NamedTuple):
    """
    Consecutive cells with the same temperatures: one that was measured, or held ones after a gap.

    Attributes
    ----------
    first_cell : int
        Number of the first cell.
    count : int
        How many cells.
    temperature_c : ndarray, shape (J,)
        Mean or held temperatures, °C.
    measured : tuple of J bool
        Which thermometers had a sample of their own.

    """

    first_cell: int
    count: int
    temperature_c: FloatArray
    measured: tuple[bool, ...]


class ThermalGrid:
    """
    Averages temperatures per cell as they arrive.

    Parameters
    ----------
    period_ns : int
        Cell length h, ns.
    thermometers : int
        Number of thermometers J.
    patience_s : float
        How long a silent thermometer may hold the others up, s; then its last value is held.

    """

    def __init__(self, period_ns: int, thermometers: int, patience_s: float) -> None:
        self.period_ns = period_ns
        self.rejected = 0
        self.restarts = 0
        self._thermometers = thermometers
        self._patience = max(1, math.ceil(patience_s * 1e9 / period_ns))
        self._latest: list[int | None] = [None] * thermometers
        self._last_stamp_ns: list[int | None] = [None] * thermometers
        self._held: list[float] = [math.nan] * thermometers
        self._next: int | None = None
        self._open: dict[int, tuple[list[float], list[int]]] = {}

    def add(self, thermometer: int, stamp_ns: int, temperature_c: float) -> list[CompletedCells]:
        """
        Take one sample.

        Parameters
        ----------
        thermometer : int
            Which one, counted from 0.
        stamp_ns : int
            Its stamp, ns. A stamp that does not increase is dropped and counted; one that is
            behind by more than the patience restarts the grid there.
        temperature_c : float
            °C; a value that is not finite is dropped and counted.

        Returns
        -------
        list of CompletedCells
            Often empty, usually at most one.

        """
        if not math.isfinite(temperature_c):
            self.rejected += 1
            return []
        cell = stamp_ns // self.period_ns
        last = self._last_stamp_ns[thermometer]
        if last is not None and stamp_ns <= last:
            if cell >= last // self.period_ns - self._patience:
                self.rejected += 1
                return []
            self._restart()
        self._last_stamp_ns[thermometer] = stamp_ns
        if self._next is not None and cell < self._next:
            self.rejected += 1
            return []
        self._latest[thermometer] = cell
        sums, counts = self._open.setdefault(
            cell, ([0.0] * self._thermometers, [0] * self._thermometers)
        )
        sums[thermometer] += temperature_c
        counts[thermometer] += 1
        return self._complete()

    def _restart(self) -> None:
        """Begin anew after time ran back; the last values stay held."""
        self.restarts += 1
        self._latest = [None] * self._thermometers
        self._last_stamp_ns = [None] * self._thermometers
        self._next = None
        self._open.clear()

    def _complete(self) -> list[CompletedCells]:
        """Emit all cells that no sample can be expected for any more."""
        known = [cell for cell in self._latest if cell is not None]
        if len(known) < self._thermometers:
            return []
        end = max(min(known), max(known) - self._patience)
        if self._next is None:
            # As in a batch: begin with the first cell by whose end all have reported.
            self._next = max(
                min(cell for cell, (_, counts) in self._open.items() if counts[j])
                for j in range(self._thermometers)
            )
            for cell in sorted(cell for cell in self._open if cell < self._next):
                self._hold(*self._open.pop(cell))
        done: list[CompletedCells] = []
        for cell in sorted(cell for cell in self._open if cell < end):
            if cell > self._next:
                done.append(self._emit(cell))
            sums, counts = self._open.pop(cell)
            self._hold(sums, counts)
            done.append(self._emit(cell + 1, tuple(count > 0 for count in counts)))
        if end > self._next:
            done.append(self._emit(end))
        return done

    def _hold(self, sums: list[float], counts: list[int]) -> None:
        """Make a cell's means the held values."""
        for j, count in enumerate(counts):
            if count:
                self._held[j] = sums[j] / count

    def _emit(self, end: int, measured: tuple[bool, ...] | None = None) -> CompletedCells:
        """Emit the cells up to end with the values that are held now."""
        assert self._next is not None  # noqa: S101 -- set before anything is emitted
        cells = CompletedCells(
            self._next,
            end - self._next,
            np.array(self._held),
            measured or (False,) * self._thermometers,
        )
        self._next = end
        return cells
