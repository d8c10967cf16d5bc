"""
Fit rigid bodies to gains of specific force, (6, 3).

Those of a body are [-m R; -m [c]× R]: mass m, centre of mass c, and the rotation R from the frame
of the specific force to that of the wrench, which all bodies share. A direction counts by how well
it is known. Each axis of the sensor may have a gain error of its own, of about _SENSOR_GAIN.
"""

from dataclasses import dataclass

import numpy as np
import scipy  # which loads its parts when they are used

from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.payload.weight import FARTHEST_M, MOST_KG, Payload
from wrist_ft_comp.series import BoolArray, FloatArray, IntArray, ROUNDING

#: Least mass of a payload, kg.
LIGHTEST_KG = 0.02
#: Largest share of the weight, and of the changes between poses, that rigid bodies may leave
#: unexplained. Ordinary days had up to 0.01 of the changes, a day in contact for 0.9 of the time
#: 0.16: half of it finds the same days, twice of it overlooks that one.
MISFIT = 0.1
#: Above this share of changes between poses that do not turn with the specific force, no payload
#: is identified, and above three times this share nothing is learnt at all. Poses in a cone of 30°
#: reach 0.59 on drawn days that are well.
_MOST_UNEXPLAINED = 0.2
#: Standard error of the gain of a sensor's axis, by its own calibration.
_SENSOR_GAIN = 0.01
#: Torques are compared with forces at this lever, m: where a tool's centre of mass is.
LEVER_M = 0.1
#: How far gravity has to move along the second direction, m/s² RMS, to determine a rotation.
CONTRAST = 0.3


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

    def named(self, states: IntArray) -> dict[str, Payload]:
        """Name those in the states of free cells, (n,), by numbers, the lightest first."""
        shares = [float(np.mean(states == k)) for k in range(len(self.mass_kg))]
        mounted = self.tangible & (np.array(shares) > 0)
        order = [int(k) for k in np.argsort(self.mass_kg) if mounted[k]]
        return {str(n): self.payload(k, shares[k]) for n, k in enumerate(order, 1)}

    def payload(self, number: int, share: float = np.nan) -> Payload:
        """Make a payload of one body, with the share of the time in which it was mounted."""
        mass_kg, error_kg = float(self.mass_kg[number]), float(self.mass_error_kg[number])
        center = self.center_m[number], error_kg, self.center_error_m[number]
        return Payload(mass_kg, *center, share)

    def doubts(self, unexplained: float = 0.0) -> list[str]:
        """
        Say in sentences why no payload can be identified; empty where it can.

        Takes the share of changes between poses that do not turn with the specific force.
        CalibrationRefusedError where nothing at all can be learnt.
        """
        what = ''
        if self.contrast[0] >= CONTRAST and unexplained > _MOST_UNEXPLAINED:
            what = (
                f'{unexplained:.0%} of the changes between poses do not follow gravity; at most '
                f'{_MOST_UNEXPLAINED:.0%} are allowed. The specific force is of another frame or '
                'of another clock than the wrench, or a cable pulls.'
            )
        if what and unexplained > 3 * _MOST_UNEXPLAINED:
            raise CalibrationRefusedError(
                f'{what} Neither payload nor drift can be learnt. Record the specific force of a '
                'frame fixed to the sensor, by its clock.'
            )
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
        doubts = [f'No payload can be identified: {reason}.' for reason in reasons]
        return [f'{what} No payload was identified.', *doubts] if what else doubts


def rigid_bodies(
    gains: FloatArray, normal: FloatArray, spread: FloatArray, cells: float,
    scale: FloatArray | None = None,
) -> RigidBodies:  # fmt: skip
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
    start, mirrored = _start_rotation(gains, seen)
    sign = -1.0 if mirrored else 1.0
    ridge = 1e-9 * np.trace(normal) + ROUNDING
    roots = np.linalg.cholesky(normal + ridge * np.eye(3 * count)).T
    spread = np.maximum(spread, 1e-18 * np.mean(gains**2, axis=(0, 1)) + ROUNDING)

    def residual(values: FloatArray) -> FloatArray:
        """
        Compute the weighted errors of the gains, and those of the sensor's axes.

        The values, (9 + 4K,), are a rotation from the start, rad, the relative gain errors of the
        six axes, and mass and centre of every body.
        """
        rotation = start @ scipy.spatial.transform.Rotation.from_rotvec(values[:3]).as_matrix()
        expected = sign * (1 + values[3:9]) * gains_of(values[9:].reshape(count, 4), rotation)
        errors = roots @ (gains - expected).reshape(-1, 6) / np.sqrt(spread)
        return np.append(errors, values[3:9] / _SENSOR_GAIN)

    mass = -sign * np.einsum('kji,ij->k', gains[:, :, :3], start) / 3
    first = np.append(np.zeros(3 + 6), mass[:, None] * [1.0, 0.0, 0.0, 0.0])
    # Where no rigid body fits, thousands of steps more would change nothing.
    found = scipy.optimize.least_squares(residual, first, x_scale='jac', ftol=1e-12, max_nfev=300)
    # The second time, errors contain what no rigid body explains.
    errors = found.fun[:-6]
    roots = roots / np.sqrt(max(1.0, float(errors @ errors) / (len(errors) - 3 - 4 * count)))
    found = scipy.optimize.least_squares(residual, found.x, x_scale='jac', ftol=1e-12)
    covariance = np.linalg.pinv(found.jac.T @ found.jac, rcond=1e-12, hermitian=True)
    error = np.sqrt(np.diag(covariance))[9:].reshape(count, 4)
    bodies = found.x[9:].reshape(count, 4)
    rotation = start @ scipy.spatial.transform.Rotation.from_rotvec(found.x[:3]).as_matrix()
    # What only gain errors of the axes explain is no rigid body, either.
    unexplained = gains - sign * gains_of(bodies, rotation)
    if scale is not None:
        shares = np.diag(seen) / max(np.trace(seen), 1e-30)
        error[:, 0] = np.hypot(error[:, 0], bodies[:, 0] * np.sqrt(shares @ scale @ shares))
    traces = np.trace(seen_by_body, axis1=1, axis2=2)
    seen_by_body = seen_by_body / np.maximum(traces, 1e-30)[:, None, None]
    rest = np.einsum('kia,kij,kja,a->k', unexplained, seen_by_body, unexplained, 1 / spread)
    whole = np.einsum('kia,kij,kja,a->k', gains, seen_by_body, gains, 1 / spread)
    return RigidBodies(
        mass_kg=bodies[:, 0], mass_error_kg=error[:, 0],
        center_m=bodies[:, 1:], center_error_m=error[:, 1:],
        rotation=rotation, misfit=float(np.sqrt(rest.max() / max(whole.max(), ROUNDING))),
        mirrored=mirrored, contrast=np.sqrt(np.maximum(sizes[::-1], 0) / cells),
        unseen=rotation @ directions[:, 0])  # fmt: skip


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


def gains_of(bodies: FloatArray, rotation: FloatArray) -> FloatArray:
    """Compute gains, (K, 3, 6), of bodies, m and c, (K, 4), at a rotation: [-m R; -m [c]× R]."""
    torque = np.cross(bodies[:, None, 1:], rotation.T)  # columns of [c]× R, as rows
    force = np.broadcast_to(rotation.T, torque.shape)
    return np.asarray(-bodies[:, :1, None] * np.concatenate((force, torque), axis=-1))
