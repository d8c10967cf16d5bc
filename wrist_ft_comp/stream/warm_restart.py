"""
Warm restarts: what a stream leaves behind, and how the next one goes on from it.

Thermal memory is an hour long, a restart takes seconds. Between the last cell of the old stream
and the first one of the new, temperatures are taken to have moved along a straight line. After a
gap of several time constants hardly anything of the memory is left, and what the temperatures did
meanwhile matters more; then, or when the stamps make no sense, the sensor counts as soaked.
"""

from dataclasses import dataclass

import numpy as np

from wrist_ft_comp.model import drift_model
from wrist_ft_comp.model.drift_model import Drift, DriftModel, DriftState
from wrist_ft_comp.model.signals import FloatArray, NANOSECONDS

#: After this many time constants a twentieth of what was remembered is left.
TIME_CONSTANTS = 3.0
#: A restart is allowed this long, s, however short a model's memory is.
LEAST_GAP_S = 60.0
#: The stream keeps no more cells than these hours hold either.
MOST_GAP_S = 6 * 3600.0
#: Temperatures are remembered as means over spans of this, s.
SPAN_S = 60.0
#: A clock that lost more than this against another one was not running all the time, s.
_SLIP_S = 60.0


@dataclass(frozen=True, eq=False)
class ThermalMemory:
    """What a stream remembers of the temperatures."""

    #: Stamp at which the last completed thermal cell ended, and cell length h, ns.
    end_ns: int
    period_ns: int
    #: Of the last cell, °C, shape (J,), and the filter state of each modelled axis after it.
    temperature_c: FloatArray
    filters: DriftState
    #: What was being subtracted, arrays of shape (6,).
    compensation: Drift
    #: Mean temperatures of consecutive spans of cells, °C, shape (J,), and how many cells each
    #: has; oldest first, up to the last cell. For another model that goes live after the restart.
    history: tuple[tuple[FloatArray, int], ...]


def slowest_time_constant_s(model: DriftModel) -> float:
    """Find the time, s, after which a model has forgotten all but 1/e: τ = -h / ln |pole|."""
    radii = np.concatenate([[0.0], *(np.abs(axis.poles) for axis in model.axes.values())])
    period_s = model.period_ns / NANOSECONDS
    return float(-period_s / np.log(radii.max())) if radii.max() > 0 else 0.0


def longest_gap_s(model: DriftModel) -> float:
    """Choose the longest gap, s, after which a model's memory is worth something."""
    return min(max(TIME_CONSTANTS * slowest_time_constant_s(model), LEAST_GAP_S), MOST_GAP_S)


def belongs_to(model: DriftModel, memory: ThermalMemory) -> bool:
    """Tell whether a memory, perhaps from a file, has a model's form, so that it can go on."""
    seen = (memory.temperature_c, *(mean for mean, _ in memory.history))
    if any(each.shape != (model.thermometers,) for each in seen):
        return False
    form = drift_model.start(model, memory.temperature_c)
    if (
        memory.period_ns != model.period_ns
        or memory.filters.keys() != form.keys()
        or any(memory.filters[axis].shape != form[axis].shape for axis in form)
    ):
        return False
    with np.errstate(all='ignore'):
        _, drift = drift_model.step(model, memory.filters, memory.temperature_c)
    return bool(np.isfinite(drift).all())


def fill_gap(
    model: DriftModel,
    memory: ThermalMemory,
    first_cell: int,
    temperature_c: FloatArray,
    at_least_s: float,
) -> tuple[FloatArray | None, str]:
    """Judge the gap from a memory to the first thermal cell, at temperatures after it."""
    # Gives the temperatures of the N cells in it, °C, (N, J), None when the memory is of no use,
    # and says what is done, and why.
    # By another clock it was ``at_least_s`` long, 0 without one: stamps that moved on by much less
    # belong to a clock that was set or stood still.
    cells = first_cell - memory.end_ns // model.period_ns
    gap_s = cells * model.period_ns / NANOSECONDS
    problem = ''
    if gap_s < -_SLIP_S:
        problem = (
            f'the saved thermal state is {-gap_s:.0f} s ahead of the temperatures: their stamps '
            'are of another clock, or time ran back'
        )
    elif gap_s < at_least_s - _SLIP_S:
        problem = (
            f'the stamps of the temperatures moved on by {gap_s:.0f} s while {at_least_s:.0f} s '
            'passed since the thermal state was saved: their clock was set'
        )
    elif gap_s > longest_gap_s(model):
        problem = too_old(model, gap_s)
    if problem:
        soaked = 'so the drift starts at the steady state of the present temperatures'
        return None, f'{problem}; {soaked}'
    # The way from the last cell (share 0) to the first one (share 1), ends excluded.
    between_ends = max(cells, 0)
    shares = np.arange(1, between_ends + 1)[:, np.newaxis] / (between_ends + 1)
    between = memory.temperature_c + shares * (temperature_c - memory.temperature_c)
    return between, f'the drift goes on from the thermal state saved {gap_s:.0f} s before'


def too_old(model: DriftModel, gap_s: float) -> str:
    """Say, as the first half of a sentence, that a memory is too old, by its age, s."""
    return (
        f'the saved thermal state is {gap_s:.0f} s old and this model remembers '
        f'{longest_gap_s(model):.0f} s'
    )
