"""A coarse history: means over blocks of thermal cells, small enough to be saved often."""

from collections import deque
from collections.abc import Iterator

import numpy as np

from wrist_ft_comp.core.recording import FloatArray


class Blocks:
    """
    Averages temperatures over blocks as cells complete.

    Parameters
    ----------
    cells : int
        Cells per block.
    history_cells : int
        How many cells are remembered.

    """

    def __init__(self, cells: int, history_cells: int) -> None:
        self._cells = cells
        self._done: deque[tuple[FloatArray, int]] = deque(maxlen=max(history_cells // cells, 1))
        self._sum: FloatArray = np.zeros(0)
        self._count = 0

    def add(self, temperature_c: FloatArray, count: int) -> None:
        """
        Take completed cells.

        Parameters
        ----------
        temperature_c : ndarray, shape (J,)
            Their temperatures, °C.
        count : int
            How many cells.

        """
        while count:
            part = min(count, self._cells - self._count)
            self._sum = part * temperature_c + (self._sum if self._count else 0.0)
            self._count += part
            count -= part
            # The very first cell stays alone: it is where a model starts from.
            if self._count == self._cells or not self._done:
                self._done.append((self._sum / self._count, self._count))
                self._count = 0

    def __iter__(self) -> Iterator[tuple[FloatArray, int]]:
        """
        Give the blocks, the one that is being filled included.

        Yields
        ------
        tuple of ndarray, shape (J,), and int
            Mean temperatures, °C, and how many cells they are of; oldest first.

        """
        yield from self._done
        if self._count:
            yield self._sum / self._count, self._count
