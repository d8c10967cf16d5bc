"""
A job, and a process of its own for it, as the node sees it; ``job_main`` is what runs in it.

The job is JSON on standard input, the outcome is JSON on standard output. Its only argument is the
process id of the node, with which it ends.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
import json
import os
from pathlib import Path
import signal
import subprocess
from threading import Thread
import time
from typing import Any

from wrist_ft_comp import ONE_THREAD
from wrist_ft_comp.fit.settings import CalibrationSettings
from wrist_ft_comp.recording import Topics
from wrist_ft_comp.stored.node_folder import HistoryEntry
from wrist_ft_comp.stored.safe_file import to_plain

#: A process that was asked to end is killed after this time, s.
_END_TIMEOUT_S = 5.0


@dataclass(frozen=True)
class Minute:
    """A minute of motion, in which a job finds the payload; the job's output is payloads.json."""

    #: Means over cells, as payload/identify_payload.py takes them.
    cells: Sequence[tuple[float, ...]]
    #: Length of a cell, s.
    period_s: float
    #: Names of payloads that are in use elsewhere.
    taken: tuple[str, ...] = ()
    #: Bias and scale of the accelerometer where a calibration has found them.
    sensor: tuple[Sequence[float], Sequence[float]] | None = None


@dataclass(frozen=True)
class CalibrationJob:
    """What to calibrate from, how, and where the model goes."""

    #: Bags or CSV files.
    recordings: tuple[Path, ...]
    #: Model file to make or replace.
    output: Path
    settings: CalibrationSettings = field(default_factory=CalibrationSettings)
    #: Thermal period h, s; 0 takes what fits the recordings.
    period_s: float = 1.0
    topics: Topics = field(default_factory=Topics)
    #: Leave out, with a warning, recordings that cannot be read, have other thermometers than
    #: topics names, or lack the reference; as long as one is left.
    skip_unusable: bool = False
    #: Where a report goes, if one is wanted.
    report: Path | None = None
    #: For a node that learns by itself, from all days that have ended, oldest first: models that
    #: were live, the live one last. Days before a person's last decision are no evidence for a
    #: change any more. None for all other jobs.
    history: tuple[HistoryEntry, ...] | None = None
    #: How large the recordings of days may be together, MB.
    max_mb: float = 500.0
    #: For ~/identify_payload: there are no recordings then.
    minute: Minute | None = None


class JobProcess:
    """A running job; OSError when it cannot be started."""

    def __init__(self, command: Sequence[str], job: CalibrationJob) -> None:
        text = json.dumps(to_plain(job), default=str)  # which from_plain reads
        pipe = subprocess.PIPE
        # In a session of its own, because Ctrl-C in the terminal is the node's to handle.
        self._process = subprocess.Popen(  # noqa: S603 -- our own command line
            (*command, str(os.getpid())), stdin=pipe, stdout=pipe, stderr=pipe,
            env={**os.environ, **ONE_THREAD}, start_new_session=True)  # fmt: skip
        if job.history is not None:
            os.setpriority(os.PRIO_PROCESS, self._process.pid, 19)  # nobody waits for it
        self._output, self._errors = b'', b''
        # A job of many days is more than a pipe holds, and no wrench waits until it is read.
        self._exchange = Thread(target=self._communicate, args=(text,), daemon=True)
        self._exchange.start()

    def _communicate(self, text: str) -> None:
        self._output, self._errors = self._process.communicate(text.encode())

    def poll(self) -> dict[str, Any] | None:
        """Give the outcome, as ``job_main`` writes it; None while the job runs."""
        if self._exchange.is_alive():
            return None
        with suppress(ValueError):
            outcome: dict[str, Any] = json.loads(self._output)
            return outcome
        last_line = self._errors.decode(errors='replace').strip().rsplit('\n', 1)[-1]
        code = self._process.returncode
        how = f'by signal {-code}' if code < 0 else f'with code {code}'
        message = (
            f'The calibration process was ended {how} and gave no result '
            f'({last_line or "it said nothing"}). The running model stays; call again.'
        )
        return {'success': False, 'message': message}

    def end(self) -> None:
        """Stop it, if it runs."""
        for number in (signal.SIGTERM, signal.SIGKILL):
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, number)  # its group's id, too
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_END_TIMEOUT_S)
                break
        self._exchange.join(_END_TIMEOUT_S)


def end_with(parent: int) -> None:
    """End this process when the one that started it has ended: nobody waits for it any more."""
    while os.getppid() == parent:
        time.sleep(0.5)
    os.kill(os.getpid(), signal.SIGTERM)
