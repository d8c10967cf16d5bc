"""Jobs in a process of their own, and the service ~/calibrate, which starts one."""

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import Any

from wrist_ft_comp import ONE_THREAD
from wrist_ft_comp.drift.drift_model import StoredModel
from wrist_ft_comp.errors import CalibrationRefusedError, RecordingError
from wrist_ft_comp.fit.settings import CalibrationSettings, IdentificationSettings
from wrist_ft_comp.jobs.request import (
    CalibrationJob,
    encode_job,
    Learning,
    Minute,
    UNTIL_CLOSED,
)
from wrist_ft_comp.node.recording import Recorder, RecordService
from wrist_ft_comp.ros.node_log import NodeLog, OK, Status, WARN
from wrist_ft_comp.ros.part import LongService, Work
from wrist_ft_comp.signals import NANOSECONDS, Topics
from wrist_ft_comp.stored.model_file import restore_model
from wrist_ft_comp.stored.model_store import ModelStore
from wrist_ft_comp.stored.payload_file import PAYLOADS

#: Runs a job that comes on standard input, and ends when that is closed, which it also is when
#: this process is killed.
COMMAND = (sys.executable, '-m', 'wrist_ft_comp.jobs.calibration', UNTIL_CLOSED)
_END_TIMEOUT_S = 5.0
#: Priority of a lesson, for which nobody waits.
_LOWEST = 19


class CalibrationProcess:
    """One running calibration; OSError when it cannot be started."""

    def __init__(self, job: CalibrationJob) -> None:
        self._process = process = subprocess.Popen(  # noqa: S603 -- our own command line
            COMMAND,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            bufsize=0,
            env={**os.environ, **ONE_THREAD},
            start_new_session=True,  # Ctrl-C in the terminal is the node's to handle
        )
        if job.learning is not None:
            os.setpriority(os.PRIO_PROCESS, self.pid, _LOWEST)
        self._pipes: list[Any] = [process.stdin, process.stdout, process.stderr]
        entrance, *exits = self._pipes
        #: What came so far, per pipe.
        self._read: dict[int, list[bytes]] = {pipe.fileno(): [] for pipe in exits}
        for pipe in self._pipes:
            os.set_blocking(pipe.fileno(), False)
        #: What the process has not taken of its job; a pipe holds 64 kB until it is read.
        self._job = encode_job(job).encode() + b'\n'
        self._hand_on(entrance)

    def _hand_on(self, entrance: Any) -> None:
        """Hand on as much of the job as the pipe takes."""
        with suppress(BrokenPipeError):  # a process that has died says so in poll
            self._job = self._job[entrance.write(self._job) or 0 :]

    @property
    def pid(self) -> int:
        """Process id, which is also its group's."""
        return self._process.pid

    def poll(self) -> dict[str, Any] | None:
        """Give the outcome, as jobs.calibration writes it; None while it runs."""
        ended = self._process.poll()
        if self._job:
            self._hand_on(self._pipes[0])
        for pipe, parts in self._read.items():
            with suppress(BlockingIOError):  # so that a full pipe never stops the process
                while part := os.read(pipe, 1 << 16):
                    parts.append(part)
        if ended is None:
            return None
        output, errors = (
            b''.join(parts).decode(errors='replace') for parts in self._read.values()
        )
        self._close()
        try:
            outcome: dict[str, Any] = json.loads(output)
        except ValueError:
            last_line = errors.strip().rsplit('\n', 1)[-1]
            how = f'by signal {-ended}' if ended < 0 else f'with code {ended}'
            return {
                'success': False,
                'message': f'The calibration process was ended {how} and gave no result '
                f'({last_line or "it said nothing"}). The running model stays; call again.',
            }
        return outcome

    def end(self) -> None:
        """Stop it, if it runs."""
        for number in (signal.SIGTERM, signal.SIGKILL):
            with suppress(ProcessLookupError):
                os.killpg(self.pid, number)
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_END_TIMEOUT_S)
                break
        self._close()

    def _close(self) -> None:
        """Close the pipes."""
        for pipe in self._pipes:
            with suppress(BrokenPipeError):  # what was buffered for a process that died
                pipe.close()


@dataclass(frozen=True, eq=False)
class JobMaker:
    """Makes jobs; ``topics`` takes the present parameters and tells topics by their full names."""

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

    def learning(self, days: Sequence[Path], champion: Path | None, since: str) -> CalibrationJob:
        """Ask for what can be learnt from days."""
        chosen = {**self.settings(), 'calibration.reference': 'payload'}
        kept_mb = 0.8 * chosen['learning.max_mb']  # leaves room for the day that goes on
        learning = Learning(champion, since, chosen['learning.keep_days'], kept_mb)
        return replace(self._make(tuple(days), chosen, skip_unusable=True), learning=learning)

    def identification(self, minute: Minute) -> CalibrationJob:
        """Ask for what ``~/identify_payload`` does."""
        output, topics = self.store.directory / 'models' / PAYLOADS, self._topics(self.settings())
        return CalibrationJob((), output, topics=topics, minute=minute)

    def _make(
        self, recordings: tuple[Path, ...], chosen: dict[str, Any], *, skip_unusable: bool
    ) -> CalibrationJob:
        """Make a job."""
        output = self.store.new_model_path()
        settings = CalibrationSettings(
            reference=chosen['calibration.reference'],
            min_temperature_span_k=chosen['calibration.min_temperature_span'],
            identification=IdentificationSettings(method=chosen['calibration.method']),
        )
        period_s = self.recorder.period_ns / NANOSECONDS
        return CalibrationJob(
            recordings, output, settings, period_s, self._topics(chosen),
            skip_unusable=skip_unusable, report=output.with_suffix('.html'),
        )  # fmt: skip


def run_job(job: CalibrationJob) -> Generator[None, None, dict[str, Any]]:
    """Wait for a process that runs a job; CalibrationRefusedError where it refuses, or can't."""
    try:
        process = CalibrationProcess(job)
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

    name, title, severe = '~/calibrate', 'calibration', True
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
        elif self._recording.failure:
            level, message = WARN, self._recording.failure
        elif self.refused:
            level, message = WARN, 'the last one was refused; see "last"'
        yield Status(self.title, level, message, numbers)

    def _busy(self) -> str:
        """Say that one runs."""
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
