"""
How soon the stream comes back after a SIGKILL, and how often it does not.

``python bench/comes_back.py [KILLS] [--shared-memory] [--seed N]``. A node is killed at a random
moment of its stream and started again at once. It is deaf when no output comes for DEAF_S; the
next kill ends that. Figures on standard output and in ``out/comes_back.json``; exit code 1 when a
node was deaf.
"""

import argparse
import json
from pathlib import Path
import sys
import tempfile
import time
from typing import Any

import numpy as np
from stand import make_model, message, own_domain, Sensor, Stand, write_warm_up

RATE_HZ = 250
#: A temperature comes with every so many wrenches.
WRENCHES_PER_TEMPERATURE = 25
#: Without an output for so long, a node will not hear anything any more, s.
DEAF_S = 60.0
#: How long a stream lasts that has come back, s.
LASTS_S = (0.2, 6.0)


class Stream:
    """
    A sensor that reads all the time, and when its last reading came back.

    Parameters
    ----------
    stand : Stand
        With the node that is killed.

    """

    def __init__(self, stand: Stand) -> None:
        from geometry_msgs.msg import WrenchStamped  # noqa: PLC0415 -- after the environment is set
        from sensor_msgs.msg import Temperature  # noqa: PLC0415

        self.heard_s = 0.0
        self._sensor, self._sent = Sensor(1), 0
        self._raw: Any = stand.talker.create_publisher(WrenchStamped, 'wrench_raw', 1000)
        self._warm: Any = stand.talker.create_publisher(Temperature, 'temperature', 100)
        stand.node.create_subscription(WrenchStamped, 'wrench', self._hear, 1000, raw=True)

    def _hear(self, _: bytes) -> None:
        self.heard_s = time.monotonic()

    def until(self, heard_after_s: float, end_s: float) -> bool:
        """Send readings until one came back after a time, or an end; whether one did."""
        while not (heard := self.heard_s > heard_after_s) and time.monotonic() < end_s:
            if self._sent % WRENCHES_PER_TEMPERATURE == 0:
                self._warm.publish(message(time.time_ns(), (self._sensor.celsius, 0.0)))
            self._raw.publish(message(time.time_ns(), self._sensor.raw()))
            self._sent += 1
            time.sleep(1 / RATE_HZ)
        return heard


def one_life(stand: Stand, stream: Stream, lasts_s: float) -> float | None:
    """Start the node, and kill it when it streams; s until its first output, None without."""
    stand.start_node()
    begun_s = time.monotonic()
    came = stream.until(begun_s, begun_s + DEAF_S)
    took_s = stream.heard_s - begun_s
    if came:
        end_s = time.monotonic() + lasts_s
        stream.until(end_s, end_s)
    stand.end_node()
    return took_s if came else None


def main() -> int:
    """Kill, count, tell."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1] if __doc__ else '')
    parser.add_argument('kills', nargs='?', type=int, default=50)
    parser.add_argument('--shared-memory', action='store_true', help='as Fast DDS does by default')
    parser.add_argument('--seed', type=int, default=0)
    arguments = parser.parse_args()
    own_domain(92, shared_memory=arguments.shared_memory)
    rng = np.random.default_rng(arguments.seed)
    with tempfile.TemporaryDirectory() as name:
        data = Path(name) / 'data'
        model = make_model(write_warm_up(data / 'warm_up.csv'), data / 'models/first.yaml')
        stand = Stand(data, f'model_file:={model}')
        try:
            stream = Stream(stand)
            lives = [
                one_life(stand, stream, rng.uniform(*LASTS_S)) for _ in range(arguments.kills)
            ]
        finally:
            stand.close()
    took_s = [each for each in lives if each is not None]
    figures = {
        'shared_memory': arguments.shared_memory,
        'kills': len(lives),
        'deaf': lives.count(None),
        'median_s': round(float(np.median(took_s)), 2) if took_s else None,
        'longest_s': round(max(took_s), 2) if took_s else None,
    }
    print(json.dumps(figures, indent=1))
    out = Path(__file__).resolve().parent.parent / 'out'
    out.mkdir(exist_ok=True)
    (out / 'comes_back.json').write_text(json.dumps(figures, indent=1), 'utf-8')
    return 1 if figures['deaf'] else 0


if __name__ == '__main__':
    sys.exit(main())
