"""
What a stream remembers of the temperatures, for another model and for the time after a restart.

The sensor remembers an hour of temperatures, and a restart takes seconds. For the next stream, the
time between is a gap in the temperatures like any other (``stream/gap.py``).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from wrist_ft_comp.drift import drift_model
from wrist_ft_comp.drift.drift_model import Drift, DriftModel, DriftState
from wrist_ft_comp.series import FloatArray
from wrist_ft_comp.stream.thermometer_prediction import start, ThermometerState


class History:
    """Keeps the newest cells of J thermometers, ``most`` at most."""

    def __init__(self, thermometers: int, most: int) -> None:
        self._most, self._end = most, 0
        self._rows: FloatArray = np.zeros((0, thermometers))

    def __len__(self) -> int:
        return min(self._end, self._most)

    @property
    def temperature_c(self) -> FloatArray:
        """What was believed, °C, shape (N, J), oldest first."""
        return self._rows[self._end - len(self) : self._end]

    def add(self, temperature_c: FloatArray) -> None:
        """Add cells, °C, shape (n, J)."""
        rows = temperature_c[-self._most :]
        if self._end + len(rows) > len(self._rows):
            kept = self.temperature_c
            self._rows = np.zeros((2 * self._most, rows.shape[1]))
            self._rows[: len(kept)], self._end = kept, len(kept)
        self._rows[self._end : self._end + len(rows)] = rows
        self._end += len(rows)


class Block(NamedTuple):
    """Mean temperatures, °C, shape (J,), of a number of consecutive cells."""

    temperature_c: FloatArray
    cells: int


@dataclass(frozen=True, eq=False)
class ThermalMemory:
    """What a stream remembers of the temperatures."""

    #: Stamp at which the last completed thermal cell ended, and cell length h, ns.
    end_ns: int
    period_ns: int
    #: As they were read last, °C, shape (J,).
    temperature_c: FloatArray
    #: For how many cells each thermometer has been silent, shape (J,).
    silent: tuple[int, ...]
    #: State of every modelled axis after the last cell.
    filters: DriftState
    #: What was being subtracted, arrays of shape (6,).
    compensation: Drift
    #: The cells of the start, °C, (n, J): the sensor had soaked at their mean temperature.
    start_c: FloatArray
    #: The cells until now, oldest first, for another model that goes live after the restart.
    history: tuple[Block, ...]
    #: What is known of the thermometers; None where they are not predicted.
    thermometers: ThermometerState | None = None


def blocks_of(temperature_c: FloatArray, cells: int) -> tuple[Block, ...]:
    """
    Average temperatures, °C, shape (N, J), over blocks of some cells.

    The first cell is a block of its own, because a model starts from it.
    """
    if not len(temperature_c):
        return ()
    begins = np.array([0, *range(1, len(temperature_c), cells)])
    counts = np.diff(begins, append=len(temperature_c))
    means = np.add.reduceat(temperature_c, begins, axis=0) / counts[:, np.newaxis]
    return tuple(map(Block, means, counts.tolist()))


def belongs_to(model: DriftModel, memory: ThermalMemory) -> bool:
    """Whether a memory, perhaps from a file, has the shapes of a model, so that it can be used."""
    shape, start_c = (model.thermometers,), memory.start_c
    rows = (memory.temperature_c, *start_c, *(mean_c for mean_c, _ in memory.history))
    if len(memory.silent) != model.thermometers or any(row.shape != shape for row in rows):
        return False
    if memory.period_ns != model.period_ns or not 0 < len(start_c) <= model.start_cells:
        return False
    if _shapes(memory.filters) != _shapes(drift_model.start(model, memory.temperature_c)):
        return False
    if (memory.thermometers is None) != (model.prediction is None):
        return False
    if memory.thermometers is not None and model.prediction is not None:
        known = start(model.prediction, memory.temperature_c)
        if _shapes(vars(memory.thermometers)) != _shapes(vars(known)):
            return False
    with np.errstate(all='ignore'):
        _, drift = drift_model.step(model, memory.filters, memory.temperature_c)
    return bool(np.isfinite(drift).all())


def _shapes(arrays: Mapping[str, Any]) -> dict[str, tuple[int, ...]]:
    return {name: np.shape(array) for name, array in arrays.items()}
