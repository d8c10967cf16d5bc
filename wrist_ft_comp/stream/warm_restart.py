"""
Warm restarts: what a stream leaves behind, so that the next one goes on from it.

Thermal memory is an hour long, a restart takes seconds. To the stream that goes on, the time
between is a gap in the temperatures like any other (``stream/gap.py``).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.drift import drift_model
from wrist_ft_comp.drift.drift_model import Drift, DriftModel, DriftState
from wrist_ft_comp.signals import FloatArray


class Block(NamedTuple):
    """Mean temperatures, °C, shape (J,), of a number of consecutive cells."""

    temperature_c: FloatArray
    cells: int


@dataclass(frozen=True, eq=False)
class OpenCells:
    """Cells whose temperatures change when a thermometer comes back that is silent in them."""

    #: Whether the sensor had soaked before them; otherwise the filter state is that before them.
    from_rest: bool
    #: For how many cells each thermometer has been silent, shape (J,).
    silent: tuple[int, ...]
    #: Their temperatures, held where a thermometer is silent; oldest first.
    blocks: tuple[Block, ...]


@dataclass(frozen=True, eq=False)
class ThermalMemory:
    """What a stream remembers of the temperatures."""

    #: Stamp at which the last completed thermal cell ended, and cell length h, ns.
    end_ns: int
    period_ns: int
    #: Of the last cell, °C, shape (J,), and the filter state of each modelled axis after it, or
    #: before the open cells.
    temperature_c: FloatArray
    filters: DriftState
    #: What was being subtracted, arrays of shape (6,).
    compensation: Drift
    #: The cells up to the filter state, oldest first, for another model that goes live after the
    #: restart.
    history: tuple[Block, ...]
    #: The cells at the end that are not settled; None when all are.
    open_cells: OpenCells | None = None


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
    """Tell whether a memory, perhaps from a file, has a model's form, so that it can go on."""
    shape, blocks = (model.thermometers,), memory.history
    if memory.open_cells is not None:
        blocks = (*blocks, *memory.open_cells.blocks)
        if len(memory.open_cells.silent) != model.thermometers:
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
