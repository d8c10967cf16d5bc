"""wrist_ft_comp compensate: a recording with its drift removed."""

import argparse
from contextlib import ExitStack
import gc
from pathlib import Path

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.cli import options
from wrist_ft_comp.cli.terminal import print_result, progress_bar
from wrist_ft_comp.drift.drift_model import check_sensor
from wrist_ft_comp.errors import check_range
from wrist_ft_comp.recordings.compensated_copy import check_copy, rewrite_recording
from wrist_ft_comp.recordings.read import read_recording
from wrist_ft_comp.report.evaluation import range_warnings
from wrist_ft_comp.series import NANOSECONDS
from wrist_ft_comp.stored.model_file import load_model
from wrist_ft_comp.stream.drift_of_recordings import correct_many, track_drift
from wrist_ft_comp.stream.tare import initial_tare

_UNTARED = (
    'Nothing was tared: drift is removed, but every axis keeps a constant offset, perhaps of many '
    'newtons. Give --tare SECONDS where the recording begins unloaded, or subtract what is left '
    'of an unloaded part.'
)
HELP = 'remove the drift from a recording'
DESCRIPTION = """\
Write a recording with compensated wrenches. In bags they come beside the raw
ones, on the topic /wrench_without_drift. Of a table they replace them, in a CSV
file with this package's columns and units, which is marked as compensated and
not compensated again. An existing file or folder is never overwritten. Without
a tare every axis keeps a constant offset."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument('model', type=Path, metavar='MODEL.yaml')
    parser.add_argument('recording', type=Path, metavar='REC', help=options.RECORDING_HELP)
    parser.add_argument('-o', '--output', required=True, type=Path, metavar='OUT')
    parser.add_argument(
        '--tare', type=float, default=0.0, metavar='SECONDS', help='tare on the first SECONDS, '
        'which must be unloaded (default: 0, no tare)')  # fmt: skip
    options.add_json(parser)
    options.add_topics(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    source, target = arguments.recording, arguments.output
    topics = options.topics_from(arguments, [source])
    check_range('--tare', arguments.tare, 0.0)
    check_copy(source, topics, target, [arguments.model])
    stored = load_model(arguments.model)
    model, warnings = stored.model, [] if arguments.tare else [_UNTARED]
    with progress_bar('compensating') as progress, ExitStack() as stack:
        gc.disable()  # messages make no cycles, and looking for some takes half of the time
        stack.callback(gc.enable)
        recording = read_recording(
            source, period_s=model.period_ns / NANOSECONDS, topics=topics,
            progress=lambda done: progress(done / 3))  # fmt: skip
        warnings += check_sensor(stored, recording.sensor, f'in {recording.name}')
        warnings += recording.warnings
        track = track_drift(model, recording)
        tare = initial_tare(model, recording, arguments.tare)
        warnings += rewrite_recording(
            source, target, lambda stamps_ns, raw: correct_many(track, stamps_ns, raw, tare),
            topics=topics, progress=lambda done: progress((1 + 2 * done) / 3))  # fmt: skip
    warnings += range_warnings(stored, recording)
    taken_off = dict(zip(AXES, tare.tolist(), strict=True))
    document = {'output': target, 'tare': taken_off, 'warnings': warnings}
    print_result([f'wrote {target}'], document, warnings, as_json=arguments.json)
    return 0
