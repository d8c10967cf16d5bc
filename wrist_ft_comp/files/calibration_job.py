"""
The calibration job: read recordings, fit, save the model. One function, and a process around it.

The command line calls ``run_job``. The node starts this module as a program instead
(``python -m wrist_ft_comp.files.calibration_job``), because a fit in its own process neither stops
the stream nor fights it for the interpreter: the job comes as one JSON object on standard input,
the outcome goes as one to standard output. With ``--until-closed`` the job is a line, and standard
input stays open for as long as somebody waits for the outcome: where it is closed, as it is when
the node is killed, the process ends.
"""

import hashlib
import json
import os
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from wrist_ft_comp import RecordingError, WristFtCompError
from wrist_ft_comp.core.calibration import Calibration, CalibrationSettings, calibrate
from wrist_ft_comp.core.identification import IdentificationSettings
from wrist_ft_comp.core.outer_inner import Orders
from wrist_ft_comp.core.recording import Recording
from wrist_ft_comp.core.summary import summarise
from wrist_ft_comp.files.model_file import StoredModel, save_model
from wrist_ft_comp.files.recordings import Topics, read_recording

#: Argument of the program: end when standard input is closed.
UNTIL_CLOSED = '--until-closed'
_HASH_CHUNK = 1 << 20


@dataclass(frozen=True)
class CalibrationJob:
    """
    What to calibrate from, how, and where the model goes.

    Attributes
    ----------
    recordings : tuple of Path
        Bags, CSV files or chamber tables.
    output : Path
        Model file to make or replace.
    settings : CalibrationSettings
        What a person chose.
    period_s : float
        Thermal period h, s.
    topics : Topics
        Topic names in bags.
    skip_unusable : bool
        Leave out, with a warning, recordings that cannot be read, have other thermometers than
        topics names, or lack the reference; as long as one is left.
    keep_copied_columns : bool
        Fit columns of a chamber table that repeat another one, too.

    """

    recordings: tuple[Path, ...]
    output: Path
    settings: CalibrationSettings = field(default_factory=CalibrationSettings)
    period_s: float = 1.0
    topics: Topics = field(default_factory=Topics)
    skip_unusable: bool = False
    keep_copied_columns: bool = False


def run_job(
    job: CalibrationJob, progress: Callable[[float], None] | None = None
) -> tuple[Calibration, StoredModel, tuple[str, ...]]:
    """
    Read, fit, save.

    Parameters
    ----------
    job : CalibrationJob
        The job.
    progress : callable, optional
        Told the share that is done, 0 to 1.

    Returns
    -------
    tuple of Calibration, StoredModel and tuple of str
        What was found, what was saved, and which recordings were left out.

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
    return calibration, save_model(job.output, calibration, provenance), left_out


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


def encode_job(job: CalibrationJob) -> str:
    """Write a job as JSON."""
    return json.dumps(asdict(job), default=str)


def decode_job(text: str) -> CalibrationJob:
    """Read a job that encode_job wrote."""
    job = _with_tuples(json.loads(text))
    settings = job['settings']
    identification = settings['identification']
    identification['orders'] = Orders(**identification['orders'])
    settings['identification'] = IdentificationSettings(**identification)
    return CalibrationJob(
        **{
            **job,
            'recordings': tuple(Path(path) for path in job['recordings']),
            'output': Path(job['output']),
            'settings': CalibrationSettings(**settings),
            'topics': Topics(**job['topics']),
        }
    )


def _with_tuples(value: Any) -> Any:
    """Turn the lists of a JSON value back into the tuples they were."""
    if isinstance(value, dict):
        return {key: _with_tuples(each) for key, each in value.items()}
    return tuple(_with_tuples(each) for each in value) if isinstance(value, list) else value


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
    json.dump(_outcome(text), sys.stdout)
    return 0


def _end_when_closed() -> None:
    """End the process when nobody waits for it any more."""
    # Not by sys.stdin: its lock would still be held when the interpreter ends.
    while os.read(sys.stdin.fileno(), 1024):
        pass
    os._exit(1)


def _outcome(text: str) -> dict[str, Any]:
    """Run the job that a text describes."""
    try:
        calibration, stored, left_out = run_job(decode_job(text))
    except WristFtCompError as error:
        return {'success': False, 'message': str(error)}
    notes = ''.join(f'\nwarning: {sentence}' for sentence in left_out)
    return {
        'success': True,
        'message': f'{summarise(calibration)}{notes}\nsaved as {stored.path}',
        'path': str(stored.path),
        'sha256': stored.sha256,
        'document': stored.document,
    }


if __name__ == '__main__':
    sys.exit(main())
