"""A calibration beside the stream: a process of its own, at low priority."""

import json
import os
import signal
import subprocess
import sys
from contextlib import suppress
from typing import Any

from wrist_ft_comp.files.calibration_job import CalibrationJob, encode_job

_END_TIMEOUT_S = 5.0


class CalibrationProcess:
    """
    One running calibration.

    Parameters
    ----------
    job : CalibrationJob
        What to do.

    """

    def __init__(self, job: CalibrationJob) -> None:
        self._process = subprocess.Popen(
            [sys.executable, '-m', 'wrist_ft_comp.files.calibration_job'],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C in the terminal is the node's to handle
        )
        assert self._process.stdin is not None  # noqa: S101 -- it is a pipe
        with suppress(BrokenPipeError):  # then the process died, and poll says how
            self._process.stdin.write(encode_job(job))
            self._process.stdin.close()
        self._process.stdin = None
        assert self._process.stdout is not None  # noqa: S101 -- it is a pipe
        assert self._process.stderr is not None  # noqa: S101 -- it is a pipe
        self._parts: tuple[list[bytes], list[bytes]] = ([], [])
        self._pipes = (self._process.stdout.fileno(), self._process.stderr.fileno())
        for pipe in self._pipes:
            os.set_blocking(pipe, False)

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
        for pipe, parts in zip(self._pipes, self._parts, strict=True):
            _drain(pipe, parts)
        if ended is None:
            return None
        output, errors = (b''.join(parts).decode(errors='replace') for parts in self._parts)
        self._close()
        try:
            outcome: dict[str, Any] = json.loads(output)
        except ValueError:
            last = errors.strip().rsplit('\n', 1)[-1]
            return {
                'success': False,
                'message': f'The calibration process ended with code {ended} and no result '
                f'({last or "no message"}). The running model stays; call again.',
            }
        return outcome

    def end(self) -> None:
        """Stop it, if it runs."""
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGTERM)
        try:
            self._process.wait(_END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._close()

    def _close(self) -> None:
        """Close the pipes."""
        for pipe in (self._process.stdout, self._process.stderr):
            if pipe is not None:
                pipe.close()


def _drain(pipe: int, parts: list[bytes]) -> None:
    """Read what is there, so that a full pipe never stops the process."""
    with suppress(BlockingIOError):
        while part := os.read(pipe, 1 << 16):
            parts.append(part)
