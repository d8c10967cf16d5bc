"""
Learnt from days at work instead of an empty flange: drift left on an empty next day, and payloads.

``python bench/accuracy/at_work.py`` draws the worlds from the last commit that touched how drift
is learnt, as ``worlds.py`` does; ``--dev`` draws the ones to develop on. Every world
(``working_days``) is a random thermal network with two thermometers and a six-axis sensor; learnt
are four days of 2.5 h at work, judged is an empty fifth one, tared in its first minute, over means
of ten seconds: root mean square left, over raw. The yardstick learns from the same four days with
an empty flange and without a tare. Both use ``auto``. For every scenario: drift left, its median
by the yardstick's, masses and centres of mass against what was drawn, how many of them are within
their stated standard errors, and steps that were found for the driver's tares.

docs/accuracy.md has the figures of worlds that nobody had looked at.
"""

from concurrent.futures import ProcessPoolExecutor
from functools import partial
import time
from typing import NamedTuple

from judging import bench_parser, first_seed, interval, STATISTICS, tared_rms
import numpy as np
from working_days import SCENARIOS, Working, working

from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.result import Calibration
from wrist_ft_comp.fit.settings import CalibrationSettings
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import FloatArray
from wrist_ft_comp.stream.offline import simulate_drift

MEDIAN = STATISTICS['median']


class Judged(NamedTuple):
    """One world."""

    #: Share of the drift that is left, learnt at work and with an empty flange, (6,).
    left: FloatArray
    empty: FloatArray
    #: Errors and stated standard errors of each payload, relative and in m, (P, 2), (P, 3, 2); NaN
    #: where none was reported.
    mass: FloatArray
    center: FloatArray
    #: Found and there.
    payloads: tuple[int, int]
    tares: tuple[int, int]
    #: Time it took to learn at work.
    seconds: float


def left_of(calibration: Calibration, judged: Recording) -> FloatArray:
    """Share of an empty day's drift that is left, (6,)."""
    rest = judged.wrench - simulate_drift(calibration.model, judged).zero
    return np.asarray(tared_rms(rest) / tared_rms(judged.wrench))


def errors_of(world: Working, calibration: Calibration) -> tuple[FloatArray, FloatArray]:
    """Compare each payload with the nearest that was found."""
    mass = np.full((len(world.payloads), 2), np.nan)
    center = np.full((len(world.payloads), 3, 2), np.nan)
    if calibration.payloads is None:
        return mass, center
    for n, true in enumerate(world.payloads):
        payloads = calibration.payloads.payloads.values()
        found = min(payloads, key=lambda payload: abs(payload.mass_kg - true.mass_kg))
        mass[n] = found.mass_kg - true.mass_kg, found.mass_error_kg
        mass[n] /= true.mass_kg
        center[n] = np.stack((found.center_m - true.center_m, found.center_error_m), axis=1)
    return mass, center


def judge(name: str, seed: int) -> Judged:
    """Judge one world."""
    world = working(name, seed)
    empty = left_of(calibrate(world.empty), world.judged)
    began = time.perf_counter()
    calibration = calibrate(world.days, CalibrationSettings('payload'))
    left = left_of(calibration, world.judged)
    seconds = time.perf_counter() - began
    separation = calibration.separation
    states, steps = (len(separation.fit.gains), separation.steps) if separation else (0, [])
    return Judged(
        left,
        empty,
        *errors_of(world, calibration),
        (states, len(world.payloads)),
        (sum(map(len, steps)), world.tares),
        seconds,
    )


def print_scenario(name: str, results: list[Judged]) -> None:
    """Print a scenario."""
    left, empty = (np.stack([getattr(r, part) for r in results]) for part in ('left', 'empty'))
    ratio = MEDIAN(left) / MEDIAN(empty)
    low, high = interval(MEDIAN, left, empty)
    mass = np.concatenate([r.mass for r in results])
    center = np.concatenate([r.center for r in results])
    reported = np.isfinite(mass[:, 0])
    mass, center = mass[reported], center[reported]
    off = np.linalg.norm(center[..., 0], axis=1)
    sigmas = np.abs(np.append(mass[:, 0] / mass[:, 1], center[..., 0] / center[..., 1]))
    covered = [float(np.mean(sigmas < limit)) for limit in (1.645, 3.0)]
    percent, mm = 100 * np.abs(mass[:, 0]), 1e3 * off
    print(f'\n{SCENARIOS[name].title} [{name}], {len(results)} worlds')
    print(
        f'  drift left  {MEDIAN(left):.3f}, empty flange {MEDIAN(empty):.3f}, ratio {ratio:.2f} '
        f'({low:.2f}–{high:.2f}); means {np.mean(left):.3f} and {np.mean(empty):.3f}; '
        f'axis by axis {np.median(left / empty):.2f}, worst {np.max(left / empty):.1f}'
    )
    print(
        f'  payloads    {reported.sum()} of {len(reported)} reported; mass off by '
        f'{np.median(percent):.2f} % (worst {percent.max():.2f}), centre by '
        f'{np.median(mm):.2f} mm (worst {mm.max():.2f}); '
        f'within 1.64 and 3 stated errors: {covered[0]:.0%} and {covered[1]:.0%}'
    )
    counted = [(r.payloads, r.tares) for r in results]
    states = sum(found == drawn for (found, drawn), _ in counted)
    tares = [sum(column) for column in zip(*(tares for _, tares in counted), strict=True)]
    seconds = np.median([r.seconds for r in results])
    print(
        f'  found       number of payloads right in {states}, {tares[0]} steps for '
        f'{tares[1]} tares; {seconds:.0f} s per world',
        flush=True,
    )


def main() -> None:
    """Judge all scenarios."""
    parser = bench_parser(__doc__, 'worlds', 12)
    parser.add_argument('--scenarios', nargs='*', default=list(SCENARIOS), choices=SCENARIOS)
    options = parser.parse_args()
    first = first_seed(options)
    seeds = range(first, first + options.worlds)
    with ProcessPoolExecutor() as pool:
        for name in options.scenarios:
            print_scenario(name, list(pool.map(partial(judge, name), seeds)))


if __name__ == '__main__':
    main()
