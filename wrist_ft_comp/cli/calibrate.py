"""wrist_ft_comp calibrate: recordings to a model."""

import argparse
import json
from dataclasses import asdict
from pathlib import Path
from typing import get_args

from wrist_ft_comp.cli import options
from wrist_ft_comp.cli.tables import chamber_table_text
from wrist_ft_comp.core.calibration import Calibration, CalibrationSettings
from wrist_ft_comp.core.chamber_fit import (
    chamber_figures,
    compensate_table,
    leave_one_temperature_out,
)
from wrist_ft_comp.core.features import FeatureKind
from wrist_ft_comp.core.identification import METHODS, IdentificationSettings
from wrist_ft_comp.core.summary import summarise
from wrist_ft_comp.files.calibration_job import CalibrationJob, run_job
from wrist_ft_comp.files.chamber_table import is_chamber_table, read_chamber_table
from wrist_ft_comp.files.model_file import StoredModel
from wrist_ft_comp.files.recordings import read_recording
from wrist_ft_comp.files.report import write_report

EXAMPLES = """\
examples:
  wrist_ft_comp calibrate warm_up.mcap -o model.yaml
  wrist_ft_comp calibrate monday/ tuesday/ -o model.yaml --report report.html
  wrist_ft_comp calibrate data/keller_pa10/table2_sensor_b_raw.csv -o keller_b.yaml
"""


def add_parser(commands: 'argparse._SubParsersAction[argparse.ArgumentParser]') -> None:
    """Add the command."""
    parser = commands.add_parser(
        'calibrate',
        help='learn the drift from recordings',
        description='Learn the drift of every recorded axis and write a model file.',
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(run=run)
    parser.add_argument(
        'recordings', nargs='+', type=Path, metavar='REC', help=options.RECORDING_HELP
    )
    parser.add_argument('-o', '--output', required=True, type=Path, metavar='MODEL.yaml')
    options.add_reference(parser)
    parser.add_argument(
        '--method', choices=METHODS, help='(default: pls for chamber tables, else auto)'
    )
    _add_structure(parser)
    options.add_topics(parser)
    options.add_output_forms(parser)


def _add_structure(parser: argparse.ArgumentParser) -> None:
    """Add what a person may choose about the model and the data."""
    defaults = CalibrationSettings()
    parser.add_argument(
        '--features',
        choices=get_args(FeatureKind),
        help='powers of temperature, or hat functions at given temperatures '
        '(default: hats for chamber tables, else powers)',
    )
    parser.add_argument('--degree', type=int, default=defaults.identification.degree)
    parser.add_argument(
        '--hat-temperatures',
        type=options.temperatures,
        default=(),
        metavar='T1,T2,…',
        help='°C (default: the plateaus that were recorded)',
    )
    parser.add_argument('--latents', type=int, help='(default: chosen on held-out blocks)')
    parser.add_argument('--thermal-period', type=options.positive, default=1.0, metavar='SECONDS')
    parser.add_argument(
        '--min-temperature-span',
        type=options.not_negative,
        default=defaults.min_temperature_span_k,
        metavar='KELVIN',
    )
    parser.add_argument(
        '--keep-copied-columns',
        action='store_true',
        help='fit columns of a chamber table that repeat another one, too',
    )


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    job = _job(arguments)
    with options.progress_bar('calibrating') as progress:
        calibration, stored, _ = run_job(job, progress)
    if arguments.report:
        recordings = [
            read_recording(path, period_s=job.period_s, topics=job.topics)
            for path in job.recordings
        ]
        write_report(arguments.report, stored, recordings, job.settings.reference)
    if arguments.json:
        print(json.dumps(_as_json(calibration, stored), indent=1))
    else:
        print(summarise(calibration))
        print(f'saved as {stored.path}')
        _print_chamber_figures(job, stored)
    return 0


def _job(arguments: argparse.Namespace) -> CalibrationJob:
    """Build the job; chamber tables have their own defaults."""
    tables = all(path.is_file() and is_chamber_table(path) for path in arguments.recordings)
    settings = CalibrationSettings(
        reference=arguments.reference or ('recorded' if tables else 'unloaded'),
        min_temperature_span_k=arguments.min_temperature_span,
        identification=IdentificationSettings(
            method=arguments.method or ('pls' if tables else 'auto'),
            features=arguments.features or ('hats' if tables else 'powers'),
            degree=arguments.degree,
            hat_temperatures_c=arguments.hat_temperatures,
            latents=arguments.latents,
        ),
    )
    return CalibrationJob(
        recordings=tuple(arguments.recordings),
        output=arguments.output,
        settings=settings,
        period_s=arguments.thermal_period,
        topics=options.topics_from(arguments),
        keep_copied_columns=arguments.keep_copied_columns,
    )


def _as_json(calibration: Calibration, stored: StoredModel) -> dict[str, object]:
    """Everything a script may want."""
    return {
        'model': str(stored.path),
        'sha256': stored.sha256,
        'axes': {
            axis: {
                'chosen': fit.chosen,
                'rms_before': fit.rms_before,
                'rms_after': fit.rms_after,
                'time_constants_s': list(fit.time_constants_s),
                'candidates': [asdict(candidate) for candidate in fit.candidates],
                'notes': list(fit.notes),
            }
            for axis, fit in calibration.fits.items()
        },
        'temperature_range_c': calibration.temperature_range_c.tolist(),
        'duration_s': calibration.duration_s,
        'warnings': list(calibration.warnings),
    }


def _print_chamber_figures(job: CalibrationJob, stored: StoredModel) -> None:
    """Show a chamber table's figures: raw, fitted, and every temperature left out in turn."""
    for path in job.recordings:
        if not is_chamber_table(path):
            continue
        table = read_chamber_table(path, keep_copied_columns=job.keep_copied_columns)
        columns = {
            'raw': chamber_figures(table),
            'fitted': chamber_figures(compensate_table(table, stored.model)),
        }
        left_out = leave_one_temperature_out(table, job.settings, job.period_s)
        if left_out is not None:
            columns['left out'] = chamber_figures(left_out)
        print(f'\n{path.name}\n{chamber_table_text(columns)}')
