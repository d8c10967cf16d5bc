"""
Sensors that are real: a load cell, and an inertial sensor in a climate chamber.

Load cell: hmd83, TANEN project, CC BY 4.0. Inertial sensor: Copyright (c) 2024 tofupilot, MIT.
"""

import csv
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from worlds_drawn import World

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.recording import Recording, Samples
from wrist_ft_comp.series import NANOSECONDS
from wrist_ft_comp.stream.batch_grid import grid_samples

DATA = Path(__file__).parents[3] / 'shared' / 'data'
#: 22 kg for 40.8 h.
LOAD_CELL = DATA / 'load_cell' / 'constant_load_run1.csv'
LEARNT_H = 20.0
IMU = DATA / 'imu_chamber' / 'imu_chamber.csv'
CREDITS = {
    'load cell': 'load cell: hmd83, TANEN project, CC BY 4.0',
    'six axes': 'six axes: inertial sensor, Copyright (c) 2024 tofupilot, MIT',
}
#: Learnt on rows from 1 up to one of these, judged on the rest.
SPLITS = (6180, 4800, 5400, 5900, 6400, 6600, 7200)
_COLUMNS = (*(f'imu.acc.{axis}' for axis in 'xyz'), *(f'imu.gyro.{axis}' for axis in 'xyz'))


def with_zero_reference(day: Recording) -> Recording:
    """Say that the true load did not change."""
    return replace(day, reference=np.where(np.isfinite(day.wrench), 0.0, np.nan))


def chamber_part(rows: NDArray[np.void]) -> Recording:
    """Put some rows of the inertial sensor onto cells of 1 s; acceleration is read as force."""
    stamps_ns = (rows['timestamp'] * 1000).astype(np.int64)
    wrench = np.stack([rows[name] for name in _COLUMNS], axis=1)
    return grid_samples(
        [
            Samples(('temperature_c',), stamps_ns, rows['imu.temperature'][:, np.newaxis]),
            Samples(AXES, stamps_ns, wrench),
        ],
        name='six axes',
        period_s=1.0,
    )


def six_axes(split: int) -> World | None:
    """Learn on the rows before the split, judge on the rest; None where the file is not."""
    if not IMU.exists():
        return None
    rows = np.genfromtxt(IMU, delimiter=',', names=True, deletechars='')
    learn, judge = (
        with_zero_reference(chamber_part(part)) for part in (rows[1:split], rows[split:])
    )
    return World([learn], judge, np.zeros_like(judge.wrench), 'constant')


def load_cell_world() -> World | None:
    """Learn on the first 20 h, judge on the rest, in g; None where the file is not."""
    if not LOAD_CELL.exists():
        return None
    with LOAD_CELL.open(encoding='utf-8') as file:
        rows = list(csv.DictReader(file, delimiter=';'))
    stamps = [datetime.fromisoformat(row['time'].replace('Z', '+00:00')) for row in rows]
    elapsed_s = np.array([(stamp - stamps[0]).total_seconds() for stamp in stamps])
    stamps_ns = (elapsed_s * NANOSECONDS).astype(np.int64)
    values = np.array([[float(row['T_C']), 1000 * float(row['W_raw_kg'])] for row in rows])
    first = elapsed_s < 3600 * LEARNT_H
    learn, judge = (
        with_zero_reference(
            grid_samples(
                [
                    Samples(('temperature_c',), stamps_ns[part], values[part, :1]),
                    Samples(('force_z',), stamps_ns[part], values[part, 1:]),
                ],
                name='load cell',
                period_s=30.0,
            )
        )
        for part in (first, ~first)
    )
    return World([learn], judge, np.zeros_like(judge.wrench), 'constant')
