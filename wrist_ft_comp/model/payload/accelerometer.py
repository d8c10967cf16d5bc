"""An accelerometer's bias and scale by its norm, as far as the directions that it saw tell."""

import numpy as np

from wrist_ft_comp.model.payload.weight import ForceFrame
from wrist_ft_comp.model.signals import FloatArray, GRAVITY

#: What is expected of accelerometers: bias, m/s², per kelvin, and scale.
_BIAS, _PER_KELVIN, _SCALE = 0.3, 0.01, 0.03
#: Noise of a norm that is taken as independent, m/s², so that slow errors count for what they are.
_NORM_NOISE = 0.2


def fit_norm(force: FloatArray, theta: FloatArray) -> tuple[ForceFrame, FloatArray, FloatArray]:
    """
    Fit bias, scale and bias per kelvin to the norm at rest, in a frame without rotation.

    Specific force as it was measured, m/s², (n, 3), and temperatures less their mean, K, (n, J),
    give the frame, the bias per kelvin, (J, 3), and the covariance of the scale that is left.
    """
    common = float(np.median(np.linalg.norm(force, axis=1))) / GRAVITY if len(force) else 1.0
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
