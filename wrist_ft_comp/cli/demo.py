"""wrist_ft_comp demo: a simulated sensor, the real node, and a table of what it removed."""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, ExitStack
from dataclasses import asdict
from importlib.util import find_spec
import json
import os
from pathlib import Path
import queue
import subprocess
import sys
import tempfile
import threading
from typing import NoReturn, TextIO

from matplotlib.figure import Figure
from tqdm import tqdm

from wrist_ft_comp.cli import options
from wrist_ft_comp.cli.evaluate import evaluation_text
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.files.demo_log import DemoLog, load_demo_log
from wrist_ft_comp.files.documents import write_picture
from wrist_ft_comp.model.signals import AXES, axis_unit, NANOSECONDS
from wrist_ft_comp.report.evaluation import AxisEvaluation, judge_errors, TaredErrors
from wrist_ft_comp.report.pictures import draw_drift, DriftSeries, png_bytes, TemperatureSeries

TOPICS = ('temperature', 'temperature_2')
#: The sensor warms up, rests, works, and cools while recording; then it lives another day.
_RECORD_DUTY = ((0, 0.0), (300, 0.9), (3600, 0.0), (5700, 0.5), (8100, 1.0), (9600, 0.0))
_RECORD_S = 11400
_TEST_DUTY = ((0, 0.0), (2400, 0.7), (4800, 0.2), (6600, 1.0), (8400, 0.0), (9300, 0.6))
_TEST_S = 10800
_END_TIMEOUT_S = 10.0
_LOOK_AFTER_S = 0.5
#: Domains that Linux keeps free of ephemeral ports, from the end that people don't begin with.
_DOMAINS = range(60, 101)
_Process = subprocess.Popen[str]
_Event = dict[str, object]


def play(folder: Path, log_file: Path, sensor: tuple[int, float], messages: TextIO) -> None:
    """
    Run the three processes until the operator is done, and end them.

    The sensor is its specimen, and how many times faster than real time it runs. The operator puts
    what it received into the log file; what it says is printed to the messages.
    """
    with ExitStack() as stack:
        running = {'compensator': stack.enter_context(_process(*_compensator(folder)))}
        operator = stack.enter_context(_process(*_operator(log_file), stdout=subprocess.PIPE))
        bar = stack.enter_context(tqdm(total=1.0, disable=None, leave=False))
        for event in _events(operator, running):
            if event['event'] == 'recording':
                running['simulated sensor'] = stack.enter_context(_process(*_sensor(*sensor)))
            else:
                _show(event, bar, messages)
    if not log_file.exists():
        raise RecordingError('The demonstration ended without a result; see the messages above.')


def _show(event: _Event, bar: 'tqdm[NoReturn]', messages: TextIO) -> None:
    """Show what the operator tells."""
    if event['event'] == 'progress':
        bar.set_description(str(event['what']))
        bar.update(float(str(event['share'])) - bar.n)
    elif event['event'] == 'failed':
        raise RecordingError(f'The demonstration failed: {event["text"]}')
    elif event['event'] == 'message':
        bar.clear()
        print(event['text'], file=messages, flush=True)


def _events(operator: _Process, running: Mapping[str, _Process]) -> Iterator[_Event]:
    """Read what the operator tells, a JSON object a line, while the others are alive."""
    lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
    threading.Thread(target=_read_lines, args=(operator, lines), daemon=True).start()
    while True:
        try:
            line = lines.get(timeout=_LOOK_AFTER_S)
        except queue.Empty:
            for name, process in running.items():
                if process.poll() is not None:
                    raise RecordingError(
                        f'The {name} of the demonstration ended early, with exit code '
                        f'{process.returncode}; see the messages above.'
                    ) from None
            continue
        if line is None:
            return
        try:
            event = json.loads(line)
        except ValueError:
            event = None
        # Whatever else a library may print there is not for us.
        if isinstance(event, dict) and 'event' in event:
            yield event


def _read_lines(operator: _Process, lines: 'queue.SimpleQueue[str | None]') -> None:
    """Hand lines over until the operator has ended, then None."""
    if operator.stdout is not None:
        with operator.stdout:
            for line in operator.stdout:
                lines.put(line)
    lines.put(None)


def _compensator(folder: Path) -> list[str]:
    """Set the node up; its module and arguments."""
    return [
        'compensator_node',
        *_ros_arguments(
            data_directory=folder / 'data',
            temperature_topics=_array(TOPICS),
            **{'calibration.reference': 'recorded'},
        ),
    ]


def _operator(log_file: Path) -> list[str]:
    """Tell the operator what to do; its module and arguments."""
    return ['demo_client', str(log_file), str(_RECORD_S), str(_TEST_S), *TOPICS]


def _sensor(seed: int, speed: float) -> list[str]:
    """Set the simulated sensor up for both days; its module and arguments."""
    # A busy machine calibrates while hours go by here: the other day comes several times.
    days = range(_RECORD_S, _RECORD_S + 6 * _TEST_S, _TEST_S)
    test = [(day + start, level) for day in days for start, level in _TEST_DUTY]
    duty = [*_RECORD_DUTY, *test]
    return [
        'simulated_sensor_node',
        *_ros_arguments(
            seed=seed,
            speed=speed,
            wrench_rate=500.0,
            temperature_rate=speed,
            **{
                'duty_cycle.start_s': _array([float(start) for start, _ in duty]),
                'duty_cycle.level': _array([float(level) for _, level in duty]),
            },
        ),
    ]


def _ros_arguments(**parameters: object) -> list[str]:
    """Write parameters as a ROS command line."""
    pairs = (['-p', f'{name}:={value}'] for name, value in parameters.items())
    return ['--ros-args', *(word for pair in pairs for word in pair)]


def _array(values: Sequence[object]) -> str:
    """Write an array as ROS parameters are written."""
    return f'[{", ".join(str(value) for value in values)}]'


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
    process = subprocess.Popen(  # noqa: S603 -- our own modules, no shell
        [sys.executable, '-m', f'wrist_ft_comp.ros.{module}', *arguments],
        env=_environment(),
        stdout=stdout,
        text=True,
    )
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(_END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


_TARE_S = 60.0
_WANTED_RATIO = 10.0
EXAMPLES = """\
examples:
  wrist_ft_comp demo
  wrist_ft_comp demo --seed 2 --output /tmp/demo
  wrist_ft_comp demo --json
"""


def add_parser(commands: options.Commands) -> None:
    """Add the command."""
    parser = commands.add_parser(
        'demo',
        help='watch the node learn and remove a simulated drift',
        description='Start a simulated sensor and the compensator as processes, record a\n'
        'warm-up, calibrate, let the robot cool down and warm up differently, and print\n'
        'what is left of the drift.\n'
        f'Exit code 0 when drift of force z fell at least {_WANTED_RATIO:.0f} times.',
        epilog=EXAMPLES,
    )
    parser.set_defaults(run=run)
    parser.add_argument(
        '--output',
        type=Path,
        default=Path('out'),
        metavar='FOLDER',
        help='for the picture, demo.png (default: %(default)s)',
    )
    parser.add_argument(
        '--seed',
        type=int,
        default=1,
        metavar='N',
        help='specimen of the simulated sensor (default: %(default)s)',
    )
    parser.add_argument(
        '--speed',
        type=options.number(0.01, 10_000.0),
        default=450.0,
        metavar='TIMES',
        help='how many times faster than real time (default: %(default)g)',
    )
    options.add_json(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    if find_spec('rclpy') is None:
        raise RecordingError(
            'The demonstration needs rclpy, which this Python does not have. Source a ROS 2 '
            'installation, or install the package with its extra "ros".'
        )
    try:
        arguments.output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(
            f'{arguments.output} cannot be made: {error.strerror}. Choose another --output.'
        ) from error
    with tempfile.TemporaryDirectory(prefix='wrist_ft_comp_demo_') as folder:
        log_file = Path(folder, 'log.npz')
        messages = sys.stderr if arguments.json else sys.stdout
        play(Path(folder), log_file, (arguments.seed, arguments.speed), messages)
        log = load_demo_log(log_file)
    results = judge_errors([errors(log)])
    picture = arguments.output / 'demo.png'
    write_picture(picture, png_bytes(_draw(log)))
    ratio = results['force_z'].rms_before / results['force_z'].rms_after
    if arguments.json:
        axes = {axis: asdict(each) for axis, each in results.items()}
        options.print_json({'axes': axes, 'wrenches': len(log.stamps_ns), 'picture': picture})
    else:
        print(_text(results, len(log.stamps_ns)))
        print(f'picture: {picture}')
        print(f'drift of force z fell {ratio:.1f} times; at least {_WANTED_RATIO:.0f} are wanted')
    return 0 if ratio >= _WANTED_RATIO else 1


def _text(results: dict[str, AxisEvaluation], wrenches: int) -> str:
    """Put the result into a table."""
    units = {axis: axis_unit(axis) for axis in results}
    return (
        f'\nafter the calibration, over {wrenches} wrenches received from the topics:\n'
        f'{evaluation_text(results, units)}'
    )


def errors(log: DemoLog) -> TaredErrors:
    """Compare with the reference what came after the calibration, tared on its first minute."""
    after = log.stamps_ns > log.calibrated_ns
    since = log.stamps_ns[after] - log.calibrated_ns
    tare = since <= _TARE_S * NANOSECONDS
    if not tare.any():
        raise RecordingError(
            f'No wrench was received in the {_TARE_S:g} s after the calibration, so the '
            'demonstration cannot be judged. Try a lower --speed.'
        )
    parts = (wrench[after] - log.reference[after] for wrench in (log.raw, log.compensated))
    return TaredErrors(*(part - part[tare].mean(axis=0) for part in parts))


def _draw(log: DemoLog) -> Figure:
    """Draw what came after the calibration."""
    raw, compensated = errors(log)
    after = log.stamps_ns > log.calibrated_ns
    elapsed_s = (log.stamps_ns[after] - log.calibrated_ns) / NANOSECONDS
    temperatures = []
    for number, topic in enumerate(TOPICS):
        rows = (log.thermometer == number) & (log.temperature_stamps_ns > log.calibrated_ns)
        times = (log.temperature_stamps_ns[rows] - log.calibrated_ns) / NANOSECONDS
        temperatures.append(TemperatureSeries(topic, times, log.temperature_c[rows]))
    return draw_drift(
        [
            DriftSeries(f'{axis}, {axis_unit(axis)}', elapsed_s, raw[:, i], compensated[:, i])
            for i, axis in enumerate(AXES)
        ],
        temperatures,
    )
