"""wrist_ft_comp node: operate a running compensator without the ros2 command."""

import argparse
from collections.abc import Iterator
from contextlib import suppress
import sys
import textwrap
import time
from typing import TYPE_CHECKING

from tqdm import tqdm

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.cli import options
from wrist_ft_comp.errors import NodeError

if TYPE_CHECKING:
    from wrist_ft_comp.cli.operate import Operator, Watch
    from wrist_ft_comp.ros.diagnostics import Status

HELP = 'operate a running compensator: record, calibrate, tare, look at its status'
DESCRIPTION = """\
Let a running compensator do something, wait for its answer, and print it. Exit
code 0 when it was done, 1 when it was refused. status shows temperatures, drift
and what is wrong: once a second in a terminal, until Ctrl-C; else once. Its exit
code is 1 when anything is not ok. All services are actions; those
of this node are listed where another one is asked for."""
EXAMPLES = """\
examples:
  wrist_ft_comp node record
  wrist_ft_comp node stop
  wrist_ft_comp node calibrate
  wrist_ft_comp node tare --name left
  wrist_ft_comp node reset_tare
  wrist_ft_comp node identify_payload
  wrist_ft_comp node adopt
  wrist_ft_comp node rollback
  wrist_ft_comp node status
"""
#: Columns of a terminal that every page fits into.
WIDTH = 79
_LEVELS = {b'\0': 'ok', b'\1': 'WARNING', b'\2': 'ERROR', b'\3': 'STALE'}
#: Clears the terminal and goes to its corner.
_CLEAR = '\x1b[2J\x1b[H'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        'action', metavar='ACTION',
        help='status, record, stop (ends a recording), or another service of it')  # fmt: skip
    parser.add_argument(
        '--name', default='',
        help='which node, by its name or namespace, where several run')  # fmt: skip
    options.add_json(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    options.require_ros(NodeError, 'A running node is reached by rclpy')
    from wrist_ft_comp.cli.operate import (  # noqa: PLC0415 -- loads rclpy
        DISCOVERY_S,
        operating,
        Watch,
    )

    with operating() as operator:
        name = operator.find(arguments.name)
        watch = Watch(operator, name)
        if arguments.action == 'status':
            return _show(operator, name, watch, as_json=arguments.json)
        service = 'record' if arguments.action == 'stop' else arguments.action
        if not operator.wait_for(lambda: service in operator.services(name), DISCOVERY_S / 10):
            raise NodeError(
                f'{name} has no service {arguments.action}. Ask for status, stop, or one of '
                f'{", ".join(operator.services(name))}.'
            )
        answer = _ask(operator, name, watch, arguments.action)
    if arguments.json:
        options.print_json({'node': name, 'action': arguments.action, 'answer': answer})
    else:
        print(answer)
    return 0


def _ask(operator: 'Operator', name: str, watch: 'Watch', action: str) -> str:
    """Ask, and show on standard error how far it is, where that is a terminal."""
    from wrist_ft_comp.cli.operate import ask  # noqa: PLC0415 -- loads rclpy

    with tqdm(bar_format='{desc} {elapsed}', disable=None, leave=False) as line:

        def show() -> None:
            # What takes long has a status of its own, as payload for identify_payload.
            said = [status.message for name, status in watch.statuses.items() if name in action]
            line.set_description_str(': '.join([action, *said])[: WIDTH - 8])

        timer = operator.node.create_timer(0.5, show)
        try:
            return ask(operator, name, action, watch)
        finally:
            operator.node.destroy_timer(timer)


def _show(operator: 'Operator', name: str, watch: 'Watch', *, as_json: bool) -> int:
    """Print the status once, or in a terminal again and again; 1 when anything is not ok."""
    from wrist_ft_comp.cli.operate import SILENCE_S  # noqa: PLC0415 -- loads rclpy

    if not operator.wait_for(lambda: watch.reports, SILENCE_S):
        raise NodeError(f'{name} has published no diagnostics for {SILENCE_S:.0f} s.')
    if as_json:
        statuses = {
            key: {'level': _LEVELS[part.level].lower(), 'message': part.message, **part.values}
            for key, part in watch.statuses.items()
        }
        options.print_json({'node': name, 'hardware_id': watch.hardware_id, 'statuses': statuses})
    elif sys.stdout.isatty():
        with suppress(KeyboardInterrupt):
            while True:
                print(_CLEAR + '\n'.join(page(name, watch)), flush=True)
                watch.reports = 0
                operator.wait_for(lambda: watch.reports, 1.0)
    else:
        print('\n'.join(page(name, watch)))
    return int(any(status.level != b'\0' for status in watch.statuses.values()))


def page(name: str, watch: 'Watch') -> list[str]:
    """Write what was heard in at most WIDTH columns: what is wrong first, then the numbers."""
    statuses = watch.statuses
    sensor = f', sensor {watch.hardware_id}' if watch.hardware_id else ''
    lines = [f'{name}{sensor}'[: WIDTH - 10] + f'  {time.strftime("%H:%M:%S")}', '']
    if watch.silent:
        lines += ['Nothing was heard of it for ten seconds: it has ended, or hangs.', '']
    for status in sorted(statuses.values(), key=lambda status: status.level, reverse=True):
        head = f'{_LEVELS[status.level]:8}{status.name:15}'
        text = ' '.join(status.message.split())
        lines += textwrap.wrap(
            head + text, WIDTH, subsequent_indent=' ' * len(head), break_on_hyphens=False
        )
    return [*lines, '', *_temperatures(statuses), *_drifts(statuses)]


def _temperatures(statuses: 'dict[str, Status]') -> Iterator[str]:
    """Write what the thermometers read, and how old that is."""
    values = statuses['temperature'].values if 'temperature' in statuses else {}
    j = 1
    while f'thermometer_{j}_age_s' in values:
        celsius, age = values.get(f'thermometer_{j}_c'), values[f'thermometer_{j}_age_s']
        yield f'thermometer {j:2}  ' + (
            f'{celsius:>8} °C, {age} s ago' if celsius else 'not heard'
        )
        j += 1


def _drifts(statuses: 'dict[str, Status]') -> Iterator[str]:
    """Write what is subtracted from every axis."""
    values = statuses['output'].values if 'output' in statuses else {}
    if f'{AXES[0]}_drift' not in values:
        return
    yield ''
    yield f'{"axis":10}{"drift":>16}{"uncertain by":>16}{"tare":>16}'
    for axis in AXES:
        drift, tare = values.get(f'{axis}_drift', '-'), values.get(f'{axis}_tare', '-')
        yield f'{axis:10}{drift:>16}{values.get(f"{axis}_drift_deviation", "-"):>16}{tare:>16}'
