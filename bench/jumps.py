"""
Days on which a sensor's zero jumps, and ordinary ones with tares: what is named, and what falsely.

``python bench/jumps.py`` draws years (``years_drawn``) as ``years.py`` does, and of each the day
of its crash and some ordinary days, and looks at them as a node does that learns by itself and has
a live model, which leaves a share of the drift. ``--dev`` draws the ones to develop on. A day
takes two seconds of processor time.
"""

import argparse
from concurrent.futures import ProcessPoolExecutor
from functools import partial
import os

os.environ.setdefault('OMP_NUM_THREADS', '1')
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import numpy as np
from worlds import DEVELOPMENT_SEED, report_seed
from years_drawn import Year

from wrist_ft_comp.calibration.learning.day import describe, look_at
from wrist_ft_comp.calibration.learning.incidents import incident, ZERO


def named(seed: int, ordinary: int, left: float) -> list[tuple[int, bool]]:
    """Tell of the crash's day, and of ordinary ones, whether a jump was named."""
    year = Year(seed)
    events = year.events
    special = {events.crash, events.pressed, *range(events.stopped, events.replaced)}
    plain = [number for number in year.worked if number not in special]
    others = np.random.default_rng(seed).choice(plain, ordinary, replace=False).tolist()
    found = []
    for number in (events.crash, *others):
        day = year.day(number)
        looked = look_at(day.recording)
        kind, _ = incident(looked, describe(looked), [], (1 - left) * day.drift)
        found.append((number, kind == ZERO))
    return found


def main() -> None:
    """Look at all days."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('--dev', action='store_true', help='years to develop on')
    parser.add_argument('--years', type=int, default=100)
    parser.add_argument('--ordinary', type=int, default=2, help='ordinary days of a year')
    parser.add_argument('--left', type=float, default=0.2, help='what the live model leaves')
    options = parser.parse_args()
    first = DEVELOPMENT_SEED if options.dev else report_seed()
    seeds = range(first, first + options.years)
    hit = false = 0
    with ProcessPoolExecutor() as pool:
        look = partial(named, ordinary=options.ordinary, left=options.left)
        for seed, (crash, *others) in zip(seeds, pool.map(look, seeds), strict=True):
            hit += crash[1]
            false += sum(was for _, was in others)
            if not crash[1]:
                print(f'year {seed}: the jump of day {crash[0]} was not named')
            for number, was in others:
                if was:
                    print(f'year {seed}: a jump was named on day {number}, which had none')
    print(
        f'{hit} of {options.years} jumps were named, and {false} on '
        f'{options.years * options.ordinary} ordinary days'
    )


if __name__ == '__main__':
    main()
