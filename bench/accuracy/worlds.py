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
import subprocess
import time

os.environ.setdefault('OMP_NUM_THREADS', '1')
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import numpy as np
from other_tree import OtherTree
from peers import block_means, day_of, Peer, PEERS, root_mean_square, tared
from real_worlds import chamber_rows, CREDITS, load_cell_world, six_axes, SPLITS
from scenarios import SCENARIOS
from worlds_drawn import FAMILIES, family, World

from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.settings import CalibrationSettings
from wrist_ft_comp.signals import AXES, FloatArray
from wrist_ft_comp.stream.offline import simulate_drift

ROOT = Path(__file__).resolve().parents[2]
#: The folders that decide how drift is learnt: their last commit draws the worlds.
LEARNING = ('fit', 'payload')
DEVELOPMENT_SEED = 1000
AUTO, MORE, BEFORE, TRUTH = 'auto', 'auto, more', 'auto before', 'the truth'
METHODS = (*PEERS, AUTO, TRUTH)
#: Tree of the version that is judged as ``auto before``.
BEFORE_TREE = 'WORLDS_BEFORE_TREE'
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


#: Statistics over axes, NaN left out.
STATISTICS: dict[str, Callable[[FloatArray], float]] = {
    'median': lambda shares: float(np.nanmedian(shares)),
    'mean': lambda shares: float(np.nanmean(shares)),
    '95 %': lambda shares: float(np.nanquantile(shares, 0.95)),
    'worst': lambda shares: float(np.nanmax(shares)),
}
_DRAWS = 1000


@dataclass(frozen=True, eq=False)
class Answer:
    """
    Drift of the judged day (N, 6), and what is said of it, (6,), NaN for nothing.

    That is the RMS that is left, and the limit that the largest error stays below.
    """

    drift: FloatArray
    claim: FloatArray
    limit: FloatArray = field(default_factory=lambda: np.full(len(AXES), np.nan))


@dataclass(frozen=True, eq=False)
class Result:
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


def intervals(
    statistic: Callable[[FloatArray], float], *shares: FloatArray
) -> tuple[float, float]:
    """Draw worlds again and again: 95 % of a statistic, or of its ratio between two methods."""
    rng = np.random.default_rng(0)
    worlds = len(shares[0])
    drawn = []
    for _ in range(_DRAWS):
        rows = rng.integers(worlds, size=worlds)
        values = [statistic(share[rows]) for share in shares]
        drawn.append(values[0] / values[1] if len(values) > 1 else values[0])
    low, high = np.quantile(drawn, (0.025, 0.975))
    return float(low), float(high)


def print_family(title: str, results: Mapping[str, Result], peer: str) -> None:
    """Print one family: every method, and how auto stands to the family's best peer."""
    worlds = len(next(iter(results.values())).left)
    print(f'\n{title}: drift left in {worlds} worlds, as a share of the uncompensated')
    print(f'{"":16}{"median":>21}{"mean":>21}{"95 %":>21}{"worst":>8}{"s":>7}')
    for name, result in results.items():
        cells = ''
        for key in ('median', 'mean', '95 %'):
            low, high = intervals(STATISTICS[key], result.left)
            cells += f'{STATISTICS[key](result.left):7.3f} ({low:.3f}–{high:.3f})'.rjust(21)
        cells += f'{STATISTICS["worst"](result.left):8.2f}{np.median(result.seconds):7.1f}'
        print(f'{name:16}{cells}')
    if AUTO in results and peer in results:
        print(f'{AUTO} by {peer}: ' + ratios(results[AUTO].left, results[peer].left))
    for ours, theirs in ((AUTO, BEFORE), (MORE, AUTO)):
        if ours in results and theirs in results:
            print(f'{ours} by {theirs}: ' + ratios(results[ours].left, results[theirs].left))
    for name in (AUTO, BEFORE):
        if name in results and np.isfinite(results[name].kept).any():
            print(f'{name}, left by claimed: {claims(results[name])}')


def ratios(ours: FloatArray, peers: FloatArray) -> str:
    """Say how the statistics stand to a peer's."""
    words = []
    for key in ('median', 'mean', '95 %'):
        low, high = intervals(STATISTICS[key], ours, peers)
        ratio = STATISTICS[key](ours) / STATISTICS[key](peers)
        words.append(f'{key} {ratio:.2f} ({low:.2f}–{high:.2f})')
    return ', '.join(words)


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
        name: Result(
            np.concatenate([family[name].left for family in families]),
            np.concatenate([family[name].kept for family in families]),
            np.concatenate([family[name].peak for family in families]),
            np.concatenate([family[name].seconds for family in families]),
        )
        for name in families[0]
    }


def draw(families: Mapping[str, Mapping[str, Result]], target: Path) -> None:
    """Draw the share of axes below a drift left, one panel per family."""
    import matplotlib as mpl  # noqa: PLC0415 -- needed for a picture only

    mpl.use('Agg')
    import matplotlib.pyplot as plt  # noqa: PLC0415

    rows = -(-len(families) // 3)
    figure, axes = plt.subplots(rows, 3, figsize=(15, 4 * rows), squeeze=False, sharex=True)
    for panel in axes.flat[len(families) :]:
        panel.axis('off')
    for panel, (title, results) in zip(axes.flat, families.items(), strict=False):
        for name, result in results.items():
            shares = np.sort(result.left[np.isfinite(result.left)])
            part = np.arange(1, len(shares) + 1) / len(shares)
            width = 2.5 if name.startswith('auto') else 1.0
            panel.step(np.maximum(shares, 1e-3), part, where='post', label=name, linewidth=width)
        panel.set(xscale='log', title=title, ylabel='share of axes', xlabel='drift left / raw')
        panel.grid(alpha=0.3)
    axes.flat[0].legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(target, dpi=110)


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
    return Answer(*OtherTree.at(os.environ[BEFORE_TREE]).answer(world))


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


def drawn(name: str, seed: int, more: int) -> World:
    """Draw a world of a family, or of a scenario of the package's own simulator."""
    if name in FAMILIES:
        return family(name, seed, more)
    learn, judge, truth = SCENARIOS[name](seed)
    whole = np.zeros_like(judge.wrench)
    whole[:, 2] = truth
    return World(learn, judge, whole)


def left_of(world: World, answer: Answer) -> FloatArray:
    """Return what is left of the judged day's drift, shape (M, 6), tared."""
    day = day_of(world.judge)
    cells = round(len(answer.drift) / len(day.drift))
    return tared(day.drift - block_means(answer.drift, cells), day.period_s)


def judge(
    task: tuple[str, int, tuple[str, ...], int],
) -> list[tuple[FloatArray, FloatArray, FloatArray, float]]:
    """Judge all methods in one world: share left, left and peak by claimed, and seconds."""
    name, seed, methods, more = task
    world = drawn(name, seed, more)
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


def report_seed(*more: str) -> int:
    """Make a seed of the last commit that touched how drift is learnt, or ``more`` folders."""
    paths = [f'wrist_ft_comp/{room}' for room in (*LEARNING, *more)]
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
    parser.add_argument('--before', type=Path, help='tree of a version to judge beside this one')
    parser.add_argument('--more', type=int, default=0, help='days beyond those of the families')
    parser.add_argument('--jobs', type=int, default=min(2, os.cpu_count() or 1))
    parser.add_argument('--no-real', action='store_true', help='drawn worlds only')
    parser.add_argument('--picture', type=Path, help='empirical distributions')
    return parser.parse_args()


def main() -> None:
    """Judge all methods in all worlds."""
    options = arguments()
    first = DEVELOPMENT_SEED if options.dev else report_seed()
    if options.before:
        os.environ[BEFORE_TREE] = str(options.before.resolve())
        options.methods = [*options.methods, BEFORE]
    if options.more:
        options.methods = [*options.methods, MORE]
    results: dict[str, dict[str, Result]] = {}
    with ProcessPoolExecutor(options.jobs) as pool:
        for name in options.families:
            title = FAMILIES[name].title if name in FAMILIES else f'scenario: {name}'
            tasks = [
                (name, first + number, tuple(options.methods), options.more)
                for number in range(options.worlds)
            ]
            rows = list(pool.map(judge, tasks))
            results[title] = {
                method: Result(*(np.array([row[i][part] for row in rows]) for part in range(4)))
                for i, method in enumerate(options.methods)
            }
            peer = BEST_PEER.get(name, OVERALL_PEER)
            print_family(f'{title} [{name}]', results[title], peer)
    ours = [FAMILIES[name].title for name in options.families if name in FAMILIES]
    if ours:
        together = pooled([results[title] for title in ours])
        print_family('all families', together, OVERALL_PEER)
    if not options.no_real:
        print_real([method for method in options.methods if method != TRUTH])
        print_chamber()
    if options.picture:
        draw(results, options.picture)


if __name__ == '__main__':
    main()
