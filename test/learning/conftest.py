from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.learning.separated_day import look_at
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import NANOSECONDS

CELLS = 600
PERIOD_S = 2


@dataclass(frozen=True)
class Specimen:
    """What a day's robot is like; drift in N and N m per kelvin behind a lag."""

    drift: float = 0.5
    mass_kg: float = 1.5
    center_m: tuple[float, float, float] = (0.0, 0.01, 0.1)
    gain: float = 1.0
    noise: float = 0.02
    turned_deg: float = 0.0
    contact: float = 0.1
    jump: float = 0.0
    stopped: bool = False
    warm_k: float = 10.0
    cells: int = CELLS


def record(number: int, **properties) -> Recording:
    """Record a robot that goes from pose to pose and warms up."""
    specimen = Specimen(**properties)
    cells = specimen.cells
    rng = np.random.default_rng(number)
    hours = PERIOD_S * np.arange(cells) / 3600
    warm = specimen.warm_k * (1 - np.exp(-hours / rng.uniform(0.05, 0.2)))
    inside = 18.0 + rng.uniform(0, 4) + warm
    room = 18.0 + rng.uniform(0, 3) + 3 * hours
    temperature_c = np.stack((inside, room), axis=1) + rng.normal(0, 0.01, (cells, 2))
    if specimen.stopped:
        rounding = np.spacing(temperature_c[0, 1]) * (np.arange(cells) % 2)
        temperature_c[:, 1] = temperature_c[0, 1] + rounding
    pose = np.repeat(rng.normal(size=(cells // 5, 3)), 5, axis=0)
    force = 9.807 * pose / np.linalg.norm(pose, axis=1, keepdims=True)
    weight = -specimen.mass_kg * force
    true = np.concatenate((weight, np.cross(specimen.center_m, weight)), axis=1)
    pushed = np.repeat(rng.random(cells // 10) < specimen.contact, 10)
    true[pushed] += rng.uniform(5, 40, (pushed.sum(), 6)) * [1, 1, 1, 0.1, 0.1, 0.1]
    units = np.array([1, -1, 0.6, 0.03, -0.05, 0.02])
    raw = specimen.gain * true + specimen.drift * units * (inside - 22.0)[:, None]
    raw += rng.normal(0, 5, 6) * units
    raw[350:] += specimen.jump * units
    raw += rng.normal(0, specimen.noise, raw.shape) * units
    angle = np.deg2rad(specimen.turned_deg)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0],
                     [0, 0, 1]])  # fmt: skip
    return Recording(
        f'day_{number:05d}.csv', PERIOD_S * NANOSECONDS, 12 * 3600 * number, temperature_c,
        np.ones(temperature_c.shape, dtype=bool), raw, np.full((cells, len(AXES)), np.nan),
        specific_force=force @ turn.T + rng.normal(0, 0.005, force.shape),
        rotation_speed=np.zeros(cells))  # fmt: skip


@pytest.fixture(scope='session')
def separated():
    """Separated days by number and specimen; a day is separated once."""
    return cache(lambda number, **properties: look_at(record(number, **properties)))
