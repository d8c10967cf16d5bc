"""
A process of its own for a job, as the node sees it; ``entry`` is what runs in it.

The job is JSON on standard input, the outcome is JSON on standard output. Its only argument is the
process id of the node, with which it ends.
"""

from collections.abc import Sequence
from contextlib import suppress
import json
import os
import signal
import subprocess
from threading import Thread
from typing import Any

from wrist_ft_comp import ONE_THREAD
from wrist_ft_comp.jobs.request import CalibrationJob, encode_job

#: A process that was asked to end is killed after this time, s.
_END_TIMEOUT_S = 5.0
#: Nice value of a learning job, for which nobody waits.
_LOWEST_PRIORITY = 19


class JobProcess:
    """A running job; OSError when it cannot be started."""

    def __init__(self, command: Sequence[str], job: CalibrationJob) -> None:
        self._process = subprocess.Popen(  # noqa: S603 -- our own command line
            (*command, str(os.getpid())),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={**os.environ, **ONE_THREAD},
            start_new_session=True,  # Ctrl-C in the terminal is the node's to handle
        )
        if job.learning is not None:
            os.setpriority(os.PRIO_PROCESS, self.pid, _LOWEST_PRIORITY)
        self._output, self._errors = b'', b''
        # A job of many days is more than a pipe holds, and no wrench waits until it is read.
        self._exchange = Thread(target=self._communicate, args=(job,), daemon=True)
        self._exchange.start()

    def _communicate(self, job: CalibrationJob) -> None:
        self._output, self._errors = self._process.communicate(encode_job(job).encode())

    @property
    def pid(self) -> int:
        """Process id, which is also its group's."""
        return self._process.pid

    def poll(self) -> dict[str, Any] | None:
        """Give the outcome, as ``entry`` writes it; None while the job runs."""
        if self._exchange.is_alive():
            return None
        try:
            outcome: dict[str, Any] = json.loads(self._output)
        except ValueError:
            last_line = self._errors.decode(errors='replace').strip().rsplit('\n', 1)[-1]
            code = self._process.returncode
            how = f'by signal {-code}' if code < 0 else f'with code {code}'
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
        self._exchange.join(_END_TIMEOUT_S)
