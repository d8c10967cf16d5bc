"""
What the stream costs: processor time and latency of a message, against relays a user would write.

``python bench/stream.py [SECONDS] [RATE …]``. Real processes over DDS on loopback: a sensor, a
receiver, and between them in turn a plain typed relay on the default executor, a relay of bytes on
the events executor, and the compensator with a model; last, the computation alone. A table on
standard output, figures in ``out/stream.json``.
"""

import argparse
import json
import os
import signal
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

ROLES = {'typed relay': 'typed', 'bytes relay': 'raw', 'compensator': 'compensator'}
WARM_UP_S = 1.0
SETTLE_S = 1.5
TEMPERATURE_HZ = 10
_FRAME = b'wrist_ft\0'
_HEAD = struct.Struct('<4siII12s')


def header(stamp_ns: int) -> bytes:
    """Serialize a header; its doubles follow."""
    return _HEAD.pack(b'\0\1\0\0', *divmod(stamp_ns, 1_000_000_000), len(_FRAME), _FRAME)


def sense(context: Any, rate_hz: float, seconds: float) -> dict[str, float]:
    """Publish wrenches at a rate, stamped with the monotonic clock; temperatures beside them."""
    from geometry_msgs.msg import WrenchStamped  # noqa: PLC0415 -- a role of a process
    from rclpy.node import Node  # noqa: PLC0415
    from sensor_msgs.msg import Temperature  # noqa: PLC0415

    from wrist_ft_comp.ros import qos  # noqa: PLC0415

    node: Any = Node('bench_sensor', context=context)
    wrench = node.create_publisher(WrenchStamped, 'wrench_raw', qos.FAST_SENSOR)
    warm = node.create_publisher(Temperature, 'temperature', qos.SLOW_SENSOR)
    while not wrench.get_subscription_count():
        time.sleep(0.01)
    time.sleep(SETTLE_S)  # discovery of every service costs tens of milliseconds, once
    print('ready', flush=True)
    sys.stdin.readline()
    doubles = struct.pack('<6d', 1.0, 2.0, 3.0, 0.1, 0.2, 0.3)
    sent, start = 0, time.monotonic()
    next_temperature = start
    while (now := time.monotonic()) < start + seconds:
        if now >= next_temperature:
            degrees = struct.pack('<2d', 25.0 + (now - start), 0.0)
            warm.publish(header(time.monotonic_ns()) + degrees)
            next_temperature += 1 / TEMPERATURE_HZ
        while sent < (time.monotonic() - start) * rate_hz:
            wrench.publish(header(time.monotonic_ns()) + doubles)
            sent += 1
        time.sleep(max(start + (sent + 1) / rate_hz - time.monotonic(), 0.0))
    time.sleep(0.3)
    node.destroy_node()
    return {'sent': sent, 'seconds': seconds}


def receive(context: Any) -> dict[str, float]:
    """Receive until a signal; latencies are from the stamps, which pass through untouched."""
    from geometry_msgs.msg import WrenchStamped  # noqa: PLC0415
    from rclpy.node import Node  # noqa: PLC0415
    from rclpy.qos import QoSProfile  # noqa: PLC0415

    from wrist_ft_comp.ros.running import make_executor  # noqa: PLC0415

    node: Any = Node('bench_receiver', context=context)
    came: list[tuple[bytes, int]] = []
    node.create_subscription(
        WrenchStamped,
        'wrench',
        lambda data: came.append((data[4:12], time.monotonic_ns())),
        QoSProfile(depth=5000),  # type: ignore[no-untyped-call] # as rclpy declares it
        raw=True,
    )
    executor = make_executor('auto', context)
    executor.add_node(node)
    ended: list[bool] = []
    signal.signal(signal.SIGTERM, lambda *_: ended.append(True))
    while not ended:
        executor.spin_once(timeout_sec=0.2)
    executor.shutdown()
    node.destroy_node()
    stamps = np.array([struct.unpack('<iI', head) for head, _ in came], dtype=np.int64)
    if not len(stamps):
        return {'received': 0, 'p50_us': np.nan, 'p99_us': np.nan, 'max_us': np.nan}
    latency_us = (
        np.array([at for _, at in came]) - stamps[:, 0] * 1_000_000_000 - stamps[:, 1]
    ) / 1e3
    p50, p99 = np.percentile(latency_us, [50, 99])
    return {'received': len(came), 'p50_us': p50, 'p99_us': p99, 'max_us': latency_us.max()}


def relay(context: Any, *, raw: bool) -> dict[str, float]:
    """Pass wrenches on: typed on the default executor, or bytes on the events executor."""
    from geometry_msgs.msg import WrenchStamped  # noqa: PLC0415
    from rclpy.node import Node  # noqa: PLC0415

    from wrist_ft_comp.ros import qos  # noqa: PLC0415
    from wrist_ft_comp.ros.running import make_executor  # noqa: PLC0415

    node: Any = Node('bench_relay', context=context)
    publisher = node.create_publisher(WrenchStamped, 'wrench', qos.OUTPUT)
    node.create_subscription(
        WrenchStamped, 'wrench_raw', publisher.publish, qos.FAST_SENSOR, raw=raw
    )
    executor = make_executor('auto' if raw else 'default', context)
    executor.add_node(node)
    ended: list[bool] = []
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: ended.append(True))
    while not ended:
        executor.spin_once(timeout_sec=0.2)
    executor.shutdown()
    node.destroy_node()
    return {}


def play_role(words: Sequence[str]) -> None:
    """Be one of the processes."""
    from rclpy.context import Context  # noqa: PLC0415

    context = Context()
    context.init([])
    role, *numbers = words
    if role == 'sensor':
        result = sense(context, *(float(number) for number in numbers))
    elif role == 'receiver':
        result = receive(context)
    else:
        result = relay(context, raw=role == 'raw')
    context.try_shutdown()
    print(json.dumps(result))


@contextmanager
def process(*words: str, module: str = '') -> Iterator['subprocess.Popen[str]']:
    """Run a role of this file, or a module of the package; ended by its own id."""
    program = ['-m', module] if module else [__file__, '--role']
    running = subprocess.Popen(
        [sys.executable, *program, *words],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        yield running
    finally:
        if running.poll() is None:
            running.send_signal(signal.SIGTERM)
            running.communicate(timeout=20)


def processor_seconds(pid: int) -> float:
    """Processor time that a process has used."""
    fields = Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def measure(node: 'subprocess.Popen[str]', rate_hz: float, seconds: float) -> dict[str, float]:
    """Send at a rate through a running node."""
    with process('receiver') as receiver:
        time.sleep(WARM_UP_S)
        with process('sensor', str(rate_hz), str(seconds)) as sensor:
            if sensor.stdout is None or sensor.stdout.readline() != 'ready\n':
                sys.exit('the sensor did not start')
            before = processor_seconds(node.pid)
            sent = json.loads(sensor.communicate('go\n', timeout=seconds + 60)[0])
        used = processor_seconds(node.pid) - before
        receiver.send_signal(signal.SIGTERM)
        got = json.loads(receiver.communicate(timeout=20)[0])
    messages = max(sent['sent'], 1)
    return {
        **got,
        'sent': sent['sent'],
        'lost': sent['sent'] - got['received'],
        'cpu_us': 1e6 * used / messages,
    }


def make_model(folder: Path) -> Path:
    """Calibrate from a made-up warm-up of six axes."""
    rng = np.random.default_rng(1)
    cells = np.arange(7200)
    temperature = 25 + 20 * (1 - np.exp(-cells / 1500)) + 3 * np.sin(cells / 500)
    drift = np.outer(temperature - 25, [0.1, -0.1, 0.4, 0.01, -0.01, 0.02])
    rows = np.column_stack((cells, drift + rng.normal(0, 0.05, drift.shape), temperature))
    names = 'stamp_s,force_x,force_y,force_z,torque_x,torque_y,torque_z,temperature_c'
    np.savetxt(folder / 'warm_up.csv', rows, delimiter=',', header=names, comments='', fmt='%.6f')
    subprocess.run(
        [
            *(sys.executable, '-m', 'wrist_ft_comp.cli.main', 'calibrate'),
            *(str(folder / 'warm_up.csv'), '-o', str(folder / 'model.yaml')),
        ],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    return folder / 'model.yaml'


@contextmanager
def node_of(role: str, folder: Path) -> Iterator['subprocess.Popen[str]']:
    """Run one of the candidates."""
    if role != 'compensator':
        with process(role) as running:
            yield running
        return
    parameters = {'model_file': folder / 'model.yaml', 'data_directory': folder / 'data'}
    words = [word for pair in parameters.items() for word in ('-p', '{}:={}'.format(*pair))]
    module = 'wrist_ft_comp.ros.compensator_node'
    with process('--ros-args', *words, module=module) as running:
        yield running


def pure_compute() -> float:
    """Time bytes in to bytes out without DDS, µs per message."""
    from wrist_ft_comp.core.compensator import Compensator, StreamSettings  # noqa: PLC0415
    from wrist_ft_comp.ros import wire  # noqa: PLC0415

    compensator = Compensator(1, StreamSettings())
    reader = wire.Wire(6)
    doubles = struct.pack('<6d', 1.0, 2.0, 3.0, 0.1, 0.2, 0.3)
    messages = [header(k * 1_000_000) + doubles for k in range(100_000)]
    best = np.inf
    for _ in range(5):
        start = time.perf_counter()
        for data in messages:
            layout, stamp_ns, raw = reader.read(data)
            wire.replace(layout, data, compensator.correct(stamp_ns, raw))
        best = min(best, time.perf_counter() - start)
    return 1e6 * best / len(messages)


def main() -> None:
    """Measure everything, print a table, write JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('seconds', nargs='?', type=float, default=5.0)
    parser.add_argument('rates', nargs='*', type=float, default=[500, 1000, 2000, 4000, 8000])
    arguments = parser.parse_args()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ['ROS_DOMAIN_ID'] = '93'
    results: list[dict[str, Any]] = []
    print('rate, Hz  node            CPU, µs  p50, µs  p99, µs  max, µs   sent   lost')
    with tempfile.TemporaryDirectory() as name:
        make_model(Path(name))
        for rate in arguments.rates:
            for title, role in ROLES.items():
                with node_of(role, Path(name)) as node:
                    time.sleep(WARM_UP_S)
                    found = measure(node, rate, arguments.seconds)
                results.append({'rate_hz': rate, 'node': title, **found})
                print(
                    f'{rate:8.0f}  {title:14}  {found["cpu_us"]:7.0f}  {found["p50_us"]:7.0f}  '
                    f'{found["p99_us"]:7.0f}  {found["max_us"]:7.0f}  {found["sent"]:5.0f}  '
                    f'{found["lost"]:5.0f}',
                    flush=True,
                )
    compute = pure_compute()
    print(f'computation alone, bytes in to bytes out: {compute:.2f} µs per message')
    Path('out').mkdir(exist_ok=True)
    figures = {'stream': results, 'compute_us': compute}
    Path('out/stream.json').write_text(json.dumps(figures, indent=1), encoding='utf-8')


if __name__ == '__main__':
    if '--role' in sys.argv:
        play_role(sys.argv[2:])
    else:
        main()
