"""An accelerometer set right by its norm at rest, as far as the directions that it saw tell."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrist_ft_comp.payload.cells import rotation_speed
from wrist_ft_comp.payload.directions import fit_norm
from wrist_ft_comp.payload.weight import ForceFrame
from wrist_ft_comp.signals import BoolArray, FloatArray, noise_level, Recording

#: A specific force that does not change at all for so long, s, is no longer measured.
FROZEN_S = 1200
#: The wrench of a robot that moves jumps by so many times its noise, in this share of cells.
_JUMP, _JUMPY = 12.0, 0.01
#: Standing still, rad/s.
_STILL = 0.03
#: A norm at rest that is off the newest recording's by more is another unit's, not a bias.
_OTHER_UNIT = 0.1


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
    known = np.all(np.isfinite(force), axis=1)
    temperature_c = np.concatenate([recording.temperature_c for recording in recordings])
    theta = temperature_c - temperature_c.mean(axis=0)
    still = known & (np.concatenate([rotation_speed(r) for r in recordings]) < _STILL)
    still = still if still.any() else known
    frame, drift, covariance = fit_norm(force[still], theta[still])
    right = (force - frame.bias - theta @ drift) / frame.scale
    ends = np.cumsum([len(recording) for recording in recordings])[:-1]
    return Accelerometer(np.split(right, ends), frame, covariance)


def _in_one_unit(forces: Sequence[FloatArray]) -> list[FloatArray]:
    """Bring specific forces, (N, 3), to the unit of the newest, which is what the node hears."""
    norms = [np.linalg.norm(force[np.isfinite(force[:, 0])], axis=1) for force in forces]
    usual = [float(np.median(norm)) if len(norm) else np.nan for norm in norms]
    shares = [norm / next((u for u in usual[::-1] if u > 0), np.nan) for norm in usual]
    return [
        force / share if abs(share - 1) > _OTHER_UNIT and share > 0 else force
        for force, share in zip(forces, shares, strict=True)
    ]


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
