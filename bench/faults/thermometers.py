"""
Thermometers that die or freeze: what is left of the drift.

``python bench/faults/thermometers.py`` draws thermal networks with 2, 3 and 4 thermometers from
the last commit that touched how drift is learnt, ``--dev`` those to develop on. A model is learnt
from three days; on the fourth, one thermometer dies or freezes between 30 and 90 min after the
start. What is left of its drift is compared with what a model leaves that was learnt without that
thermometer. Healthy days are counted on which a thermometer was replaced.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
import sys
import time

sys.path.append(str(Path(__file__).resolve().parents[1] / 'accuracy'))

from judging import bench_parser, first_seed
import numpy as np
from worlds import Answer, by_nothing, rms_left
from worlds_drawn import FAMILIES, Family, family, World

from wrist_ft_comp.drift.drift_model import DriftModel
from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.settings import CalibrationSettings, IdentificationSettings
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import FloatArray
from wrist_ft_comp.stream.drift_of_recordings import judge, simulate_drift
from wrist_ft_comp.stream.gaps_and_restarts import reporting_cells

COUNTS = (2, 3, 4)
FAMILIES |= {f'lying_{count}': Family('failing thermometers', count, 3) for count in COUNTS}
FAULTS = ('dead', 'frozen')
#: An axis that drifts by less says nothing, N or N m.
LEAST_DRIFT = np.array([0.05, 0.05, 0.05, 0.0025, 0.0025, 0.0025])
#: On healthy days the drift does not matter, only how thermometers predict each other.
QUICKEST = CalibrationSettings(
    reference='recorded', identification=IdentificationSettings(method='pls')
)
#: A fault is due to be found where the others have moved by this since it began, K.
DUE_K = 3.0


@dataclass(frozen=True)
class Outcome:
    """A day with a fault: mean share left, now, without a check, and without that thermometer."""

    fault: str
    left: float
    believed: float
    without: float
    #: Minutes after it was due when it was found; inf where it was not, NaN where it was not due.
    late_min: float
    #: Whether another one was replaced.
    wrong: bool


def drawn(seeds: Sequence[int], count: int) -> Iterator[tuple[int, World]]:
    """Draw worlds; bodies with fewer parts than thermometers are left out."""
    for seed in seeds:
        with suppress(ValueError):
            yield seed, family(f'lying_{count}', seed)


def without(recording: Recording, j: int) -> Recording:
    """Take a thermometer out."""
    temperature_c = np.delete(recording.temperature_c, j, axis=1)
    measured = np.delete(recording.measured, j, axis=1)
    return replace(recording, temperature_c=temperature_c, measured=measured)


def failing(day: Recording, fault: str, j: int, begin: int) -> Recording:
    """Let a thermometer die or freeze in a cell."""
    temperature_c, measured = day.temperature_c.copy(), day.measured.copy()
    temperature_c[begin:, j] = temperature_c[begin, j]
    measured[begin + 1 :, j] = fault == 'frozen'
    return replace(day, temperature_c=temperature_c, measured=measured)


def watch(model: DriftModel, day: Recording) -> dict[int, float]:
    """Find which thermometers are replaced, and after how many minutes first."""
    found = dict[int, float]()
    cells = reporting_cells(day.measured, day.period_ns).tolist()
    for cell, state in zip(cells, judge(model, day.temperature_c, day.measured), strict=False):
        for j in np.flatnonzero(state.replaced).tolist():
            found.setdefault(j, cell * day.period_s / 60)
    return found


def due_min(day: Recording, j: int, begin: int) -> float:
    """Find the minute in which another thermometer has moved by DUE_K; inf where none does."""
    others = np.delete(day.temperature_c[begin:], j, axis=1)
    moved_k = np.maximum.accumulate(others) - np.minimum.accumulate(others)
    cells = np.flatnonzero(moved_k.max(axis=1) > DUE_K)
    return (begin + int(cells[0])) * day.period_s / 60 if len(cells) else np.inf


def judge_world(seed: int, world: World) -> list[Outcome]:
    """Learn with and without a thermometer, and let it fail."""
    rng = np.random.default_rng([seed, world.judge.thermometers])
    j = int(rng.integers(world.judge.thermometers))
    settings = CalibrationSettings(reference=world.reference)
    model = calibrate(world.learn, settings).model
    reserve = calibrate([without(day, j) for day in world.learn], settings).model
    raw = rms_left(world, by_nothing(world))
    drifting = raw > LEAST_DRIFT

    def share(drift: FloatArray) -> float:
        errors = rms_left(world, Answer(drift))
        return float((errors / raw)[drifting].mean()) if drifting.any() else np.nan

    alone = share(simulate_drift(reserve, without(world.judge, j)).zero)
    begin, outcomes = int(rng.integers(1800, 5400)), []
    for fault in FAULTS:
        day = failing(world.judge, fault, j, begin)
        now = share(simulate_drift(model, day).zero)
        believed = share(simulate_drift(replace(model, prediction=None), day).zero)
        found, due = watch(model, day), due_min(day, j, begin)
        minute = found.pop(j, np.inf)
        late = minute - due if np.isfinite(due) else np.nan
        outcomes.append(Outcome(fault, now, believed, alone, late, bool(found)))
    return outcomes


def print_faults(outcomes: Sequence[Outcome]) -> None:
    """Print a line for every fault, of the days on which it was due to be found."""
    titles = ('days', 'left', 'believed', 'without', 'ratio', 'in 10 min', 'late, min', 'wrong')
    print(f'{"":12}' + ''.join(f'{title:>11}' for title in titles))
    for fault in FAULTS:
        days = [day for day in outcomes if day.fault == fault and not np.isnan(day.late_min)]
        left, believed, alone = (
            float(np.nanmean([getattr(day, name) for day in days]))
            for name in ('left', 'believed', 'without')
        )
        late, wrong = np.array([day.late_min for day in days]), sum(day.wrong for day in days)
        print(
            f'{fault:12}{len(days):11}{left:11.3f}{believed:11.3f}{alone:11.3f}'
            f'{left / alone:11.2f}{np.sum(late <= 10):11}{np.median(late):11.1f}{wrong:11}'
        )


def main() -> None:
    """Judge faults, then count healthy days."""
    parser = bench_parser(__doc__, 'worlds', 20)
    parser.add_argument('--healthy', type=int, default=70, help='days per number of thermometers')
    options = parser.parse_args()
    first = first_seed(options)
    for count in COUNTS if options.worlds else ():
        worlds = drawn(range(first, first + options.worlds), count)
        print(f'\n{count} thermometers')
        print_faults([outcome for seed, world in worlds for outcome in judge_world(seed, world)])
    days, alarms, seconds = 0, 0, []
    for count in COUNTS:
        for _, world in drawn(range(first, first + options.healthy), count):
            model, begun = calibrate(world.learn, QUICKEST).model, time.process_time()
            days, alarms = days + 1, alarms + bool(watch(model, world.judge))
            seconds.append((time.process_time() - begun) / len(world.judge))
    if days:
        print(f'\n{days} healthy days: on {alarms} a thermometer was replaced; '
              f'{1e6 * np.mean(seconds):.1f} µs per cell')  # fmt: skip


if __name__ == '__main__':
    main()
