"""What a specific force saw, and what its norm tells of the accelerometer."""

from dataclasses import dataclass

import numpy as np

from wrist_ft_comp.payload.weight import ForceFrame
from wrist_ft_comp.signals import FloatArray, GRAVITY

#: A direction was seen where gravity moved by more along it, m/s² RMS: two degrees.
_MOVED = 0.3
#: What is expected of accelerometers: bias, m/s², per kelvin, and scale.
_BIAS, _PER_KELVIN, _SCALE = 0.3, 0.01, 0.03
#: A norm that is off by this share of the usual one says nothing of an accelerometer.
_FAR = 0.3
#: Noise of a norm that is taken as independent, m/s², so that slow errors count for what they are.
_NORM_NOISE = 0.2


@dataclass(frozen=True)
class ForceSummary:
    """What a recording's specific force saw: its norm, and how gravity moved, m/s²."""

    #: Root mean square over all samples.
    norm: float
    #: Standard deviations along the three directions in which it moved most, and less, as if the
    #: norm were GRAVITY.
    spread: tuple[float, float, float]

    @property
    def seen(self) -> int:
        """How many directions were seen; a payload needs two."""
        return sum(each > _MOVED for each in self.spread)


def moments_of(force: FloatArray) -> FloatArray:
    """Sum up products of [f, 1] of finite samples, shape (n, 3): (4, 4)."""
    samples = force[np.isfinite(force).all(axis=1)]
    samples = np.concatenate((samples, np.ones((len(samples), 1))), axis=1)
    return np.asarray(samples.T @ samples)


def turning_speed(force: FloatArray, period_s: float) -> FloatArray:
    """Tell how fast a specific force (n, 3) turns from one sample to the next, rad/s (n,)."""
    unit = force / np.maximum(np.linalg.norm(force, axis=1, keepdims=True), 1e-9)
    turned = np.linalg.norm(np.diff(unit, axis=0), axis=1) / period_s
    return np.asarray(np.fmax(np.append(turned, 0.0), np.append(0.0, turned)))


def describe_force(moments: FloatArray) -> ForceSummary | None:
    """Find norm and principal directions from summed moments; None without samples."""
    if not moments[3, 3]:
        return None
    moments = moments / moments[3, 3]
    norm = float(np.sqrt(np.trace(moments[:3, :3])))
    mean = moments[:3, 3]
    moved = np.linalg.eigvalsh(moments[:3, :3] - np.outer(mean, mean))[::-1]
    largest, middle, least = np.sqrt(np.maximum(moved, 0)) * (GRAVITY / norm if norm else 0.0)
    return ForceSummary(norm, (float(largest), float(middle), float(least)))


def fit_norm(force: FloatArray, theta: FloatArray) -> tuple[ForceFrame, FloatArray, FloatArray]:
    """Fit bias, scale and bias per kelvin to the norm at rest, in a frame without rotation."""
    # Specific force as it was measured, m/s², (n, 3), and temperatures less their mean, K, (n, J),
    # give the frame, the bias per kelvin, (J, 3), and the covariance of the scale that is left.
    norms = np.linalg.norm(force, axis=1)
    common = (float(np.median(norms)) if len(force) else 0.0) / GRAVITY or 1.0
    near = np.abs(norms - common * GRAVITY) < _FAR * common * GRAVITY
    force, theta = force[near], theta[near]
    thermometers = theta.shape[1]
    widths = np.repeat([_BIAS, _SCALE, *[_PER_KELVIN] * thermometers], 3)
    prior = np.diag(widths**2)
    # Half of a scale's variance is common to all axes.
    prior[3:6, 3:6] = _SCALE**2 * (np.eye(3) + 1) / 2
    found, covariance = np.zeros(len(prior)), prior
    weights = np.ones(len(force))
    for _ in range(6 * bool(len(force))):
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
        weights = 1 / (1 + (error / (4 * max(0.005, np.median(error)))) ** 2) ** 2
    frame = ForceFrame(bias=found[:3] * common, scale=common / (1 - found[3:6]))
    return frame, found[6:].reshape(-1, 3) * common, covariance[3:6, 3:6]
