"""
The drift of all six axes: settings of the fit left behind, this is what runs.

    r_i = (1 + s_i) w_i + o_i           measurement: s sensitivity drift, o zero drift
    ŵ_i = (r_i - o_i - tare_i) / (1 + s_i)
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from wrist_ft_comp.errors import ModelFileError
from wrist_ft_comp.model.axis_model import AxisModel
from wrist_ft_comp.model.signals import AXES, FloatArray

Document = dict[str, Any]


@dataclass(frozen=True, eq=False)
class DriftModel:
    """
    Drift of a sensor.

    Attributes
    ----------
    period_ns : int
        Thermal period h, ns.
    thermometers : int
        Number of thermometers J.
    axes : mapping of str to AxisModel
        By axis name; an axis that is not there has no drift ("none").
    deviation : mapping of str to float
        By axis name, also of axes without drift: standard deviation of what the model leaves of
        the drift, from held-out data, N or N m.

    """

    period_ns: int
    thermometers: int
    axes: Mapping[str, AxisModel]
    deviation: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the names and the numbers of thermometers."""
        if self.period_ns <= 0 or self.thermometers < 1:
            raise ModelFileError(
                'A model needs a positive thermal period and at least one thermometer; got '
                f'{self.period_ns} ns and {self.thermometers}.'
            )
        for name, axis in self.axes.items():
            if name not in AXES:
                raise ModelFileError(f'Unknown axis {name!r}; expected one of {", ".join(AXES)}.')
            if axis.thermometers != self.thermometers:
                raise ModelFileError(
                    f'{name} expects {axis.thermometers} thermometers, the model has '
                    f'{self.thermometers}.'
                )

    def outside(self, temperature_c: FloatArray) -> list[int]:
        """
        Tell which thermometers read outside the calibrated range.

        Parameters
        ----------
        temperature_c : ndarray, shape (J,)
            Temperatures, °C.

        Returns
        -------
        list of int
            Their numbers, counted from 0.

        """
        return sorted(
            {
                int(j)
                for axis in self.axes.values()
                for j in np.flatnonzero(
                    (temperature_c < axis.lower_c) | (temperature_c > axis.upper_c)
                )
            }
        )

    def uncertainty(self, temperature_c: FloatArray) -> FloatArray:
        """
        Estimate how far the zero drift that is subtracted may be from the true one.

        Beyond the calibrated temperatures it grows by what the model itself says of a further
        kelvin: nobody saw whether the drift goes on like that.

        Parameters
        ----------
        temperature_c : ndarray, shape (J,)
            Temperatures, °C.

        Returns
        -------
        ndarray, shape (6,)
            Standard deviation, N and N m; NaN for axes that were not calibrated.

        """
        found = np.full(len(AXES), np.nan)
        for name, deviation in self.deviation.items():
            beyond = 0.0
            if name in self.axes:
                beyond = self.axes[name].drift_beyond_range(temperature_c)
            found[AXES.index(name)] = np.hypot(deviation, beyond)
        return found


#: Filter state of each modelled axis, by name: what the last cell left.
DriftState = Mapping[str, FloatArray]


class Drift(NamedTuple):
    """
    Zero and sensitivity drift.

    Attributes
    ----------
    zero : ndarray, shape (..., 6)
        o, N and N m, axis order AXES.
    sensitivity : ndarray, shape (..., 6)
        s, without unit.

    """

    zero: FloatArray
    sensitivity: FloatArray


def start(model: DriftModel, temperature_c: FloatArray) -> DriftState:
    """
    State of a sensor that has soaked at these temperatures.

    Parameters
    ----------
    model : DriftModel
        The model.
    temperature_c : ndarray, shape (J,)
        Temperatures, °C.

    Returns
    -------
    DriftState
        For step and run.

    """
    return {name: axis.start(temperature_c) for name, axis in model.axes.items()}


def step(
    model: DriftModel, state: DriftState, temperature_c: FloatArray
) -> tuple[DriftState, Drift]:
    """
    Advance the drift by one thermal cell.

    Parameters
    ----------
    model : DriftModel
        The model.
    state : DriftState
        From start or the last step; not modified.
    temperature_c : ndarray, shape (J,)
        Mean temperatures of the cell, °C.

    Returns
    -------
    tuple of DriftState and Drift
        New state, and the drift of the cell, arrays of shape (6,).

    """
    after: dict[str, FloatArray] = {}
    drift = Drift(np.zeros(len(AXES)), np.zeros(len(AXES)))
    for name, axis in model.axes.items():
        after[name], outputs = axis.step(state[name], temperature_c)
        for part, value in zip(drift, outputs, strict=False):
            part[AXES.index(name)] = value
    return after, drift


def run(
    model: DriftModel, state: DriftState, temperature_c: FloatArray
) -> tuple[DriftState, Drift]:
    """
    Advance the drift by many thermal cells: the fold of step, faster.

    Parameters
    ----------
    model : DriftModel
        The model.
    state : DriftState
        From start or the last run; not modified.
    temperature_c : ndarray, shape (N, J)
        Mean temperatures of consecutive cells, °C.

    Returns
    -------
    tuple of DriftState and Drift
        State after the last cell, and the drift of every cell, arrays of shape (N, 6).

    """
    after: dict[str, FloatArray] = {}
    shape = (len(temperature_c), len(AXES))
    drift = Drift(np.zeros(shape), np.zeros(shape))
    for name, axis in model.axes.items():
        after[name], outputs = axis.run(state[name], temperature_c)
        for part, values in zip(drift, outputs.T, strict=False):
            part[:, AXES.index(name)] = values
    return after, drift


def correct(raw: FloatArray, drift: Drift, tare: FloatArray | float = 0.0) -> FloatArray:
    """
    Remove drift and tare from raw wrenches.

    Parameters
    ----------
    raw : ndarray, shape (..., 6)
        Raw wrench, N and N m.
    drift : Drift
        Of the same times.
    tare : float or ndarray that broadcasts against raw
        Raw offset to subtract, N and N m.

    Returns
    -------
    ndarray, shape (..., 6)
        Compensated wrench ŵ, N and N m.

    """
    corrected: FloatArray = (raw - drift.zero - tare) / (1.0 + drift.sensitivity)
    return corrected


@dataclass(frozen=True, eq=False)
class StoredModel:
    """
    A model as it lies on disk.

    Attributes
    ----------
    path : Path
        The file.
    sha256 : str
        Of its bytes.
    model : DriftModel
        Ready to run.
    document : dict
        Everything in the file, as plain values.

    """

    path: Path
    sha256: str
    model: DriftModel
    document: Document
