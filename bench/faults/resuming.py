"""
How a killed node goes on: what it subtracts then, and how soon its stream is back.

``restart``: a node is killed by SIGKILL at a random moment of a warm-up, is away for up to ten
seconds, and goes on from the state that it saved, which is up to five seconds old. What it
subtracts then is compared with a stream that was never killed, and with one that begins anew.

``thermometer_kills``: two thermometers of a sensor that warms up; the second one freezes at a
random moment, so that its prediction takes its place. From before that on the node is killed again
and again. Its drift must not step: two neighbouring drifts may differ by what the limit of the
drift's rate allows in the time between them.

``comes_back``: a node is killed at a random moment of its stream and started again at once. It is
deaf when no output comes for DEAF_S; the next kill ends that.

But in the last, stamps run SPEED times faster than the clock.
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
    COLD_C,
    GAINS,
    HASTE,
    keep,
    make_model,
    message,
    NODE,
    NOISE,
    Sensor,
    Stand,
    tell,
    write_warm_up,
)

from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.signals import AXES, FloatArray, NANOSECONDS
from wrist_ft_comp.stored.model_file import load_model
from wrist_ft_comp.stored.state_file import load_state
from wrist_ft_comp.stream.compensator import Compensator, StreamSettings

SPEED = 50.0
#: As HASTE says: 5 s of stamps.
SAVE_PERIOD_S = 0.1
START_NS = 1_700_000_000 * NANOSECONDS
#: Stamps from a look for the node to the next one.
LOOK_NS = 10_000_000
#: How long a node is away at most, s of stamps.
LONGEST_GAP_S = 10

#: ``restart``: when the node may be killed, and how long it is watched then, s of stamps.
KILLED_S = (120, 900)
WATCHED_S = 60
#: The sensor stays cold before the warm-up, so that the node may be found meanwhile, s.
SOAKS_S = 30
#: Largest deviation that is allowed, as a share of the drift since the warm-up began.
LIMIT = 0.02

#: ``thermometer_kills``: length of a day, s, and of what the model is learnt from.
DAY_S, LEARNT_S = 1800, 10_800
#: When the second thermometer freezes, s of stamps.
FREEZES_S = (600, 900)
#: Shortest and longest life, s of stamps.
LIFE_S = (40, 240)
#: Time constants of the first thermometer's place behind the heat, of the second one's behind
#: that, and of the sensor's behind both, s.
PLACES_S = (200.0, 120.0, 300.0)
#: How many newest drifts are compared at the end of a day with the healthy stream's.
COMPARED = 60

#: ``comes_back``: wrenches, Hz, and how many of them come with a temperature.
RATE_HZ, WRENCHES_PER_TEMPERATURE = 250, 25
#: A node without an output for this time will not hear anything any more, s.
DEAF_S = 60.0
#: How long a stream lasts that has come back, s.
LASTS_S = (0.2, 6.0)


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


def warmth(rng: np.random.Generator, seconds: int) -> tuple[FloatArray, FloatArray]:
    """Draw temperatures, °C, (N, 2), and the sensor's own above COLD_C, K, (N,)."""
    levels_k = np.repeat(rng.uniform(0.0, 20.0, -(-seconds // 900)), 900)[:seconds]
    heated_k = np.zeros((seconds, 3))
    for second in range(1, seconds):
        before_k = heated_k[second - 1]
        source_k = np.array([levels_k[second], before_k[0], before_k[1]])
        heated_k[second] = before_k + (source_k - before_k) / PLACES_S
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


def kill_with_a_thermometer_out(arguments: argparse.Namespace, folder: Path) -> bool:
    """Kill, load, compare; whether every state loaded and no drift stepped."""
    rng = np.random.default_rng(arguments.seed)
    path = make_model(write_day(folder / 'learnt.csv', rng), folder / 'm.yaml')
    model, settings = load_model(path).model, StreamSettings()
    given = (
        f'model_file:={path}',
        'temperature_topics:=[temperature, temperature_2]',
    )  # fmt: skip
    kills = days = named = 0
    broken: list[str] = []
    shares, steps_n, healthy_n, errors_n = [], [], [], []
    while kills < arguments.kills:
        celsius, _ = warmth(rng, DAY_S)
        never_n = np.array(list(undisturbed(model, celsius, settings).values()))
        frozen = int(rng.integers(*FREEZES_S))
        celsius[frozen:, 1] = celsius[frozen, 1]
        data = folder / f'day_{days}'
        with closing(Stand(data, *given, source=HASTE)) as stand:
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
        allowed_n = settings.max_drift_rate_n_s * np.diff(seconds)
        shares += (np.abs(np.diff(drift)) / allowed_n).tolist()
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


def count_deaf(arguments: argparse.Namespace, folder: Path) -> bool:
    """Kill, count, tell; whether no node was deaf."""
    rng = np.random.default_rng(arguments.seed)
    model = make_model(write_warm_up(folder / 'warm_up.csv'), folder / 'models/first.yaml')
    sensor, heard_s, took_s, deaf = Sensor(1), [0.0], [], 0
    with closing(Stand(folder, f'model_file:={model}')) as stand:
        raw: Any = stand.talker.create_publisher(WrenchStamped, 'wrench_raw', 1000)
        warm: Any = stand.talker.create_publisher(Temperature, 'temperature', 100)
        stand.node.create_subscription(
            WrenchStamped, 'wrench', lambda _: heard_s.append(time.monotonic()), 1000, raw=True
        )

        def send(seconds: float, *, until_heard: bool) -> None:
            """Send readings for some time, or until one came back that is newer than now."""
            begun_s = time.monotonic()
            for sent in itertools.count():
                heard = until_heard and heard_s[-1] > begun_s
                if heard or time.monotonic() > begun_s + seconds:
                    return
                if sent % WRENCHES_PER_TEMPERATURE == 0:
                    warm.publish(message(time.time_ns(), (sensor.celsius, 0.0)))
                raw.publish(message(time.time_ns(), sensor.raw()))
                time.sleep(1 / RATE_HZ)

        for _ in range(arguments.kills):
            stand.start_node()
            begun_s, lasts_s = time.monotonic(), rng.uniform(*LASTS_S)
            send(DEAF_S, until_heard=True)
            if heard_s[-1] > begun_s:
                took_s.append(heard_s[-1] - begun_s)
                send(lasts_s, until_heard=False)
            else:
                deaf += 1
            stand.end_node()
    figures = {
        'shared_memory': arguments.shared_memory,
        'kills': arguments.kills,
        'deaf': deaf,
        'median_s': round(float(np.median(took_s)), 2) if took_s else None,
        'longest_s': round(max(took_s), 2) if took_s else None,
    }
    tell('comes_back', figures)
    return not deaf
