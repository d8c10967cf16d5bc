"""
Worlds to learn from and to be judged on, drawn by seed.

``family(name, seed)`` gives a ``World``: ``learn`` (a list of Recording), ``judge`` (a Recording),
``truth``, the drift of the judged day without its noise, shape (N, 6), axis order AXES, and
``reference``, what to tell the calibration. Recordings have thermal cells of 1 s, the raw wrench
and its reference; the drift is raw minus reference. ``FAMILIES`` names the families.
"""

from dataclasses import dataclass, field

from judging import recording_of
import numpy as np
import thermal_networks as networks
from thermal_networks import Body, draw_day, lag, network, rod

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.recording import Recording, Reference
from wrist_ft_comp.series import FloatArray, IntArray

#: °C at which the sensor was calibrated at its factory, and newtons (or N m) of drift per kelvin.
FACTORY_C = 22.0
UNITS = np.array([1.0, 1.0, 1.0, 0.05, 0.05, 0.05])
LOADS = np.array([20.0, 20.0, 20.0, 1.0, 1.0, 1.0])
QUANTA_K = (0.01, 0.03125, 0.0625, 0.1)
#: Share of its heat that each day has where days get unequally hot.
UNEQUAL = (1.0, 0.1, 0.3)


@dataclass(frozen=True, eq=False)
class World:
    """Recordings to learn from, one to be judged on, and its drift (N, 6) without noise."""

    learn: list[Recording]
    judge: Recording
    truth: FloatArray
    reference: Reference = 'recorded'
    #: What nobody learns from who has ``learn`` only.
    more: list[Recording] = field(default_factory=list)


@dataclass(frozen=True)
class Family:
    """What the worlds of a family have in common; without thermometers: one or two of them."""

    title: str
    thermometers: int
    days: int
    hours: float = 2.5
    loaded: bool = False
    body: str = 'network'
    #: Some of the days get hot, some hardly do.
    unequal: bool = False
    #: Days to learn from are warm-ups that come to rest.
    steady: bool = False
    #: How much warmer the hall is on the second day than on the first; on the last, in between, K.
    warmer_k: float = 0.0


FAMILIES: dict[str, Family] = {
    'two_four': Family('two thermometers, four loaded days', 2, 4, loaded=True),
    'one_three': Family('one thermometer, three days', 1, 3),
    'long_day': Family('a single long day', 0, 1, hours=8.0),
    'two_days': Family('two days', 0, 2),
    'single_lag': Family('a single lag', 1, 3, body='lag'),
    'nothing': Family('nothing to learn', 0, 3, body='nothing'),
    'rod_two': Family('rod, two thermometers, four loaded days', 2, 4, loaded=True, body='rod'),
    'rod_one': Family('rod, one thermometer, three days', 1, 3, body='rod'),
}
#: The families of little data: name, title, days and hours a day.
LITTLE = (
    ('half_day', 'half a day of 90 min', 1, 1.5),
    ('one_day', 'one day of 3 h', 1, 3.0),
    ('two_days', 'two days of 3 h', 2, 3.0),
)
_WORDS = {1: 'one thermometer', 2: 'two thermometers', 3: 'three thermometers'}
FAMILIES |= {
    f'{name}_{body}_{count}': Family(f'{title}, {body}, {words}', count, days, hours, body=body)
    for name, title, days, hours in LITTLE
    for body in ('network', 'rod')
    for count, words in _WORDS.items()
}
FAMILIES |= {
    f'unequal_{count}': Family(f'three days unequally hot, {words}', count, 3, unequal=True)
    for count, words in list(_WORDS.items())[:2]
}
FAMILIES |= {
    f'warm_up_{count}': Family(f'one warm-up of 3 h, {words}', count, 1, 3.0, steady=True)
    for count, words in _WORDS.items()
}
FAMILIES |= {
    f'short_{count}': Family(f'three recordings of 20 min, {words}', count, 3, 1 / 3)
    for count, words in _WORDS.items()
}
FAMILIES |= {
    f'halls_{count}': Family(f'two halls, 20 K apart, {words}', count, 2, 3.0, warmer_k=20.0)
    for count, words in _WORDS.items()
}


@dataclass(frozen=True, eq=False)
class Gauges:
    """How six axes see n nodes."""

    #: Zero drift per K and per K², and gain drift per K, (n, 6).
    linear: FloatArray
    square: FloatArray
    gain: FloatArray
    #: Largest zero drift of a day without any temperature, and noise of a cell, (6,).
    creep: FloatArray
    noise: FloatArray

    def drift(self, rng: np.random.Generator, felt_c: FloatArray, true: FloatArray) -> FloatArray:
        """Drift of a day in cells of 1 s, from its nodes (N, n) and its true wrench, (N, 6)."""
        theta, hours = felt_c - FACTORY_C, np.arange(len(felt_c))[:, None] / 3600
        crept = self.creep * rng.uniform(-1, 1, len(AXES)) * np.log1p(hours)
        zero: FloatArray = theta @ self.linear + theta**2 @ self.square + crept
        return zero + theta @ self.gain * true


@dataclass(frozen=True, eq=False)
class Thermometers:
    """Where they are, and their lag, noise and quantum."""

    nodes: IntArray
    lag_s: FloatArray
    noise_k: FloatArray
    quantum_k: float


def draw_gauges(rng: np.random.Generator, body: Body, kind: str) -> Gauges:
    """Mix temperatures, differences between neighbours and squares, axis by axis."""
    axes, nodes = len(AXES), body.nodes
    if kind == 'rod':
        first = int(rng.integers(8, 20))
        flexure: IntArray = np.arange(first, first + 12)
        pairs = np.stack((flexure[:6], flexure[6:]), axis=1)
    else:
        pairs = body.edges
        flexure = rng.choice(nodes, min(nodes, int(rng.integers(1, 4))), replace=False)
    linear = np.zeros((nodes, axes))
    linear[flexure] = rng.dirichlet(np.ones(len(flexure)), axes).T * rng.choice([-1, 1], axes)
    for _ in range(2):
        ends = pairs[rng.integers(len(pairs), size=axes)]
        weight = rng.normal(0, 0.5, axes)
        linear[ends[:, 0], np.arange(axes)] += weight
        linear[ends[:, 1], np.arange(axes)] -= weight
    square = np.zeros_like(linear)
    square[rng.choice(flexure, axes), np.arange(axes)] = rng.normal(0, 0.01, axes)
    gain = np.zeros_like(linear)
    gain[rng.choice(flexure, axes), np.arange(axes)] = rng.normal(0, 4e-4, axes)
    size = UNITS * np.exp(rng.uniform(np.log(0.3), np.log(3.0), axes))
    drifts = (rng.random(axes) > 0.02) & (kind != 'nothing')
    creep = size * np.where(rng.random(axes) < 0.1, np.exp(rng.uniform(-4, -1, axes)), 0.0)
    noise = size * np.exp(rng.uniform(np.log(0.01), np.log(0.1), axes))
    return Gauges(size * drifts * linear, size * drifts * square, gain * drifts, creep, noise)


def draw_thermometers(rng: np.random.Generator, body: Body, count: int, kind: str) -> Thermometers:
    """Put thermometers at random nodes; of a rod, one near each end."""
    if kind == 'rod':
        ends = [rng.integers(20, 38), rng.integers(2, 10)]
        nodes = np.array([*ends, *([rng.integers(10, 20)] if count > 2 else [])])[:count]
    else:
        nodes = rng.choice(body.nodes, count, replace=False)
    slowest_s = 2.0 if kind == 'lag' else 60.0
    return Thermometers(
        nodes,
        np.exp(rng.uniform(0, np.log(slowest_s), count)),
        np.exp(rng.uniform(np.log(0.005), np.log(0.05), count)),
        float(rng.choice(QUANTA_K)),
    )


def read(
    rng: np.random.Generator, thermometers: Thermometers, night: FloatArray, day: FloatArray
) -> FloatArray:
    """Read the thermometers, shape (N, J)."""
    columns = []
    for j, node in enumerate(thermometers.nodes):
        seen = lag(day[:, [node]], thermometers.lag_s[j], night[-1, [node]])[:, 0]
        noisy = seen + rng.normal(0, thermometers.noise_k[j], len(seen))
        columns.append(thermometers.quantum_k * np.round(noisy / thermometers.quantum_k))
    return np.stack(columns, axis=1)


def record(
    rng: np.random.Generator, gauges: Gauges, temperature_c: FloatArray, day: FloatArray, load: int
) -> tuple[Recording, FloatArray]:
    """Read a day's wrench under loads that change every 5 s, and its drift without noise."""
    cells, axes = len(day), len(AXES)
    held = rng.normal(0, LOADS, (cells // 5 + 1, axes)) + rng.normal(0, LOADS / 2, axes)
    true = load * np.repeat(held, 5, axis=0)[:cells]
    drift = gauges.drift(rng, day, true)
    offset = rng.normal(0, LOADS)
    raw = true + drift + offset + rng.normal(0, gauges.noise, (cells, axes))
    return recording_of(temperature_c, raw, true), drift


def shift_of(rng: np.random.Generator, learnt: FloatArray, judged: FloatArray) -> float:
    """Often move a day up to a third of the calibrated span beyond all learnt days, K."""
    beyond = float(rng.uniform(0, 1 / 3)) * float(np.ptp(learnt))
    side = rng.random()
    if side < 0.35:
        return float(learnt.max() - judged.max()) + beyond
    return float(learnt.min() - judged.min()) - beyond if side < 0.6 else 0.0


def family(name: str, seed: int, more: int = 0) -> World:
    """
    Draw a world of one of FAMILIES; the same seed gives the same world.

    ``more`` are days beyond those of the family; another number gives another day to be judged on.
    """
    kind = FAMILIES[name]
    rng = np.random.default_rng([seed, list(FAMILIES).index(name)])
    others = networks.draw_others(rng)
    if kind.body in {'rod', 'lag'}:  # a rod's other end; a lag is not seen to begin at rest
        others[networks.COOLANT] = kind.body == 'rod'
    body = rod(rng, others) if kind.body == 'rod' else network(rng, others)
    sources = networks.draw_sources(rng, others)
    thermometers = draw_thermometers(
        rng, body, kind.thermometers or int(rng.integers(1, 3)), kind.body
    )
    gauges = draw_gauges(rng, body, kind.body)
    tau_s = networks.between(rng, 60.0, 2400.0)
    days: list[tuple[FloatArray, FloatArray]] = []
    for number in range(kind.days + more + 1):
        last = number == kind.days + more
        seconds = int(3600 * (2.5 if last else kind.hours))
        night, day = draw_day(rng, body, sources, seconds, steady=kind.steady and not last)
        if kind.unequal and number < kind.days:
            heat = UNEQUAL[number] * rng.uniform(0.7, 1.0)
            base_c = float(day[0].mean())
            night, day = (base_c + heat * (values_c - base_c) for values_c in (night, day))
        if kind.warmer_k:
            shift = kind.warmer_k * (float(rng.uniform(0, 1)) if last else number)
            night, day = night + shift, day + shift
        elif last:
            node = thermometers.nodes[0]
            learnt = np.concatenate([earlier[:, node] for _, earlier in days[: kind.days]])
            shift = shift_of(rng, learnt, day[:, node])
            night, day = night + shift, day + shift
        days.append((night, day))
    recorded = []
    for night, day in days:
        readings = read(rng, thermometers, night, day)
        felt = day
        if kind.body == 'lag':
            seen = np.repeat(night[:, thermometers.nodes], body.nodes, axis=1)
            slept = lag(seen, tau_s, seen[0], networks.NIGHT_STEP_S)[-1]
            felt = lag(np.repeat(day[:, thermometers.nodes], body.nodes, axis=1), tau_s, slept)
        recorded.append(record(rng, gauges, readings, felt, int(kind.loaded)))
    learn = [recording for recording, _ in recorded[:-1]]
    return World(learn[: kind.days], *recorded[-1], more=learn[kind.days :])
