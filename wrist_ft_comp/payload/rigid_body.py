"""
Which rigid bodies weigh what gains of specific force say: numpy alone, for live and offline.

Gains, 6 numbers for each direction of the specific force, are [-m R; -m [c]× R] of a rigid body:
mass m, rotation R of the specific force's frame into the wrench's, which all bodies share, and
centre of mass c. They start from the polar factor of the force's block and the skew part of the
torque's, and are then fitted to all gains, each counting by how well it is known, so that a
direction that was never seen says nothing. Every axis of the sensor is allowed a gain of its own,
which is not known better than _SENSOR_GAIN, above all not at the temperatures of these days.
Standard errors hold that, and grow with what no rigid body explains.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrist_ft_comp.payload.weight import FARTHEST_M, MOST_KG, Payload
from wrist_ft_comp.signals import BoolArray, FloatArray

#: Contrast that the second direction of the specific force needs, m/s², for a rotation to be told.
CONTRAST = 0.3
#: No payload is told below this mass, kg, …
LIGHTEST_KG = 0.02
#: … or where more than this share of its weight is no rigid body's.
MISFIT = 0.1
#: Standard error of the gain of a sensor's axis, by its own calibration.
_SENSOR_GAIN = 0.01
#: Squares of contrasts, m²/s⁴, of wrenches, and of weights that are smaller are rounding errors.
_ROUNDING = 1e-12
#: Most steps of a fit, which ends when they are smaller, rad, kg and m.
_MOST_STEPS = 20
_SETTLED = 1e-10


@dataclass(frozen=True, eq=False)
class RigidBodies:
    """Rigid bodies behind K gains, with standard errors."""

    mass_kg: FloatArray
    mass_error_kg: FloatArray
    #: In the wrench's frame, shape (K, 3).
    center_m: FloatArray
    center_error_m: FloatArray
    #: From the frame of the specific force, (3, 3).
    rotation: FloatArray
    #: Contrasts of the worst body that no rigid body makes, as a share of the heaviest's, RMS.
    misfit: float
    #: Whether the specific force has the wrong sign, or a frame that no rotation leads to.
    mirrored: bool
    #: Of the specific force, m/s², along its principal directions, largest first.
    contrast: FloatArray
    #: Direction in which gravity moved least, in the wrench's frame.
    unseen: FloatArray

    @property
    def tangible(self) -> BoolArray:
        """Whether there is a body, (K,): a mass beyond its error, not far from the sensor."""
        weighs = self.mass_kg > np.maximum(LIGHTEST_KG, 3 * self.mass_error_kg)
        weighs &= self.mass_kg < MOST_KG
        return np.asarray(weighs & (np.abs(self.center_m) < FARTHEST_M).all(axis=1))

    def payload(self, number: int, share: float = np.nan) -> Payload:
        """Take one body, and the share of the time in which it was mounted."""
        mass_kg, error_kg = float(self.mass_kg[number]), float(self.mass_error_kg[number])
        center = self.center_m[number], error_kg, self.center_error_m[number]
        return Payload(mass_kg, *center, share)

    def doubts(self) -> list[str]:
        """Say in sentences why no payload can be told; empty where all can."""
        if self.contrast[1] < CONTRAST:
            seen = ', '.join(f'{contrast:.2f}' for contrast in self.contrast)
            axis = 'xyz'[int(np.argmax(np.abs(self.unseen)))]
            missing = (
                f'gravity moved by {seen} m/s² along three directions of the sensor, where two '
                f'need {CONTRAST}; tilt the tool by 20° or more, for it to move along {axis}, too'
            )
            reasons = [missing]
        elif not self.tangible.any():
            reasons = ['nothing weighs on the sensor; the driver may subtract its payload itself']
        else:
            mirrored = 'the specific force is mirrored; its sign is wrong, or two axes are swapped'
            crooked = (
                f"{self.misfit:.0%} of the weight is no rigid body's, where {MISFIT:.0%} are "
                'allowed; crosstalk, a wrong frame of the specific force, or a cable'
            )
            reasons = [mirrored] * self.mirrored + [crooked] * (self.misfit > MISFIT)
        return [f'No payload can be told: {reason}.' for reason in reasons]


@dataclass(frozen=True, eq=False)
class _Problem:
    """What is fitted: gains, and how well each is known."""

    #: Shape (K, 3, 6), kg and kg m.
    gains: FloatArray
    #: Square root of their weights, shape (3K, 3K).
    roots: FloatArray
    #: Variance of an axis, shape (6,).
    spread: FloatArray
    #: Sign of the specific force: -1 where it is mirrored.
    sign: float

    def residual(self, values: FloatArray, rotation: FloatArray) -> FloatArray:
        """Weigh what is left at small turns (…, 3), the axes' gains (…, 6) and m, c of bodies."""
        shape, axis_gains = values.shape[:-1], values[..., 3:9]
        turned = rotation @ small_rotation(values[..., :3])
        expected = _gains_of(values[..., 9:], turned)
        expected = self.sign * (1 + axis_gains[..., None, None, :]) * expected
        left = self.roots @ (self.gains - expected).reshape(*shape, -1, 6) / np.sqrt(self.spread)
        return np.concatenate((left.reshape(*shape, -1), axis_gains / _SENSOR_GAIN), axis=-1)

    def slopes(self, values: FloatArray, rotation: FloatArray) -> FloatArray:
        """Differentiate the residual by the values."""
        moves = 1e-6 * np.eye(len(values))
        ahead, back = (self.residual(values + move, rotation) for move in (moves, -moves))
        return np.asarray((ahead - back).T / 2e-6)

    def settle(self, values: FloatArray, rotation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Fit by Gauss-Newton steps; the turn goes into the rotation."""
        for _ in range(_MOST_STEPS):
            slopes = self.slopes(values, rotation)
            step = np.linalg.lstsq(slopes, self.residual(values, rotation), rcond=1e-9)[0]
            values = values - step
            rotation = rotation @ small_rotation(values[:3])
            values[:3] = 0.0
            if np.max(np.abs(step)) < _SETTLED:
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
    Find the rigid bodies behind gains (K, 3, 6) of specific force, kg and kg m.

    ``normal`` (3K, 3K) are products of specific forces, levels taken out, ``cells`` is the sum of
    their weights. The covariance of gains is spread (6,) times the inverse of normal; scale (3, 3)
    is the covariance that is left of the accelerometer's scale.
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
    for _ in range(2):  # the second time with errors that hold what no rigid body explains
        problem = _Problem(gains, roots, spread, sign)
        values, rotation = problem.settle(values, rotation)
        left = problem.residual(values, rotation)[:-6]
        roots = roots / np.sqrt(max(1.0, float(left @ left) / (len(left) - 3 - 4 * count)))
    problem = _Problem(gains, roots, spread, sign)
    slopes = problem.slopes(values, rotation)
    covariance = np.linalg.pinv(slopes.T @ slopes, rcond=1e-12, hermitian=True)
    error = np.sqrt(np.diag(covariance))[9:].reshape(count, 4)
    bodies = values[9:].reshape(count, 4)
    # Without the axes' gains: what only they explain is no rigid body's, either.
    strange = gains - sign * _gains_of(values[9:], rotation)
    if scale is not None:
        shares = np.diag(seen) / max(np.trace(seen), 1e-30)
        error[:, 0] = np.hypot(error[:, 0], bodies[:, 0] * np.sqrt(shares @ scale @ shares))
    traces = np.trace(seen_by_body, axis1=1, axis2=2)
    seen_by_body = seen_by_body / np.maximum(traces, 1e-30)[:, None, None]
    left, whole = (
        np.einsum('kia,kij,kja,a->k', part, seen_by_body, part, 1 / spread)
        for part in (strange, gains)
    )
    misfit = float(np.sqrt(left.max() / max(whole.max(), _ROUNDING)))
    found = bodies[:, 0], error[:, 0], bodies[:, 1:], error[:, 1:], rotation, misfit, mirrored
    contrast = np.sqrt(np.maximum(sizes[::-1], 0) / cells)
    return RigidBodies(*found, contrast, rotation @ directions[:, 0])


def information(
    contrast: FloatArray, rest: FloatArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """
    Tell how well gains are known: normal matrix (C, C), and its divisor per axis (A,).

    Given are specific force less its level (n, B, C), what the fit leaves (n, B, A), and weights
    (n, B). The errors of a block are taken to depend on one another, those of others not.
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
    return whole.reshape(-1, length, *values.shape[1:])


def small_rotation(vector: FloatArray) -> FloatArray:
    """Turn by vectors (…, 3), rad, as Rodrigues does: (…, 3, 3)."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    skew = np.cross(np.eye(3), vector[..., None, :])
    # np.sinc(x) is sin(π x) / (π x), and one at 0
    first, half = np.sinc(angle / np.pi), np.sinc(angle / 2 / np.pi)
    return np.asarray(np.eye(3) + first * skew + half**2 / 2 * skew @ skew)


def _start_rotation(gains: FloatArray, seen: FloatArray) -> tuple[FloatArray, bool]:
    """Find the polar factor of what was seen of the force's blocks, and whether it mirrors."""
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
    """Gains (…, K, 3, 6) of rigid bodies, m and c of each (…, 4K), at rotations (…, 3, 3)."""
    bodies = bodies.reshape(*bodies.shape[:-1], -1, 1, 4)
    mass, center = bodies[..., :1], bodies[..., 1:]
    force = np.swapaxes(rotation, -1, -2)[..., None, :, :]
    torque = np.cross(center, force)  # columns of [c]× R, as rows
    wrench = np.concatenate((np.broadcast_to(force, torque.shape), torque), axis=-1)
    return np.asarray(-mass * wrench)
