"""
How far the drift is off after a kill in the middle of a warm-up.

``python bench/restart.py [KILLS] [--seed N]``. A node is killed by SIGKILL at a random moment of a
warm-up, is away for up to ten seconds, and goes on from the state it saved, which is up to five
seconds old. What it subtracts then is compared with a stream that was never killed, and with one
that begins anew. Stamps run SPEED times faster than the clock. Figures on standard output and in
``out/restart.json``; exit code 1 when a deviation is more than LIMIT.
"""

import argparse
import itertools
import json
from pathlib import Path
import sys
import tempfile
import time
from typing import Any

import numpy as np
from stand import make_model, message, NODE, own_domain, Sensor, Stand, write_warm_up

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
#: The sensor is cold for so long before the warm-up, so that the node may be found meanwhile, s.
SOAKS_S = 30
#: From a look for the node to the next one, in stamps.
LOOK_NS = 10_000_000


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


def connect(stand: Stand, heard: dict[int, float]) -> Any:
    """Note the drift that the node tells, by second; return what publishes temperatures."""
    from geometry_msgs.msg import WrenchStamped  # noqa: PLC0415 -- after the environment is set
    from sensor_msgs.msg import Temperature  # noqa: PLC0415

    def note(told: Any) -> None:
        heard[told.header.stamp.sec - START_NS // NANOSECONDS] = told.wrench.force.z

    stand.node.create_subscription(WrenchStamped, f'/{NODE}/drift', note, 1000)
    return stand.talker.create_publisher(Temperature, 'temperature', 100)


def live(
    stand: Stand, heat: Any, celsius: list[float], seconds: range, heard: dict[int, float]
) -> None:
    """Start the node, let it live through some seconds of the warm-up, and kill it."""
    looks = itertools.count(seconds.start * NANOSECONDS, LOOK_NS)
    reached = seconds.start

    def send(at_ns: int) -> None:
        second = at_ns // NANOSECONDS
        heat.publish(message(START_NS + at_ns, (celsius[max(second, 0)], 0.0)))

    def is_there() -> bool:
        # New stamps with every look: nobody knows which of them is the first to be received.
        nonlocal reached
        at_ns = next(looks)
        reached = at_ns // NANOSECONDS
        send(at_ns)
        return bool(heard)

    heard.clear()
    stand.start_node()
    stand.wait(is_there, 'the drift of the node')
    begun = time.monotonic()
    for number, second in enumerate(range(reached + 1, seconds.stop)):
        time.sleep(max(0.0, begun + number / SPEED - time.monotonic()))
        send(second * NANOSECONDS)
    stand.end_node()


def one_kill(folder: Path, model_path: Path, rng: np.random.Generator) -> dict[str, float]:
    """Kill a node once; give the drift so far, and the largest deviations as shares of it."""
    killed = int(rng.integers(*KILLED_S))
    back = killed + int(rng.integers(1, LONGEST_GAP_S + 1))
    end = back + WATCHED_S
    celsius, model = temperatures(end), load_model(model_path).model
    heard: dict[int, float] = {}
    stand = Stand(folder, f'model_file:={model_path}', f'save_period:={SAVE_PERIOD_S}')
    try:
        heat = connect(stand, heard)
        live(stand, heat, celsius, range(-SOAKS_S, killed), heard)
        live(stand, heat, celsius, range(back, end), heard)
    finally:
        stand.close()
    never, anew = undisturbed(model, celsius, -SOAKS_S), undisturbed(model, celsius, back)
    # What is told first is what was saved; the first cell is complete a second after that.
    seconds = sorted(heard)[1:]
    if len(seconds) < WATCHED_S // 2:
        sys.exit(f'heard of {len(seconds)} seconds only\n{stand.log.read_text("utf-8")}')

    def deviation(other: dict[int, float]) -> float:
        return max(abs(other[k] - never[k]) / abs(never[k] - never[1]) for k in seconds)

    return {
        'killed_s': killed,
        'away_s': back - killed,
        'drift_n': never[back] - never[1],
        'deviation': deviation(heard),
        'deviation_anew': deviation(anew),
    }


def main() -> int:
    """Kill, compare, tell."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1] if __doc__ else '')
    parser.add_argument('kills', nargs='?', type=int, default=20)
    parser.add_argument('--seed', type=int, default=0)
    arguments = parser.parse_args()
    own_domain(93)
    rng = np.random.default_rng(arguments.seed)
    measured = []
    with tempfile.TemporaryDirectory() as name:
        model = make_model(write_warm_up(Path(name, 'warm_up.csv')), Path(name, 'm.yaml'))
        for number in range(arguments.kills):
            measured.append(one_kill(Path(name, str(number)), model, rng))
            print(
                json.dumps({key: round(value, 5) for key, value in measured[-1].items()}),
                flush=True,
            )
    for what, key in (('restarted', 'deviation'), ('begun anew', 'deviation_anew')):
        shares = [100 * each[key] for each in measured]
        print(f'{what}: off by {np.median(shares):.3f} % (median), {max(shares):.3f} % at most')
    out = Path(__file__).resolve().parent.parent / 'out'
    out.mkdir(exist_ok=True)
    (out / 'restart.json').write_text(json.dumps(measured, indent=1), 'utf-8')
    return 1 if max(each['deviation'] for each in measured) > LIMIT else 0


if __name__ == '__main__':
    sys.exit(main())
