"""
The processes of the stream benchmark: sensors, receiver, and the relays a user would write.

``python bench/cost/stream_roles.py ROLE …``. Sensor and receiver obey lines on standard input and
answer with one line of JSON each.
"""

from collections.abc import Sequence
from functools import partial
from itertools import chain
import json
import signal
import struct
import sys
import threading
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
import numpy as np
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu, JointState, Temperature
from std_srvs.srv import Trigger

from wrist_ft_comp.ros import topics as qos
from wrist_ft_comp.series import NANOSECONDS

TEMPERATURE_HZ = 10
_FRAME = b'wrist_ft\0'
_HEAD = struct.Struct('<4siII12s')
_DOUBLES = struct.pack('<6d', 1.0, 2.0, 3.0, 0.1, 0.2, 0.3)
#: Of an IMU at rest: 25 doubles before those of acceleration.
_IMU = struct.pack('<37d', *[0.0] * 25, 0.1, 0.2, 9.8, *[0.0] * 9)
#: Of six joints; the third one's effort is taken for a temperature.
_STATE = serialize_message(
    JointState(
        name=[f'joint_{k}' for k in range(1, 7)],
        position=[0.5] * 6,
        velocity=[0.1] * 6,
        effort=[20.0, 21.0, 25.0, 23.0, 24.0, 22.0],
    )
)
#: Where it is.
STATE_ENTRY = 'state:effort[2]'


def wrench_bytes(stamp_ns: int, doubles: bytes = _DOUBLES) -> bytes:
    """Serialize a wrench, or whatever else is a header and doubles."""
    stamp = divmod(stamp_ns, NANOSECONDS)
    return _HEAD.pack(b'\0\1\0\0', *stamp, len(_FRAME), _FRAME) + doubles


def sense(context: Any, namespaces: Sequence[str]) -> None:
    """
    Publish as a request says, ``{"to": …, "rate_hz": …, "seconds": …}``, with stamps of now.

    ``"states": true`` sends the driver's whole state beside every wrench, temperature included;
    ``"imu_every": n`` a message of the IMU beside every n-th.
    """
    node: Any = Node('bench_sensor', context=context)
    kinds = (
        (WrenchStamped, 'wrench_raw', qos.FAST_SENSOR),
        (Temperature, 'temperature', qos.SLOW_SENSOR),
        (JointState, 'state', qos.FAST_SENSOR),
        (Imu, 'imu', qos.FAST_SENSOR),
    )
    publishers = {
        name: [
            node.create_publisher(kind, f'/{name}/{topic}', depth) for kind, topic, depth in kinds
        ]
        for name in namespaces
    }
    for line in sys.stdin:
        order = json.loads(line)
        print(json.dumps(_publish(*publishers[order.pop('to')], **order)), flush=True)
    node.destroy_node()


def _publish(  # noqa: PLR0913 -- as the order says
    wrench: Any,
    thermometer: Any,
    state: Any,
    imu: Any,
    *,
    rate_hz: float,
    seconds: float,
    states: bool = False,
    imu_every: int = 0,
) -> dict[str, float]:
    """Keep to a rate: what a pause delayed is sent at once, so that nothing is left out."""
    due, late_s = round(rate_hz * seconds), 0.0
    start = next_temperature = time.monotonic()
    for k in range(due):
        now = time.monotonic()
        while now < start + k / rate_hz:
            time.sleep(start + k / rate_hz - now)
            now = time.monotonic()
        late_s = max(late_s, now - start - k / rate_hz)
        if now >= next_temperature:
            degrees = struct.pack('<2d', 25.0 + now % 10.0, 0.0)
            thermometer.publish(wrench_bytes(time.monotonic_ns(), degrees))
            next_temperature += 1 / TEMPERATURE_HZ
        if imu_every and k % imu_every == 0:
            imu.publish(wrench_bytes(time.monotonic_ns(), _IMU))
        wrench.publish(wrench_bytes(time.monotonic_ns()))
        if states:
            stamp = struct.pack('<iI', *divmod(time.monotonic_ns(), NANOSECONDS))
            state.publish(_STATE[:4] + stamp + _STATE[12:])
    return {'sent': due, 'publisher_late_ms': 1e3 * late_s}


class Receiver:
    """Hears every output of some namespaces, and what the compensators count."""

    def __init__(self, context: Any, namespaces: Sequence[str]) -> None:
        self._node: Any = Node('bench_receiver', context=context)
        #: Stamps, and times of arrival.
        self._came: dict[str, list[tuple[bytes, int]]] = {name: [] for name in namespaces}
        self._counted: dict[str, dict[str, float]] = {name: {} for name in namespaces}
        self._calibrated: list[str] = []
        #: Wrenches without the payload that were heard, by namespace.
        self._external: dict[str, list[bytes]] = {name: [] for name in namespaces}
        profile: Any = QoSProfile
        deep = profile(depth=5000)
        listen = partial(self._node.create_subscription, WrenchStamped, raw=True)
        for name, came in self._came.items():
            listen(f'/{name}/wrench', partial(self._hear, came), deep)
            listen(f'/{name}/wrench_external', self._external[name].append, deep)
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        self._orders: list[str] = []

    @staticmethod
    def _hear(came: list[tuple[bytes, int]], data: bytes) -> None:
        came.append((data[4:12], time.monotonic_ns()))

    def run(self, context: Any) -> None:
        """Obey ``take`` and ``calibrate NAMESPACE`` until standard input ends."""
        executor = EventsExecutor(context=context)
        executor.add_node(self._node)
        orders = chain((line.strip() for line in sys.stdin), ['end'])
        threading.Thread(target=lambda: self._orders.extend(orders), daemon=True).start()
        while 'end' not in self._orders:
            executor.spin_once(timeout_sec=0.02)
            while self._orders and self._orders[0] != 'end':
                self._obey(*self._orders.pop(0).split())
        executor.shutdown()
        self._node.destroy_node()

    def _obey(self, order: str, namespace: str = '') -> None:
        if order == 'calibrate':
            client = self._node.create_client(Trigger, f'/{namespace}/wrist_ft_comp/calibrate')
            client.wait_for_service()
            answer = client.call_async(Trigger.Request())
            answer.add_done_callback(lambda done: self._calibrated.append(done.result().message))
        received = {
            name: {**latencies(came), **self._counted[name], 'external': len(self._external[name])}
            for name, came in self._came.items()
        }
        print(json.dumps({'topics': received, 'calibrated': self._calibrated}), flush=True)
        for name, came in self._came.items():
            came.clear()
            self._external[name].clear()

    def _on_diagnostics(self, array: Any) -> None:
        """Keep what the compensators count of wrenches, and the largest rate of temperatures."""
        for status in array.status:
            name, _, concern = status.name.partition('/wrist_ft_comp: ')
            counted = self._counted.get(name, {})
            for item in status.values if concern in {'input', 'output', 'temperature'} else ():
                if item.key in {'received', 'published', 'rate_hz'}:
                    key = item.key if item.key != 'rate_hz' else f'{concern} rate_hz'
                    counted[key] = max(float(item.value), counted.get(key, 0.0))


def latencies(came: list[tuple[bytes, int]]) -> dict[str, Any]:
    """Compute latencies from the stamps, which pass through untouched, µs."""
    if not came:
        return {'heard': 0, 'latencies_us': [0.0, 0.0, 0.0]}
    stamps = np.array([struct.unpack('<iI', head) for head, _ in came], dtype=np.int64)
    arrived = np.array([at for _, at in came])
    late_us = (arrived - stamps[:, 0] * NANOSECONDS - stamps[:, 1]) / 1e3
    heard = len(np.unique(stamps, axis=0))
    return {'heard': heard, 'latencies_us': np.percentile(late_us, [50, 99, 100]).tolist()}


def relay(context: Any, kind: str) -> None:
    """Pass wrenches on: typed on the default executor, or bytes on the events executor."""
    raw = kind == 'bytes'
    node: Any = Node('bench_relay', context=context, namespace=f'/{kind}')
    publisher = node.create_publisher(WrenchStamped, 'wrench', qos.OUTPUT)
    node.create_subscription(
        WrenchStamped, 'wrench_raw', publisher.publish, qos.FAST_SENSOR, raw=raw
    )
    executor = EventsExecutor(context=context) if raw else SingleThreadedExecutor(context=context)
    executor.add_node(node)
    ended = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: ended.set())
    while not ended.is_set():
        executor.spin_once(timeout_sec=0.2)
    executor.shutdown()
    node.destroy_node()


def main(role: str, *names: str) -> None:
    """Be one of the processes."""
    context = Context()
    context.init([])
    if role == 'sensor':
        sense(context, names)
    elif role == 'receiver':
        Receiver(context, names).run(context)
    else:
        relay(context, *names)
    context.try_shutdown()


if __name__ == '__main__':
    main(*sys.argv[1:])
