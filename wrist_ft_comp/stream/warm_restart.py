"""
Warm restarts: what a stream leaves behind, and how the next one goes on from it.

Thermal memory is an hour long, a restart takes seconds. Between the last cell of the old stream
and the first one of the new, temperatures are taken to have moved along a straight line. After a
gap of several time constants hardly anything of the memory is left, and what the temperatures did
meanwhile matters more; then, or when the stamps make no sense, the sensor counts as soaked.
"""

from dataclasses import dataclass
from typing import NamedTuple

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


#: Length of a block of history, s.
BLOCK_S = 60.0


#: A clock that lost more than this against another one was not running all the time, s.
_SLIP_S = 60.0


@dataclass(frozen=True, eq=False)
class ThermalMemory:
    """
    What a stream remembers of the temperatures.

    Attributes
    ----------
    end_ns : int
        Stamp at which the last completed thermal cell ended, ns.
    period_ns : int
        Cell length h, ns.
    temperature_c : ndarray, shape (J,)
        Of the last cell, °C.
    filters : DriftState
        Filter state of each modelled axis after that cell.
    compensation : Drift
        What was being subtracted, arrays of shape (6,).
    history : tuple of tuples of ndarray, shape (J,), and int
        Mean temperatures of consecutive blocks of cells, °C, and how many cells each has; oldest
        first, up to the last cell. For another model that goes live after the restart.

    """

    end_ns: int
    period_ns: int
    temperature_c: FloatArray
    filters: DriftState
    compensation: Drift
    history: tuple[tuple[FloatArray, int], ...]


class GapFill(NamedTuple):
    """
    How a gap is crossed.

    Attributes
    ----------
    temperature_c : ndarray, shape (N, J), or None
        Temperatures of the N cells in it, °C; None when the memory is of no use.
    sentence : str
        What is done, and why.

    """

    temperature_c: FloatArray | None
    sentence: str


def slowest_time_constant_s(model: DriftModel) -> float:
    """
    Find the time after which a model has forgotten all but 1/e of anything.

    Parameters
    ----------
    model : DriftModel
        The model.

    Returns
    -------
    float
        τ = -h / ln |pole| of the slowest pole, s; 0 without memory.

    """
    radii = [
        float(radius)
        for axis in model.axes.values()
        for radius in np.abs(axis.poles)
        if radius > 0
    ]
    period_s = model.period_ns / NANOSECONDS
    return max((-period_s / np.log(radius) for radius in radii), default=0.0)


def longest_gap_s(model: DriftModel) -> float:
    """
    Choose the longest gap after which a model's memory is worth something.

    Parameters
    ----------
    model : DriftModel
        The model.

    Returns
    -------
    float
        TIME_CONSTANTS of the slowest, within bounds, s.

    """
    return min(max(TIME_CONSTANTS * slowest_time_constant_s(model), LEAST_GAP_S), MOST_GAP_S)


def belongs_to(model: DriftModel, memory: ThermalMemory) -> bool:
    """
    Tell whether a memory has the form of a model's.

    Parameters
    ----------
    model : DriftModel
        The model.
    memory : ThermalMemory
        From a file, perhaps.

    Returns
    -------
    bool
        Whether period, thermometers, axes and orders are the same, and the model can go on.

    """
    if memory.temperature_c.shape != (model.thermometers,):
        return False
    if any(block.shape != (model.thermometers,) for block, _ in memory.history):
        return False
    form = drift_model.start(model, memory.temperature_c)
    if (
        memory.period_ns != model.period_ns
        or memory.filters.keys() != form.keys()
        or any(memory.filters[axis].shape != form[axis].shape for axis in form)
    ):
        return False
    with np.errstate(all='ignore'):
        _, target = drift_model.step(model, memory.filters, memory.temperature_c)
    return bool(np.isfinite(target).all())


def fill_gap(
    model: DriftModel,
    memory: ThermalMemory,
    first_cell: int,
    temperature_c: FloatArray,
    at_least_s: float,
) -> GapFill:
    """
    Judge the gap between a memory and the first thermal cell after a restart.

    Parameters
    ----------
    model : DriftModel
        The model, to which the memory belongs.
    memory : ThermalMemory
        What the stream before left.
    first_cell : int
        Number of the first cell.
    temperature_c : ndarray, shape (J,)
        Its temperatures, °C.
    at_least_s : float
        How long the gap was by another clock; stamps that moved on by much less belong to a clock
        that was set or stood still. 0 when there is no other.

    Returns
    -------
    GapFill
        The temperatures in the gap, or why there are none.

    """
    cells = first_cell - memory.end_ns // model.period_ns
    gap_s = cells * model.period_ns / NANOSECONDS
    soaked = 'so the drift starts at the steady state of the present temperatures'
    if gap_s < -_SLIP_S:
        return GapFill(
            None,
            f'the saved thermal state is {-gap_s:.0f} s ahead of the temperatures: their stamps '
            f'are of another clock, or time ran back; {soaked}',
        )
    if gap_s < at_least_s - _SLIP_S:
        return GapFill(
            None,
            f'the stamps of the temperatures moved on by {gap_s:.0f} s while {at_least_s:.0f} s '
            f'passed since the thermal state was saved: their clock was set; {soaked}',
        )
    if gap_s > longest_gap_s(model):
        return GapFill(None, f'{too_old(model, gap_s)}; {soaked}')
    # The way from the last cell (share 0) to the first one (share 1), ends excluded.
    shares = np.arange(1, max(cells, 0) + 1)[:, np.newaxis] / (max(cells, 0) + 1)
    between = memory.temperature_c + shares * (temperature_c - memory.temperature_c)
    return GapFill(between, f'the drift goes on from the thermal state saved {gap_s:.0f} s before')


def too_old(model: DriftModel, gap_s: float) -> str:
    """
    Say that a memory is too old.

    Parameters
    ----------
    model : DriftModel
        The model.
    gap_s : float
        The memory's age, s.

    Returns
    -------
    str
        The first half of a sentence.

    """
    return (
        f'the saved thermal state is {gap_s:.0f} s old and this model remembers '
        f'{longest_gap_s(model):.0f} s'
    )
