"""
What an idle node takes, beside a plain typed relay.

``python bench/cost/footprint.py [--repeats N]``. By turns, each as a process of its own: the relay
that a user would write, and the compensator without and with a model. Ten wrenches a second are
sent, and a temperature with each. Measured are the processor time until the first wrench has
passed, and the resident memory a while later. Bytecode is kept, as an installed package's is; the
first turn makes it and does not count. Medians go to standard output, everything to
``out/footprint.json``. Aimed at is LIMIT times the relay.
"""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
import json
import os
from pathlib import Path
import signal
from statistics import median
import subprocess
import sys
import tempfile
import time
from typing import Any

from geometry_msgs.msg import WrenchStamped
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import Temperature
from warm_up import make_model

ROOT = Path(__file__).resolve().parents[2]
LIMIT = 1.5
TIMEOUT_S = 60.0
SETTLE_S = 3.0
TICKS_S = os.sysconf('SC_CLK_TCK')
PAGE_MB = os.sysconf('SC_PAGE_SIZE') / 1e6
RELAY = """
import rclpy
from geometry_msgs.msg import WrenchStamped

rclpy.init()
node = rclpy.create_node('relay')
output = node.create_publisher(WrenchStamped, 'wrench', 10)
node.create_subscription(
    WrenchStamped, 'wrench_raw', output.publish, rclpy.qos.qos_profile_sensor_data
)
rclpy.spin(node)
"""


class Sensor:
    """Sends wrenches and temperatures until a process passes one on."""

    def __init__(self, context: Any) -> None:
        self._node: Any = Node('footprint_sensor', context=context)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self._node)
        self._wrench = self._node.create_publisher(WrenchStamped, 'wrench_raw', 10)
        self._temperature = self._node.create_publisher(Temperature, 'temperature', 10)
        self._came: list[Any] = []
        self._node.create_subscription(WrenchStamped, 'wrench', self._came.append, 10)

    def send(self, seconds: float, *, until_heard: bool) -> None:
        """Send ten a second; until one is heard, or all the time."""
        self._came.clear()
        end = time.monotonic() + seconds
        while time.monotonic() < end and not (until_heard and self._came):
            stamp = self._node.get_clock().now().to_msg()
            wrench, temperature = WrenchStamped(), Temperature(temperature=30.0)
            wrench.header.stamp = temperature.header.stamp = stamp
            self._temperature.publish(temperature)
            self._wrench.publish(wrench)
            wake = time.monotonic() + 0.1
            while time.monotonic() < wake and not (until_heard and self._came):
                self._executor.spin_once(timeout_sec=0.02)
        if not self._came:
            sys.exit(f'No wrench was passed within {seconds:.0f} s.')

    def close(self) -> None:
        """End the sensor."""
        self._executor.shutdown()
        self._node.destroy_node()


@contextmanager
def process(words: list[str]) -> Iterator[int]:
    """Run Python with this tree's package; gives the process id."""
    running = subprocess.Popen(
        [sys.executable, *words],
        env={**os.environ, 'PYTHONPATH': str(ROOT)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield running.pid
    finally:
        running.send_signal(signal.SIGINT)
        running.wait(TIMEOUT_S)


def measure(sensor: Sensor, words: list[str]) -> dict[str, float]:
    """Start a process, and measure it."""
    with process(words) as pid:
        sensor.send(TIMEOUT_S, until_heard=True)
        fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
        sensor.send(SETTLE_S, until_heard=False)
        pages = int(Path(f'/proc/{pid}/statm').read_text().split()[1])
    return {
        'processor_s': (int(fields[11]) + int(fields[12])) / TICKS_S,
        'resident_mb': pages * PAGE_MB,
    }


def compensator(data: Path, *model: str) -> list[str]:
    """Command of a compensator, as setup.py installs it, with a new folder of its own."""
    start = 'from wrist_ft_comp.node.executables import compensator; compensator()'
    return ['-c', start, '--ros-args', '-p', f'data_directory:={data}', *model]


def main() -> int:
    """Measure by turns; print medians."""
    parser = argparse.ArgumentParser(description='Memory and start of the node.')
    parser.add_argument('--repeats', type=int, default=5)
    repeats = parser.parse_args().repeats
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ.setdefault('ROS_DOMAIN_ID', '92')
    context: Any = Context()
    context.init([])
    sensor = Sensor(context)
    runs: dict[str, list[dict[str, float]]] = {}
    with tempfile.TemporaryDirectory() as name:
        folder, model = Path(name), ('-p', f'model_file:={make_model(Path(name))}')
        os.environ |= {'PYTHONDONTWRITEBYTECODE': '', 'PYTHONPYCACHEPREFIX': f'{name}/bytecode'}
        for number in range(repeats + 1):
            for who, words in (
                ('relay', ['-c', RELAY]),
                ('no model', compensator(folder / f'{number}_none')),
                ('compensator', compensator(folder / f'{number}_new', *model)),
            ):
                measured = measure(sensor, words)
                if number:
                    runs.setdefault(who, []).append(measured)
    sensor.close()
    context.try_shutdown()
    figures = {
        who: {what: median(run[what] for run in measured) for what in measured[0]}
        for who, measured in runs.items()
    }
    print(f'{"":12}  until the first wrench, s  idle, MB   beside the relay')
    for who, row in figures.items():
        times = [row[what] / figures['relay'][what] for what in ('processor_s', 'resident_mb')]
        print(
            f'{who:12}{row["processor_s"]:27.2f}{row["resident_mb"]:10.0f}'
            f'{times[0]:9.2f}, {times[1]:.2f}'
        )
        row |= dict(zip(('processor_times', 'resident_times'), times, strict=True))
    out = ROOT / 'out'
    out.mkdir(exist_ok=True)
    (out / 'footprint.json').write_text(json.dumps({'medians': figures, 'runs': runs}, indent=1))
    worst = max(figures['compensator'][what] for what in ('processor_times', 'resident_times'))
    print(f'compensator: at most {worst:.2f} times the relay; aimed at: {LIMIT}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
