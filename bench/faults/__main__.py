"""
Faults on purpose, and what comes of them: ``python bench/faults BENCH [HOW MANY] [--seed N]``.

What each bench does stands at the head of its module; figures go to standard output and to
``out/BENCH.json``. Exit code 1 when something was wrong.
"""

import argparse
from importlib import import_module
from pathlib import Path
import signal
import sys
import tempfile

from stand import own_domain

#: By bench: module, function, ROS domain, unit of its first argument, and that argument's default.
BENCHES: dict[str, tuple[str, str, int, str, float]] = {
    'pauses': ('pauses', 'measure', 96, 'times', 1),
    'fuzz': ('fuzz', 'fuzz', 91, 'inputs', 10_000),
    'kills': ('kills', 'kill_recording', 94, 'kills', 200),
    'learning_kills': ('kills', 'kill_learning', 93, 'kills', 20),
    'restart': ('restart', 'compare_drift', 93, 'kills', 20),
    'endurance': ('endurance', 'endure', 95, 'minutes', 10.0),
}  # fmt: skip


def main() -> int:
    """Run one bench in a folder of its own."""
    parser = argparse.ArgumentParser(
        prog='bench/faults', description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    commands = parser.add_subparsers(dest='bench', required=True)
    for name, (_, _, _, unit, default) in BENCHES.items():
        command = commands.add_parser(name)
        command.add_argument(unit, nargs='?', type=type(default), default=default)
        command.add_argument('--seed', type=int, default=0)
        if name == 'endurance':
            command.add_argument('--rate', type=float, default=1000.0, help='wrenches, Hz')
            command.add_argument('--fault', help='the only one that is injected')
            command.add_argument('--shared-memory', action='store_true', help="Fast DDS's default")
    arguments = parser.parse_args()
    module, function, domain, *_ = BENCHES[arguments.bench]
    own_domain(domain, shared_memory=getattr(arguments, 'shared_memory', False))
    with tempfile.TemporaryDirectory() as folder:
        right = getattr(import_module(module), function)(arguments, Path(folder))
    return int(not right)


if __name__ == '__main__':
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # the node ends with the bench
    sys.exit(main())
