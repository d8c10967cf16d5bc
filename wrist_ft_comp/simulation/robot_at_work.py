"""A simulated robot at work: it moves, holds a tool and parts, and presses on things."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from wrist_ft_comp.channels import GRAVITY
from wrist_ft_comp.payload.weight import Payload
from wrist_ft_comp.series import FloatArray, IntArray

#: Legs of a program, each a motion and a rest.
_LEGS = 200
#: Number of legs in a row with a part in the gripper, and then without one.
_HELD_LEGS = 6
#: Shortest rest, and mean of what rests last longer, s.
_LEAST_REST_S, _REST_S = 1.0, 6.0
#: Standard deviation of a motion along each axis, m.
_REACH_M = 0.15
#: Largest force on things, N.
_LARGEST_FORCE_N = 60.0
#: The robot does not press in this share of a rest at its beginning, and at its end.
_PRESS_MARGIN = 0.1
#: Time in which the force rises and falls, s.
_RISE_S = 0.3
#: Of an accelerometer: its place in the sensor's frame, m, and the standard deviations of specific
#: force, m/s², and angular velocity, rad/s.
_IMU_M, _IMU_NOISE = np.array([0.005, 0.0, 0.026]), np.repeat([0.02, 0.002], 3)


@dataclass(frozen=True)
class WorkSettings:
    """What a person chooses about a robot's work; the node's parameters limit the ranges."""

    #: Mass of the tool, and of the part that it picks up and puts down again; 0 is none.
    tool_kg: float = 1.4
    part_kg: float = 0.8
    #: About the share of the time in which it presses on something, 0 to 0.6.
    contacts: float = 0.15
    #: Largest speed of rotation.
    speed_rad_s: float = 1.0


@dataclass(frozen=True, eq=False)
class Work:
    """The program that a seed has drawn: L legs, each a motion and a rest."""

    #: The tool, and the tool with the part.
    payloads: tuple[Payload, ...]
    #: Which of them is mounted in each leg, (L,).
    held: IntArray
    #: Beginning of each leg, and end of the program, (L + 1,).
    begins_s: FloatArray
    #: Duration of the motion of each leg, (L,).
    moves_s: FloatArray
    #: Orientation at the beginning, rotation in the sensor's frame, rad, and path in the world's.
    poses: Rotation
    turns: FloatArray
    paths_m: FloatArray
    #: Wrench against things at rest, N and N m, (L, 6).
    pressed: FloatArray


class Motion(NamedTuple):
    """The robot at n times, in the sensor's frame."""

    #: Sensor's frame to the world's (n,).
    pose: Rotation
    #: Specific force, m/s², angular velocity, rad/s, and its derivative, (n, 3).
    force: FloatArray
    omega: FloatArray
    alpha: FloatArray
    #: Wrench of the payload, and of the things that it presses on, N and N m, (n, 6).
    weight: FloatArray
    contact: FloatArray


def draw_work(
    settings: WorkSettings, rng: np.random.Generator, tools: np.random.Generator | None = None
) -> Work:
    """Draw a program; ``tools`` draws the payloads, where several programs have the same."""
    poses = Rotation.random(_LEGS, random_state=int(rng.integers(2**31)))
    turns = (poses.inv() * poses[np.r_[1:_LEGS, 0]]).as_rotvec()
    # The fastest moment of a smooth motion is 1.875 times its mean.
    moves_s = 1.875 * np.linalg.norm(turns, axis=1) / settings.speed_rad_s + 0.5
    rests_s = rng.exponential(_REST_S, _LEGS) + _LEAST_REST_S
    pressing = (1 - 2 * _PRESS_MARGIN) * rests_s.sum() / (moves_s.sum() + rests_s.sum())
    direction = rng.normal(0, 0.4, (_LEGS, 3)) - [0, 0, 1]
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    force = direction * rng.uniform(0.1 * _LARGEST_FORCE_N, _LARGEST_FORCE_N, (_LEGS, 1))
    point = np.column_stack((rng.normal(0, 0.03, (_LEGS, 2)), rng.uniform(0.08, 0.2, _LEGS)))
    touched = rng.random((_LEGS, 1)) < settings.contacts / pressing
    # Where the centres of mass are: a tool, and the same with a part in it.
    payload_rng = tools or rng
    tool_m = np.append(payload_rng.normal(0, 0.02, 2), payload_rng.uniform(0.04, 0.12))
    part_m = np.append(payload_rng.normal(0, 0.02, 2), payload_rng.uniform(0.12, 0.2))
    payloads = [Payload(settings.tool_kg, tool_m)]
    if settings.part_kg > 0:
        both_kg = settings.tool_kg + settings.part_kg
        center_m = (settings.tool_kg * tool_m + settings.part_kg * part_m) / both_kg
        payloads.append(Payload(both_kg, center_m))
    return Work(
        payloads=tuple(payloads),
        begins_s=np.concatenate(([0.0], np.cumsum(moves_s + rests_s))), moves_s=moves_s,
        poses=poses, turns=turns, paths_m=rng.normal(0, _REACH_M, (_LEGS, 3)),
        held=np.arange(_LEGS) // _HELD_LEGS % 2 * (settings.part_kg > 0),
        pressed=touched * np.concatenate((force, np.cross(point, force)), axis=1))  # fmt: skip


def move(work: Work, elapsed_s: FloatArray) -> Motion:
    """Look up what a robot does at times (n,), s, since it began."""
    time_s = elapsed_s % work.begins_s[-1]
    leg = np.searchsorted(work.begins_s, time_s, side='right') - 1
    since_s, moves_s = time_s - work.begins_s[leg], work.moves_s[leg, np.newaxis]
    # From 0 to 1 without a jerk: the position, and its first and second derivatives.
    share = np.minimum(since_s[:, np.newaxis] / moves_s, 1.0)
    rest = 1 - share
    done = share**3 * (10 - 15 * share + 6 * share**2)
    rate, bend = 30 * (share * rest) ** 2, 60 * share * rest * (1 - 2 * share)
    turn = work.turns[leg]
    pose = work.poses[leg] * Rotation.from_rotvec(done * turn)
    omega, alpha = turn * rate / moves_s, turn * bend / moves_s**2
    pushed = work.paths_m[leg] * bend / moves_s**2 + [0.0, 0.0, GRAVITY]
    force = pose.inv().apply(pushed)
    weights = [
        payload.weight(force + lever(omega, alpha, payload.center_m)) for payload in work.payloads
    ]
    weight = np.choose(work.held[leg, np.newaxis], weights)
    # It presses on things in the middle of rests.
    rests_s = np.diff(work.begins_s) - work.moves_s
    first_s = (work.moves_s + _PRESS_MARGIN * rests_s)[leg]
    last_s = (work.moves_s + (1 - _PRESS_MARGIN) * rests_s)[leg]
    swell = np.clip(np.minimum(since_s - first_s, last_s - since_s) / _RISE_S, 0.0, 1.0)
    contact = np.asarray(swell[:, np.newaxis] * work.pressed[leg])
    return Motion(pose, force, omega, alpha, weight, contact)


def lever(omega: FloatArray, alpha: FloatArray, at_m: FloatArray) -> FloatArray:
    """Accelerate a point of the sensor's frame by rotation: α × r + ω × (ω × r), (n, 3)."""
    return np.asarray(np.cross(alpha, at_m) + np.cross(omega, np.cross(omega, at_m)))


@dataclass(frozen=True, eq=False)
class Accelerometer:
    """An accelerometer with errors, mounted crooked beside the sensor."""

    #: Its frame to the sensor's.
    rotation: Rotation
    #: Along its axes: bias, m/s², scale, 1, and drift, m/s² per kelvin of warmth, (3,).
    bias: FloatArray
    scale: FloatArray
    per_kelvin: FloatArray


def draw_accelerometer(rng: np.random.Generator) -> Accelerometer:
    """Draw the accelerometer of a specimen: 3° off, 0.1 m/s², 0.5 % and 3 mm/s² per kelvin."""
    crooked = rng.normal(0, 1, 3)
    return Accelerometer(
        Rotation.from_rotvec(np.deg2rad(3.0) * crooked / np.linalg.norm(crooked)),
        bias=rng.normal(0, 0.1, 3), scale=1 + 0.005 * rng.choice([-1.0, 1.0], 3),
        per_kelvin=rng.normal(0, 0.003, 3))  # fmt: skip


def read_imu(
    imu: Accelerometer, motion: Motion, warm_k: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Read specific force, m/s², and angular velocity, rad/s, (n, 6), at a warmth, K (n,)."""
    at_imu = motion.force + lever(motion.omega, motion.alpha, _IMU_M)
    to_imu = imu.rotation.inv()
    force = imu.scale * to_imu.apply(at_imu) + imu.bias + warm_k[:, np.newaxis] * imu.per_kelvin
    read = np.concatenate((force, to_imu.apply(motion.omega)), axis=1)
    return np.asarray(read + rng.normal(0, _IMU_NOISE, read.shape))
