"""
The calibration job: read recordings, fit, save the model. One function, and a process around it.

The command line calls ``run_job``. The node starts this module as a program instead
(``python -m wrist_ft_comp.cli.calibration_job``), because a fit in its own process neither stops
the stream nor fights it for the interpreter: the job comes as one JSON object on standard input,
the outcome goes as one to standard output. With ``--until-closed`` the job is a line, and standard
input stays open for as long as somebody waits for the outcome: where it is closed, as it is when
the node is killed, the process ends.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
import hashlib
import json
import os
from pathlib import Path
import signal
import sys
import threading
from typing import Any

import numpy as np

from wrist_ft_comp.calibration.calibrate import calibrate, summarise
from wrist_ft_comp.calibration.chamber import (
    chamber_figures,
    ChamberFigures,
    compensate_table,
    leave_one_temperature_out,
)
from wrist_ft_comp.errors import RecordingError, WristFtCompError
from wrist_ft_comp.files.chamber_table import is_chamber_table, read_chamber_table
from wrist_ft_comp.files.job_request import (
    CalibrationJob,
    decode_job,
    JobOutcome,
    UNTIL_CLOSED,
)
from wrist_ft_comp.files.model_file import save_model
from wrist_ft_comp.files.recordings import read_recording
from wrist_ft_comp.model.drift_model import StoredModel
from wrist_ft_comp.model.signals import Recording
from wrist_ft_comp.report.of_calibration import calibration_view
from wrist_ft_comp.report.page import write_report

ChamberColumns = dict[str, ChamberFigures]


def report_job(
    job: CalibrationJob, outcome: JobOutcome, tables: Mapping[str, ChamberColumns] | None = None
) -> None:
    """
    Write the report of a job, if it asks for one.

    Parameters
    ----------
    job : CalibrationJob
        The job.
    outcome : JobOutcome
        From run_job.
    tables : mapping, optional
        From judge_chamber_tables; judged here by default.

    Raises
    ------
    RecordingError
        When it cannot be written; the model is saved already.

    """
    if job.report is None:
        return
    tables = judge_chamber_tables(job, outcome.stored) if tables is None else tables
    view = calibration_view(
        outcome.calibration, outcome.recordings, outcome.stored, job.settings.reference, tables
    )
    write_report(job.report, view)


def judge_chamber_tables(job: CalibrationJob, stored: StoredModel) -> dict[str, ChamberColumns]:
    """
    Judge chamber tables: raw, fitted, and every temperature left out in turn.

    Parameters
    ----------
    job : CalibrationJob
        What was fitted.
    stored : StoredModel
        The model.

    Returns
    -------
    dict of str to dict of str to ChamberFigures
        By path, then by title; empty when no recording is a chamber table.

    """
    tables: dict[str, ChamberColumns] = {}
    for path in job.recordings:
        if not is_chamber_table(path):
            continue
        table = read_chamber_table(path, keep_copied_columns=job.keep_copied_columns)
        columns = {
            'raw': chamber_figures(table),
            'fitted': chamber_figures(compensate_table(table, stored.model)),
        }
        left_out = leave_one_temperature_out(
            table, lambda recording: calibrate([recording], job.settings).model, job.period_s
        )
        if left_out is not None:
            columns['left out'] = chamber_figures(left_out)
        tables[str(path)] = columns
    return tables


_HASH_CHUNK = 1 << 20


def run_job(job: CalibrationJob, progress: Callable[[float], None] | None = None) -> JobOutcome:
    """
    Read, fit, save the model; the report is left to report_job.

    Parameters
    ----------
    job : CalibrationJob
        The job.
    progress : callable, optional
        Told the share that is done, 0 to 1.

    Returns
    -------
    JobOutcome
        What was found, and what was saved.

    Raises
    ------
    WristFtCompError
        When a recording is unusable, the calibration is refused, or the model cannot be saved;
        nothing is changed then.

    """
    report = progress or (lambda _: None)
    recordings, used, left_out = _read(job, report)
    calibration = calibrate(recordings, job.settings, lambda done: report(0.5 + 0.5 * done))
    provenance = {
        'recordings': [{'path': str(path), 'sha256': hash_recording(path)} for path in used],
        'settings': json.loads(json.dumps(asdict(job.settings))),
    }
    stored = save_model(job.output, calibration, provenance)
    return JobOutcome(calibration, stored, tuple(recordings), left_out)


def _read(
    job: CalibrationJob, report: Callable[[float], None]
) -> tuple[list[Recording], list[Path], tuple[str, ...]]:
    """Read all recordings; half of the progress is reading."""
    recordings: list[Recording] = []
    used: list[Path] = []
    left_out: list[str] = []
    failure: RecordingError | None = None
    for number, path in enumerate(job.recordings):
        try:
            recordings.append(_read_one(job, path, partial(_report_part, report, job, number)))
        except RecordingError as error:  # noqa: PERF203 -- one must not end the others
            if not job.skip_unusable:
                raise
            failure = error
            left_out.append(f'{path.name} was left out: {error}')
        else:
            used.append(path)
    if failure is not None and not recordings:
        raise failure
    return recordings, used, tuple(left_out)


def _report_part(
    report: Callable[[float], None], job: CalibrationJob, number: int, done: float
) -> None:
    """Report the share that is done when a share of one recording is."""
    report(0.5 * (number + done) / len(job.recordings))


def _read_one(job: CalibrationJob, path: Path, report: Callable[[float], None]) -> Recording:
    """Read a recording; where others may do, refuse one that this calibration cannot use."""
    recording = read_recording(
        path,
        period_s=job.period_s,
        topics=job.topics,
        keep_copied_columns=job.keep_copied_columns,
        progress=report,
    )
    if not job.skip_unusable:
        return recording
    thermometers = len(job.topics.temperatures)
    if recording.thermometers != thermometers:
        raise RecordingError(
            f'{path.name} has {recording.thermometers} thermometers; {thermometers} are expected. '
            'Record again with these, or name the recordings to calibrate from.'
        )
    if job.settings.reference == 'recorded' and not np.isfinite(recording.reference).any():
        raise RecordingError(
            f'{path.name} holds no reference wrench. Record wrench_reference beside the raw '
            'wrench, or declare the reference unloaded or constant.'
        )
    return recording


def hash_recording(path: Path) -> str:
    """
    Hash a recording's bytes, a folder's files in order of their names.

    Parameters
    ----------
    path : Path
        File or folder.

    Returns
    -------
    str
        SHA-256, hexadecimal.

    """
    digest = hashlib.sha256()
    for file in sorted(path.iterdir()) if path.is_dir() else [path]:
        if file.is_file():
            with file.open('rb') as content:
                while chunk := content.read(_HASH_CHUNK):
                    digest.update(chunk)
    return digest.hexdigest()


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Run one job from standard input, at low priority, and write its outcome.

    Parameters
    ----------
    arguments : sequence of str, optional
        Command line without the program; sys.argv's by default.

    Returns
    -------
    int
        Exit code 0; a refusal is an outcome.

    """
    os.nice(10)
    if UNTIL_CLOSED in (sys.argv[1:] if arguments is None else arguments):
        text = sys.stdin.readline()
        threading.Thread(target=_end_when_closed, daemon=True).start()
    else:
        text = sys.stdin.read()
    json.dump(_answer(decode_job(text)), sys.stdout)
    return 0


def _end_when_closed() -> None:
    """End the process when nobody waits for it any more."""
    # Not by sys.stdin: its lock would still be held when the interpreter ends.
    while os.read(sys.stdin.fileno(), 1024):
        pass
    os.kill(os.getpid(), signal.SIGTERM)


def _answer(job: CalibrationJob) -> dict[str, Any]:
    """Run a job and put its outcome into plain values."""
    try:
        found = run_job(job)
    except WristFtCompError as error:
        return {'success': False, 'message': str(error)}
    notes = ''.join(f'\nwarning: {sentence}' for sentence in found.left_out)
    return {
        'success': True,
        'message': f'{summarise(found.calibration)}{notes}\nsaved as {found.stored.path}'
        f'{_report(job, found)}',
        'path': str(found.stored.path),
        'sha256': found.stored.sha256,
        'document': found.stored.document,
    }


def _report(job: CalibrationJob, found: JobOutcome) -> str:
    """Write the report and say where; a model is not given up because its report failed."""
    try:
        report_job(job, found)
    except WristFtCompError as error:
        return f'\nwarning: {error}'
    return f'\nreport: {job.report}' if job.report else ''


if __name__ == '__main__':
    sys.exit(main())
