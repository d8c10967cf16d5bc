"""Bags to read: written by rosbags itself, message by message."""

from collections.abc import Callable, Iterable
from pathlib import Path
import struct
from types import SimpleNamespace

import numpy as np
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores

STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = STORE.types
START_NS = 1_723_248_197_000_000_000
WRENCH = 'geometry_msgs/msg/WrenchStamped'
TEMPERATURE = 'sensor_msgs/msg/Temperature'
STRING = 'std_msgs/msg/String'


def _header(stamp_ns: int, frame: str) -> object:
    time = TYPES['builtin_interfaces/msg/Time'](*divmod(stamp_ns, 10**9))
    return TYPES['std_msgs/msg/Header'](time, frame)


def make_wrench(stamp_ns: int, values: Iterable[float], frame='ft_sensor', little=True) -> bytes:
    x, y, z, a, b, c = (float(value) for value in values)
    vector = TYPES['geometry_msgs/msg/Vector3']
    wrench = TYPES['geometry_msgs/msg/Wrench'](vector(x, y, z), vector(a, b, c))
    message = TYPES[WRENCH](_header(stamp_ns, frame), wrench)
    return bytes(STORE.serialize_cdr(message, WRENCH, little_endian=little))


def make_temperature(stamp_ns: int, value: float, frame='ft_sensor', little=True) -> bytes:
    message = TYPES[TEMPERATURE](_header(stamp_ns, frame), float(value), 0.25)
    return bytes(STORE.serialize_cdr(message, TEMPERATURE, little_endian=little))


def wrench_at(k: int) -> tuple[float, ...]:
    return (k % 7, -2.0, 0.5 * (k % 11), 0.01, 0.02, k % 3)


def fill(writer: Writer, count: int, wrench='/wrench_raw', start_ns=START_NS) -> None:
    """Write 1 kHz wrenches, 10 Hz temperatures and a topic of no interest."""
    add = writer.add_connection
    raw, warm, other = (
        add(topic, kind, typestore=STORE)
        for topic, kind in ((wrench, WRENCH), ('/temperature', TEMPERATURE), ('/log', STRING))
    )
    text = bytes(STORE.serialize_cdr(TYPES[STRING]('hello'), STRING))
    base = bytearray(make_wrench(0, wrench_at(0)))
    for k in range(count):
        stamp = start_ns + k * 1_000_000
        struct.pack_into('<iI', base, 4, *divmod(stamp, 10**9))
        struct.pack_into('<6d', base, len(base) - 48, *wrench_at(k))
        writer.write(raw, stamp + 5000, bytes(base))
        if k % 100 == 0:
            writer.write(warm, stamp + 6000, make_temperature(stamp, 25.0 + k * 1e-4))
            writer.write(other, stamp + 7000, text)


@pytest.fixture
def make_bag(tmp_path: Path) -> Callable[..., Path]:
    """Write a bag of some storage and compression; more arguments go to fill."""

    def make(storage='sqlite3', compression='none', count=3000, name='bag', **more) -> Path:
        writer = Writer(tmp_path / name, version=9, storage_plugin=StoragePlugin[storage.upper()])
        writer.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
        with writer:
            fill(writer, count, **more)
        return tmp_path / name

    return make


@pytest.fixture
def write_messages(tmp_path: Path) -> Callable[..., Path]:
    """Write a bag from (topic, type, bytes) one by one, a millisecond apart."""

    def write(*messages: tuple[str, str, bytes | None], name='few') -> Path:
        with Writer(tmp_path / name, version=9) as writer:
            known = {}
            for k, (topic, kind, data) in enumerate(messages):
                if topic not in known:
                    known[topic] = writer.add_connection(topic, kind, typestore=STORE)
                if data is not None:
                    writer.write(known[topic], START_NS + k * 1_000_000, data)
        return tmp_path / name

    return write


@pytest.fixture
def make_csv(tmp_path: Path) -> Callable[..., Path]:
    """Write text as a CSV file, byte for byte."""

    def make(text: str | bytes, name='run.csv') -> Path:
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return make


@pytest.fixture
def expected_means() -> Callable[[int], np.ndarray]:
    """Textbook means per second of what fill writes, shape (N, 6)."""

    def means(count: int) -> np.ndarray:
        cells = [range(k, min(k + 1000, count)) for k in range(0, count, 1000)]
        return np.array([np.mean([wrench_at(k) for k in cell], axis=0) for cell in cells])

    return means


@pytest.fixture
def messages() -> SimpleNamespace:
    """Build single messages, from a stamp in ns and a value."""
    return SimpleNamespace(wrench=make_wrench, temperature=make_temperature, start_ns=START_NS)
