"""
Kill the node again and again while a thermometer is out: its drift must not step.

Two thermometers of a sensor that warms up; the second one freezes at a random moment, so that its
prediction takes its place. The node is killed by SIGKILL at random moments from before that on, is
away for some seconds, and goes on from its state. Two neighbouring drifts may differ by what the
limit of the drift's rate allows in the time between them; with the healthy stream, which nobody
killed, a lie of the thermometer would show. Stamps run SPEED times faster than the clock.
"""

import argparse
from contextlib import closing
import itertools
from pathlib import Path
import time
from typing import Any

from geometry_msgs.msg import WrenchStamped
import numpy as np
from restart import LONGEST_GAP_S, LOOK_NS, SAVE_PERIOD_S, SPEED, START_NS
from sensor_msgs.msg import Temperature
from stand import COLD_C, GAINS, make_model, message, NODE, NOISE, Stand, tell

from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.signals import AXES, FloatArray, NANOSECONDS
from wrist_ft_comp.stored.model_file import load_model
from wrist_ft_comp.stored.state_file import load_state
from wrist_ft_comp.stream.compensator import Compensator, StreamSettings

#: Length of a day, s, and of what the model is learnt from.
DAY_S, LEARNT_S = 1800, 10_800
#: When the second thermometer freezes, s of stamps.
FREEZES_S = (600, 900)
#: Shortest and longest life, s of stamps.
LIFE_S = (40, 240)
#: Time constants of the place of the second thermometer, and of the sensor behind it, s.
PLACE_S, SENSOR_S = 120.0, 300.0
#: How many newest drifts are compared at the end of a day with the healthy stream's.
COMPARED = 60


def warmth(rng: np.random.Generator, seconds: int) -> tuple[FloatArray, FloatArray]:
    """Draw temperatures, °C, (N, 2), and the sensor's own above COLD_C, K, (N,)."""
    levels_k = np.repeat(rng.uniform(0.0, 20.0, -(-seconds // 900)), 900)[:seconds]
    heated_k = np.zeros((seconds, 3))
    for second in range(1, seconds):
        before_k = heated_k[second - 1]
        source_k = np.array([levels_k[second], before_k[0], before_k[1]])
        heated_k[second] = before_k + (source_k - before_k) / (200.0, PLACE_S, SENSOR_S)
    celsius = COLD_C + heated_k[:, :2] + rng.normal(0.0, 0.02, (seconds, 2))
    return celsius, heated_k[:, 2]


def write_day(path: Path, rng: np.random.Generator) -> Path:
    """Write what the model is learnt from."""
    celsius, sensor_k = warmth(rng, LEARNT_S)
    wrench = np.outer(sensor_k, GAINS) + rng.normal(0.0, 1.0, (LEARNT_S, len(AXES))) * NOISE
    table = np.column_stack((np.arange(LEARNT_S), wrench, celsius))
    header = ','.join(['stamp_s', *AXES, 'temperature_c', 'temperature_2_c'])
    np.savetxt(path, table, '%.5f', ',', header=header, comments='')
    return path


class Day:
    """A day of a node that is killed, and the drift of force z that it published, N, by stamp."""

    def __init__(self, stand: Stand, celsius: FloatArray) -> None:
        self._stand, self._celsius = stand, celsius
        self.heard: dict[int, float] = {}
        self._messages = 0
        stand.node.create_subscription(WrenchStamped, f'/{NODE}/drift', self._note, 1000)
        self._talkers: list[Any] = [
            stand.talker.create_publisher(Temperature, topic, 100)
            for topic in ('temperature', 'temperature_2')
        ]

    def _note(self, drift: Any) -> None:
        self._messages += 1
        second = drift.header.stamp.sec - START_NS // NANOSECONDS
        self.heard[second] = drift.wrench.force.z

    def _send(self, at_ns: int) -> None:
        both_c = self._celsius[at_ns // NANOSECONDS]
        for talker, celsius in zip(self._talkers, both_c, strict=True):
            talker.publish(message(START_NS + at_ns, (celsius, 0.0)))

    def live(self, first: int, end: int) -> None:
        """Start the node, let it live through some seconds of the day, and kill it."""
        before = self._messages
        # New stamps with every look: nobody knows which of them is the first to be received.
        looks = itertools.count(first * NANOSECONDS, LOOK_NS)
        reached_ns = 0

        def is_heard() -> bool:
            nonlocal reached_ns
            reached_ns = next(looks)
            self._send(reached_ns)
            return self._messages > before + 1  # the first one is of the state

        self._stand.start_node()
        self._stand.wait(is_heard, 'the drift of the node')
        begun, following = time.monotonic(), reached_ns // NANOSECONDS + 1
        for second in range(following, end):
            time.sleep(max(0.0, begun + (second - following) / SPEED - time.monotonic()))
            self._send(second * NANOSECONDS)
        self._stand.end_node()


def healthy(model: Any, celsius: FloatArray) -> FloatArray:
    """Compute the drift of force z that a stream has whose thermometers live, N, (N,)."""
    twin = Compensator(2, StreamSettings(), model)
    drift = []
    for second, both_c in enumerate(celsius):
        for thermometer, one_c in enumerate(both_c):
            twin.add_temperature(thermometer, START_NS + second * NANOSECONDS, float(one_c))
        drift.append(float(twin.compensation.zero[2]))
    return np.array(drift)


def kill_with_a_thermometer_out(arguments: argparse.Namespace, folder: Path) -> bool:
    """Kill, load, compare; whether every state loaded and no drift stepped."""
    rng = np.random.default_rng(arguments.seed)
    path = make_model(write_day(folder / 'learnt.csv', rng), folder / 'm.yaml')
    model, allowed_n_s = load_model(path).model, StreamSettings().max_drift_rate_n_s
    given = (
        f'model_file:={path}', f'save_period:={SAVE_PERIOD_S}',
        'temperature_topics:=[temperature, temperature_2]',
    )  # fmt: skip
    kills = days = named = 0
    broken: list[str] = []
    shares, steps_n, healthy_n, errors_n = [], [], [], []
    while kills < arguments.kills:
        celsius, _ = warmth(rng, DAY_S)
        never_n, frozen = healthy(model, celsius), int(rng.integers(*FREEZES_S))
        celsius[frozen:, 1] = celsius[frozen, 1]
        data = folder / f'day_{days}'
        with closing(Stand(data, *given)) as stand:
            day, first = Day(stand, celsius), 0
            while first < DAY_S - LIFE_S[0] and kills < arguments.kills:
                end = min(first + int(rng.integers(*LIFE_S)), DAY_S)
                day.live(first, end)
                kills += 1
                try:
                    load_state(data / 'state.json')
                except WristFtCompError as error:
                    broken.append(str(error))
                first = end + int(rng.integers(1, LONGEST_GAP_S + 1))
            days, named = days + 1, named + ('stands still at' in stand.log.read_text('utf-8'))
        seconds = np.array(sorted(day.heard))
        drift = np.array([day.heard[second] for second in seconds])
        steps_n += np.abs(np.diff(drift)).tolist()
        shares += (np.abs(np.diff(drift)) / (allowed_n_s * np.diff(seconds))).tolist()
        healthy_n += np.abs(np.diff(never_n)).tolist()
        errors_n += np.abs(drift - never_n[seconds])[-COMPARED:].tolist()
        print(f'{kills} kills, largest step {max(steps_n):.3f} N', flush=True)
    figures = {
        'kills': kills,
        'days': days,
        'days on which the frozen thermometer was named': named,
        'largest step of the drift, N': round(max(steps_n), 4),
        'of a healthy stream, N': round(max(healthy_n), 4),
        'as a share of what the rate allows': round(max(shares), 4),
        'off from a healthy stream at the end of a day, N, median and largest': [
            round(float(np.median(errors_n)), 4), round(max(errors_n), 4),
        ],
        'broken': broken,
    }  # fmt: skip
    tell('thermometer_kills', figures)
    return not broken and max(shares) <= 1.0
