"""
Contacts on a sensor that drifts: what people do about the drift today, and this package.

``python bench/accuracy/contacts.py [SEEDS]``, 6 by default. A heat-conducting wrist works for
2.5 h with duty cycles that no method has seen. Every ten minutes it touches something for 60 s
with 20 N along z; in the last hour it holds 20 N all the time. Methods that learn were given four
other, unloaded days. The error is measured minus true force, in N.
"""

import argparse
from collections.abc import Callable, Sequence
from functools import partial

from judging import block_means, recording_of
import numpy as np
from peers import Day, PEERS
from scipy.signal import butter, lfilter

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import FloatArray
from wrist_ft_comp.simulation import ft_sensor
from wrist_ft_comp.simulation.ft_sensor import draw_run, drive, RunSettings, true_wrench
from wrist_ft_comp.stream.drift_of_recordings import simulate_drift

Z = AXES.index('force_z')
#: Length of a day, and how often the duty cycle of the wrist changes, s.
DAY_S, DUTY_S = 9000, 1200.0
CONTACT_N = 20.0
#: When a short contact begins, and how long it lasts, s.
STARTS_S = tuple(range(600, 5400, 600))
CONTACT_S = 60
#: When the long contact begins and ends, s.
HOLD_S = (5400, 9000)
#: A sensor is zeroed on this time before a contact, s.
REZERO_S = 5
#: Which run of the wrist is judged; the first four are learnt from.
JUDGED_RUN = 99
#: Estimates the true force of a day, shape (N,), from its readings and other days.
Practice = Callable[[Sequence[Recording], Recording], FloatArray]


def wrist(seed: int, run: int, contact_n: FloatArray | float = 0.0) -> Recording:
    """Warm up the simulated wrist of a seed, which conducts heat; a contact pushes along z."""
    rng = np.random.default_rng([seed, run])
    sensor = ft_sensor.build_sensor(seed)
    starts = np.arange(0.0, DAY_S, DUTY_S)
    levels = rng.uniform(0, 1, len(starts)) * (rng.random(len(starts)) > 0.35)
    settings = RunSettings(tuple(starts), tuple(levels), force_n=0.0, torque_nm=0.0)
    program = draw_run(settings, rng)
    elapsed_s: FloatArray = np.arange(DAY_S, dtype=float) + 0.5
    true = true_wrench(program, elapsed_s)
    true[:, Z] += contact_n
    driven = drive(program, elapsed_s)
    nodes_c = ft_sensor.trajectory(sensor, driven[0, 1], driven)
    measured = ft_sensor.measured_wrench(sensor, nodes_c[:-1], true)
    wrench = ft_sensor.digitised_wrench(measured, rng)
    return recording_of(ft_sensor.digitised_temperatures(sensor, nodes_c[:-1], rng), wrench, true)


def contacts() -> FloatArray:
    """Draw the contact force, N, shape (N,)."""
    force: FloatArray = np.zeros(HOLD_S[1])
    for start in STARTS_S:
        force[start : start + CONTACT_S] = CONTACT_N
    force[slice(*HOLD_S)] = CONTACT_N
    return force


def zeroed(force: FloatArray) -> FloatArray:
    """Zero on the first minute."""
    return np.asarray(force - force[:60].mean())


def zero_once(_: Sequence[Recording], day: Recording) -> FloatArray:
    """Zero at the start of the day only."""
    return zeroed(day.wrench[:, Z])


def rezero(_: Sequence[Recording], day: Recording) -> FloatArray:
    """Zero on the last seconds before every contact, as sensor vendors advise."""
    force = zeroed(day.wrench[:, Z])
    for start in (*STARTS_S, HOLD_S[0]):
        force[start:] -= force[start - REZERO_S : start].mean()
    return force


def high_pass(cut_off_hz: float, _: Sequence[Recording], day: Recording) -> FloatArray:
    """Pass the force through a first-order high-pass."""
    b, a = butter(1, cut_off_hz, 'highpass', fs=1.0)
    return np.asarray(lfilter(b, a, zeroed(day.wrench[:, Z])))


def cubic(training: Sequence[Recording], day: Recording) -> FloatArray:
    """Subtract a cubic polynomial of the thermometer in the sensor."""
    *learnt, judged = (
        Day(one.temperature_c, one.wrench, np.zeros_like(one.wrench), one.period_s)
        for one in (*training, day)
    )
    return zeroed(day.wrench[:, Z] - PEERS['cubic'](learnt, judged)[:, Z])


def ours(training: Sequence[Recording], day: Recording) -> FloatArray:
    """Calibrate with this package, by default settings."""
    zero, sensitivity = simulate_drift(calibrate(training).model, day)
    return zeroed((day.wrench[:, Z] - zero[:, Z]) / (1.0 + sensitivity[:, Z]))


PRACTICES: dict[str, Practice] = {
    'zeroed once': zero_once,
    'zeroed before every contact': rezero,
    'high-pass, 0.01 Hz': partial(high_pass, 0.01),
    'high-pass, 0.001 Hz': partial(high_pass, 0.001),
    'high-pass, 0.0001 Hz': partial(high_pass, 0.0001),
    'cubic polynomial': cubic,
    'this package': ours,
}


def contact_errors(estimate: FloatArray, day: Recording) -> list[float]:
    """Measure RMS in short contacts, RMS in between, and the worst of the long one, N."""
    error = estimate - day.reference[:, Z]
    touching, hold = contacts() > 0, slice(*HOLD_S)
    short = touching & (np.arange(len(error)) < HOLD_S[0])
    # Means of 10 s, because noise is no drift.
    in_contact, free, held = (
        block_means(error[rows, np.newaxis], 10) for rows in (short, ~touching, hold)
    )
    rms = [float(np.sqrt(np.mean(means**2))) for means in (in_contact, free)]
    return [*rms, float(np.max(np.abs(held)))]


def main() -> None:
    """Print the errors of practices during contacts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('seeds', nargs='?', type=int, default=6)
    found: dict[str, list[list[float]]] = {name: [] for name in PRACTICES}
    for seed in range(parser.parse_args().seeds):
        training = [wrist(seed, run) for run in range(4)]
        test = wrist(seed, JUDGED_RUN, contacts())
        for name, practice in PRACTICES.items():
            found[name].append(contact_errors(practice(training, test), test))
    print(f'error of force z, contacts of {CONTACT_N:g} N, N: median (worst)')
    titles = ('60 s contacts, RMS', 'free, RMS', '1 h contact, worst')
    print(f'{"":28}' + ''.join(f'{title:>20}' for title in titles))
    for name, rows in found.items():
        cells = (f'{np.median(kind):.2f} ({np.max(kind):.2f})' for kind in np.transpose(rows))
        print(f'{name:28}' + ''.join(f'{cell:>20}' for cell in cells))


if __name__ == '__main__':
    main()
