"""
Drift left on the next day, in worlds that nobody tuned on, against what a careful engineer does.

``--before TREE`` also judges ``auto`` of another version, from its own tree, in the same worlds;
``--more DAYS`` draws other worlds, in which ``auto`` is also judged after so many days more.

``python bench/accuracy/worlds.py`` draws the worlds from the last commit that touched how drift is
learnt; ``--dev`` draws the ones to develop on. Learnt are some days, judged is another one, tared
in its first minute, over means of ten seconds: root mean square left, over raw. Intervals are
bootstrapped over worlds. ``family(name, seed)`` of ``worlds_drawn`` draws a single world.
"""

import argparse
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
import os
from pathlib import Path
import time
from typing import NamedTuple

from judging import (
    bench_parser,
    block_means,
    first_seed,
    root_mean_square,
    STATISTICS,
    tared,
    with_interval,
)
import numpy as np
from other_tree import answer_of_tree
from peers import day_of, Peer, PEERS
from real_worlds import CREDITS, load_cell_world, six_axes, SPLITS
from worlds_drawn import FAMILIES, family, World

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.errors import RecordingError, WristFtCompError
from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.settings import CalibrationSettings
from wrist_ft_comp.series import FloatArray
from wrist_ft_comp.stream.offline import simulate_drift

AUTO, MORE, BEFORE, TRUTH = 'auto', 'auto, more', 'auto before', 'the truth'
METHODS = (*PEERS, AUTO, TRUTH)
#: Statistics that are printed with an interval.
PRINTED = ('median', 'mean', '95 %')
#: Tree of the version that is judged as ``auto before``.
BEFORE_TREE = 'WORLDS_BEFORE_TREE'
OVERALL_PEER = 'mean of 30'
#: The best peer of each family on the development seeds (least median times mean), fixed before
#: anything was judged; of the others it is the best of all families together.
BEST_PEER = {
    'nothing': 'nothing',
    'rod_one': 'ridge bank',
}


@dataclass(frozen=True, eq=False)
class Answer:
    """
    Drift of the judged day (N, 6), and what is said of it, (6,), NaN for nothing.

    That is the RMS that is left, and the limit that the largest error stays below.
    """

    drift: FloatArray
    claim: FloatArray
    limit: FloatArray = field(default_factory=lambda: np.full(len(AXES), np.nan))


class Result(NamedTuple):
    """
    What a method left in the worlds of a family.

    Attributes
    ----------
    left : ndarray, shape (worlds, 6)
        Of the drift of each axis; NaN where there was none.
    kept : ndarray, shape (worlds, 6)
        What was left by what had been claimed; NaN without a claim.
    peak : ndarray, shape (worlds, 6)
        The largest error of the day by the limit that had been stated; NaN without one.
    seconds : ndarray, shape (worlds,)
        Time it took.

    """

    left: FloatArray
    kept: FloatArray
    peak: FloatArray
    seconds: FloatArray


def print_family(title: str, results: Mapping[str, Result], peer: str) -> None:
    """Print one family: every method, and how auto stands to the family's best peer."""
    worlds = len(next(iter(results.values())).left)
    print(f'\n{title}: drift left in {worlds} worlds, as a share of the uncompensated')
    print(f'{"":16}{"median":>21}{"mean":>21}{"95 %":>21}{"worst":>8}{"s":>7}')
    for name, result in results.items():
        cells = ''.join(f'{with_interval(key, result.left):>21}' for key in PRINTED)
        cells += f'{STATISTICS["worst"](result.left):8.2f}{np.median(result.seconds):7.1f}'
        print(f'{name:16}{cells}')
    for ours, theirs in ((AUTO, peer), (AUTO, BEFORE), (MORE, AUTO)):
        if ours in results and theirs in results:
            left = results[ours].left, results[theirs].left
            ratios = ', '.join(f'{key} {with_interval(key, *left)}' for key in PRINTED)
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


def by_auto(world: World) -> Answer:
    """Calibrate; a refusal leaves the sensor as it is and claims nothing."""
    drift, claim = np.zeros_like(world.judge.wrench), np.full(len(AXES), np.nan)
    settings = CalibrationSettings(reference=world.reference)
    try:
        calibration = calibrate(world.learn, settings)
    except WristFtCompError:
        return Answer(drift, claim)
    zero, gain = simulate_drift(calibration.model, world.judge)
    drift = zero + np.where(gain == 0.0, 0.0, gain * world.judge.reference)
    deviation = calibration.model.uncertainty(world.judge.temperature_c)
    limits = np.array([calibration.model.day_limits.get(axis, np.nan) for axis in AXES])
    return Answer(drift, np.sqrt(np.mean(deviation**2, axis=0)), limits)


def by_more(world: World) -> Answer:
    """Calibrate with all days that there are."""
    return by_auto(replace(world, learn=world.learn + world.more))


def by_other_tree(world: World) -> Answer:
    """Calibrate with ``auto`` of another version, in a process of its own."""
    return Answer(*answer_of_tree(os.environ[BEFORE_TREE], world))


def by_peer(peer: Peer, world: World) -> Answer:
    """Predict with a peer, which claims nothing."""
    predicted = peer([day_of(day) for day in world.learn], day_of(world.judge))
    return Answer(predicted, np.full(6, np.nan))


def by_truth(world: World) -> Answer:
    """Predict with a model that knows the sensor."""
    return Answer(world.truth, np.full(6, np.nan))


def answerer(method: str) -> Callable[[World], Answer]:
    """Find a method by its name."""
    ours = {AUTO: by_auto, MORE: by_more, BEFORE: by_other_tree, TRUTH: by_truth}
    return ours.get(method) or partial(by_peer, PEERS[method])


def left_of(world: World, answer: Answer) -> FloatArray:
    """Return what is left of the judged day's drift, shape (M, 6), tared."""
    day = day_of(world.judge)
    cells = round(len(answer.drift) / len(day.drift))
    return tared(day.drift - block_means(answer.drift, cells), day.period_s)


def judge(
    task: tuple[str, int, Sequence[str], int],
) -> list[tuple[FloatArray, FloatArray, FloatArray, float]]:
    """Judge all methods in one world: what stands in a Result, of each."""
    name, seed, methods, more = task
    nothing = np.full(len(AXES), np.nan)
    try:
        world = family(name, seed, more)
    except RecordingError:  # a body that gets hotter than any thermometer of a wrist
        return [(nothing, nothing, nothing, np.nan)] * len(methods)
    raw = root_mean_square(left_of(world, Answer(np.zeros_like(world.judge.wrench), np.zeros(6))))
    rows = []
    for method in methods:
        began = time.perf_counter()
        answer = answerer(method)(world)
        seconds = time.perf_counter() - began
        errors = left_of(world, answer)
        remaining, peak = root_mean_square(errors), np.asarray(np.nanmax(np.abs(errors), axis=0))
        rows.append((remaining / raw, remaining / answer.claim, peak / answer.limit, seconds))
    return rows


def print_real(methods: Sequence[str]) -> None:
    """Print what is left of the spread of real sensors."""
    worlds = {f'six axes, {split}': six_axes(split) for split in SPLITS}
    print(
        '\nsix real axes, learnt before a row, judged after: spread left, geometric mean (worst)'
    )
    if None in worlds.values():
        print('skipped: imu_chamber.csv is not beside the project')
    else:
        print(CREDITS['six axes'])
        print(f'{"":16}' + ''.join(f'{split:>15}' for split in SPLITS))
        for method in methods:
            cells = ''
            for world in worlds.values():
                assert world is not None  # noqa: S101 -- looked at above
                remaining = np.std(left_of(world, answerer(method)(world)), axis=0)
                share = remaining / np.std(day_of(world.judge).drift, axis=0)
                cells += f'{np.exp(np.mean(np.log(share))):.3f} ({share.max():.2f})'.rjust(15)
            print(f'{method:16}{cells}', flush=True)
    cell = load_cell_world()
    print('\nload cell, learnt from 20 h: spread of the rest, g')
    if cell is None:
        print('skipped: constant_load_run1.csv is not beside the project')
        return
    print(CREDITS['load cell'])
    for method in methods:
        remaining = left_of(cell, answerer(method)(cell))
        print(f'{method:16}{np.nanstd(remaining[:, 2]):8.2f}', flush=True)


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = bench_parser(__doc__, 'worlds', 20)
    parser.add_argument('--families', nargs='*', default=[*FAMILIES], choices=FAMILIES)
    parser.add_argument('--methods', nargs='*', default=METHODS, choices=METHODS)
    parser.add_argument('--before', type=Path, help='tree of a version to judge beside this one')
    parser.add_argument('--more', type=int, default=0, help='days beyond those of the families')
    parser.add_argument('--no-real', action='store_true', help='drawn worlds only')
    return parser.parse_args()


def main() -> None:
    """Judge all methods in all worlds."""
    options = arguments()
    first = first_seed(options)
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
            print_family(title, results, BEST_PEER.get(name, OVERALL_PEER))
            drawn_families.append(results)
    if drawn_families:
        print_family('all families', pooled(drawn_families), OVERALL_PEER)
    if not options.no_real:
        print_real([method for method in methods if method != TRUTH])


if __name__ == '__main__':
    main()
