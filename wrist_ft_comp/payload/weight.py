"""
A payload and its weight: F = -m f, τ = c × F at specific force f (docs/algorithm.md, section 7).

Specific force is that of sensor_msgs/Imu (REP 145): +9.81 m/s² upwards at rest. What
the node does with each wrench (LivePayload) is in floats instead of arrays.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.channels import GRAVITY
from wrist_ft_comp.errors import check_range, SettingsError
from wrist_ft_comp.series import FloatArray

#: Largest mass that is accepted, kg.
MOST_KG = 1000.0
#: Largest distance of the centre of mass from the origin, along an axis, m.
FARTHEST_M = 10.0
#: Two payloads, or accelerometers, may be the same where mass, gains or norm differ by a smaller
#: share; a frame that changes forces by a smaller one does nothing. It is the expected error of
#: an accelerometer's scale.
SAME_SHARE = 0.03
#: Specific force, m/s².
Force = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Payload:
    """Everything that is mounted on the sensor; standard errors are NaN where unknown."""

    mass_kg: float
    #: Centre of mass in the wrench's frame, shape (3,).
    center_m: FloatArray
    mass_error_kg: float = np.nan
    center_error_m: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    #: Share of the time in which it was mounted; NaN where it was not learnt.
    share: float = np.nan

    def __post_init__(self) -> None:
        if np.shape(self.center_m) != (3,) or np.shape(self.center_error_m) != (3,):
            raise SettingsError(
                f'A centre of mass is three numbers in m; got {np.shape(self.center_m)}.'
            )
        check_range('mass_kg', self.mass_kg, 0.0, MOST_KG)
        for coordinate in self.center_m:
            check_range('center_of_mass_m', coordinate, -FARTHEST_M, FARTHEST_M)

    def weight(self, specific_force: FloatArray) -> FloatArray:
        """Compute the wrench, N and N m, (…, 6), at specific forces in its frame, m/s², (…, 3)."""
        force = -self.mass_kg * specific_force
        return np.concatenate((force, np.cross(self.center_m, force)), axis=-1)


class FrameIds(NamedTuple):
    """The frame_id of a specific force, and that of the wrench; empty where unknown."""

    force_frame: str = ''
    wrench_frame: str = ''


@dataclass(frozen=True, eq=False)
class ForceFrame:
    """Converts measured specific force f to the wrench's frame: R ((f - bias) / scale)."""

    #: R, from the frame of the specific force to that of the wrench, shape (3, 3).
    rotation: FloatArray = field(default_factory=lambda: np.eye(3))
    #: Bias of the accelerometer along its own axes, m/s², shape (3,).
    bias: FloatArray = field(default_factory=lambda: np.zeros(3))
    #: Scale of the accelerometer along its own axes, shape (3,).
    scale: FloatArray = field(default_factory=lambda: np.ones(3))
    #: What measured the specific force, imu or tf; empty where unknown.
    source: str = ''
    #: As in FrameIds, at the time when the frame was learnt.
    force_frame: str = ''
    wrench_frame: str = ''

    def turn(self, specific_force: FloatArray) -> FloatArray:
        """Convert measured specific forces, (…, 3), to the wrench's frame."""
        return np.asarray(((specific_force - self.bias) / self.scale) @ self.rotation.T)

    def apart_deg(self, other: 'ForceFrame') -> float:
        """Compute the angle between its rotation and that of another one, degrees."""
        cosine = (np.sum(self.rotation * other.rotation) - 1) / 2
        return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))

    @property
    def does_nothing(self) -> bool:
        """Whether measured specific force is in the wrench's frame already, as that by TF is."""
        changed = np.abs(self.turn(GRAVITY * np.eye(3)) / GRAVITY - np.eye(3))
        return bool(changed.max() < SAME_SHARE)

    def __str__(self) -> str:
        r = self.rotation
        roll, yaw = np.arctan2((r[2, 1], r[1, 0]), (r[2, 2], r[0, 0]))
        angles = np.degrees([roll, -np.arcsin(np.clip(r[2, 0], -1, 1)), yaw])
        rounded = ', '.join(f'{angle:.1f}' for angle in np.round(angles, 1) + 0.0)
        return f'turned by roll, pitch, yaw of {rounded} degrees'


@dataclass(frozen=True, eq=False)
class LearntPayloads:
    """All payloads of a calibration."""

    #: Converts measured specific force to the wrench's frame.
    frame: ForceFrame
    #: By name, the lightest first.
    payloads: dict[str, Payload]

    def lines(self) -> list[str]:
        """Describe every payload in one line, and the frame in another."""
        lines = [f'payload {payload_line(*payload)}' for payload in self.payloads.items()]
        return [*lines, f'specific force {self.frame}']


class LivePayload:
    """A payload and the frame of its specific force; ``turned`` says where that was learnt."""

    def __init__(
        self, name: str, payload: Payload, frame: ForceFrame, turned: str = '', *,
        is_assumed: bool = False,
    ) -> None:  # fmt: skip
        self.name, self.payload, self.frame = name, payload, frame
        #: Whether nobody measured the frame: it is right where both frame_ids are one.
        self.is_assumed = is_assumed
        #: The same in words for people.
        self.turn = f'specific force is {frame}, {turned}'
        still = payload.weight(frame.turn(np.zeros(3)))
        gains = payload.weight(frame.turn(np.eye(3))) - still
        #: Per axis: gains of the three directions of the specific force, and a constant.
        self._rows: list[list[float]] = np.vstack((gains, still)).T.tolist()

    def __str__(self) -> str:
        center = ', '.join(f'{coordinate:.4f}' for coordinate in self.payload.center_m)
        return f'{self.name}, {self.payload.mass_kg:.4f} kg at ({center}) m'

    def weight(self, force: Force) -> list[float]:
        """Compute its wrench at a specific force, m/s²: N and N m, axis order AXES."""
        return [-value for value in self.taken_off([0.0] * 6, force)]

    def taken_off(self, wrench: Sequence[float], force: Force) -> list[float]:
        """Subtract its wrench at a specific force, m/s², from a wrench, N and N m."""
        x, y, z = force
        return [
            w - (a * x + b * y + c * z + d)
            for w, (a, b, c, d) in zip(wrench, self._rows)  # noqa: B905 -- as in Compensator
        ]


def payload_line(name: str, payload: Payload) -> str:
    """Describe a payload in one line."""
    center = ', '.join(f'{1e3 * center_m:.1f}' for center_m in payload.center_m)
    line = (
        f'{name}: {payload.mass_kg:.3f} ± {payload.mass_error_kg:.2g} kg, centre of mass at '
        f'{center} mm (± {1e3 * float(np.max(payload.center_error_m)):.2g})'
    )
    return line if np.isnan(payload.share) else f'{line}, on for {payload.share:.0%} of the time'
