"""
What to doubt of days at work, in sentences with numbers; and six wrong inputs to try them on.

``python bench/payload_doubts.py`` spoils one tool's days at work in six ways, learns from them as
``at_work.py`` does, and prints what is said and what is left of the drift of an empty next day,
beside what an empty flange's days leave. Nothing may be wrong without a word. In one world (seed
1003, empty flange 0.017, nothing wrong 0.018) all were named. A wrong sign and swapped axes left
0.018 and told no payload; frozen left 0.024, half without TF 0.098, another tool 0.020, each with
payloads within 0.3 %; clocks 5 s apart left 0.407 of the drift, were named with their 5 s, and
told no payload; the gravity of another frame was refused.
"""

import argparse
from collections.abc import Callable
from dataclasses import replace
import os

os.environ.setdefault('OMP_NUM_THREADS', '1')
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

from at_work import at_work, left_of, recording_of
import numpy as np
from working_days import weight_of, WorkDay, Working, working
from worlds import DEVELOPMENT_SEED

from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.signals import FloatArray


def spoiled(world: Working, other: Working) -> dict[str, list[WorkDay]]:
    """Spoil days at work in six ways."""

    def forces(change: Callable[[int, FloatArray], FloatArray]) -> list[WorkDay]:
        return [replace(d, force=change(n, d.force.copy())) for n, d in enumerate(world.days)]

    def stuck(_: int, force: FloatArray) -> FloatArray:
        force[3000:] = force[3000]
        return force

    def half(_: int, force: FloatArray) -> FloatArray:
        force[: len(force) // 2] = np.nan
        return force

    changed = []
    for n, day in enumerate(world.days):
        gravity = world.rotation.apply(day.force)
        extra = weight_of(1.2, np.array([0.01, 0.02, 0.08]), gravity)
        extra *= n > 1 or (n == 1) * (np.arange(len(extra)) > len(extra) // 2)[:, None]
        changed.append(replace(day, wrench=day.wrench + extra))
    return {
        'nothing wrong': world.days,
        'sign of the IMU': forces(lambda _, f: -f),
        'swapped axes': forces(lambda _, f: f[:, [1, 0, 2]]),
        'wrong frame': forces(lambda n, _: other.days[n].force),
        'frozen IMU': forces(stuck),
        'half without TF': forces(half),
        'tool change': changed,
        'clocks 5 s apart': forces(lambda _, f: np.roll(f, -5, axis=0)),
    }


def main() -> None:
    """Spoil days of some worlds."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('--seeds', type=int, nargs='*', default=[DEVELOPMENT_SEED + 3])
    for seed in parser.parse_args().seeds:
        world, other = working('tool', seed), working('tool', seed + 500)
        judged = recording_of(*world.judged)
        empty = left_of(calibrate([recording_of(*each) for each in world.empty]), judged)
        print(f'world {seed}: an empty flange leaves {np.median(empty):.3f}')
        for title, days in spoiled(world, other).items():
            try:
                calibration = at_work(days)
            except CalibrationRefusedError as refusal:
                print(f'\n{title}: refused\n  {refusal}', flush=True)
                continue
            left, told = left_of(calibration, judged), calibration.payloads
            masses = [payload.mass_kg for payload in told.payloads.values()] if told else []
            said = ', '.join(f'{mass:.3f} kg' for mass in masses) or 'no payload told'
            print(f'\n{title}: leaves {np.median(left):.3f}; {said}', flush=True)
            for sentence in calibration.warnings:
                print(f'  {sentence}', flush=True)


if __name__ == '__main__':
    main()
