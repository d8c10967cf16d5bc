"""Makes jobs from the parameters, waits for their processes, and serves ~/calibrate."""

from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
import sys
import time
from typing import Any, get_args

from wrist_ft_comp.drift.drift_model import StoredModel
from wrist_ft_comp.errors import CalibrationRefusedError, RecordingError
from wrist_ft_comp.fit.settings import CalibrationSettings
from wrist_ft_comp.jobs.process import JobProcess
from wrist_ft_comp.jobs.request import CalibrationJob, Learning, Minute
from wrist_ft_comp.node.recording import Recorder, RecordService
from wrist_ft_comp.ros.diagnostics import OK, Status, WARN
from wrist_ft_comp.ros.node_log import NodeLog
from wrist_ft_comp.ros.parameters import Parameter
from wrist_ft_comp.ros.part import LongService, Work
from wrist_ft_comp.signals import NANOSECONDS, Reference, Topics
from wrist_ft_comp.stored.model_file import restore_model
from wrist_ft_comp.stored.model_store import HistoryEntry, ModelStore
from wrist_ft_comp.stored.payload_file import PAYLOADS

#: The process that runs a job.
COMMAND = (sys.executable, '-m', 'wrist_ft_comp.jobs.calibration')


def start_job(job: CalibrationJob) -> JobProcess:
    """Start a process that runs a job; OSError when it cannot be started."""
    return JobProcess(COMMAND, job)


@dataclass(frozen=True, eq=False)
class JobMaker:
    """Makes jobs from the parameters; ``topics`` gives the full names of topics for them."""

    store: ModelStore
    settings: Callable[[], dict[str, Any]]
    _topics: Callable[[dict[str, Any]], Topics]
    recorder: Recorder

    def calibration(self) -> CalibrationJob:
        """Ask for what ``~/calibrate`` does."""
        chosen = self.settings()
        named = tuple(self.store.locate(path) for path in chosen['calibration.recordings'])
        recordings = named or tuple(self.store.recordings())
        if not recordings:
            raise RecordingError(
                f'There is no recording in {self.store.directory / "recordings"}. Record a '
                'warm-up with ~/record, or set calibration.recordings.'
            )
        return self._make(recordings, chosen, skip_unusable=not named)

    def learning(self, days: Sequence[Path], history: Sequence[HistoryEntry]) -> CalibrationJob:
        """Ask for what can be learnt from days."""
        chosen = {**self.settings(), 'calibration.reference': 'payload'}
        kept_mb = 0.8 * chosen['learning.max_mb']  # leaves room for the day that goes on
        learning = Learning(tuple(history), max_mb=kept_mb)
        return replace(self._make(tuple(days), chosen, skip_unusable=True), learning=learning)

    def identification(self, minute: Minute) -> CalibrationJob:
        """Ask for what ``~/identify_payload`` does."""
        output, topics = self.store.directory / 'models' / PAYLOADS, self._topics(self.settings())
        return CalibrationJob((), output, topics=topics, minute=minute)

    def _make(
        self, recordings: tuple[Path, ...], chosen: dict[str, Any], *, skip_unusable: bool
    ) -> CalibrationJob:
        output = self.store.new_model_path()
        settings = CalibrationSettings(reference=chosen['calibration.reference'])
        period_s = self.recorder.period_ns / NANOSECONDS
        return CalibrationJob(
            recordings, output, settings, period_s, self._topics(chosen),
            skip_unusable=skip_unusable, report=output.with_suffix('.html'),
        )  # fmt: skip


def run_job(job: CalibrationJob) -> Generator[None, None, dict[str, Any]]:
    """Run a job in a process, and wait; CalibrationRefusedError where it refuses or fails."""
    try:
        process = start_job(job)
    except OSError as error:
        raise CalibrationRefusedError(
            f'The calibration cannot be started: {error}. Mend that, then call again.'
        ) from error
    try:
        while (outcome := process.poll()) is None:
            yield
    except GeneratorExit:
        process.end()
        raise
    if not outcome['success']:
        raise CalibrationRefusedError(outcome['message'])
    return outcome


@dataclass(eq=False)
class CalibrateService(LongService):
    """Runs a calibration in a process of its own; ``go_live`` returns a warning, or nothing."""

    _make_request: Callable[[], CalibrationJob]
    _go_live: Callable[[StoredModel], str]
    _recording: RecordService
    _log: NodeLog
    _begun_s: float = 0.0

    title, name, severe = 'calibration', '~/calibrate', True
    purpose = 'fits the recordings, saves the model and makes it live; answers when done'
    parameters = (
        Parameter(
            'calibration.recordings', (),
            "Recordings to calibrate from; empty takes the node's own, the newest ten. Set at run "
            'time, they must lie inside data_directory.', element=str),
        Parameter(
            'calibration.reference', CalibrationSettings().reference,
            'The true wrench while recording: zero (unloaded), unknown but constant (constant), '
            'the weight of an unknown payload, found by the specific force (payload), or that on '
            'wrench_reference (recorded).',
            choices=get_args(Reference)),
    )  # fmt: skip
    done, not_done = 'calibrated: ', 'not calibrated: '
    unchanged = '; the model is unchanged'

    @property
    def running_s(self) -> float | None:
        """How long a calibration has been running, s; None when none is."""
        return None if self._running is None else time.monotonic() - self._begun_s

    def statuses(self) -> Iterator[Status]:
        """Report recording, running calibration, and last outcome."""
        recording = self._recording.current
        numbers = {
            'last': self.last_outcome or 'none yet',
            'last_refusal': self._log.last_refusal or 'none yet',
        }
        level, message = OK, 'recording' if recording else 'idle'
        if recording is not None:
            numbers['recording'] = str(self._recording.path)
            numbers['recorded_cells'] = str(recording.rows)
        if self.running_s is not None:
            message = f'running for {self.running_s:.0f} s'
        elif trouble := self._recording.failure or self._recording.doubt():
            level, message = WARN, trouble
        elif self.refused:
            level, message = WARN, 'the last one was refused; see "last"'
        yield Status(self.title, level, message, numbers)

    def _busy(self) -> str:
        return f'A calibration has been running for {self.running_s:.0f} s'

    def _work(self) -> Work:
        """Wait for the process, and make its model live."""
        self._begun_s = time.monotonic()
        outcome = yield from run_job(self._make_request())
        message: str = outcome['message']
        problem = self._go_live(
            restore_model(Path(outcome['path']), outcome['sha256'], outcome['document'])
        )
        return f'{message}\nwarning: {problem}' if problem else message
