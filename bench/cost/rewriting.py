"""
What it costs to compensate long recordings, against scripts of a user.

``python bench/cost/rewriting.py [MINUTES]``, 60 by default, runs ``wrist_ft_comp compensate`` at
1 kHz with a thermometer at 10 Hz, as mcap, sqlite3 and CSV. The script reads, computes and writes
one message by one, in typed Python; it gets the first PEER_MINUTES only, and is compared per
wrench, in processor time, which other programs disturb less. The command is run as a process of
its own, start-up included. Peak memory is shown for the whole and for a quarter of it, because it
must not grow. Figures are written to ``out/rewriting.json``.
"""

import argparse
from collections.abc import Callable, Iterator
import csv
from functools import partial
import math
import os
from pathlib import Path
import struct
import subprocess
import sys
import tempfile
import time
from typing import Any

import numpy as np
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores
from warm_up import keep, make_model

from wrist_ft_comp.signals import AXES, NANOSECONDS
from wrist_ft_comp.stored.model_file import load_model
from wrist_ft_comp.stream.compensator import Compensator, StreamSettings

STORE = get_typestore(Stores.ROS2_JAZZY)
WRENCH, TEMPERATURE = 'geometry_msgs/msg/WrenchStamped', 'sensor_msgs/msg/Temperature'
HEADER = struct.Struct('<4siII12s')
START_S = 1_723_248_197
RATE_HZ = 1000
PEER_MINUTES = 2.0
#: Wrenches between two temperatures.
THERMAL = 100


def rows(minutes: float) -> Iterator[tuple[int, Any, float | None]]:
    """
    Make stamps, ns, wrenches (6,), and a temperature with every hundredth.

    Second by second: a process inherits the peak of the memory of the one that starts it.
    """
    rng = np.random.default_rng(2)
    for second in range(round(minutes * 60)):
        wrenches = rng.normal(0, 0.05, (RATE_HZ, len(AXES)))
        for k, wrench in enumerate(wrenches):
            stamp = (START_S + second) * NANOSECONDS + k * (NANOSECONDS // RATE_HZ)
            warm = 25 + 20 * (1 - math.exp(-second / 1500)) if k % THERMAL == 0 else None
            yield stamp, wrench, warm


def write_bag(storage: StoragePlugin, path: Path, minutes: float) -> None:
    """Write the bag that is to be compensated."""
    with Writer(path, version=9, storage_plugin=storage) as writer:
        raw = writer.add_connection('/wrench_raw', WRENCH, typestore=STORE)
        warm = writer.add_connection('/temperature', TEMPERATURE, typestore=STORE)
        for stamp, wrench, temperature in rows(minutes):
            header = HEADER.pack(b'\0\1\0\0', *divmod(stamp, NANOSECONDS), 10, b'ft_sensor\0')
            if temperature is not None:
                writer.write(warm, stamp, header + struct.pack('<2d', temperature, 0.0))
            writer.write(raw, stamp, header + wrench.tobytes())


def write_csv(path: Path, minutes: float) -> None:
    """Write the CSV file that is to be compensated."""
    with path.open('w', encoding='utf-8') as file:
        file.write(','.join(('stamp_ns', *AXES, 'temperature_c')) + '\n')
        for stamp, wrench, temperature in rows(minutes):
            warm = '' if temperature is None else f'{temperature:.3f}'
            file.write(f'{stamp},{",".join(f"{v:.6f}" for v in wrench.tolist())},{warm}\n')


def rewrite_bag_typed(source: Path, target: Path, compensator: Compensator) -> None:
    """Copy a bag, and add compensated wrenches, one typed message by one."""
    with Reader(source) as reader, Writer(target, version=9, storage_plugin=_plugin(source)) as to:
        copies = {
            c.id: to.add_connection(c.topic, c.msgtype, typestore=STORE)
            for c in reader.connections
        }
        output = to.add_connection('/wrench', WRENCH, typestore=STORE)
        for connection, recorded, data in reader.messages():
            message: Any = STORE.deserialize_cdr(data, connection.msgtype)
            to.write(copies[connection.id], recorded, data)
            stamp = message.header.stamp.sec * NANOSECONDS + message.header.stamp.nanosec
            if connection.msgtype == TEMPERATURE:
                compensator.add_temperature(0, stamp, message.temperature)
                continue
            force, torque = message.wrench.force, message.wrench.torque
            values = compensator.correct(
                stamp, (force.x, force.y, force.z, torque.x, torque.y, torque.z)
            )
            force.x, force.y, force.z, torque.x, torque.y, torque.z = values
            to.write(output, recorded, STORE.serialize_cdr(message, WRENCH))


def _plugin(source: Path) -> StoragePlugin:
    """Find out how a bag is stored."""
    return StoragePlugin.MCAP if list(source.glob('*.mcap')) else StoragePlugin.SQLITE3


def rewrite_csv_typed(source: Path, target: Path, compensator: Compensator) -> None:
    """Copy a CSV file with its wrenches compensated, row by row."""
    with source.open(newline='') as file, target.open('w', newline='') as made:
        rows = csv.DictReader(file)
        writer = csv.DictWriter(made, rows.fieldnames or ())
        writer.writeheader()
        for row in rows:
            stamp = int(row['stamp_ns'])
            if row['temperature_c']:
                compensator.add_temperature(0, stamp, float(row['temperature_c']))
            corrected = compensator.correct(stamp, [float(row[axis]) for axis in AXES])
            writer.writerow(row | dict(zip(AXES, map(repr, corrected), strict=True)))


def peer_rate(
    rewrite: Callable[[Path, Path, Compensator], None], source: Path, model: Path, wrenches: int
) -> float:
    """Wrenches per second of processor time of the script."""
    compensator = Compensator(1, StreamSettings(), load_model(model).model)
    start = time.process_time()
    rewrite(source, source.with_name('typed' + source.suffix), compensator)
    return wrenches / (time.process_time() - start)


def command_cost(source: Path, model: Path, target: Path) -> dict[str, float]:
    """Measure processor time, s, elapsed time, s, and peak memory, MiB, of the command."""
    start = time.perf_counter()
    words = ('compensate', str(model), str(source), '-o', str(target))
    process = subprocess.Popen(
        [sys.executable, '-m', 'wrist_ft_comp', *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        sys.exit(f'compensate failed on {source}')
    return {
        'cpu_s': usage.ru_utime + usage.ru_stime,
        'elapsed_s': time.perf_counter() - start,
        'peak_mib': usage.ru_maxrss / 1024,
    }


#: By kind of recording: its suffix, what writes it, and the script that rewrites it.
KINDS: dict[str, tuple[str, Callable[[Path, float], None], Any]] = {
    'mcap': ('', partial(write_bag, StoragePlugin.MCAP), rewrite_bag_typed),
    'sqlite3': ('', partial(write_bag, StoragePlugin.SQLITE3), rewrite_bag_typed),
    'csv': ('.csv', write_csv, rewrite_csv_typed),
}


def compare(kind: str, minutes: float, folder: Path, model: Path) -> dict[str, float]:
    """Measure one kind of recording."""
    suffix, write, rewrite = KINDS[kind]
    long, part, short = (folder / f'{name}{suffix}' for name in ('long', 'part', 'short'))
    peer_minutes = min(PEER_MINUTES, minutes)
    for path, length in ((long, minutes), (part, minutes / 4), (short, peer_minutes)):
        write(path, length)
    typed = peer_rate(rewrite, short, model, round(peer_minutes * 60 * RATE_HZ))
    quarter = command_cost(part, model, folder / f'part_made{suffix}')
    whole = command_cost(long, model, folder / f'long_made{suffix}')
    ours = minutes * 60 * RATE_HZ / whole['cpu_s']
    return {
        **whole,
        'quarter_peak_mib': quarter['peak_mib'],
        'wrenches_per_cpu_s': ours,
        'typed_per_cpu_s': typed,
        'ratio': ours / typed,
    }


def main() -> None:
    """Measure, print a table, write JSON."""
    parser = argparse.ArgumentParser(description='Speed and memory of compensate.')
    parser.add_argument('minutes', nargs='?', type=float, default=60.0)
    minutes = parser.parse_args().minutes
    print(f'{minutes:g} minutes; wrenches per second of processor time')
    print(
        'storage   compensate  typed script  ratio  whole: CPU, s  elapsed, s  peak MiB of 1/4, 1'
    )
    figures = {}
    for kind in KINDS:
        with tempfile.TemporaryDirectory() as name:
            row = figures[kind] = compare(kind, minutes, Path(name), make_model(Path(name)))
        print(
            f'{kind:8}  {row["wrenches_per_cpu_s"]:10,.0f}  {row["typed_per_cpu_s"]:12,.0f}  '
            f'{row["ratio"]:5.1f}  {row["cpu_s"]:13.1f}  {row["elapsed_s"]:10.1f}  '
            f'{row["quarter_peak_mib"]:15.0f}  {row["peak_mib"]:4.0f}',
            flush=True,
        )
    keep('rewriting.json', figures)


if __name__ == '__main__':
    main()
