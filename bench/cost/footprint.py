"""
What an idle node takes, beside a plain typed relay.

``python bench/cost/footprint.py [--repeats N]``. By turns, each as a process of its own: the relay
that a user would write, and the compensator without and with a model. Measured are the processor
time until a wrench has passed, and the resident memory a while later. Bytecode is kept, as an
installed package's is; the first turn makes it and does not count. Medians go to standard output,
everything to ``out/footprint.json``. Aimed at is LIMIT times the relay.
"""

import argparse
from contextlib import ExitStack
import os
from pathlib import Path
from statistics import median
import sys
import tempfile

sys.path.append(str(Path(__file__).resolve().parents[1] / 'faults'))
from stand import keep, own_domain
from stream import compensator, Line, make_model

LIMIT = 1.5
PAGE_MB = os.sysconf('SC_PAGE_SIZE') / 1e6
RELAY = """
import rclpy
from geometry_msgs.msg import WrenchStamped

rclpy.init()
node = rclpy.create_node('relay', namespace='relay')
output = node.create_publisher(WrenchStamped, 'wrench', 10)
node.create_subscription(
    WrenchStamped, 'wrench_raw', output.publish, rclpy.qos.qos_profile_sensor_data
)
rclpy.spin(node)
"""


def measure(namespace: str, words: list[str]) -> dict[str, float]:
    """Start a process, let wrenches pass, and measure it."""
    with ExitStack() as stack:
        line = Line(stack, {namespace: words})
        statm = Path(f'/proc/{line.nodes[namespace].pid}/statm').read_text()
        return {
            'processor_s': line.started_us[namespace] / 1e6,
            'resident_mb': int(statm.split()[1]) * PAGE_MB,
        }


def main() -> None:
    """Measure by turns; print medians."""
    parser = argparse.ArgumentParser(description='Memory and start of the node.')
    parser.add_argument('--repeats', type=int, default=5)
    repeats = parser.parse_args().repeats
    own_domain(92, shared_memory=True)
    runs: dict[str, list[dict[str, float]]] = {'relay': [], 'bare': [], 'model': []}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make_model(folder)
        os.environ |= {'PYTHONDONTWRITEBYTECODE': '', 'PYTHONPYCACHEPREFIX': f'{name}/bytecode'}
        for _ in range(repeats + 1):
            runs['relay'].append(measure('relay', ['-c', RELAY]))
            runs['bare'].append(measure('bare', compensator(folder, 'bare', model=False)))
            runs['model'].append(measure('model', compensator(folder, 'model')))
    print(f'{"":12}  until a wrench, s  idle, MB   beside the relay')
    medians = {
        who: {what: median(run[what] for run in measured[1:]) for what in measured[0]}
        for who, measured in runs.items()
    }
    for who, row in medians.items():
        times = [row[what] / medians['relay'][what] for what in row]
        print(
            f'{who:12}{row["processor_s"]:19.2f}{row["resident_mb"]:10.0f}'
            f'{times[0]:9.2f}, {times[1]:.2f}'
        )
    keep('footprint.json', {'medians': medians, 'runs': runs})
    print(f'compensator: at most {max(times):.2f} times the relay; aimed at: {LIMIT}')


if __name__ == '__main__':
    main()
