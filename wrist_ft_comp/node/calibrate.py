"""The part that answers ~/calibrate, and says how recording and calibration stand."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
import time
from typing import get_args

from wrist_ft_comp.drift.drift_model import StoredModel
from wrist_ft_comp.fit.settings import CalibrationSettings
from wrist_ft_comp.jobs.job_process import CalibrationJob
from wrist_ft_comp.node.jobs import run_job
from wrist_ft_comp.node.recorder import RecordService
from wrist_ft_comp.recording import Reference
from wrist_ft_comp.ros.diagnostics import NodeLog, OK, Status, WARN
from wrist_ft_comp.ros.hub import LongService, Work
from wrist_ft_comp.ros.parameters import Parameter
from wrist_ft_comp.stored.model_file import restore_model


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
