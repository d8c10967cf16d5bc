"""
Learnt from days at work instead of an empty flange: drift left on an empty next day, and payloads.

``python bench/accuracy/at_work.py`` draws the worlds (``working_days``) from the last commit that
touched how drift is learnt, as ``worlds.py`` does; ``--dev`` draws the ones to develop on. Learnt
are four days of 2.5 h at work with two thermometers, judged is an empty fifth one, tared in its
first minute, over means of ten seconds: root mean square left, over raw. The yardstick learns from
the same four days with an empty flange and without a tare. Both use ``auto``.
"""

from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import NamedTuple

from judging import bench_parser, first_seed, STATISTICS, tared_rms, with_interval
import numpy as np
from working_days import SCENARIOS, Working, working

from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.result import Calibration
from wrist_ft_comp.fit.settings import CalibrationSettings
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import FloatArray
from wrist_ft_comp.stream.drift_of_recordings import simulate_drift

MEDIAN = STATISTICS['median']


class Judged(NamedTuple):
    """One world."""

    #: Share of the drift that is left, learnt at work and with an empty flange, (6,).
    left: FloatArray
    empty: FloatArray
    #: Errors of each payload: of its mass, as a share, and of its centre, m, (P,); NaN where none
    #: was reported.
    mass: FloatArray
    center: FloatArray
    #: Found and there.
    payloads: tuple[int, int]
    tares: tuple[int, int]


def left_of(calibration: Calibration, judged: Recording) -> FloatArray:
    """Share of an empty day's drift that is left, (6,)."""
    rest = judged.wrench - simulate_drift(calibration.model, judged).zero
    return np.asarray(tared_rms(rest) / tared_rms(judged.wrench))


def errors_of(world: Working, calibration: Calibration) -> tuple[FloatArray, FloatArray]:
    """Compare each payload with the nearest that was found."""
    mass, center = np.full((2, len(world.payloads)), np.nan)
    learnt = calibration.payloads.payloads if calibration.payloads else {}
    for n, true in enumerate(world.payloads if learnt else ()):
        found = min(learnt.values(), key=lambda payload: abs(payload.mass_kg - true.mass_kg))
        mass[n] = abs(found.mass_kg - true.mass_kg) / true.mass_kg
        center[n] = np.linalg.norm(found.center_m - true.center_m)
    return mass, center


def judge(name: str, seed: int) -> Judged:
    """Judge one world."""
    world = working(name, seed)
    empty = left_of(calibrate(world.empty), world.judged)
    calibration = calibrate(world.days, CalibrationSettings('payload'))
    left = left_of(calibration, world.judged)
    separation = calibration.separation
    states, steps = (len(separation.fit.gains), separation.steps) if separation else (0, [])
    # A flange that reads no weight is a state, too.
    drawn = len(world.payloads) + (not SCENARIOS[name].tool_is_read)
    payloads, tares = (states, drawn), (sum(map(len, steps)), world.tares)
    return Judged(left, empty, *errors_of(world, calibration), payloads, tares)


def print_scenario(name: str, results: list[Judged]) -> None:
    """Print a scenario."""
    left, empty = (np.stack([getattr(r, part) for r in results]) for part in ('left', 'empty'))
    print(f'\n{SCENARIOS[name].title} [{name}], {len(results)} worlds')
    print(
        f'  drift left  {MEDIAN(left):.3f}, empty flange {MEDIAN(empty):.3f}, ratio '
        f'{with_interval("median", left, empty)}; means {np.mean(left):.3f} and '
        f'{np.mean(empty):.3f}; axis by axis {np.median(left / empty):.2f}, worst '
        f'{np.max(left / empty):.1f}'
    )
    percent = 100 * np.concatenate([r.mass for r in results])
    mm = 1e3 * np.concatenate([r.center for r in results])
    print(
        f'  payloads    {np.isfinite(mm).sum()} of {len(mm)} reported; mass off by '
        f'{np.nanmedian(percent):.2f} % (worst {np.nanmax(percent):.2f}), centre by '
        f'{np.nanmedian(mm):.2f} mm (worst {np.nanmax(mm):.2f})'
    )
    states = sum(found == drawn for found, drawn in (r.payloads for r in results))
    found, drawn = np.sum([r.tares for r in results], axis=0)
    print(
        f'  found       number of payloads right in {states}, {found} steps for {drawn} tares',
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
