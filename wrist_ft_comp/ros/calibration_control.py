"""The service ~/calibrate: from parameters to a process, from its outcome to an answer."""

from pathlib import Path
import time
from typing import Any, TYPE_CHECKING

from wrist_ft_comp import (
    CalibrationRefusedError,
    RecordingError,
    WristFtCompError,
)
from wrist_ft_comp.core.calibration import CalibrationSettings
from wrist_ft_comp.core.identification import IdentificationSettings
from wrist_ft_comp.core.recording import NANOSECONDS
from wrist_ft_comp.files.calibration_job import CalibrationJob
from wrist_ft_comp.files.model_file import restore_model
from wrist_ft_comp.files.recordings import Topics
from wrist_ft_comp.ros.calibration_process import CalibrationProcess
from wrist_ft_comp.ros.compensator_parameters import PARAMETERS
from wrist_ft_comp.ros.deferred_service import Reply
from wrist_ft_comp.ros.parameters import values

if TYPE_CHECKING:
    from wrist_ft_comp.ros.compensator_node import CompensatorNode


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
