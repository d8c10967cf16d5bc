"""
Simulated years of a robot at work: rooms with seasons, weekends, and what happens to sensors.

``Year(seed)`` draws one; ``day(number)`` gives a day at work, as a node would have recorded it,
and its true drift. Bodies, gauges and work are those of ``working_days``; robots rest at weekends.
Once a year the robot is moved (other sources of heat and another room), its tool is changed, it
crashes (the zero jumps), a thermometer stops and is replaced days later, and on one day it is in
contact nearly all the time.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

from judging import block_means, recording_of
import numpy as np
from thermal_networks import between, Body, draw_day, draw_others, draw_sources, network, SUN
from working_days import draw_imu, measure, SCENARIOS, SECONDS, work
from worlds_drawn import draw_gauges, draw_thermometers, FACTORY_C, read, UNITS

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import FloatArray, NANOSECONDS

#: Seconds of a thermal cell.
CELL_S = 2
#: Share of the time in contact on a day of wrong contacts.
PRESSED = 0.9


@dataclass(frozen=True, eq=False)
class YearDay:
    """A day as it was recorded, and its true drift (N, 6), N and N m."""

    number: int
    recording: Recording
    drift: FloatArray


@dataclass(frozen=True)
class Events:
    """Numbers of days on which something happens."""

    moved: int
    tool: int
    crash: int
    #: A thermometer stops, and is replaced.
    stopped: int
    replaced: int
    pressed: int

    def named(self) -> dict[str, int]:
        """Days on which something happens that has to be named, by its kind."""
        return {
            'tool': self.tool,
            'zero': self.crash,
            'thermometer': self.stopped,
            'contacts': self.pressed,
        }


class Year:
    """A robot's year; days are drawn one by one, in any order."""

    def __init__(self, seed: int, length: int = 365) -> None:
        rng = np.random.default_rng([seed, 31])
        self._seed = seed
        others = draw_others(rng)
        self._body = network(rng, others)
        self._sources = [draw_sources(rng, others) for _ in range(2)]
        self._neighbour = _moved(rng, self._body)
        self._thermometers = draw_thermometers(rng, self._body, 2, 'network')
        self._gauges = draw_gauges(rng, self._body, 'network')
        self._imu = draw_imu(rng, SCENARIOS['part'])
        #: Days on which the robot works.
        self.worked = [number for number in range(length) if number % 7 < 5]
        self._swing_k, self._phase = between(rng, 3.0, 9.0), rng.uniform(0, 365)
        self._rooms_k = [0.0, float(rng.uniform(-5, 5))]
        self._offset_k = rng.normal(0, 0.3)
        at = rng.choice(np.arange(15, len(self.worked) - 15, 12), 5, replace=False)
        moved, tool, crash, stopped, pressed = (self.worked[i] for i in at)
        replaced = self.worked[int(at[3]) + int(rng.integers(2, 6))]
        self.events = Events(moved, tool, crash, stopped, replaced, pressed)
        self._jump = rng.choice([-1, 1], 6) * UNITS * rng.uniform(3, 12, 6)
        self._silent = bool(rng.random() < 0.5)

    def _warmed(self, number: int) -> tuple[FloatArray, FloatArray]:
        """Temperatures of the nodes (N, n) and of the thermometers (N, J), every second, °C."""
        rng = np.random.default_rng([self._seed, 32, number])
        moved = number >= self.events.moved
        body = self._neighbour if moved else self._body
        night, felt_c = draw_day(rng, body, self._sources[moved], SECONDS)
        season = self._swing_k * np.sin(2 * np.pi * (number - self._phase) / 365)
        shift = season + self._rooms_k[moved]
        seen = read(rng, self._thermometers, night + shift, felt_c + shift)
        if number >= self.events.replaced:
            seen[:, 1] += self._offset_k
        return felt_c + shift, seen

    def day(
        self, number: int, burden: Callable[[FloatArray], FloatArray] | None = None
    ) -> YearDay:
        """Draw a day at work; ``burden`` changes the wrench of every second, N and N m, (N, 6)."""
        events = self.events
        felt_c, seen_c = self._warmed(number)
        rng = np.random.default_rng([self._seed, 33, number])
        warm_k = felt_c[:, self._thermometers.nodes[0]] - FACTORY_C
        tools = 2 * self._seed + (number >= events.tool)
        true = work(rng, SCENARIOS['part'], tools, self._imu, warm_k)
        wrench = true.wrench if burden is None else burden(true.wrench)
        if number == events.pressed:
            pushes = rng.normal(0, 20, (SECONDS // 10, 6)) * [1, 1, 1, 0.1, 0.1, 0.1]
            pushes *= rng.random((len(pushes), 1)) < PRESSED
            wrench = wrench + np.repeat(pushes, 10, axis=0)
        again = [np.random.default_rng([self._seed, 34, number]) for _ in range(2)]
        raw, _ = measure(again[0], self._gauges, felt_c, wrench, 0.25)
        quiet = replace(self._gauges, noise=0 * self._gauges.noise)
        drift, _ = measure(again[1], quiet, felt_c, np.zeros_like(raw), 0.0)
        if number == events.crash:
            raw[int(rng.integers(1800, SECONDS - 1800)) :] += self._jump
        measured = np.ones(seen_c.shape, dtype=bool)
        if events.stopped <= number < events.replaced:
            at = int(rng.integers(600, SECONDS // 2)) if number == events.stopped else 0
            seen_c[at:, 1] = seen_c[at, 1] if at else 24.0
            measured[at:, 1] = not self._silent
        speed = np.sqrt(block_means(true.speed[:, None] ** 2, CELL_S)[:, 0])
        recording = replace(
            _recorded(number, seen_c, raw),
            first_cell=number * 86_400 // CELL_S,
            measured=measured[::CELL_S],
            specific_force=block_means(true.force, CELL_S),
            rotation_speed=speed,
        )
        return YearDay(number, recording, block_means(drift, CELL_S))

    def warm_up(self, number: int) -> Recording:
        """Record a day with an empty flange, as somebody does who calibrates by hand."""
        felt_c, seen_c = self._warmed(number)
        rng = np.random.default_rng([self._seed, 35, number])
        raw, _ = measure(rng, self._gauges, felt_c, np.zeros((SECONDS, len(AXES))), 0.0)
        return _recorded(number, seen_c, raw)


def _recorded(number: int, seen_c: FloatArray, raw: FloatArray) -> Recording:
    """Record temperatures (N, J) and wrenches (N, 6) of every second in cells of CELL_S."""
    recording = recording_of(block_means(seen_c, CELL_S), block_means(raw, CELL_S))
    return replace(recording, name=day_name(number), period_ns=CELL_S * NANOSECONDS)


def day_name(number: int) -> str:
    """Name a day's file."""
    return f'day_{number:03d}.csv'


def _moved(rng: np.random.Generator, body: Body) -> Body:
    """Let other neighbours shine on another node."""
    node, strength = int(rng.integers(body.nodes)), between(rng, 0.3, 1.5)
    size = np.linalg.norm(body.inlets[:, 2])
    inlets = body.inlets.copy()
    shone = body.shapes[node] / np.linalg.norm(body.shapes[node])
    inlets[:, SUN] = strength * size * shone
    return replace(body, inlets=inlets)
