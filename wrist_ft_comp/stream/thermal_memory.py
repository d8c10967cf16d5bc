"""
Warm restarts: what a stream saves, so that the next one continues from it.

The sensor remembers an hour of temperatures, and a restart takes seconds. For the next stream, the
time between is a gap in the temperatures like any other (``stream/gap.py``).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.drift import drift_model
from wrist_ft_comp.drift.drift_model import Drift, DriftModel, DriftState
from wrist_ft_comp.signals import AXES, FloatArray


class Block(NamedTuple):
    """Mean temperatures, °C, shape (J,), of a number of consecutive cells."""

    temperature_c: FloatArray
    cells: int


@dataclass(frozen=True, eq=False)
class OpenCells:
    """Cells in which a thermometer is silent; they change when it reports again."""

    #: Whether the sensor had soaked before them. If not, the filter state is that before them.
    from_rest: bool
    #: For how many cells each thermometer has been silent, shape (J,).
    silent: tuple[int, ...]
    #: Their temperatures, held where a thermometer is silent; oldest first.
    blocks: tuple[Block, ...]


@dataclass(frozen=True, eq=False)
class Distrust:
    """Which thermometers are replaced, and what keeps the drift from stepping."""

    #: Why, by the number of the thermometer, counted from 1.
    replaced: Mapping[str, str]
    #: As in ``agreement.Offsets``, shapes (2, 6).
    kept: FloatArray
    released: FloatArray


@dataclass(frozen=True, eq=False)
class ThermalMemory:
    """What a stream remembers of the temperatures."""

    #: Stamp at which the last completed thermal cell ended, and cell length h, ns.
    end_ns: int
    period_ns: int
    #: Of the last cell, °C, shape (J,).
    temperature_c: FloatArray
    #: State of every modelled axis after the last cell, or before the open cells.
    filters: DriftState
    #: What was being subtracted, arrays of shape (6,).
    compensation: Drift
    #: The cells up to the filter state, oldest first, for another model that goes live after the
    #: restart.
    history: tuple[Block, ...]
    #: The last cells, which may still change; None when no thermometer is silent.
    open_cells: OpenCells | None = None
    #: None when all thermometers are believed, and always were.
    distrust: Distrust | None = None


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
    shape, blocks = (model.thermometers,), memory.history
    if memory.open_cells is not None:
        blocks = (*blocks, *memory.open_cells.blocks)
        if len(memory.open_cells.silent) != model.thermometers:
            return False
    if memory.distrust is not None:
        numbers = {str(j + 1) for j in range(model.thermometers)}
        if model.prediction is None or not memory.distrust.replaced.keys() < numbers:
            return False
        if {memory.distrust.kept.shape, memory.distrust.released.shape} != {(2, len(AXES))}:
            return False
    if any(c.shape != shape for c in (memory.temperature_c, *(mean for mean, _ in blocks))):
        return False
    start = drift_model.start(model, memory.temperature_c)
    if (
        memory.period_ns != model.period_ns
        or memory.filters.keys() != start.keys()
        or any(memory.filters[axis].shape != start[axis].shape for axis in start)
    ):
        return False
    with np.errstate(all='ignore'):
        _, drift = drift_model.step(model, memory.filters, memory.temperature_c)
    return bool(np.isfinite(drift).all())
