"""wrist_ft_comp demo: a node learns a simulated drift on one day, and is judged on another."""

import argparse
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
import os
from pathlib import Path
import subprocess
import sys
from tempfile import mkdtemp, NamedTemporaryFile
from typing import Any, TYPE_CHECKING

from wrist_ft_comp.cli import options
from wrist_ft_comp.cli.evaluate import evaluate_recordings
from wrist_ft_comp.cli.terminal import content_words, filled, print_words, progress_bar
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.report.advice import as_yaml
from wrist_ft_comp.report.html_page import page, REPORT
from wrist_ft_comp.series import Progress
from wrist_ft_comp.stored.node_folder import NodeFolder

if TYPE_CHECKING:
    from wrist_ft_comp.cli.service_calls import Watch

_Process = subprocess.Popen[bytes]
#: A program that was asked to end is killed after this time, s.
_END_TIMEOUT_S = 10.0
#: How many times faster than real time the simulated robot works.
_SPEED = 360.0
#: A day is given up that takes this many times as long as it should.
_PATIENCE = 10.0
#: The drift of force_z has to become smaller by this factor.
_RATIO = 10.0
#: The days of the simulated robot: the duty cycle of the motor from each time on, s, and how long
#: the day is, s. The sensor warms up, rests, works and cools; on day 2 it works otherwise.
_DAYS = (
    ({0.0: 0.0, 300.0: 0.9, 3600.0: 0.0, 5700.0: 0.5, 8100.0: 1.0, 9600.0: 0.0}, 11400),
    ({0.0: 0.0, 600.0: 0.7, 2400.0: 0.2, 3000.0: 1.0, 4200.0: 0.0, 4800.0: 0.6}, 5400),
)
HELP = 'watch the node learn and remove a simulated drift'
DESCRIPTION = """\
Start a simulated sensor and the compensator as processes, record a warm-up,
calibrate, record another day, and judge the model on it: a report says what is
left of the drift. Exit code 0 when drift of force_z fell at least 10 times."""
_PLOT = (
    f'A simulated sensor drifts on two days, {_SPEED:g} times as fast as a real one. The node '
    'records day 1, learns the drift, and removes it on day 2. It takes a minute.'
)
_NEXT = """\
The node's model, its recordings and its log: {folder}
The report of day 2, for a browser: {report}
Next, your own recording; this prints the commands that learn from it:
  wrist_ft_comp show RECORDING"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        '--output', type=Path, default=Path('out'), metavar='FOLDER',
        help="for the report, demo.html, and a folder of the node's (default: %(default)s)",
    )  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    options.require_ros(RecordingError, 'The demonstration needs rclpy')
    arguments.output.mkdir(parents=True, exist_ok=True)
    report = arguments.output / 'demo.html'
    REPORT.check_target(report)
    folder = Path(mkdtemp(prefix='demo_', dir=arguments.output))
    print_words([filled(_PLOT), ''])
    play(folder)
    store = NodeFolder(folder)
    model, day_2 = store.history()[-1].path, store.recordings()[-1]
    if model is None:
        raise RecordingError(f'The node did not keep its model; see its log in {folder}.')
    with progress_bar('judging day 2') as progress:
        content, _ = evaluate_recordings(model, [day_2], wanted='recorded', progress=progress)
    REPORT.write(report, page(content))
    (force_z,) = (axis.errors for axis in content.axes if axis.axis == 'force_z')
    ratio = force_z.rms_before / force_z.rms_after
    reached = ratio >= _RATIO
    sentence = (
        f'{"PASS" if reached else "FAIL"}: the model made the drift of force_z {ratio:.1f} times '
        f'smaller; {_RATIO:.0f} times was asked.'
    )
    print_words([
        'Day 2, which the model has not seen:', '', *content_words(content, advice=0), '',
        filled(sentence), '', *_NEXT.format(report=report, folder=folder).splitlines(),
    ])  # fmt: skip
    return 0 if reached else 1


def play(folder: Path) -> None:
    """Let the node record, calibrate and record again."""
    os.environ.update(own_domain())
    from wrist_ft_comp.cli.service_calls import operating, Watch  # noqa: PLC0415 -- ROS

    node: dict[str, object] = {
        'data_directory': as_yaml(folder), 'temperature_topics': '[temperature, temperature_2]',
        'calibration.reference': 'recorded',
    }  # fmt: skip
    with (
        NamedTemporaryFile('wb', dir=folder, prefix='log_', suffix='.txt', delete=False) as log,
        operating() as operator,
    ):
        for number, (duty, length_s) in enumerate(_DAYS):
            parameters: dict[str, object] = {
                'run': number, 'speed': _SPEED, 'start_stamp_s': 86_400.0 * (number + 1),
                'wrench_rate': 400.0,
                'temperature_rate': _SPEED,  # one for every thermal cell of 1 s
                'duty_cycle.start_s': [*duty], 'duty_cycle.level': [*duty.values()],
            }  # fmt: skip
            # The node is started anew on the second day, and takes the model by itself.
            with process('compensator_node', node, log) as compensator:
                watch = Watch(operator, operator.find())
                watch.ask('record')
                with process('simulated_sensor', parameters, log) as sensor:
                    programs = {'compensator': compensator, 'sensor': sensor}
                    with progress_bar(f'recording day {number + 1} of 2') as progress:
                        listen(watch, length_s, programs, progress)
                print_words([filled(watch.ask('stop'))])
                if not number:
                    watch.ask('calibrate')


def listen(watch: 'Watch', day_s: float, nodes: dict[str, _Process], progress: Progress) -> None:
    """Wait until the node has recorded a day, as long as both programs are alive."""

    def ended() -> list[str]:
        return [name for name, node in nodes.items() if node.poll() is not None]

    def is_over() -> bool:
        status = watch.statuses.get('calibration')
        recorded_s = float(status.values.get('recording_s', 0.0)) if status else 0.0
        progress(min(recorded_s / day_s, 1.0))
        return recorded_s >= day_s

    patience_s = _PATIENCE * day_s / _SPEED
    watch.operator.wait_for(lambda: is_over() or ended(), patience_s)
    if not is_over():
        why = f'node did not record a day within {patience_s:.0f} s'
        if ended():
            why = f'{" and the ".join(ended())} of the demonstration ended early'
        raise RecordingError(f'The {why}; see its log.')


def own_domain() -> dict[str, str]:
    """Stay on this computer and out of the user's domain: a robot may listen to a wrench there."""
    taken = os.environ.get('ROS_DOMAIN_ID', '0')
    # Linux uses no ports of these for others, and people choose from the other end.
    free = [domain for domain in range(60, 101) if str(domain) != taken]
    domain = str(free[os.getpid() % len(free)])
    return {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', 'ROS_DOMAIN_ID': domain}


@contextmanager
def process(module: str, parameters: Mapping[str, object], log: Any) -> Iterator[_Process]:
    """Run one of the package's nodes; end it by its own id."""
    pairs = (['-p', f'{name}:={value}'] for name, value in parameters.items())
    command = [sys.executable, '-m', f'wrist_ft_comp.node.{module}', '--ros-args']
    command += [word for pair in pairs for word in pair]
    with subprocess.Popen(command, stdout=log, stderr=log) as process:  # noqa: S603 -- no shell
        try:
            yield process
        finally:
            process.terminate()
            try:
                process.wait(_END_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                process.kill()
