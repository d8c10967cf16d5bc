"""
Simulated years of a node that learns by itself, against a model that somebody learns by hand.

``python bench/accuracy/years.py`` draws years (``years_drawn``) from the last commit that touched
how drift is learnt, as ``worlds.py`` does; ``--dev`` draws the ones to develop on. Every working
day of 2.5 h is recorded in cells of 2 s, and judged on its true drift, tared in its first minute,
over means of ten seconds: root mean square left of each axis, by what is there without a model in
the mean of the year, mean over axes. Four robots live through the same year: one is never
calibrated, one by a warm-up with an empty flange on the first day, one by another such warm-up
every quarter, added to those before, and one learns by itself (``auto``: a better model is live on
the next day). On every day, the last is compared with the best of the models that were live in the
week before.

A year takes 5 to 11 min on two processors: days to come are drawn and looked at ahead.
docs/accuracy.md has the figures.

``--incidents`` looks at the days only on which another tool is mounted, the zero jumps, a
thermometer stops, or something pushes on the sensor nearly all day, and the two days before each,
as a node does whose live model leaves a share of the drift; which of them is named within two
days, and what falsely. A year takes 20 s then.
"""

from collections import Counter
from collections.abc import Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial

from judging import bench_parser, first_seed, tared_rms
import numpy as np
from years_drawn import CELL_S, day_name, Events, Year, YearDay

from wrist_ft_comp.drift.drift_model import DriftModel
from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.learning.days_learnt_from import worthiest
from wrist_ft_comp.learning.diary import DayEntry
from wrist_ft_comp.learning.incidents import incident
from wrist_ft_comp.learning.model_choice import Champion, take
from wrist_ft_comp.learning.separated_day import Day, describe, look_at
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import FloatArray
from wrist_ft_comp.stream.offline import simulate_drift

NEVER, ONCE, SEASONS, LEARNING, BEFORE = range(5)
TITLES = ('never', 'once by hand', 'every season by hand', 'learning', 'the week before')
#: An incident has to be named within this many days.
NAMED_DAYS = 2
#: A day is worse than the best model of the week before by more than this, as a share of the
#: uncompensated drift: such days are counted.
WORSE = 0.2
#: Axes that drift less than this by their largest noise do not count.
_STILL = 1e-9
#: Days that a robot keeps.
_KEPT = 30
#: Days of a week.
_WEEK = 7
#: Days before an incident that are looked at, too.
BEFORE_DAYS = 2
#: What the live model leaves of the drift on the days around an incident.
LEAVES = 0.2


@dataclass(frozen=True, eq=False)
class Lived:
    """
    A year.

    Attributes
    ----------
    days : ndarray, shape (D,)
        Numbers of the working days.
    left : ndarray, shape (D, 5)
        Drift left of every day, by way of learning; of the last, that of the best of the models
        that were learnt by itself and live in the week before.
    entries : list of DayEntry
        The diary.
    adopted : list of int
        Days after which a model was adopted.

    """

    seed: int
    events: Events
    days: FloatArray
    left: FloatArray
    entries: list[DayEntry]
    adopted: list[int]

    def alarms(self) -> tuple[dict[str, int], int]:
        """Say after how many days what happened was named (-1 never), and count false alarms."""
        named, true = {}, set()
        days = self.days.astype(int).tolist()
        for kind, number in self.events.named().items():
            end = self.events.replaced if kind == 'thermometer' else number
            window = [n for n, day in enumerate(days) if number <= day][: NAMED_DAYS + 1]
            window = sorted({*window, *(n for n, day in enumerate(days) if number <= day < end)})
            at = [n for n in window if self.entries[n].kind == kind]
            true |= set(at)
            named[kind] = at[0] - window[0] if at and at[0] - window[0] < NAMED_DAYS else -1
        alarms = {n for n, entry in enumerate(self.entries) if entry.kind}
        return named, len(alarms - true)

    def worse(self) -> FloatArray:
        """By how much more was left than the week's best leaves, of a usual day's drift, (D,)."""
        near = np.zeros(len(self.days), dtype=bool)
        for kind, number in {'moved': self.events.moved, **self.events.named()}.items():
            end = self.events.replaced if kind == 'thermometer' else number
            first, last = np.searchsorted(self.days, (number, end))
            near[first : last + NAMED_DAYS + 1] = True
        return np.where(near, 0.0, self.left[:, LEARNING] - self.left[:, BEFORE])


@dataclass
class Robot:
    """One that learns by itself, and what a job would have to read for it."""

    champion: Champion = field(default_factory=Champion)
    #: Numbers of days, and the models that were live on them.
    lived: list[tuple[int, DriftModel | None]] = field(default_factory=list)
    entries: list[DayEntry] = field(default_factory=list)
    kept: dict[str, Day | None] = field(default_factory=dict)
    adopted: list[int] = field(default_factory=list)

    def week(self, number: int) -> list[DriftModel | None]:
        """List the models that were live on days of the week before a day, and on that day."""
        self.lived.append((number, self.champion.model))
        return list(dict.fromkeys(model for day, model in self.lived if day >= number - _WEEK))

    def end(self, number: int, looked: Day | None) -> None:
        """Learn from a day that has ended, and was looked at."""
        name = day_name(number)
        self.kept[name] = looked

        def look(asked: str) -> Day:
            """Give a day that could be separated."""
            day = self.kept[asked]
            if day is None:
                raise CalibrationRefusedError(f'{asked} cannot be separated.')
            return day

        choice = take(name, look, self.entries, self.champion, list(self.kept))
        self.entries.append(choice.entry)
        worthy = worthiest([entry for entry in self.entries if entry.name in self.kept], _KEPT)
        self.kept = {entry.name: self.kept[entry.name] for entry in worthy}
        if choice.better is not None:
            self.champion = Champion(f'after {name}', choice.better.model, name)
            self.adopted.append(number)


def left_of(model: DriftModel | None, day: YearDay) -> FloatArray:
    """RMS of what is left of the true drift, tared, (6,)."""
    rest = day.drift - (simulate_drift(model, day.recording).zero if model else 0.0)
    return tared_rms(rest, CELL_S)


def ended(year: Year, number: int) -> tuple[YearDay, Day | None]:
    """Draw a day and look at it; None where that cannot be."""
    day = year.day(number)
    with suppress(CalibrationRefusedError):
        return day, look_at(day.recording)
    return day, None


def by_hand(recordings: Sequence[Recording]) -> DriftModel | None:
    """Calibrate as somebody does who has these warm-ups; None where they are refused."""
    try:
        return calibrate(recordings).model
    except CalibrationRefusedError:
        return None


def live(seed: int, length: int, pool: Executor) -> Lived:
    """Live through a year; days to come are drawn and looked at in other processes."""
    year, robot = Year(seed, length), Robot()
    quarters = [next(n for n in year.worked if n >= length * q // 4) for q in range(4)]
    warm_ups: list[Recording] = []
    once, seasons = None, None
    rows, weeks = [], []
    ahead = pool.map(partial(ended, year), year.worked)
    for number, (day, looked) in zip(year.worked, ahead, strict=True):
        if number in quarters:
            warm_ups.append(year.warm_up(number))
            seasons = by_hand(warm_ups)
            once = seasons if number == quarters[0] else once
        models = (None, once, seasons, robot.champion.model)
        rows.append([left_of(model, day) for model in models])
        weeks.append([left_of(model, day) for model in robot.week(number)])
        robot.end(number, looked)
    figures = np.array(rows)
    usual = figures[:, NEVER].mean(axis=0)
    drifts = usual > _STILL
    left = np.mean((figures / usual)[:, :, drifts], axis=2)
    best = [min(np.mean((model / usual)[drifts]) for model in week) for week in weeks]
    left = np.column_stack((left, best))
    days = np.array(year.worked, dtype=float)
    return Lived(seed, year.events, days, left, robot.entries, robot.adopted)


def means_of(left: FloatArray) -> str:
    """Write the means of days, shape (D, 5), by way of learning."""
    means = left.mean(axis=0)
    return ', '.join(f'{TITLES[way]} {means[way]:.3f}' for way in (ONCE, SEASONS, LEARNING))


def print_year(year: Lived) -> None:
    """Print a year in some lines."""
    named, false = year.alarms()
    print(f'\nyear {year.seed}: drift left {means_of(year.left)}')
    print('  named after days: ' + ', '.join(f'{kind} {n}' for kind, n in named.items()))
    for entry in year.entries:
        if entry.kind:
            print(f'    {entry.name}: {entry.incident}')
    learnt = sum(entry.challenged for entry in year.entries)
    print(
        f'  {false} false alarms; {learnt} models learnt, live after days {year.adopted}; at '
        f'worst {year.worse().max():.2f} of a usual day more than the best of the week before',
        flush=True,
    )


def print_all(years: Sequence[Lived]) -> None:
    """Sum all years up."""
    alarms = [year.alarms() for year in years]
    missed = sum(n < 0 for named, _ in alarms for n in named.values())
    worse = np.concatenate([year.worse() for year in years])
    means = means_of(np.stack([year.left.mean(axis=0) for year in years]))
    print(f'\n{len(years)} years: drift left {means}')
    print(
        f'  {missed} incidents were not named in two days; {sum(false for _, false in alarms)} '
        f'false alarms; {(worse > WORSE).sum()} of {len(worse)} days are worse by more than '
        f'{WORSE:g} of a usual day, the worst by {worse.max():.2f}'
    )


def name_incidents(seed: int) -> tuple[dict[str, bool], list[str]]:
    """Tell which of a year's incidents were named, and what was named on days before."""
    year = Year(seed)
    named, false = {}, []
    for kind, number in year.events.named().items():
        at = year.worked.index(number)
        entries: list[DayEntry] = []
        named[kind] = False
        for worked in year.worked[at - BEFORE_DAYS : at + NAMED_DAYS]:
            day = year.day(worked)
            looked = look_at(day.recording)
            entry = describe(looked)
            found, what = incident(looked, entry, entries, (1 - LEAVES) * day.drift)
            entries.append(replace(entry, kind=found, incident=what))
            if worked < number and found:
                false.append(f'day {worked}: {what}')
            if worked >= number and found == kind:
                named[kind] = True
                break
    return named, false


def print_incidents(seeds: range, pool: Executor) -> None:
    """Print what was not named, what falsely, and how often."""
    hits, alarms = Counter[str](), 0
    named: dict[str, bool] = {}
    for seed, (named, false) in zip(seeds, pool.map(name_incidents, seeds), strict=True):
        hits.update(kind for kind, was_named in named.items() if was_named)
        alarms += len(false)
        missed = [f'{kind} was not named' for kind, was_named in named.items() if not was_named]
        for sentence in (*missed, *false):
            print(f'year {seed}, {sentence}', flush=True)
    for kind in named:
        print(f'{kind:12} {hits[kind]} of {len(seeds)} named within {NAMED_DAYS} days')
    ordinary = BEFORE_DAYS * len(named) * len(seeds)
    print(f'{alarms} false alarms on {ordinary} ordinary days')


def main() -> None:
    """Live through all years."""
    parser = bench_parser(__doc__, 'years', 2)
    parser.add_argument('--first', type=int, help='seed of the first year')
    parser.add_argument('--length', type=int, default=365, help='days of a year, at least 130')
    parser.add_argument('--incidents', action='store_true', help='look at incidents only')
    options = parser.parse_args()
    first = options.first or first_seed(options, 'learning')
    seeds, years = range(first, first + options.years), []
    with ProcessPoolExecutor() as pool:
        if options.incidents:
            print_incidents(seeds, pool)
            return
        for seed in seeds:
            years.append(live(seed, options.length, pool))
            print_year(years[-1])
    print_all(years)


if __name__ == '__main__':
    main()
