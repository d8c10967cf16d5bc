"""wrist_ft_comp node: operate a running compensator without the ros2 command."""

import argparse
from collections.abc import Iterator
from contextlib import suppress
import re
import sys
import time
from typing import TYPE_CHECKING

from rich.console import Group
from rich.live import Live
from rich.table import Table

from wrist_ft_comp.channels import AXES, axis_unit
from wrist_ft_comp.cli import options, terminal
from wrist_ft_comp.errors import NodeError

if TYPE_CHECKING:
    from wrist_ft_comp.cli.service_calls import Watch

HELP = 'operate a running compensator: record, calibrate, tare, look at its status'
DESCRIPTION = """\
Let a running compensator do something, wait for its answer, and print it.
status shows what is wrong and what to do, the wrench before and after, drift,
tare and temperatures: again and again in a terminal, until Ctrl-C; else once.
Its exit code is 1 when the wrench is not compensated or anything else is not ok.
An action is the name of a service; with a wrong name, those of the node are
listed."""
_LEVELS = {b'\0': 'ok', b'\1': 'WARNING', b'\2': 'ERROR', b'\3': 'STALE'}


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
    from wrist_ft_comp.cli import service_calls  # noqa: PLC0415 -- loads rclpy

    action = arguments.action
    with service_calls.operating() as operator:
        name = operator.find(arguments.name)
        watch = service_calls.Watch(operator, name)
        if action == 'status':
            silence_s = service_calls.SILENCE_S
            if not operator.wait_for(lambda: watch.reports, silence_s):
                raise NodeError(f'{name} has published no diagnostics for {silence_s:.0f} s.')
            return _show(watch, arguments)
        service = 'record' if action == 'stop' else action
        if not operator.wait_for(lambda: service in operator.services(f'{name}/'), 1.0):
            offered = ', '.join(operator.services(f'{name}/'))
            raise NodeError(
                f'{name} has no service {action}. Ask for status, stop, or one of {offered}.'
            )
        if not arguments.json:
            print(f'{action}: asked {name}', file=sys.stderr)
        answer = watch.ask(action)
    document = {'node': name, 'action': action, 'answer': answer}
    terminal.print_result([answer], document, as_json=arguments.json)
    return 0


def _show(watch: 'Watch', arguments: argparse.Namespace) -> int:
    """Print the status once, or in a terminal again and again; 1 when anything is not ok."""
    if arguments.json or not sys.stdout.isatty():
        statuses = {
            key: {'level': _LEVELS[part.level].lower(), 'message': part.message, **part.values}
            for key, part in watch.statuses.items()
        }
        document = {'node': watch.name, 'hardware_id': watch.hardware_id, 'statuses': statuses}
        terminal.print_result(status_page(watch), document, as_json=arguments.json)
    else:
        with suppress(KeyboardInterrupt), Live(auto_refresh=False) as live:
            while True:
                live.update(Group(*terminal.coloured(status_page(watch))), refresh=True)
                watch.reports = 0
                watch.operator.wait_for(lambda: watch.reports, 1.0)
    return int(any(status.level != b'\0' for status in watch.statuses.values()))


def status_page(watch: 'Watch') -> Iterator[str | Table]:
    """Write what was heard: what is wrong first, then the numbers."""
    sensor = f', sensor {watch.hardware_id}' if watch.hardware_id else ''
    yield f'{watch.name}{sensor}'[: terminal.WIDTH - 11] + f'  {time.strftime("%H:%M:%S")}'
    yield ''
    if watch.silent:
        yield 'ERROR   Nothing was heard of it for ten seconds: it has ended, or hangs.'
    for status in sorted(watch.statuses.values(), key=lambda one: one.level, reverse=True):
        head = f'{_LEVELS[status.level]:8}{status.name:13}'
        message = re.sub(r'(?<!\S)~/(\w+)', r'wrist_ft_comp node \1', status.message)
        yield from terminal.filled(' '.join(message.split()) or '-', head).splitlines()
    values = {name: status.values for name, status in watch.statuses.items()}
    output, heard = values.get('output', {}), values.get('temperature', {})
    model, calibration = values.get('model', {}), values.get('calibration', {})
    if f'{AXES[0]}_drift' in output:
        output = values.get('payload', {}) | output  # both have a tare
        names = ['raw', 'compensated', 'external', 'drift', 'drift_deviation', 'tare']
        if f'{AXES[0]}_external' not in output:
            names.remove('external')
        rows = [
            [axis, axis_unit(axis)]
            + [output.get(f'{axis}_{name}', '–').partition(' ')[0] for name in names]
            for axis in AXES
        ]
        titles = [name.replace('drift_deviation', '± 1 σ') for name in names]
        yield ''
        yield terminal.table(['axis', 'unit', *titles], rows)
    if thermometers := [key.removesuffix('_age_s') for key in heard if key.endswith('_age_s')]:
        yield ''
        yield terminal.table(
            ['thermometer', 'now, °C', 'age, s', 'learnt at'],
            [
                [one.removeprefix('thermometer_'),
                 ' → '.join(heard[k] for k in (f'{one}_c', f'{one}_believed_c') if k in heard)
                 or '–',
                 heard[f'{one}_age_s'], model.get(f'{one}_calibrated_c', '–')]
                for one in thermometers
            ])  # fmt: skip
    if seconds := calibration.get('recording_s'):
        minutes = float(seconds) / 60
        yield f'A recording has run for {minutes:.0f} min. End it: wrist_ft_comp node stop'
