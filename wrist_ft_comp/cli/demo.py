"""wrist_ft_comp demo: a simulated sensor, the real node, and a table of what it removed."""

import argparse
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path
import sys
import tempfile

from matplotlib.figure import Figure
import numpy as np

from wrist_ft_comp import RecordingError
from wrist_ft_comp.cli import options, values
from wrist_ft_comp.cli.demo_processes import play, TOPICS
from wrist_ft_comp.cli.evaluate import evaluation_text
from wrist_ft_comp.core.evaluation import AxisEvaluation
from wrist_ft_comp.core.recording import AXES, axis_unit, FloatArray, NANOSECONDS
from wrist_ft_comp.files.demo_log import DemoLog, load_demo_log
from wrist_ft_comp.files.pictures import draw_drift, DriftSeries, save_png, TemperatureSeries

_TARE_S = 60.0
_WANTED_RATIO = 10.0
EXAMPLES = """\
examples:
  wrist_ft_comp demo
  wrist_ft_comp demo --seed 2 --output /tmp/demo
  wrist_ft_comp demo --json
"""


def add_parser(commands: 'argparse._SubParsersAction[argparse.ArgumentParser]') -> None:
    """Add the command."""
    parser = commands.add_parser(
        'demo',
        help='watch the node learn and remove a simulated drift',
        description='Start a simulated sensor and the compensator as processes, record a\n'
        'warm-up, calibrate, let the robot cool down and warm up differently, and print\n'
        'what is left of the drift.\n'
        f'Exit code 0 when drift of force z fell at least {_WANTED_RATIO:.0f} times.',
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
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
        type=values.positive,
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
    results = judge(log)
    picture = arguments.output / 'demo.png'
    save_png(picture, _draw(log))
    ratio = results['force_z'].rms_before / results['force_z'].rms_after
    if arguments.json:
        axes = {axis: asdict(found) for axis, found in results.items()}
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


def errors(log: DemoLog) -> tuple[FloatArray, FloatArray]:
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

    Raises
    ------
    RecordingError
        When nothing was received in that minute.

    """
    after = log.stamps_ns > log.calibrated_ns
    since = log.stamps_ns[after] - log.calibrated_ns
    tare = since <= _TARE_S * NANOSECONDS
    if not tare.any():
        raise RecordingError(
            f'No wrench was received in the {_TARE_S:g} s after the calibration, so the '
            'demonstration cannot be judged. Try a lower --speed.'
        )
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
