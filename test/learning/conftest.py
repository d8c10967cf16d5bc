from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.learning.incidents import look_at
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import NANOSECONDS

CELLS = 600
PERIOD_S = 2


def record(  # noqa: PLR0913 -- what a day's robot is like
    number, *, mass_kg=1.5, center_m=(0.0, 0.01, 0.1), gain=1.0, noise=0.02, turned_deg=0.0,
    contact=0.1, jump=0.0, stopped=False, unseen=0.0, cells=CELLS,
):  # fmt: skip
    """Record a robot that goes from pose to pose; its sensor drifts, also by unseen heat."""
    rng = np.random.default_rng(number)
    hours = PERIOD_S * np.arange(cells) / 3600
    warm = 10.0 * (1 - np.exp(-hours / rng.uniform(0.05, 0.2)))
    inside = 18.0 + rng.uniform(0, 4) + warm
    room = 18.0 + rng.uniform(0, 3) + 3 * hours
    temperature_c = np.stack((inside, room), axis=1) + rng.normal(0, 0.01, (cells, 2))
    if stopped:
        rounding = np.spacing(temperature_c[0, 1]) * (np.arange(cells) % 2)
        temperature_c[:, 1] = temperature_c[0, 1] + rounding
    pose = np.repeat(rng.normal(size=(cells // 5, 3)), 5, axis=0)
    force = 9.807 * pose / np.linalg.norm(pose, axis=1, keepdims=True)
    weight = -mass_kg * force
    true = np.concatenate((weight, np.cross(center_m, weight)), axis=1)
    pushed = np.repeat(rng.random(cells // 10) < contact, 10)
    true[pushed] += rng.uniform(5, 40, (pushed.sum(), 6)) * [1, 1, 1, 0.1, 0.1, 0.1]
    units = np.array([1, -1, 0.6, 0.03, -0.05, 0.02])
    raw = gain * true + 0.5 * units * (inside - 22.0)[:, None]
    raw += rng.normal(0, 5, 6) * units
    raw[350:] += jump * units
    raw[:, 3] += unseen * units[3] * hours * np.exp(-hours)
    raw += rng.normal(0, noise, raw.shape) * units
    turned = Rotation.from_euler('z', turned_deg, degrees=True).apply(force)
    return Recording(
        f'day_{number:05d}.csv', PERIOD_S * NANOSECONDS, 12 * 3600 * number, temperature_c,
        np.ones(temperature_c.shape, dtype=bool), raw, np.full((cells, len(AXES)), np.nan),
        specific_force=turned + rng.normal(0, 0.005, force.shape),
        rotation_speed=np.zeros(cells))  # fmt: skip


@pytest.fixture(scope='session')
def recorded():
    """Recordings of days by number and specimen."""
    return record


@pytest.fixture(scope='session')
def separated():
    """Separated days by number and specimen; a day is separated once."""
    return cache(lambda number, **properties: look_at(record(number, **properties)))
