"""
Simulated years of a node that learns by itself, against a model that somebody learns by hand.

``python bench/accuracy/years.py`` draws years from the last commit that touched how drift is
learnt, as ``worlds.py`` does; ``--dev`` draws the ones to develop on. Every working day of 2.5 h
is recorded in cells of 2 s, and judged as in ``at_work.py``, by what is there without a model in
the mean of the year, mean over axes. Four robots live through the same year: one is never
calibrated, one by a warm-up with an empty flange on the first day, one by another such warm-up
every quarter, added to those before, and one learns by itself (a better model is live on the next
day). Once a year the robot is moved (other sources of heat and another room), its tool is changed,
it crashes (the zero jumps), a thermometer stops and is replaced days later, and on one day it is
in contact nearly all the time. A year takes 5 to 11 min on two processors. docs/accuracy.md has
the figures.

``--incidents`` looks only at the days on which something has to be named, and the two days before
each, as a node does whose live model leaves a share of the drift. A year takes 20 s then.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple

from judging import bench_parser, block_means, first_seed, recording_of, tared_rms
import numpy as np
from thermal_networks import between, Body, draw_day, draw_others, draw_sources, network, SUN
from working_days import draw_imu, measure, SCENARIOS, SECONDS, work
from worlds_drawn import draw_gauges, draw_thermometers, FACTORY_C, read, UNITS

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.drift.drift_model import DriftModel
from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.learning.days import DayEntry, worthiest
from wrist_ft_comp.learning.incidents import Day, describe, incident, look_at
from wrist_ft_comp.learning.model_choice import Champion, take
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import FloatArray, NANOSECONDS
from wrist_ft_comp.stream.drift_of_recordings import simulate_drift

#: Seconds of a thermal cell.
CELL_S = 2
#: Share of the time in contact on a day of wrong contacts.
PRESSED = 0.9
#: The ways of learning, in this order; the first of them never does.
WAYS = ('never', 'once by hand', 'every season by hand', 'learning')
#: An incident has to be named within this many days.
NAMED_DAYS = 2
#: Axes that drift less than this by their largest noise do not count.
_STILL = 1e-9
#: Days that a robot keeps.
_KEPT = 30
#: Days before an incident that are looked at, too.
BEFORE_DAYS = 2
#: What the live model leaves of the drift on the days around an incident.
LEAVES = 0.2


@dataclass(frozen=True, eq=False)
class YearDay:
    """A day as it was recorded, and its true drift (N, 6), N and N m."""

    number: int
    recording: Recording
    drift: FloatArray


@dataclass(frozen=True)
class Events:
    """Numbers of days on which something happens."""

    moved: int
    tool: int
    crash: int
    #: A thermometer stops, and is replaced.
    stopped: int
    replaced: int
    pressed: int

    def named(self) -> dict[str, int]:
        """Days on which something happens that has to be named, by its kind."""
        return {
            'tool': self.tool,
            'zero': self.crash,
            'thermometer': self.stopped,
            'contacts': self.pressed,
        }


class Year:
    """A robot's year; days are drawn one by one, in any order."""

    def __init__(self, seed: int, length: int = 365) -> None:
        rng = np.random.default_rng([seed, 31])
        self._seed = seed
        others = draw_others(rng)
        self._body = network(rng, others)
        self._sources = [draw_sources(rng, others) for _ in range(2)]
        self._neighbour = _moved(rng, self._body)
        self._thermometers = draw_thermometers(rng, self._body, 2, 'network')
        self._gauges = draw_gauges(rng, self._body, 'network')
        self._imu = draw_imu(rng, SCENARIOS['part'])
        #: Days on which the robot works.
        self.worked = [number for number in range(length) if number % 7 < 5]
        self._swing_k, self._phase = between(rng, 3.0, 9.0), rng.uniform(0, 365)
        self._rooms_k = [0.0, float(rng.uniform(-5, 5))]
        self._offset_k = rng.normal(0, 0.3)
        at = rng.choice(np.arange(15, len(self.worked) - 15, 12), 5, replace=False)
        moved, tool, crash, stopped, pressed = (self.worked[i] for i in at)
        replaced = self.worked[int(at[3]) + int(rng.integers(2, 6))]
        self.events = Events(moved, tool, crash, stopped, replaced, pressed)
        self._jump = rng.choice([-1, 1], 6) * UNITS * rng.uniform(3, 12, 6)
        self._silent = bool(rng.random() < 0.5)

    def _warmed(self, number: int) -> tuple[FloatArray, FloatArray]:
        """Temperatures of the nodes (N, n) and of the thermometers (N, J), every second, °C."""
        rng = np.random.default_rng([self._seed, 32, number])
        moved = number >= self.events.moved
        body = self._neighbour if moved else self._body
        night, felt_c = draw_day(rng, body, self._sources[moved], SECONDS)
        season = self._swing_k * np.sin(2 * np.pi * (number - self._phase) / 365)
        shift = season + self._rooms_k[moved]
        seen = read(rng, self._thermometers, night + shift, felt_c + shift)
        if number >= self.events.replaced:
            seen[:, 1] += self._offset_k
        return felt_c + shift, seen

    def day(
        self, number: int, burden: Callable[[FloatArray], FloatArray] | None = None
    ) -> YearDay:
        """Draw a day at work; ``burden`` changes the wrench of every second, N and N m, (N, 6)."""
        events = self.events
        felt_c, seen_c = self._warmed(number)
        rng = np.random.default_rng([self._seed, 33, number])
        warm_k = felt_c[:, self._thermometers.nodes[0]] - FACTORY_C
        tools = 2 * self._seed + (number >= events.tool)
        true = work(rng, SCENARIOS['part'], tools, self._imu, warm_k)
        wrench = true.wrench if burden is None else burden(true.wrench)
        if number == events.pressed:
            pushes = rng.normal(0, 20, (SECONDS // 10, 6)) * [1, 1, 1, 0.1, 0.1, 0.1]
            pushes *= rng.random((len(pushes), 1)) < PRESSED
            wrench = wrench + np.repeat(pushes, 10, axis=0)
        again = [np.random.default_rng([self._seed, 34, number]) for _ in range(2)]
        raw, _ = measure(again[0], self._gauges, felt_c, wrench, 0.25)
        quiet = replace(self._gauges, noise=0 * self._gauges.noise)
        drift, _ = measure(again[1], quiet, felt_c, np.zeros_like(raw), 0.0)
        if number == events.crash:
            raw[int(rng.integers(1800, SECONDS - 1800)) :] += self._jump
        measured = np.ones(seen_c.shape, dtype=bool)
        if events.stopped <= number < events.replaced:
            at = int(rng.integers(600, SECONDS // 2)) if number == events.stopped else 0
            seen_c[at:, 1] = seen_c[at, 1] if at else 24.0
            measured[at:, 1] = not self._silent
        speed = np.sqrt(block_means(true.speed[:, None] ** 2, CELL_S)[:, 0])
        recording = replace(
            _recorded(number, seen_c, raw),
            first_cell=number * 86_400 // CELL_S,
            measured=measured[::CELL_S],
            specific_force=block_means(true.force, CELL_S),
            rotation_speed=speed,
        )
        return YearDay(number, recording, block_means(drift, CELL_S))

    def warm_up(self, number: int) -> Recording:
        """Record a day with an empty flange, as somebody does who calibrates by hand."""
        felt_c, seen_c = self._warmed(number)
        rng = np.random.default_rng([self._seed, 35, number])
        raw, _ = measure(rng, self._gauges, felt_c, np.zeros((SECONDS, len(AXES))), 0.0)
        return _recorded(number, seen_c, raw)


def _recorded(number: int, seen_c: FloatArray, raw: FloatArray) -> Recording:
    """Record temperatures (N, J) and wrenches (N, 6) of every second in cells of CELL_S."""
    recording = recording_of(block_means(seen_c, CELL_S), block_means(raw, CELL_S))
    return replace(recording, name=day_name(number), period_ns=CELL_S * NANOSECONDS)


def day_name(number: int) -> str:
    """Name a day's file."""
    return f'day_{number:03d}.csv'


def _moved(rng: np.random.Generator, body: Body) -> Body:
    """Let other neighbours shine on another node."""
    node, strength = int(rng.integers(body.nodes)), between(rng, 0.3, 1.5)
    size = np.linalg.norm(body.inlets[:, 2])
    inlets = body.inlets.copy()
    shone = body.shapes[node] / np.linalg.norm(body.shapes[node])
    inlets[:, SUN] = strength * size * shone
    return replace(body, inlets=inlets)


@dataclass
class Robot:
    """One that learns by itself, and what a job would have to read for it."""

    champion: Champion = field(default_factory=Champion)
    #: Its diary.
    entries: list[DayEntry] = field(default_factory=list)
    kept: dict[str, Day | None] = field(default_factory=dict)
    #: Days after which a model was adopted.
    adopted: list[int] = field(default_factory=list)

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


class Lived(NamedTuple):
    """A year, its robot, and the mean drift left of every working day, (D, 4), by WAYS."""

    seed: int
    year: Year
    robot: Robot
    left: FloatArray

    def alarms(self) -> tuple[dict[str, int], int]:
        """Say after how many days what happened was named (-1 never), and count false alarms."""
        named, true = {}, set()
        events, days = self.year.events, self.year.worked
        for kind, number in events.named().items():
            end = events.replaced if kind == 'thermometer' else number
            window = [n for n, day in enumerate(days) if number <= day][: NAMED_DAYS + 1]
            window = sorted({*window, *(n for n, day in enumerate(days) if number <= day < end)})
            at = [n for n in window if self.robot.entries[n].kind == kind]
            true |= set(at)
            named[kind] = at[0] - window[0] if at and at[0] - window[0] < NAMED_DAYS else -1
        alarms = {n for n, entry in enumerate(self.robot.entries) if entry.kind}
        return named, len(alarms - true)


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
    with suppress(CalibrationRefusedError):
        return calibrate(recordings).model
    return None


def live(seed: int, length: int, pool: Executor) -> Lived:
    """Live through a year; days to come are drawn and looked at in other processes."""
    year, robot = Year(seed, length), Robot()
    quarters = [next(n for n in year.worked if n >= length * q // 4) for q in range(4)]
    warm_ups: list[Recording] = []
    once, seasons, rows = None, None, []
    ahead = pool.map(partial(ended, year), year.worked)
    for number, (day, looked) in zip(year.worked, ahead, strict=True):
        if number in quarters:
            warm_ups.append(year.warm_up(number))
            seasons = by_hand(warm_ups)
            once = seasons if number == quarters[0] else once
        models = (None, once, seasons, robot.champion.model)
        rows.append([left_of(model, day) for model in models])
        robot.end(number, looked)
    figures = np.array(rows)
    usual = figures[:, 0].mean(axis=0)
    drifts = usual > _STILL
    return Lived(seed, year, robot, np.mean((figures / usual)[:, :, drifts], axis=2))


def print_left(title: str, left: FloatArray) -> None:
    """Print the means of rows, shape (D, 4), by way of learning."""
    means = zip(WAYS[1:], left.mean(axis=0)[1:], strict=True)
    print(f'\n{title}: drift left ' + ', '.join(f'{way} {mean:.3f}' for way, mean in means))


def print_year(lived: Lived) -> None:
    """Print a year in some lines."""
    named, false = lived.alarms()
    print_left(f'year {lived.seed}', lived.left)
    print('  named after days: ' + ', '.join(f'{kind} {n}' for kind, n in named.items()))
    for entry in lived.robot.entries:
        if entry.kind:
            print(f'    {entry.name}: {entry.incident}')
    learnt = sum(entry.challenged for entry in lived.robot.entries)
    adopted = lived.robot.adopted
    print(f'  {false} false alarms; {learnt} models learnt, live after days {adopted}', flush=True)


def print_all(years: Sequence[Lived]) -> None:
    """Sum all years up."""
    alarms = [year.alarms() for year in years]
    missed = sum(n < 0 for named, _ in alarms for n in named.values())
    print_left(f'{len(years)} years', np.stack([year.left.mean(axis=0) for year in years]))
    print(
        f'  {missed} incidents were not named in {NAMED_DAYS} days; '
        f'{sum(false for _, false in alarms)} false alarms'
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
    parser.add_argument('--length', type=int, default=365, help='days of a year, at least 130')
    parser.add_argument('--incidents', action='store_true', help='look at incidents only')
    options = parser.parse_args()
    first = first_seed(options, 'learning')
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
