"""
How long ``auto`` takes: six axes of the simulated wrist, unloaded and loaded.

``python bench/cost/calibration.py``. 24 h, half and a quarter of it for the growth, five times
2.5 h, and a fortnight of 8 h a day; 8 h with four and with sixteen thermometers, which
may take MOST_TIMES as long; with the largest memory of the process.
"""

from collections.abc import Sequence
from dataclasses import replace
import os
from pathlib import Path
import resource
import sys
import time

from wrist_ft_comp import ONE_THREAD

os.environ.update(ONE_THREAD)  # as the command and the node's calibration do, before numpy loads

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1] / 'accuracy'))
from thermal_networks import lag
from wrist import warm_up

from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.settings import CalibrationSettings
from wrist_ft_comp.recording import Recording, Reference

#: Hours of a recording, and how many recordings.
LENGTHS = ((6.0, 1), (12.0, 1), (24.0, 1), (2.5, 5), (8.0, 14))
MOST_TIMES = 3.0


def seconds(runs: Sequence[Recording], reference: Reference) -> float:
    """Calibrate, and say how long that took, s."""
    start = time.perf_counter()
    calibrate(runs, CalibrationSettings(reference=reference))
    return time.perf_counter() - start


def with_thermometers(count: int) -> Recording:
    """Warm up for 8 h; thermometers beyond those of the wrist follow the last one more slowly."""
    rng = np.random.default_rng(0)
    run = warm_up(rng, 1, 8.0)
    last = run.temperature_c[:, -1:]
    more = [
        lag(last, 60.0 * number, last[0]) + rng.normal(0, 0.02, last.shape)
        for number in range(1, count - run.temperature_c.shape[1] + 1)
    ]
    temperature_c = np.column_stack((run.temperature_c, *more))
    measured = np.ones(temperature_c.shape, dtype=bool)
    return replace(run, temperature_c=temperature_c, measured=measured)


def main() -> None:
    """Print how long a calibration of six axes takes."""
    references: dict[str, Reference] = {'unloaded': 'unloaded', 'loaded': 'recorded'}
    for hours, count in LENGTHS:
        for what, reference in references.items():
            runs = [
                warm_up(np.random.default_rng(run), 1, hours, loaded=what == 'loaded')
                for run in range(count)
            ]
            took = seconds(runs, reference)
            print(f'auto, six axes, {count} x {hours:g} h at 1 s, {what}: {took:.1f} s')
    four, sixteen = (seconds([with_thermometers(count)], 'unloaded') for count in (4, 16))
    print(
        f'8 h, four thermometers: {four:.1f} s, sixteen: {sixteen:.1f} s, {sixteen / four:.1f} '
        f'times as long (at most {MOST_TIMES:.0f})'
    )
    print(f'memory at most {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6:.2f} GB')


if __name__ == '__main__':
    main()
