"""Learning from days: when a job runs, and what becomes of the better model that it found."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path
import time
from typing import Any

from std_srvs.srv import Trigger

from wrist_ft_comp.drift.drift_model import StoredModel
from wrist_ft_comp.errors import SettingsError, StateFileError, WristFtCompError
from wrist_ft_comp.learning.day_files import DayFiles
from wrist_ft_comp.learning.memory import load_memory, Memory, save_memory
from wrist_ft_comp.node.calibrate import CalibrateService, CalibrationProcess, JobMaker
from wrist_ft_comp.node.day_recorder import DiaryKeeper
from wrist_ft_comp.node.live_model import LiveModel
from wrist_ft_comp.ros.hub import Part, Service
from wrist_ft_comp.ros.node_log import NodeLog, OK, Status, WARN
from wrist_ft_comp.stored.model_file import restore_model

#: How often to look for a day to judge, and how long to wait where a job cannot run, s.
_LOOK_S, _WAIT_S = 1.0, 60.0
#: What a memory holds when nothing is offered.
_NONE = {'offered': '', 'sha256': '', 'why': '', 'automatic': False}


def why_not(chosen: Mapping[str, Any]) -> str:
    """Say why parameters do not allow what ``learning`` asks for; empty when they do."""
    if chosen['learning'] == 'off':
        return 'learning is off: set the parameter learning to propose or auto at start-up.'
    reference, source = chosen['calibration.reference'], chosen['gravity.source']
    if reference == 'payload' and source != 'none':
        return ''
    return (
        'nothing is learnt: that needs calibration.reference payload, and gravity.source imu or '
        f'tf; they are {reference} and {source}.'
    )


class Learner(Part):
    """Judges models on days, and offers or takes a better one; days are the keeper's business."""

    def __init__(
        self,
        chosen: Mapping[str, Any],
        live: LiveModel,
        calibration: CalibrateService,
        jobs: JobMaker,
        log: NodeLog,
    ) -> None:
        self.mode: str = chosen['learning']
        #: Why learning is off, and why what was decided can't be remembered; or nothing.
        self.why_not, self.problem = why_not(chosen), ''
        self._max_bytes = 1e6 * chosen['learning.max_mb']
        #: Why a day that has ended is not judged yet.
        self.waiting = ''
        self.memory = Memory()
        self.diary: DiaryKeeper | None = None
        self._live, self._calibration, self._jobs, self._log = live, calibration, jobs, log
        self._directory = jobs.store.directory
        self._process: CalibrationProcess | None = None
        #: Up to which day, and since when.
        self._judging, self._begun, self._begun_with_model = '', 0.0, False
        #: When to look for a day to judge, and the newest day when old ones were in the way.
        self._wait_until, self._crowded = 0.0, ''
        self._parameters_due = 0.0

    title = 'learning'

    def services(self) -> Sequence[Service]:
        """Offer ~/adopt."""
        return (Service(Trigger, '~/adopt', self.adopt),)

    def on_model(self) -> None:
        """Begin the diary when it is known which model is live; later models are looked for."""
        if self._begun_with_model:
            return
        self._begun_with_model = True
        if not self.why_not:
            self._begin()
        elif self.mode != 'off':
            self._log.warning(self.why_not)

    def _begin(self) -> None:
        """Go on with memory and diary, where the parameters allow it."""
        broken, memory = '', None
        try:
            memory = load_memory(self._directory)
        except StateFileError as error:
            broken = f'learning began anew: {error}'
            self._log.warning(broken)
        self.memory = memory or Memory(champion=self._live.sha256)
        newest = max(self.memory.judged, self.memory.since)
        recorder = self._jobs.recorder
        files = DayFiles(self._directory, recorder.channels, self._max_bytes, newest)
        files.sensor = recorder.sensor
        self.diary = DiaryKeeper(recorder, files, self._log)
        if broken:
            self._decide(broken)

    def _follow_parameters(self) -> None:
        """Begin or rest when calibration.reference has changed."""
        before, self.why_not = self.why_not, why_not(self._jobs.settings())
        if before and not self.why_not:
            self._begin()
        elif self.why_not and not before:
            self._log.warning(self.why_not)
            self._rest()

    @property
    def running_s(self) -> float | None:
        """How long a job has been running, s; None when none is."""
        return None if self._process is None else time.monotonic() - self._begun

    @property
    def offered(self) -> Path:
        """The file of the model that is offered."""
        return self._directory / 'models' / self.memory.offered

    def poll(self) -> None:
        """Go on with whatever is due: the diary, a job, what came of it."""
        if self.mode != 'off' and time.monotonic() >= self._parameters_due:
            self._parameters_due = time.monotonic() + _LOOK_S
            self._follow_parameters()
        if self.diary is None:
            return
        self._notice()
        if self.memory.automatic and self.mode == 'auto':  # a kill came before it was live
            self._go_live(lambda: self._live.load(self.offered))
        self.diary.poll()
        if self._calibration.running_s is not None:
            self._end_job()  # a person's goes first; the day is judged afterwards
        elif self._process is not None:
            self._follow(self._process)
        elif time.monotonic() >= self._wait_until:
            self._wait_until = time.monotonic() + _LOOK_S
            files = self.diary.files
            self._start(files.ended(), crowded=files.full)

    def _notice(self) -> None:
        """Note who changed the live model: a person, a job before a kill, or a broken file."""
        live, memory = self._live, self.memory
        if live.sha256 == memory.champion:
            return
        if live.stored is None and live.problem:
            self._remember(champion=None, change=_dated(f'no model is live: {live.problem}'))
        elif live.sha256 != memory.sha256:
            now = live.stored.path.name if live.stored else 'no model'
            self._decide(f'{now} was made live by hand')
        elif memory.automatic:
            self._note_learnt()
        else:
            self._decide(f'{memory.offered} was adopted: {memory.why}')

    def _start(self, days: list[Path], *, crowded: bool) -> None:
        """Start a job where no job has judged the newest day, or once to make room."""
        newest = days[-1].name if days else ''
        if newest <= self.memory.judged and (not crowded or newest in {'', self._crowded}):
            return
        self._crowded = newest
        live = self._live.stored
        champion = None if live is None else live.path
        self._judging, self._begun = newest, time.monotonic()
        try:
            job = self._jobs.learning(days, champion, self.memory.since)
            self._process = CalibrationProcess(job)
        except OSError as error:
            self._wait(f'Learning cannot be started: {error}.')

    def _wait(self, why: str) -> None:
        """Try again later."""
        self._wait_until = time.monotonic() + _WAIT_S
        if why != self.waiting:
            self.waiting = why
            self._log.info(why)

    def _follow(self, process: CalibrationProcess) -> None:
        """Look whether the job is done, and take what it says."""
        outcome = process.poll()
        if outcome is None:
            return
        self._process, message = None, outcome['message']
        if outcome.get('later'):
            self._wait(message)
            return
        self.waiting = ''
        judged = {'judged': self._judging, 'verdict': message}
        if not outcome['success']:
            trouble = f'Nothing was learnt from {self._judging}: {message}'
            self._remember(**judged, incident=trouble)
            self._log.warning(trouble)
            return
        self._remember(**judged, paused=outcome['paused'], incident=outcome['incident'])
        self._log.info(f'{self._judging}: {message}')
        if outcome['learnt']:
            self._take(Path(outcome['path']), outcome)

    def _take(self, path: Path, outcome: dict[str, Any]) -> None:
        """Make a better model live, or offer it."""
        sha256, why = outcome['sha256'], outcome['message']
        automatic = self.mode == 'auto' and not self.memory.paused
        # First of all, so that after a kill it is known what was to become of this model.
        self._remember(offered=path.name, sha256=sha256, why=why, automatic=automatic)
        if automatic:
            self._go_live(lambda: restore_model(path, sha256, outcome['document']))
        else:
            self._log.info(f'a better model, {path}, is offered: call ~/adopt to make it live')

    def _go_live(self, restore: Callable[[], StoredModel]) -> None:
        """Make a model live that was learnt; one that can't be is offered only."""
        try:
            problem = self._live.take(restore())
        except WristFtCompError as error:
            self._remember(automatic=False)
            self.problem = str(error)
            self._log.error(self.problem)
            return
        self._note_learnt()
        self.problem = self.problem or problem

    def _note_learnt(self) -> None:
        """Remember that the model that was learnt is live, and that no person decided it."""
        change = _dated(f'{self.memory.offered} was learnt: {self.memory.why}')
        self._remember(champion=self._live.sha256, change=change, **_NONE)

    def _decide(self, what: str) -> None:
        """Note that a person decided: days so far are no evidence against that."""
        self._end_job()
        if self.diary is None:
            return
        self.diary.end_day()
        days = self.diary.files.ended()
        newest = days[-1].name if days else self.memory.judged
        decided = {'since': newest, 'judged': newest, 'paused': '', 'incident': ''}
        self._remember(champion=self._live.sha256, change=_dated(what), **decided, **_NONE)

    def _remember(self, **changes: Any) -> None:
        """Keep what changed over a restart; an offer that nobody took is nobody's any more."""
        before, offered = self.memory, self.offered
        self.memory, self.problem = replace(before, **changes), ''
        try:
            save_memory(self._directory, self.memory)
        except StateFileError as error:
            self.problem = str(error)
            self._log.error(self.problem)
            return
        if before.offered not in {'', self.memory.offered} and before.sha256 != self._live.sha256:
            self._jobs.store.discard(offered)

    def adopt(self, *_: Any) -> str:
        """Make the offered model live; say which."""
        memory = self.memory
        try:
            if self.why_not or not memory.offered:
                none = f'No better model is offered: {memory.verdict or "no day is judged yet"}.'
                raise SettingsError(self.why_not or none)
            stored = self._live.load(self.offered)
            if stored.sha256 != memory.sha256:
                raise SettingsError(
                    f'{stored.path} is not what was judged: somebody changed it. Set model_file '
                    'if that is what you want.'
                )
            problem = self._live.take(stored)
        except WristFtCompError as error:
            raise SettingsError(f'{error} The running model stays.') from error
        self._decide(f'{memory.offered} was adopted: {memory.why}')
        message = f'compensating with {stored.path}: {memory.why}'
        return f'{message}\nwarning: {problem}' if problem else message

    def _end_job(self) -> None:
        """Stop the job, if one runs; nothing of it counts."""
        if self._process is not None:
            self._process.end()
            self._process = None

    def statuses(self) -> Iterator[Status]:
        """Judge how it stands; nothing is said where learning is off."""
        if self.mode == 'off':
            return
        memory, resting = self.memory, self.diary.problem if self.diary else ''
        # What a person should look at, the worst first.
        trouble = self.why_not or resting or self.problem or memory.paused or memory.incident
        level = WARN if trouble else OK
        yield Status(self.title, level, trouble or self._well(), self._numbers())

    def _well(self) -> str:
        """Say what is going on."""
        if self.memory.offered:
            return 'a better model is offered: see "offered", and call ~/adopt to make it live'
        if self.running_s is not None:
            return f'learning for {self.running_s:.0f} s'
        return self.waiting or 'keeping a diary'

    def _numbers(self) -> dict[str, str]:
        """Give what stands behind it."""
        memory = self.memory
        numbers = {
            'mode': self.mode,
            'last_day': f'{memory.judged}: {memory.verdict}' if memory.verdict else 'none yet',
            'last_change': memory.change or 'none yet',
        }
        if memory.offered:
            report = str(self.offered.with_suffix('.html'))
            numbers |= {'offered': str(self.offered), 'why': memory.why, 'report': report}
        if self.diary is not None:
            files = self.diary.files
            numbers |= {
                'days': str(len(files.ended())),
                'megabytes': f'{files.used() / 1e6:.1f}',
                'today': files.path.name if files.path else 'none yet',
                'cells': str(self.diary.rows),
            }
        return numbers

    def _rest(self) -> None:
        """Leave the day where it is; it and its judgement go on at the next beginning."""
        self._end_job()
        diary, self.diary = self.diary, None
        if diary is not None:
            diary.end()

    def end(self) -> bool:
        """End with the node."""
        self._rest()
        return False


def _dated(what: str) -> str:
    """Begin a sentence with the present day, UTC."""
    return f'{datetime.now(timezone.utc).date()}: {what}'
