"""
Bodies that conduct heat, and days that warm them: none of them is the package's own simulator.

A body is a network of heat capacities; a conducting rod is one with forty in a row. Temperatures
are exact for drives that are constant over a step, because every mode of the body runs by itself.
Drives are, in this order: room and coolant, °C; motor and sun, as a share of their full power.
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from wrist_ft_comp.series import BoolArray, FloatArray, IntArray

ROOM, COOLANT, MOTOR, SUN = range(4)
NIGHT_S, NIGHT_STEP_S = 36_000, 60.0
DAY_S = 86_400.0


@dataclass(frozen=True, eq=False)
class Body:
    """A body with n nodes, C dT/dt = -K T + B u, in modal form; edges join neighbouring nodes."""

    #: Of the modes, 1/s, (n,).
    rates: FloatArray
    #: Temperatures of the nodes (rows) for modal amplitudes of one (columns), (n, n).
    shapes: FloatArray
    #: Change of the amplitudes by the drives, per second, (n, 4).
    inlets: FloatArray
    #: Pairs of nodes, (E, 2).
    edges: IntArray

    @property
    def nodes(self) -> int:
        """Count the nodes."""
        return len(self.rates)


@dataclass(frozen=True)
class Sources:
    """How strongly a world's heat sources act: K of room and coolant, and share of the motor."""

    room_swing_k: float
    room_steps_k: float
    coolant_swing_k: float
    coolant_offset_k: float
    motor_share: float


def between(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a positive number, evenly on a logarithmic scale."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def lag(values: FloatArray, tau_s: float, start: FloatArray, period_s: float = 1.0) -> FloatArray:
    """Pass columns through a first-order lag from given values, shape (N, C)."""
    pole = np.exp(-period_s / tau_s)
    return np.asarray(lfilter([1 - pole], [1, -pole], values, axis=0, zi=pole * start[None])[0])


def temperatures(
    body: Body, drive: FloatArray, start: FloatArray, period_s: float = 1.0
) -> FloatArray:
    """
    Warm a body by drives (N, 4), each of them constant over a step of ``period_s``.

    From the nodes before the first step (n,) to those at the end of each, (N, n), °C.
    """
    poles = np.exp(-body.rates * period_s)
    pushed = drive @ (body.inlets * ((1 - poles) / body.rates)[:, None]).T
    amplitudes = np.linalg.solve(body.shapes, start)
    modes = [
        lfilter([1.0], [1.0, -pole], column, zi=[pole * amplitude])[0]
        for pole, column, amplitude in zip(poles, pushed.T, amplitudes, strict=True)
    ]
    return np.asarray(np.stack(modes, axis=1) @ body.shapes.T)


def resting(body: Body, drive: FloatArray) -> FloatArray:
    """Temperatures of the nodes after a long time of one drive (4,), shape (n,)."""
    return np.asarray(body.shapes @ (body.inlets @ drive / body.rates))


def network(rng: np.random.Generator, others: BoolArray) -> Body:
    """Draw 3 to 12 nodes: a random tree and some more couplings."""
    nodes = int(rng.integers(3, 13))
    edges = [(int(rng.integers(max(0, i - 3), i)), i) for i in range(1, nodes)]
    edges += [tuple(rng.choice(nodes, 2, replace=False)) for _ in range(nodes // 3)]
    conductance = np.exp(rng.uniform(np.log(0.3), np.log(10.0), len(edges)))
    capacity = np.exp(rng.uniform(np.log(10.0), np.log(300.0), nodes))
    room = np.exp(rng.uniform(np.log(0.005), np.log(0.05), nodes))
    room[int(rng.integers(nodes))] += between(rng, 0.1, 0.5)
    inlet = place_sources(rng, rng.integers(nodes, size=3), room, others)
    return body_of(rng, capacity, np.array(edges), conductance, inlet)


def rod(rng: np.random.Generator, others: BoolArray) -> Body:
    """Draw a rod of forty pieces between motor (first) and tool (last), losing heat on its way."""
    nodes = 40
    edges = np.stack((np.arange(nodes - 1), np.arange(1, nodes)), axis=1)
    room = np.full(nodes, between(rng, 0.002, 0.01))
    room[-1] += between(rng, 0.05, 0.5)
    capacity = np.full(nodes, 10.0)
    capacity[[0, -1]] += np.exp(rng.uniform(np.log(20.0), np.log(300.0), 2))
    conductance = np.full(nodes - 1, between(rng, 8.0, 40.0))
    at = np.array([nodes - 1, 0, rng.integers(nodes, size=3)[2]])
    inlet = place_sources(rng, at, room, others)
    return body_of(rng, capacity, edges, conductance, inlet)


def place_sources(
    rng: np.random.Generator, at: IntArray, room: FloatArray, others: BoolArray
) -> FloatArray:
    """Let coolant, motor and sun act at a node each, the room everywhere, shape (n, 4)."""
    inlet = np.zeros((len(room), 4))
    inlet[:, ROOM] = room
    inlet[at[0], COOLANT] = between(rng, 0.3, 2.0) * others[COOLANT]
    inlet[at[1], MOTOR] = 1.0
    inlet[at[2], SUN] = float(others[SUN])
    return inlet


def body_of(
    rng: np.random.Generator,
    capacity: FloatArray,
    edges: IntArray,
    conductance: FloatArray,
    inlet: FloatArray,
) -> Body:
    """Find the modes, scale the slowest time constant and the powers."""
    stiffness = np.diag(inlet[:, ROOM] + inlet[:, COOLANT])
    for (i, j), value in zip(edges, conductance, strict=True):
        stiffness[[i, j], [i, j]] += value
        stiffness[[i, j], [j, i]] -= value
    root = np.sqrt(capacity)
    rates, vectors = np.linalg.eigh(stiffness / np.outer(root, root))
    shapes = vectors / root[:, None]
    inlets = shapes.T @ inlet
    scale = 1.0 / (between(rng, 900.0, 7200.0) * rates[0])
    body = Body(rates * scale, shapes, inlets * scale, edges)
    for source, low, high in ((MOTOR, 12.0, 40.0), (SUN, 10.0, 40.0)):
        warmed = float(resting(body, np.eye(4)[source]) @ capacity / capacity.sum())
        inlets[:, source] *= between(rng, low, high) / warmed if warmed > 0 else 0.0
    return Body(rates * scale, shapes, inlets * scale, edges)


def draw_others(rng: np.random.Generator) -> BoolArray:
    """Draw which sources act beside the motor, mostly two of them, shape (4,)."""
    others = np.zeros(4, dtype=bool)
    count = rng.choice(3, p=(0.05, 0.35, 0.6))
    others[rng.choice([ROOM, COOLANT, SUN], count, replace=False)] = True
    return others


def draw_sources(rng: np.random.Generator, others: BoolArray) -> Sources:
    """Draw how strongly room, coolant and motor swing."""
    return Sources(
        room_swing_k=between(rng, 4.0, 16.0) if others[ROOM] else 0.5,
        room_steps_k=float(rng.uniform(1.0, 5.0)) if others[ROOM] else 0.0,
        coolant_swing_k=float(rng.uniform(3.0, 12.0)),
        coolant_offset_k=float(rng.uniform(-4.0, 10.0)),
        motor_share=float(rng.uniform(0.5, 1.0)),
    )


def levels(rng: np.random.Generator, steps: int, low: float, high: float) -> FloatArray:
    """Draw shares 0 to 1 that last between low and high steps, a third of them 0, shape (N,)."""
    lengths = rng.uniform(low, high, int(steps / low) + 1).astype(int) + 1
    drawn = rng.uniform(0, 1, len(lengths)) * (rng.random(len(lengths)) > 0.35)
    return np.asarray(np.repeat(drawn, lengths)[:steps])


def draw_day(
    rng: np.random.Generator, body: Body, sources: Sources, seconds: int, *, steady: bool = False
) -> tuple[FloatArray, FloatArray]:
    """
    Work for some seconds, after a night that the room has left in the body.

    A steady motor works alike all day, and nothing else changes: temperatures only rise, and come
    to rest. Gives temperatures of the nodes in the night, (NIGHT_S / NIGHT_STEP_S, n), and by day,
    (seconds, n), °C.
    """
    night: FloatArray = np.arange(-NIGHT_S, 0, NIGHT_STEP_S, dtype=float)
    day: FloatArray = np.arange(seconds, dtype=float)
    base_c, phase_s = float(rng.uniform(17.0, 27.0)), float(rng.uniform(0.0, DAY_S))
    switch_s, clouds = between(rng, 1200.0, 3600.0), levels(rng, seconds, 300, 3000)
    doors = lag(levels(rng, seconds, 600, 3600)[:, None], 600.0, np.zeros(1))[:, 0]

    def boundaries(time_s: FloatArray) -> FloatArray:
        drive = np.zeros((len(time_s), 4))
        drive[:, ROOM] = base_c + sources.room_swing_k / 2 * np.sin(
            2 * np.pi * (time_s - phase_s) / DAY_S
        )
        square = np.where((time_s + phase_s) // switch_s % 2 == 0, 0.5, -0.5)
        drive[:, COOLANT] = base_c + sources.coolant_offset_k + sources.coolant_swing_k * square
        return drive

    before = boundaries(night)
    evening = before[0] + np.eye(4)[MOTOR] * sources.motor_share * rng.uniform(0, 0.6)
    if rng.random() < 0.3:  # already at work before the day is recorded
        hours = float(rng.uniform(0.1, 1.5))
        before[night >= -3600 * hours, MOTOR] = sources.motor_share * rng.uniform(0, 1)
    slept = temperatures(body, before, resting(body, evening), NIGHT_STEP_S)
    drive = boundaries(day)
    drive[:, ROOM] += sources.room_steps_k * doors
    drive[:, MOTOR] = sources.motor_share * levels(rng, seconds, 600, 1800)
    drive[:, SUN] = clouds * np.sin(np.pi * np.clip(day / DAY_S * 2 + 0.2, 0, 1))
    if steady:
        drive[:] = drive[0]
        drive[:, MOTOR] = sources.motor_share
    return slept, temperatures(body, drive, slept[-1])
