"""
A payload from a minute of motion: one body, with the drift off already, and so a constant level.

A minute holds a few poses only, and a contact may last for all of one. A fit to all cells would
begin with a contact taken for weight, so the start is the best of many fits to a few cells each,
by what it says of directions, not of time. From there on a minute is separated as a day is.
"""

from dataclasses import dataclass, replace

import numpy as np

from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.payload.cells import Cells, FASTEST
from wrist_ft_comp.payload.directions import fit_norm, turning_speed
from wrist_ft_comp.payload.gains import bodies_of, COUNTS, Fit, rescaled
from wrist_ft_comp.payload.rigid_body import CONTRAST
from wrist_ft_comp.payload.states import fit_again
from wrist_ft_comp.payload.weight import ForceFrame, Payload
from wrist_ft_comp.signals import AXES, FloatArray, FORCE_CHANNELS, GRAVITY

#: Channels of a cell: wrench less drift, specific force, and speed of rotation.
CHANNELS = len(AXES) + len(FORCE_CHANNELS) + 1
#: A minute tells by at least as many cells, and this share of them has to be free of contact.
_LEAST_CELLS, _LEAST_FREE = 40, 0.4
#: Numbers beyond are no wrench and no acceleration, N, N m and m/s²; norms below no gravity's.
_LARGEST, _LEAST_NORM = 1e6, 0.5
#: The accelerometer is as a calibration found it while its norm is within this share of gravity.
_AS_FOUND = 0.02
#: The start is the best of as many fits.
_DRAWS = 300
#: Cells of a fit, one more than it has unknowns per axis.
_DRAWN_CELLS = 5
#: Holds a fit against large gains where its cells are of one direction.
_RIDGE = 1e-3
#: Cells whose directions are nearer, rad, are of one pose, whose length does not count.
_ONE_POSE = 0.2
#: Torques count by a lever of 0.1 m; errors below the last, N, are none of a contact.
_LEVERS, _FINE = np.repeat([1.0, 0.1], 3), 0.1


@dataclass(frozen=True, eq=False)
class Identified:
    """What was found, and the share of the time that was in contact, and that turned too fast."""

    payload: Payload
    frame: ForceFrame
    contact: float
    fast: float


def identify(cells: FloatArray, period_s: float, sensor: ForceFrame | None) -> Identified:
    """
    Find the payload in a minute of motion.

    Parameters
    ----------
    cells : ndarray, shape (n, CHANNELS)
        Means in order of time: N and N m, m/s² as measured, and rad/s, or NaN where nobody knows.
    period_s : float
        Length of a cell, s.
    sensor : ForceFrame or None
        Bias and scale of the accelerometer as a calibration found them. They are found in the
        minute where there are none, or where they do not make gravity of what was measured.

    Raises
    ------
    CalibrationRefusedError
        When motion or wrenches do not tell; it says what to do.

    """
    wrench, force, speed = cells[:, : len(AXES)], cells[:, len(AXES) : -1], cells[:, -1]
    real = np.all(np.abs(cells[:, :-1]) < _LARGEST, axis=1)
    felt = np.where(real[:, np.newaxis], force, 0.0)
    turned = np.where(np.isnan(speed), turning_speed(felt, period_s)[: len(felt)], speed)
    slow = real & (np.linalg.norm(felt, axis=1) > _LEAST_NORM) & (turned < FASTEST)
    if slow.sum() < _LEAST_CELLS:
        raise CalibrationRefusedError(
            f'The tool turned slower than {FASTEST:g} rad/s for {slow.sum() * period_s:.0f} s '
            f'only, as far as wrench and gravity were felt; at least '
            f'{_LEAST_CELLS * period_s:.0f} s are needed. Move more slowly, or rest in every '
            'pose, and look whether the specific force is about 9.8 m/s² at rest.'
        )
    wrench, force = wrench[slow], force[slow]
    fitted, _, scale = fit_norm(force, np.empty((len(force), 0)))
    if sensor is not None:
        norm = float(np.median(np.linalg.norm(sensor.turn(force), axis=1)))
        sensor = sensor if abs(norm / GRAVITY - 1) < _AS_FOUND else None
    frame = fitted if sensor is None else replace(sensor, rotation=np.eye(3))
    felt = frame.turn(force)
    everywhere = np.ones((1, len(felt)), dtype=bool)
    separated = Cells(wrench[np.newaxis], felt[np.newaxis], everywhere, powers=1)
    fit = fit_again(separated, _start(separated))
    found = bodies_of(separated, fit, scale if sensor is None else None)
    free = float((fit.weights > COUNTS).mean())
    if free < _LEAST_FREE and found.contrast[1] > CONTRAST:
        raise CalibrationRefusedError(
            f'In {1 - free:.0%} of the time the wrench did not follow gravity; at least '
            f'{_LEAST_FREE:.0%} have to be free. Move without contact, and look whether gravity '
            'is of this sensor.'
        )
    if doubts := found.doubts():
        raise CalibrationRefusedError(doubts[0])
    frame = replace(frame, rotation=found.rotation)
    return Identified(found.payload(0), frame, 1 - free, 1 - float(slow.mean()))


def _start(cells: Cells) -> Fit:
    """Of fits to a few cells each, take the one that is right about most directions."""
    force, wrench = cells.force[0], cells.wrench[0]
    x = np.column_stack((np.ones(len(force)), force))
    up = force / np.linalg.norm(force, axis=1, keepdims=True)
    rare = 1 / np.sum(up @ up.T > np.cos(_ONE_POSE), axis=1)
    rare /= rare.sum()
    drawn = np.random.default_rng(0).choice(len(x), (_DRAWS, _DRAWN_CELLS), p=rare)
    across = np.swapaxes(x[drawn], 1, 2)
    fits = np.linalg.solve(across @ x[drawn] + _RIDGE * np.eye(4), across @ wrench[drawn])
    errors = np.linalg.norm((wrench - x @ fits) / _LEVERS, axis=2)
    best = int(np.argmin(np.log(errors + _FINE) @ rare))
    level, gains = fits[best, 0], fits[best, 1:]
    weights = 1.0 * (errors[best] <= np.quantile(errors[best], _LEAST_FREE))[np.newaxis]
    states = np.zeros(weights.shape, dtype=np.int64)
    levels = np.broadcast_to(level, cells.wrench.shape)
    start = Fit(gains[np.newaxis], states, weights, levels, np.ones(len(AXES)))
    return rescaled(cells, start)
