"""wrist_ft_comp compensate: a recording with its drift removed."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
import gc
from pathlib import Path

from wrist_ft_comp.calibration.chamber import table_tare
from wrist_ft_comp.cli import options, paths
from wrist_ft_comp.cli.tables import print_warnings, range_warnings
from wrist_ft_comp.files.chamber_table import is_chamber_table, read_chamber_table
from wrist_ft_comp.files.model_file import load_model
from wrist_ft_comp.files.recordings import read_recording, rewrite_recording
from wrist_ft_comp.model.drift_model import DriftModel
from wrist_ft_comp.model.offline import correct_many, initial_tare, track_drift
from wrist_ft_comp.model.signals import AXES, FloatArray, NANOSECONDS, Recording

EXAMPLES = """\
examples:
  wrist_ft_comp compensate model.yaml run.csv -o compensated.csv
  wrist_ft_comp compensate model.yaml bag/ -o bag_compensated/ --tare 60
"""


def add_parser(commands: options.Commands) -> None:
    """Add the command."""
    parser = commands.add_parser(
        'compensate',
        help='remove the drift from a recording',
        description='Write a recording of the same kind with compensated wrenches.\n'
        'In CSV files they replace the raw ones; in bags they come beside them, on a\n'
        'topic of their own. An existing file or folder is never overwritten.',
        epilog=EXAMPLES,
    )
    parser.set_defaults(run=run)
    parser.add_argument('model', type=Path, metavar='MODEL.yaml')
    parser.add_argument('recording', type=Path, metavar='REC', help=options.RECORDING_HELP)
    parser.add_argument('-o', '--output', required=True, type=Path, metavar='OUT')
    parser.add_argument(
        '--tare',
        type=options.number(0.0),
        default=0.0,
        metavar='SECONDS',
        help='tare on the first SECONDS, which must be unloaded (default: 0, no tare; a chamber '
        'table is tared without load at its reference temperature)',
    )
    options.add_json(parser)
    group = options.add_topics(parser)
    group.add_argument(
        '--output-topic',
        default='/wrench',
        metavar='TOPIC',
        help='of compensated wrenches (default: %(default)s)',
    )


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    paths.check_model(arguments.model)
    paths.check_recordings([arguments.recording])
    stored = load_model(arguments.model)
    model = stored.model
    topics = options.topics_from(arguments)
    with options.progress_bar('compensating') as progress, _without_garbage_collector():
        recording = read_recording(
            arguments.recording,
            period_s=model.period_ns / NANOSECONDS,
            topics=topics,
            progress=lambda done: progress(done / 3),
        )
        track = track_drift(model, recording)
        tare = _tare(arguments, model, recording)
        warnings = rewrite_recording(
            arguments.recording,
            arguments.output,
            lambda stamps_ns, raw: correct_many(track, stamps_ns, raw, tare),
            topics=topics,
            output_topic=arguments.output_topic,
            progress=lambda done: progress((1 + 2 * done) / 3),
        )
    warnings = (*recording.warnings, *warnings, *range_warnings(stored, recording))
    if arguments.json:
        answer = {'output': arguments.output, 'tare': dict(zip(AXES, tare.tolist(), strict=True))}
        options.print_json({**answer, 'warnings': warnings})
        return 0
    print_warnings(warnings)
    print(f'wrote {arguments.output}')
    return 0


@contextmanager
def _without_garbage_collector() -> Iterator[None]:
    """Keep it off: messages make no cycles, and looking for some takes half of the time."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def _tare(arguments: argparse.Namespace, model: DriftModel, recording: Recording) -> FloatArray:
    """Find the raw offset to subtract, shape (6,)."""
    if arguments.recording.is_file() and is_chamber_table(arguments.recording):
        return table_tare(read_chamber_table(arguments.recording), model)
    return initial_tare(model, recording, arguments.tare)
