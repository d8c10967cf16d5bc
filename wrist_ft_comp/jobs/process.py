"""
A process of its own for a job: ``JobProcess`` starts and watches it, ``serve`` runs in it.

The job is a line of JSON on standard input, the outcome is JSON on standard output. The process
ends when standard input is closed, as it is when the process that started it is killed.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
import json
import os
import signal
import subprocess
import sys
import threading
from typing import Any

from wrist_ft_comp import ONE_THREAD
from wrist_ft_comp.jobs.request import CalibrationJob, decode_job, encode_job

#: A process that was asked to end is killed after this time, s.
_END_TIMEOUT_S = 5.0
#: Nice value of a job for which somebody waits.
_LOW_PRIORITY = 10
#: Nice value of a learning job, for which nobody waits.
_LOWEST_PRIORITY = 19


class JobProcess:
    """A running job, as seen by the process that waits; OSError when it cannot be started."""

    def __init__(self, command: Sequence[str], job: CalibrationJob) -> None:
        self._process = process = subprocess.Popen(  # noqa: S603 -- our own command line
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            bufsize=0,
            env={**os.environ, **ONE_THREAD},
            start_new_session=True,  # Ctrl-C in the terminal is the node's to handle
        )
        if job.learning is not None:
            os.setpriority(os.PRIO_PROCESS, self.pid, _LOWEST_PRIORITY)
        self._pipes: list[Any] = [process.stdin, process.stdout, process.stderr]
        entrance, *exits = self._pipes
        #: Bytes that were read, per pipe.
        self._read: dict[int, list[bytes]] = {pipe.fileno(): [] for pipe in exits}
        for pipe in self._pipes:
            os.set_blocking(pipe.fileno(), False)
        #: Rest of the job that the process has not read; a pipe holds 64 kB.
        self._job = encode_job(job).encode() + b'\n'
        self._write_job(entrance)

    def _write_job(self, entrance: Any) -> None:
        """Write as much of the job as the pipe takes."""
        with suppress(BrokenPipeError):  # a process that has died says so in poll
            self._job = self._job[entrance.write(self._job) or 0 :]

    @property
    def pid(self) -> int:
        """Process id, which is also its group's."""
        return self._process.pid

    def poll(self) -> dict[str, Any] | None:
        """Give the outcome, as ``serve`` writes it; None while the job runs."""
        ended = self._process.poll()
        if self._job:
            self._write_job(self._pipes[0])
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
        for pipe in self._pipes:
            with suppress(BrokenPipeError):  # what was buffered for a process that died
                pipe.close()


def serve(answer: Callable[[CalibrationJob], dict[str, Any]]) -> int:
    """Run one job from standard input, at low priority, and write its outcome; gives 0."""
    os.nice(_LOW_PRIORITY)
    text = sys.stdin.readline()
    threading.Thread(target=_end_when_closed, daemon=True).start()
    json.dump(answer(decode_job(text)), sys.stdout)
    return 0


def _end_when_closed() -> None:
    """End the process when standard input is closed: nobody waits for it any more."""
    # sys.stdin would not do: its lock would still be held when the interpreter ends.
    while os.read(sys.stdin.fileno(), 1024):
        pass
    os.kill(os.getpid(), signal.SIGTERM)
