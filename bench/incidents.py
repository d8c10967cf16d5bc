"""
What happens to a sensor in a year: which of it is named within two days, and what falsely.

``python bench/incidents.py`` draws years (``years_drawn``) as ``years.py`` does, and of each the
days on which another tool is mounted, the zero jumps, a thermometer stops, or something pushes on
the sensor nearly all day, with the two days before. They are looked at as by a node that learns by
itself, with a live model that leaves a share of the drift. ``--dev`` draws the years to develop
on. A year takes 20 s of processor time.

Seen on 24 years that nobody had tuned on: 94 of 96 named, all but two jumps of the zero (one
behind a press in which the driver tared, too); no false alarm on 192 ordinary days. On 64 more, by
rules before: 254 of 256, and none on 512.
"""

import argparse
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
import os

os.environ.setdefault('OMP_NUM_THREADS', '1')
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

from worlds import DEVELOPMENT_SEED, report_seed
from years_drawn import Year

from wrist_ft_comp.learning.day import describe, look_at
from wrist_ft_comp.learning.diary import DayEntry
from wrist_ft_comp.learning.incidents import incident

#: Days before that are looked at, and days within which something has to be named.
BEFORE, WITHIN = 2, 2


def live(seed: int, left: float) -> tuple[dict[str, bool], list[str]]:
    """Tell of a year's events whether they were named, and what was named on days before."""
    year = Year(seed)
    named, false = {}, []
    for kind, number in year.events.named().items():
        at = year.worked.index(number)
        before: list[DayEntry] = []
        named[kind] = False
        for each in year.worked[at - BEFORE : at + WITHIN]:
            day = year.day(each)
            looked = look_at(day.recording)
            entry = describe(looked)
            found, what = incident(looked, entry, before, (1 - left) * day.drift)
            before.append(replace(entry, kind=found, incident=what))
            if each < number and found:
                false.append(f'day {each}: {what}')
            if each >= number and found == kind:
                named[kind] = True
                break
    return named, false


def main() -> None:
    """Live through all years' events."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('--dev', action='store_true', help='years to develop on')
    parser.add_argument('--years', type=int, default=40)
    parser.add_argument('--left', type=float, default=0.2, help='what the live model leaves')
    options = parser.parse_args()
    first = DEVELOPMENT_SEED if options.dev else report_seed()
    seeds = range(first, first + options.years)
    hits, alarms = Counter[str](), 0
    with ProcessPoolExecutor() as pool:
        years = pool.map(partial(live, left=options.left), seeds)
        for seed, (named, false) in zip(seeds, years, strict=True):
            hits.update(kind for kind, was in named.items() if was)
            alarms += len(false)
            missed = [f'{kind} was not named' for kind, was in named.items() if not was]
            for sentence in (*missed, *false):
                print(f'year {seed}, {sentence}', flush=True)
    for kind in named:
        print(f'{kind:12} {hits[kind]} of {options.years} named within {WITHIN} days')
    ordinary = BEFORE * len(named) * options.years
    print(f'{alarms} false alarms on {ordinary} ordinary days')


if __name__ == '__main__':
    main()
