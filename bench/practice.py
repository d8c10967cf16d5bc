"""
Contacts on a sensor that drifts: what people do about it today, and this package.

The heat-conducting wrist works for 2.5 h with duty cycles that no method has seen. Every ten
minutes it touches something for 60 s with 20 N along z; in the last hour it holds 20 N all the
time. Learning methods were given four other, unloaded days. The error is measured minus true
force, in N.
"""

import argparse
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from peers import polynomial
from scenarios import read_sensor, recording, wrist, Z
from scipy.signal import butter, lfilter

from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.settings import CalibrationSettings
from wrist_ft_comp.signals import FloatArray, Recording
from wrist_ft_comp.simulation import ft_sensor
from wrist_ft_comp.simulation import run as simulated_run
from wrist_ft_comp.simulation.heat_flow import FtSensorSettings
from wrist_ft_comp.stream.offline import simulate_drift

CONTACT_N = 20.0
DURATION_S = 9000
STARTS_S = tuple(range(600, 5400, 600))
CONTACT_S = 60
HOLD_S = (5400, DURATION_S)
REZERO_S = 5
#: Estimates the true force of a day, shape (N,), from its readings and other days.
Practice = Callable[[Sequence[Recording], Recording], FloatArray]


def contacts() -> FloatArray:
    """Draw the contact force, N, shape (N,)."""
    force: FloatArray = np.zeros(DURATION_S)
    for start in STARTS_S:
        force[start : start + CONTACT_S] = CONTACT_N
    force[slice(*HOLD_S)] = CONTACT_N
    return force


def day(seed: int) -> Recording:
    """Work for a day with contacts; the reference is the true force."""
    rng = np.random.default_rng([seed, 99])
    sensor = ft_sensor.build_sensor(FtSensorSettings(), seed)
    starts = np.arange(0.0, DURATION_S, 1200.0)
    levels = rng.uniform(0, 1, len(starts)) * (rng.random(len(starts)) > 0.35)
    settings = simulated_run.RunSettings(
        duty_start_s=tuple(starts), duty_level=tuple(levels), force_n=0.0, torque_nm=0.0
    )
    drawn = simulated_run.draw_run(settings, rng)
    elapsed_s: FloatArray = np.arange(DURATION_S, dtype=float) + 0.5
    true = simulated_run.true_wrench(drawn, elapsed_s)
    true[:, Z] += contacts()
    drive = simulated_run.drive(drawn, elapsed_s)
    wrench, temperature_c = read_sensor(sensor, drive, true, rng)
    return recording(temperature_c, wrench[:, Z], true[:, Z])


def tared(force: FloatArray) -> FloatArray:
    """Zero on the first minute."""
    result: FloatArray = force - force[:CONTACT_S].mean()
    return result


def zero_once(_: Sequence[Recording], each: Recording) -> FloatArray:
    """Zero at the start of the day only."""
    return tared(each.wrench[:, Z])


def rezero(_: Sequence[Recording], each: Recording) -> FloatArray:
    """Zero on the last seconds before every contact, as sensor vendors advise."""
    force = tared(each.wrench[:, Z])
    for start in (*STARTS_S, HOLD_S[0]):
        force[start:] -= force[start - REZERO_S : start].mean()
    return force


def high_pass(cut_off_hz: float, _: Sequence[Recording], each: Recording) -> FloatArray:
    """Pass the force through a first-order high-pass."""
    b, a = butter(1, cut_off_hz, 'highpass', fs=1.0)
    return np.asarray(lfilter(b, a, tared(each.wrench[:, Z])))


def cubic(training: Sequence[Recording], each: Recording) -> FloatArray:
    """Subtract a cubic polynomial of the thermometer in the sensor."""
    return tared(each.wrench[:, Z] - polynomial(3, training)(each))


def ours(training: Sequence[Recording], each: Recording) -> FloatArray:
    """Calibrate with this package, by default settings."""
    drift = simulate_drift(calibrate(training, CalibrationSettings()).model, each)
    return tared((each.wrench[:, Z] - drift.zero[:, Z]) / (1.0 + drift.sensitivity[:, Z]))


PRACTICES: dict[str, Practice] = {
    'zeroed once': zero_once,
    'zeroed before every contact': rezero,
    'high-pass, 0.01 Hz': partial(high_pass, 0.01),
    'high-pass, 0.001 Hz': partial(high_pass, 0.001),
    'high-pass, 0.0001 Hz': partial(high_pass, 0.0001),
    'cubic polynomial': cubic,
    'this package': ours,
}


def errors(estimate: FloatArray, each: Recording) -> list[float]:
    """Measure RMS in short contacts, RMS in between, and the worst of the long one, N."""
    error = estimate - each.reference[:, Z]
    touching = contacts() > 0
    short = touching & (np.arange(DURATION_S) < HOLD_S[0])
    free, hold = ~touching, slice(*HOLD_S)
    # Means of 10 s, because noise is no drift.
    return [
        *(float(np.sqrt(np.mean(smooth(error[rows]) ** 2))) for rows in (short, free)),
        float(np.max(np.abs(smooth(error[hold])))),
    ]


def smooth(values: FloatArray) -> FloatArray:
    """Means of ten seconds, shape (N // 10,)."""
    means: FloatArray = values[: len(values) // 10 * 10].reshape(-1, 10).mean(axis=1)
    return means


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('seeds', nargs='?', type=int, default=6)
    seeds = range(parser.parse_args().seeds)
    found: dict[str, list[list[float]]] = {name: [] for name in PRACTICES}
    for seed in seeds:
        training = [wrist(seed, run, 2, loaded=False) for run in range(4)]
        test = day(seed)
        for name, practice in PRACTICES.items():
            found[name].append(errors(practice(training, test), test))
    print(
        f'error of force z in N, contacts of {CONTACT_N:g} N: median (worst) of {len(seeds)} seeds'
    )
    titles = ('60 s contacts, RMS', 'free, RMS', '1 h contact, worst')
    print(f'{"":28}' + ''.join(f'{title:>20}' for title in titles))
    for name, rows in found.items():
        middle, worst = np.median(rows, axis=0), np.max(rows, axis=0)
        cells = (f'{m:.2f} ({w:.2f})' for m, w in zip(middle, worst, strict=True))
        print(f'{name:28}' + ''.join(f'{cell:>20}' for cell in cells))


if __name__ == '__main__':
    main()
