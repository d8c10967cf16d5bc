"""
A wrist force/torque sensor that warms up: what the simulated sensor measures.

Its state is the temperature of the M nodes of ``HeatFlow``; a reading at step k is of the state
before the heat of step k has flowed.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from wrist_ft_comp.signals import FloatArray
from wrist_ft_comp.simulation.heat_flow import (
    build_heat_flow,
    FtSensorSettings,
    HeatFlow,
    interpolation,
)
from wrist_ft_comp.simulation.strain_gauges import bridge_wrench, draw_gauges, Gauges, per_axis


@dataclass(frozen=True, eq=False)
class FtSensor:
    """One specimen: settings, and the gauges that a seed has drawn."""

    settings: FtSensorSettings
    heat: HeatFlow = field(repr=False)
    gauges: Gauges = field(repr=False)
    #: Thermometer temperatures from node temperatures, shape (2, M); rows sum to 1.
    thermometer_weights: FloatArray = field(repr=False)


def build_sensor(settings: FtSensorSettings, seed: int) -> FtSensor:
    """Build the specimen whose gauges a seed draws; another seed is another specimen."""
    gauges = draw_gauges(settings, np.random.default_rng(seed))
    weights = interpolation(settings.cells, np.array(settings.thermometer_positions))
    return FtSensor(settings, build_heat_flow(settings), gauges, weights)


def steady_state(sensor: FtSensor, duty_cycle: float, room_c: float) -> FloatArray:
    """Find the node temperatures that duty cycle and room temperature end in, °C, shape (M,)."""
    drive = sensor.heat.inputs @ np.array([duty_cycle, room_c])
    return np.asarray(np.linalg.solve(sensor.heat.rates, -drive))


def start(sensor: FtSensor, room_c: float) -> FloatArray:
    """Give the state of a robot that was off for long: everything at room temperature."""
    return steady_state(sensor, 0.0, room_c)


def trajectory(sensor: FtSensor, nodes_c: FloatArray, drive: FloatArray) -> FloatArray:
    """Let heat flow from node temperatures, (M,), step by step: (N + 1, M), °C, the first too."""
    # What drives it, (N, 2), is duty cycle, 0 to 1, and room temperature, °C, during each step.
    warming = drive @ sensor.heat.step_inputs.T
    states_c = np.empty((len(drive) + 1, len(nodes_c)))
    states_c[0] = nodes_c
    for k in range(len(drive)):
        states_c[k + 1] = sensor.heat.transition @ states_c[k] + warming[k]
    return states_c


def thermometer_temperatures(sensor: FtSensor, nodes_c: FloatArray) -> FloatArray:
    """Temperature where the thermometers sit, °C, shape (..., 2), from nodes_c, (..., M)."""
    return np.asarray(np.einsum('jm,...m->...j', sensor.thermometer_weights, nodes_c))


def measured_wrench(sensor: FtSensor, nodes_c: FloatArray, wrench: ArrayLike) -> FloatArray:
    """Show ``wrench``, shape (..., 6), at nodes_c, (..., M), without noise and quantisation."""
    return bridge_wrench(sensor.settings, sensor.gauges, nodes_c, wrench)


def digitised_wrench(
    sensor: FtSensor, measured: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Add noise and quantisation to ``measured_wrench``, shape (..., 6)."""
    s = sensor.settings
    noise = per_axis(s.force_noise_n, s.torque_noise_nm) * rng.standard_normal(measured.shape)
    return _quantised(measured + noise, per_axis(s.force_quantum_n, s.torque_quantum_nm))


def digitised_temperatures(
    sensor: FtSensor, nodes_c: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Read the thermometers for any number of states, shape (..., M) to (..., 2)."""
    true = thermometer_temperatures(sensor, nodes_c)
    noise = sensor.settings.thermometer_noise_k * rng.standard_normal(true.shape)
    return _quantised(true + noise, np.full(2, sensor.settings.thermometer_quantum_k))


def _quantised(values: FloatArray, quantum: FloatArray) -> FloatArray:
    """Round to multiples of a quantum; 0 leaves the values as they are."""
    step = np.where(quantum > 0, quantum, 1.0)
    return np.where(quantum > 0, np.round(values / step) * step, values)
