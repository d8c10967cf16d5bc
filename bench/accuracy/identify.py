"""
How well ``~/identify_payload`` does: a minute of the simulated robot's work, in many worlds.

``python bench/accuracy/identify.py [--worlds N] [--seed S]``. Each world has a tool, a program and
an accelerometer of its own (3° off, 0.1 m/s², 0.5 %) that no calibration has looked at. A row
tells how many were refused, errors of mass and of the centre of mass, the share within 3 % and 5
mm, and which multiple of the stated standard error of the mass nine of ten keep within.
"""

import argparse
from contextlib import suppress
import math
import time

import numpy as np

from wrist_ft_comp.channels import GRAVITY
from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.payload.identify_payload import identify
from wrist_ft_comp.payload.motion_collector import CELL_S, DURATION_S, MotionCollector
from wrist_ft_comp.payload.weight import Payload
from wrist_ft_comp.series import FloatArray, NANOSECONDS
from wrist_ft_comp.simulation import robot_at_work as robots

RATE_HZ = 100
NOISE = np.repeat([0.1, 0.005], 3)


def collected(
    seed: tuple[int, int], contacts: float, *, by_tf: bool
) -> tuple[FloatArray, Payload]:
    """Let a robot work for a minute; by TF nothing tells its acceleration or speed."""
    rng = np.random.default_rng(seed)
    work = robots.draw_work(robots.WorkSettings(part_kg=0.0, contacts=contacts), rng)
    since_s = np.arange(round(DURATION_S * RATE_HZ) + 2) / RATE_HZ
    time_s: FloatArray = rng.uniform(0, 500) + since_s
    motion = robots.move(work, time_s)
    imu = robots.read_imu(robots.draw_accelerometer(rng), motion, np.zeros(len(time_s)), rng)
    if by_tf:
        imu[:, :3], imu[:, 3:] = motion.pose.inv().apply([0, 0, GRAVITY]), np.nan
    wrench = motion.weight + motion.contact + rng.normal(0, NOISE, (len(time_s), 6))
    collector = MotionCollector()
    for k, row in enumerate(wrench.tolist()):
        stamp_ns = k * NANOSECONDS // RATE_HZ
        if collector.add(stamp_ns, row, imu[k, :3].tolist(), math.hypot(*imu[k, 3:])):
            break
    return np.array(collector.cells), work.payloads[0]


#: What is printed: a row's name, the share of time in contact, and whether down is known by TF.
ROWS = (
    ('free motion', 0.0, False),
    ('contacts, 15 % of time', 0.15, False),
    ('contacts, 30 % of time', 0.3, False),
    ('contacts, 15 %, by TF', 0.15, True),
)


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description='How well a minute of motion tells a payload.')
    parser.add_argument('--worlds', type=int, default=30)
    parser.add_argument('--seed', type=int, default=2024)
    given = parser.parse_args()
    print(
        f'{"":>24} {"refused":>8} {"mass, %":>8} {"worst":>6} {"centre, mm":>10} {"worst":>6} '
        f'{"within":>8} {"errors":>8} {"worst ms":>8}'
    )
    for name, contacts, by_tf in ROWS:
        found, took_s = [], [0.0]
        for world in range(given.worlds):
            cells, tool = collected((given.seed, world), contacts, by_tf=by_tf)
            start = time.perf_counter()
            with suppress(CalibrationRefusedError):
                payload, _ = identify(cells, CELL_S, None)
                took_s.append(time.perf_counter() - start)
                off_kg = abs(payload.mass_kg - tool.mass_kg)
                off_mm = 1e3 * float(np.linalg.norm(payload.center_m - tool.center_m))
                found.append((100 * off_kg / tool.mass_kg, off_mm, off_kg / payload.mass_error_kg))
        mass, center, errors = np.array(found).T
        within, refused = np.mean((mass < 3) & (center < 5)), given.worlds - len(found)
        print(
            f'{name:>24} {refused:>8} {np.median(mass):>8.2f} {mass.max():>6.2f} '
            f'{np.median(center):>10.2f} {center.max():>6.2f} {within:>8.0%} '
            f'{np.quantile(errors, 0.9):>8.1f} {1e3 * max(took_s):>8.0f}'
        )


if __name__ == '__main__':
    main()
