"""The calibration job: read recordings, fit, save the model and its payloads."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from wrist_ft_comp.drift.drift_model import StoredModel
from wrist_ft_comp.errors import CalibrationRefusedError, RecordingError, WristFtCompError
from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.data_checks import check_recordings
from wrist_ft_comp.fit.outliers_and_steps import false_starts
from wrist_ft_comp.fit.result import Calibration
from wrist_ft_comp.jobs.job_process import CalibrationJob
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.recordings.read import hash_recording, period_of, read_recording
from wrist_ft_comp.report.html_page import page, REPORT
from wrist_ft_comp.report.report_content import calibration_content, ReportContent
from wrist_ft_comp.series import part_of, Progress
from wrist_ft_comp.stored.model_file import save_model
from wrist_ft_comp.stored.payload_file import add_payloads, PAYLOADS


def run_job(
    job: CalibrationJob, progress: Progress = lambda _: None
) -> tuple[Calibration, ReportContent]:
    """Read, fit and save the model, or raise and change nothing; give what its report holds."""
    recordings: list[Recording] = []
    paths: dict[str, Path] = {}
    left_out: list[str] = []
    if not job.period_s:
        # A payload is found where most cells hold a reading, and other methods are slow.
        asked = job.settings
        filled = asked.reference == 'payload' or asked.identification.method != 'auto'
        job = replace(job, period_s=period_of(job.recordings, job.topics, filled=filled))
    for number, path in enumerate(job.recordings):
        part = part_of(progress, number, 2 * len(job.recordings))
        try:
            recording, sha256 = _read(job, path, paths, part)
        except (CalibrationRefusedError, RecordingError) as error:
            none_is_left = number + 1 == len(job.recordings) and not recordings
            if not job.skip_unusable or none_is_left:
                raise
            left_out.append(f'{path.name} was left out: {error}')
        else:
            recordings.append(recording)
            paths[sha256] = path
    starts = false_starts(recordings)
    left_out += starts.values()
    for place in reversed(starts):
        del recordings[place], paths[list(paths)[place]]
    found = calibrate(recordings, job.settings, lambda done: progress(0.5 + 0.5 * done))
    found = replace(found, warnings=(*left_out, *found.warnings))
    calibration, stored = save(job, found, paths)
    options = job.topics.options(job.settings.reference)
    return calibration, calibration_content(calibration, recordings, stored, options)


def calibrate_for_node(job: CalibrationJob) -> dict[str, Any]:
    """Run a job, and write its report; give the outcome in plain values."""
    _, content = run_job(job)
    stored = content.stored
    lines = [*content.lines(), f'saved as {stored.path}']
    if job.report is not None:
        try:  # a model is not given up because its report cannot be written
            REPORT.write(job.report, page(content))
            lines.append(f'report: {job.report}')
        except WristFtCompError as error:
            lines.append(f'warning: {error}')
    return {
        'success': True, 'message': '\n'.join(lines), 'path': str(stored.path),
        'sha256': stored.sha256, 'document': stored.document}  # fmt: skip


def _read(
    job: CalibrationJob, path: Path, earlier: Mapping[str, Path], progress: Progress
) -> tuple[Recording, str]:
    """Read and hash a recording; refuse a copy of an earlier one, and one that is unusable."""
    recording = read_recording(path, period_s=job.period_s, topics=job.topics, progress=progress)
    sha256 = hash_recording(path)
    if sha256 in earlier:
        raise RecordingError(f'{path} is a copy of {earlier[sha256]}; name one of them only.')
    if not job.skip_unusable:
        return recording, sha256
    thermometers = len(job.topics.temperatures)
    if recording.thermometers != thermometers:
        raise RecordingError(
            f'{path.name} has {recording.thermometers} thermometers; {thermometers} are expected. '
            'Record again with these, or name the recordings to calibrate from.'
        )
    if job.settings.reference == 'payload' and recording.specific_force is None:
        raise RecordingError(f'{path.name} holds no specific force, which a payload needs.')
    check_recordings([recording], job.settings.reference, 0.0)
    return recording, sha256


def save(
    job: CalibrationJob, found: Calibration, paths: Mapping[str, Path]
) -> tuple[Calibration, StoredModel]:
    """
    Save a model that was learnt from recordings, by hash, and then payloads beside it.

    Gives the calibration with the payloads' names in their file. The model is not given up where
    its payloads cannot be saved: that is one more warning.
    """
    # Names may hold bytes that are no text.
    texts = {sha256: str(path).encode(errors='replace').decode() for sha256, path in paths.items()}
    sources = [{'path': text, 'sha256': sha256} for sha256, text in texts.items()]
    stored, learnt = save_model(job.output, found, {'recordings': sources}), found.payloads
    if learnt is None:
        return found, stored
    # Columns of a file do not show what measured specific force; only that by TF needs no frame.
    source = job.topics.force_source or ('' if learnt.frame.does_nothing else 'imu')
    wrench_frame = next(iter(found.sensor.get('frame_id', ())), job.topics.wrench_frame)
    frame = replace(
        learnt.frame, source=source, force_frame=job.topics.force_frame, wrench_frame=wrench_frame
    )
    payloads, path = learnt.payloads.values(), job.output.with_name(PAYLOADS)
    try:
        names = add_payloads(path, job.output.stem, payloads, frame)
    except WristFtCompError as error:
        lost = f'The model is saved, but its payloads are not: {error}'
        return replace(found, warnings=(*found.warnings, lost)), stored
    named = dict(zip(names, payloads, strict=True))
    return replace(found, payloads=replace(learnt, payloads=named)), stored
