"""
How long ``auto`` takes: six axes of the simulated wrist, unloaded and loaded.

``python bench/identification.py``. 24 h, half and a quarter of it for the growth, five times
2.5 h, and a fortnight of 8 h a day, with the largest memory of the process.
"""

import os
import resource
import time

from wrist_ft_comp import ONE_THREAD

os.environ.update(ONE_THREAD)  # as the command and the node's calibration do, before numpy loads

import numpy as np
from scenarios import read_sensor

from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.settings import CalibrationSettings
from wrist_ft_comp.signals import FloatArray, NANOSECONDS, Recording, Reference
from wrist_ft_comp.simulation import ft_sensor
from wrist_ft_comp.simulation import run as simulated_run
from wrist_ft_comp.simulation.heat_flow import FtSensorSettings


def wrist(run: int, hours: float, *, loaded: bool) -> Recording:
    """Warm the simulated wrist up and down."""
    rng = np.random.default_rng(run)
    sensor = ft_sensor.build_sensor(FtSensorSettings(), 1)
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
    wrench, temperature_c = read_sensor(sensor, drive, true, rng)
    measured = np.ones(temperature_c.shape, dtype=bool)
    name = f'run {run}'
    return Recording(name, NANOSECONDS, 0, temperature_c, measured, wrench, true)


def print_times() -> None:
    """Print how long a calibration of six axes takes."""
    for hours, recordings in ((6.0, 1), (12.0, 1), (24.0, 1), (2.5, 5), (8.0, 14)):
        for loaded in (False, True):
            runs = [wrist(run, hours, loaded=loaded) for run in range(recordings)]
            reference: Reference = 'recorded' if loaded else 'unloaded'
            start = time.perf_counter()
            calibrate(runs, CalibrationSettings(reference=reference))
            took = time.perf_counter() - start
            what = 'loaded' if loaded else 'unloaded'
            print(f'auto, six axes, {recordings} x {hours:g} h at 1 s, {what}: {took:.1f} s')
    print(f'memory at most {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6:.2f} GB')


if __name__ == '__main__':
    print_times()
