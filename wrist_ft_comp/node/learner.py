"""The part that learns: it records every day, has models judged on it, offers a better one."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
import time
from typing import Any

from wrist_ft_comp.drift.drift_model import StoredModel
from wrist_ft_comp.errors import RecordingError, SettingsError, StateFileError, WristFtCompError
from wrist_ft_comp.jobs.job_process import CalibrationJob, JobProcess, Learning
from wrist_ft_comp.learning.day_files import DayFiles, SILENCE_NS
from wrist_ft_comp.learning.diary import last_change, load_memory, Memory, save_memory
from wrist_ft_comp.node.jobs import CalibrateService, start_job
from wrist_ft_comp.node.live_model import LiveModel
from wrist_ft_comp.node.recorder import OwnRecording, Recorder
from wrist_ft_comp.ros.diagnostics import ERROR, NodeLog, OK, Status, WARN
from wrist_ft_comp.ros.hub import Hub, Part
from wrist_ft_comp.ros.parameters import at_start
from wrist_ft_comp.ros.services import service, Work
from wrist_ft_comp.series import NANOSECONDS
from wrist_ft_comp.stored.model_file import restore_model
from wrist_ft_comp.stored.model_store import day_of_choice

#: The node looks for an ended day once in this time, s.
_LOOK_S = 1.0
#: A job that could not run is started again, and a day is recorded again that the disk refused,
#: after this time, s.
_RETRY_S = 60.0


class DiaryKeeper:
    """Records days; tries again later when the disk refuses."""

    def __init__(self, recorder: Recorder, files: DayFiles, log: NodeLog) -> None:
        #: Why nothing is being recorded; empty while all is well.
        self.problem = ''
        self.files = files
        self._recorder, self._log = recorder, log
        #: When to try again, and when the last row was written, by the steady clock.
        self._wait_until = self._written = time.monotonic()
        self._recording: OwnRecording | None = recorder.begin_recording(files)

    def poll(self) -> None:
        """Go on recording, unless the disk refused just now; a silence ends the day."""
        now, recording = time.monotonic(), self._recording
        if recording is None:
            if now >= self._wait_until:
                self._recording = self._recorder.begin_recording(self.files)
        elif recording.error is not None:
            self._fail(recording.error)
        elif recording.rows:
            recording.rows, self._written, self.problem = 0, now, ''
        if self.files.path is not None and now - self._written > SILENCE_NS / NANOSECONDS:
            self.end_day()

    def _fail(self, error: RecordingError) -> None:
        with suppress(RecordingError):  # what the disk took stays, the rest is lost
            self.files.close()
        self._recording, self._wait_until = None, time.monotonic() + _RETRY_S
        if not self.problem:
            self._log.error(f'The day is not recorded any more: {error}')
        self.problem = f'{error} The day is not recorded; the node tries again every minute'

    def end_day(self) -> None:
        """End the day, if one goes on; the next row begins another."""
        self.end()
        try:
            self.files.leave()
        except RecordingError as error:
            self._fail(error)
        else:
            self._recording = self._recorder.begin_recording(self.files)

    def end(self) -> None:
        """Write all rows, and close; the day goes on with the next recording."""
        recording, self._recording = self._recording, None
        if recording is None:
            return
        self._recorder.finish(recording)
        try:
            if recording.error is not None:
                raise recording.error
            self.files.close()
        except RecordingError as error:
            self._fail(error)


@dataclass(eq=False, kw_only=True)
class Learner(Part):
    """Starts a job for every ended day, and offers its better model or makes it live."""

    live: LiveModel
    calibration: CalibrateService
    recorder: Recorder
    hub: Hub = field(init=False)
    mode: str = 'off'
    #: Why parameters do not allow learning; empty when they do.
    why_not: str = ''
    #: Why a model could not be made live, or what is remembered could not be saved.
    problem: str = ''
    memory: Memory = field(default_factory=Memory)
    diary: DiaryKeeper | None = None
    _process: JobProcess | None = None
    #: Newest day of the running job, and when it was started, by the steady clock.
    _judging: str = ''
    _begun_s: float = 0.0
    #: When to look for a day to judge, by the steady clock.
    _wait_until: float = 0.0
    #: Newest day of the last job that was started to make room.
    _crowded: str = ''
    #: The model that the last job found: reading its file again would hold up wrenches.
    _found: StoredModel | None = None
    #: File of an offered model that could not be made live; it is only offered from then on.
    _failed: str = ''

    title = 'learning'
    parameters = (
        at_start(
            'learning.mode', 'off',
            'Whether to keep a diary of every day and to learn from it. A better model is '
            'offered, and ~/adopt makes it live (propose), or it goes live by itself (auto); off '
            'does nothing. Needs calibration.reference payload and a gravity.source.',
            choices=('off', 'propose', 'auto')),
        at_start(
            'learning.max_mb', 500.0,
            'Most room on the disk for the days of a sensor.', 'MB', 50.0, 1e6),
    )  # fmt: skip

    def start(self) -> None:
        """Say what does not allow learning."""
        chosen = self.hub.chosen()
        self.mode = chosen['learning.mode']
        reference, source = chosen['calibration.reference'], chosen['gravity.source']
        if self.mode == 'off':
            self.why_not = (
                'learning is off: set the parameter learning.mode to propose or auto at start-up.'
            )
        elif reference != 'payload' or source == 'none':
            self.why_not = (
                'nothing is learnt: that needs calibration.reference payload, and gravity.source '
                f'imu or tf; they are {reference} and {source}.'
            )
            self.hub.log.warning(self.why_not)

    def begin(self) -> None:
        """Load the memory, and begin to record."""
        if self.why_not:
            return
        directory, recorder, memory, broken = self._directory, self.recorder, None, ''
        try:
            memory = load_memory(directory)
        except StateFileError as error:
            broken = (
                'It is forgotten what the newest day said, and which model was offered: '
                f'{error} learning.json.kept is the first such file.'
            )
            self.hub.log.warning(broken)
        self.memory = memory or Memory(self.live.sha256, incident=broken)
        newest = max(self.memory.judged, day_of_choice(self.live.history))
        most_bytes = 1e6 * self.hub.chosen()['learning.max_mb']
        files = DayFiles(directory, recorder.channels, most_bytes, newest, recorder.sensor)
        self.diary = DiaryKeeper(recorder, files, self.hub.log)
        self.live.end_day = self._end_day
        if memory is None:
            self._remember()

    @property
    def _directory(self) -> Path:
        return self.live.store.directory

    @property
    def running_s(self) -> float | None:
        """How long a job has been running, s; None when none is."""
        return None if self._process is None else time.monotonic() - self._begun_s

    @property
    def offered(self) -> Path:
        """The file of the model that is offered."""
        return self._directory / 'models' / self.memory.offered

    def poll(self) -> None:
        """Do what is due: record, start a job, take its outcome, adopt its model."""
        if self.diary is None:
            return
        self._follow_live()
        self.diary.poll()
        if self.calibration.running_s is not None:
            self._end_job()  # a person's goes first; the day is judged afterwards
        elif self._process is not None:
            if outcome := self._process.poll():
                self._process = None
                self._take(outcome)
        elif time.monotonic() >= self._wait_until:
            self._wait_until = time.monotonic() + _LOOK_S
            # A job starts where the newest day is not judged; without room, once per day.
            files = self.diary.files
            days = files.ended()
            newest = days[-1].name if days else ''
            is_crowded = files.full and newest not in {'', self._crowded}
            if newest > self.memory.judged or is_crowded:
                self._crowded = self._judging = newest
                self._begun_s = time.monotonic()
                try:
                    self._process = start_job(self._job(days))
                except OSError as error:
                    self._wait_until = time.monotonic() + _RETRY_S
                    self.problem = f'Learning cannot be started: {error}.'
        memory = self.memory
        if self.mode == 'auto' and not memory.paused and memory.offered not in {'', self._failed}:
            try:
                self._adopt(f'the node made {memory.offered} live: {memory.why}', memory.judged)
            except SettingsError as error:
                self._failed, self.problem = memory.offered, str(error)
                self.hub.log.write(ERROR, self.problem)

    def _job(self, days: Sequence[Path]) -> CalibrationJob:
        """Ask for what can be learnt from days."""
        kept_mb = (
            0.8 * self.hub.chosen()['learning.max_mb']
        )  # leaves room for the day that goes on
        learning = Learning(tuple(self.live.history), kept_mb)
        return self.calibration.make_job(
            days, reference='payload', skip_unusable=True, learning=learning
        )

    def _follow_live(self) -> None:
        """Forget what was said and offered about a model that is not live any more."""
        live, memory = self.live, self.memory
        if live.sha256 == memory.champion or (live.stored is None and live.problem):
            return
        changes = {'champion': live.sha256, 'offered': '', 'sha256': '', 'why': ''}
        if not live.history or live.history[-1].how != 'learnt':
            judged = max(memory.judged, day_of_choice(live.history))
            changes |= {'judged': judged, 'paused': '', 'incident': ''}
        self._remember(**changes)

    def _take(self, outcome: Mapping[str, Any]) -> None:
        """Remember the outcome of a job, and offer the model that it found."""
        message: str = outcome['message']
        judged = {'judged': self._judging, 'verdict': message}
        if not outcome['success']:
            trouble = f'{self._judging} could not be judged: {message}'
            self._remember(**judged, incident=trouble)
            self.hub.log.warning(trouble)
            return
        judged |= {'paused': outcome['paused'], 'incident': outcome['incident']}
        self.hub.log.info(f'{self._judging}: {message}')
        if outcome['learnt']:
            path, sha256 = Path(outcome['path']), outcome['sha256']
            self._found = restore_model(path, sha256, outcome['document'])
            judged |= {'offered': path.name, 'sha256': sha256, 'why': message}
            if self.mode == 'propose':
                self.hub.log.info(f'The better model {path} is offered. Adopt it with ~/adopt.')
        self._remember(**judged)

    @service(
        '~/adopt',
        'makes the better model live that learning offers; refused when there is none',
    )
    def adopt(self, _: Any) -> Work:
        """Make the offered model live because a person asked for it; say which."""
        now, why = f'compensating with {self.offered}: {self.memory.why}', self.memory.why
        self._adopt(f'a person called ~/adopt: {why}')
        return (yield from self.live.kept(now))

    def _adopt(self, why: str, judged: str = '') -> None:
        """Make the offered model live, as LiveModel.take does; SettingsError refuses."""
        memory = self.memory
        try:
            if self.why_not or not memory.offered:
                said = f'the newest day said: {memory.verdict}' if memory.verdict else ''
                none = f'No better model is offered: {said or "no day is judged yet"}.'
                raise SettingsError(self.why_not or none)
            stored = self._found
            if stored is None or stored.sha256 != memory.sha256 or not judged:
                stored = self.live.load(self.offered)
            if stored.sha256 != memory.sha256:
                raise SettingsError(
                    f'{stored.path} has changed since it was judged. Set model_file to it if you '
                    'want it live all the same.'
                )
            self.live.take(stored, why, judged)
        except WristFtCompError as error:
            raise SettingsError(f'{error} The running model stays.') from error
        self._follow_live()

    def _end_day(self) -> None:
        """End the day that goes on, and the job, because a person decides about models."""
        self._end_job()
        if self.diary is not None:
            self.diary.end_day()

    def _remember(self, **changes: Any) -> None:
        """Save changes of the memory; delete the file of a model that is not offered any more."""
        before, offered = self.memory, self.offered
        self.memory, self.problem = replace(before, **changes), ''
        was_live = any(entry.sha256 == before.sha256 for entry in self.live.history)
        is_over = before.offered not in {'', self.memory.offered} and not was_live

        def note(problem: str) -> None:
            if problem:
                self.problem = problem
                self.hub.log.error(problem)
            elif is_over:
                self.live.store.discard(offered)

        write = partial(save_memory, self._directory, self.memory)
        self.live.writer.put('learning.json', write, note)

    def _end_job(self) -> None:
        if self._process is not None:
            self._process.end()
            self._process = None

    def statuses(self) -> Iterator[Status]:
        """Report what learning does, and its last results; nothing where it is off."""
        if self.mode == 'off':
            return
        memory, diary = self.memory, self.diary
        numbers = {
            'mode': self.mode,
            'last_day': f'{memory.judged}: {memory.verdict}' if memory.verdict else 'none yet',
            'last_change': last_change(self.live.history) or 'none yet',
        }
        if memory.offered:
            report = str(self.offered.with_suffix('.html'))
            numbers |= {'offered': str(self.offered), 'why': memory.why, 'report': report}
        if diary is not None:
            numbers['days'] = str(len(diary.files.ended()))
            numbers['megabytes'] = f'{diary.files.used() / 1e6:.1f}'
        disk = diary.problem if diary else ''
        # The worst first.
        trouble = self.why_not or disk or self.problem or memory.paused or memory.incident
        if trouble:
            message = trouble
        elif memory.offered:
            message = f'a better model is offered, {memory.offered}; ~/adopt makes it live'
        elif self.running_s is not None:
            message = f'models have been compared on {self._judging} for {self.running_s:.0f} s'
        else:
            message = 'the day is being recorded; no better model is offered'
        yield Status(self.title, WARN if trouble else OK, message, numbers)

    def end(self) -> None:
        """End the job, and write what was recorded."""
        self._end_job()
        diary, self.diary = self.diary, None
        if diary is not None:
            diary.end()
