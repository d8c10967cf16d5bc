"""
A wrist force/torque sensor that warms up: what the simulated sensor measures, and its run.

Heat flows from a joint's motor through the flange and the sensor's body to the tool, and
from each of them into the room::

    motor ─ contact ─ cell 1 ─ cell 2 ─ … ─ cell n ─ contact ─ tool
      │                 │        │            │                  │     (convection to the room)

Each node of this chain has one temperature (finite volumes), so the state is linear in duty cycle
and room temperature, and a time step is exact; a reading at step k is of the state before the heat
of step k has flowed. Six full bridges of strain gauges drift: gauges differ a little in their
temperature coefficient and in their place, so the zero drifts with temperature and with its
gradient (eq. 1 of the paper), and the piezoresistive coefficient falls with temperature, so the
gain drifts (eq. 2). A run gives duty cycle, room temperature and load by simulated seconds.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import cont2discrete

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.series import FloatArray

#: Temperature at which the gauges' nominal values and the gain hold, °C.
NOMINAL_C = 25.0
#: Sign of each gauge's strain, and of its share in the bridge's output.
GAUGE_SIGNS = np.array([1.0, -1.0, 1.0, -1.0])
#: Sines that make up the load of an axis.
_SINES = 4


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
    #: Standard deviation, and step of the reading, K.
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
    #: Standard deviation of a reading, and its step, N and N m.
    force_noise_n: float = 0.08
    torque_noise_nm: float = 0.003
    force_quantum_n: float = 0.01
    torque_quantum_nm: float = 0.0005


class HeatFlow(NamedTuple):
    """Linear heat flow of a time step between M nodes: motor, the body's cells, tool."""

    #: T(k + 1) = transition T(k) + inputs (duty cycle, room temperature), (M, M) and (M, 2).
    transition: FloatArray
    inputs: FloatArray


def build_heat_flow(settings: FtSensorSettings) -> HeatFlow:
    """Build the matrices of heat flow, exact for one time step."""
    # capacity · dT/dt = conduction + convection + motor, of every node
    s, n = settings, settings.cells
    half_cell = 2 * n * s.body_w_per_k  # from a cell's centre to its border
    links = np.full(n + 1, n * s.body_w_per_k)
    # Two conductances in series.
    links[0] = 1 / (1 / s.contact_w_per_k + 1 / half_cell)
    links[-1] = 1 / (1 / half_cell + 1 / s.tool_contact_w_per_k)
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
    return HeatFlow(*cont2discrete(space, s.step_s)[:2])


def interpolation(cells: int, positions: FloatArray) -> FloatArray:
    """Weigh node temperatures, (..., M), so that they give those at places from 0 to 1, (...)."""
    centres = (np.arange(cells) + 0.5) / cells
    rows = np.zeros((*positions.shape, cells + 2))
    for cell in range(cells):
        rows[..., cell + 1] = np.interp(positions, centres, np.eye(cells)[cell])
    return rows


def bridge_output(resistances: FloatArray, changes: FloatArray) -> FloatArray:
    """Compute V/V of Wheatstone bridges of R1 to R4 and their changes, (..., 4), by eq. 1."""
    r1, r2, r3, r4 = np.moveaxis(resistances + GAUGE_SIGNS * changes, -1, 0)
    return np.asarray((r1 * r3 - r2 * r4) / ((r1 + r2) * (r3 + r4)))  # eq. 1


def per_axis(force: float, torque: float) -> FloatArray:
    """Spread a value for forces and one for torques over AXES, shape (6,)."""
    return np.repeat([force, torque], 3)


@dataclass(frozen=True, eq=False)
class FtSensor:
    """One specimen: six bridges of four gauges, which a seed has drawn."""

    settings: FtSensorSettings
    heat: HeatFlow = field(repr=False)
    #: Gauge temperatures from the M node temperatures of HeatFlow, shape (6, 4, M).
    gauge_weights: FloatArray = field(repr=False)
    #: Relative change of resistance with temperature, 1/K and 1/K², shape (6, 4).
    per_k: FloatArray = field(repr=False)
    per_k2: FloatArray = field(repr=False)
    #: Thermometer temperatures from node temperatures, shape (2, M); rows sum to 1.
    thermometer_weights: FloatArray = field(repr=False)


def build_sensor(settings: FtSensorSettings, seed: int) -> FtSensor:
    """Build the specimen whose gauges a seed draws; another seed is another specimen."""
    s, rng = settings, np.random.default_rng(seed)
    axes = s.gauge_position + s.axis_position_spread * rng.uniform(-1, 1, (6, 1))
    places = axes + s.gauge_position_spread * rng.uniform(-1, 1, (6, 4))
    # Gauges are sorted into bridges of a zero drift in a range. Near balance, eq. 1 is
    # V = (δ1 - δ2 + δ3 - δ4) / 4, δ the relative changes of resistance.
    drawn = s.gauge_mismatch_per_k * rng.standard_normal((6, 4))
    wanted = rng.uniform(*s.zero_coefficient_per_k, 6) * rng.choice((-1.0, 1.0), 6)
    excess = wanted - drawn @ GAUGE_SIGNS / 4
    per_k = s.gauge_coefficient_per_k + drawn + excess[:, None] * GAUGE_SIGNS
    per_k2 = s.gauge_coefficient_per_k2 + s.gauge_mismatch_per_k2 * rng.standard_normal((6, 4))
    thermometers = interpolation(s.cells, np.array(s.thermometer_positions))
    gauges = interpolation(s.cells, places)
    return FtSensor(s, build_heat_flow(s), gauges, per_k, per_k2, thermometers)


def start(sensor: FtSensor, room_c: float) -> FloatArray:
    """Give the nodes of a robot that was off for long: all at room temperature, °C, (M,)."""
    return np.full(sensor.settings.cells + 2, room_c)


def trajectory(sensor: FtSensor, nodes_c: FloatArray, drive: FloatArray) -> FloatArray:
    """
    Let heat flow from node temperatures, (M,), step by step: (N + 1, M), °C, the first included.

    ``drive``, (N, 2), is duty cycle, 0 to 1, and room temperature, °C, during each step.
    """
    warming = drive @ sensor.heat.inputs.T
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
    s = sensor.settings
    warm = np.einsum('agm,...m->...ag', sensor.gauge_weights, nodes_c) - NOMINAL_C
    resistances = 1.0 + sensor.per_k * warm + sensor.per_k2 * warm**2
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
    quantum = per_axis(s.force_quantum_n, s.torque_quantum_nm)
    return np.asarray(np.round((measured + noise) / quantum) * quantum)


def digitised_temperatures(
    sensor: FtSensor, nodes_c: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Read the thermometers for any number of states, shape (..., M) to (..., 2)."""
    true = thermometer_temperatures(sensor, nodes_c)
    noise = sensor.settings.thermometer_noise_k * rng.standard_normal(true.shape)
    quantum = sensor.settings.thermometer_quantum_k
    return np.asarray(np.round((true + noise) / quantum) * quantum)


@dataclass(frozen=True)
class RunSettings:
    """What a person chooses about a run."""

    #: Ascending times at which the duty cycle changes, s; before the first one it is 0.
    duty_start_s: tuple[float, ...] = (0.0, 120.0)
    #: Duty cycle from each of these times on, 0 to 1.
    duty_level: tuple[float, ...] = (0.0, 0.8)
    #: Mean room temperature, °C, and amplitude, K, and period, s, of its slow swing.
    room_c: float = 22.0
    room_swing_k: float = 1.0
    room_swing_period_s: float = 7200.0
    #: The largest load of an axis, N and N m; 0 is unloaded.
    force_n: float = 20.0
    torque_nm: float = 1.0
    #: About how long a load takes from one peak to the next, s.
    load_period_s: float = 60.0

    def __post_init__(self) -> None:
        """Refuse a schedule that cannot be followed; ranges are those of the node's parameters."""
        starts, levels = self.duty_start_s, self.duty_level
        if len(starts) != len(levels):
            raise SettingsError(
                'The duty schedule needs as many start times as levels; got '
                f'{len(starts)} and {len(levels)}. Give a level from each start time on.'
            )
        if not (np.diff(starts) > 0).all():
            raise SettingsError(
                'The start times of the duty schedule must ascend, in seconds; got '
                f'{list(self.duty_start_s)}.'
            )


@dataclass(frozen=True, eq=False)
class Run:
    """A run: settings, and what a seed has drawn."""

    settings: RunSettings
    #: Phase of the room's swing at time 0, rad.
    room_phase: float = field(repr=False)
    #: The sines of every axis, shape (6, 4): rad/s, rad, and shares of the largest load.
    load_rates: FloatArray = field(repr=False)
    load_phases: FloatArray = field(repr=False)
    load_shares: FloatArray = field(repr=False)


def draw_run(settings: RunSettings, rng: np.random.Generator) -> Run:
    """Draw the random part of a run: everything but the sensor."""
    shape = (len(AXES), _SINES)
    shares = rng.uniform(0.5, 1.5, shape)
    return Run(
        settings,
        room_phase=float(rng.uniform(0, 2 * np.pi)),
        load_rates=2 * np.pi / settings.load_period_s * rng.uniform(0.4, 1.6, shape),
        load_phases=rng.uniform(0, 2 * np.pi, shape),
        load_shares=shares / shares.sum(axis=1, keepdims=True),
    )


def room_temperature(run: Run, elapsed_s: ArrayLike) -> FloatArray:
    """Compute the room temperature, °C, in the shape of elapsed_s."""
    s = run.settings
    angle = 2 * np.pi / s.room_swing_period_s * np.asarray(elapsed_s) + run.room_phase
    return np.asarray(s.room_c + s.room_swing_k * np.sin(angle))


def drive(run: Run, elapsed_s: FloatArray) -> FloatArray:
    """Give what drives the heat: duty cycle and room temperature (°C), shape (N, 2)."""
    levels = np.array((0.0, *run.settings.duty_level))
    at = np.searchsorted(np.array(run.settings.duty_start_s), elapsed_s, side='right')
    return np.column_stack((levels[at], room_temperature(run, elapsed_s)))


def true_wrench(run: Run, elapsed_s: ArrayLike) -> FloatArray:
    """Compute the load, N and N m, (..., 6): smooth, endless, never above the largest load."""
    s = run.settings
    angles = np.asarray(elapsed_s)[..., None, None] * run.load_rates + run.load_phases
    shares = (run.load_shares * np.sin(angles)).sum(axis=-1)
    return np.asarray(per_axis(s.force_n, s.torque_nm) * shares)
