"""
The drift of all six axes: settings of the fit left behind, this is what runs.

    r_i = (1 + s_i) w_i + o_i           measurement: s sensitivity drift, o zero drift
    ŵ_i = (r_i - o_i - tare_i) / (1 + s_i)
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wrist_ft_comp import ModelFileError
from wrist_ft_comp.core.arx_pls import ArxPls
from wrist_ft_comp.core.features import Features
from wrist_ft_comp.core.recording import AXES, FloatArray


@dataclass(frozen=True, eq=False)
class AxisModel:
    """
    Drift of one axis.

    Attributes
    ----------
    features : Features
        From J temperatures to F features.
    dynamics : ArxPls
        From F features to one output (zero drift) or two (zero drift, sensitivity drift).

    """

    features: Features
    dynamics: ArxPls

    def __post_init__(self) -> None:
        """Check the numbers of inputs and outputs."""
        inputs = self.features.expand(self.features.reference_c).shape[0]
        if inputs != len(self.dynamics.input_mean):
            raise ModelFileError(
                f'The features give {inputs} inputs, the dynamics expect '
                f'{len(self.dynamics.input_mean)}; they must be equal.'
            )
        if len(self.dynamics.output_mean) not in (1, 2):
            raise ModelFileError(
                'An axis has one output (zero drift) or two (zero and sensitivity drift); got '
                f'{len(self.dynamics.output_mean)}.'
            )


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

    """

    period_ns: int
    thermometers: int
    axes: Mapping[str, AxisModel]

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
            if axis.features.thermometers != self.thermometers:
                raise ModelFileError(
                    f'{name} expects {axis.features.thermometers} thermometers, the model has '
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
                    (temperature_c < axis.features.lower_c)
                    | (temperature_c > axis.features.upper_c)
                )
            }
        )


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
    return {
        name: axis.dynamics.start(axis.features.expand(temperature_c))
        for name, axis in model.axes.items()
    }


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
        after[name], outputs = axis.dynamics.step(state[name], axis.features.expand(temperature_c))
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
        after[name], outputs = axis.dynamics.run(state[name], axis.features.expand(temperature_c))
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
