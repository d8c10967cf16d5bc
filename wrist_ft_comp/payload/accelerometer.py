"""An accelerometer set right by its norm at rest, as far as the directions that it saw tell."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrist_ft_comp.payload.directions import rotation_speed
from wrist_ft_comp.payload.weight import ForceFrame
from wrist_ft_comp.robust import robust_weight
from wrist_ft_comp.signals import BoolArray, FloatArray, GRAVITY, noise_level, Recording

#: A specific force that does not change at all for this time, s, is no longer measured …
FROZEN_S = 1200
#: … if the wrench jumps meanwhile as that of a robot that moves: by so many times its noise …
_JUMP = 12.0
#: … in this share of the cells.
_JUMPING_SHARE = 0.01
#: Standing still, rad/s.
_STILL = 0.03
#: Share by which a norm at rest is off the newest recording's where its unit is another one: no
#: bias is as large.
_OTHER_UNIT = 0.1
#: Bias that is expected of an accelerometer, m/s², its change per kelvin, and error of its scale.
_BIAS = 0.3
_BIAS_PER_K = 0.01
_SCALE = 0.03
#: A norm that is off by this share of the usual one says nothing of an accelerometer.
_FAR = 0.3
#: Noise of a norm that is taken as independent, m/s², so that slow errors count for what they are.
_NORM_NOISE = 0.2
#: Width of the robust weight of a norm, in median errors, and the least median error, m/s².
_WIDTH, _LEAST_ERROR = 4, 0.005
#: Rounds of the fit to norms.
_ROUNDS = 6


@dataclass(frozen=True, eq=False)
class Accelerometer:
    """What was found."""

    #: Of every recording, set right, m/s² (N, 3); NaN where it is missing or frozen.
    forces: list[FloatArray]
    #: Bias and scale at the mean temperature, without rotation.
    frame: ForceFrame
    #: Covariance of the scale that is left, relative, (3, 3).
    scale: FloatArray


def set_right(recordings: Sequence[Recording]) -> Accelerometer:
    """Find bias, what temperature adds to it, and scale of recordings that hold specific force."""
    force = np.concatenate(_in_one_unit([known_force(recording) for recording in recordings]))
    finite = np.all(np.isfinite(force), axis=1)
    temperature_c = np.concatenate([recording.temperature_c for recording in recordings])
    theta = temperature_c - temperature_c.mean(axis=0)
    still = finite & (np.concatenate([rotation_speed(r) for r in recordings]) < _STILL)
    still = still if still.any() else finite
    frame, drift, covariance = fit_norm(force[still], theta[still])
    right = (force - frame.bias - theta @ drift) / frame.scale
    ends = np.cumsum([len(recording) for recording in recordings])[:-1]
    return Accelerometer(np.split(right, ends), frame, covariance)


def fit_norm(force: FloatArray, theta: FloatArray) -> tuple[ForceFrame, FloatArray, FloatArray]:
    """
    Fit bias, scale and bias per kelvin to the norm at rest.

    Specific force as it was measured, m/s² (n, 3), and temperatures less their mean, K (n, J),
    give a frame without rotation, the bias per kelvin (J, 3), and the covariance (3, 3) of the
    scale that is left.
    """
    norms = np.linalg.norm(force, axis=1)
    common = (float(np.median(norms)) if len(force) else 0.0) / GRAVITY or 1.0
    near = np.abs(norms - common * GRAVITY) < _FAR * common * GRAVITY
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
        right = (force / common - bias - theta @ drift) * (1 - scale)
        norm = np.linalg.norm(right, axis=1, keepdims=True)
        n = right / norm
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
    """Take the specific force, (N, 3), NaN where it stands still to the last digit for long."""
    force = recording.specific_force
    if force is None:
        return np.full((len(recording), 3), np.nan)
    return np.where(_frozen(force, recording)[:, None], np.nan, force)


def _in_one_unit(forces: Sequence[FloatArray]) -> list[FloatArray]:
    """Bring specific forces, (N, 3), to the unit of the newest, which is what the node hears."""
    norms = [np.linalg.norm(force[np.isfinite(force[:, 0])], axis=1) for force in forces]
    usual = [float(np.median(norm)) if len(norm) else np.nan for norm in norms]
    newest = next((norm for norm in reversed(usual) if norm > 0), np.nan)
    shares = [norm / newest for norm in usual]
    return [
        force / share if abs(share - 1) > _OTHER_UNIT and share > 0 else force
        for force, share in zip(forces, shares, strict=True)
    ]


def _frozen(force: FloatArray, recording: Recording) -> BoolArray:
    """Tell where a specific force (N, 3) stands still for FROZEN_S although the wrench jumps."""
    changes = np.append(True, np.any(np.diff(force, axis=0) != 0, axis=1))
    runs = np.cumsum(changes) - 1
    steps = np.abs(np.diff(recording.wrench, axis=0, prepend=recording.wrench[:1]))
    noise = np.array([noise_level([axis]) for axis in recording.wrench.T])
    cells, jumps = np.bincount(runs), np.bincount(runs, np.any(steps > _JUMP * noise, axis=1))
    frozen = (jumps > _JUMPING_SHARE * cells) & (cells * recording.period_s >= FROZEN_S)
    return np.asarray(frozen[runs])
