"""
What the stream costs: processor time and latency of a wrench, against relays a user would write.

``python bench/cost/stream.py [--seconds S] [--repeats N] [RATE …]``. Real processes over DDS on
loopback: a sensor, a receiver, and between them by turns a plain typed relay on the default
executor, a relay of bytes on the events executor, and the compensator with a model. All are up all
the time and are used one after the other in short runs, so that a noisy machine is as noisy to
each; figures are medians of the runs, losses are sums. Then: the compensator during a calibration,
with a thermometer that is a field of another kilohertz message, with a payload and an IMU of
1 kHz, and while it learns from days; last, the computation alone.

Where a wrench was lost is known by counting: the sensor counts what it sends, the compensator's
diagnostics tell what it received and published, and the receiver counts the different stamps that
it hears. A table goes to standard output, figures to ``out/stream.json``.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, ExitStack
import json
import math
import os
from pathlib import Path
import signal
from statistics import median
import subprocess
import sys
import tempfile
import time
from typing import Any

import numpy as np
from stream_roles import STATE_ENTRY, wrench_bytes

sys.path.append(str(Path(__file__).resolve().parents[1] / 'faults'))
from kills import write_days
import stand

from wrist_ft_comp.learning.diary import load_memory
from wrist_ft_comp.payload.weight import ForceFrame, Payload
from wrist_ft_comp.stored.model_file import load_model
from wrist_ft_comp.stored.payload_file import add_payloads, PAYLOADS
from wrist_ft_comp.stream.compensator import Compensator, StreamSettings
from wrist_ft_comp.wire.cdr import locate, WRENCH_DOUBLES

RATES_HZ = (500.0, 1000.0, 2000.0, 4000.0, 8000.0)
#: Ways of a relay that a user would write: typed messages, and bytes.
RELAYS = ('typed', 'bytes')
NODE = 'compensator'
#: The compensator, as setup.py installs it.
START = 'from wrist_ft_comp.node.executables import compensator; compensator()'
#: The diagnostics tell within this time what was counted, s.
DIAGNOSTICS_S = 1.2
#: Processes that have just met get this time before they are measured, s.
SETTLE_S = 2.0
LEARNT_DAYS = 12
ROLES = str(Path(__file__).with_name('stream_roles.py'))
#: What is made of the figures of several runs. ``cpu_us``: processor time of the node per wrench;
#: ``p50_us`` to ``max_us``: latency from the sensor's stamp to the receiver; ``lost``: what the
#: receiver did not hear of what was sent; ``lost_before`` and ``lost_inside``: of these before and
#: in the node, NaN where nobody counts; ``external``: wrenches without the payload that were
#: heard; ``publisher_late_ms``: how far the sensor was behind its own clock.
SUMMARIES: tuple[tuple[Callable[[Any], float], tuple[str, ...]], ...] = (
    (median, ('cpu_us', 'p50_us', 'p99_us')),
    (max, ('max_us', 'publisher_late_ms')),
    (sum, ('sent', 'lost', 'lost_before', 'lost_inside', 'external')),
)
HEADER = (
    'rate, Hz  through      CPU, µs  p50, µs  p99, µs  max, µs    sent    lost  '
    'before node  in node  publisher late, ms'
)
#: Figures of a run, named in SUMMARIES.
Run = dict[str, float]


def make_model(folder: Path) -> Path:
    """Calibrate from a warm-up of two hours, in a process of its own; give model.yaml."""
    recording, model = stand.write_warm_up(folder / 'warm_up.csv', 7200), folder / 'model.yaml'
    words = ('-m', 'wrist_ft_comp', 'calibrate', str(recording), '-o', str(model))
    subprocess.run([sys.executable, *words], check=True, stdout=subprocess.DEVNULL)
    return model


def keep(name: str, figures: object) -> None:
    """Write figures into out/."""
    stand.keep(name, json.dumps(figures, indent=1))


@contextmanager
def process(*words: str) -> Iterator['subprocess.Popen[str]']:
    """Run Python with these words; ended by its own id."""
    running = subprocess.Popen(
        [sys.executable, *words],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        yield running
    finally:
        if running.poll() is None:
            running.send_signal(signal.SIGTERM)
            running.communicate('end\n', timeout=20)


def processor_us(pid: int) -> float:
    """Processor time that the threads of a process have used, µs."""
    tasks = Path(f'/proc/{pid}/task').glob('*/schedstat')
    return sum(int(task.read_text().split()[0]) for task in tasks) / 1e3


def order(running: 'subprocess.Popen[str]', words: str) -> None:
    """Give an order to a process of ours."""
    if running.stdin is None:
        raise TypeError('the process has no pipes')
    running.stdin.write(words + '\n')
    running.stdin.flush()


def ask(running: 'subprocess.Popen[str]', words: str) -> Any:
    """Give an order, and wait for its answer."""
    order(running, words)
    return json.loads(running.stdout.readline() if running.stdout else '')


def compensator(data: Path, namespace: str, *parameters: str) -> list[str]:
    """Words that start the compensator in a namespace, with a data directory."""
    settings = (f'data_directory:={data}', *parameters)
    words = [word for setting in settings for word in ('-p', setting)]
    return ['-c', START, '--ros-args', '-r', f'__ns:=/{namespace}', *words]


def with_model(folder: Path, namespace: str, *parameters: str) -> list[str]:
    """Words that start the compensator with the model."""
    model = f'model_file:={folder / "model.yaml"}'
    return compensator(folder / namespace, namespace, model, *parameters)


class Line:
    """
    A sensor process, a receiver process, and what runs between them.

    ``stack`` ends the processes; ``nodes`` are the words that start that of each namespace.
    """

    def __init__(self, stack: ExitStack, nodes: dict[str, Sequence[str]]) -> None:
        self.nodes = {n: stack.enter_context(process(*words)) for n, words in nodes.items()}
        self.receiver = stack.enter_context(process(ROLES, 'receiver', *nodes))
        self._sensor = stack.enter_context(process(ROLES, 'sensor', *nodes))
        self._counted: dict[str, Any] = {name: np.zeros(2, dtype=int) for name in nodes}
        #: Processor time until a message had come all the way through each node, µs.
        self.started_us: dict[str, float] = {}
        deadline = time.monotonic() + 60
        waiting = set(nodes)
        while waiting:
            if time.monotonic() > deadline:
                sys.exit(f'{", ".join(waiting)} did not start')
            for name in waiting:
                self._send(name, 20, 0.2)
            self._take()
            for name in [name for name in waiting if self.topics[name]['heard']]:
                self.started_us[name] = processor_us(self.nodes[name].pid)
                waiting.remove(name)
        time.sleep(SETTLE_S)
        self._take()
        for name in nodes:
            self._newly_counted(name)

    def _send(
        self, name: str, rate_hz: float, seconds: float, **beside: float
    ) -> dict[str, float]:
        """Let the sensor send."""
        job = {'to': name, 'rate_hz': rate_hz, 'seconds': seconds, **beside}
        result: dict[str, float] = ask(self._sensor, json.dumps(job))
        return result

    def _take(self) -> None:
        """Take what the receiver has."""
        taken = ask(self.receiver, 'take')
        self.topics: dict[str, Any] = taken['topics']
        self.calibrated = bool(taken['calibrated'])

    def _newly_counted(self, name: str) -> list[int]:
        """Give what a compensator has received and published since it was asked last."""
        topic, before = self.topics[name], self._counted[name]
        self._counted[name] = np.array([topic.get('received', 0), topic.get('published', 0)])
        new: list[int] = (self._counted[name] - before).tolist()
        return new

    def measure(self, name: str, rate_hz: float, seconds: float, **beside: float) -> Run:
        """Send through one of the nodes; what beside the wrenches, stream_roles says."""
        pid = self.nodes[name].pid
        before = processor_us(pid)
        sent = self._send(name, rate_hz, seconds, **beside)
        time.sleep(0.2)
        used = processor_us(pid) - before
        counts = name not in RELAYS
        time.sleep(DIAGNOSTICS_S if counts else 0.0)
        self._take()
        topic, total = self.topics[name], int(sent['sent'])
        received, published = self._newly_counted(name)
        return {
            'cpu_us': used / total,
            **dict(zip(('p50_us', 'p99_us', 'max_us'), topic['latencies_us'], strict=True)),
            'sent': total,
            'lost': total - topic['heard'],
            'lost_before': total - received if counts else math.nan,
            'lost_inside': received - published if counts else math.nan,
            'publisher_late_ms': sent['publisher_late_ms'],
            'external': topic['external'],
        }


def by_turns(
    line: Line, names: Sequence[str], rate_hz: float, seconds: float, repeats: int, **beside: float
) -> dict[str, list[Run]]:
    """Measure nodes one after the other, again and again."""
    runs: dict[str, list[Run]] = {name: [] for name in names}
    for _ in range(repeats):
        for name in names:
            runs[name].append(line.measure(name, rate_hz, seconds, **beside))
    return runs


def rows_of(runs: dict[str, list[Run]], rate_hz: float) -> list[dict[str, Any]]:
    """Sum up and print."""
    rows = []
    for name, measured in runs.items():
        row: dict[str, Any] = {'name': name, 'rate_hz': rate_hz}
        for combine, keys in SUMMARIES:
            row |= {key: combine(run[key] for run in measured) for key in keys}
        losses = f'{row["lost"]:6}  {row["lost_before"]:11}  {row["lost_inside"]:7}'
        print(
            f'{rate_hz:8.0f}  {name:11}  {row["cpu_us"]:7.1f}  {row["p50_us"]:7.0f}  '
            f'{row["p99_us"]:7.0f}  {row["max_us"]:7.0f}  {row["sent"]:6}  {losses}  '
            f'{row["publisher_late_ms"]:18.1f}',
            flush=True,
        )
        rows.append(row)
    return rows


def cpu_ratio(runs: dict[str, list[Run]], name: str, other: str) -> float:
    """Compare runs that followed each other, and take the median."""
    pairs = zip(runs[name], runs[other], strict=True)
    return median(run['cpu_us'] / beside['cpu_us'] for run, beside in pairs)


def compare_rates(line: Line, rates: Sequence[float], seconds: float, repeats: int) -> list[Any]:
    """Measure relays and node by turns at every rate."""
    rows = []
    for rate_hz in rates:
        runs = by_turns(line, (*RELAYS, NODE), rate_hz, seconds, repeats)
        rows += rows_of(runs, rate_hz)
        rows[-1] |= {f'cpu_to_{relay}': cpu_ratio(runs, NODE, relay) for relay in RELAYS}
        print(
            f"          compensator: {rows[-1]['cpu_to_typed']:.2f} of the typed relay's CPU, "
            f"{rows[-1]['cpu_to_bytes']:.2f} of the bytes relay's, "
            f"{rows[-1]['p99_us'] / rows[-3]['p99_us']:.2f} of the typed relay's p99"
        )
    return rows


def during_calibration(line: Line, folder: Path, seconds: float) -> list[Any]:
    """Measure at 1 kHz before and while the node calibrates from a recording of some hours."""
    stand.write_warm_up(folder / NODE / 'recordings/warm_up.csv', 4 * 3600)
    idle = [line.measure(NODE, 1000, seconds) for _ in range(4)]
    order(line.receiver, f'calibrate {NODE}')
    busy = [line.measure(NODE, 1000, seconds)]
    while not line.calibrated:
        busy.append(line.measure(NODE, 1000, seconds))
    rows = rows_of({'idle': idle, 'calibrating': busy}, 1000)
    print(f'          p99 while calibrating: {rows[1]["p99_us"] / rows[0]["p99_us"]:.2f} of idle')
    return rows


def with_a_field(folder: Path, seconds: float, repeats: int) -> list[Any]:
    """Compare, at 1 kHz, a thermometer with one that is a field of a message at the same rate."""
    entries = {'topic': 'temperature', 'field': STATE_ENTRY}
    nodes: dict[str, Sequence[str]] = {
        name: with_model(folder, name, f'temperature_topics:=["{entry}"]')
        for name, entry in entries.items()
    }
    with ExitStack() as stack:
        line = Line(stack, nodes)
        line.measure('field', 1000, 3.0, states=True)  # until it has found out what there is
        runs = by_turns(line, list(nodes), 1000, seconds, repeats, states=True)
    for name in nodes:
        print(f'{name:>19}: {line.topics[name]["temperatures_hz"]:.1f} temperatures a second')
    rows = rows_of(runs, 1000)
    rows[1]['cpu_to_topic'] = cpu_ratio(runs, 'field', 'topic')
    print(
        f'          a field of 1 kHz: {rows[1]["cpu_to_topic"]:.2f} of the CPU, '
        f'{rows[1]["p99_us"] / rows[0]["p99_us"]:.2f} of the p99'
    )
    return rows


def with_a_payload(
    folder: Path, rates: Sequence[float], seconds: float, repeats: int
) -> list[Any]:
    """Compare a node that holds a payload, with an IMU of 1 kHz, with one that holds none."""
    payload = Payload(1.5, np.array([0.0, 0.0, 0.06]))
    add_payloads(folder / PAYLOADS, 'bench', [payload], ForceFrame())
    held = ('gravity.source:=imu', 'payload.active:=bench-1')
    nodes: dict[str, Sequence[str]] = {
        'bare': with_model(folder, 'bare'),
        'payload': with_model(folder, 'payload', *held),
    }
    rows = []
    with ExitStack() as stack:
        line = Line(stack, nodes)
        for rate_hz in rates:
            every = max(round(rate_hz / 1000), 1)
            runs = by_turns(line, list(nodes), rate_hz, seconds, repeats, imu_every=every)
            rows += rows_of(runs, rate_hz)
            rows[-1]['cpu_to_bare'] = cpu_ratio(runs, 'payload', 'bare')
            missing = rows[-1]['sent'] - rows[-1]['external']
            print(
                f'          with a payload: {rows[-1]["cpu_to_bare"]:.2f} of the CPU, '
                f'{rows[-1]["p99_us"] / rows[-2]["p99_us"]:.2f} of the p99; '
                f'{missing} of wrench_external missing'
            )
    return rows


def while_learning(folder: Path, seconds: float) -> list[Any]:
    """Measure at 1 kHz while the node learns from days that it finds, and afterwards."""
    write_days(folder / 'learns', np.random.default_rng(0), LEARNT_DAYS, cell_s=1)
    given = 'gravity.source:=imu', 'calibration.reference:=payload', 'learning.mode:=auto'
    with ExitStack() as stack:
        line = Line(stack, {'learns': with_model(folder, 'learns', *given)})

        def measure() -> Run:
            return line.measure('learns', 1000, seconds, imu_every=1)

        busy = [measure()]
        while not (found := load_memory(folder / 'learns')) or not found.verdict:
            busy.append(measure())
        runs = {'learning': busy[:-1], 'afterwards': [measure() for _ in busy[:-1]]}
    rows = rows_of(runs, 1000)
    ratio = rows[0]['p99_us'] / rows[1]['p99_us']
    print(f'          p99 while learning: {ratio:.2f} of afterwards')
    return rows


def pure_compute(model: Path) -> float:
    """Time bytes in to bytes out without DDS, µs per wrench: the best of five passes."""
    node = Compensator(1, StreamSettings(), load_model(model).model)
    for second in range(3):
        node.add_temperature(0, second * 1_000_000_000, 25.0 + second)
    messages = [wrench_bytes(k * 1_000_000) for k in range(100_000)]
    best = float('inf')
    for _ in range(5):
        start = time.perf_counter()
        for data in messages:
            layout = locate(data, WRENCH_DOUBLES)
            layout.encode(data, node.correct(*layout.decode(data)))
        best = min(best, time.perf_counter() - start)
    return 1e6 * best / len(messages)


def main() -> None:
    """Measure everything, print tables, write JSON."""
    parser = argparse.ArgumentParser(description='Cost of the stream.')
    parser.add_argument('--seconds', type=float, default=2.0, help='length of a run')
    parser.add_argument('--repeats', type=int, default=5)
    parser.add_argument('rates', nargs='*', type=float, default=RATES_HZ, metavar='RATE')
    arguments = parser.parse_args()
    seconds, repeats = arguments.seconds, arguments.repeats
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ.setdefault('ROS_DOMAIN_ID', '93')
    figures: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        figures['compute_us'] = pure_compute(make_model(folder))
        print(f'computation alone, bytes in to bytes out: {figures["compute_us"]:.2f} µs')
        print(HEADER)
        with ExitStack() as stack:
            relays = {relay: [ROLES, 'relay', relay] for relay in RELAYS}
            line = Line(stack, {**relays, NODE: with_model(folder, NODE)})
            figures['rates'] = compare_rates(line, arguments.rates, seconds, repeats)
            figures['long'] = rows_of({'10 s': [line.measure(NODE, 8000, 10.0)]}, 8000)
            figures['calibration'] = during_calibration(line, folder, seconds)
        figures['field'] = with_a_field(folder, seconds, 2 * repeats)
        figures['payload'] = with_a_payload(folder, (1000, 2000), seconds, repeats)
        figures['learning'] = while_learning(folder, seconds)
    keep('stream.json', figures)


if __name__ == '__main__':
    main()
