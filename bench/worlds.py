"""
Drift left on the next day, in worlds that nobody tuned on, against what a careful engineer does.

``python bench/worlds.py`` draws the worlds from the last commit that touched identification or
calibration; ``--dev`` draws the ones to develop on. Learnt are some days, judged is another one,
tared in its first minute, over means of ten seconds: root mean square left, over raw. Intervals
are bootstrapped over worlds. ``family(name, seed)`` of ``worlds_drawn`` draws a single world.
"""

import argparse
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
import os
from pathlib import Path
import subprocess
import time

os.environ.setdefault('OMP_NUM_THREADS', '1')
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

from baseline import baseline, ROOT
import numpy as np
from real_worlds import chamber_rows, CREDITS, load_cell_world, six_axes, SPLITS
from scenarios import SCENARIOS
from world_autos import Answer, auto_before, auto_here
from world_peers import block_means, day_of, Peer, PEERS, root_mean_square, tared
from world_tables import draw, pooled, print_family, Result
from worlds_drawn import FAMILIES, family, World

from wrist_ft_comp.signals import FloatArray

__all__ = ['FAMILIES', 'World', 'family']

#: What decides how drift is learnt, now and after it has moved: its last commit draws the worlds.
LEARNING = ('identification', 'calibration')
DEVELOPMENT_SEED = 1000
AUTO, BEFORE_AUTO, TRUTH = 'auto', 'auto of 0.1.0', 'the truth'
METHODS = (*PEERS, BEFORE_AUTO, AUTO, TRUTH)
OVERALL_PEER = 'mean of 30'
#: The best peer of each family on the development seeds (least median times mean), fixed before
#: anything was judged; of the others it is the best of all families together.
BEST_PEER = {
    'nothing': 'nothing',
    'rod_one': 'ridge bank',
    'two lags': 'likely bank',
    'wrist, 1 thermometer': 'PLS on lags',
    'wrist, 1, loaded': 'PLS on lags',
    'noise only': 'nothing',
    'no drift': 'nothing',
}


def by_peer(peer: Peer, world: World) -> Answer:
    """Predict with a peer, which claims nothing."""
    predicted = peer([day_of(each) for each in world.learn], day_of(world.judge))
    return Answer(predicted, np.full(6, np.nan))


def by_truth(world: World) -> Answer:
    """Predict with a model that knows the sensor."""
    return Answer(world.truth, np.full(6, np.nan))


def answerer(method: str) -> Callable[[World], Answer]:
    """Find a method by its name."""
    ours = {
        AUTO: auto_here,
        BEFORE_AUTO: auto_before,
        TRUTH: by_truth,
    }
    return ours.get(method) or partial(by_peer, PEERS[method])


def drawn(name: str, seed: int) -> World:
    """Draw a world of a family, or of a scenario of the package's own simulator."""
    if name in FAMILIES:
        return family(name, seed)
    learn, judge, truth = SCENARIOS[name](seed)
    whole = np.zeros_like(judge.wrench)
    whole[:, 2] = truth
    return World(learn, judge, whole)


def left_of(world: World, answer: Answer) -> FloatArray:
    """Return what is left of the judged day's drift, shape (M, 6), tared."""
    day = day_of(world.judge)
    cells = round(len(answer.drift) / len(day.drift))
    return tared(day.drift - block_means(answer.drift, cells), day.period_s)


def judge(task: tuple[str, int, tuple[str, ...]]) -> list[tuple[FloatArray, FloatArray, float]]:
    """Judge all methods in one world: share left, left by claimed, and seconds."""
    name, seed, methods = task
    world = drawn(name, seed)
    raw = root_mean_square(left_of(world, Answer(np.zeros_like(world.judge.wrench), np.zeros(6))))
    rows = []
    for method in methods:
        began = time.perf_counter()
        answer = answerer(method)(world)
        seconds = time.perf_counter() - began
        remaining = root_mean_square(left_of(world, answer))
        rows.append((remaining / raw, remaining / answer.claim, seconds))
    return rows


def report_seed() -> int:
    """Make a seed of the last commit that touched how drift is learnt."""
    paths = [f'wrist_ft_comp/{room}' for room in LEARNING]
    command = ['git', 'log', '-1', '--format=%H', '--', *paths]
    commit = subprocess.run(command, cwd=ROOT, capture_output=True, check=True, text=True).stdout
    changed = ['git', 'status', '--porcelain', '--', *paths]
    if subprocess.run(changed, cwd=ROOT, capture_output=True, check=True).stdout:
        print('NOT A REPORT: how drift is learnt has changes that are not committed')
    print(f'report seeds from commit {commit[:12]}')
    return int(commit[:8], 16)


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


def print_chamber() -> None:
    """Print the paper's tables, fitted and with every temperature left out in turn."""
    print("\nthe paper's chamber tables, %FS: max |K_s| per °C, zero spread")
    for title, figures in chamber_rows().items():
        if figures is None:
            print(f'{title:28} refused')
        else:
            print(f'{title:28}{figures.max_sensitivity_drift:9.4f}{figures.zero_spread:9.3f}')


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('--dev', action='store_true', help='worlds to develop on')
    parser.add_argument('--worlds', type=int, default=20, help='per family')
    parser.add_argument(
        '--families',
        nargs='*',
        default=[*FAMILIES, *SCENARIOS],
        choices=[*FAMILIES, *SCENARIOS],
        help='and scenarios',
    )
    parser.add_argument('--methods', nargs='*', default=METHODS, choices=METHODS)
    parser.add_argument('--jobs', type=int, default=min(2, os.cpu_count() or 1))
    parser.add_argument('--no-real', action='store_true', help='drawn worlds only')
    parser.add_argument('--picture', type=Path, help='empirical distributions')
    return parser.parse_args()


def main() -> None:
    """Judge all methods in all worlds."""
    options = arguments()
    first = DEVELOPMENT_SEED if options.dev else report_seed()
    if BEFORE_AUTO in options.methods:
        baseline()  # once, before several processes want it
    results: dict[str, dict[str, Result]] = {}
    with ProcessPoolExecutor(options.jobs) as pool:
        for name in options.families:
            title = FAMILIES[name].title if name in FAMILIES else f'scenario: {name}'
            tasks = [
                (name, first + number, tuple(options.methods)) for number in range(options.worlds)
            ]
            rows = list(pool.map(judge, tasks))
            results[title] = {
                method: Result(*(np.array([row[i][part] for row in rows]) for part in range(3)))
                for i, method in enumerate(options.methods)
            }
            peer = BEST_PEER.get(name, OVERALL_PEER)
            print_family(f'{title} [{name}]', results[title], peer, (BEFORE_AUTO, AUTO))
    ours = [FAMILIES[name].title for name in options.families if name in FAMILIES]
    if ours:
        together = pooled([results[title] for title in ours])
        print_family('all families', together, OVERALL_PEER, (BEFORE_AUTO, AUTO))
    if not options.no_real:
        print_real([each for each in options.methods if each != TRUTH])
        print_chamber()
    if options.picture:
        draw(results, options.picture)


if __name__ == '__main__':
    main()
