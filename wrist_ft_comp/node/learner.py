"""The part that learns: it records every day, has models judged on it, offers a better one."""

from collections.abc import Generator, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
import time
from typing import Any

from wrist_ft_comp import errors
from wrist_ft_comp.drift.drift_model import StoredModel
from wrist_ft_comp.learning import days
from wrist_ft_comp.node.calibration_services import Jobs, run_job
from wrist_ft_comp.node.live_model import LiveModel
from wrist_ft_comp.node.recorder import OwnRecording, Recorder
from wrist_ft_comp.ros.diagnostics import OK, Status, WARN
from wrist_ft_comp.ros.hub import Part
from wrist_ft_comp.ros.parameters import at_start
from wrist_ft_comp.ros.services import service, Work
from wrist_ft_comp.series import NANOSECONDS
from wrist_ft_comp.stored.model_file import restore_model
from wrist_ft_comp.stored.node_folder import day_of_choice

#: The node looks for an ended day once in this time, s.
_LOOK_S = 1.0
#: A day that the disk refuses is recorded again after this time, s.
_PAUSE_S = 60.0


@dataclass(eq=False)
class Learner(Part):
    """Starts a job for every ended day, and offers its better model or makes it live."""

    live: LiveModel
    jobs: Jobs
    recorder: Recorder
    mode: str = 'off'
    #: Why parameters do not allow learning; empty when they do.
    why_not: str = ''
    #: Why a model could not be made live, or what is remembered could not be saved.
    problem: str = ''
    memory: days.Memory = field(default_factory=days.Memory)
    #: The days and what is recorded into them; None while nothing is learnt.
    files: days.DayFiles | None = None
    _recording: OwnRecording | None = None
    #: Waits for the job that runs; None while none does.
    _judging: Generator[None, None, None] | None = None
    #: When to look for a day to judge, by the steady clock.
    _wait_until: float = 0.0
    #: Newest day of the last job.
    _judged_last: str = ''
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
        """Load the memory, and begin to record, or say what does not allow learning."""
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
        if self.why_not:
            return
        directory, recorder = self.live.store.directory, self.recorder
        memory, broken = None, ''
        try:
            memory = days.load_memory(directory)
        except errors.StateFileError as error:
            broken = (
                'The verdict on the newest day and the offered model are lost: '
                f'{error} The damaged file is kept as learning.json.kept.'
            )
        self.memory = memory or days.Memory(self.live.sha256, incident=broken)
        newest = max(self.memory.judged, day_of_choice(self.live.history))
        most_bytes = 1e6 * chosen['learning.max_mb']
        self.files = days.DayFiles(
            directory, recorder.channels, most_bytes, newest, recorder.sensor
        )
        self._recording = recorder.begin_recording(self.files, _PAUSE_S)
        self.live.end_day = self._end_day
        if memory is None:
            self._remember()

    @property
    def offered(self) -> Path:
        """The file of the model that is offered."""
        return self.live.store.directory / 'models' / self.memory.offered

    def poll(self) -> None:
        """Do what is due: record, start a job, take its outcome, adopt its model."""
        recording, files = self._recording, self.files
        if recording is None or files is None:
            return
        self._follow_live()
        if recording.error is not None:
            with suppress(errors.RecordingError):  # what the disk took stays, the rest is lost
                files.close()
        elif files.path and time.monotonic() - recording.came_s > days.SILENCE_NS / NANOSECONDS:
            files.leave()
        if self.hub.running_s('~/calibrate') is not None:
            self._end_job()  # a person's goes first; the day is judged afterwards
        elif self._judging is not None:
            if next(self._judging, self) is self:  # it has ended
                self._judging = None
        elif time.monotonic() >= self._wait_until:
            self._wait_until = time.monotonic() + _LOOK_S
            # A job starts where the newest day is not judged; without room, once per day.
            ended = files.ended()
            newest = ended[-1].name if ended else ''
            is_judged_last = files.full and newest not in {'', self._judged_last}
            if newest > self.memory.judged or is_judged_last:
                self._judged_last, self._judging = newest, self._judge(ended)
        memory = self.memory
        if self.mode == 'auto' and not memory.paused and memory.offered not in {'', self._failed}:
            try:
                self._adopt(f'the node made {memory.offered} live: {memory.why}', memory.judged)
            except errors.SettingsError as error:
                self._failed, self.problem = memory.offered, str(error)

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

    def _judge(self, ended: Sequence[Path]) -> Generator[None, None, None]:
        """Let a job judge the newest day, remember what it says, and offer the model it found."""
        newest, log = ended[-1].name, self.hub.log
        kept_mb = 0.8 * self.hub.chosen()['learning.max_mb']  # leaves room for the present day
        job = self.jobs.make_job(
            ended, reference='payload', skip_unusable=True,
            history=tuple(self.live.history), max_mb=kept_mb,
        )  # fmt: skip
        try:
            outcome = yield from run_job(job)
        except errors.CalibrationRefusedError as error:
            incident = f'{newest} could not be judged: {error}'
            self._remember(judged=newest, verdict=str(error), incident=incident)
            return
        message, news = outcome['message'], dict[str, str]()
        log.info(f'{newest}: {message}')
        if outcome['learnt']:
            path, sha256 = Path(outcome['path']), outcome['sha256']
            self._found = restore_model(path, sha256, outcome['document'])
            news = {'offered': path.name, 'sha256': sha256, 'why': message}
            if self.mode == 'propose':
                log.info(f'The better model {path} is offered. Adopt it with ~/adopt.')
        self._remember(
            judged=newest, verdict=message, paused=outcome['paused'],
            incident=outcome['incident'], **news,
        )  # fmt: skip

    @service(
        '~/adopt', 'makes the better model live that learning offers; refused when there is none'
    )
    def adopt(self, _: Any) -> Work:
        """Make the offered model live because a person asked for it; say which."""
        offered, why = self.offered, self.memory.why
        self._adopt(f'a person called ~/adopt: {why}')
        return (yield from self.live.kept(f'compensating with {offered}: {why}'))

    def _adopt(self, why: str, judged: str = '') -> None:
        """Make the offered model live, as LiveModel.take does; SettingsError refuses."""
        memory = self.memory
        try:
            if self.why_not or not memory.offered:
                said = f'the newest day said: {memory.verdict}' if memory.verdict else ''
                none = f'No better model is offered: {said or "no day is judged yet"}.'
                raise errors.SettingsError(self.why_not or none)
            stored = self._found
            if stored is None or stored.sha256 != memory.sha256 or not judged:
                stored = self.live.load(self.offered)
            if stored.sha256 != memory.sha256:
                raise errors.SettingsError(
                    f'{stored.path} has changed since it was judged. Set model_file to it if you '
                    'want it live all the same.'
                )
            self.live.take(stored, why, judged)
        except errors.WristFtCompError as error:
            raise errors.SettingsError(f'{error} The running model stays.') from error
        self._follow_live()

    def _end_day(self) -> None:
        """End the day that goes on, and the job, because a person decides about models."""
        self._end_job()
        if self.files is not None:
            self.hub.do(self, self.files.leave)  # a disk that refuses keeps no decision back

    def _remember(self, **changes: Any) -> None:
        """Save changes of the memory; delete the file of a model that is not offered any more."""
        before, offered = self.memory, self.offered
        self.memory, self.problem = replace(before, **changes), ''
        was_live = any(entry.sha256 == before.sha256 for entry in self.live.history)
        is_over = before.offered not in {'', self.memory.offered} and not was_live

        def note(problem: str) -> None:
            self.problem = problem or self.problem
            if is_over and not problem:
                self.live.store.discard(offered)

        write = partial(days.save_memory, self.live.store.directory, self.memory)
        self.live.writer.put('learning.json', write, note)

    def _end_job(self) -> None:
        if self._judging is not None:
            self._judging.close()
            self._judging = None

    def statuses(self) -> Iterator[Status]:
        """Report what learning does, and its last results; nothing where it is off."""
        if self.mode == 'off':
            return
        memory, recording, disk = self.memory, self._recording, ''
        numbers = {
            'mode': self.mode,
            'last_day': f'{memory.judged}: {memory.verdict}' if memory.verdict else 'none yet',
            'last_change': days.last_change(self.live.history) or 'none yet',
        }
        if memory.offered:
            report = str(self.offered.with_suffix('.html'))
            numbers |= {'offered': str(self.offered), 'why': memory.why, 'report': report}
        if self.files is not None:
            numbers['days'] = str(len(self.files.ended()))
            numbers['megabytes'] = f'{self.files.used() / 1e6:.1f}'
        if recording is not None and recording.error is not None:
            disk = f'{recording.error} The day is not recorded; the node tries again every minute'
        # The worst first.
        trouble = self.why_not or disk or self.problem or memory.paused or memory.incident
        if trouble:
            message = trouble
        elif memory.offered:
            message = f'a better model is offered, {memory.offered}; ~/adopt makes it live'
        elif self._judging is not None:
            message = f'models are being compared on {self._judged_last}'
        else:
            message = 'the day is being recorded; no better model is offered'
        yield Status(self.title, WARN if trouble else OK, message, numbers)

    def end(self) -> None:
        """End the job, and write what was recorded."""
        self._end_job()
        if self.files is not None and self._recording is not None:
            recording, self._recording = self._recording, None
            self.recorder.finish(recording)
            self.files.close()
