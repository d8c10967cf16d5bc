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

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import cont2discrete

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.series import FloatArray

#: Temperature at which the gauges' nominal values and the gain hold, °C.
NOMINAL_C = 25.0
#: Time step of the heat flow, s, and finite volumes of the body.
STEP_S, CELLS = 1.0, 10
#: Heat of the motor at duty cycle 1, W.
MOTOR_W = 22.0
#: Heat capacity, J/K, and conductance to the room, W/K, of the motor with its gear, of the whole
#: body, and of the tool.
CAPACITY_J_PER_K = (700.0, 600.0, 200.0)
CONVECTION_W_PER_K = (0.2, 0.6, 0.15)
#: Conductance from motor to body, along the whole body, and from body to tool, W/K.
_CONTACT_W_PER_K, _BODY_W_PER_K, _TOOL_CONTACT_W_PER_K = 1.0, 0.1, 0.5
#: Places, 0 to 1: on the electronics toward the tool, and at the flange of the motor.
_THERMOMETER_POSITIONS = np.array([0.9, 0.1])
#: Standard deviation, and step of the reading, K.
THERMOMETER_NOISE_K, THERMOMETER_QUANTUM_K = 0.01, 0.0625
#: Mean place of the gauges, and the most that an axis and a gauge deviate from it.
_GAUGE_POSITION, _AXIS_SPREAD, _GAUGE_SPREAD = 0.3, 0.05, 0.008
#: Sign of each gauge's strain, and of its share in the bridge's output.
GAUGE_SIGNS = np.array([1.0, -1.0, 1.0, -1.0])
#: Relative change of resistance with temperature, and its standard deviation between the gauges of
#: a bridge, 1/K and 1/K².
_GAUGE_PER_K, _MISMATCH_PER_K = 1.5e-3, 40e-6
_GAUGE_PER_K2, _MISMATCH_PER_K2 = 1e-6, 1e-7
#: Smallest and largest zero drift of a bridge at even temperature, V/V per K. Gauges are sorted
#: into bridges, so none drifts more; that none drifts less keeps the drift visible.
_ZERO_PER_K = (45e-6, 65e-6)
#: Relative change of resistance per strain at NOMINAL_C, and its relative change with temperature,
#: 1/K and 1/K².
_PIEZORESISTIVE, _PIEZORESISTIVE_PER_K, _PIEZORESISTIVE_PER_K2 = 100.0, -4e-4, 4e-7
#: Load per strain, and standard deviation and step of a reading, N and N m, axis order AXES.
_STIFFNESS = np.repeat([1e6, 3e4], 3)
_NOISE = np.repeat([0.08, 0.003], 3)
QUANTUM = np.repeat([0.01, 0.0005], 3)
#: Sines that make up the load of an axis, and about how long one takes from peak to peak, s.
_SINES, _LOAD_PERIOD_S = 4, 60.0
#: Mean room temperature, °C, and amplitude, K, and period, s, of its slow swing.
_ROOM_C, _ROOM_SWING_K, _ROOM_SWING_PERIOD_S = 22.0, 1.0, 7200.0


def heat_flow() -> tuple[FloatArray, FloatArray]:
    """
    Build the heat flow between M nodes, motor, the body's cells and tool, exact for a time step.

    T(k + 1) = transition T(k) + inputs (duty cycle, room temperature), (M, M) and (M, 2).
    """
    # capacity · dT/dt = conduction + convection + motor, of every node
    capacity, convection = (
        np.array([motor, *[body / CELLS] * CELLS, tool])
        for motor, body, tool in (CAPACITY_J_PER_K, CONVECTION_W_PER_K)
    )
    half_cell = 2 * CELLS * _BODY_W_PER_K  # from a cell's centre to its border
    links = np.full(CELLS + 1, CELLS * _BODY_W_PER_K)
    # Two conductances in series.
    links[0] = 1 / (1 / _CONTACT_W_PER_K + 1 / half_cell)
    links[-1] = 1 / (1 / half_cell + 1 / _TOOL_CONTACT_W_PER_K)
    nodes = np.eye(CELLS + 2)
    difference = np.diff(nodes, axis=0)
    conduction = difference.T @ np.diag(links) @ difference
    rates = -(conduction + np.diag(convection)) / capacity[:, None]
    inputs = np.column_stack((MOTOR_W * nodes[0], convection)) / capacity[:, None]
    # The outputs, which the library wants as well, are the states.
    transition, step_inputs, *_ = cont2discrete((rates, inputs, nodes, 0 * inputs), STEP_S)
    return transition, step_inputs


def interpolation(positions: FloatArray) -> FloatArray:
    """Weigh node temperatures, (..., M), so that they give those at places from 0 to 1, (...)."""
    centres = (np.arange(CELLS) + 0.5) / CELLS
    nodes = np.eye(CELLS + 2)[:, 1:-1]
    return np.stack([np.interp(positions, centres, of_node) for of_node in nodes], axis=-1)


def bridge_output(resistances: FloatArray, changes: FloatArray) -> FloatArray:
    """Compute V/V of Wheatstone bridges of R1 to R4 and their changes, (..., 4), by eq. 1."""
    r1, r2, r3, r4 = np.moveaxis(resistances + GAUGE_SIGNS * changes, -1, 0)
    return np.asarray((r1 * r3 - r2 * r4) / ((r1 + r2) * (r3 + r4)))  # eq. 1


@dataclass(frozen=True, eq=False, repr=False)
class FtSensor:
    """One specimen: six bridges of four gauges, which a seed has drawn."""

    #: Those of ``heat_flow``.
    transition: FloatArray
    inputs: FloatArray
    #: Gauge temperatures from the M node temperatures, shape (6, 4, M).
    gauge_weights: FloatArray
    #: Relative change of resistance with temperature, 1/K and 1/K², shape (6, 4).
    per_k: FloatArray
    per_k2: FloatArray
    #: Thermometer temperatures from node temperatures, shape (2, M); rows sum to 1.
    thermometer_weights: FloatArray


def build_sensor(seed: int) -> FtSensor:
    """Build the specimen whose gauges a seed draws; another seed is another specimen."""
    rng = np.random.default_rng(seed)
    axes = _GAUGE_POSITION + _AXIS_SPREAD * rng.uniform(-1, 1, (6, 1))
    places = axes + _GAUGE_SPREAD * rng.uniform(-1, 1, (6, 4))
    # Gauges are sorted into bridges of a zero drift in a range. Near balance, eq. 1 is
    # V = (δ1 - δ2 + δ3 - δ4) / 4, δ the relative changes of resistance.
    drawn = _MISMATCH_PER_K * rng.standard_normal((6, 4))
    wanted = rng.uniform(*_ZERO_PER_K, 6) * rng.choice((-1.0, 1.0), 6)
    excess = wanted - drawn @ GAUGE_SIGNS / 4
    per_k = _GAUGE_PER_K + drawn + excess[:, None] * GAUGE_SIGNS
    per_k2 = _GAUGE_PER_K2 + _MISMATCH_PER_K2 * rng.standard_normal((6, 4))
    thermometers = interpolation(_THERMOMETER_POSITIONS)
    return FtSensor(*heat_flow(), interpolation(places), per_k, per_k2, thermometers)


def trajectory(sensor: FtSensor, nodes_c: ArrayLike, drive: FloatArray) -> FloatArray:
    """
    Let heat flow from node temperatures, (M,), step by step: (N + 1, M), °C, the first included.

    All nodes of a robot that was off for long have one temperature, that of the room. ``drive``,
    (N, 2), is duty cycle, 0 to 1, and room temperature, °C, during each step.
    """
    warming = drive @ sensor.inputs.T
    states_c = np.empty((len(drive) + 1, CELLS + 2))
    states_c[0] = nodes_c
    for k in range(len(drive)):
        states_c[k + 1] = sensor.transition @ states_c[k] + warming[k]
    return states_c


def thermometer_temperatures(sensor: FtSensor, nodes_c: FloatArray) -> FloatArray:
    """Temperature where the thermometers sit, °C, shape (..., 2), from nodes_c, (..., M)."""
    return np.asarray(np.einsum('jm,...m->...j', sensor.thermometer_weights, nodes_c))


def measured_wrench(sensor: FtSensor, nodes_c: FloatArray, wrench: ArrayLike) -> FloatArray:
    """Show wrenches, (..., 6), at nodes_c, °C, (..., M), without noise and quantisation."""
    warm = np.einsum('agm,...m->...ag', sensor.gauge_weights, nodes_c) - NOMINAL_C
    resistances = 1.0 + sensor.per_k * warm + sensor.per_k2 * warm**2
    falling = 1.0 + _PIEZORESISTIVE_PER_K * warm + _PIEZORESISTIVE_PER_K2 * warm**2
    strain = (np.asarray(wrench) / _STIFFNESS)[..., None]
    changes = resistances * _PIEZORESISTIVE * falling * strain  # ΔR/R = πσ, eq. 2
    return np.asarray(bridge_output(resistances, changes) * (_STIFFNESS / _PIEZORESISTIVE))


def digitised_wrench(measured: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Add noise and quantisation to ``measured_wrench``, shape (..., 6)."""
    noisy = measured + _NOISE * rng.standard_normal(measured.shape)
    return np.asarray(np.round(noisy / QUANTUM) * QUANTUM)


def digitised_temperatures(
    sensor: FtSensor, nodes_c: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Read the thermometers for any number of states, shape (..., M) to (..., 2)."""
    true_c = thermometer_temperatures(sensor, nodes_c)
    noisy_c = true_c + THERMOMETER_NOISE_K * rng.standard_normal(true_c.shape)
    return np.asarray(np.round(noisy_c / THERMOMETER_QUANTUM_K) * THERMOMETER_QUANTUM_K)


@dataclass(frozen=True)
class RunSettings:
    """What a person chooses about a run."""

    #: Ascending times at which the duty cycle changes, s; before the first one it is 0.
    duty_start_s: tuple[float, ...] = (0.0, 120.0)
    #: Duty cycle from each of these times on, 0 to 1.
    duty_level: tuple[float, ...] = (0.0, 0.8)
    #: The largest load of an axis, N and N m; 0 is unloaded.
    force_n: float = 20.0
    torque_nm: float = 1.0

    def __post_init__(self) -> None:
        """Refuse a schedule that cannot be followed; ranges are those of the node's parameters."""
        starts, levels = self.duty_start_s, self.duty_level
        if len(starts) != len(levels) or not (np.diff(starts) > 0).all():
            raise SettingsError(
                'The duty schedule needs start times that ascend, s, and as many levels; got '
                f'{list(starts)} and {list(levels)}. Give a level from each start time on.'
            )


@dataclass(frozen=True, eq=False, repr=False)
class Run:
    """A run: settings, and what a seed has drawn."""

    settings: RunSettings
    #: Phase of the room's swing at time 0, rad.
    room_phase: float
    #: The sines of every axis, shape (6, 4): rad/s, rad, and shares of the largest load.
    load_rates: FloatArray
    load_phases: FloatArray
    load_shares: FloatArray


def draw_run(settings: RunSettings, rng: np.random.Generator) -> Run:
    """Draw the random part of a run: everything but the sensor."""
    shape = (len(AXES), _SINES)
    shares = rng.uniform(0.5, 1.5, shape)
    return Run(
        settings,
        room_phase=float(rng.uniform(0, 2 * np.pi)),
        load_rates=2 * np.pi / _LOAD_PERIOD_S * rng.uniform(0.4, 1.6, shape),
        load_phases=rng.uniform(0, 2 * np.pi, shape),
        load_shares=shares / shares.sum(axis=1, keepdims=True),
    )


def room_temperature(run: Run, elapsed_s: ArrayLike) -> FloatArray:
    """Compute the room temperature, °C, in the shape of elapsed_s."""
    angle = 2 * np.pi / _ROOM_SWING_PERIOD_S * np.asarray(elapsed_s) + run.room_phase
    return np.asarray(_ROOM_C + _ROOM_SWING_K * np.sin(angle))


def drive(run: Run, elapsed_s: FloatArray) -> FloatArray:
    """Give what drives the heat: duty cycle and room temperature (°C), shape (N, 2)."""
    levels = np.array((0.0, *run.settings.duty_level))
    at = np.searchsorted(np.array(run.settings.duty_start_s), elapsed_s, side='right')
    return np.column_stack((levels[at], room_temperature(run, elapsed_s)))


def true_wrench(run: Run, elapsed_s: ArrayLike) -> FloatArray:
    """Compute the load, N and N m, (..., 6): smooth, endless, never above the largest load."""
    largest = np.repeat([run.settings.force_n, run.settings.torque_nm], 3)
    angles = np.asarray(elapsed_s)[..., None, None] * run.load_rates + run.load_phases
    shares = (run.load_shares * np.sin(angles)).sum(axis=-1)
    return np.asarray(largest * shares)
