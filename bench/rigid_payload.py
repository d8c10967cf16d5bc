"""
Payload and drift together, second layer: which rigid bodies weigh what the first layer found.

The gains of a state, 6 numbers for each direction of the specific force, are [-m R; -m [c]× R]
of a rigid body: mass m, rotation R of the specific force's frame into the wrench's, which all
states share, and centre of mass c. They start from the polar factor of the force's block and the
skew part of the torque's, and are then fitted to all gains, each counting by how well it is known,
so that a direction that was never seen says nothing. Every axis of the sensor is allowed a gain of
its own, which is not known better than SENSOR_GAIN, above all not at the temperatures of these
days. Standard errors hold that, the scale of the accelerometer, and grow with what no rigid body
explains.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

from at_work_days import Observed
import numpy as np
from payload import information, pulled
from scipy.spatial.transform import Rotation

from wrist_ft_comp.model.signals import FloatArray

#: A second direction has to be seen, m/s² of its contrast, for a rotation to be known.
CONTRAST = 0.3
#: How well a sensor's own calibration is trusted, 1 for all.
SENSOR_GAIN = 0.01
#: No payload is told below this mass, or where this share of its weight is no rigid body's.
LIGHTEST_KG, MISFIT = 0.02, 0.1
#: Nor where this share of the contrast between poses does not turn with the specific force.
UNEXPLAINED = 0.2
ROUNDS = 20


@dataclass(frozen=True, eq=False)
class Rigid:
    """
    Rigid bodies of all states.

    Attributes
    ----------
    mass_kg, mass_error : ndarrays, shape (K,)
        With standard errors.
    center_m, center_error : ndarrays, shape (K, 3)
        In the wrench's frame.
    rotation : ndarray, shape (3, 3)
        From the frame of the specific force.
    misfit : float
        Share of the weight's contrasts, RMS, that no rigid body explains.
    mirrored : bool
        Whether the specific force has the wrong sign, or a frame that no rotation leads to.
    contrast : ndarray, shape (3,)
        Of the specific force within blocks, m/s², along its principal directions.

    """

    mass_kg: FloatArray
    mass_error: FloatArray
    center_m: FloatArray
    center_error: FloatArray
    rotation: FloatArray
    misfit: float
    mirrored: bool
    contrast: FloatArray


def payloads_of(observed: Observed) -> Rigid | None:
    """Find the rigid bodies of days at work; None where none can be told, or none is there."""
    found = bodies_of(observed)
    doubted = found.contrast[1] < CONTRAST or found.mirrored or found.misfit > MISFIT
    doubted = doubted or unexplained_contrast(observed) > UNEXPLAINED
    return None if doubted or weightless(found) else found


def unexplained_contrast(observed: Observed) -> float:
    """Share of the contrast between poses that no payload makes, in the median block."""
    cells, fit = observed.cells, observed.fit
    middle = np.median(cells.wrench, axis=1, keepdims=True)
    whole = np.linalg.norm((cells.wrench - middle) / fit.noise, axis=2)
    rest = np.linalg.norm((cells.wrench - fit.levels - pulled(cells, fit)) / fit.noise, axis=2)
    blocks = cells.usable.mean(axis=1) > 0.3
    if not blocks.any():
        return 0.0
    left, there = (
        np.nanmedian(np.where(cells.usable, each, np.nan)[blocks], axis=1)
        for each in (rest, whole)
    )
    return float(np.median(left / np.maximum(there, 1e-9)))


def weightless(found: Rigid) -> bool:
    """Tell whether nothing weighs on the sensor."""
    return bool((found.mass_kg < np.maximum(LIGHTEST_KG, 3 * found.mass_error)).all())


def bodies_of(observed: Observed) -> Rigid:
    """Find the rigid bodies of days at work, whether to be believed or not."""
    normal, spread = information(observed.cells, observed.fit)
    cells = float(observed.fit.weights.sum())
    found = rigid_bodies(observed.fit.gains, normal, spread, cells)
    own = np.einsum('kikj->ij', normal.reshape(*[len(found.mass_kg), 3] * 2))
    share = np.diag(own) / np.trace(own)
    error = np.hypot(found.mass_error, found.mass_kg * np.sqrt(share @ observed.scale @ share))
    return replace(found, mass_error=error)


def rigid_bodies(gains: FloatArray, normal: FloatArray, spread: FloatArray, cells: float) -> Rigid:
    """
    Find rigid bodies.

    Parameters
    ----------
    gains : ndarray, shape (K, 3, 6)
        Of specific force, kg and kg m.
    normal : ndarray, shape (3K, 3K)
        Products of specific forces, levels taken out.
    spread : ndarray, shape (6,)
        Of the gains: their covariance is this times the inverse of normal.
    cells : float
        Sum of the weights.

    Returns
    -------
    Rigid
        In the order of the gains.

    """
    count = len(gains)
    blocks = normal.reshape(count, 3, count, 3)
    own = np.sum([blocks[k, :, k] for k in range(count)], axis=0)
    contrast = np.sqrt(np.maximum(np.linalg.eigvalsh(own)[::-1], 0) / cells)
    roots = np.linalg.cholesky(normal + 1e-9 * np.trace(normal) * np.eye(3 * count)).T
    rotation, mirrored = start_rotation(gains, own)
    sign = -1.0 if mirrored else 1.0
    states = [start_body(each, rotation, sign) for each in gains]
    found = np.concatenate([np.zeros(3 + 6), *states])

    def rest(values: FloatArray, turned: FloatArray) -> FloatArray:
        own = values[3:9]
        off = gains - sign * (1 + own) * modelled(
            values[[0, 1, 2, *range(9, len(values))]], turned
        )
        left = roots @ off.reshape(3 * count, 6) / np.sqrt(spread)
        return np.concatenate((left.ravel(), own / SENSOR_GAIN))

    for _ in range(2):  # the second time with errors that hold what no rigid body explains
        for _ in range(ROUNDS):
            slopes = slopes_of(rest, found, rotation)
            found = found - np.linalg.lstsq(slopes, rest(found, rotation), rcond=1e-9)[0]
            rotation = rotation @ Rotation.from_rotvec(found[:3]).as_matrix()
            found[:3] = 0.0
        left = rest(found, rotation)[:-6]
        share = np.linalg.norm(left) / np.linalg.norm(rest(0 * found, rotation)[:-6])
        roots = roots / np.sqrt(max(1.0, float(left @ left) / (len(left) - 3 - 4 * count)))
    slopes = slopes_of(rest, found, rotation)
    covariance = np.linalg.pinv(slopes.T @ slopes, rcond=1e-12, hermitian=True)
    error = np.sqrt(np.diag(covariance))[9:].reshape(count, 4)
    bodies = found[9:].reshape(count, 4)
    return Rigid(
        bodies[:, 0],
        error[:, 0],
        bodies[:, 1:],
        error[:, 1:],
        rotation,
        float(share),
        mirrored,
        contrast,
    )


def start_rotation(gains: FloatArray, own: FloatArray) -> tuple[FloatArray, bool]:
    """Find the polar factor of what was seen of the force's blocks, and whether it mirrors."""
    values, directions = np.linalg.eigh(own)
    seen = directions * (values > 1e-4 * values[-1])
    block = -np.sum(gains[:, :, :3], axis=0).T @ seen @ seen.T
    left, sizes, right = np.linalg.svd(block)
    mirrored = bool(sizes[2] > 1e-6 * sizes[0] and np.linalg.det(left @ right) < 0)
    if mirrored:
        left = -left
    elif np.linalg.det(left @ right) < 0:
        left[:, 2] *= -1
    return left @ right, mirrored


def start_body(gains: FloatArray, rotation: FloatArray, sign: float) -> FloatArray:
    """Read mass and centre of mass off the gains of one state: m and c, (4,)."""
    force, torque = (-sign * gains[:, part].T @ rotation.T for part in (slice(3), slice(3, 6)))
    mass = max(float(np.trace(force)) / 3, 1e-6)
    skew = (torque - torque.T) / (2 * mass)
    return np.array([mass, skew[2, 1], skew[0, 2], skew[1, 0]])


def modelled(values: FloatArray, rotation: FloatArray) -> FloatArray:
    """Gains of rigid bodies, (K, 3, 6), for a small turn (3,) and m, c of each state."""
    turned = rotation @ Rotation.from_rotvec(values[:3]).as_matrix()
    blocks = []
    for mass, *center in values[3:].reshape(-1, 4):
        torque = np.cross(center, turned.T)  # columns of [c]× R, as rows
        blocks.append(-mass * np.concatenate((turned.T, torque), axis=1))
    return np.array(blocks)


def slopes_of(
    rest: Callable[[FloatArray, FloatArray], FloatArray], values: FloatArray, rotation: FloatArray
) -> FloatArray:
    """Differentiate what is left by the parameters."""
    step = 1e-6
    columns = []
    for at in range(len(values)):
        moved = np.zeros_like(values)
        moved[at] = step
        ahead, behind = rest(values + moved, rotation), rest(values - moved, rotation)
        columns.append((ahead - behind) / (2 * step))
    return np.stack(columns, axis=1)
