"""How a specific force moved: its norm, the directions of gravity, the speed of rotation."""

from dataclasses import dataclass

import numpy as np

from wrist_ft_comp.channels import GRAVITY
from wrist_ft_comp.payload.mass_and_center import CONTRAST
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import FloatArray


@dataclass(frozen=True)
class ForceSummary:
    """How the specific force of a recording moved, m/s²."""

    #: Root mean square over all samples.
    norm: float
    #: Standard deviations along the three principal directions, largest first, scaled to a norm of
    #: GRAVITY.
    spread: tuple[float, float, float]

    @property
    def seen(self) -> int:
        """Number of directions along which gravity moved; a payload needs two."""
        return sum(deviation > CONTRAST for deviation in self.spread)


def moments_of(force: FloatArray) -> FloatArray:
    """Sum the products of [f, 1] over the finite samples of (n, 3), shape (4, 4)."""
    samples = force[np.isfinite(force).all(axis=1)]
    samples = np.concatenate((samples, np.ones((len(samples), 1))), axis=1)
    return np.asarray(samples.T @ samples)


def describe_force(moments: FloatArray) -> ForceSummary | None:
    """Compute norm and principal directions from the sums of moments_of; None without samples."""
    if not moments[3, 3]:
        return None
    moments = moments / moments[3, 3]
    norm = float(np.sqrt(np.trace(moments[:3, :3])))
    mean = moments[:3, 3]
    moved = np.linalg.eigvalsh(moments[:3, :3] - np.outer(mean, mean))[::-1]
    largest, middle, least = np.sqrt(np.maximum(moved, 0)) * (GRAVITY / norm if norm else 0.0)
    return ForceSummary(norm, (float(largest), float(middle), float(least)))


def turning_speed(force: FloatArray, period_s: float) -> FloatArray:
    """Compute how fast a specific force, (n, 3), turns at every sample, rad/s, (n,)."""
    unit = force / np.maximum(np.linalg.norm(force, axis=1, keepdims=True), 1e-9)
    turned = np.linalg.norm(np.diff(unit, axis=0), axis=1) / period_s
    return np.asarray(np.fmax(np.append(turned, 0.0), np.append(0.0, turned)))


def rotation_speed(recording: Recording) -> FloatArray:
    """Speed of rotation of every cell, rad/s, (N,); of the specific force if none was recorded."""
    force = recording.specific_force
    if recording.rotation_speed is not None:
        return np.nan_to_num(recording.rotation_speed)
    if force is None:
        return np.zeros(len(recording))
    return np.nan_to_num(turning_speed(force, recording.period_s))
