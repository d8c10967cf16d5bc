"""
Specific force: how it moved, and the accelerometer's bias and scale by its norm at rest.

A cell that turns holds the mean of a vector that turns, which is shorter than gravity. So bias and
scale are fitted to cells at rest alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # which loads its parts when they are used

from wrist_ft_comp.channels import GRAVITY
from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.payload.weight import ForceFrame, SAME_SHARE
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import BoolArray, differ, FloatArray

#: A sensor that turns more slowly is at rest, rad/s.
_REST_RAD_S = 0.03
#: A driver hangs rarely: at most once per 100 cells that do change.
_HANGS = 0.01
#: No IMU is as near to gravity at rest, m/s²; TF is.
_NOISELESS = 1e-3
#: Expected bias of an accelerometer, m/s².
_BIAS = 0.3
#: No bias is as large as this share of gravity: samples whose norm differs by more are left out,
#: and a recording that does so at rest is in another unit.
OUTLIER_SHARE = 0.3
#: Noise of a norm, m/s². It is far above that of an IMU, because errors of neighbouring samples
#: are alike, and a recording would else seem to determine bias and scale exactly.
_NORM_NOISE = 0.2
#: Errors of a norm above this many times that noise count less: the robot was pushed, or braked.
_OUTLIER_SIGMA = 0.5


def turning_speed(force: FloatArray, period_s: float) -> FloatArray:
    """Compute how fast a specific force, (n, 3), turns at every sample, rad/s, (n,)."""
    unit = force / np.maximum(np.linalg.norm(force, axis=1, keepdims=True), 1e-9)
    turned = np.linalg.norm(np.diff(unit, axis=0), axis=1) / period_s
    return np.asarray(np.fmax(np.append(turned, 0.0), np.append(0.0, turned)))


def rotation_speed(recording: Recording) -> FloatArray:
    """Speed of rotation of every cell, rad/s, (N,); of the specific force if none was recorded."""
    speed = recording.rotation_speed
    if speed is None:
        speed = turning_speed(np.asarray(recording.specific_force), recording.period_s)
    return np.nan_to_num(speed)


def repeats_itself(recordings: Sequence[Recording]) -> BoolArray:
    """Mark cells of all of an IMU whose driver hangs, by its gyroscope, which stands off zero."""
    marked = []
    for recording in recordings:
        felt = np.column_stack((np.asarray(recording.specific_force), rotation_speed(recording)))
        same = ~differ(felt[1:], felt[:-1]).any(axis=1) & (felt[1:, -1] > 0)
        marked.append(np.append(False, same))
    same = np.concatenate(marked)
    # One of few digits, or without noise, reads the same wherever the robot rests.
    begins = np.count_nonzero(np.diff(same.astype(int), prepend=0) > 0)
    return same & (begins <= _HANGS * np.count_nonzero(~same))


@dataclass(frozen=True, eq=False)
class Accelerometer:
    """Specific force, corrected by what the norm at rest shows."""

    #: Corrected, m/s², (N, 3) per recording; NaN where it is missing.
    forces: list[FloatArray]
    #: Bias and scale at the mean temperature, without a rotation.
    frame: ForceFrame
    #: Relative covariance of what is left of the scale's error, shape (3, 3).
    scale: FloatArray
    #: Share of the cells at rest; without any, nothing was fitted.
    rested: float
    #: Whether it is by TF, which shows no acceleration.
    by_tf: bool


def calibrated_by_norm(recordings: Sequence[Recording]) -> Accelerometer:
    """
    Fit bias, its change with temperature, and scale; every recording holds specific force.

    Where no cell is at rest, specific force is taken as it was measured. CalibrationRefusedError
    where a resting one is not in m/s².
    """
    force = np.concatenate([np.asarray(recording.specific_force) for recording in recordings])
    speed = np.concatenate([rotation_speed(recording) for recording in recordings])
    ends = np.cumsum([len(recording) for recording in recordings])[:-1]
    rest = np.isfinite(force).all(axis=1) & (speed < _REST_RAD_S)
    norms = np.where(rest, np.linalg.norm(force, axis=1), np.nan)
    for recording, norm in zip(recordings, np.split(norms, ends), strict=True):
        usual = np.median(norm[np.isfinite(norm)]) if np.isfinite(norm).any() else GRAVITY
        if abs(usual / GRAVITY - 1) > OUTLIER_SHARE:
            raise CalibrationRefusedError(
                f'The specific force of {recording.name} is {usual:.3g} at rest, and '
                f'{GRAVITY:.3g} was expected: it is in another unit. Convert it to m/s².'
            )
    temperature_c = np.concatenate([recording.temperature_c for recording in recordings])
    theta = temperature_c - temperature_c.mean(axis=0)
    frame, drift, covariance = fit_norm(force[rest], theta[rest])
    corrected = (force - frame.bias - theta @ drift) / frame.scale
    by_tf = bool((np.abs(norms[rest] - GRAVITY) < _NOISELESS).all())
    return Accelerometer(np.split(corrected, ends), frame, covariance, float(rest.mean()), by_tf)


def fit_norm(force: FloatArray, theta: FloatArray) -> tuple[ForceFrame, FloatArray, FloatArray]:
    """
    Fit bias, scale and bias per kelvin to the norm at rest.

    Takes specific force as measured, m/s², (n, 3), and temperatures less their mean, K, (n, J).
    Gives a frame without rotation, the bias per kelvin, (J, 3), and the relative covariance of
    what is left of the scale's error, (3, 3). Without samples, nothing is corrected.
    """
    near = np.abs(np.linalg.norm(force, axis=1) - GRAVITY) < OUTLIER_SHARE * GRAVITY
    force, theta = force[near], theta[near]
    # Over 30 K the bias may change by as much as it is.
    widths = np.repeat([_BIAS, SAME_SHARE, *[_BIAS / 30] * theta.shape[1]], 3)
    prior = np.diag(widths**2)
    # Half of a scale's variance is common to all axes.
    prior[3:6, 3:6] = SAME_SHARE**2 * (np.eye(3) + 1) / 2
    roots = np.linalg.cholesky(np.linalg.inv(prior)).T

    def errors(found: FloatArray) -> FloatArray:
        """Compare norms with gravity, and bias, scale and bias per kelvin with what is usual."""
        corrected = (force - found[:3] - theta @ found[6:].reshape(-1, 3)) * (1 - found[3:6])
        apart = np.linalg.norm(corrected, axis=1) - GRAVITY
        return np.concatenate((apart / _NORM_NOISE, roots @ found))

    fit = scipy.optimize.least_squares(
        errors, np.zeros(len(prior)), loss='cauchy', f_scale=_OUTLIER_SIGMA
    )
    covariance = np.linalg.inv(fit.jac.T @ fit.jac)[3:6, 3:6]
    frame = ForceFrame(bias=fit.x[:3], scale=1 / (1 - fit.x[3:6]))
    return frame, fit.x[6:].reshape(-1, 3), covariance
