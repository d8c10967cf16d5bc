"""
What to doubt of days at work, in sentences with numbers; and six wrong inputs to try them on.

``python bench/payload_doubts.py`` spoils one tool's days at work in six ways, learns from them as
``at_work.py`` does, and prints what is said and what is left of the drift of an empty next day,
beside what an empty flange's days leave. Nothing may be wrong without a word. In one world (seed
1003, empty flange 0.018) all were named, and left 0.019 with a wrong sign or swapped axes, 0.021
frozen, 0.067 with half of the gravity, 0.019 with another tool, 0.085 with clocks 5 s apart and
0.531 with the gravity of another frame.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
import os

os.environ.setdefault('OMP_NUM_THREADS', '1')
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

from at_work import empty_day, left_of
from at_work_days import COUNTS, frozen, FROZEN_S, joined, observe, Observed
import numpy as np
from rigid_payload import (
    bodies_of,
    CONTRAST,
    MISFIT,
    payloads_of,
    Rigid,
    UNEXPLAINED,
    unexplained_contrast,
    weightless,
)
from working_days import weight_of, WorkDay, Working, working
from worlds import DEVELOPMENT_SEED

from wrist_ft_comp.model.signals import FloatArray

#: Cells by which clocks may be apart, and shares that are doubted: of cells in contact, without
#: specific force, and, for drift, of the contrast between poses that is not explained.
LAGS, CONTACT, MISSING, NOTHING_LEARNT = 20, 0.5, 0.1, 0.6


def doubts(days: Sequence[WorkDay], observed: Observed) -> list[str]:
    """Say all that is to be doubted."""
    found = bodies_of(observed)
    share = missing_share(days)
    said = []
    if share > MISSING:
        said.append(
            f'The specific force is missing or stands still for {FROZEN_S} s and more in '
            f'{share:.0%} of the time, from which nothing was learnt.'
        )
    usable = observed.cells.usable
    contact = float(np.mean(observed.fit.weights[usable] < COUNTS)) if usable.any() else 1.0
    if contact > CONTACT:
        said.append(
            f'In {contact:.0%} of the time something else than a payload pushed, or the specific '
            "force is not the sensor's: contacts may be taken for drift."
        )
    unexplained = unexplained_contrast(observed)
    if unexplained > UNEXPLAINED:
        said.append(
            f'{unexplained:.0%} of what changes between poses does not turn with the specific '
            'force: it is of another frame or another time, or a cable pulls. No payload is told'
            + (', and no drift is to be learnt.' if unexplained > NOTHING_LEARNT else '.')
        )
    lag = clock_lag(days)
    if lag:
        said.append(f'The wrench lags the specific force by {lag} s: their clocks differ.')
    change = tool_change(days, observed)
    if change:
        said.append(change)
    return said + bodies_doubts(found)


def bodies_doubts(found: Rigid) -> list[str]:
    """Say why no payload is told, or why not to believe it."""
    directions = ', '.join(f'{each:.2f}' for each in found.contrast)
    if found.contrast[1] < CONTRAST:
        needed = f'two of {CONTRAST} are needed for a payload: tilt the tool about another axis.'
        return [f'Gravity moved by {directions} m/s² along three directions, and {needed}']
    if weightless(found):
        return ['Nothing weighs on the sensor: the driver may subtract its payload itself.']
    said = []
    if found.mirrored:
        said.append(
            'The specific force is mirrored: its sign is wrong, or two of its axes are swapped. '
            'No payload is told; drift is learnt.'
        )
    if found.misfit > MISFIT:
        said.append(
            f"{found.misfit:.0%} of the weight is no rigid body's: crosstalk, a wrong frame of "
            'the specific force, or a cable. No payload is told.'
        )
    return said


def missing_share(days: Sequence[WorkDay]) -> float:
    """Share of cells whose specific force is missing or frozen."""
    lost = [~np.isfinite(day.force).all(axis=1) | frozen(day.force) for day in days]
    return float(np.mean(np.concatenate(lost)))


def clock_lag(days: Sequence[WorkDay]) -> int:
    """Find by how many cells changes of the wrench follow those of the specific force."""
    total = np.zeros(2 * LAGS + 1)
    for day in days:
        moved, pushed = (
            np.nan_to_num(np.linalg.norm(np.diff(each, axis=0), axis=1))
            for each in (day.force, day.wrench[:, :3])
        )
        moved, pushed = (np.minimum(each, np.quantile(each, 0.95)) for each in (moved, pushed))
        moved, pushed = moved - moved.mean(), pushed - pushed.mean()
        inner = pushed[LAGS:-LAGS]
        rows = [moved[LAGS - k : len(moved) - LAGS - k] @ inner for k in range(-LAGS, LAGS + 1)]
        total += rows
    best = int(total.argmax())
    # A peak that stands out of what is far from it; otherwise they do not belong together at all.
    return best - LAGS if total[best] > 5 * np.median(np.abs(total)) else 0


def tool_change(days: Sequence[WorkDay], observed: Observed) -> str:
    """Say where payloads before and after a time have nothing in common."""
    states = np.concatenate(joined(days, observed.fit.states))
    counts = np.concatenate(joined(days, observed.fit.weights)) > COUNTS
    states, at = states[counts], np.flatnonzero(counts)
    number = len(observed.fit.gains)
    ends = [
        (at[states == k].min(), at[states == k].max())
        for k in range(number)
        if (states == k).any()
    ]
    for k, (first, _) in enumerate(ends):
        others = [last for j, (_, last) in enumerate(ends) if j != k]
        if first > 0 and others and min(others) < first:
            hours = first / 3600
            return f'The tool was changed after {hours:.1f} h: payloads before are not seen again.'
    return ''


def spoiled(world: Working, other: Working) -> dict[str, list[WorkDay]]:
    """Spoil days at work in six ways."""

    def forces(change: Callable[[int, FloatArray], FloatArray]) -> list[WorkDay]:
        return [replace(d, force=change(n, d.force.copy())) for n, d in enumerate(world.days)]

    def stuck(_: int, force: FloatArray) -> FloatArray:
        force[3000:] = force[3000]
        return force

    def half(_: int, force: FloatArray) -> FloatArray:
        force[: len(force) // 2] = np.nan
        return force

    changed = []
    for n, day in enumerate(world.days):
        gravity = world.rotation.apply(day.force)
        extra = weight_of(1.2, np.array([0.01, 0.02, 0.08]), gravity)
        extra *= n > 1 or (n == 1) * (np.arange(len(extra)) > len(extra) // 2)[:, None]
        changed.append(replace(day, wrench=day.wrench + extra))
    return {
        'nothing wrong': world.days,
        'sign of the IMU': forces(lambda _, f: -f),
        'swapped axes': forces(lambda _, f: f[:, [1, 0, 2]]),
        'wrong frame': forces(lambda n, _: other.days[n].force),
        'frozen IMU': forces(stuck),
        'half without TF': forces(half),
        'tool change': changed,
        'clocks 5 s apart': forces(lambda _, f: np.roll(f, -5, axis=0)),
    }


def main() -> None:
    """Spoil days of some worlds."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('--seeds', type=int, nargs='*', default=[DEVELOPMENT_SEED + 3])
    for seed in parser.parse_args().seeds:
        world, other = working('tool', seed), working('tool', seed + 500)
        judged = empty_day(*world.judged)
        empty = left_of([empty_day(*each) for each in world.empty], judged)
        print(f'world {seed}: an empty flange leaves {np.median(empty):.3f}')
        for title, days in spoiled(world, other).items():
            observed = observe(days)
            left = left_of(observed.days, judged)
            masses = ', '.join(f'{m:.3f}' for m in bodies_of(observed).mass_kg)
            told = 'told' if payloads_of(observed) else 'not told'
            print(f'\n{title}: leaves {np.median(left):.3f}; {masses} kg, {told}', flush=True)
            for sentence in doubts(days, observed):
                print(f'  {sentence}', flush=True)


if __name__ == '__main__':
    main()
