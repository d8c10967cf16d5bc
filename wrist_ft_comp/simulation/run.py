"""Duty cycle, room temperature and load of a simulated wrist, by simulated seconds."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.series import FloatArray
from wrist_ft_comp.simulation.ft_sensor import per_axis

#: Sines that make up the load of an axis.
_SINES = 4


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
