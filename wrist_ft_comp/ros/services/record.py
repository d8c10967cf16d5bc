"""The service ~/record: starting and ending the node's own recording."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.files.documents import writing
from wrist_ft_comp.files.model_store import ModelStore
from wrist_ft_comp.model.signals import NANOSECONDS
from wrist_ft_comp.ros.node_log import NodeLog
from wrist_ft_comp.ros.services.recorder import OwnRecording, Recorder, REMEDY


@dataclass(eq=False)
class RecordService:
    """Starts and ends a recording; ``subscribe_reference`` returns what ends its subscription."""

    _recorder: Recorder
    _store: ModelStore
    _subscribe_reference: Callable[[], Callable[[], object]]
    _log: NodeLog
    _unsubscribe: Callable[[], object] = lambda: None
    #: The recording that runs, and its file, or that of the last one.
    current: OwnRecording | None = None
    path: Path = Path()
    #: Why the last one ended early; empty when it did not.
    failure: str = ''

    def on_request(self, request: Any, _reply: Any) -> str:
        """Start or end the recording, as SetBool's data says; say where to, or what it holds."""
        return self.start() if request.data else self._finish()

    def start(self) -> str:
        """Start recording; say where to."""
        from wrist_ft_comp.files.csv_file import CsvRecordingWriter  # noqa: PLC0415 -- rare

        if self.current is not None:
            raise RecordingError(
                f'A recording runs already, into {self.path}. End it first, with data: false.'
            )
        try:
            with writing(self._store.directory):
                path = self._store.new_recording_path()
                writer = CsvRecordingWriter(path, self._recorder.channels)
        except RecordingError as error:
            raise RecordingError(f'{error} {REMEDY}.') from error
        self.current = self._recorder.begin(writer, self._fail, self._follow_period)
        self.path = path
        # Only while recording: a reference at a kilohertz costs as much as the wrench itself.
        self._unsubscribe = self._subscribe_reference()
        self.failure = ''
        return f'recording into {path}'

    def _finish(self) -> str:
        """End the recording; say what it holds."""
        recording = self.current
        if recording is None:
            raise RecordingError(self.failure or 'No recording runs. Start one with data: true.')
        self._recorder.end(recording)
        self._forget()
        recording.close()
        seconds = recording.rows * recording.period_ns / NANOSECONDS
        return f'recorded {recording.rows} thermal cells ({seconds:.0f} s) into {self.path}'

    def _forget(self) -> None:
        """Listen to the reference no longer."""
        self.current = None
        self._unsubscribe()

    def add_reference(self, stamp_ns: int, reference: Sequence[float]) -> None:
        """Take one reference wrench, N and N m."""
        if self.current is not None:
            self.current.averager.add_reference(stamp_ns, reference)

    def _fail(self, error: RecordingError) -> None:
        """Say that the disk has ended the recording."""
        rows = self.current.rows if self.current else 0
        self._forget()
        self.failure = (
            f'{error} The recording has ended after {rows} thermal cells. {REMEDY}, then record '
            'again.'
        )
        self._log.error(self.failure)

    def _follow_period(self) -> None:
        """End the recording, because a new model has brought another thermal period."""
        self.end()
        self.failure = (
            f'The recording into {self.path} has ended: the new model has thermal cells of '
            f'{self._recorder.period_ns / NANOSECONDS:g} s. Record again.'
        )
        self._log.warning(self.failure)

    def end(self) -> None:
        """Close the recording that runs, if one does, and log what it holds."""
        if self.current is None:
            return
        try:
            self._log.info(self._finish())
        except RecordingError as error:
            self._log.error(str(error))
