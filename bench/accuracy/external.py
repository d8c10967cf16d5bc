"""
The wrench without drift and payload, and a payload from a minute of motion, on simulated robots.

``python bench/accuracy/external.py`` draws twelve robots from the last commit that touched how
drift is learnt, as ``worlds.py`` does; ``--dev`` draws the ones to develop on. Each works for a
day with a tool and a part, contacts included, from which drift and payload are learnt, by an
accelerometer (crooked, biased, drifting) or by TF, which knows no acceleration. On another day it
moves freely while it warms up, up to 1 rad/s and 1 m/s², and what the stream takes off is compared
with what pushed on the tool, over means of 1 s, tared in the first minute:

    RMS of the error <= sqrt(drift left² + (twice the noise)² + (3 % of the weight)²)

per axis, a torque's weight by the lever of the centre of mass; the noise is that of a reading.
Then ``~/identify_payload``'s arithmetic gets 60 s of that motion with contacts, warm: its mass has
to be within 3 %, its centre of mass within 5 mm.
"""

import argparse
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
import os
from typing import NamedTuple

os.environ.setdefault('OMP_NUM_THREADS', '1')
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import numpy as np
from worlds import DEVELOPMENT_SEED, report_seed

from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.settings import CalibrationSettings
from wrist_ft_comp.payload.live_weight import LivePayload
from wrist_ft_comp.payload.minute_of_motion import identify
from wrist_ft_comp.payload.motion import CELL_S, DURATION_S, MotionCollector
from wrist_ft_comp.payload.weight import ForceFrame, Payload
from wrist_ft_comp.signals import AXES, FloatArray, GRAVITY, NANOSECONDS, Recording
from wrist_ft_comp.simulation.ft_sensor import (
    build_sensor,
    digitised_temperatures,
    digitised_wrench,
    measured_wrench,
    NOMINAL_C,
    per_axis,
    start,
    trajectory,
)
from wrist_ft_comp.simulation.heat_flow import FtSensorSettings
from wrist_ft_comp.simulation.run import draw_run, drive, room_temperature, RunSettings
from wrist_ft_comp.simulation.work import (
    draw_accelerometer,
    draw_work,
    move,
    read_imu,
    Work,
    WorkSettings,
)
from wrist_ft_comp.stream.compensator import Compensator

RATE, SECONDS, TARE_S = 20, 9000, 60
DUTIES = (((0, 600, 4200, 6000), (0.0, 0.9, 0.0, 0.5)), ((0, 900, 5000), (0.0, 0.7, 0.2)))
MASS, CENTER_M, WEIGHT = 0.03, 0.005, 0.03


class Day(NamedTuple):
    """A day at RATE: what is read and true; temperatures once a second."""

    raw: FloatArray
    true: FloatArray
    contact: FloatArray
    force: FloatArray
    speed: FloatArray
    temperature_c: FloatArray


def live(seed: int, number: int, work: Work, *, tf: bool) -> Day:
    """Live a day of a specimen."""
    rng = np.random.default_rng([seed, number, 7])
    starts_s, levels = DUTIES[number]
    run = draw_run(RunSettings(tuple(map(float, starts_s)), levels, force_n=0, torque_nm=0), rng)
    sensor = build_sensor(FtSensorSettings(), seed)
    begun = start(sensor, float(room_temperature(run, 0.0)))
    nodes_c = trajectory(sensor, begun, drive(run, np.arange(SECONDS, dtype=np.float64)))[:-1]
    seconds = np.repeat(np.arange(SECONDS), RATE)
    motion = move(work, (np.arange(SECONDS * RATE) + 0.5) / RATE)
    true = motion.contact + motion.weight
    parts = np.array_split(np.arange(len(seconds)), 50)  # gauges of a whole day need gigabytes
    ideal = [measured_wrench(sensor, nodes_c[seconds[part]], true[part]) for part in parts]
    raw = digitised_wrench(sensor, np.concatenate(ideal), rng)
    temperature_c = digitised_temperatures(sensor, nodes_c, rng)
    imu = draw_accelerometer(np.random.default_rng([seed, 1]))
    read = read_imu(imu, motion, temperature_c[seconds, 0] - NOMINAL_C, rng)
    force = motion.pose.inv().apply([0, 0, GRAVITY]) if tf else read[:, :3]
    speed = np.linalg.norm(read[:, 3:], axis=1)
    return Day(raw, true, motion.contact, force, speed, temperature_c)


def means(values: FloatArray) -> FloatArray:
    """Means over a second."""
    return np.asarray(values.reshape(-1, RATE, *values.shape[1:]).mean(axis=1))


def recorded(day: Day) -> Recording:
    """Record a day."""
    raw, felt = means(day.raw), means(day.force)
    measured = np.ones(day.temperature_c.shape, dtype=bool)
    unknown = np.full_like(raw, np.nan)
    fast = np.sqrt(means(day.speed**2))
    return Recording(
        'day', NANOSECONDS, 0, day.temperature_c, measured, raw, unknown,
        specific_force=felt, rotation_speed=fast,
    )  # fmt: skip


class Judged(NamedTuple):
    """What came of one robot; errors of mass, relative, and of centre of mass, m."""

    #: Error of the external wrench, and by what is allowed, (6,).
    external: FloatArray
    share: FloatArray
    #: Of what the day at work taught, and of a minute; NaN where it was refused.
    learnt: tuple[float, float]
    minute: tuple[float, float]


def judge(seed: int, *, tf: bool) -> Judged:
    """Judge one robot."""
    rng = np.random.default_rng([seed, 3])
    settings = WorkSettings(rng.uniform(0.7, 2.5), rng.uniform(0.4, 2.0))
    work = draw_work(settings, np.random.default_rng([seed, 4]))
    day = recorded(live(seed, 0, work, tf=tf))
    calibration = calibrate([day], CalibrationSettings('payload'))
    learnt = calibration.payloads
    if learnt is None:
        print(f'  robot {seed}: {calibration.warnings}')
        nothing = np.full(len(AXES), np.nan)
        return Judged(nothing, nothing, (np.nan, np.nan), (np.nan, np.nan))
    tool = min(
        learnt.payloads.values(), key=lambda payload: abs(payload.mass_kg - settings.tool_kg)
    )
    # The fastest moment of a smooth motion is 5.774 times its way over its time squared.
    quickest = 5.774 * np.linalg.norm(work.ways_m, axis=1) / work.moves_s**2
    gentle = replace(
        work,
        held=np.zeros_like(work.held),
        ways_m=work.ways_m / np.maximum(quickest, 1.0)[:, np.newaxis],
    )
    free = live(seed, 1, replace(gentle, pressed=np.zeros_like(work.pressed)), tf=tf)
    stream = Compensator(2, model=calibration.model)
    held = LivePayload('tool', tool, learnt.frame)
    left, external = followed(stream, free, held)
    true = work.payloads[0]
    weight = true.mass_kg * GRAVITY * np.repeat([1.0, float(np.linalg.norm(true.center_m))], 3)
    s = FtSensorSettings()
    noise = 2 * per_axis(s.force_noise_n, s.torque_noise_nm)
    allowed = np.sqrt(left**2 + noise**2 + (WEIGHT * weight) ** 2)
    pressing = live(seed, 1, gentle, tf=tf)
    return Judged(
        external,
        external / allowed,
        errors(tool, true),
        errors(in_a_minute(stream, pressing, learnt.frame), true),
    )


def followed(stream: Compensator, day: Day, held: LivePayload) -> tuple[FloatArray, FloatArray]:
    """Run a day through the stream: RMS of what is left of drift and in the external wrench."""
    wrench, external = (np.empty_like(day.raw) for _ in range(2))
    for second, temperatures in enumerate(day.temperature_c.tolist()):
        for number, temperature_c in enumerate(temperatures):
            stream.add_temperature(number, second * NANOSECONDS, temperature_c)
        for row in range(second * RATE, (second + 1) * RATE):
            stamp_ns, raw = round((row + 0.5) / RATE * NANOSECONDS), day.raw[row].tolist()
            wrench[row] = stream.correct(stamp_ns, raw)
            without = stream.correct(stamp_ns, raw, external=True)
            external[row] = held.taken_off(without, tuple(day.force[row].tolist()))
    return tared(wrench - day.true), tared(external - day.contact)


def tared(error: FloatArray) -> FloatArray:
    """Root mean square of means of 1 s, tared in the first minute, (6,)."""
    averaged = means(error)
    return np.asarray(np.sqrt(np.mean((averaged - averaged[:TARE_S].mean(axis=0)) ** 2, axis=0)))


def in_a_minute(stream: Compensator, day: Day, frame: ForceFrame) -> Payload | None:
    """Identify the payload in the last minute of a day; None where that is refused."""
    collector = MotionCollector()
    for row in range(len(day.raw) - round((DURATION_S + 1) * RATE), len(day.raw)):
        stamp_ns = round((row + 0.5) / RATE * NANOSECONDS)
        wrench = stream.correct(stamp_ns, day.raw[row].tolist(), external=True)
        if collector.add(stamp_ns, wrench, day.force[row].tolist(), float(day.speed[row])):
            break
    try:
        return identify(np.array(collector.cells), CELL_S, frame).payload
    except CalibrationRefusedError as refusal:
        print(f'  refused: {refusal}')
        return None


def errors(found: Payload | None, true: Payload) -> tuple[float, float]:
    """Compare a payload with the true one: relative error of the mass, and centre, m."""
    if found is None:
        return np.nan, np.nan
    off = float(np.linalg.norm(found.center_m - true.center_m))
    return abs(found.mass_kg - true.mass_kg) / true.mass_kg, off


def print_kind(title: str, judged: Sequence[Judged]) -> None:
    """Print what came of all robots."""
    share = np.stack([robot.share for robot in judged])
    external = np.stack([robot.external for robot in judged])
    print(f'\n{title}, {len(judged)} robots')
    print('  ' + ''.join(f'{axis:>12}' for axis in AXES))
    print(
        '  '
        + ''.join(f'{value:12.4f}' for value in np.nanmedian(external, axis=0))
        + '  median RMS'
    )
    print(
        '  '
        + ''.join(f'{value:12.2f}' for value in np.nanmax(share, axis=0))
        + '  worst, by what is '
        f'allowed; {np.mean(share <= 1):.0%} of axes within'
    )
    for name in ('learnt', 'minute'):
        mass, center = np.array([getattr(robot, name) for robot in judged]).T
        within = (mass <= MASS) & (center <= CENTER_M)
        print(
            f'  {name}: mass off by {100 * np.nanmedian(mass):.2f} % (worst '
            f'{100 * np.nanmax(mass):.2f}), centre by {1e3 * np.nanmedian(center):.2f} mm (worst '
            f'{1e3 * np.nanmax(center):.2f}); {within.sum()} of {len(mass)} within 3 % and 5 mm, '
            f'{np.isnan(mass).sum()} refused',
            flush=True,
        )


def main() -> None:
    """Judge by an accelerometer, and by TF."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('--dev', action='store_true', help='robots to develop on')
    parser.add_argument('--robots', type=int, default=12)
    parser.add_argument('--jobs', type=int, default=min(2, os.cpu_count() or 1))
    options = parser.parse_args()
    first = DEVELOPMENT_SEED if options.dev else report_seed()
    seeds = range(first, first + options.robots)
    with ProcessPoolExecutor(options.jobs) as pool:
        for title, tf in (('accelerometer', False), ('TF', True)):
            print_kind(title, list(pool.map(partial(judge, tf=tf), seeds)))


if __name__ == '__main__':
    main()
