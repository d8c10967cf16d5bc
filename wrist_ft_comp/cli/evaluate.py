"""wrist_ft_comp evaluate: what a model leaves of the drift in other recordings."""

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from wrist_ft_comp.cli import options
from wrist_ft_comp.cli.tables import chamber_table_text, table_text
from wrist_ft_comp.core.chamber_fit import ChamberFigures, chamber_figures, compensate_table
from wrist_ft_comp.core.evaluation import AxisEvaluation, evaluate
from wrist_ft_comp.core.problem import Reference
from wrist_ft_comp.core.recording import AXES, NANOSECONDS, Recording, axis_unit
from wrist_ft_comp.files.chamber_table import is_chamber_table, read_chamber_table
from wrist_ft_comp.files.model_file import load_model
from wrist_ft_comp.files.recordings import read_recording
from wrist_ft_comp.files.report import write_report

EXAMPLES = """\
examples:
  wrist_ft_comp evaluate model.yaml wednesday.mcap
  wrist_ft_comp evaluate model.yaml loaded.csv --reference recorded --json
"""


def add_parser(commands: 'argparse._SubParsersAction[argparse.ArgumentParser]') -> None:
    """Add the command."""
    parser = commands.add_parser(
        'evaluate',
        help='judge a model on recordings',
        description='Compare raw and compensated wrenches with the reference, both tared first.',
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(run=run)
    parser.add_argument('model', type=Path, metavar='MODEL.yaml')
    parser.add_argument(
        'recordings', nargs='+', type=Path, metavar='REC', help=options.RECORDING_HELP
    )
    options.add_reference(parser)
    parser.add_argument(
        '--tare',
        type=options.not_negative,
        default=60.0,
        metavar='SECONDS',
        help='tare on the first SECONDS (default: 60)',
    )
    options.add_topics(parser)
    options.add_output_forms(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    stored = load_model(arguments.model)
    period_s = stored.model.period_ns / NANOSECONDS
    recordings: list[Recording] = []
    results: list[dict[str, AxisEvaluation]] = []
    tables: dict[str, dict[str, ChamberFigures]] = {}
    reference: Reference = 'unloaded'
    with options.progress_bar('evaluating') as progress:
        for number, path in enumerate(arguments.recordings):
            recording = read_recording(
                path, period_s=period_s, topics=options.topics_from(arguments)
            )
            is_table = path.is_file() and is_chamber_table(path)
            reference = arguments.reference or ('recorded' if is_table else 'unloaded')
            results.append(evaluate(stored.model, recording, reference, arguments.tare))
            recordings.append(recording)
            if is_table:
                table = read_chamber_table(path)
                compensated = compensate_table(table, stored.model)
                tables[path.name] = {
                    'raw': chamber_figures(table),
                    'compensated': chamber_figures(compensated),
                }
            progress((number + 1) / len(arguments.recordings))
    pooled = pool(results, [len(recording) for recording in recordings])
    if arguments.report:
        write_report(arguments.report, stored, recordings, reference)
    if arguments.json:
        print(json.dumps(_as_json(pooled, recordings, results, tables), indent=1))
    else:
        print(evaluation_text(pooled))
        for name, columns in tables.items():
            print(f'\n{name}\n{chamber_table_text(columns)}')
    return 0


def pool(
    results: Sequence[dict[str, AxisEvaluation]], cells: Sequence[int]
) -> dict[str, AxisEvaluation]:
    """
    Pool the evaluations of several recordings: mean squares by length, largest of the largest.

    Parameters
    ----------
    results : sequence of dict of str to AxisEvaluation
        One per recording.
    cells : sequence of int
        Length of each.

    Returns
    -------
    dict of str to AxisEvaluation
        By axis, those that any recording has.

    """
    pooled = {}
    for axis in AXES:
        found = [(result[axis], n) for result, n in zip(results, cells, strict=True) if axis in result]
        if found:
            weights = [n for _, n in found]
            before, after = (
                float(np.sqrt(np.average([getattr(e, name) ** 2 for e, _ in found], weights=weights)))
                for name in ('rms_before', 'rms_after')
            )
            pooled[axis] = AxisEvaluation(
                before,
                after,
                max(e.max_before for e, _ in found),
                max(e.max_after for e, _ in found),
            )
    return pooled


def evaluation_text(axes: dict[str, AxisEvaluation]) -> str:
    """Put an evaluation into a table."""
    return table_text(
        ['axis', 'unit', 'RMS before', 'after', 'peak before', 'after', 'RMS ratio'],
        [
            [
                axis,
                axis_unit(axis),
                f'{e.rms_before:.4g}',
                f'{e.rms_after:.4g}',
                f'{e.max_before:.4g}',
                f'{e.max_after:.4g}',
                f'{e.rms_before / e.rms_after:.1f}' if e.rms_after > 0 else '-',
            ]
            for axis, e in axes.items()
        ],
    )


def _as_json(
    pooled: dict[str, AxisEvaluation],
    recordings: Sequence[Recording],
    results: Sequence[dict[str, AxisEvaluation]],
    tables: dict[str, dict[str, ChamberFigures]],
) -> dict[str, object]:
    """Everything a script may want."""
    return {
        'axes': {axis: asdict(e) for axis, e in pooled.items()},
        'recordings': [
            {
                'name': recording.name,
                'duration_s': recording.duration_s,
                'axes': {axis: asdict(e) for axis, e in result.items()},
                'warnings': list(recording.warnings),
            }
            for recording, result in zip(recordings, results, strict=True)
        ],
        'chamber_tables': {
            name: {title: asdict(figures) for title, figures in columns.items()}
            for name, columns in tables.items()
        },
    }
