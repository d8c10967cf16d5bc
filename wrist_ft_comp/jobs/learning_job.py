"""The learning job: a day is judged, a new model learnt from all days, and old days deleted."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from wrist_ft_comp.errors import RecordingError, WristFtCompError
from wrist_ft_comp.jobs.calibration_job import save
from wrist_ft_comp.jobs.job_process import CalibrationJob
from wrist_ft_comp.learning import days, model_choice
from wrist_ft_comp.learning.incidents import Day, look_at, pause
from wrist_ft_comp.recordings.read import hash_recording, read_recording
from wrist_ft_comp.report.html_page import page, REPORT
from wrist_ft_comp.report.report_content import calibration_content, model_sources
from wrist_ft_comp.stored.model_file import load_model
from wrist_ft_comp.stored.node_folder import day_of_choice, HistoryEntry, model_on

_LATE = 'This day was judged late, and no model was learnt after it.'


def learn(job: CalibrationJob) -> dict[str, Any]:
    """Judge the newest day, and those that the diary lacks; report what cannot be saved."""
    history, directory = job.history or (), job.recordings[-1].parent.parent
    live = _champion(history[-1] if history else None)

    def champion_of(day: str) -> model_choice.Champion:
        """Load the model that ran on a day; only its name is known where its file is gone."""
        entry = model_on(history, day)
        if history and entry is history[-1]:
            return live
        try:
            return _champion(entry)
        except WristFtCompError:
            return model_choice.Champion(entry.path.name if entry and entry.path else '')

    # Days are read and separated once.
    look = lru_cache(maxsize=model_choice.MOST_DAYS + 1)(lambda name: _look(job, name))
    names, known = [path.name for path in job.recordings], days.load_diary(directory)
    since, newest = day_of_choice(history), max(names)
    judged = {day.name: day for day in known.days if day.name != newest}
    for name in sorted(set(names) - set(judged) - {newest}):
        before = [judged[other] for other in sorted(judged) if other < name]
        entry = model_choice.describe_day(name, look, before, champion_of(name))
        judged[name] = replace(entry, verdict=f'{model_choice.drift_words(entry)}{_LATE}')
    before = [judged[name] for name in sorted(judged)]
    choice = model_choice.take(
        newest, look, before, champion_of(newest), names, since, job.settings
    )
    entry = choice.entry
    paused = pause([*before, entry], since)

    answer: dict[str, Any] = {'success': True, 'learnt': False, 'paused': paused}
    troubles, advice = [entry.incident], ''
    if lost := known.problem:
        troubles.append(f'{lost} The days are judged again; the damaged file is diary.json.kept.')
    with _noted(troubles, 'A better model is lost'):
        if choice.better is not None:
            learnt = [path for path in job.recordings if path.name in choice.days]
            saved, stored = save(job, choice.better, {hash_recording(p): p for p in learnt})
            troubles += saved.warnings[len(choice.better.warnings) :]
            answer |= {'learnt': True, 'path': str(stored.path)}
            answer |= {'sha256': stored.sha256, 'document': stored.document}
            with suppress(WristFtCompError):  # the report does not matter to the model
                drifts = [look(name).drift for name in choice.days]
                content = calibration_content(saved, drifts, stored)
                advice = ''.join(f'To make it better: {said}' for said in content.advice[:1])
                if job.report is not None:
                    REPORT.write(job.report, page(content))
            entry = replace(entry, better=job.output.name)
    diary = days.Diary((*before, entry), paused=paused)
    with _noted(troubles, 'The diary is lost'):
        days.save_diary(directory, diary)
    with _noted(troubles, 'Old days stay'):
        days.prune(directory, diary, job.max_mb)
    incident = ' '.join(filter(None, troubles))
    message = ' '.join(filter(None, (incident, entry.verdict, advice)))
    return {**answer, 'incident': incident, 'message': message}


def _look(job: CalibrationJob, name: str) -> Day:
    """Read and separate a day, after the one that it goes on from."""
    paths = {path.name: path for path in job.recordings}
    path = paths[name]
    if not days.size_of(path):
        raise RecordingError(
            f'{path} is no file that a node wrote: empty, a dead link, or larger than '
            f'{days.LARGEST_BYTES / 1e6:.0f} MB. Move it away.'
        )
    recording = read_recording(path, period_s=job.period_s, topics=job.topics)
    earlier = max((other for other in paths if other < name), default=None)
    with suppress(RecordingError, OSError):  # a damaged day before is no fault of this one
        if earlier and days.goes_on(paths[earlier], path):
            before = read_recording(paths[earlier], period_s=job.period_s, topics=job.topics)
            if before.thermometers == recording.thermometers:
                return look_at(recording, before)
    return look_at(recording)


@contextmanager
def _noted(troubles: list[str], what: str) -> Iterator[None]:
    """Add a sentence about an error to a list, instead of raising it."""
    try:
        yield
    except (WristFtCompError, OSError) as error:
        troubles.append(f'{what}: {error}')


def _champion(entry: HistoryEntry | None) -> model_choice.Champion:
    """Load a model that is or was live, and find the newest day that it was learnt from."""
    if entry is None or entry.path is None:
        return model_choice.Champion()
    stored = load_model(entry.path)
    sources = [Path(source) for source, _ in model_sources(stored)]
    # A person's own recordings may have names like those of days.
    names = [source.name for source in sources if source.parent.name == 'days']
    newest = max(filter(days.day_number, names), default='')
    return model_choice.Champion(stored.sha256[:12], stored.model, newest)
