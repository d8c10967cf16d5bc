"""wrist_ft_comp evaluate: what a model leaves of the drift in other recordings."""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from wrist_ft_comp.cli import options
from wrist_ft_comp.cli.terminal import content_words, print_result, progress_bar
from wrist_ft_comp.drift.drift_model import check_sensor
from wrist_ft_comp.fit.folds import averaged_s
from wrist_ft_comp.recording import Reference, Topics
from wrist_ft_comp.recordings.read import hash_recording, read_recording
from wrist_ft_comp.report import evaluation, report_content
from wrist_ft_comp.report.html_page import page, REPORT
from wrist_ft_comp.series import NANOSECONDS, part_of, Progress
from wrist_ft_comp.stored.model_file import load_model

HELP = 'judge a model on recordings'
DESCRIPTION = 'Compare raw and compensated wrenches with the reference, both tared first.'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument('model', type=Path, metavar='MODEL.yaml')
    options.add_recordings(
        parser, 'what the model was learnt with, if the recording holds it, or unloaded'
    )
    parser.add_argument(
        '--tare', type=float, default=60.0, metavar='SECONDS', help='tare on the first SECONDS, '
        'above 0; at least on the first thermal cell (default: 60)')  # fmt: skip
    options.add_topics(parser)
    options.add_part_and_report(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    topics = options.topics_from(arguments, arguments.recordings)
    if arguments.report:
        REPORT.check_target(arguments.report, [arguments.model, *arguments.recordings])
    with progress_bar('evaluating') as progress:
        content, document = evaluate_recordings(
            arguments.model, arguments.recordings, topics,
            arguments.reference, arguments.tare, progress)  # fmt: skip
    words = content_words(content)
    if arguments.report:  # before what a closed pipe may end
        REPORT.write(arguments.report, page(content))
        words += ['', f'report: {arguments.report}']
    print_result(words, document, content.warnings, as_json=arguments.json)
    return 0


def evaluate_recordings(  # noqa: PLR0913, PLR0917 -- as many as the command's options
    model: Path, paths: Sequence[Path], topics: Topics | None = None,
    wanted: Reference | None = None, tare_s: float = 60.0, progress: Progress = lambda _: None,
) -> tuple[report_content.ReportContent, dict[str, object]]:  # fmt: skip
    """Judge a model, by default with its own reference; give a report's content, and JSON."""
    stored, judged = load_model(model), list[report_content.EvaluatedRecording]()
    period_s, topics = stored.model.period_ns / NANOSECONDS, topics or stored.topics
    for number, path in enumerate(paths):
        recording = read_recording(
            path, period_s=period_s, topics=topics,
            progress=part_of(progress, number, len(paths)))  # fmt: skip
        reference = wanted or evaluation.reference_of(recording, stored.reference)
        warnings = check_sensor(stored, recording.sensor, f'in {path.name}')
        if hash_recording(path) in {sha256 for _, sha256 in report_content.model_sources(stored)}:
            warnings += (f'The model was learnt from {path.name}: judge it on another day.',)
        warnings += recording.warnings
        errors = evaluation.tared_errors(stored.model, recording, reference, tare_s)
        warnings += errors.warnings
        # Of a recording that fits the model.
        warnings += tuple(evaluation.range_warnings(stored, recording))
        recording = replace(recording, warnings=warnings)
        judged.append(report_content.EvaluatedRecording(recording, reference, errors))
    content = report_content.evaluation_content(stored, judged, tare_s, paths, topics)
    verdicts = {axis.axis: axis.verdict for axis in content.axes}
    return content, {
        'model': str(stored.path), 'sha256': stored.sha256, 'tare_s': tare_s,
        'averaged_s': averaged_s(stored.model),
        'axes': {axis.axis: axis.errors for axis in content.axes},
        'day_limits': dict(stored.model.day_limits),
        'recordings': [
            {'name': one.recording.name, 'path': str(path), 'reference': one.reference,
             'duration_s': one.recording.duration_s,
             'axes': evaluation.judge_errors([one.errors]), 'warnings': one.recording.warnings}
            for path, one in zip(paths, judged, strict=True)
        ],
        'verdicts': {a: {'level': v.level, 'why': v.sentence} for a, v in verdicts.items()},
        'advice': content.advice, 'warnings': content.warnings,
    }  # fmt: skip
