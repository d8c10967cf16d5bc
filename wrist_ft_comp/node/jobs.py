"""What runs in a process of its own: how jobs are made and awaited, and the parts that ask."""

from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
import sys
import time
from typing import Any, get_args

import numpy as np

from wrist_ft_comp.errors import CalibrationRefusedError, RecordingError
from wrist_ft_comp.fit.settings import CalibrationSettings
from wrist_ft_comp.jobs.job_process import CalibrationJob, JobProcess, Learning, Minute
from wrist_ft_comp.node.external_wrench import ExternalWrench, PayloadFiles
from wrist_ft_comp.node.live_model import warned
from wrist_ft_comp.node.recorder import Recorder, RecordService
from wrist_ft_comp.payload.live_weight import CELL_S, DURATION_S, MotionCollector
from wrist_ft_comp.payload.weight import ForceFrame
from wrist_ft_comp.recording import Reference, Topics
from wrist_ft_comp.ros.diagnostics import NodeLog, OK, Status, WARN
from wrist_ft_comp.ros.hub import LongService, Work
from wrist_ft_comp.ros.parameters import Parameter
from wrist_ft_comp.series import NANOSECONDS
from wrist_ft_comp.stored.model_file import restore_model
from wrist_ft_comp.stored.model_store import HistoryEntry, ModelStore
from wrist_ft_comp.stored.payload_file import IDENTIFIED, PAYLOADS
from wrist_ft_comp.stream.compensator import Compensator

#: The process that runs a job.
COMMAND = (sys.executable, '-m', 'wrist_ft_comp.jobs.entry')
#: An identification is refused when no wrench with specific force has come for this time, s.
_PATIENCE_S = 10.0


def start_job(job: CalibrationJob) -> JobProcess:
    """Start a process that runs a job; OSError when it cannot be started."""
    return JobProcess(COMMAND, job)


def run_job(job: CalibrationJob) -> Generator[None, None, dict[str, Any]]:
    """Run a job in a process, and wait; CalibrationRefusedError where it refuses or fails."""
    try:
        process = start_job(job)
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


@dataclass(frozen=True, eq=False)
class JobMaker:
    """Makes jobs from the parameters; ``topics`` gives the full names of topics for them."""

    store: ModelStore
    settings: Callable[[], dict[str, Any]]
    topics: Callable[[dict[str, Any]], Topics]
    recorder: Recorder

    def calibration(self) -> CalibrationJob:
        """Ask for what ``~/calibrate`` does."""
        chosen = self.settings()
        named = tuple(self.store.locate(path) for path in chosen['calibration.recordings'])
        recordings = named or tuple(self.store.recordings())
        if not recordings:
            raise RecordingError(
                f'There is no recording in {self.store.directory / "recordings"}. Record a '
                'warm-up with ~/record, or set calibration.recordings.'
            )
        return self._make(recordings, chosen, skip_unusable=not named)

    def learning(self, days: Sequence[Path], history: Sequence[HistoryEntry]) -> CalibrationJob:
        """Ask for what can be learnt from days."""
        chosen = {**self.settings(), 'calibration.reference': 'payload'}
        kept_mb = 0.8 * chosen['learning.max_mb']  # leaves room for the day that goes on
        learning = Learning(tuple(history), kept_mb)
        return self._make(tuple(days), chosen, skip_unusable=True, learning=learning)

    def _make(
        self, recordings: tuple[Path, ...], chosen: dict[str, Any], **more: Any
    ) -> CalibrationJob:
        output = self.store.new_model_path()
        return CalibrationJob(
            recordings, output, CalibrationSettings(reference=chosen['calibration.reference']),
            self.recorder.thermal_period_ns / NANOSECONDS, self.topics(chosen),
            report=output.with_suffix('.html'), **more,
        )  # fmt: skip


@dataclass(eq=False)
class CalibrateService(LongService):
    """
    Runs a calibration in a process of its own.

    ``go_live`` takes the model, and what gets a warning, or '', when the model is remembered.
    """

    make_request: Callable[[], CalibrationJob]
    go_live: Callable[..., None]
    recording: RecordService
    log: NodeLog
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
        recording = self.recording.current
        numbers = {
            'last': self.last_outcome or 'none yet',
            'last_refusal': self.log.last_refusal or 'none yet',
        }
        level, message = OK, 'recording' if recording else 'idle'
        if recording is not None:
            numbers['recording'] = str(self.recording.path)
            numbers |= {'recorded_cells': str(recording.rows), **self.recording.spans()}
        if self.running_s is not None:
            message = f'running for {self.running_s:.0f} s'
        elif trouble := self.recording.failure or self.recording.recorder.doubt():
            level, message = WARN, trouble
        elif self.refused:
            level, message = WARN, f'the last one was refused: {self.last_outcome}'
        yield Status(self.title, level, message, numbers)

    def _busy(self) -> str:
        return f'A calibration has been running for {self.running_s:.0f} s'

    def _work(self) -> Work:
        """Wait for the process, make its model live, and wait until that is remembered."""
        self._begun_s = time.monotonic()
        outcome = yield from run_job(self.make_request())
        problems: list[str] = []
        path, sha256, document = (outcome[name] for name in ('path', 'sha256', 'document'))
        self.go_live(restore_model(Path(path), sha256, document), then=problems.append)
        while not problems:
            yield
        return warned(outcome['message'], problems[0])


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
    done, not_done = 'identified: ', 'no payload was identified: '

    def _busy(self) -> str:
        passed_s = DURATION_S * (self.external.collector.share if self.external.collector else 0.0)
        return f'A payload is being identified for {passed_s:.0f} of {DURATION_S:g} s'

    def _work(self) -> Work:
        """Collect a minute of stamps, let a job identify the payload, and say how to use it."""
        external = self.external
        if external.specific_force.forces.newest is None:
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
        external.collect(collector)
        try:
            tare, share, heard_s = self.compensator.external_tare, 0.0, time.monotonic()
            while collector.share < 1 and self.compensator.external_tare is tare:
                if collector.share != share:
                    share, heard_s = collector.share, time.monotonic()
                if time.monotonic() - heard_s > _PATIENCE_S:
                    raise CalibrationRefusedError(
                        f'Wrenches with specific force have stayed away for {_PATIENCE_S:g} s. '
                        'Look at the diagnostics, input and payload, then call again.'
                    )
                yield
            if self.compensator.external_tare is not tare:  # the wrenches made a step
                raise CalibrationRefusedError(
                    'The tare or the model changed meanwhile. Call again.'
                )
            # The accelerometer is as a calibration found it, which a minute can do no better.
            frames, calibrated = self.files.frames(external.specific_force.frames()), None
            for name, frame in frames.items():
                if not name.startswith(f'{IDENTIFIED}-'):
                    calibrated = frame.bias.tolist(), frame.scale.tolist()
            minute = Minute(collector.cells, CELL_S, tuple(self.files.payloads()), calibrated)
            path, topics = self.jobs.store.directory / 'models' / PAYLOADS, self.jobs.topics
            job = CalibrationJob((), path, topics=topics(self.jobs.settings()), minute=minute)
            outcome = yield from run_job(job)
        finally:
            external.collect(None)
        found = ForceFrame(np.array(outcome['rotation']))
        use = (
            f'{outcome["message"]} Specific force is {found}. Use it: ros2 '
            f'param set {self.hub.get_fully_qualified_name()} payload.active {outcome["name"]}'
        )
        return '\n'.join([use, *outcome['driver_lines']])
