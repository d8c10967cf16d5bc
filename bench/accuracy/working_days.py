"""
Days of a robot at work, in worlds that nobody tuned on, and the same days with an empty flange.

Bodies, gauges and thermometers are those of ``worlds_drawn``: random thermal networks. The robot
of ``robot_at_work`` moves with a tool, picks parts up and puts them down, and presses on things.
What it does is looked up at 10 Hz and averaged over cells of 1 s. Specific force comes from an
accelerometer (turned, biased, scaled, drifting with temperature, noisy), or is gravity by TF,
which knows no acceleration and stands on a base that is not quite level. Drivers tare.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

from judging import recording_of
import numpy as np
from scipy.spatial.transform import Rotation
from thermal_networks import between, draw_day, draw_others, draw_sources, network
from worlds_drawn import draw_gauges, draw_thermometers, FACTORY_C, Gauges, LOADS, read, shift_of

from wrist_ft_comp.channels import AXES, GRAVITY
from wrist_ft_comp.payload.weight import Payload
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import FloatArray, IntArray
from wrist_ft_comp.simulation import robot_at_work as robots

RATE = 10
DAYS, SECONDS = 4, 9000
#: Tares of the driver are at least so far apart, s.
APART_S = 300


@dataclass(frozen=True)
class Scenario:
    """What the worlds of a scenario have in common."""

    title: str
    part: bool = True
    tool_is_read: bool = True
    #: Different poses of a day; None: a new one for each leg.
    poses: int | None = None
    contacts: float = 0.15
    #: Largest angle between the tool and the vertical, degrees.
    cone_deg: float = 180.0
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
    'subtracted': Scenario('part, TF; tool subtracted', tool_is_read=False, tf=True),
}


class Worked(NamedTuple):
    """A day at work in cells of 1 s."""

    #: True wrench, N and N m, (N, 6).
    wrench: FloatArray
    #: By TF or by the accelerometer, m/s², (N, 3).
    force: FloatArray
    #: RMS speed of rotation, rad/s, (N,).
    speed: FloatArray
    payloads: tuple[Payload, ...]


@dataclass(frozen=True, eq=False)
class Working:
    """Days at work and with an empty flange, an empty day to judge, payloads, drivers' tares."""

    days: list[Recording]
    empty: list[Recording]
    judged: Recording
    payloads: tuple[Payload, ...]
    tares: int


def draw_imu(rng: np.random.Generator, scenario: Scenario) -> robots.Accelerometer:
    """Draw an accelerometer that is mounted in any way."""
    crooked = rng.normal(size=3)
    crooked *= np.deg2rad(scenario.turned_deg) / np.linalg.norm(crooked)
    mounted = Rotation.random(random_state=int(rng.integers(2**31)))
    scale = 1 + scenario.scale_error * rng.choice([-1, 1], 3)
    turned = mounted * Rotation.from_rotvec(crooked)
    return replace(robots.draw_accelerometer(rng), rotation=turned, scale=scale)


def work(
    rng: np.random.Generator, scenario: Scenario, tools: int, imu: robots.Accelerometer,
    warm_k: FloatArray,
) -> Worked:  # fmt: skip
    """Work for a day with the payloads that ``tools`` draws, beside warmth (N,), K."""
    masses = np.random.default_rng([tools, 1])
    tool_kg, part_kg = between(masses, 0.7, 2.5), between(masses, 0.4, 2.5)
    tool_kg, part_kg = tool_kg * scenario.tool_is_read, part_kg * scenario.part
    settings = robots.WorkSettings(tool_kg, part_kg, scenario.contacts, between(rng, 0.4, 1.5))
    drawn = robots.draw_work(settings, rng, np.random.default_rng(tools))
    # The tool points down within a cone; a day of few poses returns to them.
    legs = len(drawn.turns)
    tilt = np.arccos(rng.uniform(np.cos(np.deg2rad(scenario.cone_deg)), 1, legs))
    turns = rng.uniform(-np.pi, np.pi, (2, legs))
    down = Rotation.from_euler('ZYZ', np.stack((turns[0], tilt, turns[1]), axis=1))
    poses = (down * Rotation.from_euler('X', np.pi))[np.arange(legs) % (scenario.poses or legs)]
    turned = (poses.inv() * poses[np.r_[1:legs, 0]]).as_rotvec()
    motion = robots.move(
        replace(drawn, poses=poses, turns=turned), (np.arange(len(warm_k) * RATE) + 0.5) / RATE
    )
    if scenario.tf:
        base = GRAVITY * Rotation.from_rotvec([*rng.normal(0, 0.005, 2), 0]).apply([0, 0, 1])
        force = motion.pose.inv().apply(np.broadcast_to(base, motion.force.shape))
    else:
        force = robots.read_imu(imu, motion, np.repeat(warm_k, RATE), rng)[:, :3]
    wrench, force, squares = (
        part.reshape(-1, RATE, part.shape[1]).mean(axis=1)
        for part in (motion.weight + motion.contact, force, motion.omega**2)
    )
    payloads = tuple(payload for payload in drawn.payloads if payload.mass_kg)
    return Worked(wrench, force, np.sqrt(squares.sum(axis=1)), payloads)


def measure(
    rng: np.random.Generator, gauges: Gauges, felt_c: FloatArray, true: FloatArray, tares: float
) -> tuple[FloatArray, IntArray]:
    """Read a true wrench (N, 6) with drift, noise, an offset and tares; and their cells."""
    raw = true + gauges.drift(rng, felt_c, true) + rng.normal(0, LOADS)
    raw += rng.normal(0, gauges.noise, raw.shape)
    tared = np.sort(rng.integers(60, len(raw) - 60, rng.poisson(tares)))
    tared = tared[np.diff(tared, prepend=-APART_S) >= APART_S]
    for at in tared:
        raw[at:] -= raw[at - 3 : at].mean(axis=0)
    return raw, tared


def working(name: str, seed: int) -> Working:
    """Draw a world of one of SCENARIOS, which share bodies, temperatures and noise."""
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
    imu = draw_imu(rng, scenario)
    days, empty, tares = [], [], 0
    payloads: tuple[Payload, ...] = ()
    for number, (_, felt_c) in enumerate(nights):
        again = [np.random.default_rng([seed, 16, number]) for _ in range(2)]
        raw, _ = measure(again[0], gauges, felt_c, np.zeros((SECONDS, len(AXES))), 0.0)
        empty.append(recording_of(seen[number], raw))
        if number == DAYS:
            break
        day = work(rng, scenario, seed, imu, felt_c[:, node] - FACTORY_C)
        raw, tared = measure(again[1], gauges, felt_c, day.wrench, scenario.tares)
        recording = recording_of(seen[number], raw)
        recording = replace(recording, specific_force=day.force, rotation_speed=day.speed)
        days.append(recording)
        tares, payloads = tares + len(tared), day.payloads
    return Working(days, empty[:-1], empty[-1], payloads, tares)
