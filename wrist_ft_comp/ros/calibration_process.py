"""A calibration beside the stream: a process of its own, at low priority."""

from contextlib import suppress
import json
import os
import signal
import subprocess
import sys
from typing import Any

from wrist_ft_comp import ONE_THREAD
from wrist_ft_comp.files.calibration_job import CalibrationJob, encode_job, UNTIL_CLOSED

#: What runs a job that comes on standard input, and ends when that is closed: also when this
#: process is killed and cannot say so.
COMMAND = (sys.executable, '-m', 'wrist_ft_comp.files.calibration_job', UNTIL_CLOSED)
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
