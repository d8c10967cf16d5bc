"""
Steps of the zero in days that are declared unloaded: which are named, and what they cost.

Each drawn day gets short touches, and one to three steps of 2 to 20 N. Printed are the share of
steps that are named within 30 s, the steps that are named where there are none, and the mean drift
left on the judged day by what was learnt with steps, over that without.

``python bench/accuracy/steps.py --dev`` draws the days to develop on.
"""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

from judging import bench_parser, first_seed
import numpy as np
from worlds import by_auto, by_nothing, rms_left
from worlds_drawn import FAMILIES, family

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.fit.outliers_and_steps import segment
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import FloatArray

#: Steps of a day, N; torques step by a twentieth in N m.
STEPS, SIZE_N = (1, 3), (2.0, 20.0)
#: Touches of a day, their size, N, and how long they last, s.
TOUCHES, TOUCH_N, TOUCH_S = 3, 20.0, (2.0, 50.0)
#: A step is named where one is found this near, s.
NEAR_S = 30.0
LEVER = np.array([1.0, 1.0, 1.0, 0.05, 0.05, 0.05])


def unloaded(day: Recording) -> Recording:
    """Take the load off a day, so that it holds drift only."""
    load = np.where(np.isfinite(day.reference), day.reference, 0.0)
    return replace(day, wrench=day.wrench - load, reference=np.zeros_like(load))


def touched(day: Recording, rng: np.random.Generator) -> Recording:
    """Touch a day's sensor for some seconds, now and then."""
    wrench = day.wrench.copy()
    for begin in rng.integers(0, len(day) - round(TOUCH_S[1] / day.period_s), TOUCHES):
        end = begin + round(rng.uniform(*TOUCH_S) / day.period_s)
        wrench[begin:end] += TOUCH_N * rng.uniform(-1, 1, len(AXES)) * LEVER
    return replace(day, wrench=wrench)


def stepped(day: Recording, rng: np.random.Generator) -> tuple[Recording, FloatArray]:
    """Let a day's zero step, in all axes; say at which cells."""
    wrench, length = day.wrench.copy(), len(day)
    count = int(rng.integers(STEPS[0], STEPS[1] + 1))
    cells = np.round(length * (np.arange(count) + rng.uniform(0.2, 0.8, count)) / count)
    for cell in cells.astype(int):
        signs = rng.choice((-1.0, 1.0), len(AXES))
        wrench[cell:] += signs * rng.uniform(*SIZE_N) * LEVER
    return replace(day, wrench=wrench), cells


def judge(task: tuple[str, int]) -> tuple[int, int, int, int, float, float]:
    """Count days, steps, named and false ones, and give what is left with steps and without."""
    name, seed = task
    world, rng = family(name, seed), np.random.default_rng(seed)
    days = [touched(unloaded(day), rng) for day in world.learn]
    plain, _ = segment(days, 'unloaded')
    false = sum(len(day.steps) for day in plain)
    pairs = [stepped(day, rng) for day in days]
    found, _ = segment([day for day, _ in pairs], 'unloaded')
    named = sum(
        int(min(abs(np.subtract(day.steps, cell)), default=np.inf) * day.period_s <= NEAR_S)
        for day, (_, cells) in zip(found, pairs, strict=True)
        for cell in cells
    )
    world = replace(world, judge=unloaded(world.judge), reference='unloaded')
    steps, raw = sum(len(cells) for _, cells in pairs), rms_left(world, by_nothing(world))
    with_steps, without = (
        float(np.nanmean(rms_left(world, by_auto(replace(world, learn=learn))) / raw))
        for learn in ([day for day, _ in pairs], days)
    )
    return len(days), steps, named, false, with_steps, without


def main() -> None:
    """Judge all families whose days can be unloaded."""
    options = bench_parser(__doc__, 'worlds', 4).parse_args()
    first = first_seed(options)
    names = [name for name, kind in FAMILIES.items() if not kind.loaded and kind.hours >= 1]
    tasks = [(name, first + n) for name in names for n in range(options.worlds)]
    with ProcessPoolExecutor() as pool:
        rows = np.array(list(pool.map(judge, tasks)))
    days, steps, named, false = rows[:, :4].sum(axis=0).astype(int)
    print(
        f'{days} days, {steps} steps of {SIZE_N[0]:g} to {SIZE_N[1]:g} N, {TOUCHES} touches a day'
    )
    print(f'named within {NEAR_S:g} s: {named / steps:.1%}; named where there are none: {false}')
    with_steps, without = rows[:, 4:].mean(axis=0)
    print(
        f'drift left, mean of {len(rows)} worlds: {with_steps:.3f} with steps, {without:.3f} '
        f'without, {with_steps / without:.2f} times'
    )


if __name__ == '__main__':
    main()
