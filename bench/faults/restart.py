"""
How a killed node goes on: how far its drift is off, and how soon its stream is back.

``restart``: a node is killed by SIGKILL at a random moment of a warm-up, is away for up to ten
seconds, and goes on from the state that it saved, which is up to five seconds old. What it
subtracts then is compared with a stream that was never killed, and with one that begins anew.
Stamps run SPEED times faster than the clock.

``back``: a node is killed at a random moment of its stream and started again at once. It is deaf
when no output comes for DEAF_S; the next kill ends that.
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
from stand import keep, make_model, message, NODE, Sensor, Stand, tell, write_warm_up

from wrist_ft_comp.signals import NANOSECONDS
from wrist_ft_comp.stored.model_file import load_model
from wrist_ft_comp.stream.compensator import Compensator, StreamSettings

SPEED = 50.0
#: The parameter's default, 5 s, in stamps.
SAVE_PERIOD_S = 5.0 / SPEED
#: When the node may be killed, how long it is away, and how long it is watched then, s of stamps.
KILLED_S = (120, 900)
LONGEST_GAP_S = 10
WATCHED_S = 60
#: Largest deviation that is allowed, as a share of the drift since the warm-up began.
LIMIT = 0.02
START_NS = 1_700_000_000 * NANOSECONDS
#: The sensor stays cold before the warm-up, so that the node may be found meanwhile, s.
SOAKS_S = 30
#: Stamps from a look for the node to the next one.
LOOK_NS = 10_000_000
RATE_HZ = 250
WRENCHES_PER_TEMPERATURE = 25
#: A node without an output for this time will not hear anything any more, s.
DEAF_S = 60.0
#: How long a stream lasts that has come back, s.
LASTS_S = (0.2, 6.0)


def temperatures(seconds: int) -> list[float]:
    """Give the warm-up's temperatures, one per second, °C."""
    sensor, measured = Sensor(1), []
    for second in range(seconds):
        sensor.advance(float(second))
        measured.append(sensor.celsius)
    return measured


def undisturbed(model: Any, celsius: list[float], first: int) -> dict[int, float]:
    """Give the drift of force z, N, by second, of a stream that begins with one."""
    twin = Compensator(1, StreamSettings(max_drift_rate_n_s=1e3), model)
    measured = {}
    for second in range(first, len(celsius)):
        twin.add_temperature(0, START_NS + second * NANOSECONDS, celsius[max(second, 0)])
        measured[second] = float(twin.compensation.zero[2])
    return measured


class WarmUp:
    """
    A warm-up that a node lives through, killed and started again.

    Parameters
    ----------
    stand : Stand
        With the node.
    celsius : list of float
        Temperatures, one per second.

    """

    def __init__(self, stand: Stand, celsius: list[float]) -> None:
        self._stand, self._celsius = stand, celsius
        #: Drift of force z that the node published, N, by second.
        self.heard: dict[int, float] = {}
        stand.node.create_subscription(WrenchStamped, f'/{NODE}/drift', self._note, 1000)
        self._talker: Any = stand.talker.create_publisher(Temperature, 'temperature', 100)

    def _note(self, drift: Any) -> None:
        self.heard[drift.header.stamp.sec - START_NS // NANOSECONDS] = drift.wrench.force.z

    def _send(self, at_ns: int) -> None:
        celsius = self._celsius[max(at_ns // NANOSECONDS, 0)]
        self._talker.publish(message(START_NS + at_ns, (celsius, 0.0)))

    def live(self, first: int, end: int) -> None:
        """Start the node, let it live through some seconds of the warm-up, and kill it."""
        # New stamps with every look: nobody knows which of them is the first to be received.
        looks = itertools.count(first * NANOSECONDS, LOOK_NS)
        reached = first

        def is_heard() -> bool:
            nonlocal reached
            at_ns = next(looks)
            reached = at_ns // NANOSECONDS
            self._send(at_ns)
            return bool(self.heard)

        self.heard.clear()
        self._stand.start_node()
        self._stand.wait(is_heard, 'the drift of the node')
        begun = time.monotonic()
        for number, second in enumerate(range(reached + 1, end)):
            time.sleep(max(0.0, begun + number / SPEED - time.monotonic()))
            self._send(second * NANOSECONDS)
        self._stand.end_node()


def kill_once(folder: Path, model_path: Path, rng: np.random.Generator) -> dict[str, float]:
    """Kill a node once; give the drift so far, and the largest deviations as shares of it."""
    killed = int(rng.integers(*KILLED_S))
    back = killed + int(rng.integers(1, LONGEST_GAP_S + 1))
    celsius, model = temperatures(back + WATCHED_S), load_model(model_path).model
    given = (f'model_file:={model_path}', f'save_period:={SAVE_PERIOD_S}')
    with closing(Stand(folder, *given)) as stand:
        warm_up = WarmUp(stand, celsius)
        warm_up.live(-SOAKS_S, killed)
        warm_up.live(back, back + WATCHED_S)
    never, anew = undisturbed(model, celsius, -SOAKS_S), undisturbed(model, celsius, back)
    # The first drift is the saved one; the first cell is complete a second after that.
    seconds = sorted(warm_up.heard)[1:]
    if len(seconds) < WATCHED_S // 2:
        sys.exit(f'heard of {len(seconds)} seconds only\n{stand.log.read_text("utf-8")}')

    def deviation(other: dict[int, float]) -> float:
        return max(abs(other[k] - never[k]) / abs(never[k] - never[1]) for k in seconds)

    return {
        'killed_s': killed,
        'away_s': back - killed,
        'drift_n': never[back] - never[1],
        'deviation': deviation(warm_up.heard),
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


class Stream:
    """
    A sensor that reads all the time, and when its last reading came back.

    Parameters
    ----------
    stand : Stand
        With the node that is killed.

    """

    def __init__(self, stand: Stand) -> None:
        self._stand = stand
        self._heard_s = 0.0
        self._sensor, self._sent = Sensor(1), 0
        self._raw: Any = stand.talker.create_publisher(WrenchStamped, 'wrench_raw', 1000)
        self._warm: Any = stand.talker.create_publisher(Temperature, 'temperature', 100)
        stand.node.create_subscription(WrenchStamped, 'wrench', self._hear, 1000, raw=True)

    def _hear(self, _: bytes) -> None:
        self._heard_s = time.monotonic()

    def _send_until(self, heard_after_s: float, end_s: float) -> bool:
        """Send readings until one came back after a time, or an end; whether one did."""
        while not (heard := self._heard_s > heard_after_s) and time.monotonic() < end_s:
            if self._sent % WRENCHES_PER_TEMPERATURE == 0:
                self._warm.publish(message(time.time_ns(), (self._sensor.celsius, 0.0)))
            self._raw.publish(message(time.time_ns(), self._sensor.raw()))
            self._sent += 1
            time.sleep(1 / RATE_HZ)
        return heard

    def live(self, lasts_s: float) -> float | None:
        """Start the node, and kill it when it streams; s until its first output, if one came."""
        self._stand.start_node()
        begun_s = time.monotonic()
        came = self._send_until(begun_s, begun_s + DEAF_S)
        took_s = self._heard_s - begun_s
        if came:
            end_s = time.monotonic() + lasts_s
            self._send_until(end_s, end_s)
        self._stand.end_node()
        return took_s if came else None


def count_deaf(arguments: argparse.Namespace, folder: Path) -> bool:
    """Kill, count, tell; whether no node was deaf."""
    rng = np.random.default_rng(arguments.seed)
    model = make_model(write_warm_up(folder / 'warm_up.csv'), folder / 'models/first.yaml')
    with closing(Stand(folder, f'model_file:={model}')) as stand:
        stream = Stream(stand)
        lives = [stream.live(rng.uniform(*LASTS_S)) for _ in range(arguments.kills)]
    took_s = [life for life in lives if life is not None]
    figures = {
        'shared_memory': arguments.shared_memory,
        'kills': len(lives),
        'deaf': lives.count(None),
        'median_s': round(float(np.median(took_s)), 2) if took_s else None,
        'longest_s': round(max(took_s), 2) if took_s else None,
    }
    tell('comes_back', figures)
    return not figures['deaf']
