"""
What a killed node subtracts when it is back: ``restart``.

A node is killed by SIGKILL at a random moment of a warm-up, is away for up to ten seconds, and
goes on from the state that it saved, which is up to five seconds old. What it subtracts then is
compared with a stream that was never killed, and with one that begins anew. Stamps run SPEED times
faster than the clock.
"""

import argparse
from contextlib import closing
import itertools
import json
from pathlib import Path
import sys
import time
from typing import Any

from geometry_msgs.msg import WrenchStamped
import numpy as np
from sensor_msgs.msg import Temperature
from stand import (
    HASTE,
    keep,
    make_model,
    message,
    NODE,
    Sensor,
    Stand,
    write_warm_up,
)

from wrist_ft_comp.series import FloatArray, NANOSECONDS
from wrist_ft_comp.stored.model_file import load_model
from wrist_ft_comp.stream.compensator import Compensator, StreamSettings

SPEED = 50.0
#: The parameter's default, 5 s, in stamps.
SAVE_PERIOD_S = 0.1
START_NS = 1_700_000_000 * NANOSECONDS
#: Stamps from a look for the node to the next one.
LOOK_NS = 10_000_000
#: How long a node is away at most, s of stamps.
LONGEST_GAP_S = 10

#: When the node may be killed, and how long it is watched then, s of stamps.
KILLED_S = (120, 900)
WATCHED_S = 60
#: The sensor stays cold before the warm-up, so that the node may be found meanwhile, s.
SOAKS_S = 30
#: Largest deviation that is allowed, as a share of the drift since the warm-up began.
LIMIT = 0.02


class Day:
    """
    A day that a node lives through, killed and started again.

    Parameters
    ----------
    stand : Stand
        With the node.
    celsius : ndarray, shape (N, J)
        Temperatures, one per second; the first one holds before the day, too.

    """

    def __init__(self, stand: Stand, celsius: FloatArray) -> None:
        self._stand, self._celsius = stand, celsius
        #: Drift of force z that the node published, N, by second.
        self.heard: dict[int, float] = {}
        self._messages = 0
        stand.node.create_subscription(WrenchStamped, f'/{NODE}/drift', self._note, 1000)
        self._talkers: list[Any] = [
            stand.talker.create_publisher(Temperature, topic, 100)
            for topic in ('temperature', 'temperature_2')[: celsius.shape[1]]
        ]

    def _note(self, drift: Any) -> None:
        self._messages += 1
        second = drift.header.stamp.sec - START_NS // NANOSECONDS
        self.heard[second] = drift.wrench.force.z

    def _send(self, at_ns: int) -> None:
        temperatures_c = self._celsius[max(at_ns // NANOSECONDS, 0)]
        for talker, celsius in zip(self._talkers, temperatures_c, strict=True):
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


def undisturbed(
    model: Any, celsius: FloatArray, settings: StreamSettings, first: int = 0
) -> dict[int, float]:
    """Give the drift of force z, N, by second, of a stream that nobody kills."""
    twin = Compensator(celsius.shape[1], settings, model)
    drift = {}
    for second in range(first, len(celsius)):
        for thermometer, one_c in enumerate(celsius[max(second, 0)].tolist()):
            twin.add_temperature(thermometer, START_NS + second * NANOSECONDS, one_c)
        drift[second] = float(twin.compensation.zero[2])
    return drift


def kill_once(folder: Path, model_path: Path, rng: np.random.Generator) -> dict[str, float]:
    """Kill a node once; give the drift so far, and the largest deviations as shares of it."""
    killed = int(rng.integers(*KILLED_S))
    back = killed + int(rng.integers(1, LONGEST_GAP_S + 1))
    sensor, celsius = Sensor(1), np.empty((back + WATCHED_S, 1))
    for second in range(len(celsius)):
        sensor.advance(float(second))
        celsius[second] = sensor.celsius
    with closing(Stand(folder, f'model_file:={model_path}', source=HASTE)) as stand:
        day = Day(stand, celsius)
        day.live(-SOAKS_S, killed)
        day.heard.clear()
        day.live(back, back + WATCHED_S)
    model, settings = load_model(model_path).model, StreamSettings(max_drift_rate_n_s=1e3)
    never, anew = (undisturbed(model, celsius, settings, first) for first in (-SOAKS_S, back))
    # The first drift is the saved one; the first cell is complete a second after that.
    seconds = sorted(day.heard)[1:]
    if len(seconds) < WATCHED_S // 2:
        sys.exit(f'heard of {len(seconds)} seconds only\n{stand.log.read_text("utf-8")}')

    def deviation(other: dict[int, float]) -> float:
        return max(abs(other[k] - never[k]) / abs(never[k] - never[1]) for k in seconds)

    return {
        'killed_s': killed,
        'away_s': back - killed,
        'drift_n': never[back] - never[1],
        'deviation': deviation(day.heard),
        'deviation_anew': deviation(anew),
    }


def compare_drift(arguments: argparse.Namespace, folder: Path) -> bool:
    """Kill, compare, tell; whether every deviation is within LIMIT."""
    rng = np.random.default_rng(arguments.seed)
    model = make_model(write_warm_up(folder / 'warm_up.csv'), folder / 'm.yaml')
    measured = []
    for number in range(arguments.kills):
        measured.append(kill_once(folder / str(number), model, rng))
        print(json.dumps({k: round(v, 5) for k, v in measured[-1].items()}), flush=True)
    for what, key in (('restarted', 'deviation'), ('begun anew', 'deviation_anew')):
        percent = [100 * figures[key] for figures in measured]
        print(f'{what}: off by {np.median(percent):.3f} % (median), {max(percent):.3f} % at most')
    keep('restart.json', json.dumps(measured, indent=1))
    return max(figures['deviation'] for figures in measured) <= LIMIT
