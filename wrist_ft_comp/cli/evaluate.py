"""wrist_ft_comp evaluate: what a model leaves of the drift in other recordings."""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
import textwrap

import numpy as np

from wrist_ft_comp.cli import options, tables
from wrist_ft_comp.drift.drift_model import check_sensor, StoredModel
from wrist_ft_comp.fit.folds import averaged_s
from wrist_ft_comp.payload.at_work import learn_at_work
from wrist_ft_comp.payload.doubts import follows_gravity
from wrist_ft_comp.payload.learnt import LearntPayloads, same_payload
from wrist_ft_comp.ranges import rounded
from wrist_ft_comp.recordings.read import hash_recording, read_recording
from wrist_ft_comp.report.evaluation import (
    AxisEvaluation,
    judge_errors,
    tared_errors,
    without_steps,
)
from wrist_ft_comp.report.outputs import REPORT
from wrist_ft_comp.report.page import page
from wrist_ft_comp.report.view import EvaluatedRecording, evaluation_view, model_sources
from wrist_ft_comp.signals import axis_unit, NANOSECONDS, part_of, Progress, Recording, Reference
from wrist_ft_comp.stored.model_file import load_model
from wrist_ft_comp.stored.payload_file import load_payloads, PAYLOADS

HELP = 'judge a model on recordings'
DESCRIPTION = 'Compare raw and compensated wrenches with the reference, both tared first.'
EXAMPLES = """\
examples:
  wrist_ft_comp evaluate model.yaml wednesday.mcap
  wrist_ft_comp evaluate model.yaml workday.csv --reference payload
  wrist_ft_comp evaluate model.yaml loaded.csv --reference recorded --json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument('model', type=Path, metavar='MODEL.yaml')
    options.add_recordings(parser)
    options.add_reference(
        parser, 'what the model was learnt with, if the recording holds it, or unloaded'
    )
    parser.add_argument(
        '--tare', type=options.number(0.0, above=True), default=60.0, metavar='SECONDS',
        help='tare on the first SECONDS, above 0; at least on the first thermal cell (default: '
        '60)')  # fmt: skip
    options.add_topics(parser)
    options.add_part(parser)
    options.add_output_forms(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    options.check_model(arguments.model)
    options.check_recordings(arguments.recordings)
    if arguments.report:
        REPORT.check_target(arguments.report, [arguments.model, *arguments.recordings])
    options.warn_of_idle(arguments, arguments.recordings)
    stored = load_model(arguments.model)
    count = len(arguments.recordings)
    with options.progress_bar('evaluating') as progress:
        judged = [
            _judge(arguments, stored, path, part_of(progress, number, count))
            for number, path in enumerate(arguments.recordings)
        ]
    view = evaluation_view(stored, judged, arguments.tare)
    errors = {axis.axis: axis.errors for axis in view.axes}
    verdicts = {axis.axis: axis.verdict for axis in view.axes}
    if arguments.report:  # before what a closed pipe may end
        REPORT.write(arguments.report, page(view))
    if not arguments.json:
        units = {axis.axis: axis.unit for axis in view.axes}
        print(f'{evaluation_text(errors, units)}\n\n{tables.verdict_text(verdicts)}')
        print(f'\n{_limit_text(stored, judged)}')
    tables.print_warnings(view.warnings)
    if arguments.report and not arguments.json:
        print(f'report: {arguments.report}')
    if arguments.json:
        by_path = dict(zip(map(str, arguments.recordings), judged, strict=True))
        options.print_json(
            {
                'model': str(stored.path),
                'sha256': stored.sha256,
                'tare_s': arguments.tare,
                'averaged_s': averaged_s(stored.model),
                'axes': errors,
                'day_limits': dict(stored.model.day_limits),
                'recordings': [_as_json(path, evaluated) for path, evaluated in by_path.items()],
                'verdicts': {
                    axis: {'level': verdict.level, 'why': verdict.sentence}
                    for axis, verdict in verdicts.items()
                },
                'warnings': view.warnings,
            }
        )
    return 0


def _judge(
    arguments: argparse.Namespace, stored: StoredModel, path: Path, progress: Progress
) -> EvaluatedRecording:
    """Read a recording and compare it, raw and compensated, with its reference."""
    period_s, topics = stored.model.period_ns / NANOSECONDS, options.topics_from(arguments)
    recording = read_recording(path, period_s=period_s, topics=topics, progress=progress)
    reference: Reference = arguments.reference or _learnt_reference(stored, recording)
    warnings = check_sensor(stored, recording.sensor, f'in {path.name}')
    if hash_recording(path) in {sha256 for _, sha256 in model_sources(stored)}:
        warnings += (f'The model was learnt from {path.name}: judge it on another day.',)
    warnings += recording.warnings
    if reference in {'unloaded', 'constant'}:
        warnings += tuple(follows_gravity([recording], reference))
    compared, true = recording, reference
    if reference == 'payload':
        work = learn_at_work([recording])
        compared, true = work.drift[0], 'recorded'
        warnings += (*work.warnings, *_unknown_payloads(stored, recording.name, work.payloads))
    warnings += tuple(without_steps(compared, true)[1])
    errors = tared_errors(stored.model, compared, true, arguments.tare)
    warnings += tables.range_warnings(stored, recording)  # of a recording that fits the model
    return EvaluatedRecording(replace(recording, warnings=warnings), reference, errors)


def _learnt_reference(stored: StoredModel, recording: Recording) -> Reference:
    """Take the reference that a model was learnt with, where the recording holds it too."""
    if stored.reference == 'payload' and recording.specific_force is not None:
        return 'payload'
    if stored.reference == 'recorded' and np.isfinite(recording.reference).any():
        return 'recorded'
    return 'unloaded'


def _unknown_payloads(
    stored: StoredModel, name: str, found: LearntPayloads | None
) -> Iterator[str]:
    """Mark payloads that no calibration in the model's folder has seen."""
    kept = [payload for payload, _ in load_payloads(stored.path.with_name(PAYLOADS)).values()]
    for payload in found.payloads.values() if found else ():
        if not any(same_payload(payload, other) for other in kept):
            yield (
                f'{name} holds a payload of {payload.mass_kg:.2f} kg that is not in {PAYLOADS} '
                'beside the model; its weight was fitted to this recording.'
            )


def evaluation_text(axes: Mapping[str, AxisEvaluation], units: Mapping[str, str]) -> str:
    """Put an evaluation into a table."""
    return tables.table_text(
        ['axis', 'unit', 'RMS before', 'after', 'peak before', 'after', 'RMS ratio'],
        [
            [axis, units[axis], *(rounded(figure, 4) for figure in vars(left).values()),
             f'{left.rms_before / left.rms_after:.1f}' if left.rms_after > 0 else '-']
            for axis, left in axes.items()
        ],
    )  # fmt: skip


def _limit_text(stored: StoredModel, judged: Sequence[EvaluatedRecording]) -> str:
    """Say what errors are, and which limits the calibration stated of the peaks."""
    references = ', '.join(dict.fromkeys(evaluated.reference for evaluated in judged))
    limits = ', '.join(
        f'{axis} {limit:.2g} {axis_unit(axis)}' for axis, limit in stored.model.day_limits.items()
    )
    text = f'Errors are means over {averaged_s(stored.model):g} s, as those of calibrate.'
    text = f'Reference: {references}. {text}'
    if limits:
        text += f' Limits of the peaks after, by its calibration (95 of 100 days): {limits}.'
    return textwrap.fill(text, tables.WIDTH)


def _as_json(path: str, evaluated: EvaluatedRecording) -> dict[str, object]:
    """Everything a script may want of one recording."""
    return {
        'name': evaluated.recording.name,
        'path': path,
        'reference': evaluated.reference,
        'duration_s': evaluated.recording.duration_s,
        'axes': judge_errors([evaluated.errors]),
        'warnings': evaluated.recording.warnings,
    }
