"""What all jobs of a node share: they are made from the parameters, started, and waited for."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
import sys
from typing import Any

from wrist_ft_comp.errors import CalibrationRefusedError, RecordingError
from wrist_ft_comp.fit.settings import CalibrationSettings
from wrist_ft_comp.jobs.job_process import CalibrationJob, JobProcess, Learning, Minute
from wrist_ft_comp.node.recorder import Recorder
from wrist_ft_comp.recording import Topics
from wrist_ft_comp.series import NANOSECONDS
from wrist_ft_comp.stored.model_store import HistoryEntry, ModelStore
from wrist_ft_comp.stored.payload_file import PAYLOADS

#: The process that runs a job.
COMMAND = (sys.executable, '-m', 'wrist_ft_comp.jobs.entry')


def start_job(job: CalibrationJob) -> JobProcess:
    """Start a process that runs a job; OSError when it cannot be started."""
    return JobProcess(COMMAND, job)


@dataclass(frozen=True, eq=False)
class JobMaker:
    """Makes jobs from the parameters; ``topics`` gives the full names of topics for them."""

    store: ModelStore
    settings: Callable[[], dict[str, Any]]
    _topics: Callable[[dict[str, Any]], Topics]
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
        job = self._make(tuple(days), chosen, skip_unusable=True)
        return replace(job, learning=Learning(tuple(history), kept_mb))

    def identification(self, minute: Minute) -> CalibrationJob:
        """Ask for what ``~/identify_payload`` does."""
        output, topics = self.store.directory / 'models' / PAYLOADS, self._topics(self.settings())
        return CalibrationJob((), output, topics=topics, minute=minute)

    def _make(
        self, recordings: tuple[Path, ...], chosen: dict[str, Any], *, skip_unusable: bool
    ) -> CalibrationJob:
        output = self.store.new_model_path()
        settings = CalibrationSettings(reference=chosen['calibration.reference'])
        period_s = self.recorder.thermal_period_ns / NANOSECONDS
        return CalibrationJob(
            recordings, output, settings, period_s, self._topics(chosen),
            skip_unusable=skip_unusable, report=output.with_suffix('.html'),
        )  # fmt: skip


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
