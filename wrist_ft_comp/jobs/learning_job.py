"""The learning job: a day is judged, a new model learnt from all days, and old days deleted."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
import fcntl
from functools import lru_cache
import os
from pathlib import Path
import tempfile
import time
from typing import Any

from wrist_ft_comp.errors import RecordingError, WristFtCompError
from wrist_ft_comp.fit.result import Calibration
from wrist_ft_comp.jobs.calibration_job import model_values, save
from wrist_ft_comp.jobs.request import CalibrationJob, Learning
from wrist_ft_comp.learning.day import Day, look_at
from wrist_ft_comp.learning.day_files import day_number, goes_on, LARGEST_BYTES, size_of
from wrist_ft_comp.learning.diary import Diary, diary_problem, load_diary, save_diary
from wrist_ft_comp.learning.incidents import pause
from wrist_ft_comp.learning.model_choice import Champion, describe_day, drift_words, take
from wrist_ft_comp.learning.old_days import prune
from wrist_ft_comp.learning.schedule import MOST_DAYS
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.recordings.read import hash_recording, read_recording
from wrist_ft_comp.report.page import page, REPORT
from wrist_ft_comp.report.report_content import calibration_content, model_sources
from wrist_ft_comp.stored.model_file import load_model
from wrist_ft_comp.stored.model_store import day_of_choice, HistoryEntry, model_on

#: Digits of its SHA-256 by which the diary names a model.
_DIGITS = 12


def learn(job: CalibrationJob, learning: Learning) -> dict[str, Any]:
    """
    Judge the newest day, and those that are missing in the diary, and save the results.

    What cannot be saved, such as the diary on a full disk, is reported; the rest is done.
    """
    if not job.recordings:
        raise RecordingError('No day has ended yet; there is nothing to learn from.')
    with alone() as mine:
        if not mine:
            busy = 'Another sensor of this computer is learning; this one waits for it.'
            return {'success': False, 'later': True, 'message': busy}
        return _LearningJob(job, learning).run()


class _LearningJob:
    """One job; days are read and separated once."""

    def __init__(self, job: CalibrationJob, learning: Learning) -> None:
        self._job, self._learning = job, learning
        self._paths = {path.name: path for path in job.recordings}
        self._directory = job.recordings[-1].parent.parent
        history = learning.history
        self._live = _champion(history[-1] if history else None)
        self.look = lru_cache(maxsize=MOST_DAYS + 1)(self._look)

    def run(self) -> dict[str, Any]:
        """Judge, learn, save, and tidy up."""
        history, newest = self._learning.history, max(self._paths)
        lost = diary_problem(self._directory)
        since = day_of_choice(history)
        judged = {day.name: day for day in load_diary(self._directory).days}
        judged.pop(newest, None)
        for name in sorted(set(self._paths) - set(judged) - {newest}):
            began = time.process_time()
            before = [judged[other] for other in sorted(judged) if other < name]
            entry = describe_day(name, self.look, before, self._champion_of(name))
            verdict = f'{drift_words(entry)}It was judged late, so that no new model was tried.'
            judged[name] = replace(entry, verdict=verdict, seconds=time.process_time() - began)
        before, began = [judged[name] for name in sorted(judged)], time.process_time()
        choice = take(
            newest, self.look, before, self._champion_of(newest), list(self._paths), since,
            self._job.settings,
        )  # fmt: skip
        entry = replace(choice.entry, seconds=time.process_time() - began)
        diary = Diary((*before, entry), tuple(history), pause([*before, entry], since))

        answer: dict[str, Any] = {'success': True, 'learnt': False, 'paused': diary.paused}
        troubles = [entry.incident]
        if lost:
            troubles.append(
                f'{lost} The days are judged anew; diary.json.kept is the first such one.'
            )
        with _noted(troubles, 'A better model is lost'):
            if choice.better is not None:
                answer |= self._save(choice.better, choice.days, diary, troubles)
                answer['learnt'] = True
                entry = replace(entry, better=self._job.output.name)
                diary = replace(diary, days=(*before, entry))
        with _noted(troubles, 'The diary is lost'):
            save_diary(self._directory, diary)
        with _noted(troubles, 'Old days stay'):
            prune(self._directory, diary, self._learning.max_mb)
        incident = ' '.join(filter(None, troubles))
        return {**answer, 'incident': incident, 'message': f'{incident} {entry.verdict}'.strip()}

    def _champion_of(self, day: str) -> Champion:
        """Load the model that ran on a day; only its name is known where its file was deleted."""
        history = self._learning.history
        entry = model_on(history, day)
        if history and entry is history[-1]:
            return self._live
        try:
            return _champion(entry)
        except WristFtCompError:
            return Champion(entry.path.name if entry and entry.path else '')

    def _read(self, path: Path) -> Recording:
        return read_recording(path, period_s=self._job.period_s, topics=self._job.topics)

    def _look(self, name: str) -> Day:
        """Read and separate a day."""
        path = self._paths[name]
        if not size_of(path):
            raise RecordingError(
                f'{path} is no file that a node wrote: empty, a dead link, or larger than '
                f'{LARGEST_BYTES / 1e6:.0f} MB. Move it away.'
            )
        recording, before = self._read(path), None
        earlier = max((other for other in self._paths if other < name), default=None)
        with suppress(RecordingError, OSError):  # a damaged day before is no fault of this one
            if earlier and goes_on(self._paths[earlier], path):
                before = self._read(self._paths[earlier])
        same = before is not None and before.thermometers == recording.thermometers
        return look_at(recording, before if same else None)

    def _save(
        self, better: Calibration, days: Sequence[str], diary: Diary, troubles: list[str]
    ) -> dict[str, Any]:
        """Save a better model, and then payloads and report, whose errors do not matter to it."""
        job = self._job
        paths = {hash_recording(self._paths[name]): self._paths[name] for name in days}
        saved, stored = save(job, better, paths)
        troubles += saved.warnings[len(better.warnings) :]
        if job.report is not None:
            with suppress(WristFtCompError):
                drifts = [self.look(name).drift for name in days]
                view = calibration_content(saved, drifts, stored, 'payload')
                REPORT.write(job.report, page(replace(view, diary=diary)))
        return model_values(stored)


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
