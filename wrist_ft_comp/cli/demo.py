"""wrist_ft_comp demo: a simulated sensor, the real node, and a table of what it removed."""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, ExitStack, suppress
from dataclasses import dataclass
import json
import os
from pathlib import Path
import select
import subprocess
import sys
import tempfile
from typing import Any, NoReturn, TextIO

from tqdm import tqdm

from wrist_ft_comp.cli import options
from wrist_ft_comp.cli.demo_result import draw, judge, PART_KG, TOOL_KG, TOPICS
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.report.outputs import PICTURE
from wrist_ft_comp.stored.demo_log import load_demo_log
from wrist_ft_comp.stored.payload_file import load_payloads, PAYLOADS

#: A program that was asked to end is killed after this time, s.
_END_TIMEOUT_S = 10.0
#: While the operator is silent, the other programs are checked once in this time, s.
_LOOK_AFTER_S = 0.5
#: ROS domains whose ports Linux does not use for others; people choose from the other end.
_DOMAINS = range(60, 101)
_Process = subprocess.Popen[bytes]
_Event = dict[str, object]
#: Temperatures per second of a thermometer: as many as a real one sends.
_TEMPERATURE_RATE_HZ = 100.0
#: Duty cycle of the recorded day, s and level: the sensor warms up, rests, works and cools.
_RECORD_DUTY = ((0, 0.0), (300, 0.9), (3600, 0.0), (5700, 0.5), (8100, 1.0), (9600, 0.0))
_RECORD_S = 11400
#: Duty cycle of the day after, on which the calibration is judged.
_TEST_DUTY = ((0, 0.0), (2400, 0.7), (4800, 0.2), (6600, 1.0), (8400, 0.0), (9300, 0.6))
_TEST_S = 10800


@dataclass(frozen=True)
class Plan:
    """Arguments of the three programs: modules of ``node``, and their parameters."""

    #: Specimen of the simulated sensor.
    seed: int
    #: How many times faster than real time it runs.
    speed: float
    #: Whether the robot works, and never stands empty.
    at_work: bool = False

    def compensator(self, folder: Path) -> list[str]:
        """Write the node's command line."""
        learns: dict[str, object] = {'calibration.reference': 'recorded'}
        if self.at_work:
            learns = {'calibration.reference': 'payload', 'gravity.source': 'imu'}
        where = {'data_directory': folder / 'data', 'temperature_topics': _array(TOPICS)}
        return _program('compensator', where | learns)

    def operator(self, log_file: Path) -> list[str]:
        """Write the operator's command line."""
        work = ['--at-work'] * self.at_work
        return ['demo_client', *work, str(log_file), str(_RECORD_S), str(_TEST_S), *TOPICS]

    def sensor(self) -> list[str]:
        """Write the simulated sensor's command line, for both days."""
        # A busy machine calibrates while hours go by here: the other day comes several times.
        days = range(_RECORD_S, _RECORD_S + 6 * _TEST_S, _TEST_S)
        test = [(day + start, level) for day in days for start, level in _TEST_DUTY]
        duty = [*_RECORD_DUTY, *test]
        works = {
            'work.tool_mass': TOOL_KG, 'work.part_mass': PART_KG, 'load.force_n': 0.0,
            'load.torque_nm': 0.0,
        }  # fmt: skip
        parameters = {
            'seed': self.seed, 'speed': self.speed, 'wrench_rate': 500.0,
            'temperature_rate': min(self.speed, _TEMPERATURE_RATE_HZ),
            'duty_cycle.start_s': _array([float(start) for start, _ in duty]),
            'duty_cycle.level': _array([float(level) for _, level in duty]),
        }  # fmt: skip
        return _program('simulated_sensor', parameters | (works if self.at_work else {}))


def _program(module: str, parameters: Mapping[str, object]) -> list[str]:
    """Name a program and its parameters, as a ROS command line."""
    pairs = (['-p', f'{name}:={value}'] for name, value in parameters.items())
    return [module, '--ros-args', *(word for pair in pairs for word in pair)]


def _array(values: Sequence[object]) -> str:
    """Write an array as ROS parameters are written."""
    return f'[{", ".join(str(value) for value in values)}]'


def play(folder: Path, log_file: Path, plan: Plan, messages: TextIO) -> None:
    """
    Run the three processes until the operator is done, and end them.

    The operator puts what it received into the log file; what it says is printed to the messages.
    """
    with ExitStack() as stack:
        running = {'compensator': stack.enter_context(_process(*plan.compensator(folder)))}
        operator = stack.enter_context(_process(*plan.operator(log_file), stdout=subprocess.PIPE))
        bar = stack.enter_context(tqdm(total=1.0, disable=None, leave=False))
        for event in _events(operator, running):
            if event['event'] == 'recording':
                running['simulated sensor'] = stack.enter_context(_process(*plan.sensor()))
            else:
                _show(event, bar, messages, str(folder))
    if not log_file.exists():
        raise RecordingError('The demonstration ended without a result; see the messages above.')


def _show(event: _Event, bar: 'tqdm[NoReturn]', messages: TextIO, folder: str) -> None:
    """Show an event of the operator, but no line about a folder that is removed at the end."""
    if event['event'] == 'progress':
        bar.set_description(str(event['what']))
        bar.update(float(str(event['share'])) - bar.n)
    elif event['event'] == 'failed':
        raise RecordingError(f'The demonstration failed: {event["text"]}')
    elif event['event'] == 'message':
        bar.clear()
        for line in str(event['text']).splitlines():
            if folder not in line:
                print(line, file=messages, flush=True)


def _events(operator: _Process, running: Mapping[str, _Process]) -> Iterator[_Event]:
    """Read the events of the operator, a JSON object a line, while the others are alive."""
    output: Any = operator.stdout
    while True:
        if not select.select([output], [], [], _LOOK_AFTER_S)[0]:
            for name, process in running.items():
                if process.poll() is not None:
                    raise RecordingError(
                        f'The {name} of the demonstration ended early, with exit code '
                        f'{process.returncode}; see the messages above.'
                    )
            continue
        line = output.readline()
        if not line:
            return
        with suppress(ValueError):  # whatever else a library may print there is not for us
            event = json.loads(line)
            if isinstance(event, dict) and 'event' in event:
                yield event


def _environment() -> dict[str, str]:
    """Stay on this computer and out of the user's domain: a robot may listen to a wrench there."""
    taken = os.environ.get('ROS_DOMAIN_ID', '0')
    free = [domain for domain in _DOMAINS if str(domain) != taken]
    return {
        **os.environ,
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'ROS_DOMAIN_ID': str(free[os.getpid() % len(free)]),
    }


@contextmanager
def _process(module: str, *arguments: str, stdout: int | None = None) -> Iterator[_Process]:
    """Run one of the package's programs; end it by its own id."""
    command = [sys.executable, '-m', f'wrist_ft_comp.node.{module}', *arguments]
    # Without a buffer, in which lines would wait unseen by select.
    with subprocess.Popen(  # noqa: S603 -- our own modules, no shell
        command, env=_environment(), stdout=stdout, bufsize=0
    ) as process:
        try:
            yield process
        finally:
            process.terminate()
            try:
                process.wait(_END_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                process.kill()


HELP = 'watch the node learn and remove a simulated drift'
DESCRIPTION = """\
Start a simulated sensor and the compensator as processes, record a
warm-up, calibrate, let the robot cool down and warm up differently, and print
what is left of the drift. With --at-work the robot never stands empty.
Exit code 0 when drift of force z fell at least 10 times; at work, 5 times, and
the tool's mass was found within 5 %."""
EXAMPLES = """\
examples:
  wrist_ft_comp demo
  wrist_ft_comp demo --at-work
  wrist_ft_comp demo --seed 2 --output /tmp/demo
  wrist_ft_comp demo --json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        '--output', type=Path, default=Path('out'), metavar='FOLDER',
        help='for the picture, demo.png (default: %(default)s)')  # fmt: skip
    parser.add_argument(
        '--seed', type=options.number(0, 2**63 - 1), default=1, metavar='N',
        help='specimen of the simulated sensor (default: %(default)s)')  # fmt: skip
    parser.add_argument(
        '--speed', type=options.number(0.1, 1000.0), default=450.0, metavar='TIMES',
        help='how many times faster than real time (default: %(default)g)')  # fmt: skip
    parser.add_argument(
        '--at-work', action='store_true',
        help='learn drift and tool from a robot that moves, picks up parts and presses on things',
    )  # fmt: skip
    options.add_json(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    options.require_ros(RecordingError, 'The demonstration needs rclpy')
    picture = arguments.output / 'demo.png'
    PICTURE.check_target(picture)
    with tempfile.TemporaryDirectory(prefix='wrist_ft_comp_demo_') as folder:
        log_file = Path(folder, 'log.npz')
        messages = sys.stderr if arguments.json else sys.stdout
        plan = Plan(arguments.seed, arguments.speed, arguments.at_work)
        play(Path(folder), log_file, plan, messages)
        log = load_demo_log(log_file)
        learnt = load_payloads(Path(folder, 'data', 'models', PAYLOADS))
    masses_kg = {name: payload.mass_kg for name, (payload, _) in learnt.items()}
    outcome = judge(log, masses_kg if plan.at_work else None)
    PICTURE.write(picture, draw(log, external=plan.at_work))
    if arguments.json:
        options.print_json({**outcome.as_json(), 'picture': picture})
    else:
        print(f'{outcome.table()}\npicture: {picture}\n{outcome.sentence}')
    return 0 if outcome.reached else 1
