"""The learning job: judge the newest day, learn from all days, tidy up."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
import fcntl
from functools import lru_cache, partial
import os
from pathlib import Path
import tempfile
import time
from typing import Any

from wrist_ft_comp.errors import RecordingError, WristFtCompError
from wrist_ft_comp.fit.result import Calibration
from wrist_ft_comp.jobs.request import CalibrationJob, Learning
from wrist_ft_comp.learning.day import Day, look_at
from wrist_ft_comp.learning.day_files import day_number, goes_on, LARGEST_BYTES, size_of
from wrist_ft_comp.learning.diary import (
    decisions,
    Diary,
    diary_problem,
    load_diary,
    save_diary,
)
from wrist_ft_comp.learning.incidents import pause
from wrist_ft_comp.learning.model_choice import Champion, describe_day, drift_words, take
from wrist_ft_comp.learning.old_days import prune
from wrist_ft_comp.learning.schedule import MOST_DAYS
from wrist_ft_comp.recordings.read import hash_recording, read_recording
from wrist_ft_comp.report.outputs import REPORT
from wrist_ft_comp.report.page import page
from wrist_ft_comp.report.view import calibration_view, model_sources
from wrist_ft_comp.stored.model_file import load_model, save_model
from wrist_ft_comp.stored.model_store import day_of_choice, HistoryEntry, model_on
from wrist_ft_comp.stored.payload_file import add_payloads, PAYLOADS

#: Digits of its SHA-256 by which the diary names a model.
_DIGITS = 12
Answer = dict[str, Any]


def answer_learning(job: CalibrationJob, learning: Learning) -> Answer:
    """Run a learning job; give its outcome in plain values."""
    nothing: Answer = {'success': False, 'learnt': False, 'paused': '', 'later': False}
    if not job.recordings:
        return {**nothing, 'message': 'No day has ended yet; there is nothing to learn from.'}
    try:
        with alone() as mine:
            if not mine:
                busy = 'Another sensor of this computer is learning; this one waits for it.'
                return {**nothing, 'later': True, 'message': busy}
            return _learn(job, learning)
    except (WristFtCompError, OSError) as error:
        return {**nothing, 'message': str(error)}


def _learn(job: CalibrationJob, learning: Learning) -> Answer:
    """
    Judge the newest day, and those that are missing in the diary, and save the results.

    What cannot be saved, such as the diary on a full disk, is reported; the rest is done.
    """
    paths = {path.name: path for path in job.recordings}
    directory, newest = job.recordings[-1].parent.parent, job.recordings[-1].name
    diary, lost = load_diary(directory), diary_problem(directory)
    history, since = learning.history, day_of_choice(learning.history)
    live = _champion(history[-1] if history else None)

    def champion_of(day: str) -> Champion:
        """Load the model that ran on a day; only its name is known where its file was deleted."""
        entry = model_on(history, day)
        if history and entry is history[-1]:
            return live
        try:
            return _champion(entry)
        except WristFtCompError:
            return Champion(entry.path.name if entry and entry.path else '')

    read = partial(read_recording, period_s=job.period_s, topics=job.topics)

    @lru_cache(maxsize=MOST_DAYS + 1)
    def look(name: str) -> Day:
        """Read and separate a day."""
        if not size_of(paths[name]):
            raise RecordingError(
                f'{paths[name]} is no file that a node wrote: empty, a dead link, or larger than '
                f'{LARGEST_BYTES / 1e6:.0f} MB. Move it away.'
            )
        recording = read(paths[name])
        earlier = max((paths[other] for other in paths if other < name), default=None)
        before = None
        with suppress(RecordingError, OSError):  # a damaged day before is no fault of this one
            before = read(earlier) if earlier and goes_on(earlier, paths[name]) else None
        same = before is not None and before.thermometers == recording.thermometers
        return look_at(recording, before if same else None)

    judged = {entry.name: entry for entry in diary.days if entry.name != newest}
    for name in sorted(set(paths) - set(judged) - {newest}):
        began = time.process_time()
        before = [judged[other] for other in sorted(judged) if other < name]
        entry = describe_day(name, look, before, champion_of(name))
        verdict = f'{drift_words(entry)}It was judged late, so that no new model was tried.'
        judged[name] = replace(entry, verdict=verdict, seconds=time.process_time() - began)
    entries = [judged[name] for name in sorted(judged)]
    began = time.process_time()
    choice = take(newest, look, entries, champion_of(newest), list(paths), since, job.settings)
    entry = replace(choice.entry, seconds=time.process_time() - began)
    diary = Diary((*entries, entry), decisions(history), pause([*entries, entry], since))
    answer: Answer = {'success': True, 'learnt': False, 'paused': diary.paused}
    troubles, better = [entry.incident], choice.better
    if lost:
        troubles.append(f'{lost} The days are judged anew; diary.json.kept is the first such one.')
    with _noted(troubles, 'A better model is lost'):
        if better:
            days = {name: paths[name] for name in choice.days}
            answer |= _save(job, better, days, look, troubles, diary)
            answer['learnt'] = True
            entry = replace(entry, better=job.output.name)
            diary = replace(diary, days=(*entries, entry))
    with _noted(troubles, 'The diary is lost'):
        save_diary(directory, diary)
    with _noted(troubles, 'Old days stay'):
        prune(directory, diary, learning.keep_days, learning.max_mb)
    answer['incident'] = ' '.join(filter(None, troubles))
    return {**answer, 'message': f'{answer["incident"]} {entry.verdict}'.strip()}


@contextmanager
def alone() -> Iterator[bool]:
    """Hold the lock of learning; False where another process of this user holds it."""
    # In the folder for temporary files, because the folders of two sensors may have nothing in
    # common. The system releases it where the process is killed.
    path = Path(tempfile.gettempdir()) / f'wrist_ft_comp_learning_{os.getuid()}.lock'
    handle = os.open(path, os.O_CREAT | os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield True
    except BlockingIOError:
        yield False
    finally:
        os.close(handle)


@contextmanager
def _noted(troubles: list[str], what: str) -> Iterator[None]:
    """Add a sentence about an error to a list, instead of raising it."""
    try:
        yield
    except (WristFtCompError, OSError) as error:
        troubles.append(f'{what}: {error}')


def _champion(entry: HistoryEntry | None) -> Champion:
    """Load a model that is or was live, and find the newest day that it was learnt from."""
    if entry is None or entry.path is None:
        return Champion()
    stored = load_model(entry.path)
    sources = [Path(source) for source, _ in model_sources(stored)]
    # A person's own recordings may have names like those of days.
    names = [source.name for source in sources if source.parent.name == 'days']
    newest = max(filter(day_number, names), default='')
    return Champion(stored.sha256[:_DIGITS], stored.model, newest)


def _save(  # noqa: PLR0913, PLR0917 -- a model, where it goes, and what its report shows
    job: CalibrationJob,
    better: Calibration,
    days: dict[str, Path],
    look: Callable[[str], Day],
    troubles: list[str],
    diary: Diary,
) -> Answer:
    """Save a better model, and then payloads and report, whose errors do not matter to it."""
    sources = [{'path': str(path), 'sha256': hash_recording(path)} for path in days.values()]
    stored = save_model(job.output, better, {'recordings': sources})
    kept = keep_payloads(job, better)
    troubles += kept.warnings[len(better.warnings) :]
    better = kept
    answer = {'path': str(stored.path), 'sha256': stored.sha256, 'document': stored.document}
    if job.report is not None:
        with suppress(WristFtCompError):
            drifts = [look(name).drift for name in days]
            view = calibration_view(better, drifts, stored, 'payload')
            REPORT.write(job.report, page(replace(view, diary=diary)))
    return answer


def keep_payloads(job: CalibrationJob, found: Calibration) -> Calibration:
    """
    Save the payloads of a calibration beside its model; gives it with their names in the file.

    The model is saved before: payloads that cannot be saved are a warning.
    """
    learnt = found.payloads
    if learnt is None:
        return found
    # Columns of a file do not show what measured specific force; only that by TF needs no frame.
    source = job.topics.force_source or ('' if learnt.frame.does_nothing else 'imu')
    wrench_frame = next(iter(found.sensor.get('frame_id', ())), job.topics.wrench_frame)
    frame = learnt.frame.learnt_by(source, replace(job.topics, wrench_frame=wrench_frame))
    payloads, path = learnt.payloads.values(), job.output.with_name(PAYLOADS)
    try:
        names = add_payloads(path, job.output.stem, payloads, frame)
    except WristFtCompError as error:
        lost = f'The model is saved, but its payloads are not: {error}'
        return replace(found, warnings=(*found.warnings, lost))
    named = dict(zip(names, payloads, strict=True))
    return replace(found, payloads=replace(learnt, payloads=named))
