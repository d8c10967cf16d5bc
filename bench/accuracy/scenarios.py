"""Recordings to learn from and to be judged on: simulated sensors, and a real load cell."""

from collections.abc import Callable
import csv
from dataclasses import replace
from datetime import datetime
from functools import partial
from pathlib import Path

from judging import recording_of
import numpy as np

from wrist_ft_comp.drift.arx import free_run, relaxation
from wrist_ft_comp.signals import AXES, FloatArray, NANOSECONDS, Recording, Samples
from wrist_ft_comp.simulation import ft_sensor
from wrist_ft_comp.simulation.heat_flow import FtSensorSettings
from wrist_ft_comp.simulation.run import draw_run, drive, RunSettings, true_wrench
from wrist_ft_comp.stream.batch_grid import grid_samples

Z = AXES.index('force_z')
#: From a seed to recordings to learn from, one to be judged on, and the drift behind its noise.
Drawn = tuple[list[Recording], Recording, FloatArray]
Scenario = Callable[[int], Drawn]

#: The load cell of the TANEN project (by hmd83, CC BY 4.0): 22 kg for 40.8 h, beside the project.
LOAD_CELL = Path(__file__).parents[3] / 'shared' / 'data' / 'load_cell' / 'constant_load_run1.csv'
LEARNT_H = 20.0
#: The duty cycle of the wrist changes this often, s.
DUTY_S = 1200.0


def only_z(temperature_c: FloatArray, raw: FloatArray, true: FloatArray) -> Recording:
    """Make a recording of force z, (N,)."""
    wrench, reference = (np.full((len(raw), len(AXES)), np.nan) for _ in range(2))
    wrench[:, Z], reference[:, Z] = raw, true
    return recording_of(temperature_c, wrench, reference)


def lag(values: FloatArray, tau_s: float) -> FloatArray:
    """Pass a series through a first-order lag."""
    return free_run(relaxation(tau_s, 1.0), values)


def two_lags(seed: int, hours: float, noise: float = 1.0) -> Recording:
    """Two hidden lags of 300 s and 1500 s, quadratic zero drift, 0.04 %/K gain drift, loads."""
    rng = np.random.default_rng(seed)
    cells = int(hours * 3600)
    room_k = np.repeat(rng.uniform(0, 30, cells // 900 + 1), 900)[:cells]
    temperature = 22 + lag(room_k, 600.0)
    fast, slow = lag(temperature - 22, 300.0), lag(temperature - 22, 1500.0)
    zero = 2.0 * fast - 1.2 * slow + 0.01 * slow**2
    true = np.repeat(rng.normal(0, 20, cells // 5 + 1), 5)[:cells]
    raw = (1 - 0.0004 * slow) * true + zero + noise * rng.normal(0, 0.1, cells)
    return only_z((temperature + rng.normal(0, 0.02, cells))[:, np.newaxis], raw, true)


def warm_up(  # noqa: PLR0913 -- what a run can differ in
    rng: np.random.Generator,
    seed: int,
    hours: float,
    *,
    loaded: bool = False,
    noise: float = 1.0,
    contact_n: FloatArray | float = 0.0,
) -> Recording:
    """Warm the heat-conducting wrist of a seed up; a contact pushes along z beside the loads."""
    usual = FtSensorSettings()
    sensor = ft_sensor.build_sensor(
        replace(usual, force_noise_n=noise * usual.force_noise_n), seed
    )
    starts = np.arange(0.0, hours * 3600, DUTY_S)
    levels = rng.uniform(0, 1, len(starts)) * (rng.random(len(starts)) > 0.35)
    force_n, torque_nm = (20.0, 1.0) if loaded else (0.0, 0.0)
    run = draw_run(
        RunSettings(tuple(starts), tuple(levels), force_n=force_n, torque_nm=torque_nm), rng
    )
    elapsed_s: FloatArray = np.arange(round(hours * 3600), dtype=float) + 0.5
    true = true_wrench(run, elapsed_s)
    true[:, Z] += contact_n
    driven = drive(run, elapsed_s)
    nodes_c = ft_sensor.trajectory(sensor, ft_sensor.start(sensor, float(driven[0, 1])), driven)
    measured = ft_sensor.measured_wrench(sensor, nodes_c[:-1], true)
    wrench = ft_sensor.digitised_wrench(sensor, measured, rng)
    return recording_of(ft_sensor.digitised_temperatures(sensor, nodes_c[:-1], rng), wrench, true)


def wrist(  # noqa: PLR0913 -- the same
    seed: int,
    run: int,
    thermometers: int,
    *,
    loaded: bool = False,
    noise: float = 1.0,
    contact_n: FloatArray | float = 0.0,
) -> Recording:
    """Warm the wrist up for 2.5 h; force z only."""
    rng = np.random.default_rng([seed, run])
    whole = warm_up(rng, seed, 2.5, loaded=loaded, noise=noise, contact_n=contact_n)
    temperature_c = whole.temperature_c[:, :thermometers]
    return only_z(temperature_c, whole.wrench[:, Z], whole.reference[:, Z])


def still(seed: int, run: int, noise_n: float) -> Recording:
    """Record a sensor without drift in a room that warms up: noise only."""
    rng = np.random.default_rng([seed, run])
    temperature = 22 + lag(np.repeat(rng.uniform(0, 20, 10), 720), 600.0)
    raw = rng.normal(0, noise_n, len(temperature))
    return only_z(temperature[:, np.newaxis], raw, np.zeros_like(raw))


def two_lag_runs(seed: int) -> Drawn:
    """Two recordings to learn from, a third to judge."""
    last = 100 * seed + 3
    learnt = [two_lags(100 * seed + 1, 2.0), two_lags(100 * seed + 2, 2.0)]
    return learnt, two_lags(last, 3.0), drift(two_lags(last, 3.0, noise=0.0))


def wrists(thermometers: int, loaded: bool, seed: int) -> Drawn:
    """Four recordings to learn from, a fifth to judge."""
    runs = [wrist(seed, run, thermometers, loaded=loaded) for run in range(5)]
    return runs[:4], runs[4], drift(wrist(seed, 4, thermometers, loaded=loaded, noise=0.0))


def stills(noise_n: float, seed: int) -> Drawn:
    """Three recordings without drift to learn from, a fourth to judge."""
    runs = [still(seed, run, noise_n) for run in range(4)]
    return runs[:3], runs[3], np.zeros(len(runs[3]))


def drift(day: Recording) -> FloatArray:
    """Raw minus true wrench of force z, shape (N,)."""
    return day.wrench[:, Z] - day.reference[:, Z]


def with_zero_reference(day: Recording) -> Recording:
    """Say that the true load did not change."""
    return replace(day, reference=np.where(np.isfinite(day.wrench), 0.0, np.nan))


def load_cell() -> tuple[Recording, Recording] | None:
    """Read the first hours of the load cell, and the rest, in g; None where its file is not."""
    if not LOAD_CELL.exists():
        return None
    with LOAD_CELL.open(encoding='utf-8') as file:
        rows = list(csv.DictReader(file, delimiter=';'))
    stamps = [datetime.fromisoformat(row['time'].replace('Z', '+00:00')) for row in rows]
    elapsed_s = np.array([(stamp - stamps[0]).total_seconds() for stamp in stamps])
    stamps_ns = (elapsed_s * NANOSECONDS).astype(np.int64)
    values = np.array([[float(row['T_C']), 1000 * float(row['W_raw_kg'])] for row in rows])
    samples = [
        Samples(('temperature_c',), stamps_ns, values[:, :1]),
        Samples(('force_z',), stamps_ns, values[:, 1:]),
    ]
    whole = with_zero_reference(grid_samples(samples, name='load cell', period_s=30.0))
    cut = int(LEARNT_H * 3600 / whole.period_s)
    return part(whole, 0, cut), part(whole, cut, len(whole))


def part(whole: Recording, first: int, last: int) -> Recording:
    """Take some cells of a recording."""
    return replace(
        whole,
        first_cell=whole.first_cell + first,
        temperature_c=whole.temperature_c[first:last],
        measured=whole.measured[first:last],
        wrench=whole.wrench[first:last],
        reference=whole.reference[first:last],
    )


SCENARIOS: dict[str, Scenario] = {
    'two lags': two_lag_runs,
    'wrist, 1 thermometer': partial(wrists, 1, False),
    'wrist, 1, loaded': partial(wrists, 1, True),
    'wrist, 2 thermometers': partial(wrists, 2, False),
    'wrist, 2, loaded': partial(wrists, 2, True),
    'noise only': partial(stills, 0.1),
    'no drift': partial(stills, 1e-3),
}
