"""
Drift left on the next day, in worlds that nobody tuned on, against what a careful engineer does.

``--before TREE`` also judges ``auto`` of another version, from its own tree, in the same worlds;
``--more DAYS`` draws other worlds, in which ``auto`` is also judged after so many days more.

``python bench/accuracy/worlds.py`` draws the worlds from the last commit that touched how drift is
learnt; ``--dev`` draws the ones to develop on. Learnt are some days, judged is another one, tared
in its first minute, over means of ten seconds: root mean square left, over raw. Intervals are
bootstrapped over worlds. ``family(name, seed)`` of ``worlds_drawn`` draws a single world.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
import os
from pathlib import Path
import pickle
import subprocess
import sys
import time
from typing import NamedTuple

import judging
import numpy as np
import pandas
from peers import axes_of, day_of, Peer, PEERS
from worlds_drawn import FAMILIES, family, World

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.errors import RecordingError, WristFtCompError
from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.settings import CalibrationSettings
from wrist_ft_comp.recording import Recording, Samples
from wrist_ft_comp.recordings.sample_checks import grid_samples
from wrist_ft_comp.series import FloatArray, IntArray, NANOSECONDS
from wrist_ft_comp.stream.drift_of_recordings import simulate_drift

NOTHING, AUTO, TRUTH = 'nothing', 'auto', 'the truth'
MORE, BEFORE = 'auto, more', 'auto before'
METHODS = (NOTHING, *PEERS, AUTO, TRUTH)
#: Statistics that are printed with an interval.
PRINTED = ('median', 'mean', '95 %')
#: Names the tree of the version that is judged as ``auto before`` to other processes.
BEFORE_TREE = 'WORLDS_BEFORE_TREE'
#: What ``auto`` is compared with.
PEER = 'ridge bank'
#: Sensors that are real, where their data lie beside the project.
DATA = Path(__file__).parents[3] / 'shared' / 'data'
#: 22 kg for 40.8 h, of which some are learnt from.
LOAD_CELL = DATA / 'load_cell' / 'constant_load_run1.csv'
LEARNT_H = 20.0
IMU = DATA / 'imu_chamber' / 'imu_chamber.csv'
#: Learnt on rows from 1 up to one of these, judged on the rest.
SPLITS = (6180, 4800, 5400, 5900, 6400, 6600, 7200)
_COLUMNS = (*(f'imu.acc.{axis}' for axis in 'xyz'), *(f'imu.gyro.{axis}' for axis in 'xyz'))


@dataclass(frozen=True, eq=False)
class Answer:
    """
    Drift of the judged day (N, 6), and what is said of it, (6,), NaN for nothing.

    That is the RMS that is left, and the limit that the largest error stays below.
    """

    drift: FloatArray
    claim: FloatArray = field(default_factory=lambda: np.full(len(AXES), np.nan))
    limit: FloatArray = field(default_factory=lambda: np.full(len(AXES), np.nan))


class Result(NamedTuple):
    """What a method left in the worlds of a family, axis by axis, (worlds, 6); NaN for nothing."""

    #: Of the drift.
    left: FloatArray
    #: What was left by what had been claimed.
    kept: FloatArray
    #: The largest error of the day by the limit that had been stated.
    peak: FloatArray
    #: Time it took, (worlds,).
    seconds: FloatArray


def print_family(title: str, results: Mapping[str, Result]) -> None:
    """Print one family: every method, and how auto stands to PEER."""
    worlds = len(next(iter(results.values())).left)
    print(f'\n{title}: drift left in {worlds} worlds, as a share of the uncompensated')
    print(f'{"":16}{"median":>21}{"mean":>21}{"95 %":>21}{"worst":>8}{"s":>7}')
    for name, result in results.items():
        cells = ''.join(f'{judging.with_interval(key, result.left):>21}' for key in PRINTED)
        cells += f'{judging.STATISTICS["worst"](result.left):8.2f}{np.median(result.seconds):7.1f}'
        print(f'{name:16}{cells}')
    for ours, theirs in ((AUTO, PEER), (AUTO, BEFORE), (MORE, AUTO)):
        if ours in results and theirs in results:
            left = results[ours].left, results[theirs].left
            ratios = ', '.join(f'{key} {judging.with_interval(key, *left)}' for key in PRINTED)
            print(f'{ours} by {theirs}: {ratios}')
    for name in (AUTO, BEFORE):
        if name in results and np.isfinite(results[name].kept).any():
            print(f'{name}, left by claimed: {claims(results[name])}')


def claims(result: Result) -> str:
    """Say how much more is left than was claimed, and on how many days the day's limit holds."""
    finite, peak = (part[np.isfinite(part)] for part in (result.kept, result.peak))
    return (
        f'median {np.median(finite):.2f}, below 2: {np.mean(finite < 2):.0%}; below the limit of '
        f'a day: {np.mean(peak < 1):.0%}, 95 % of peaks below '
        f'{np.quantile(peak, 0.95) if len(peak) else np.nan:.2f} of it'
    )


def pooled(families: Sequence[Mapping[str, Result]]) -> dict[str, Result]:
    """Put the worlds of several families together."""
    return {
        name: Result(*map(np.concatenate, zip(*(one[name] for one in families), strict=True)))
        for name in families[0]
    }


def by_nothing(world: World) -> Answer:
    """Leave the sensor as it is, and claim nothing."""
    return Answer(np.zeros_like(world.judge.wrench))


def by_auto(world: World) -> Answer:
    """Calibrate; where that is refused, the sensor stays as it is."""
    settings = CalibrationSettings(reference=world.reference)
    try:
        model = calibrate(world.learn, settings).model
    except WristFtCompError:
        return by_nothing(world)
    zero, gain = simulate_drift(model, world.judge)
    drift = zero + np.where(gain == 0.0, 0.0, gain * world.judge.reference)
    deviation = model.uncertainty(world.judge.temperature_c)
    limits = np.array([model.day_limits.get(axis, np.nan) for axis in AXES])
    return Answer(drift, np.sqrt(np.mean(deviation**2, axis=0)), limits)


def by_other_tree(world: World) -> Answer:
    """Calibrate with ``auto`` of another version, in a process of its own."""
    days = [
        (d.name, d.period_ns, d.first_cell, d.temperature_c, d.measured, d.wrench, d.reference)
        for d in (*world.learn, world.judge)
    ]
    done = subprocess.run(
        [sys.executable, str(Path(__file__).with_name('other_tree.py'))],
        env={**os.environ, 'PYTHONPATH': os.environ[BEFORE_TREE]},
        input=pickle.dumps((days, world.reference)),
        stdout=subprocess.PIPE,
        check=True,
    )
    return Answer(*pickle.loads(done.stdout))  # noqa: S301 -- from our own process


def by_peer(peer: Peer, world: World) -> Answer:
    """Predict with a peer, which claims nothing."""
    return Answer(peer([day_of(day) for day in world.learn], day_of(world.judge)))


#: Answers a world, by the name of the method.
ANSWERS: dict[str, Callable[[World], Answer]] = {
    NOTHING: by_nothing,
    **{name: partial(by_peer, peer) for name, peer in PEERS.items()},
    AUTO: by_auto,
    MORE: lambda world: by_auto(replace(world, learn=world.learn + world.more)),
    BEFORE: by_other_tree,
    TRUTH: lambda world: Answer(world.truth),
}


def left_of(world: World, answer: Answer) -> FloatArray:
    """Return what is left of the judged day's drift, shape (M, 6), tared."""
    day = day_of(world.judge)
    cells = round(len(answer.drift) / len(day.drift))
    return judging.tared(day.drift - judging.block_means(answer.drift, cells), day.period_s)


def rms_left(world: World, answer: Answer) -> FloatArray:
    """RMS of what is left of each axis' drift, (6,)."""
    return judging.root_mean_square(left_of(world, answer))


def judge(
    task: tuple[str, int, Sequence[str], int],
) -> list[tuple[FloatArray, FloatArray, FloatArray, float]]:
    """Judge all methods in one world: what stands in a Result, of each."""
    name, seed, methods, more = task
    unknown = np.full(len(AXES), np.nan)
    try:
        world = family(name, seed, more)
    except RecordingError:  # a body that gets hotter than any thermometer of a wrist
        return [(unknown, unknown, unknown, np.nan)] * len(methods)
    raw = rms_left(world, by_nothing(world))
    rows = []
    for method in methods:
        began = time.perf_counter()
        answer = ANSWERS[method](world)
        seconds = time.perf_counter() - began
        left, peak = rms_left(world, answer), np.nanmax(np.abs(left_of(world, answer)), axis=0)
        rows.append((left / raw, left / answer.claim, peak / answer.limit, seconds))
    return rows


def constant(
    stamps_ns: IntArray,
    celsius: FloatArray,
    axes: Sequence[str],
    wrench: FloatArray,
    period_s: float,
) -> Recording:
    """Grid readings of a sensor whose true load does not change."""
    samples = [
        Samples(('temperature_c',), stamps_ns, celsius[:, np.newaxis]),
        Samples(tuple(axes), stamps_ns, wrench),
    ]
    day = grid_samples(samples, name='real', period_s=period_s)
    return replace(day, reference=np.where(np.isfinite(day.wrench), 0.0, np.nan))


def six_axes(split: int) -> World:
    """Learn on the rows before the split, judge on the rest; acceleration is read as force."""
    rows = np.genfromtxt(IMU, delimiter=',', names=True, deletechars='')
    learn, judge = (
        constant(
            (part['timestamp'] * 1000).astype(np.int64), part['imu.temperature'], AXES,
            np.stack([part[name] for name in _COLUMNS], axis=1), 1.0,
        )
        for part in (rows[1:split], rows[split:])
    )  # fmt: skip
    return World([learn], judge, np.zeros_like(judge.wrench), 'constant')


def load_cell() -> World:
    """Learn on the first hours, judge on the rest, in g."""
    table = pandas.read_csv(LOAD_CELL, sep=';', parse_dates=['time'])
    elapsed_s = (table['time'] - table['time'][0]).dt.total_seconds().to_numpy()
    celsius, grams = table['T_C'].to_numpy(), 1000 * table[['W_raw_kg']].to_numpy()
    stamps_ns, first = (elapsed_s * NANOSECONDS).astype(np.int64), elapsed_s < 3600 * LEARNT_H
    learn, judge = (
        constant(stamps_ns[part], celsius[part], ['force_z'], grams[part], 30.0)
        for part in (first, ~first)
    )
    return World([learn], judge, np.zeros_like(judge.wrench), 'constant')


#: What is printed above worlds, the file they are read from, and the worlds by name.
REAL: tuple[tuple[str, Path, dict[str, Callable[[], World]]], ...] = (
    (
        'inertial sensor (Copyright (c) 2024 tofupilot, MIT), learnt before a row, judged after',
        IMU,
        {str(split): partial(six_axes, split) for split in SPLITS},
    ),
    (
        f'load cell (hmd83, TANEN project, CC BY 4.0), learnt from {LEARNT_H:g} h, in g',
        LOAD_CELL,
        {'load cell': load_cell},
    ),
)


def print_real(methods: Sequence[str]) -> None:
    """Print the spread that is left of real sensors, where their data lie beside the project."""
    for title, path, worlds in REAL:
        print(f'\n{title}: spread left, geometric mean (worst)')
        for name, draw in worlds.items() if path.exists() else ():
            world = draw()
            axes = axes_of([day_of(world.judge)])
            before = np.nanstd(day_of(world.judge).drift[:, axes], axis=0)
            print(f'{name}: spread {before.round(3)}')
            for method in methods:
                after = np.nanstd(left_of(world, ANSWERS[method](world))[:, axes], axis=0)
                share = after / before
                mean, worst = np.exp(np.mean(np.log(share))), share.max()
                print(f'{method:16}{mean:8.3f} ({worst:.2f})  {after.round(3)}', flush=True)


def main() -> None:
    """Judge all methods in all worlds."""
    parser = judging.bench_parser(__doc__, 'worlds', 20)
    parser.add_argument('--families', nargs='*', default=[*FAMILIES], choices=FAMILIES)
    parser.add_argument('--methods', nargs='*', default=METHODS, choices=METHODS)
    parser.add_argument('--before', type=Path, help='tree of a version to judge beside this one')
    parser.add_argument('--more', type=int, default=0, help='days beyond those of the families')
    parser.add_argument('--no-real', action='store_true', help='drawn worlds only')
    options = parser.parse_args()
    first = judging.first_seed(options)
    methods = list(options.methods)
    if options.before:
        os.environ[BEFORE_TREE] = str(options.before.resolve())
        methods.append(BEFORE)
    if options.more:
        methods.append(MORE)
    drawn_families = []
    with ProcessPoolExecutor() as pool:
        for name in options.families:
            tasks = [(name, first + n, methods, options.more) for n in range(options.worlds)]
            worlds = list(pool.map(judge, tasks))
            rows = [zip(*of_method, strict=True) for of_method in zip(*worlds, strict=True)]
            results = {
                method: Result(*map(np.array, row))
                for method, row in zip(methods, rows, strict=True)
            }
            title = f'{FAMILIES[name].title} [{name}]'
            print_family(title, results)
            drawn_families.append(results)
    if drawn_families:
        print_family('all families', pooled(drawn_families))
    if not options.no_real:
        print_real([method for method in methods if method != TRUTH])


if __name__ == '__main__':
    main()
