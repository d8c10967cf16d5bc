"""
Days of a robot at work, in worlds that nobody tuned on, and the same days with an empty flange.

The bodies, gauges and thermometers are those of ``worlds_drawn``: random thermal networks. On top
of them a robot runs programs: poses with motion between them, with a tool, parts that it picks up
and puts down, and contacts. What it does is drawn at 10 Hz and averaged over cells of 1 s, so that
ω×(ω×c), α×c, a part that is picked up within a cell and a contact that begins in one are as honest
as in a recording. The specific force comes from an accelerometer (mounted 26 mm away and turned in
any way, biased, scaled, drifting with the body's temperature, noisy), or is gravity by TF, which
knows no acceleration of the robot and stands on a base that is not quite level. Drivers tare.

``working(name, seed)`` draws a world: days to learn from, the same days with an empty flange, and
an empty next day to be judged on; a payload pushes with F = -m f, τ = c×F.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

from judging import recording_of
import numpy as np
from scipy.spatial.transform import Rotation
from thermal_networks import between, draw_day, draw_others, draw_sources, network
from worlds_drawn import draw_gauges, draw_thermometers, FACTORY_C, Gauges, LOADS, read, shift_of

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import FloatArray, IntArray
from wrist_ft_comp.simulation.work import lever

GRAVITY, RATE = 9.807, 10
DAYS, SECONDS = 4, 9000
#: Tares of the driver are at least so far apart, s.
APART_S = 300
IMU_M = np.array([0.005, 0.0, 0.026])


@dataclass(frozen=True)
class Scenario:
    """What the worlds of a scenario have in common."""

    title: str
    part: bool = True
    #: Different poses of a day; none: those of several programs.
    poses: int | None = None
    contacts: float = 0.15
    #: Largest angle between the tool and the vertical, degrees.
    cone_deg: float = 150.0
    #: How far the accelerometer's own axes are turned, and its scale error, one per axis.
    scale_error: float = 0.005
    turned_deg: float = 2.0
    tf: bool = False
    #: Expected tares of the driver in a day.
    tares: float = 0.25


SCENARIOS = {
    'tool': Scenario('one tool', part=False),
    'part': Scenario('tool and part'),
    'poses': Scenario('three poses a day', poses=3),
    'contacts': Scenario('contacts 40 % of the time', contacts=0.4),
    'cone': Scenario('tool-down cone of 30°', cone_deg=30.0),
    'imu': Scenario('IMU turned by 5°, scale error 3 %', scale_error=0.03, turned_deg=5.0),
    'tf': Scenario('TF instead of an IMU', tf=True),
    'tares': Scenario('two tares of the driver a day', tares=2.0),
}


@dataclass(frozen=True, eq=False)
class Payload:
    """Mass, kg, centre of mass, m (3,), and inertia about it, kg m² (3,)."""

    mass_kg: float
    center_m: FloatArray
    inertia: FloatArray


class Work(NamedTuple):
    """True wrench (N, 6), gravity by TF (N, 3) and RMS speed of rotation (N,), cells of 1 s."""

    wrench: FloatArray
    gravity: FloatArray
    spin: FloatArray


@dataclass(frozen=True, eq=False)
class Working:
    """Days at work and with an empty flange, an empty day to judge, payloads, drivers' tares."""

    days: list[Recording]
    empty: list[Recording]
    judged: Recording
    payloads: list[Payload]
    tares: int


@dataclass(frozen=True, eq=False)
class Motion:
    """At 10 Hz in the sensor's frame: what TF and an accelerometer see, speed of rotation, …."""

    gravity: FloatArray
    force: FloatArray
    omega: FloatArray
    alpha: FloatArray
    moving: FloatArray


@dataclass(frozen=True, eq=False)
class Accelerometer:
    """Turned, m/s² of bias (3,), scale (3,), bias per kelvin (3,)."""

    rotation: Rotation
    bias: FloatArray
    scale: FloatArray
    per_kelvin: FloatArray

    def read(self, rng: np.random.Generator, felt: FloatArray, near_c: FloatArray) -> FloatArray:
        """Read specific force (N, 3) at a temperature (N,)."""
        seen = self.scale * self.rotation.inv().apply(felt) + self.bias
        noise = rng.normal(0, 0.01, felt.shape)
        return np.asarray(seen + self.per_kelvin * (near_c - FACTORY_C)[:, None] + noise)


def draw_payloads(rng: np.random.Generator, *, part: bool) -> list[Payload]:
    """Draw a tool, and the same with a part in it."""
    payloads = [draw_body(rng, between(rng, 0.7, 2.5), 0.04, 0.15)]
    if part:
        tool, held = payloads[0], draw_body(rng, between(rng, 0.4, 2.5), 0.12, 0.25)
        mass = tool.mass_kg + held.mass_kg
        center = (tool.mass_kg * tool.center_m + held.mass_kg * held.center_m) / mass
        apart = tool.mass_kg * held.mass_kg / mass * np.sum((held.center_m - tool.center_m) ** 2)
        payloads.append(
            Payload(mass, center, tool.inertia + held.inertia + apart * np.array([1, 1, 0]))
        )
    return payloads


def draw_body(rng: np.random.Generator, mass_kg: float, low_m: float, high_m: float) -> Payload:
    """Draw a body that hangs some way below the flange."""
    center = np.array([*rng.normal(0, 0.02, 2), rng.uniform(low_m, high_m)])
    return Payload(mass_kg, center, mass_kg * rng.uniform(0.02, 0.05, 3) ** 2)


def smooth(share: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Go from 0 to 1 without a jerk: way, and its first and second derivatives."""
    return (
        share**3 * (10 - 15 * share + 6 * share**2),
        30 * share**2 * (1 - share) ** 2,
        60 * share * (1 - share) * (1 - 2 * share),
    )


def orientations(rng: np.random.Generator, count: int, cone_deg: float) -> Rotation:
    """Draw poses whose tool points down within a cone: sensor frame to the world's."""
    tilt = np.arccos(rng.uniform(np.cos(np.deg2rad(cone_deg)), 1, count))
    turns = rng.uniform(-np.pi, np.pi, (2, count))
    angles = np.stack((turns[0], tilt, turns[1]), axis=1)
    return Rotation.from_euler('ZYZ', angles) * Rotation.from_euler('X', np.pi)


def move(rng: np.random.Generator, scenario: Scenario, samples: int) -> Motion:
    """Run programs of poses with motion between them, at 10 Hz."""
    gravity, force, omega, alpha = (np.zeros((samples, 3)) for _ in range(4))
    moving = np.zeros((samples, 1))
    base = GRAVITY * Rotation.from_rotvec([*rng.normal(0, 0.005, 2), 0]).apply([0, 0, 1])
    at, repeats = 0, 0
    program = orientations(rng, scenario.poses or 8, scenario.cone_deg)
    current = program[0]
    speed, dwell_s, reach_m = 1.0, 5.0, 0.3
    step = 0
    while at < samples:
        if repeats == 0:
            if scenario.poses is None:
                program = orientations(rng, int(rng.integers(4, 13)), scenario.cone_deg)
            speed, dwell_s, reach_m = (
                between(rng, 0.4, 1.5),
                between(rng, 2.0, 12.0),
                between(rng, 0.1, 0.6),
            )
            repeats, step = int(rng.integers(10, 40)), 0
        target = program[step % len(program)]
        step += 1
        repeats -= step % len(program) == 0
        turn = (current.inv() * target).as_rotvec()
        way = rng.normal(0, reach_m / 2, 3)
        length_s = max(1.875 * float(np.linalg.norm(turn)) / speed, 0.8 + reach_m)
        count = max(2, int(length_s * RATE))
        share = (np.arange(count) + 0.5)[:, None] / count
        done, rate, bend = smooth(share)
        rest = int(rng.exponential(dwell_s) * RATE) + RATE
        part = slice(at, min(at + count, samples))
        rows = part.stop - part.start
        rotation = current * Rotation.from_rotvec(done[:rows] * turn)
        pushed = way * bend[:rows] / length_s**2 + [0, 0, GRAVITY]
        gravity[part] = rotation.inv().apply(np.broadcast_to(base, pushed.shape))
        force[part] = rotation.inv().apply(pushed)
        omega[part], alpha[part] = turn * rate[:rows] / length_s, turn * bend[:rows] / length_s**2
        moving[part] = 1.0
        still = slice(part.stop, min(part.stop + rest, samples))
        force[still] = target.inv().apply([0, 0, GRAVITY])
        gravity[still] = target.inv().apply(base)
        at, current = still.stop, target
    return Motion(gravity, force, omega, alpha, moving)


def hold(rng: np.random.Generator, samples: int, *, part: bool) -> IntArray:
    """Pick a part up and put it down again: which payload is on, at 10 Hz."""
    states, at = np.zeros(samples, dtype=np.int64), 0
    while part and at < samples:
        at += int(between(rng, 5.0, 60.0) * RATE)
        held = int(between(rng, 5.0, 120.0) * RATE)
        states[at : at + held] = 1
        at += held
    return states


def touch(rng: np.random.Generator, samples: int, share: float) -> FloatArray:
    """Press on things for 1 to 20 s, mostly along the tool: wrench at 10 Hz, (samples, 6)."""
    at = 0
    wrench: FloatArray = np.zeros((samples, 6))
    while at < samples:
        length = int(between(rng, 1.0, 20.0) * RATE)
        direction = rng.normal(0, 0.4, 3) - [0, 0, 1]
        pressed = between(rng, 3.0, 80.0) * direction / np.linalg.norm(direction)
        at_m = np.array([*rng.normal(0, 0.03, 2), rng.uniform(0.08, 0.2)])
        at += int(rng.exponential(7.0 * (1 - share) / share) * RATE)
        part = slice(at, min(at + length, samples))
        rows = max(0, part.stop - part.start)
        swell = np.minimum(1, (np.arange(rows) + 1) / (0.3 * RATE))
        swell = swell * (1 + 0.1 * np.sin(np.arange(rows) / RATE * rng.uniform(0.3, 6)))
        wrench[part] = swell[:, None] * np.concatenate((pressed, np.cross(at_m, pressed)))
        at += length
    return wrench


def weight(payload: Payload, motion: Motion) -> FloatArray:
    """Push on the sensor with a rigid body, (samples, 6)."""
    felt = motion.force + lever(motion.omega, motion.alpha, payload.center_m)
    pushed = weight_of(payload.mass_kg, payload.center_m, felt)
    turned = payload.inertia * motion.alpha
    turned += np.cross(motion.omega, payload.inertia * motion.omega)
    return pushed - np.concatenate((0 * turned, turned), axis=1)


def weight_of(mass_kg: float, center_m: FloatArray, felt: FloatArray) -> FloatArray:
    """Push with a mass where a specific force (n, 3) is felt, (n, 6)."""
    return np.concatenate((-mass_kg * felt, np.cross(center_m, -mass_kg * felt)), axis=1)


def unit(vector: FloatArray) -> FloatArray:
    """Scale to length one."""
    return np.asarray(vector / np.linalg.norm(vector))


def seconds(values: FloatArray) -> FloatArray:
    """Means over cells of 1 s."""
    return np.asarray(values.reshape(-1, RATE, *values.shape[1:]).mean(axis=1))


def work(
    rng: np.random.Generator, scenario: Scenario, payloads: list[Payload]
) -> tuple[Work, FloatArray]:
    """Work for a day; and the specific force at the IMU, (N, 3)."""
    samples = SECONDS * RATE
    motion = move(rng, scenario, samples)
    states = hold(rng, samples, part=scenario.part)
    touched = touch(rng, samples, scenario.contacts)
    pushes = np.stack([weight(payload, motion) for payload in payloads])
    shaken = motion.moving * rng.normal(0, [0.3, 0.3, 0.3, 0.02, 0.02, 0.02], (samples, 6))
    wrench = seconds(pushes[states, np.arange(samples)] + touched + shaken)
    spin = np.sqrt(seconds(np.sum(motion.omega**2, axis=1)))
    felt = seconds(motion.force + lever(motion.omega, motion.alpha, IMU_M))
    return Work(wrench, seconds(motion.gravity), spin), felt


def measure(
    rng: np.random.Generator, gauges: Gauges, felt_c: FloatArray, true: FloatArray, tares: float
) -> tuple[FloatArray, IntArray]:
    """Read a true wrench (N, 6) with drift, noise, an offset and tares; and their cells."""
    axes, theta = len(AXES), felt_c - FACTORY_C
    hours = np.arange(len(felt_c))[:, None] / 3600
    crept = gauges.creep * rng.uniform(-1, 1, axes) * np.log1p(hours)
    zero = theta @ gauges.linear + theta**2 @ gauges.square + crept
    raw = true * (1 + theta @ gauges.gain) + zero + rng.normal(0, LOADS)
    raw += rng.normal(0, gauges.noise, raw.shape)
    tared = np.sort(rng.integers(60, len(raw) - 60, rng.poisson(tares)))
    tared = tared[np.diff(tared, prepend=-APART_S) >= APART_S]
    for at in tared:
        raw[at:] -= raw[at - 3 : at].mean(axis=0)
    return raw, tared


def working(name: str, seed: int) -> Working:
    """
    Draw a world.

    Parameters
    ----------
    name : str
        One of SCENARIOS; they share bodies, temperatures and noise.
    seed : int
        Any; the same one gives the same world.

    Returns
    -------
    Working
        Days at work, the same with an empty flange, and an empty one to be judged on.

    """
    scenario = SCENARIOS[name]
    rng = np.random.default_rng([seed, 13])
    others = draw_others(rng)
    body = network(rng, others)
    sources = draw_sources(rng, others)
    thermometers = draw_thermometers(rng, body, 2, 'network')
    gauges = draw_gauges(rng, body, 'network')
    node = thermometers.nodes[0]
    nights = [draw_day(rng, body, sources, SECONDS) for _ in range(DAYS + 1)]
    learnt = np.concatenate([day[:, node] for _, day in nights[:-1]])
    shift = shift_of(rng, learnt, nights[-1][1][:, node])
    nights[-1] = (nights[-1][0] + shift, nights[-1][1] + shift)
    seen = [read(rng, thermometers, *night) for night in nights]
    rng = np.random.default_rng([seed, 14, list(SCENARIOS).index(name)])
    payloads = draw_payloads(np.random.default_rng([seed, 15]), part=scenario.part)
    rotation = Rotation.random(random_state=seed) if not scenario.tf else Rotation.identity()
    crooked = Rotation.from_rotvec(np.deg2rad(scenario.turned_deg) * unit(rng.normal(size=3)))
    imu = Accelerometer(
        rotation * crooked,
        rng.normal(0, 0.1, 3),
        1 + scenario.scale_error * rng.choice([-1, 1], 3),
        rng.normal(0, 0.003, 3),
    )
    days, empty, tares = [], [], 0
    for number, (_, felt_c) in enumerate(nights):
        nothing = np.zeros((SECONDS, len(AXES)))
        again = np.random.default_rng([seed, 16, number])
        raw, _ = measure(again, gauges, felt_c, nothing, 0.0)
        empty.append(recording_of(seen[number], raw))
        if number == DAYS:
            break
        day, felt = work(rng, scenario, payloads)
        again = np.random.default_rng([seed, 16, number])
        wrench, tared = measure(again, gauges, felt_c, day.wrench, scenario.tares)
        force = day.gravity if scenario.tf else imu.read(rng, felt, felt_c[:, node])
        recording = recording_of(seen[number], wrench)
        days.append(replace(recording, specific_force=force, rotation_speed=day.spin))
        tares += len(tared)
    return Working(days, empty[:-1], empty[-1], payloads, tares)
