"""The part that answers ~/identify_payload, from a minute of motion."""

from collections.abc import Iterator
from dataclasses import dataclass
import time

import numpy as np

from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.jobs.request import Minute
from wrist_ft_comp.node.calibrate import JobMaker, run_job
from wrist_ft_comp.node.external_wrench import ExternalWrench, PayloadFiles
from wrist_ft_comp.payload.motion_collector import CELL_S, DURATION_S, MotionCollector
from wrist_ft_comp.payload.weight import ForceFrame
from wrist_ft_comp.ros.node_log import NodeLog
from wrist_ft_comp.ros.part import LongService, Reply, Work
from wrist_ft_comp.stream.compensator import Compensator

#: It is refused when no wrench with specific force has come for this time, s.
_PATIENCE_S = 10.0


@dataclass(eq=False)
class IdentifyService(LongService):
    """Collects a minute of wrenches, lets a job identify the payload, and answers its name."""

    _compensator: Compensator
    _external: ExternalWrench
    _files: PayloadFiles
    _jobs: JobMaker
    _node_name: str
    _log: NodeLog

    name, title = '~/identify_payload', 'identification'
    done = 'identified: '

    def _busy(self) -> str:
        passed_s = DURATION_S * (self._external.identified_share or 0.0)
        return f'A payload is being identified for {passed_s:.0f} of {DURATION_S:g} s'

    def _work(self) -> Work:
        """Collect a minute of stamps, let a job identify the payload, and say how to use it."""
        if self._external.gravity.forces.newest is None:
            raise CalibrationRefusedError(
                'No specific force has come. Set gravity.source to imu or tf, and look whether '
                'that is published.'
            )
        if not self._compensator.compensating:
            raise CalibrationRefusedError(
                'No drift model runs, and drift would be taken for weight. Calibrate first, or '
                'wait for the first temperature.'
            )
        collector = MotionCollector()
        self._external.collect(collector)
        try:
            yield from self._wait(collector)
        finally:
            self._external.collect(None)
        sensor = self._files.sensor(self._external.gravity.frames())
        calibrated = None if sensor is None else (sensor.bias.tolist(), sensor.scale.tolist())
        minute = Minute(collector.cells, CELL_S, tuple(self._files.payloads()), calibrated)
        outcome = yield from run_job(self._jobs.identification(minute))
        frame = ForceFrame(np.array(outcome['rotation']))
        other = self._external.disagreement(frame)
        use = (
            f'{outcome["message"]} Specific force is {frame}{other and "; "}{other}. Use it: ros2 '
            f'param set {self._node_name} payload.active {outcome["name"]}'
        )
        return '\n'.join([use, *outcome['driver_lines']])

    def _wait(self, collector: MotionCollector) -> Iterator[None]:
        """Wait until the minute is over; refuse where that cannot happen any more."""
        external, tare = self._external, self._compensator.external_tare
        count, heard_s = external.collected, time.monotonic()
        while collector.share < 1 and self._compensator.external_tare is tare:
            external.identified_share = collector.share
            if external.collected != count:
                count, heard_s = external.collected, time.monotonic()
            if time.monotonic() - heard_s > _PATIENCE_S:
                raise CalibrationRefusedError(
                    f'Wrenches with specific force have stayed away for {_PATIENCE_S:g} s. Look '
                    'at the diagnostics, input and payload, then call again.'
                )
            yield
        external.identified_share = 1.0
        if self._compensator.external_tare is not tare:  # the wrenches made a step
            raise CalibrationRefusedError('The tare or the model changed meanwhile. Call again.')

    def _answer(self, reply: Reply, message: str, *, success: bool) -> None:
        """Answer; every refusal begins with the same words."""
        answer = message if success else f'No payload was identified: {message}'
        self._external.last_identification, self._external.identified_share = answer, None
        super()._answer(reply, answer, success=success)
