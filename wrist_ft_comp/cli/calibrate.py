"""wrist_ft_comp calibrate: recordings to a model."""

import argparse
from pathlib import Path
from typing import get_args

from wrist_ft_comp.cli import options
from wrist_ft_comp.cli.show import payloads_json
from wrist_ft_comp.cli.terminal import content_words, print_result, progress_bar
from wrist_ft_comp.drift.features import FeatureKind
from wrist_ft_comp.errors import check_range
from wrist_ft_comp.fit import settings
from wrist_ft_comp.jobs.calibration_job import run_job
from wrist_ft_comp.jobs.job_process import CalibrationJob
from wrist_ft_comp.recording import PERIODS_S
from wrist_ft_comp.report.html_page import page, REPORT
from wrist_ft_comp.stored.model_file import KIND as MODEL
from wrist_ft_comp.stored.payload_file import load_payloads, PAYLOADS

HELP = 'learn the drift from recordings'
DESCRIPTION = """\
Learn the drift of every recorded axis and write a model file.
An existing model file is replaced; any other existing file is not."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument('-o', '--output', required=True, type=Path, metavar='MODEL.yaml')
    options.add_recordings(parser, 'unloaded')
    parser.add_argument(
        '--method', choices=settings.METHODS, metavar='METHOD',
        help=f'{", ".join(settings.METHODS)} (default: %(default)s)', default='auto')  # fmt: skip
    parser.add_argument(
        '--features', choices=get_args(FeatureKind),
        help='powers of temperature, or hat functions at the plateaus of a chamber test (default: '
        '%(default)s)', default='powers')  # fmt: skip
    parser.add_argument(
        '--thermal-period', type=float, metavar='SECONDS',
        help='length of a thermal cell (default: 1; of slow logs more, where they last days, with '
        'a payload, or with another method than auto)')  # fmt: skip
    options.add_topics(parser)
    options.add_part_and_report(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    topics = options.topics_from(arguments, arguments.recordings)
    if arguments.thermal_period is not None:
        check_range('--thermal-period', arguments.thermal_period, *PERIODS_S)
    # Nothing that a person made may be overwritten, and it is said before the work.
    others = list(arguments.recordings)
    if arguments.reference == 'payload':
        others.append(arguments.output.parent / PAYLOADS)
        load_payloads(others[-1])
    MODEL.check_target(arguments.output, others)
    if arguments.report:
        REPORT.check_target(arguments.report, [arguments.output, *others])
    identification = settings.IdentificationSettings(arguments.method, features=arguments.features)
    job = CalibrationJob(
        tuple(arguments.recordings), arguments.output,
        settings.CalibrationSettings(
            arguments.reference or 'unloaded', identification=identification),
        arguments.thermal_period or 0.0,
        topics, report=arguments.report)  # fmt: skip
    with progress_bar('calibrating') as progress:
        calibration, content = run_job(job, progress)
    words = [*content_words(content), '', f'saved as {content.stored.path}']
    if job.report:
        REPORT.write(job.report, page(content))
        words.append(f'report: {job.report}')
    names = 'chosen rms_before rms_after day_limit largest_drift time_constants_s candidates notes'
    axes = {
        axis.axis: {
            'verdict': axis.verdict.level, 'why': axis.verdict.sentence,
            **{name: getattr(calibration.fits[axis.axis], name) for name in names.split()},
        }
        for axis in content.axes
    }  # fmt: skip
    document = {
        'model': str(content.stored.path), 'sha256': content.stored.sha256, 'axes': axes,
        'temperature_range_c': calibration.temperature_range_c,
        'duration_s': calibration.duration_s,
        'payloads': payloads_json(calibration.payloads.payloads if calibration.payloads else {}),
        'advice': content.advice, 'warnings': calibration.warnings,
    }  # fmt: skip
    print_result(words, document, content.warnings, as_json=arguments.json)
    return 0
