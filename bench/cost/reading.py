"""
Reading a bag of 1 kHz wrenches: messages per second, and memory against length.

``python bench/cost/reading.py [MINUTES]``, 20 by default (1.2 million wrenches). read_recording is
compared with rosbags' deserialize_cdr, one message by one, on the same bag.
"""

import argparse
from collections.abc import Callable
from pathlib import Path
import resource
import struct
import subprocess
import sys
import tempfile
import time

from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores

from wrist_ft_comp.recordings.recordings import read_recording

STORE = get_typestore(Stores.ROS2_JAZZY)
WRENCH, TEMPERATURE = 'geometry_msgs/msg/WrenchStamped', 'sensor_msgs/msg/Temperature'
HEADER = struct.Struct('<4siII12s')
START_S = 1_723_248_197


def write_bag(path: Path, minutes: float, storage: StoragePlugin) -> int:
    """Write 1 kHz wrenches and 10 Hz temperatures; return how many messages."""
    wrenches = round(minutes * 60_000)
    with Writer(path, version=9, storage_plugin=storage) as writer:
        raw = writer.add_connection('/wrench_raw', WRENCH, typestore=STORE)
        warm = writer.add_connection('/temperature', TEMPERATURE, typestore=STORE)
        doubles = struct.pack('<6d', 1.0, 2.0, 3.0, 0.1, 0.2, 0.3)
        degrees = struct.pack('<2d', 25.0, 0.0)
        for k in range(wrenches):
            second, millisecond = divmod(k, 1000)
            stamp = START_S + second, millisecond * 1_000_000
            header = HEADER.pack(b'\0\1\0\0', *stamp, 10, b'ft_sensor\0')
            recorded = stamp[0] * 1_000_000_000 + stamp[1]
            writer.write(raw, recorded, header + doubles)
            if k % 100 == 0:
                writer.write(warm, recorded, header + degrees)
    return wrenches + -(-wrenches // 100)


def read_one_by_one(path: Path) -> None:
    """Deserialize every message, as most scripts do."""
    with Reader(path) as reader:
        for connection, _, data in reader.messages():
            STORE.deserialize_cdr(data, connection.msgtype)


def rate(read: Callable[[Path], object], path: Path, messages: int) -> float:
    """Messages per second."""
    start = time.perf_counter()
    read(path)
    return messages / (time.perf_counter() - start)


def peak_mib(path: Path) -> float:
    """Peak memory of a process that reads the bag, MiB."""
    command = [sys.executable, __file__, '--peak', str(path)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return float(done.stdout)


def compare(minutes: float) -> None:
    """Print the table."""
    print(
        f'{"storage":8} {"read_recording":>15} {"one by one":>11} {"ratio":>6} {"peak, MiB":>22}'
    )
    for storage in (StoragePlugin.SQLITE3, StoragePlugin.MCAP):
        with tempfile.TemporaryDirectory() as folder:
            long, short = Path(folder, 'long'), Path(folder, 'short')
            messages = write_bag(long, minutes, storage)
            write_bag(short, minutes / 4, storage)
            bulk, single = (rate(f, long, messages) for f in (read_recording, read_one_by_one))
            peaks = peak_mib(short), peak_mib(long)
        print(
            f'{storage.name.lower():8} {bulk:13,.0f}/s {single:9,.0f}/s {bulk / single:6.1f} '
            f'{peaks[0]:7.1f} (x1) {peaks[1]:7.1f} (x4)'
        )


def main() -> None:
    """Read the arguments."""
    parser = argparse.ArgumentParser(description='Speed and memory of reading bags.')
    parser.add_argument('minutes', nargs='?', type=float, default=20.0)
    parser.add_argument('--peak', type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.peak:
        read_recording(arguments.peak)
        print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    else:
        compare(arguments.minutes)


if __name__ == '__main__':
    main()
