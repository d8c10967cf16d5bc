"""
Creep and hysteresis: from which size on they are named, and how often heat is taken for them.

``python bench/faults/creep.py`` draws years at work from the last commit that touched how drift is
learnt, ``--dev`` those to develop on. A model is learnt from three days. On each of the days that
follow, the robot presses once with 50 N for half an hour: grinding, which leaves the part for some
seconds every minute, or holding without a break; on every fourth day it only works, with contacts
in 15 % of the time. The same days are judged with sensors that creep by 0 to 0.5 % of the load, or
keep a share of an overload of 300 N. Creep is drawn by the simulated sensor's own equations,
and added behind the separation, which it does not change: a day is separated once.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
import sys
from typing import NamedTuple

sys.path.append(str(Path(__file__).resolve().parents[1] / 'accuracy'))

from judging import bench_parser, block_means, first_seed
import numpy as np
from years_drawn import CELL_S, Year

from wrist_ft_comp.drift.drift_model import DriftModel
from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.settings import CalibrationSettings
from wrist_ft_comp.learning.creep import shares
from wrist_ft_comp.learning.day import Day, describe, look_at
from wrist_ft_comp.learning.diary import CREEP, DayEntry
from wrist_ft_comp.learning.incidents import incident
from wrist_ft_comp.signals import FloatArray, Recording
from wrist_ft_comp.simulation.ft_sensor import no_memory, strained
from wrist_ft_comp.simulation.heat_flow import FtSensorSettings

#: Creep of a load of 30 min, as a share of it, and its time constant, s.
SIZES = (0.0, 0.0005, 0.001, 0.002, 0.005)
CONSTANT_S = 1080.0
#: Creep on days from which models are learnt.
HARMFUL = (0.001, 0.005)
#: Hysteresis, as a share of what the overload has beyond the play.
KEPT = (0.002, 0.005, 0.01)
#: Load, N, and its duration, s.
LOAD_N, LOAD_S = 50.0, 1800
#: An overload, N, and its duration, s.
OVERLOAD_N, OVERLOAD_S = 300.0, 4
#: Days from which a model is learnt; they and all others are before a year's first event.
LEARNT = 3
KINDS = ('grinding', 'holding', 'grinding', 'ordinary')


@dataclass(frozen=True, eq=False)
class Loaded:
    """A day that was separated, without creep, and the load of its cells, N and N m, (N, 6)."""

    kind: str
    day: Day
    load: FloatArray


class Finding(NamedTuple):
    """What was named on a day."""

    load: str
    #: Of the incident, and its sentence.
    kind: str
    sentence: str
    #: Largest share of the load in units of its standard error, by this day alone.
    sigmas: float


def pressed(rng: np.random.Generator, kind: str, wrench: FloatArray) -> FloatArray:
    """Press with LOAD_N for LOAD_S, mostly along the tool, on top of a wrench (N, 6)."""
    on = np.zeros(len(wrench))
    begin = int(rng.integers(1800, len(wrench) - LOAD_S - 2400))
    direction = rng.normal(0, 0.4, 3) - [0, 0, 1]
    force = LOAD_N * direction / np.linalg.norm(direction)
    at_m = np.array([*rng.normal(0, 0.03, 2), rng.uniform(0.08, 0.2)])
    on[begin : begin + LOAD_S] = kind != 'ordinary'
    at = begin
    while kind == 'grinding' and at < begin + LOAD_S:
        at += int(rng.integers(20, 61))
        pause = int(rng.integers(3, 9))
        on[at : at + pause] = 0.0
        at += pause
    return np.asarray(wrench + on[:, None] * np.concatenate((force, np.cross(at_m, force))))


def drawn(year: Year, seed: int, number: int, kind: str) -> Loaded:
    """Draw and separate a day with a load."""
    loads = []

    def burden(wrench: FloatArray) -> FloatArray:
        loads.append(pressed(np.random.default_rng([seed, 36, number]), kind, wrench))
        return loads[-1]

    recording = year.day(number, burden).recording
    return Loaded(kind, look_at(recording), block_means(loads[0], CELL_S))


def crept(loaded: Loaded, settings: FtSensorSettings) -> Day:
    """Let a sensor creep on a day that was separated."""
    day = loaded.day
    shown, _ = strained(settings, no_memory(), loaded.load, CELL_S)
    more = shown - loaded.load

    def with_more(recording: Recording) -> Recording:
        return replace(recording, wrench=recording.wrench + more)

    return replace(day, recording=with_more(day.recording), drift=with_more(day.drift))


def overloaded(loaded: Loaded) -> Loaded:
    """Let the robot crash in the middle of a day."""
    cells = slice(len(loaded.load) // 2, len(loaded.load) // 2 + OVERLOAD_S // CELL_S)
    load, raw, free = (
        values.copy()
        for values in (loaded.load, loaded.day.recording.wrench, loaded.day.drift.wrench)
    )
    for values in (load, raw):
        values[cells, 2] -= OVERLOAD_N
    free[cells] = np.nan
    day = replace(
        loaded.day,
        recording=replace(loaded.day.recording, wrench=raw),
        drift=replace(loaded.day.drift, wrench=free),
    )
    return Loaded('overload', day, load)


def found(
    days: Sequence[Loaded], model: DriftModel, settings: FtSensorSettings
) -> Iterator[Finding]:
    """Judge days, one after the other, as lessons do."""
    before: list[DayEntry] = []
    for loaded in days:
        day = crept(loaded, settings)
        simulated = day.simulate(model)
        entry = replace(describe(day), creep=shares(day, simulated))
        kind, sentence = incident(day, entry, before, simulated.zero)
        before.append(replace(entry, kind=kind, incident=sentence))
        sigmas = max((abs(share / error) for share, error in entry.creep), default=0.0)
        yield Finding(loaded.kind, kind, sentence, sigmas)


def learnt(days: Sequence[Day]) -> DriftModel:
    """Learn a model as a lesson does."""
    settings = CalibrationSettings(reference='recorded')
    return calibrate([day.drift for day in days], settings).model


def left_of(model: DriftModel, days: Sequence[Loaded]) -> FloatArray:
    """Compute the RMS of what a model leaves of days without creep, less its mean, (6,)."""
    errors = []
    for loaded in days:
        drift, simulated = loaded.day.drift, loaded.day.simulate(model)
        left = drift.wrench - simulated.zero - (1 + simulated.sensitivity) * drift.reference
        errors.append(np.nanstd(left, axis=0))
    return np.asarray(np.nanmean(errors, axis=0))


def print_findings(named: Mapping[tuple[str, float], Sequence[Sequence[Finding]]]) -> None:
    """Print how often creep was named: by days, and by sensors after some days."""
    after = 1, 2, 4, 7
    print(f'{"":15}{"size":>8}{"days":>6}{"named":>7}{"sigmas":>8}{"tenth":>7}'
          f'{"sensors":>9}' + ''.join(f'{f"in {count}":>6}' for count in after))  # fmt: skip
    for (title, size), sensors in named.items():
        days = [finding for findings in sensors for finding in findings]
        hits = [[finding.kind == CREEP for finding in findings] for findings in sensors]
        sigmas = [finding.sigmas for finding in days if finding.load != 'ordinary']
        print(f'{title:15}{size:8.2%}{len(days):6}{sum(map(sum, hits)):7}{np.median(sigmas):8.1f}'
              f'{np.quantile(sigmas, 0.1):7.1f}{len(sensors):9}'
              + ''.join(f'{sum(any(hit[:n]) for hit in hits):6}' for n in after))  # fmt: skip


def main() -> None:
    """Judge days with and without creep, and learn from them."""
    parser = bench_parser(__doc__, 'years', 3)
    parser.add_argument('--days', type=int, default=7, help='per year')
    options = parser.parse_args()
    first = first_seed(options, 'learning')
    named = defaultdict[tuple[str, float], list[list[Finding]]](list)
    harm = defaultdict[float, list[float]](list)
    for seed in range(first, first + options.years):
        year = Year(seed)
        try:
            model = learnt([look_at(year.day(n).recording) for n in year.worked[:LEARNT]])
            numbers = year.worked[LEARNT : LEARNT + options.days]
            days = [drawn(year, seed, n, KINDS[i % 4]) for i, n in enumerate(numbers)]
        except WristFtCompError as error:
            print(f'year {seed}: {error}')
            continue
        for size in SIZES:
            settings = FtSensorSettings(creep=size, creep_s=CONSTANT_S)
            findings = list(found(days, model, settings))
            named['creep' if size else 'heat alone', size].append(findings)
            for finding in findings:
                if finding.kind and not (finding.kind == CREEP and size):
                    print(f'year {seed}, creep {size:.2%}, {finding}', flush=True)
        for size in KEPT:
            settings = FtSensorSettings(hysteresis=size)
            named['what stays', size].append(list(found([overloaded(days[-1])], model, settings)))
        plain = left_of(learnt([loaded.day for loaded in days[:LEARNT]]), days[LEARNT:])
        for size in HARMFUL:
            settings = FtSensorSettings(creep=size)
            other = learnt([crept(loaded, settings) for loaded in days[:LEARNT]])
            ratios = left_of(other, days[LEARNT:]) / plain
            harm[size].append(float(np.exp(np.nanmean(np.log(ratios)))))
        print(f'year {seed} is done', flush=True)
    print_findings(named)
    for size, times in harm.items():
        print(f'learnt from days with creep of {size:.2%}: drift left is {np.median(times):.3f} '
              f'times that without (median), {max(times):.3f} at most')  # fmt: skip


if __name__ == '__main__':
    main()
