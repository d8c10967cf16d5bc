"""The part that answers ~/identify_payload, from a minute of motion."""

from collections.abc import Iterator
from dataclasses import dataclass
import time

import numpy as np

from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.jobs.job_process import Minute
from wrist_ft_comp.node.external_wrench import ExternalWrench, PayloadFiles
from wrist_ft_comp.node.jobs import JobMaker, run_job
from wrist_ft_comp.payload.live_weight import CELL_S, DURATION_S, MotionCollector
from wrist_ft_comp.payload.weight import ForceFrame
from wrist_ft_comp.ros.hub import LongService, Work
from wrist_ft_comp.ros.services import Reply
from wrist_ft_comp.stream.compensator import Compensator

#: It is refused when no wrench with specific force has come for this time, s.
_PATIENCE_S = 10.0


@dataclass(eq=False, kw_only=True)
class IdentifyService(LongService):
    """Collects a minute of wrenches, lets a job identify the payload, and answers its name."""

    compensator: Compensator
    external: ExternalWrench
    files: PayloadFiles
    jobs: JobMaker

    title, name = 'identification', '~/identify_payload'
    purpose = (
        'learns what is mounted from a minute of motion, while the drift model runs; answers with '
        'its name'
    )
    done = 'identified: '

    def _busy(self) -> str:
        passed_s = DURATION_S * (self.external.collector.share if self.external.collector else 0.0)
        return f'A payload is being identified for {passed_s:.0f} of {DURATION_S:g} s'

    def _work(self) -> Work:
        """Collect a minute of stamps, let a job identify the payload, and say how to use it."""
        if self.external.specific_force.forces.newest is None:
            raise CalibrationRefusedError(
                'No specific force has come. Set gravity.source to imu or tf, and look whether '
                'that is published.'
            )
        if not self.compensator.compensating:
            raise CalibrationRefusedError(
                'No drift model runs, and drift would be taken for weight. Calibrate first, or '
                'wait for the first temperature.'
            )
        collector = MotionCollector()
        self.external.collect(collector)
        try:
            yield from self._wait(collector)
            sensor = self.files.sensor(self.external.specific_force.frames())
            calibrated = None if sensor is None else (sensor.bias.tolist(), sensor.scale.tolist())
            minute = Minute(collector.cells, CELL_S, tuple(self.files.payloads()), calibrated)
            outcome = yield from run_job(self.jobs.identification(minute))
        finally:
            self.external.collect(None)
        frame = ForceFrame(np.array(outcome['rotation']))
        other = self.external.disagreement(frame)
        use = (
            f'{outcome["message"]} Specific force is {frame}{other and "; "}{other}. Use it: ros2 '
            f'param set {self.hub.get_fully_qualified_name()} payload.active {outcome["name"]}'
        )
        return '\n'.join([use, *outcome['driver_lines']])

    def _wait(self, collector: MotionCollector) -> Iterator[None]:
        """Wait until the minute is over; refuse where that cannot happen any more."""
        tare, share, heard_s = self.compensator.external_tare, 0.0, time.monotonic()
        while collector.share < 1 and self.compensator.external_tare is tare:
            if collector.share != share:
                share, heard_s = collector.share, time.monotonic()
            if time.monotonic() - heard_s > _PATIENCE_S:
                raise CalibrationRefusedError(
                    f'Wrenches with specific force have stayed away for {_PATIENCE_S:g} s. Look '
                    'at the diagnostics, input and payload, then call again.'
                )
            yield
        if self.compensator.external_tare is not tare:  # the wrenches made a step
            raise CalibrationRefusedError('The tare or the model changed meanwhile. Call again.')

    def _answer(self, reply: Reply, message: str, *, success: bool) -> None:
        """Answer; every refusal begins with the same words."""
        answer = message if success else f'No payload was identified: {message}'
        self.external.last_identification = answer
        super()._answer(reply, answer, success=success)
