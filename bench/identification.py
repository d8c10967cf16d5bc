"""
How long ``auto`` takes, and what it makes of a real load cell.

``python bench/identification.py``. Six axes of the simulated wrist for 24 h and for five times
2.5 h, unloaded and loaded; then the load cell of the TANEN project (by hmd83, CC BY 4.0; 22 kg for
40.8 h), fitted to the first 20 h and judged on the rest, where its file is beside the project.
"""

import csv
import time
from datetime import datetime
from pathlib import Path

import numpy as np

from wrist_ft_comp.core import simulated_run, thermal_sensor
from wrist_ft_comp.core.calibration import CalibrationSettings, calibrate
from wrist_ft_comp.core.evaluation import simulate_drift
from wrist_ft_comp.core.problem import Reference
from wrist_ft_comp.core.recording import AXES, NANOSECONDS, FloatArray, Recording, Samples
from wrist_ft_comp.core.sampling import grid_samples

LOAD_CELL = Path(__file__).parents[2] / 'shared' / 'data' / 'load_cell' / 'constant_load_run1.csv'
Z = AXES.index('force_z')


def wrist(run: int, hours: float, *, loaded: bool) -> Recording:
    """Warm the simulated wrist up and down."""
    rng = np.random.default_rng(run)
    sensor = thermal_sensor.build_sensor(thermal_sensor.ThermalSensorSettings(), 1)
    starts = np.arange(0.0, hours * 3600, 1200.0)
    settings = simulated_run.RunSettings(
        duty_start_s=tuple(starts),
        duty_level=tuple(rng.uniform(0, 1, len(starts)) * (rng.random(len(starts)) > 0.35)),
        force_n=20.0 if loaded else 0.0,
        torque_nm=1.0 if loaded else 0.0,
    )
    drawn = simulated_run.draw_run(settings, rng)
    elapsed_s: FloatArray = np.arange(round(hours * 3600), dtype=float) + 0.5
    true = simulated_run.true_wrench(drawn, elapsed_s)
    drive = simulated_run.drive(drawn, elapsed_s)
    start = thermal_sensor.start(sensor, float(drive[0, 1]))
    made = thermal_sensor.simulate(sensor, start, drive, true, (rng, rng))
    measured = np.ones(made.temperature_c.shape, dtype=bool)
    name = f'run {run}'
    return Recording(name, NANOSECONDS, 0, made.temperature_c, measured, made.wrench, true)


def print_times() -> None:
    """Print how long a calibration of six axes takes."""
    for hours, recordings in ((24.0, 1), (2.5, 5)):
        for loaded in (False, True):
            runs = [wrist(run, hours, loaded=loaded) for run in range(recordings)]
            reference: Reference = 'recorded' if loaded else 'unloaded'
            start = time.perf_counter()
            calibrate(runs, CalibrationSettings(reference=reference))
            took = time.perf_counter() - start
            what = 'loaded' if loaded else 'unloaded'
            print(f'auto, six axes, {recordings} x {hours:g} h at 1 s, {what}: {took:.1f} s')


def read_load_cell() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Read time (s), temperature (°C) and raw reading (g)."""
    with LOAD_CELL.open(encoding='utf-8') as file:
        rows = list(csv.DictReader(file, delimiter=';'))
    stamps = [datetime.fromisoformat(row['time'].replace('Z', '+00:00')) for row in rows]
    elapsed_s = np.array([(stamp - stamps[0]).total_seconds() for stamp in stamps])
    temperature_c = np.array([float(row['T_C']) for row in rows])
    return elapsed_s, temperature_c, np.array([1000 * float(row['W_raw_kg']) for row in rows])


def on_grid(elapsed_s: FloatArray, temperature_c: FloatArray, raw: FloatArray) -> Recording:
    """Put a part of the load cell's record onto cells of 30 s."""
    stamps_ns = (elapsed_s * NANOSECONDS).astype(np.int64)
    blocks = [
        Samples(('temperature_c',), stamps_ns, temperature_c[:, np.newaxis]),
        Samples(('force_z',), stamps_ns, raw[:, np.newaxis]),
    ]
    return grid_samples(blocks, name='load cell', period_s=30.0)


def spread(elapsed_s: FloatArray, left: FloatArray) -> str:
    """Print standard deviations, as they are and around the slow creep over time."""
    creep = np.polynomial.Polynomial.fit(elapsed_s, left, 1)
    return f'{np.std(left):5.1f} g, around its creep {np.std(left - creep(elapsed_s)):5.1f} g'


def print_load_cell() -> None:
    """Print what is left of the load cell's drift in the hours that were not fitted."""
    if not LOAD_CELL.exists():
        print(f'load cell: skipped, {LOAD_CELL.name} is not beside the project')
        return
    elapsed_s, temperature_c, raw = read_load_cell()
    early = elapsed_s < 20 * 3600
    print(f'load cell, raw: {spread(elapsed_s[~early], raw[~early])}')
    line = np.polynomial.Polynomial.fit(temperature_c[early], raw[early], 1)
    left = raw[~early] - np.asarray(line(temperature_c[~early]), dtype=float)
    print(f'load cell, straight line: {spread(elapsed_s[~early], left)}')
    training = on_grid(elapsed_s[early], temperature_c[early], raw[early])
    found = calibrate([training], CalibrationSettings(reference='constant'))
    everything = on_grid(elapsed_s, temperature_c, raw)
    drift = simulate_drift(found.model, everything).zero[:, Z]
    cells = (elapsed_s * NANOSECONDS).astype(np.int64) // everything.period_ns
    left = (raw - drift[cells - everything.first_cell])[~early]
    print(f'load cell, auto ({found.fits["force_z"].chosen}): {spread(elapsed_s[~early], left)}')


if __name__ == '__main__':
    print_times()
    print_load_cell()
