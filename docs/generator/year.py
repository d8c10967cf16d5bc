"""
Draw docs/year.png: a simulated year of a node that learns by itself, as ``show --picture`` does.

``PYTHONPATH=bench/accuracy python docs/generator/year.py [SEED]`` lives through a year of
``years.py`` and draws it, in some minutes on two processors. Without a seed it is the first year
that ``years.py`` reports of.
"""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path
import sys

from judging import bench_parser, first_seed
from years import live, print_year

from wrist_ft_comp.cli.show import drift_left, summary, when
from wrist_ft_comp.learning.days import Diary
from wrist_ft_comp.report.pictures import days_figure, png
from wrist_ft_comp.series import NANOSECONDS

#: The simulated year begins on this day.
BEGIN_NS = int(datetime(2026, 1, 5, 6, tzinfo=timezone.utc).timestamp()) * NANOSECONDS


def main() -> None:
    """Live through the year, and draw it."""
    options = bench_parser(__doc__, 'years', 1).parse_args([])
    seed = int(sys.argv[1]) if sys.argv[1:] else first_seed(options, 'learning')
    with ProcessPoolExecutor() as pool:
        lived = live(seed, 365, pool)
    print_year(lived)
    days = [replace(day, first_ns=day.first_ns + BEGIN_NS) for day in lived.robot.entries]
    diary = Diary(tuple(days))
    picture = png(days_figure(summary(diary), [when(day) for day in days], drift_left(diary)))
    Path(__file__).parents[1].joinpath('year.png').write_bytes(picture)


if __name__ == '__main__':
    main()
