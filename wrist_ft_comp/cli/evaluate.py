"""wrist_ft_comp evaluate: what a model leaves of the drift in other recordings."""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
import textwrap

import numpy as np

from wrist_ft_comp.cli import options, tables
from wrist_ft_comp.cli.progress import progress_bar
from wrist_ft_comp.drift.drift_model import check_sensor, StoredModel
from wrist_ft_comp.fit.folds import averaged_s
from wrist_ft_comp.payload.learn_at_work import follows_gravity, learn_at_work
from wrist_ft_comp.payload.weight import same_payload
from wrist_ft_comp.ranges import rounded
from wrist_ft_comp.recording import Reference, Topics
from wrist_ft_comp.recordings.read import hash_recording, read_recording
from wrist_ft_comp.report.evaluation import (
    AxisEvaluation,
    judge_errors,
    tared_errors,
    without_steps,
)
from wrist_ft_comp.report.page import page, REPORT
from wrist_ft_comp.report.report_content import (
    EvaluatedRecording,
    evaluation_content,
    model_sources,
    ReportContent,
)
from wrist_ft_comp.series import NANOSECONDS, part_of, Progress
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


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What a model leaves of the drift in recordings: the command's result."""

    stored: StoredModel
    paths: Sequence[Path]
    judged: Sequence[EvaluatedRecording]
    tare_s: float
    #: What its report shows.
    content: ReportContent

    @property
    def errors(self) -> dict[str, AxisEvaluation]:
        """Figures by axis, of all recordings together."""
        return {axis.axis: axis.errors for axis in self.content.axes}

    def result(self, report: Path | None) -> tables.Result:
        """Put it into words and numbers, with the report that was written."""
        table = tables.table_text(
            ['axis', 'unit', 'RMS before', 'after', 'peak before', 'after', 'RMS ratio'],
            [
                [axis.axis, axis.unit, *(rounded(figure, 4) for figure in vars(left).values()),
                 f'{left.rms_before / left.rms_after:.1f}' if left.rms_after > 0 else '-']
                for axis, left in zip(self.content.axes, self.errors.values(), strict=True)
            ],
        )  # fmt: skip
        references = dict.fromkeys(judged.reference for judged in self.judged)
        basis = (
            f'Reference: {", ".join(references)}. Errors are means over '
            f'{averaged_s(self.stored.model):g} s, as those of calibrate.'
        )
        lines = [
            table,
            '',
            *tables.verdict_lines(self.content),
            '',
            textwrap.fill(basis, tables.WIDTH),
            *tables.advice_lines(self.content),
            *(['', f'report: {report}'] if report else ()),
        ]
        document = {
            'model': str(self.stored.path),
            'sha256': self.stored.sha256,
            'tare_s': self.tare_s,
            'averaged_s': averaged_s(self.stored.model),
            'axes': self.errors,
            'day_limits': dict(self.stored.model.day_limits),
            'recordings': [
                {
                    'name': judged.recording.name,
                    'path': str(path),
                    'reference': judged.reference,
                    'duration_s': judged.recording.duration_s,
                    'axes': judge_errors([judged.errors]),
                    'warnings': judged.recording.warnings,
                }
                for path, judged in zip(self.paths, self.judged, strict=True)
            ],
            'verdicts': {
                axis.axis: {'level': axis.verdict.level, 'why': axis.verdict.sentence}
                for axis in self.content.axes
            },
            'advice': self.content.advice,
            'warnings': self.content.warnings,
        }
        return tables.Result('\n'.join(lines), document, self.content.warnings)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    options.check_model(arguments.model)
    topics = options.topics_from(arguments)
    options.check_recordings(arguments.recordings, topics)
    if arguments.report:
        REPORT.check_target(arguments.report, [arguments.model, *arguments.recordings])
    options.warn_of_idle(arguments, arguments.recordings)
    with progress_bar('evaluating') as progress:
        evaluation = evaluate_recordings(
            arguments.model, arguments.recordings, topics,
            arguments.reference, arguments.tare, progress)  # fmt: skip
    if arguments.report:  # before what a closed pipe may end
        REPORT.write(arguments.report, page(evaluation.content))
    tables.print_result(evaluation.result(arguments.report), as_json=arguments.json)
    return 0


def evaluate_recordings(  # noqa: PLR0913, PLR0917 -- as many as the command's options
    model: Path,
    paths: Sequence[Path],
    topics: Topics | None = None,
    reference: Reference | None = None,
    tare_s: float = 60.0,
    progress: Progress = lambda _: None,
) -> Evaluation:
    """Judge a model file on recordings; the reference is that of the model by default."""
    stored, count = load_model(model), len(paths)
    judged = [
        _judge(stored, path, topics or Topics(), reference, tare_s, part_of(progress, i, count))
        for i, path in enumerate(paths)
    ]
    return Evaluation(stored, paths, judged, tare_s, evaluation_content(stored, judged, tare_s))


def _judge(  # noqa: PLR0913, PLR0917 -- of one recording
    stored: StoredModel,
    path: Path,
    topics: Topics,
    wanted: Reference | None,
    tare_s: float,
    progress: Progress,
) -> EvaluatedRecording:
    """Read a recording and compare it, raw and compensated, with its reference."""
    period_s = stored.model.period_ns / NANOSECONDS
    recording = read_recording(path, period_s=period_s, topics=topics, progress=progress)
    reference: Reference = wanted or 'unloaded'
    # What the model was learnt with, where the recording holds it, too.
    if wanted is None and stored.reference == 'payload' and recording.specific_force is not None:
        reference = 'payload'
    if (
        wanted is None
        and stored.reference == 'recorded'
        and np.isfinite(recording.reference).any()
    ):
        reference = 'recorded'
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
        known = load_payloads(stored.path.with_name(PAYLOADS)).values()
        unknown = tuple(
            f'{recording.name} holds a payload of {payload.mass_kg:.2f} kg that is not in '
            f'{PAYLOADS} beside the model; its weight was fitted to this recording.'
            for payload in (work.payloads.payloads.values() if work.payloads else ())
            if not any(same_payload(payload, other) for other, _ in known)
        )
        warnings += (*work.warnings, *unknown)
    warnings += tuple(without_steps(compared, true)[1])
    errors = tared_errors(stored.model, compared, true, tare_s)
    warnings += tables.range_warnings(stored, recording)  # of a recording that fits the model
    return EvaluatedRecording(replace(recording, warnings=warnings), reference, errors)
