"""The parts that answer ~/calibrate and ~/identify_payload, by jobs in a process of their own."""

from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
import sys
import time
from typing import Any, get_args

import numpy as np

from wrist_ft_comp.errors import CalibrationRefusedError, RecordingError
from wrist_ft_comp.fit.settings import CalibrationSettings
from wrist_ft_comp.jobs.job_process import CalibrationJob, JobProcess, Minute
from wrist_ft_comp.node.external_wrench import ExternalWrench
from wrist_ft_comp.node.live_model import LiveModel
from wrist_ft_comp.node.recorder import Recorder
from wrist_ft_comp.payload.motion_collector import CELL_S, MotionCollector
from wrist_ft_comp.payload.weight import ForceFrame
from wrist_ft_comp.recording import Reference, Topics
from wrist_ft_comp.ros.diagnostics import OK, Status, WARN
from wrist_ft_comp.ros.hub import Part
from wrist_ft_comp.ros.parameters import Parameter
from wrist_ft_comp.ros.services import service, Work
from wrist_ft_comp.series import NANOSECONDS
from wrist_ft_comp.stored.model_file import restore_model
from wrist_ft_comp.stored.payload_file import IDENTIFIED

COMMAND = (sys.executable, '-m', 'wrist_ft_comp.jobs.job_main')
#: An identification is refused when no wrench with specific force has come for this time, s.
_PATIENCE_S = 10.0


def run_job(job: CalibrationJob) -> Generator[None, None, dict[str, Any]]:
    """Run a job in a process, and wait; CalibrationRefusedError where it refuses or fails."""
    try:
        process = JobProcess(COMMAND, job)
    except OSError as error:
        raise CalibrationRefusedError(
            f'The calibration cannot be started: {error}. Mend that, then call again.'
        ) from error
    try:
        while (outcome := process.poll()) is None:
            yield
    except GeneratorExit:
        process.end()
        raise
    if not outcome['success']:
        raise CalibrationRefusedError(outcome['message'])
    return outcome


@dataclass(eq=False)
class Jobs(Part):
    """Runs calibrations and identifications of payloads, and makes the jobs of learning, too."""

    live: LiveModel
    recorder: Recorder
    external: ExternalWrench
    full_topics: Callable[[], Topics]

    title = 'calibration'
    parameters = (
        Parameter(
            'calibration.recordings', (),
            "Recordings to calibrate from; empty takes the node's own, the newest ten. Set at run "
            'time, they must lie inside data_directory.'),
        Parameter(
            'calibration.reference', CalibrationSettings().reference,
            'The true wrench while recording: zero (unloaded), unknown but constant (constant), '
            'the weight of an unknown payload, found by the specific force (payload), or that on '
            'wrench_reference (recorded).',
            choices=get_args(Reference)),
    )  # fmt: skip

    def check_parameters(self, parameters: Sequence[Any]) -> None:
        """Refuse recordings outside data_directory, but those that were named at the start."""
        for given in (one for one in parameters if one.name == 'calibration.recordings'):
            for path in {*(given.value or ())} - {*self.hub.chosen()[given.name]}:
                self.live.store.require_inside(given.name, path)

    def make_job(self, recordings: Sequence[Path], **more: Any) -> CalibrationJob:
        """Ask for a model of recordings, with more fields of the job; by ``reference``, too."""
        output = self.live.store.new_model_path()
        reference = more.pop('reference', self.hub.chosen()['calibration.reference'])
        return CalibrationJob(
            tuple(recordings), output, CalibrationSettings(reference=reference),
            self.live.compensator.tracker.grid.period_ns / NANOSECONDS, self.full_topics(),
            report=output.with_suffix('.html'), **more,
        )  # fmt: skip

    @service(
        '~/calibrate', 'fits the recordings, saves the model and makes it live; answers when done'
    )
    def calibrate(self, _: Any) -> Work:
        """Wait for the process, make its model live, and wait until that is remembered."""
        outcome = yield from run_job(self.job())
        model = restore_model(Path(outcome['path']), outcome['sha256'], outcome['document'])
        self.live.take(model, why='a person called ~/calibrate')
        return (yield from self.live.kept(outcome['message']))

    def job(self) -> CalibrationJob:
        """Ask for what ``~/calibrate`` does."""
        store = self.live.store
        named = [store.locate(path) for path in self.hub.chosen()['calibration.recordings']]
        recordings = named or store.recordings()
        if not recordings:
            raise RecordingError(
                f'There is no recording in {store.directory / "recordings"}. Record a warm-up '
                'with ~/record, or set calibration.recordings.'
            )
        job = self.make_job(recordings, skip_unusable=not named)
        return replace(job, period_s=0.0 if named else self.recorder.period_s)

    @service(
        '~/identify_payload',
        'learns what is mounted from a minute of motion, while the drift model runs; answers with '
        'its name',
    )
    def identify(self, _: Any) -> Work:
        """Collect a minute of stamps, let a job identify the payload, and say how to use it."""
        external, stream = self.external, self.live.compensator
        if external.specific_force.forces.newest is None:
            raise CalibrationRefusedError(
                'No specific force has come. Set gravity.source to imu or tf, and look whether '
                'that is published.'
            )
        if not stream.compensating:
            raise CalibrationRefusedError(
                'No drift model runs, and drift would be taken for weight. Calibrate first, or '
                'wait for the first temperature.'
            )
        collector = MotionCollector()
        external.collect(collector)
        try:
            tare, share, heard_s = stream.external_tare, 0.0, time.monotonic()
            while collector.share < 1 and stream.external_tare is tare:
                if collector.share != share:
                    share, heard_s = collector.share, time.monotonic()
                if time.monotonic() - heard_s > _PATIENCE_S:
                    raise CalibrationRefusedError(
                        f'Wrenches with specific force have stayed away for {_PATIENCE_S:g} s. '
                        'Look at the diagnostics, input and payload, then call again.'
                    )
                yield
            if stream.external_tare is not tare:  # the wrenches made a step
                raise CalibrationRefusedError(
                    'The tare or the model changed meanwhile. Call again.'
                )
            # The accelerometer is as a calibration found it, which a minute can do no better.
            known, calibrated = external.choice, None
            for name, frame in known.frames().items():
                if not name.startswith(f'{IDENTIFIED}-'):
                    calibrated = frame.bias.tolist(), frame.scale.tolist()
            minute = Minute(collector.cells, CELL_S, tuple(known.payloads()), calibrated)
            job = CalibrationJob((), known.own_path, topics=self.full_topics(), minute=minute)
            outcome = yield from run_job(job)
        finally:
            external.collect(None)
        found = ForceFrame(np.array(outcome['rotation']))
        return (
            f'{outcome["message"]} Specific force is {found}. Use it: ros2 param set '
            f'{self.hub.get_fully_qualified_name()} payload.active {outcome["name"]}'
        )

    def statuses(self) -> Iterator[Status]:
        """Report recording, running calibration, and last outcome."""
        recorder, recording = self.recorder, self.recorder.current
        numbers = {'last': self.hub.answers.get('~/calibrate', 'none yet')}
        level, message = OK, 'recording' if recording else 'idle'
        if recording is not None:
            numbers['recording'] = str(recorder.path)
            numbers['recorded_cells'] = str(recording.rows)
            numbers['recording_s'] = f'{recording.rows * recorder.period_s:g}'
        if (running_s := self.hub.running_s('~/calibrate')) is not None:
            message = f'running for {running_s:.0f} s'
        elif trouble := recorder.failure or recorder.doubt():
            level, message = WARN, trouble
        yield Status(self.title, level, message, numbers)
