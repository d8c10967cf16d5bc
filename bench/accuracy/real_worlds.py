"""
Sensors that are real: a load cell, and an inertial sensor in a climate chamber.

Load cell: hmd83, TANEN project, CC BY 4.0. Inertial sensor: Copyright (c) 2024 tofupilot, MIT.
"""

import numpy as np
from numpy.typing import NDArray
from scenarios import LOAD_CELL, load_cell, with_zero_reference
from worlds_drawn import World

from wrist_ft_comp.signals import AXES, Recording, Samples
from wrist_ft_comp.stream.batch_grid import grid_samples

IMU = LOAD_CELL.parents[1] / 'imu_chamber' / 'imu_chamber.csv'
CREDITS = {
    'load cell': 'load cell: hmd83, TANEN project, CC BY 4.0',
    'six axes': 'six axes: inertial sensor, Copyright (c) 2024 tofupilot, MIT',
}
#: Learnt on rows from 1 up to one of these, judged on the rest.
SPLITS = (6180, 4800, 5400, 5900, 6400, 6600, 7200)
_COLUMNS = (*(f'imu.acc.{axis}' for axis in 'xyz'), *(f'imu.gyro.{axis}' for axis in 'xyz'))


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
    """Learn on the first 20 h, judge on the rest; None where the file is not."""
    both = load_cell()
    if both is None:
        return None
    return World([both[0]], both[1], np.zeros_like(both[1].wrench), 'constant')
