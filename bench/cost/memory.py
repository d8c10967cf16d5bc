"""
Memory of the node over a day: 24 h of stamps through its callbacks, as fast as they go.

``python bench/cost/memory.py [HOURS] [RATE]``, 24 h at 100 Hz by default, a thermometer at 10 Hz
and diagnostics every second of stamps. The node is the real one, with a model and a publisher
that nobody hears; only the transport is left out. Figures in ``out/memory.json``.
"""

import argparse
import os
from pathlib import Path
import struct
import sys
import tempfile
import time
from typing import Any

sys.path.append(str(Path(__file__).resolve().parents[1] / 'faults'))
from stand import keep, node_here
from stream import make_model
from stream_roles import wrench_bytes

from wrist_ft_comp.series import NANOSECONDS

TEMPERATURE_HZ = 10
START_S = 1_723_248_197
PAGE_MIB = os.sysconf('SC_PAGE_SIZE') / 2**20


def live_a_second(node: Any, second: int, rate_hz: int) -> None:
    """Give the node what comes in a second."""
    thermal = rate_hz // TEMPERATURE_HZ
    for k in range(rate_hz):
        stamp_ns = (START_S + second) * NANOSECONDS + k * (NANOSECONDS // rate_hz)
        if k % thermal == 0:
            degrees = 25.0 + 10.0 * abs(1 - second % 7200 / 3600)
            node.inputs.by_topic[0].read(wrench_bytes(stamp_ns, struct.pack('<2d', degrees, 0.0)))
        node._on_wrench(wrench_bytes(stamp_ns))  # noqa: SLF001 - as the executor does
    node._diagnose()  # noqa: SLF001


def endure(node: Any, hours: float, rate_hz: int) -> dict[str, Any]:
    """Run the hours; memory from the first minute on."""
    seconds, start = round(hours * 3600), time.perf_counter()
    samples: dict[int, float] = {}
    print('hours   resident, MiB   since the first minute, MiB')
    for second in range(seconds + 1):
        if second == 60 or (second > 60 and (second % 7200 == 0 or second == seconds)):
            samples[second] = int(Path('/proc/self/statm').read_text().split()[1]) * PAGE_MIB
            grown = samples[second] - samples[60]
            print(f'{second / 3600:5.2f}  {samples[second]:14.1f}  {grown:+28.2f}')
        live_a_second(node, second, rate_hz)
    speed = seconds / (time.perf_counter() - start)
    print(f'{speed:.0f} times as fast as time; {node.counts.published:,} wrenches')
    return {
        'resident_mib': samples, 'growth_mib': max(samples.values()) - samples[60], 'speed': speed,
    }  # fmt: skip


def main() -> None:
    """Read the arguments, run, write JSON."""
    parser = argparse.ArgumentParser(description='Memory of the node over a day.')
    parser.add_argument('hours', nargs='?', type=float, default=24.0)
    parser.add_argument('rate', nargs='?', type=int, default=100)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with node_here(folder, make_model(folder)) as node:
            figures = endure(node, arguments.hours, arguments.rate)
    print(f'growth after the first minute: {figures["growth_mib"]:.2f} MiB')
    keep('memory.json', figures)


if __name__ == '__main__':
    main()
