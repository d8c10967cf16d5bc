"""
What the stream costs: processor time and latency of a wrench, against relays a user would write.

``python bench/cost/stream.py [--seconds S] [--repeats N] [RATE …]``. Real processes over DDS on
loopback: a sensor, a receiver, and between them a plain typed relay on the default executor, a
relay of bytes on the events executor, and the compensator with a model, by turns in short runs, so
that a noisy machine is as noisy to each. Then the compensator during a calibration, with a
thermometer that is a field of another kilohertz message, with a payload and an IMU of 1 kHz, and
while it learns from days. Figures are medians of the runs, losses are sums; a wrench is lost where
the sensor's, the compensator's and the receiver's counts differ. All go to ``out/stream.json``.
"""

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, ExitStack
import json
import math
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

from wrist_ft_comp.learning.days import load_memory
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
START = 'from wrist_ft_comp.__main__ import compensator; compensator()'
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


@contextmanager
def process(*words: str) -> Iterator['subprocess.Popen[str]']:
    """
    Run Python with these words; ended by its own id, unless it ends with its standard input.

    A sensor that is killed may hold a lock of the shared memory for which a node would wait.
    """
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
        assert running.stdin is not None  # noqa: S101 -- as opened above
        running.stdin.close()
        try:
            running.wait(timeout=1)
        except subprocess.TimeoutExpired:
            running.send_signal(signal.SIGTERM)
            running.wait(timeout=20)


def processor_us(pid: int) -> float:
    """Processor time that the threads of a process have used, µs."""
    tasks = Path(f'/proc/{pid}/task').glob('*/schedstat')
    return sum(int(task.read_text().split()[0]) for task in tasks) / 1e3


def ask(running: 'subprocess.Popen[str]', words: str) -> Any:
    """Give an order, and wait for its answer."""
    assert running.stdin and running.stdout  # noqa: S101, PT018 -- as ``process`` opens them
    running.stdin.write(words + '\n')
    running.stdin.flush()
    return json.loads(running.stdout.readline())


def compensator(folder: Path, name: str, *parameters: str, model: bool = True) -> list[str]:
    """Words that start the compensator in a namespace and a folder of a name, with the model."""
    settings = [f'data_directory:={folder / name}', *parameters]
    if model:
        settings.append(f'model_file:={folder / "model.yaml"}')
    words = [word for setting in settings for word in ('-p', setting)]
    return ['-c', START, '--ros-args', '-r', f'__ns:=/{name}', *words]


class Line:
    """
    A sensor process, a receiver process, and what runs between them.

    ``stack`` ends the processes; ``nodes`` are the words that start that of each namespace.
    """

    def __init__(self, stack: ExitStack, nodes: Mapping[str, Sequence[str]]) -> None:
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
        job = {'to': name, 'rate_hz': rate_hz, 'seconds': seconds, **beside}
        result: dict[str, float] = ask(self._sensor, json.dumps(job))
        return result

    def _take(self) -> None:
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


def print_rows(runs: dict[str, list[Run]], rate_hz: float) -> list[dict[str, Any]]:
    """Sum up and print; the last one is compared with each of the others."""
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
    *others, last = rows
    for other in others:
        # Runs that followed each other are compared.
        pairs = zip(runs[last['name']], runs[other['name']], strict=False)
        cpu = median(run['cpu_us'] / beside['cpu_us'] for run, beside in pairs)
        last[f'cpu_to_{other["name"]}'] = cpu
        times = last['p99_us'] / other['p99_us']
        what = f'{cpu:.2f} of the CPU and {times:.2f} of the p99 of {other["name"]}'
        print(f'{"":10}{last["name"]}: {what}')
    return rows


def compare(
    line: Line, rate_hz: float, seconds: float, repeats: int, **beside: float
) -> list[dict[str, Any]]:
    """Measure the nodes of a line one after the other, again and again."""
    runs: dict[str, list[Run]] = {name: [] for name in line.nodes}
    for _ in range(repeats):
        for name, of_name in runs.items():
            of_name.append(line.measure(name, rate_hz, seconds, **beside))
    return print_rows(runs, rate_hz)


def during(
    title: str, is_over: Callable[[], bool], line: Line, name: str, seconds: float, **beside: float
) -> list[dict[str, Any]]:
    """Measure at 1 kHz while a node does something, and afterwards."""
    busy = [line.measure(name, 1000, seconds, **beside)]
    while not is_over():
        busy.append(line.measure(name, 1000, seconds, **beside))
    idle = [line.measure(name, 1000, seconds, **beside) for _ in range(max(4, len(busy)))]
    return print_rows({'idle': idle, title: busy}, 1000)


def measure_lines(
    folder: Path, rates: Sequence[float], seconds: float, repeats: int
) -> dict[str, list[dict[str, Any]]]:
    """Measure everything that goes through processes; figures by what was compared."""
    figures: dict[str, list[dict[str, Any]]] = {'rates': [], 'payload': []}
    with ExitStack() as stack:
        relays = {relay: [ROLES, 'relay', relay] for relay in RELAYS}
        line = Line(stack, {**relays, NODE: compensator(folder, NODE)})
        for rate_hz in rates:
            figures['rates'] += compare(line, rate_hz, seconds, repeats)
        figures['long'] = print_rows({'10 s': [line.measure(NODE, 8000, 10.0)]}, 8000)
        stand.write_warm_up(folder / NODE / 'recordings/warm_up.csv', 4 * 3600)
        ask(line.receiver, f'calibrate {NODE}')
        figures['calibration'] = during(
            'calibrating', lambda: line.calibrated, line, NODE, seconds
        )
    with ExitStack() as stack:  # a thermometer, and one that is a field of a message at 1 kHz
        entries = {'topic': 'temperature', 'field': STATE_ENTRY}
        nodes = {
            name: compensator(folder, name, f'temperature_topics:=["{entry}"]')
            for name, entry in entries.items()
        }
        line = Line(stack, nodes)
        line.measure('field', 1000, 3.0, states=True)  # until it has found out what there is
        figures['field'] = compare(line, 1000, seconds, 2 * repeats, states=True)
        for name in nodes:
            print(f'{name:>19}: {line.topics[name]["temperature rate_hz"]} temperatures a second')
    with ExitStack() as stack:  # a node that holds a payload, with an IMU of 1 kHz
        payload = Payload(1.5, np.array([0.0, 0.0, 0.06]))
        add_payloads(folder / PAYLOADS, 'bench', [payload], ForceFrame())
        held = compensator(folder, 'payload', 'gravity.source:=imu', 'payload.active:=bench-1')
        line = Line(stack, {'bare': compensator(folder, 'bare'), 'payload': held})
        for rate_hz in (1000, 2000):
            figures['payload'] += compare(
                line, rate_hz, seconds, repeats, imu_every=rate_hz // 1000
            )
            last = figures['payload'][-1]
            print(f'{"":10}{last["sent"] - last["external"]} of wrench_external missing')
    with ExitStack() as stack:  # a node that learns from days that it finds
        write_days(folder / 'learns', np.random.default_rng(0), LEARNT_DAYS, cell_s=1)
        given = 'gravity.source:=imu', 'calibration.reference:=payload', 'learning.mode:=auto'
        line = Line(stack, {'learns': compensator(folder, 'learns', *given)})

        def has_learnt() -> bool:
            memory = load_memory(folder / 'learns')
            return memory is not None and bool(memory.verdict)

        figures['learning'] = during('learning', has_learnt, line, 'learns', seconds, imu_every=1)
    return figures


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
    stand.own_domain(93, shared_memory=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        compute_us = pure_compute(make_model(folder))
        print(f'computation alone, bytes in to bytes out: {compute_us:.2f} µs')
        print(HEADER)
        figures = measure_lines(folder, arguments.rates, arguments.seconds, arguments.repeats)
    stand.keep('stream.json', {'compute_us': compute_us, **figures})


if __name__ == '__main__':
    main()
