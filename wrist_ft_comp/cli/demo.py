"""wrist_ft_comp demo: a simulated sensor, the real node, and a table of what it removed."""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from tqdm import tqdm

from wrist_ft_comp import RecordingError
from wrist_ft_comp.cli import options
from wrist_ft_comp.cli.evaluate import evaluation_text
from wrist_ft_comp.core.evaluation import AxisEvaluation
from wrist_ft_comp.core.recording import AXES, NANOSECONDS, axis_unit
from wrist_ft_comp.files.demo_log import DemoLog, load_demo_log
from wrist_ft_comp.files.pictures import DriftSeries, TemperatureSeries, draw_drift, save_png

TOPICS = ('temperature', 'temperature_2')
#: The sensor warms up, rests, works, and cools while recording; then it lives another day.
_RECORD_DUTY = ((0, 0.0), (300, 0.9), (3600, 0.0), (5700, 0.5), (8100, 1.0), (9600, 0.0))
_RECORD_S = 11400
_TEST_DUTY = ((0, 0.0), (2400, 0.7), (4800, 0.2), (6600, 1.0), (8400, 0.0), (9300, 0.6))
_TEST_S = 10800
_TARE_S = 60.0
_WANTED_RATIO = 10.0
_END_TIMEOUT_S = 10.0


def add_parser(commands: 'argparse._SubParsersAction[argparse.ArgumentParser]') -> None:
    """Add the command."""
    parser = commands.add_parser(
        'demo',
        help='watch the node learn and remove a simulated drift',
        description='Start a simulated sensor and the compensator as processes, record a warm-up, '
        'calibrate, let the robot cool down and warm up differently, and print what is left of '
        'the drift. Exit code 0 when drift of force z fell at least tenfold.',
    )
    parser.set_defaults(run=run)
    parser.add_argument('--output', type=Path, default=Path('out'), metavar='FOLDER')
    parser.add_argument('--seed', type=int, default=1, help='specimen of the simulated sensor')
    parser.add_argument('--speed', type=options.positive, default=450.0, help='times real time')


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
        _play(arguments, Path(folder), log_file)
        log = load_demo_log(log_file)
    results = judge(log)
    print(f'\nafter the calibration, over {len(log.stamps_ns)} wrenches received from the topics:')
    print(evaluation_text(results))
    picture = arguments.output / 'demo.png'
    save_png(picture, _draw(log))
    force_z = results['force_z']
    ratio = force_z.rms_before / force_z.rms_after
    print(f'picture: {picture}')
    print(f'drift of force z fell {ratio:.1f} times; at least {_WANTED_RATIO:.0f} are wanted')
    return 0 if ratio >= _WANTED_RATIO else 1


def _play(arguments: argparse.Namespace, folder: Path, log_file: Path) -> None:
    """Run the three processes until the operator is done."""
    environment = {
        **os.environ,
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'ROS_DOMAIN_ID': os.environ.get('ROS_DOMAIN_ID', '94'),
    }
    with ExitStack() as stack:
        stack.enter_context(
            _process(
                'compensator_node',
                *_ros_arguments(
                    data_directory=folder / 'data',
                    temperature_topics=_array(TOPICS),
                    **{'calibration.reference': 'recorded'},
                ),
                environment=environment,
            )
        )
        operator = stack.enter_context(
            _process(
                'demo_client',
                str(log_file),
                str(_RECORD_S),
                str(_TEST_S),
                *TOPICS,
                environment=environment,
                stdout=subprocess.PIPE,
            )
        )
        bar = stack.enter_context(tqdm(total=1.0, disable=None, leave=False))
        for event in _events(operator):
            if event['event'] == 'recording':
                stack.enter_context(
                    _process('simulated_sensor_node', *_sensor(arguments), environment=environment)
                )
            elif event['event'] == 'progress':
                bar.set_description(str(event['what']))
                bar.update(float(str(event['share'])) - bar.n)
            elif event['event'] == 'failed':
                raise RecordingError(f'The demonstration failed: {event["text"]}')
            elif event['event'] == 'message':
                bar.clear()
                print(event['text'], flush=True)
    if not log_file.exists():
        raise RecordingError('The demonstration ended without a result; see the messages above.')


def _events(operator: 'subprocess.Popen[str]') -> Iterator[dict[str, object]]:
    """Read what the operator tells, a JSON object a line."""
    if operator.stdout is not None:
        for line in operator.stdout:
            yield json.loads(line)


def _sensor(arguments: argparse.Namespace) -> list[str]:
    """Set the simulated sensor up for both days."""
    duty = [*_RECORD_DUTY, *((_RECORD_S + start, level) for start, level in _TEST_DUTY)]
    return _ros_arguments(
        seed=arguments.seed,
        speed=arguments.speed,
        wrench_rate=500.0,
        temperature_rate=arguments.speed,
        **{
            'duty_cycle.start_s': _array([float(start) for start, _ in duty]),
            'duty_cycle.level': _array([float(level) for _, level in duty]),
        },
    )


def _ros_arguments(**parameters: object) -> list[str]:
    """Write parameters as a ROS command line."""
    pairs = (['-p', f'{name}:={value}'] for name, value in parameters.items())
    return ['--ros-args', *(word for pair in pairs for word in pair)]


def _array(values: Sequence[object]) -> str:
    """Write an array as ROS parameters are written."""
    return f'[{", ".join(str(value) for value in values)}]'


@contextmanager
def _process(
    module: str, *arguments: str, environment: dict[str, str], stdout: int | None = None
) -> Iterator['subprocess.Popen[str]']:
    """Run one of the package's programs; end it by its own id."""
    process = subprocess.Popen(  # noqa: S603 -- our own modules, no shell
        [sys.executable, '-m', f'wrist_ft_comp.ros.{module}', *arguments],
        env=environment,
        stdout=stdout,
        text=True,
    )
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(_END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        if process.stdout is not None:
            process.stdout.close()


def errors(log: DemoLog) -> tuple[np.ndarray, np.ndarray]:
    """
    Compare with the reference everything after the calibration, tared on its first minute.

    Parameters
    ----------
    log : DemoLog
        What was received.

    Returns
    -------
    tuple of ndarrays, shape (n, 6)
        Raw and compensated minus reference.

    """
    after = log.stamps_ns > log.calibrated_ns
    since = log.stamps_ns[after] - log.calibrated_ns
    tare = since <= _TARE_S * NANOSECONDS
    raw, compensated = (
        wrench[after] - log.reference[after] for wrench in (log.raw, log.compensated)
    )
    return raw - raw[tare].mean(axis=0), compensated - compensated[tare].mean(axis=0)


def judge(log: DemoLog) -> dict[str, AxisEvaluation]:
    """
    Compute drift without and with compensation, per axis.

    Parameters
    ----------
    log : DemoLog
        What was received.

    Returns
    -------
    dict of str to AxisEvaluation
        Over all wrenches after the calibration.

    """
    raw, compensated = errors(log)
    return {
        axis: AxisEvaluation(
            float(np.sqrt(np.mean(raw[:, i] ** 2))),
            float(np.sqrt(np.mean(compensated[:, i] ** 2))),
            float(np.max(np.abs(raw[:, i]))),
            float(np.max(np.abs(compensated[:, i]))),
        )
        for i, axis in enumerate(AXES)
    }


def _draw(log: DemoLog) -> 'object':
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
