"""
What it costs to read and to compensate long recordings.

``python bench/cost/rewriting.py [MINUTES]``, 60 by default, runs ``wrist_ft_comp compensate`` at
1 kHz with a thermometer at 10 Hz, as mcap, sqlite3 and CSV, and ``show`` of a day as a node
records it, a row per second, each as a process of its own, start-up included. Processor time is
what other programs disturb least. Peak memory is shown for the whole and for a quarter of it,
because it must not grow. Figures are written to ``out/rewriting.json``.
"""

import argparse
from collections.abc import Callable, Iterator
from contextlib import closing
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
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores
from warm_up import keep, make_model

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.recordings.table_form import CsvRecordingWriter
from wrist_ft_comp.series import NANOSECONDS

STORE = get_typestore(Stores.ROS2_JAZZY)
WRENCH, TEMPERATURE = 'geometry_msgs/msg/WrenchStamped', 'sensor_msgs/msg/Temperature'
HEADER = struct.Struct('<4siII12s')
START_S = 1_723_248_197
RATE_HZ = 1000
DAY_S = 86_400
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


def command_cost(*words: object) -> dict[str, float]:
    """Measure processor time, s, elapsed time, s, and peak memory, MiB, of a command."""
    start = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, '-m', 'wrist_ft_comp', *map(str, words)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        sys.exit(f'{words} failed')
    return {
        'cpu_s': usage.ru_utime + usage.ru_stime,
        'elapsed_s': time.perf_counter() - start,
        'peak_mib': usage.ru_maxrss / 1024,
    }


#: By kind of recording: its suffix, and what writes it.
KINDS: dict[str, tuple[str, Callable[[Path, float], None]]] = {
    'mcap': ('', partial(write_bag, StoragePlugin.MCAP)),
    'sqlite3': ('', partial(write_bag, StoragePlugin.SQLITE3)),
    'csv': ('.csv', write_csv),
}


def compensate(kind: str, minutes: float, folder: Path, model: Path) -> dict[str, float]:
    """Measure one kind of recording."""
    suffix, write = KINDS[kind]
    costs = []
    for name, length in (('part', minutes / 4), ('long', minutes)):
        source, target = folder / f'{name}{suffix}', folder / f'{name}_made{suffix}'
        write(source, length)
        costs.append(command_cost('compensate', model, source, '-o', target))
    quarter, whole = costs
    rate = minutes * 60 * RATE_HZ / whole['cpu_s']
    return {**whole, 'quarter_peak_mib': quarter['peak_mib'], 'wrenches_per_cpu_s': rate}


def main() -> None:
    """Measure, print a table, write JSON."""
    parser = argparse.ArgumentParser(description='Speed and memory of compensate.')
    parser.add_argument('minutes', nargs='?', type=float, default=60.0)
    minutes = parser.parse_args().minutes
    print(f'{minutes:g} minutes; wrenches per second of processor time')
    print('storage   compensate  whole: CPU, s  elapsed, s  peak MiB of 1/4, 1')
    figures = {}
    for kind in KINDS:
        with tempfile.TemporaryDirectory() as name:
            row = figures[kind] = compensate(kind, minutes, Path(name), make_model(Path(name)))
        print(
            f'{kind:8}  {row["wrenches_per_cpu_s"]:10,.0f}  {row["cpu_s"]:13.1f}  '
            f'{row["elapsed_s"]:10.1f}  {row["quarter_peak_mib"]:12.0f}  {row["peak_mib"]:4.0f}',
            flush=True,
        )
    with tempfile.TemporaryDirectory() as name:
        day = Path(name) / 'day.csv'
        with closing(CsvRecordingWriter(day, (*AXES, 'temperature_c'))) as writer:
            for second in range(DAY_S):
                values = [0.1 * second, -0.2, 0.3, 0.01, -0.02, 0.03, 25 + second / DAY_S]
                writer.append((START_S + second) * NANOSECONDS, values)
        figures['day'] = command_cost('show', day)
    print('show of 24 h: {cpu_s:.1f} s CPU, {peak_mib:.0f} MiB'.format(**figures['day']))
    keep('rewriting.json', figures)


if __name__ == '__main__':
    main()
