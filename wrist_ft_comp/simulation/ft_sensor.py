"""
A wrist force/torque sensor that warms up: what the simulated sensor measures.

Heat flows through the body (``heat_flow``), on which strain gauges (``strain_gauges``) and two
thermometers sit. A reading at step k is of the state before the heat of step k has flowed.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from wrist_ft_comp.model.signals import FloatArray
from wrist_ft_comp.simulation.heat_flow import (
    build_heat_flow,
    FtSensorSettings,
    HeatFlow,
    interpolation,
)
from wrist_ft_comp.simulation.strain_gauges import bridge_wrench, draw_gauges, Gauges, per_axis


@dataclass(frozen=True, eq=False)
class FtSensor:
    """
    One specimen: settings, and the gauges that a seed has drawn.

    Attributes
    ----------
    settings : FtSensorSettings
        What it was built from.
    heat : HeatFlow
        Between its M nodes.
    gauges : Gauges
        Of its bridges.
    thermometer_weights : ndarray, shape (2, M)
        Thermometer temperatures from node temperatures; rows sum to 1.

    """

    settings: FtSensorSettings
    heat: HeatFlow = field(repr=False)
    gauges: Gauges = field(repr=False)
    thermometer_weights: FloatArray = field(repr=False)


@dataclass(frozen=True, eq=False)
class ThermalState:
    """
    What the last step left.

    Attributes
    ----------
    nodes_c : ndarray, shape (M,)
        Temperature of motor, cells and tool, °C.

    """

    nodes_c: FloatArray


@dataclass(frozen=True, eq=False)
class ThermalRun:
    """
    A simulated record.

    Attributes
    ----------
    wrench : ndarray, shape (N, 6)
        Readings, N and N m, axis order AXES.
    temperature_c : ndarray, shape (N, 2)
        Readings of the two thermometers, °C.
    state : ThermalState
        State behind the last step.

    """

    wrench: FloatArray
    temperature_c: FloatArray
    state: ThermalState


def build_sensor(settings: FtSensorSettings, seed: int) -> FtSensor:
    """
    Build one specimen of a sensor.

    Parameters
    ----------
    settings : FtSensorSettings
        Physical constants.
    seed : int
        Draws places and mismatches of the gauges; another seed is another specimen.

    Returns
    -------
    FtSensor
        Matrices of heat flow, and the gauges' constants.

    """
    return FtSensor(
        settings,
        build_heat_flow(settings),
        draw_gauges(settings, np.random.default_rng(seed)),
        interpolation(settings.cells, np.array(settings.thermometer_positions)),
    )


def steady_state(sensor: FtSensor, duty_cycle: float, room_c: float) -> ThermalState:
    """
    Find the state that duty cycle and room temperature end in.

    Parameters
    ----------
    sensor : FtSensor
        A specimen.
    duty_cycle : float
        Of the motor, 0 to 1.
    room_c : float
        Room temperature, °C.

    Returns
    -------
    ThermalState
        Where no temperature changes any more.

    """
    drive = sensor.heat.inputs @ np.array([duty_cycle, room_c])
    nodes_c: FloatArray = np.linalg.solve(sensor.heat.rates, -drive)
    return ThermalState(nodes_c)


def start(sensor: FtSensor, room_c: float) -> ThermalState:
    """Give the state of a robot that was off for long: everything at room temperature."""
    return steady_state(sensor, 0.0, room_c)


def advance(
    sensor: FtSensor, state: ThermalState, duty_cycle: float, room_c: float
) -> ThermalState:
    """
    Let heat flow for one time step.

    Parameters
    ----------
    sensor : FtSensor
        A specimen.
    state : ThermalState
        State before the step.
    duty_cycle : float
        Of the motor during the step, 0 to 1.
    room_c : float
        Room temperature during the step, °C.

    Returns
    -------
    ThermalState
        State behind the step.

    """
    drive = sensor.heat.step_inputs @ np.array([duty_cycle, room_c])
    return ThermalState(sensor.heat.transition @ state.nodes_c + drive)


def trajectory(sensor: FtSensor, state: ThermalState, drive: FloatArray) -> FloatArray:
    """
    Fold ``advance``.

    Parameters
    ----------
    sensor : FtSensor
        A specimen.
    state : ThermalState
        State before the first step.
    drive : ndarray, shape (N, 2)
        Duty cycle (0 to 1) and room temperature (°C) during each step.

    Returns
    -------
    ndarray, shape (N + 1, M)
        Node temperatures before each step, and behind the last one, °C.

    """
    warming = drive @ sensor.heat.step_inputs.T
    nodes_c = np.empty((len(drive) + 1, len(state.nodes_c)))
    nodes_c[0] = state.nodes_c
    for k in range(len(drive)):
        nodes_c[k + 1] = sensor.heat.transition @ nodes_c[k] + warming[k]
    return nodes_c


def gauge_temperatures(sensor: FtSensor, nodes_c: FloatArray) -> FloatArray:
    """Temperature of every gauge, °C, shape (..., 6, 4), from nodes_c, shape (..., M)."""
    temperatures: FloatArray = np.einsum('agm,...m->...ag', sensor.gauges.weights, nodes_c)
    return temperatures


def thermometer_temperatures(sensor: FtSensor, nodes_c: FloatArray) -> FloatArray:
    """Temperature where the thermometers sit, °C, shape (..., 2), from nodes_c, (..., M)."""
    temperatures: FloatArray = np.einsum('jm,...m->...j', sensor.thermometer_weights, nodes_c)
    return temperatures


def measured_wrench(sensor: FtSensor, nodes_c: FloatArray, wrench: ArrayLike) -> FloatArray:
    """Show ``wrench``, shape (..., 6), at nodes_c, (..., M), without noise and quantisation."""
    return bridge_wrench(sensor.settings, sensor.gauges, nodes_c, wrench)


def read_wrench(
    sensor: FtSensor, state: ThermalState, wrench: ArrayLike, rng: np.random.Generator
) -> FloatArray:
    """
    Read the sensor once.

    Parameters
    ----------
    sensor : FtSensor
        A specimen.
    state : ThermalState
        Its present state.
    wrench : array_like, shape (6,)
        True wrench, N and N m, axis order AXES.
    rng : numpy.random.Generator
        Source of the noise; it is moved on.

    Returns
    -------
    ndarray, shape (6,)
        N and N m, with drift, noise and quantisation.

    """
    return digitised_wrench(sensor, measured_wrench(sensor, state.nodes_c, wrench), rng)


def digitised_wrench(
    sensor: FtSensor, measured: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Add noise and quantisation to ``measured_wrench``, shape (..., 6)."""
    s = sensor.settings
    noise = per_axis(s.force_noise_n, s.torque_noise_nm) * rng.standard_normal(measured.shape)
    return _quantised(measured + noise, per_axis(s.force_quantum_n, s.torque_quantum_nm))


def read_thermometers(
    sensor: FtSensor, state: ThermalState, rng: np.random.Generator
) -> FloatArray:
    """
    Read both thermometers once.

    Parameters
    ----------
    sensor : FtSensor
        A specimen.
    state : ThermalState
        Its present state.
    rng : numpy.random.Generator
        Source of the noise; it is moved on.

    Returns
    -------
    ndarray, shape (2,)
        °C, with noise and quantisation: electronics, motor-side flange.

    """
    return digitised_temperatures(sensor, state.nodes_c, rng)


def digitised_temperatures(
    sensor: FtSensor, nodes_c: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Read the thermometers for any number of states, shape (..., M) to (..., 2)."""
    true = thermometer_temperatures(sensor, nodes_c)
    noise = sensor.settings.thermometer_noise_k * rng.standard_normal(true.shape)
    return _quantised(true + noise, np.full(2, sensor.settings.thermometer_quantum_k))


def simulate(
    sensor: FtSensor,
    state: ThermalState,
    drive: FloatArray,
    wrench: FloatArray,
    noise: tuple[np.random.Generator, np.random.Generator],
) -> ThermalRun:
    """
    Fold ``read_wrench``, ``read_thermometers`` and ``advance`` over a record.

    Parameters
    ----------
    sensor : FtSensor
        A specimen.
    state : ThermalState
        State at the first reading.
    drive : ndarray, shape (N, 2)
        Duty cycle (0 to 1) and room temperature (°C) during each step.
    wrench : ndarray, shape (N, 6)
        True wrench, N and N m, axis order AXES.
    noise : tuple of two numpy.random.Generator
        Sources of the wrench's and of the thermometers' noise, moved on; two, so that both
        streams equal those of single steps.

    Returns
    -------
    ThermalRun
        Readings, and the state behind the last step.

    """
    nodes_c = trajectory(sensor, state, drive)
    wrench_rng, thermometer_rng = noise
    return ThermalRun(
        digitised_wrench(sensor, measured_wrench(sensor, nodes_c[:-1], wrench), wrench_rng),
        digitised_temperatures(sensor, nodes_c[:-1], thermometer_rng),
        ThermalState(nodes_c[-1]),
    )


def _quantised(values: FloatArray, quantum: FloatArray) -> FloatArray:
    """Round to multiples of a quantum; 0 leaves the values as they are."""
    step = np.where(quantum > 0, quantum, 1.0)
    return np.where(quantum > 0, np.round(values / step) * step, values)
