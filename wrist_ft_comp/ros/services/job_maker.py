"""What a calibration is asked for: a job made from the node's present parameters."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from wrist_ft_comp.calibration.settings import CalibrationSettings, IdentificationSettings
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.files.job_request import CalibrationJob, Learning
from wrist_ft_comp.files.model_store import ModelStore
from wrist_ft_comp.model.signals import NANOSECONDS, Topics
from wrist_ft_comp.ros.services.recorder import Recorder


class JobMaker:
    """Makes jobs; ``topics`` takes the present parameters and tells topics by their full names."""

    def __init__(
        self,
        store: ModelStore,
        settings: Callable[[], dict[str, Any]],
        topics: Callable[[dict[str, Any]], Topics],
        recorder: Recorder,
    ) -> None:
        self.store, self.recorder = store, recorder
        self._settings, self._topics = settings, topics

    def calibration(self) -> CalibrationJob:
        """Ask for what ``~/calibrate`` does."""
        chosen = self._settings()
        named = tuple(self.store.locate(path) for path in chosen['calibration.recordings'])
        recordings = named or tuple(self.store.recordings())
        if not recordings:
            raise RecordingError(
                f'There is no recording in {self.store.directory / "recordings"}. Record a '
                'warm-up with ~/record, or set calibration.recordings.'
            )
        return self._make(recordings, chosen, skip_unusable=not named)

    def learning(self, days: Sequence[Path], champion: Path | None, since: str) -> CalibrationJob:
        """Ask for what can be learnt from days."""
        chosen = self._settings()
        kept_mb = 0.8 * chosen['learning.max_mb']  # leaves room for the day that goes on
        job = self._make(tuple(days), chosen, skip_unusable=True)
        return replace(
            job,
            settings=replace(job.settings, reference='payload'),
            learning=Learning(champion, since, chosen['learning.keep_days'], kept_mb),
        )

    def _make(
        self, recordings: tuple[Path, ...], chosen: dict[str, Any], *, skip_unusable: bool
    ) -> CalibrationJob:
        """Make a job."""
        output = self.store.new_model_path()
        return CalibrationJob(
            recordings=recordings,
            output=output,
            report=output.with_suffix('.html'),
            settings=CalibrationSettings(
                reference=chosen['calibration.reference'],
                min_temperature_span_k=chosen['calibration.min_temperature_span'],
                identification=IdentificationSettings(method=chosen['calibration.method']),
            ),
            period_s=self.recorder.period_ns / NANOSECONDS,
            topics=self._topics(chosen),
            skip_unusable=skip_unusable,
        )
