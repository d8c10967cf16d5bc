"""The state file, from which a restart continues."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.drift import drift_model
from wrist_ft_comp.drift.drift_model import DriftModel, DriftState
from wrist_ft_comp.errors import StateFileError
from wrist_ft_comp.series import FloatArray
from wrist_ft_comp.stored.safe_file import Kind, MAKE_ROOM, to_plain
from wrist_ft_comp.stream import failed_thermometers
from wrist_ft_comp.stream.failed_thermometers import ThermometerState
from wrist_ft_comp.stream.gaps_and_restarts import ThermalMemory

# The state of six axes with banks of filters takes a few kilobytes.
KIND = Kind(
    name='state file', says='wrist_ft_comp state', version=3, max_bytes=1_000_000,
    error=StateFileError, made_by='A running node makes one.',
    renewed_by='Remove it',
    remedy=f'{MAKE_ROOM} until then a restart loses the thermal state and the tare.')  # fmt: skip

#: No larger number is read, and neither NaN nor infinities.
_LARGEST = 1e100
#: Most cells of a block of the history: a file must not take all memory.
_MOST_CELLS = 1000


@dataclass(frozen=True, eq=False)
class SavedState:
    """State of a node at the time of the save."""

    #: System time of the save, UTC, ns.
    saved_ns: int
    #: Of the model that was live; None when there was none.
    model_sha256: str | None
    #: Shape (6,), N and N m, axis order AXES.
    tare: FloatArray
    #: None when no temperature had come.
    thermal: ThermalMemory | None
    #: As the tare, of the external wrench.
    external_tare: FloatArray = field(default_factory=lambda: np.zeros(len(AXES)))
    #: Whether somebody tared; a change of model makes tares without that, too.
    tared: bool = True
    #: Why the zero may be another one since the last tare.
    zero_doubts: tuple[str, ...] = ()
    #: The publishers of raw wrenches, by their identity in the graph.
    drivers: tuple[str, ...] = ()
    #: The payload that was chosen at run time, in words.
    payload: str = ''
    #: The weight that was taken off at the tare, and how it was turned, in words.
    weighed: str = ''
    #: How far models that were live before may have left the tare off, as the tare.
    tare_deviation: FloatArray = field(default_factory=lambda: np.zeros(len(AXES)))


def save_state(path: Path, state: SavedState) -> None:
    """Write a state file, without numbers that could not be read again."""
    document, no_tare = to_plain(state), [0.0] * len(AXES)
    for name, nothing in (('thermal', None), ('tare', no_tare), ('external_tare', no_tare)):
        if not _readable(document[name]):
            document[name] = nothing
    KIND.save(path, document, indent=None)


def load_state(path: Path) -> SavedState | None:
    """Read a state file, of this version and whole; None when there is none."""
    state = KIND.load(SavedState, path)
    if state is None:
        return None
    memory, problem = state.thermal, ''
    wrenches = [state.tare, state.external_tare, state.tare_deviation]
    if memory is not None:
        wrenches += memory.compensation
        if memory.uncertainty is not None:
            wrenches.append(memory.uncertainty.bound)
        if any(cells < 0 for cells in memory.silent):
            problem = f'silent is {memory.silent}, and must not be negative'
        if any(not 1 <= block.cells <= _MOST_CELLS for block in memory.history):
            problem = f'a block of the history must have 1 to {_MOST_CELLS} cells'
    if any(wrench.shape != (len(AXES),) for wrench in wrenches):
        problem = 'a wrench must have six numbers'
    if not _readable(to_plain(state)):
        problem = f'it holds a number beyond {_LARGEST:g}'
    if problem:
        raise KIND.damaged(path, problem)
    return state


def _readable(value: Any) -> bool:
    """Whether the lists of a plain value hold nothing that cannot be read again."""
    if isinstance(value, dict):
        return all(map(_readable, value.values()))
    if isinstance(value, list):
        return all(item is not None and _readable(item) for item in value)
    return not isinstance(value, (int, float)) or abs(value) <= _LARGEST


def belongs_to(model: DriftModel, memory: ThermalMemory) -> bool:
    """Whether a memory, perhaps from a file, has the shapes of a model, so that it can be used."""
    shape, start_c, reading_c = (model.thermometers,), memory.start_c, memory.temperature_c
    rows = (reading_c, *start_c, *(mean_c for mean_c, _ in memory.history))
    if len(memory.silent) != model.thermometers or any(row.shape != shape for row in rows):
        return False
    if len(memory.jumps) not in {0, model.thermometers}:
        return False
    if memory.period_ns != model.period_ns or not 0 < len(start_c) <= model.start_cells:
        return False
    thermometers = None
    if model.prediction is not None:
        thermometers = failed_thermometers.start(model.prediction, reading_c)
    expected = _shapes(drift_model.start(model, reading_c), thermometers)
    if _shapes(memory.filters, memory.thermometers) != expected:
        return False
    with np.errstate(all='ignore'):
        _, drift = drift_model.run(model, memory.filters, reading_c[np.newaxis])
    return bool(np.isfinite(drift).all())


def _shapes(filters: DriftState, failed: ThermometerState | None) -> dict[str, tuple[int, ...]]:
    parts = {**filters, **(vars(failed) if failed else {})}
    return {name: np.shape(part) for name, part in parts.items()}
