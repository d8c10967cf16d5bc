"""The service ~/calibrate: from parameters to a process, from its outcome to an answer."""

from contextlib import suppress
import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import Any, TYPE_CHECKING

from wrist_ft_comp import ONE_THREAD
from wrist_ft_comp.calibration.settings import CalibrationSettings, IdentificationSettings
from wrist_ft_comp.errors import CalibrationRefusedError, RecordingError, WristFtCompError
from wrist_ft_comp.files.bag import Topics
from wrist_ft_comp.files.job_request import CalibrationJob, encode_job, UNTIL_CLOSED
from wrist_ft_comp.files.model_file import restore_model
from wrist_ft_comp.model.signals import NANOSECONDS
from wrist_ft_comp.ros.parameters import PARAMETERS, values
from wrist_ft_comp.ros.services.deferred import Reply

if TYPE_CHECKING:
    from wrist_ft_comp.ros.compensator_node import CompensatorNode

#: What runs a job that comes on standard input, and ends when that is closed: also when this
#: process is killed and cannot say so.
COMMAND = (sys.executable, '-m', 'wrist_ft_comp.cli.calibration_job', UNTIL_CLOSED)


_END_TIMEOUT_S = 5.0


class CalibrationProcess:
    """
    One running calibration.

    Parameters
    ----------
    job : CalibrationJob
        What to do.

    Raises
    ------
    OSError
        When the process cannot be started.

    """

    def __init__(self, job: CalibrationJob) -> None:
        self._process = subprocess.Popen(  # noqa: S603 -- our own command line
            COMMAND,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={**os.environ, **ONE_THREAD},
            start_new_session=True,  # Ctrl-C in the terminal is the node's to handle
        )
        _, output, errors = self._pipes()
        for pipe in (output, errors):
            os.set_blocking(pipe.fileno(), False)
        self._read: tuple[list[bytes], list[bytes]] = ([], [])
        self._give(encode_job(job).encode())

    def _pipes(self) -> tuple[Any, Any, Any]:
        """Return standard input, output and error."""
        return self._process.stdin, self._process.stdout, self._process.stderr

    def _give(self, job: bytes) -> None:
        """Write the job as a line; a process that has died already says so in poll."""
        entrance = self._pipes()[0]
        with suppress(BrokenPipeError):
            entrance.write(job + b'\n')
            entrance.flush()

    @property
    def pid(self) -> int:
        """Process id, which is also its group's."""
        return self._process.pid

    def poll(self) -> dict[str, Any] | None:
        """
        Look whether it has ended.

        Returns
        -------
        dict or None
            None while it runs; then ``success``, ``message`` and, on success, ``path``,
            ``sha256`` and ``document`` of the model.

        """
        ended = self._process.poll()
        for pipe, parts in zip(self._pipes()[1:], self._read, strict=True):
            _drain(pipe.fileno(), parts)
        if ended is None:
            return None
        output, errors = (b''.join(parts).decode(errors='replace') for parts in self._read)
        self._close()
        try:
            outcome: dict[str, Any] = json.loads(output)
        except ValueError:
            last = errors.strip().rsplit('\n', 1)[-1]
            how = f'by signal {-ended}' if ended < 0 else f'with code {ended}'
            return {
                'success': False,
                'message': f'The calibration process was ended {how} and gave no result '
                f'({last or "it said nothing"}). The running model stays; call again.',
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
        for pipe in self._pipes():
            with suppress(BrokenPipeError):  # what was buffered for a process that died
                pipe.close()


def _drain(pipe: int, parts: list[bytes]) -> None:
    """Read what is there, so that a full pipe never stops the process."""
    with suppress(BlockingIOError):
        while part := os.read(pipe, 1 << 16):
            parts.append(part)


class CalibrationControl:
    """
    Owns the process that makes the next model, if one runs.

    Parameters
    ----------
    node : CompensatorNode
        The owner.

    """

    def __init__(self, node: 'CompensatorNode') -> None:
        #: What the last one answered; empty before the first.
        self.last_outcome = ''
        #: Whether the last one changed nothing.
        self.refused = False
        self._node = node
        self._running: tuple[CalibrationProcess, Reply, float] | None = None

    @property
    def running_s(self) -> float | None:
        """How long a calibration has been running, s; None when none is."""
        return None if self._running is None else time.monotonic() - self._running[2]

    def on_request(self, _request: Any, reply: Reply) -> None:
        """Start a calibration; the answer comes when it is done."""
        if self._running is not None:
            reply(
                success=False,
                message=f'A calibration has been running for {self.running_s:.0f} s; wait for its '
                'answer, then call again.',
            )
            return
        try:
            self._running = (CalibrationProcess(self._job()), reply, time.monotonic())
        except WristFtCompError as error:
            self._refuse(str(error), reply)
        except OSError as error:
            why = f'The calibration cannot be started: {error}. Mend that, then call again.'
            self._refuse(why, reply)

    def _job(self) -> CalibrationJob:
        """Build the job from the parameters."""
        node = self._node
        given = values(node, PARAMETERS)
        named = tuple(node.store.locate(path) for path in given['calibration.recordings'])
        recordings = named or tuple(node.store.recordings())
        if not recordings:
            raise RecordingError(
                f'There is no recording in {node.store.directory / "recordings"}. Record a '
                'warm-up with ~/record, or set calibration.recordings.'
            )
        output = node.store.new_model_path()
        return CalibrationJob(
            recordings=recordings,
            output=output,
            report=output.with_suffix('.html'),
            settings=CalibrationSettings(
                reference=given['calibration.reference'],
                min_temperature_span_k=given['calibration.min_temperature_span'],
                identification=IdentificationSettings(method=given['calibration.method']),
            ),
            period_s=node.compensator.tracker.grid.period_ns / NANOSECONDS,
            topics=Topics(
                wrench=node.raw_subscription.topic_name,
                temperatures=tuple(s.topic_name for s in node.temperature_subscriptions),
                reference=node.resolve_topic_name('wrench_reference'),
            ),
            skip_unusable=not named,
        )

    def poll(self) -> None:
        """Look whether the calibration is done; if so, swap its model in and answer."""
        if self._running is None:
            return
        process, reply, _ = self._running
        outcome = process.poll()
        if outcome is None:
            return
        self._running = None
        try:
            message = self._take(outcome)
        except WristFtCompError as error:
            self._refuse(str(error), reply)
            return
        self.last_outcome, self.refused = message, False
        self._node.console.info(f'calibrated: {message}')
        reply(success=True, message=message)

    def _take(self, outcome: dict[str, Any]) -> str:
        """Make the model of a successful outcome live; return what to answer."""
        if not outcome['success']:
            raise CalibrationRefusedError(outcome['message'])
        stored = restore_model(Path(outcome['path']), outcome['sha256'], outcome['document'])
        problem = self._node.model.take(stored)
        message: str = outcome['message']
        return f'{message}\nwarning: {problem}' if problem else message

    def _refuse(self, why: str, reply: Reply) -> None:
        """Answer that nothing changed, and why."""
        self.last_outcome, self.refused = why, True
        self._node.note_refusal('~/calibrate', why)
        self._node.console.error(f'not calibrated: {why}')
        reply(success=False, message=why)

    def end(self) -> bool:
        """Stop a running calibration; tell whether its asker was answered just now."""
        if self._running is None:
            return False
        process, reply, _ = self._running
        self._running = None
        process.end()
        reply(success=False, message='The node is shutting down; the model is unchanged.')
        return True
