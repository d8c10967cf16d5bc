"""Bias and scale of the accelerometer, fitted to its norm at rest in the poses it was in."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrist_ft_comp.channels import GRAVITY
from wrist_ft_comp.payload.specific_force_motion import rotation_speed
from wrist_ft_comp.payload.weight import ForceFrame
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import BoolArray, differ, FloatArray, noise_level, robust_weight

#: An IMU is frozen that gives the same value for this time, s, ...
FROZEN_S = 1200
#: ... while the wrench jumps, as that of a moving robot does, by this many times its noise ...
_JUMP_SIGMA = 12.0
#: ... in this share of the cells.
_JUMPING_SHARE = 0.01
#: A sensor that turns more slowly is at rest, rad/s.
_REST_RAD_S = 0.03
#: Expected bias of an accelerometer, m/s².
_BIAS = 0.3
#: Expected change of the bias, m/s² per kelvin.
_BIAS_PER_K = 0.01
#: Expected error of the scale, relative.
_SCALE = 0.03
#: No bias is as large as this share of gravity. Samples whose norm differs from the median by more
#: are left out; a recording whose norm differs so from that of the newest one is in another unit.
_OUTLIER_SHARE = 0.3
#: Noise of a norm, m/s². It is far above that of an IMU, because errors of neighbouring samples
#: are alike, and a recording would else seem to determine bias and scale exactly.
_NORM_NOISE = 0.2
#: Width of the robust weight of a norm, in median errors.
_WIDTH = 4
#: Least median error, m/s².
_LEAST_ERROR = 0.005
#: Rounds of the fit to norms.
_ROUNDS = 6


@dataclass(frozen=True, eq=False)
class Accelerometer:
    """Specific force, corrected by what the norm at rest shows."""

    #: Corrected, m/s², (N, 3) per recording; NaN where it is missing or frozen.
    forces: list[FloatArray]
    #: Bias and scale at the mean temperature, without a rotation.
    frame: ForceFrame
    #: Relative covariance of what is left of the scale's error, shape (3, 3).
    scale: FloatArray


def calibrated_by_norm(recordings: Sequence[Recording]) -> Accelerometer:
    """Fit bias, its change with temperature, and scale; every recording holds specific force."""
    force = np.concatenate(_in_one_unit([known_force(recording) for recording in recordings]))
    finite = np.all(np.isfinite(force), axis=1)
    temperature_c = np.concatenate([recording.temperature_c for recording in recordings])
    theta = temperature_c - temperature_c.mean(axis=0)
    rest = finite & (np.concatenate([rotation_speed(r) for r in recordings]) < _REST_RAD_S)
    rest = rest if rest.any() else finite
    frame, drift, covariance = fit_norm(force[rest], theta[rest])
    corrected = (force - frame.bias - theta @ drift) / frame.scale
    ends = np.cumsum([len(recording) for recording in recordings])[:-1]
    return Accelerometer(np.split(corrected, ends), frame, covariance)


def fit_norm(force: FloatArray, theta: FloatArray) -> tuple[ForceFrame, FloatArray, FloatArray]:
    """
    Fit bias, scale and bias per kelvin to the norm at rest.

    Takes specific force as measured, m/s², (n, 3), and temperatures less their mean, K, (n, J).
    Gives a frame without rotation, the bias per kelvin, (J, 3), and the relative covariance of
    what is left of the scale's error, (3, 3).
    """
    norms = np.linalg.norm(force, axis=1)
    common = (float(np.median(norms)) if len(force) else 0.0) / GRAVITY or 1.0
    near = np.abs(norms - common * GRAVITY) < _OUTLIER_SHARE * common * GRAVITY
    force, theta = force[near], theta[near]
    thermometers = theta.shape[1]
    widths = np.repeat([_BIAS, _SCALE, *[_BIAS_PER_K] * thermometers], 3)
    prior = np.diag(widths**2)
    # Half of a scale's variance is common to all axes.
    prior[3:6, 3:6] = _SCALE**2 * (np.eye(3) + 1) / 2
    found, covariance = np.zeros(len(prior)), prior
    weights: FloatArray = np.ones(len(force))
    for _ in range(_ROUNDS if len(force) else 0):
        bias, scale, drift = found[:3], found[3:6], found[6:].reshape(-1, 3)
        corrected = (force / common - bias - theta @ drift) * (1 - scale)
        norm = np.linalg.norm(corrected, axis=1, keepdims=True)
        n = corrected / norm
        warm = [n * theta[:, [j]] for j in range(thermometers)]
        x = np.concatenate((n, GRAVITY * n**2, *warm), axis=1)
        y = norm[:, 0] - GRAVITY + x @ found
        normal = (x * weights[:, None]).T @ x / _NORM_NOISE**2 + np.linalg.inv(prior)
        covariance = np.linalg.inv(normal)
        found = covariance @ (x.T @ (weights * y)) / _NORM_NOISE**2
        error = np.abs(y - x @ found)
        weights = robust_weight((error / (_WIDTH * max(_LEAST_ERROR, np.median(error)))) ** 2)
    frame = ForceFrame(bias=found[:3] * common, scale=common / (1 - found[3:6]))
    return frame, found[6:].reshape(-1, 3) * common, covariance[3:6, 3:6]


def known_force(recording: Recording) -> FloatArray:
    """Specific force as measured, (N, 3); NaN where it is missing or frozen."""
    force = recording.specific_force
    if force is None:
        return np.full((len(recording), 3), np.nan)
    return np.where(_frozen(force, recording)[:, None], np.nan, force)


def _in_one_unit(forces: Sequence[FloatArray]) -> list[FloatArray]:
    """Convert specific forces, (N, 3), to the unit of the newest, which the node receives."""
    norms = [np.linalg.norm(force[np.isfinite(force[:, 0])], axis=1) for force in forces]
    usual = [float(np.median(norm)) if len(norm) else np.nan for norm in norms]
    newest = next((norm for norm in reversed(usual) if norm > 0), np.nan)
    shares = [norm / newest for norm in usual]
    return [
        force / share if abs(share - 1) > _OUTLIER_SHARE and share > 0 else force
        for force, share in zip(forces, shares, strict=True)
    ]


def _frozen(force: FloatArray, recording: Recording) -> BoolArray:
    """Mark where a specific force, (N, 3), does not change for FROZEN_S, but the wrench jumps."""
    changes = np.append(True, np.any(differ(force[1:], force[:-1]), axis=1))
    runs = np.cumsum(changes) - 1
    steps = np.abs(np.diff(recording.wrench, axis=0, prepend=recording.wrench[:1]))
    noise = np.array([noise_level([axis]) for axis in recording.wrench.T])
    jumped = np.any(steps > _JUMP_SIGMA * noise, axis=1)
    cells, jumps = np.bincount(runs), np.bincount(runs, jumped)
    frozen = (jumps > _JUMPING_SHARE * cells) & (cells * recording.period_s >= FROZEN_S)
    return np.asarray(frozen[runs])
