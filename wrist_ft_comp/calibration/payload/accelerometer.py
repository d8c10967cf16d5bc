"""An accelerometer set right by its norm at rest, as far as the directions that it saw tell."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrist_ft_comp.calibration.payload.cells import rotation_speed
from wrist_ft_comp.model.payload.weight import ForceFrame
from wrist_ft_comp.model.signals import BoolArray, FloatArray, GRAVITY, noise_level, Recording

#: A specific force that does not change at all for so long, s, is no longer measured.
FROZEN_S = 1200
#: The wrench of a robot that moves jumps by so many times its noise, in this share of cells.
_JUMP, _JUMPY = 12.0, 0.01
#: Standing still, rad/s; what is expected of accelerometers: bias, m/s², per kelvin, and scale.
_STILL, _BIAS, _PER_KELVIN, _SCALE = 0.03, 0.3, 0.01, 0.03
#: Noise of a norm that is taken as independent, m/s², so that slow errors count for what they are.
_NORM_NOISE = 0.2


@dataclass(frozen=True, eq=False)
class Accelerometer:
    """
    What was found.

    Attributes
    ----------
    forces : list of ndarrays, shapes (N, 3)
        Specific force of every recording, set right, m/s²; NaN where it is missing or frozen.
    frame : ForceFrame
        Bias and scale at the mean temperature, without rotation.
    scale : ndarray, shape (3, 3)
        Covariance of the scale that is left, relative.

    """

    forces: list[FloatArray]
    frame: ForceFrame
    scale: FloatArray


def set_right(recordings: Sequence[Recording]) -> Accelerometer:
    """Find bias, what temperature adds to it, and scale of recordings that hold specific force."""
    force = np.concatenate([known_force(recording) for recording in recordings])
    known = np.isfinite(force).all(axis=1)
    temperature_c = np.concatenate([recording.temperature_c for recording in recordings])
    theta = temperature_c - temperature_c.mean(axis=0)
    still = known & (np.concatenate([rotation_speed(r) for r in recordings]) < _STILL)
    still = still if still.any() else known
    norm = np.median(np.linalg.norm(force[still], axis=1)) if still.any() else GRAVITY
    force = force * (GRAVITY / norm)
    found, covariance = _fit_norm(force[still], theta[still])
    bias, scale, drift = found[:3], found[3:6], found[6:].reshape(-1, 3)
    right = (force - bias - theta @ drift) * (1 - scale)
    ends = np.cumsum([len(recording) for recording in recordings])[:-1]
    frame = ForceFrame(bias=bias * norm / GRAVITY, scale=norm / GRAVITY / (1 - scale))
    return Accelerometer(np.split(right, ends), frame, covariance[3:6, 3:6])


def _fit_norm(force: FloatArray, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Fit bias, scale and bias per kelvin to the norm at rest: values (P,) and covariance."""
    thermometers = theta.shape[1]
    widths = np.repeat([_BIAS, _SCALE, *[_PER_KELVIN] * thermometers], 3)
    prior = np.diag(widths**2)
    # Half of a scale's variance is common to all axes.
    prior[3:6, 3:6] = _SCALE**2 * (np.eye(3) + 1) / 2
    found, covariance = np.zeros(len(prior)), prior
    weights = np.ones(len(force))
    for _ in range(6 * bool(len(force))):
        bias, scale, drift = found[:3], found[3:6], found[6:].reshape(-1, 3)
        right = (force - bias - theta @ drift) * (1 - scale)
        norm = np.linalg.norm(right, axis=1, keepdims=True)
        n = right / norm
        warm = [n * theta[:, [j]] for j in range(thermometers)]
        x = np.concatenate((n, GRAVITY * n**2, *warm), axis=1)
        y = norm[:, 0] - GRAVITY + x @ found
        normal = (x * weights[:, None]).T @ x / _NORM_NOISE**2 + np.linalg.inv(prior)
        covariance = np.linalg.inv(normal)
        found = covariance @ (x.T @ (weights * y)) / _NORM_NOISE**2
        error = np.abs(y - x @ found)
        weights = 1 / (1 + (error / (4 * max(0.005, np.median(error)))) ** 2) ** 2
    return found, covariance


def known_force(recording: Recording) -> FloatArray:
    """Take the specific force, (N, 3), NaN where it stands still to the last digit for long."""
    force = recording.specific_force
    if force is None:
        return np.full((len(recording), 3), np.nan)
    return np.where(_frozen(force, recording)[:, None], np.nan, force)


def _frozen(force: FloatArray, recording: Recording) -> BoolArray:
    """Tell where a specific force (N, 3) stands still for FROZEN_S although the wrench jumps."""
    changes = np.append(True, np.any(np.diff(force, axis=0) != 0, axis=1))
    runs = np.cumsum(changes) - 1
    steps = np.abs(np.diff(recording.wrench, axis=0, prepend=recording.wrench[:1]))
    noise = np.array([noise_level([each]) for each in recording.wrench.T])
    cells, jumps = np.bincount(runs), np.bincount(runs, np.any(steps > _JUMP * noise, axis=1))
    frozen = (jumps > _JUMPY * cells) & (cells * recording.period_s >= FROZEN_S)
    return np.asarray(frozen[runs])
