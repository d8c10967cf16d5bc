"""
Sensors that are real: a load cell, and an inertial sensor in a climate chamber.

Load cell: hmd83, TANEN project, CC BY 4.0. Inertial sensor: Copyright (c) 2024 tofupilot, MIT.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas
from worlds_drawn import World

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.recording import Recording, Samples
from wrist_ft_comp.series import FloatArray, IntArray, NANOSECONDS
from wrist_ft_comp.stream.batch_grid import grid_samples

DATA = Path(__file__).parents[3] / 'shared' / 'data'
#: 22 kg for 40.8 h, of which some are learnt from.
LOAD_CELL = DATA / 'load_cell' / 'constant_load_run1.csv'
LEARNT_H = 20.0
IMU = DATA / 'imu_chamber' / 'imu_chamber.csv'
#: Learnt on rows from 1 up to one of these, judged on the rest.
SPLITS = (6180, 4800, 5400, 5900, 6400, 6600, 7200)
_COLUMNS = (*(f'imu.acc.{axis}' for axis in 'xyz'), *(f'imu.gyro.{axis}' for axis in 'xyz'))


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
