"""
Identify one payload in a minute of motion, from which the drift was subtracted before.

A minute is separated as a day is, but it holds a few poses, and a contact may last for the whole
of one. So the start is the best of many fits to a few cells each, by the poses that it explains.
"""

from dataclasses import replace

import numpy as np

from wrist_ft_comp.channels import AXES, FORCE_CHANNELS, GRAVITY, LARGEST
from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.payload import mounted_payloads
from wrist_ft_comp.payload.accelerometer_calibration import fit_norm, OUTLIER_SHARE, turning_speed
from wrist_ft_comp.payload.mass_and_center import CONTRAST, LEVER_M
from wrist_ft_comp.payload.motion_collector import CALM_RAD_S
from wrist_ft_comp.payload.mounted_payloads import Cells, COUNTS, FASTEST, Fit
from wrist_ft_comp.payload.weight import ForceFrame, Payload, SAME_SHARE
from wrist_ft_comp.series import FloatArray

#: Numbers in a cell: wrench less drift, specific force, and speed of rotation.
CHANNELS = len((*AXES, *FORCE_CHANNELS, 'rotation_speed'))
#: Shortest time in which the tool turns slowly, s.
_LEAST_SLOW_S = 10.0
#: Least share of these cells that has to be free of contact.
LEAST_FREE = 0.4
#: Fits of which the best one is the start.
_DRAWS = 300
#: Cells whose directions differ by less, rad, are of one pose.
_ONE_POSE_RAD = 0.2
#: Smaller errors, N, are noise; which fit has the smallest ones does not count.
_NOISE_N = 0.1


def identify(
    cells: FloatArray, period_s: float, sensor: ForceFrame | None
) -> tuple[Payload, ForceFrame]:
    """
    Identify the payload in a minute of motion; CalibrationRefusedError where it is not determined.

    Cells, (n, CHANNELS), are means over ``period_s``, s, in order of time: N and N m, m/s² as
    measured, and rad/s, or NaN where unknown. ``sensor`` has bias and scale of the accelerometer
    by a calibration. Without it, or where the norm that it gives is not that of gravity, they are
    fitted to the minute. Of a sensor whose torques are all NaN, the centre of mass is zero.
    """
    if np.isnan(cells[:, 3:6]).all():  # of forces alone: their weight needs no centre of mass
        cells = np.hstack((cells[:, :3], np.zeros((len(cells), 3)), cells[:, 6:]))
    wrench, force, speed = cells[:, : len(AXES)], cells[:, len(AXES) : -1], cells[:, -1]
    finite = np.all(np.abs(cells[:, :-1]) < LARGEST, axis=1)
    force = np.where(finite[:, np.newaxis], force, 0.0)
    by_force = turning_speed(force, period_s)[: len(force)]
    speed = np.where(np.isnan(speed), by_force, speed)
    plausible = np.abs(np.linalg.norm(force, axis=1) / GRAVITY - 1) < OUTLIER_SHARE
    slow = finite & plausible & (speed < FASTEST)
    if slow.sum() * period_s < _LEAST_SLOW_S:
        raise CalibrationRefusedError(
            f'For {slow.sum() * period_s:.0f} s only did wrench and gravity arrive while the tool '
            f'turned slower than {FASTEST:g} rad/s (by TF {CALM_RAD_S:g}, also a second before); '
            f'at least {_LEAST_SLOW_S:.0f} s are needed. Move more slowly, or rest two seconds in '
            'every pose, and look whether the specific force at rest is about 9.8 m/s².'
        )
    wrench, force = wrench[slow], force[slow]
    fitted, _, scale = fit_norm(force, np.empty((len(force), 0)))
    if sensor is not None:
        norm = float(np.median(np.linalg.norm(sensor.turn(force), axis=1)))
        sensor = sensor if abs(norm / GRAVITY - 1) < SAME_SHARE else None
    frame = fitted if sensor is None else replace(sensor, rotation=np.eye(3))
    corrected = frame.turn(force)
    usable = np.ones((1, len(corrected)), dtype=bool)
    block = Cells(wrench[np.newaxis], corrected[np.newaxis], usable, powers=1)
    fit = mounted_payloads.fit_again(block, _start(block))
    found = mounted_payloads.bodies_of(block, fit, scale if sensor is None else None)
    free = float((fit.weights > COUNTS).mean())
    if free < LEAST_FREE and found.contrast[1] > CONTRAST:
        raise CalibrationRefusedError(
            f'In {1 - free:.0%} of the time the wrench did not follow gravity; at least '
            f'{LEAST_FREE:.0%} have to be free of contact. Move without contact, and look whether '
            'the accelerometer is that of this sensor.'
        )
    if doubts := found.doubts():
        raise CalibrationRefusedError(doubts[0])
    return found.payload(0), replace(frame, rotation=found.rotation)


def _start(cells: Cells) -> Fit:
    """Choose among fits to a few cells each the one that is right in most poses."""
    force, wrench = cells.force[0], cells.wrench[0]
    x = np.column_stack((np.ones(len(force)), force))
    up = force / np.linalg.norm(force, axis=1, keepdims=True)
    rarity = 1 / np.sum(up @ up.T > np.cos(_ONE_POSE_RAD), axis=1)
    rarity /= rarity.sum()
    # One cell more than a fit has unknowns per axis; a ridge keeps the gains of one pose small.
    unknowns = x.shape[1]
    drawn = np.random.default_rng(0).choice(len(x), (_DRAWS, unknowns + 1), p=rarity)
    across = np.swapaxes(x[drawn], 1, 2)
    fits = np.linalg.solve(across @ x[drawn] + 1e-3 * np.eye(unknowns), across @ wrench[drawn])
    # An error of a torque counts as that of a force at a lever.
    errors = np.linalg.norm((wrench - x @ fits) / np.repeat([1.0, LEVER_M], 3), axis=2)
    best = int(np.argmin(np.log(errors + _NOISE_N) @ rarity))
    weights = 1.0 * (errors[best] <= np.quantile(errors[best], LEAST_FREE))[np.newaxis]
    states = np.zeros(weights.shape, dtype=np.int64)
    levels = np.broadcast_to(fits[best, 0], cells.wrench.shape)
    start = Fit(fits[[best], 1:], states, weights, levels, np.ones(len(AXES)))
    return mounted_payloads.with_new_noise(cells, start)
