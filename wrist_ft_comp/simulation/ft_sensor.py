"""
A wrist force/torque sensor that warms up: what the simulated sensor measures.

Its state is the temperature of the M nodes of ``HeatFlow``; a reading at step k is of the state
before the heat of step k has flowed. Six full bridges of strain gauges drift: gauges differ a
little in their temperature coefficient and in their place, so the zero drifts with temperature
and with its gradient (eq. 1 of the paper), and the piezoresistive coefficient falls with
temperature, so the gain drifts (eq. 2).
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from wrist_ft_comp.series import FloatArray
from wrist_ft_comp.simulation.heat_flow import (
    build_heat_flow,
    FtSensorSettings,
    HeatFlow,
    interpolation,
)

#: Temperature at which the gauges' nominal values and the gain hold, °C.
NOMINAL_C = 25.0
#: Sign of each gauge's strain, and of its share in the bridge's output.
GAUGE_SIGNS = np.array([1.0, -1.0, 1.0, -1.0])


@dataclass(frozen=True, eq=False)
class Gauges:
    """The gauges that a seed has drawn: six bridges of four."""

    #: Their temperatures from the M node temperatures of HeatFlow, shape (6, 4, M).
    weights: FloatArray
    #: Relative change of resistance with temperature, 1/K and 1/K², shape (6, 4).
    per_k: FloatArray
    per_k2: FloatArray


def draw_gauges(settings: FtSensorSettings, rng: np.random.Generator) -> Gauges:
    """Draw the places and coefficients of one specimen."""
    s = settings
    axes = s.gauge_position + s.axis_position_spread * rng.uniform(-1, 1, (6, 1))
    places = axes + s.gauge_position_spread * rng.uniform(-1, 1, (6, 4))
    # Gauges are sorted into bridges of a zero drift in a range. Near balance, eq. 1 is
    # V = (δ1 - δ2 + δ3 - δ4) / 4, δ the relative changes of resistance.
    drawn = s.gauge_mismatch_per_k * rng.standard_normal((6, 4))
    wanted = rng.uniform(*s.zero_coefficient_per_k, 6) * rng.choice((-1.0, 1.0), 6)
    excess = wanted - drawn @ GAUGE_SIGNS / 4
    per_k = s.gauge_coefficient_per_k + drawn + excess[:, None] * GAUGE_SIGNS
    per_k2 = s.gauge_coefficient_per_k2 + s.gauge_mismatch_per_k2 * rng.standard_normal((6, 4))
    return Gauges(interpolation(s.cells, places), per_k, per_k2)


def bridge_output(resistances: FloatArray, changes: FloatArray) -> FloatArray:
    """Compute V/V of Wheatstone bridges of R1 to R4 and their changes, (..., 4), by eq. 1."""
    r1, r2, r3, r4 = np.moveaxis(resistances + GAUGE_SIGNS * changes, -1, 0)
    return np.asarray((r1 * r3 - r2 * r4) / ((r1 + r2) * (r3 + r4)))  # eq. 1


def per_axis(force: float, torque: float) -> FloatArray:
    """Spread a value for forces and one for torques over AXES, shape (6,)."""
    return np.repeat([force, torque], 3)


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
    """
    Let heat flow from node temperatures, (M,), step by step: (N + 1, M), °C, the first included.

    ``drive``, (N, 2), is duty cycle, 0 to 1, and room temperature, °C, during each step.
    """
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
    """Show wrenches, (..., 6), at nodes_c, °C, (..., M), without noise and quantisation."""
    s, gauges = sensor.settings, sensor.gauges
    warm = np.einsum('agm,...m->...ag', gauges.weights, nodes_c) - NOMINAL_C
    resistances = 1.0 + gauges.per_k * warm + gauges.per_k2 * warm**2
    falling = 1.0 + s.piezoresistive_per_k * warm + s.piezoresistive_per_k2 * warm**2
    stiffness = per_axis(s.force_stiffness_n, s.torque_stiffness_nm)
    strain = (np.asarray(wrench) / stiffness)[..., None]
    changes = resistances * s.piezoresistive_coefficient * falling * strain  # ΔR/R = πσ, eq. 2
    shown = stiffness / s.piezoresistive_coefficient
    return np.asarray(bridge_output(resistances, changes) * shown)


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
