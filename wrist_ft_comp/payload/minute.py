"""
A payload from a minute of motion: one body, with the drift off already, and so a constant level.

A minute is separated as a day is, by the same fit, but for its start. It holds a few poses only,
and a contact may last for all of one: begun as a day is, from a fit to all cells, 8 of 30 minutes
with contacts in 15 % of the time were refused instead of 2 (bench/identify.py). So the start is
the best of many fits to a few cells each, judged over directions, not over time.
"""

from dataclasses import dataclass, replace

import numpy as np

from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.payload.accelerometer import fit_norm
from wrist_ft_comp.payload.directions import turning_speed
from wrist_ft_comp.payload.gains import bodies_of, Cells, COUNTS, FASTEST, Fit, rescaled
from wrist_ft_comp.payload.rigid_body import CONTRAST
from wrist_ft_comp.payload.states import fit_again
from wrist_ft_comp.payload.weight import ForceFrame, Payload
from wrist_ft_comp.signals import AXES, FloatArray, FORCE_CHANNELS, GRAVITY

#: Channels of a cell: wrench less drift, specific force, and speed of rotation.
CHANNELS = len(AXES) + len(FORCE_CHANNELS) + 1
#: Fewest cells in which the tool turns slowly.
_LEAST_CELLS = 40
#: Share of these that has to be free of contact.
_LEAST_FREE = 0.4
#: Larger numbers are no wrench and no acceleration, N, N m and m/s².
_LARGEST = 1e6
#: Smaller norms are not those of gravity, m/s².
_LEAST_NORM = 0.5
#: The accelerometer is as a calibration found it while its norm is within this share of gravity.
_AS_FOUND = 0.02
#: Fits of which the best is the start.
_DRAWS = 300
#: Cells of a fit, one more than it has unknowns per axis.
_DRAWN_CELLS = 5
#: Ridge that keeps gains small where the cells of a fit are of one direction, m²/s⁴.
_RIDGE = 1e-3
#: Cells whose directions are nearer, rad, are of one pose; how long it lasted does not count.
_ONE_POSE = 0.2
#: Errors of torques count by a lever of 0.1 m.
_LEVERS = np.repeat([1.0, 0.1], 3)
#: Errors below this, N, are no contact's.
_FINE = 0.1


@dataclass(frozen=True, eq=False)
class Identified:
    """What was found in a minute."""

    payload: Payload
    frame: ForceFrame
    #: Share of the slow cells in contact, and of all cells that turned too fast.
    contact: float
    fast: float


def identify(cells: FloatArray, period_s: float, sensor: ForceFrame | None) -> Identified:
    """
    Find the payload in a minute of motion.

    Parameters
    ----------
    cells : ndarray, shape (n, CHANNELS)
        Means in order of time: N and N m, m/s² as measured, and rad/s, or NaN where unknown.
    period_s : float
        Length of a cell, s.
    sensor : ForceFrame or None
        Bias and scale of the accelerometer as a calibration found them. Without them, or where
        the norm that they give is not gravity's, they are found in the minute.

    Raises
    ------
    CalibrationRefusedError
        Where motion or wrenches do not tell a payload.

    """
    wrench, force, speed = cells[:, : len(AXES)], cells[:, len(AXES) : -1], cells[:, -1]
    sane = np.all(np.abs(cells[:, :-1]) < _LARGEST, axis=1)
    felt = np.where(sane[:, np.newaxis], force, 0.0)
    turned = np.where(np.isnan(speed), turning_speed(felt, period_s)[: len(felt)], speed)
    slow = sane & (np.linalg.norm(felt, axis=1) > _LEAST_NORM) & (turned < FASTEST)
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
    usable = np.ones((1, len(felt)), dtype=bool)
    block = Cells(wrench[np.newaxis], felt[np.newaxis], usable, powers=1)
    fit = fit_again(block, _start(block))
    found = bodies_of(block, fit, scale if sensor is None else None)
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
    rarity = 1 / np.sum(up @ up.T > np.cos(_ONE_POSE), axis=1)
    rarity /= rarity.sum()
    drawn = np.random.default_rng(0).choice(len(x), (_DRAWS, _DRAWN_CELLS), p=rarity)
    across = np.swapaxes(x[drawn], 1, 2)
    fits = np.linalg.solve(across @ x[drawn] + _RIDGE * np.eye(4), across @ wrench[drawn])
    errors = np.linalg.norm((wrench - x @ fits) / _LEVERS, axis=2)
    best = int(np.argmin(np.log(errors + _FINE) @ rarity))
    level, gains = fits[best, 0], fits[best, 1:]
    weights = 1.0 * (errors[best] <= np.quantile(errors[best], _LEAST_FREE))[np.newaxis]
    states = np.zeros(weights.shape, dtype=np.int64)
    levels = np.broadcast_to(level, cells.wrench.shape)
    start = Fit(gains[np.newaxis], states, weights, levels, np.ones(len(AXES)))
    return rescaled(cells, start)
