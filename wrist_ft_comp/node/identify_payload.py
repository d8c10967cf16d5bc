"""The service ~/identify_payload: what is mounted, from a minute of motion."""

from collections.abc import Iterator
from dataclasses import dataclass, field
import time

import numpy as np

from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.jobs.request import Minute
from wrist_ft_comp.node.calibrate import JobMaker, run_job
from wrist_ft_comp.node.external_wrench import ExternalWrench, Shelf
from wrist_ft_comp.payload.live_weight import Force
from wrist_ft_comp.payload.motion import CELL_S, DURATION_S, MotionCollector
from wrist_ft_comp.payload.weight import ForceFrame
from wrist_ft_comp.ros.deferred import Reply
from wrist_ft_comp.ros.long_service import LongService, Work
from wrist_ft_comp.ros.node_log import NodeLog
from wrist_ft_comp.stream.compensator import Compensator

#: Wrenches or specific force that stay away for so long by a steady clock end it, s.
_PATIENCE_S = 10.0


@dataclass(eq=False)
class IdentifyService(LongService):
    """Collects wrenches for a minute, in which a process finds a payload; the answer names it."""

    _compensator: Compensator
    _external: ExternalWrench
    _shelf: Shelf
    _jobs: JobMaker
    _node_name: str
    _log: NodeLog
    _collector: MotionCollector = field(default_factory=MotionCollector)
    _heard_s: float = 0.0

    name, title = '~/identify_payload', 'identification'
    done = 'identified: '

    @property
    def progress(self) -> float | None:
        """Tell how much of the minute has passed, 0 to 1; None when none runs."""
        return None if self._running is None else self._collector.share

    def _busy(self) -> str:
        """Say that one is being identified."""
        passed = self._collector.share * DURATION_S
        return f'A payload is being identified for {passed:.0f} of {DURATION_S:g} s'

    def _add(self, stamp_ns: int, wrench: list[float], force: Force, speed: float) -> None:
        """Take one wrench less drift, and its specific force."""
        if self._collector.share < 1:
            self._collector.add(stamp_ns, wrench, force, speed)
            self._heard_s = time.monotonic()

    def _work(self) -> Work:
        """Collect for a minute of stamps, and say what is mounted and how to use it."""
        if self._external.forces.newest is None:
            raise CalibrationRefusedError(
                'No specific force has come. Set gravity.source to imu or tf, and look whether '
                'that is published.'
            )
        if not self._compensator.compensating:
            raise CalibrationRefusedError(
                'No drift model runs, and drift would be taken for weight. Calibrate first, or '
                'wait for the first temperature.'
            )
        self._collector, self._heard_s = MotionCollector(), time.monotonic()
        self._external.collect(self._add)
        try:
            yield from self._wait()
        finally:
            self._external.collect(None)
        sensor = self._shelf.sensor(self._external.gravity.frames())
        known = None if sensor is None else (sensor.bias.tolist(), sensor.scale.tolist())
        minute = Minute(self._collector.cells, CELL_S, tuple(self._shelf.payloads()), known)
        outcome = yield from run_job(self._jobs.identification(minute))
        frame = ForceFrame(np.array(outcome['rotation']))
        other = self._external.disagreement(frame)
        return (
            f'{outcome["message"]} Specific force is {frame}{other and "; "}{other}. Use it: ros2 '
            f'param set {self._node_name} payload.active {outcome["name"]}'
        )

    def _wait(self) -> Iterator[None]:
        """Wait until the minute is over; refuse when it can't be any more."""
        tare = self._compensator.external_tare
        while self._collector.share < 1 and self._compensator.external_tare is tare:
            if time.monotonic() - self._heard_s > _PATIENCE_S:
                raise CalibrationRefusedError(
                    f'Wrenches with specific force have stayed away for {_PATIENCE_S:g} s. Look '
                    'at the diagnostics, input and payload, then call again.'
                )
            yield
        if self._compensator.external_tare is not tare:  # which stepped the wrenches
            raise CalibrationRefusedError('The tare or the model changed meanwhile. Call again.')

    def _answer(self, reply: Reply, message: str, *, success: bool) -> None:
        """Answer, after what every refusal begins with."""
        said = message if success else f'No payload was identified: {message}'
        super()._answer(reply, said, success=success)
