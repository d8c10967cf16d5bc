"""
Fit rigid bodies to gains of specific force; numpy alone.

The gains of a rigid body, 6 numbers for every direction of the specific force, are
[-m R; -m [c]× R]: mass m, centre of mass c, and the rotation R from the frame of the specific
force to that of the wrench, which all bodies share. The fit starts from the polar factor of the
block of forces. Every gain counts by how well it is known; in a direction that was never seen it
does not count at all. Each axis of the sensor may have a gain error of about _SENSOR_GAIN, because
the sensor's own calibration is no better, above all at the temperatures of these recordings. The
standard errors of the bodies contain that error, and grow with what no rigid body explains.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrist_ft_comp.payload.weight import FARTHEST_M, MOST_KG, Payload
from wrist_ft_comp.series import BoolArray, FloatArray

#: How far gravity has to move along the second direction, m/s² RMS, to determine a rotation.
CONTRAST = 0.3
#: Least mass of a payload, kg.
LIGHTEST_KG = 0.02
#: Largest share of the weight that a rigid body may leave unexplained.
MISFIT = 0.1
#: Standard error of the gain of a sensor's axis, by its own calibration.
_SENSOR_GAIN = 0.01
#: Smaller squares, of contrasts, m²/s⁴, of wrenches and of weights, are rounding errors.
_ROUNDING = 1e-12
#: Most steps of a fit.
_MOST_STEPS = 20
#: A fit ends with the first smaller step, rad, kg and m.
_SMALLEST_STEP = 1e-10


@dataclass(frozen=True, eq=False)
class RigidBodies:
    """The rigid bodies of K payload states, with standard errors."""

    #: Shape (K,).
    mass_kg: FloatArray
    mass_error_kg: FloatArray
    #: Centre of mass in the wrench's frame, shape (K, 3).
    center_m: FloatArray
    center_error_m: FloatArray
    #: From the frame of the specific force to that of the wrench, shape (3, 3).
    rotation: FloatArray
    #: Part of the weight that no rigid body explains, RMS: of the worst body, as a share of the
    #: heaviest.
    misfit: float
    #: Whether the specific force has the wrong sign, or swapped axes.
    mirrored: bool
    #: How far the specific force moved along its principal directions, m/s² RMS, largest first.
    contrast: FloatArray
    #: Direction along which gravity moved least, in the wrench's frame.
    unseen: FloatArray

    @property
    def tangible(self) -> BoolArray:
        """Whether a state is a body, (K,): its mass exceeds the error, its centre is not far."""
        weighs = self.mass_kg > np.maximum(LIGHTEST_KG, 3 * self.mass_error_kg)
        weighs &= self.mass_kg < MOST_KG
        return np.asarray(weighs & (np.abs(self.center_m) < FARTHEST_M).all(axis=1))

    def payload(self, number: int, share: float = np.nan) -> Payload:
        """Make a payload of one body, with the share of the time in which it was mounted."""
        mass_kg, error_kg = float(self.mass_kg[number]), float(self.mass_error_kg[number])
        center = self.center_m[number], error_kg, self.center_error_m[number]
        return Payload(mass_kg, *center, share)

    def doubts(self) -> list[str]:
        """Say in sentences why no payload can be identified; empty where it can."""
        if self.contrast[1] < CONTRAST:
            seen = ', '.join(f'{contrast:.2f}' for contrast in self.contrast)
            axis = 'xyz'[int(np.argmax(np.abs(self.unseen)))]
            missing = (
                f'gravity moved by {seen} m/s² along three directions of the sensor, and at least '
                f'{CONTRAST} are needed along two of them; tilt the tool by 20° or more, so that '
                f'gravity also moves along {axis}'
            )
            reasons = [missing]
        elif not self.tangible.any():
            reasons = ['nothing weighs on the sensor; the driver may subtract its payload itself']
        else:
            mirrored = 'the specific force is mirrored; its sign is wrong, or two axes are swapped'
            crooked = (
                f'{self.misfit:.0%} of the weight is not that of a rigid body, and at most '
                f'{MISFIT:.0%} are allowed; look for crosstalk of the sensor, a wrong frame of '
                'the specific force, or a cable that pulls'
            )
            reasons = [mirrored] * self.mirrored + [crooked] * (self.misfit > MISFIT)
        return [f'No payload can be identified: {reason}.' for reason in reasons]


@dataclass(frozen=True, eq=False)
class _Problem:
    """The gains that bodies are fitted to, and how well they are known."""

    #: Shape (K, 3, 6), kg and kg m.
    gains: FloatArray
    #: Square root of their weights, shape (3K, 3K).
    roots: FloatArray
    #: Variance of an axis, shape (6,).
    spread: FloatArray
    #: Sign of the specific force: -1 where it is mirrored.
    sign: float

    def residual(self, values: FloatArray, rotation: FloatArray) -> FloatArray:
        """
        Compute the weighted errors of the gains, and those of the sensor's axes.

        The values, (…, 9 + 4K), are a small rotation, rad, the relative gain errors of the six
        axes, and mass and centre of every body.
        """
        shape, axis_gains = values.shape[:-1], values[..., 3:9]
        turned = rotation @ small_rotation(values[..., :3])
        expected = _gains_of(values[..., 9:], turned)
        expected = self.sign * (1 + axis_gains[..., None, None, :]) * expected
        errors = self.roots @ (self.gains - expected).reshape(*shape, -1, 6) / np.sqrt(self.spread)
        return np.concatenate((errors.reshape(*shape, -1), axis_gains / _SENSOR_GAIN), axis=-1)

    def slopes(self, values: FloatArray, rotation: FloatArray) -> FloatArray:
        """Differentiate the residual by the values, (errors, values)."""
        moves = 1e-6 * np.eye(len(values))
        ahead, back = (self.residual(values + move, rotation) for move in (moves, -moves))
        return np.asarray((ahead - back).T / 2e-6)

    def settle(self, values: FloatArray, rotation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Fit by Gauss-Newton steps; gives the values, their rotation zero, and the rotation."""
        for _ in range(_MOST_STEPS):
            slopes = self.slopes(values, rotation)
            step = np.linalg.lstsq(slopes, self.residual(values, rotation), rcond=1e-9)[0]
            values = values - step
            rotation = rotation @ small_rotation(values[:3])
            values[:3] = 0.0
            if np.max(np.abs(step)) < _SMALLEST_STEP:
                break
        return values, rotation


def rigid_bodies(
    gains: FloatArray,
    normal: FloatArray,
    spread: FloatArray,
    cells: float,
    scale: FloatArray | None = None,
) -> RigidBodies:
    """
    Fit rigid bodies to gains, (K, 3, 6), of specific force, kg and kg m.

    ``normal``, (3K, 3K), are weighted products of the specific force, levels eliminated, and
    ``cells`` is the sum of the weights. The covariance of an axis' gains is its ``spread``, (6,),
    times the inverse of normal. ``scale``, (3, 3), is the relative covariance of the
    accelerometer's scale.
    """
    count = len(gains)
    by_body = normal.reshape(count, 3, count, 3)
    sizes, directions = np.linalg.eigh(np.einsum('kilj->ij', by_body))
    seen_by_body = np.einsum('kikj->kij', by_body)
    seen = seen_by_body.sum(axis=0)
    rotation, mirrored = _start_rotation(gains, seen)
    sign = -1.0 if mirrored else 1.0
    ridge = 1e-9 * np.trace(normal) + _ROUNDING
    roots = np.linalg.cholesky(normal + ridge * np.eye(3 * count)).T
    mass = -sign * np.einsum('kji,ij->k', gains[:, :, :3], rotation) / 3
    values = np.append(np.zeros(3 + 6), mass[:, None] * [1.0, 0.0, 0.0, 0.0])
    spread = np.maximum(spread, 1e-18 * np.mean(gains**2, axis=(0, 1)) + _ROUNDING)
    for _ in range(2):  # the second time, errors contain what no rigid body explains
        problem = _Problem(gains, roots, spread, sign)
        values, rotation = problem.settle(values, rotation)
        errors = problem.residual(values, rotation)[:-6]
        roots = roots / np.sqrt(max(1.0, float(errors @ errors) / (len(errors) - 3 - 4 * count)))
    problem = _Problem(gains, roots, spread, sign)
    slopes = problem.slopes(values, rotation)
    covariance = np.linalg.pinv(slopes.T @ slopes, rcond=1e-12, hermitian=True)
    error = np.sqrt(np.diag(covariance))[9:].reshape(count, 4)
    bodies = values[9:].reshape(count, 4)
    # What only gain errors of the axes explain is no rigid body, either.
    unexplained = gains - sign * _gains_of(values[9:], rotation)
    if scale is not None:
        shares = np.diag(seen) / max(np.trace(seen), 1e-30)
        error[:, 0] = np.hypot(error[:, 0], bodies[:, 0] * np.sqrt(shares @ scale @ shares))
    traces = np.trace(seen_by_body, axis1=1, axis2=2)
    seen_by_body = seen_by_body / np.maximum(traces, 1e-30)[:, None, None]
    rest, whole = (
        np.einsum('kia,kij,kja,a->k', part, seen_by_body, part, 1 / spread)
        for part in (unexplained, gains)
    )
    misfit = float(np.sqrt(rest.max() / max(whole.max(), _ROUNDING)))
    found = bodies[:, 0], error[:, 0], bodies[:, 1:], error[:, 1:], rotation, misfit, mirrored
    contrast = np.sqrt(np.maximum(sizes[::-1], 0) / cells)
    return RigidBodies(*found, contrast, rotation @ directions[:, 0])


def information(
    contrast: FloatArray, rest: FloatArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """
    Compute how well gains are known: the normal matrix, (C, C), and a variance per axis, (A,).

    Takes specific force less its level, (n, B, C), the residuals of the fit, (n, B, A), and the
    weights of the cells, (n, B). Errors within a block may depend on one another.
    """
    weighted = weights[..., None] * contrast
    normal = np.einsum('nbi,nbj->ij', weighted, contrast, optimize=True)
    scores = np.einsum('nbi,nba->nia', weighted, rest, optimize=True)
    spread = np.einsum('nia,nja->aij', scores, scores)
    inverse = np.linalg.pinv(normal, rcond=1e-6, hermitian=True)
    rank = max(1, np.linalg.matrix_rank(normal, tol=1e-6 * np.trace(normal), hermitian=True))
    return normal, np.einsum('ij,aji->a', inverse, spread) / rank


def blocks(values: NDArray[Any], length: int) -> NDArray[Any]:
    """Cut an array, (N, …) to (n, B, …); the last block is filled up with zeros."""
    empty = np.zeros((-len(values) % length, *values.shape[1:]), values.dtype)
    whole: NDArray[Any] = np.concatenate((values, empty))
    return whole.reshape(len(whole) // length, length, *values.shape[1:])


def small_rotation(vector: FloatArray) -> FloatArray:
    """Compute rotations, (…, 3, 3), from rotation vectors, (…, 3), rad, by Rodrigues' formula."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    skew = np.cross(np.eye(3), vector[..., None, :])
    # np.sinc(x) is sin(π x) / (π x), and one at 0
    first, half = np.sinc(angle / np.pi), np.sinc(angle / 2 / np.pi)
    return np.asarray(np.eye(3) + first * skew + half**2 / 2 * skew @ skew)


def _start_rotation(gains: FloatArray, seen: FloatArray) -> tuple[FloatArray, bool]:
    """Compute the polar factor of the force's blocks where it was seen, and whether it mirrors."""
    values, directions = np.linalg.eigh(seen)
    directions = directions * (values > 1e-4 * values[-1])
    block = -np.sum(gains[:, :, :3], axis=0).T @ directions @ directions.T
    left, sizes, right = np.linalg.svd(block)
    mirrored = bool(sizes[2] > 1e-6 * sizes[0] and np.linalg.det(left @ right) < 0)
    if mirrored:
        left = -left
    elif np.linalg.det(left @ right) < 0:
        left[:, 2] *= -1
    return left @ right, mirrored


def _gains_of(bodies: FloatArray, rotation: FloatArray) -> FloatArray:
    """Gains, (…, K, 3, 6), of bodies with m and c, (…, 4K), at rotations, (…, 3, 3)."""
    bodies = bodies.reshape(*bodies.shape[:-1], -1, 1, 4)
    mass, center = bodies[..., :1], bodies[..., 1:]
    force = np.swapaxes(rotation, -1, -2)[..., None, :, :]
    torque = np.cross(center, force)  # columns of [c]× R, as rows
    wrench = np.concatenate((np.broadcast_to(force, torque.shape), torque), axis=-1)
    return np.asarray(-mass * wrench)
