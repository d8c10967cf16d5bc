"""
Warm restarts: what a stream saves, so that the next one continues from it.

The sensor remembers an hour of temperatures, and a restart takes seconds. For the next stream, the
time between is a gap in the temperatures like any other (``stream/gap.py``).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.drift import drift_model
from wrist_ft_comp.drift.drift_model import Drift, DriftModel, DriftState
from wrist_ft_comp.signals import FloatArray
from wrist_ft_comp.stream.thermometer_prediction import start, ThermometerState


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
    shape, cells = (model.thermometers,), memory.start_c
    rows = (memory.temperature_c, *cells, *(mean for mean, _ in memory.history))
    if len(memory.silent) != model.thermometers or any(row.shape != shape for row in rows):
        return False
    if not 0 < len(cells) <= model.start_cells:
        return False
    filters = drift_model.start(model, memory.temperature_c)
    if (
        memory.period_ns != model.period_ns
        or memory.filters.keys() != filters.keys()
        or any(memory.filters[axis].shape != filters[axis].shape for axis in filters)
    ):
        return False
    state, prediction = memory.thermometers, model.prediction
    if (state is None) != (prediction is None):
        return False
    if state is not None and prediction is not None:
        expected = vars(start(prediction, memory.temperature_c))
        if any(np.shape(part) != np.shape(expected[name]) for name, part in vars(state).items()):
            return False
    with np.errstate(all='ignore'):
        _, drift = drift_model.step(model, memory.filters, memory.temperature_c)
    return bool(np.isfinite(drift).all())
