"""The demonstration's three processes: the compensator, the simulated sensor, and the operator."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, ExitStack
import json
import os
from pathlib import Path
import queue
import signal
import subprocess
import sys
import threading
from typing import NoReturn, TextIO

from tqdm import tqdm

from wrist_ft_comp import RecordingError

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
    Run the three processes until the operator is done.

    Parameters
    ----------
    folder : Path
        For the compensator's recordings and models.
    log_file : Path
        Where the operator puts what it received.
    sensor : (int, float)
        Specimen of the simulated sensor, and how many times faster than real time it runs.
    messages : TextIO
        Where what the operator says is printed.

    Raises
    ------
    RecordingError
        When a process ends early, or the operator fails; all have ended then.

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
    duty = [*_RECORD_DUTY, *((_RECORD_S + start, level) for start, level in _TEST_DUTY)]
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
        process.send_signal(signal.SIGINT)
        try:
            process.wait(_END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
