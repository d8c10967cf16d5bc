"""
Heat conduction along a simulated wrist: the constants, and the matrices that follow from them.

Heat flows from a joint's motor through the flange and the sensor's body to the tool, and
from each of them into the room::

    motor ─ contact ─ cell 1 ─ cell 2 ─ … ─ cell n ─ contact ─ tool
      │                 │        │            │                  │     (convection to the room)

Each node of this chain has one temperature (finite volumes), so the state is linear in duty cycle
and room temperature, and a time step is exact.
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import cont2discrete

from wrist_ft_comp.series import FloatArray


@dataclass(frozen=True)
class FtSensorSettings:
    """Physical constants of a simulated wrist, which only developers change."""

    #: Time step, s.
    step_s: float = 1.0
    #: Number of finite volumes of the body.
    cells: int = 10
    #: Heat of the motor at duty cycle 1, W.
    max_motor_power_w: float = 22.0
    #: Heat capacity of the motor with its gear, of the whole body, and of the tool, J/K.
    motor_capacity_j_per_k: float = 700.0
    body_capacity_j_per_k: float = 600.0
    tool_capacity_j_per_k: float = 200.0
    #: Conductance from motor to body, along the whole body, and from body to tool, W/K.
    contact_w_per_k: float = 1.0
    body_w_per_k: float = 0.1
    tool_contact_w_per_k: float = 0.5
    #: Conductance to the room, W/K.
    motor_convection_w_per_k: float = 0.2
    body_convection_w_per_k: float = 0.6
    tool_convection_w_per_k: float = 0.15
    #: Places, 0 to 1: on the electronics toward the tool, and at the flange of the motor.
    thermometer_positions: tuple[float, float] = (0.9, 0.1)
    #: Standard deviation, and step of the reading (0: none), K.
    thermometer_noise_k: float = 0.01
    thermometer_quantum_k: float = 0.0625
    #: Mean place of the gauges, and the most that an axis and a gauge deviate from it.
    gauge_position: float = 0.3
    axis_position_spread: float = 0.05
    gauge_position_spread: float = 0.008
    #: Relative change of resistance with temperature, 1/K and 1/K²; and its standard deviation
    #: between the gauges of a bridge.
    gauge_coefficient_per_k: float = 1.5e-3
    gauge_coefficient_per_k2: float = 1e-6
    gauge_mismatch_per_k: float = 40e-6
    gauge_mismatch_per_k2: float = 1e-7
    #: Smallest and largest zero drift of a bridge at even temperature, V/V per K. Gauges are
    #: sorted into bridges, so none drifts more; that none drifts less keeps the drift visible.
    zero_coefficient_per_k: tuple[float, float] = (45e-6, 65e-6)
    #: Relative change of resistance per strain at NOMINAL_C, and its relative change with
    #: temperature, 1/K and 1/K².
    piezoresistive_coefficient: float = 100.0
    piezoresistive_per_k: float = -4e-4
    piezoresistive_per_k2: float = 4e-7
    #: Load per strain, N and N m.
    force_stiffness_n: float = 1e6
    torque_stiffness_nm: float = 3e4
    #: Standard deviation of a reading, and its step (0: none), N and N m.
    force_noise_n: float = 0.08
    torque_noise_nm: float = 0.003
    force_quantum_n: float = 0.01
    torque_quantum_nm: float = 0.0005


@dataclass(frozen=True, eq=False)
class HeatFlow:
    """Linear heat flow between M nodes: motor, the body's cells, tool, in this order."""

    #: dT/dt = rates T + inputs (duty cycle, room temperature), 1/s, shape (M, M), and K/s and 1/s,
    #: shape (M, 2).
    rates: FloatArray
    inputs: FloatArray
    #: The same for one time step.
    transition: FloatArray
    step_inputs: FloatArray


def build_heat_flow(settings: FtSensorSettings) -> HeatFlow:
    """Build the matrices of heat flow, continuous and exact for one time step."""
    # capacity · dT/dt = conduction + convection + motor, of every node
    s, n = settings, settings.cells
    half_cell = 2 * n * s.body_w_per_k  # from a cell's centre to its border

    def series(a: float, b: float) -> float:
        return a * b / (a + b)

    links = np.full(n + 1, n * s.body_w_per_k)
    links[0] = series(s.contact_w_per_k, half_cell)
    links[-1] = series(half_cell, s.tool_contact_w_per_k)
    convection = np.full(n + 2, s.body_convection_w_per_k / n)
    convection[[0, -1]] = s.motor_convection_w_per_k, s.tool_convection_w_per_k
    capacity = np.full(n + 2, s.body_capacity_j_per_k / n)
    capacity[[0, -1]] = s.motor_capacity_j_per_k, s.tool_capacity_j_per_k

    difference = np.diff(np.eye(n + 2), axis=0)
    conduction = difference.T @ np.diag(links) @ difference
    rates = -(conduction + np.diag(convection)) / capacity[:, None]
    motor = np.zeros(n + 2)
    motor[0] = s.max_motor_power_w
    inputs = np.column_stack((motor, convection)) / capacity[:, None]
    # The outputs, which the library wants as well, are the states.
    space = rates, inputs, np.eye(n + 2), np.zeros((n + 2, 2))
    transition, step_inputs, *_ = cont2discrete(space, s.step_s)
    return HeatFlow(rates, inputs, transition, step_inputs)


def interpolation(cells: int, positions: FloatArray) -> FloatArray:
    """Weigh node temperatures, (..., M), so that they give those at places from 0 to 1, (...)."""
    centres = (np.arange(cells) + 0.5) / cells
    rows = np.zeros((*positions.shape, cells + 2))
    for cell in range(cells):
        rows[..., cell + 1] = np.interp(positions, centres, np.eye(cells)[cell])
    return rows
