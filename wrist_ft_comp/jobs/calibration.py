"""
The calibration job: read recordings, fit, save the model.

The command line calls ``run_job``; the node starts this module as a process (``process``).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
import sys
from typing import Any

import numpy as np

from wrist_ft_comp.drift.drift_model import StoredModel
from wrist_ft_comp.errors import RecordingError, WristFtCompError
from wrist_ft_comp.fit.calibrate import calibrate, summarise
from wrist_ft_comp.fit.result import Calibration
from wrist_ft_comp.jobs.learning_job import answer_learning, keep_payloads
from wrist_ft_comp.jobs.process import serve
from wrist_ft_comp.jobs.request import CalibrationJob, Minute
from wrist_ft_comp.payload.learnt import payload_line
from wrist_ft_comp.payload.minute_of_motion import CHANNELS, identify
from wrist_ft_comp.payload.set_payload_commands import driver_lines
from wrist_ft_comp.payload.weight import ForceFrame
from wrist_ft_comp.recordings.read import hash_recording, read_recording
from wrist_ft_comp.report.outputs import REPORT
from wrist_ft_comp.report.page import page
from wrist_ft_comp.report.view import calibration_view, ReportView
from wrist_ft_comp.signals import CLOCK_NS, part_of, Progress, Recording
from wrist_ft_comp.stored.model_file import save_model
from wrist_ft_comp.stored.payload_file import add_payloads, IDENTIFIED

#: Two recordings are of one day where this many cells at the same time ...
_FEWEST_STEPS = 50
#: ... change by the same noise: where their changes correlate by more than this.
_SAME_CORRELATION = 0.5


@dataclass(frozen=True, eq=False)
class JobOutcome:
    """The result of a calibration job."""

    calibration: Calibration
    stored: StoredModel
    recordings: tuple[Recording, ...]
    #: Recordings that were left out, and why, in sentences.
    left_out: tuple[str, ...]

    def view(self, job: CalibrationJob) -> ReportView:
        """Make the content of its report."""
        reference = job.settings.reference
        return calibration_view(self.calibration, self.recordings, self.stored, reference)


def run_job(job: CalibrationJob, progress: Progress | None = None) -> JobOutcome:
    """Read, fit and save the model, or raise and change nothing; a report is written apart."""
    report = progress or (lambda _: None)
    recordings, used, left_out = _read(job, report)
    calibration = calibrate(recordings, job.settings, lambda done: report(0.5 + 0.5 * done))
    sources = [{'path': str(path), 'sha256': sha256} for sha256, path in used.items()]
    stored = save_model(job.output, calibration, {'recordings': sources})
    calibration = keep_payloads(job, calibration)
    return JobOutcome(calibration, stored, tuple(recordings), left_out)


def _read(
    job: CalibrationJob, report: Progress
) -> tuple[list[Recording], dict[str, Path], tuple[str, ...]]:
    """Read all recordings, half of the progress; also their paths by hash, and who is left out."""
    recordings: list[Recording] = []
    used: dict[str, Path] = {}
    left_out: list[str] = []
    for number, path in enumerate(job.recordings):
        part = part_of(report, number, 2 * len(job.recordings))
        try:
            recording, sha256 = _read_one(job, path, used, part)
            _refuse_twice(path, recording, dict(zip(used.values(), recordings, strict=True)))
        except RecordingError as error:
            last = number + 1 == len(job.recordings)
            if not job.skip_unusable or (last and not recordings):
                raise
            left_out.append(f'{path.name} was left out: {error}')
        else:
            recordings.append(recording)
            used[sha256] = path
    return recordings, used, tuple(left_out)


def _read_one(
    job: CalibrationJob, path: Path, used: Mapping[str, Path], report: Progress
) -> tuple[Recording, str]:
    """Read and hash a recording; refuse a copy, and one that cannot be used."""
    recording = read_recording(path, period_s=job.period_s, topics=job.topics, progress=report)
    sha256 = hash_recording(path)
    if sha256 in used:
        raise RecordingError(f'{path} is a copy of {used[sha256]}; name one of them only.')
    if not job.skip_unusable:
        return recording, sha256
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
    return recording, sha256


def _refuse_twice(path: Path, recording: Recording, others: Mapping[Path, Recording]) -> None:
    """Refuse what another recording holds, too: counted twice, a day seems twice as sure."""
    for other_path, other in others.items():
        begin = max(recording.first_cell, other.first_cell)
        if recording.period_ns != other.period_ns or begin * recording.period_ns < CLOCK_NS:
            continue
        wrenches = [run.wrench[begin - run.first_cell :] for run in (recording, other)]
        count, correlations = min(map(len, wrenches)), []
        for ours, theirs in zip(*(wrench[:count].T for wrench in wrenches), strict=True):
            both = np.isfinite(ours) & np.isfinite(theirs)
            one, two = np.diff(ours[both]), np.diff(theirs[both])
            if len(one) > _FEWEST_STEPS and one.any() and two.any():
                correlations.append(one @ two / np.sqrt((one @ one) * (two @ two)))
        if correlations and np.median(correlations) > _SAME_CORRELATION:
            raise RecordingError(
                f'{path} was recorded at the same time as {other_path}, and steps as it does: it '
                'is the same day in another form. Name one of them only.'
            )


def _answer(job: CalibrationJob) -> dict[str, Any]:
    """Run a job and put its outcome into plain values."""
    if job.learning is not None:
        return answer_learning(job, job.learning)
    if job.minute is not None:
        return _identify(job, job.minute)
    try:
        outcome = run_job(job)
    except WristFtCompError as error:
        return {'success': False, 'message': str(error)}
    notes = ''.join(f'\nwarning: {sentence}' for sentence in outcome.left_out)
    return {
        'success': True,
        'message': f'{summarise(outcome.calibration)}{notes}\nsaved as {outcome.stored.path}'
        f'{_report(job, outcome)}',
        'path': str(outcome.stored.path),
        'sha256': outcome.stored.sha256,
        'document': outcome.stored.document,
    }


def _identify(job: CalibrationJob, minute: Minute) -> dict[str, Any]:
    """Find the payload in a minute of motion, keep it, and put it into plain values."""
    cells = np.array(minute.cells, dtype=float).reshape(-1, CHANNELS)
    sensor = None
    if minute.sensor is not None:
        bias, scale = np.array(minute.sensor)
        sensor = ForceFrame(bias=bias, scale=scale)
    try:
        found = identify(cells, minute.period_s, sensor)
        frame = found.frame.learnt_by(job.topics.force_source, job.topics)
        (name,) = add_payloads(job.output, IDENTIFIED, [found.payload], frame, minute.taken)
    except WristFtCompError as error:
        return {'success': False, 'message': str(error)}
    message = (
        f"{payload_line(name, found.payload)} in the wrench's frame. Contact was taken for "
        f'{found.contact:.0%} of the time, {found.fast:.0%} was too fast.'
    )
    return {
        'success': True, 'message': message, 'name': name, 'rotation': frame.rotation.tolist(),
        'driver_lines': driver_lines(found.payload),
    }  # fmt: skip


def _report(job: CalibrationJob, outcome: JobOutcome) -> str:
    """Write the report and say where; a model is not given up because its report failed."""
    if job.report is None:
        return ''
    try:
        REPORT.write(job.report, page(outcome.view(job)))
    except WristFtCompError as error:
        return f'\nwarning: {error}'
    return f'\nreport: {job.report}'


if __name__ == '__main__':
    sys.exit(serve(_answer))
