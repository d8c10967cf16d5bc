"""The service ~/record: starting and ending the node's own recording."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from wrist_ft_comp.errors import RecordingError, WristFtCompError
from wrist_ft_comp.files.model_store import ModelStore
from wrist_ft_comp.model.signals import NANOSECONDS
from wrist_ft_comp.model.stream_grid import CompletedCells
from wrist_ft_comp.ros.node_log import NodeLog
from wrist_ft_comp.stream.cell_averager import CellAverager, row_channels
from wrist_ft_comp.stream.compensator import Compensator

_REMEDY = 'Make room or choose another data_directory'


class OwnRecording:
    """A recording in progress, a row per thermal cell; RecordingError when the disk refuses."""

    def __init__(self, path: Path, period_ns: int, thermometers: int, *, with_force: bool) -> None:
        self.path = path
        self.period_ns = period_ns
        self.rows = 0
        self.averager = CellAverager(period_ns, thermometers, with_force=with_force)
        from wrist_ft_comp.files.csv_file import CsvRecordingWriter  # noqa: PLC0415 -- rare

        channels = row_channels(thermometers, with_force=with_force)
        self._writer = CsvRecordingWriter(path, channels)

    def write(self, *, final: bool = False) -> None:
        """Append the rows that are complete; all there are when nothing more will come."""
        for stamp_ns, values in self.averager.rows(final=final):
            self._writer.append(stamp_ns, values)
            self.rows += 1

    def close(self) -> None:
        """Write what is left, and close, also when the disk refuses."""
        try:
            self.write(final=True)
        except RecordingError:
            self.abandon()
            raise
        try:
            self._writer.close()
        except OSError as error:
            raise RecordingError(f'{self.path} cannot be written: {error.strerror}.') from error

    def abandon(self) -> None:
        """Close after the disk refused: what it took stays, the rest is lost."""
        with suppress(RecordingError, OSError):
            self._writer.close()


class RecordService:
    """Records what is pushed to it; ``subscribe_reference`` returns what ends its subscription."""

    def __init__(
        self,
        compensator: Compensator,
        store: ModelStore,
        subscribe_reference: Callable[[], Callable[[], object]],
        log: NodeLog,
        *,
        with_force: bool,
    ) -> None:
        #: The recording that runs.
        self.current: OwnRecording | None = None
        #: Why the last one ended early; empty when it did not.
        self.failure = ''
        self._compensator = compensator
        self._store = store
        self._subscribe_reference = subscribe_reference
        self._log = log
        self._with_force = with_force
        self._unsubscribe: Callable[[], object] = lambda: None

    def on_request(self, request: Any, response: Any) -> Any:
        """Start or end the recording, as SetBool's data says."""
        try:
            response.message = self.start() if request.data else self._finish()
            response.success = True
        except WristFtCompError as error:
            response.success, response.message = False, str(error)
            self._log.note_refusal('~/record', str(error))
        return response

    def start(self) -> str:
        """Start recording; say where to."""
        if self.current is not None:
            raise RecordingError(
                f'A recording runs already, into {self.current.path}. End it first, with data: '
                'false.'
            )
        try:
            path = self._store.new_recording_path()
            self.current = OwnRecording(
                path,
                self._compensator.tracker.grid.period_ns,
                self._compensator.thermometers,
                with_force=self._with_force,
            )
        except OSError as error:
            raise RecordingError(
                f'{self._store.directory} cannot be written: {error.strerror}. {_REMEDY}.'
            ) from error
        except RecordingError as error:
            raise RecordingError(f'{error} {_REMEDY}.') from error
        # Only while recording: a reference at a kilohertz costs as much as the wrench itself.
        self._unsubscribe = self._subscribe_reference()
        self.failure = ''
        return f'recording into {path}'

    def _finish(self) -> str:
        """End the recording; say what it holds."""
        if self.current is None:
            raise RecordingError(self.failure or 'No recording runs. Start one with data: true.')
        recording = self._stop(self.current)
        recording.close()
        seconds = recording.rows * recording.period_ns / NANOSECONDS
        return f'recorded {recording.rows} thermal cells ({seconds:.0f} s) into {recording.path}'

    def _stop(self, recording: OwnRecording) -> OwnRecording:
        """Let nothing more come in."""
        self.current = None
        self._unsubscribe()
        return recording

    def add_raw(self, stamp_ns: int, raw: Sequence[float]) -> None:
        """Take one raw wrench, N and N m."""
        if self.current is not None:
            self.current.averager.add_raw(stamp_ns, raw)

    def add_reference(self, stamp_ns: int, reference: Sequence[float]) -> None:
        """Take one reference wrench, N and N m."""
        if self.current is not None:
            self.current.averager.add_reference(stamp_ns, reference)

    def add_force(self, stamp_ns: int, force: Sequence[float], speed: float | None) -> None:
        """Take one specific force, m/s², and the speed of rotation, rad/s, where it is known."""
        if self.current is not None:
            self.current.averager.add_force(stamp_ns, force, speed)

    def add_cells(self, cells: list[CompletedCells]) -> None:
        """Append rows for thermal cells; a full disk ends the recording, not the stream."""
        if self.current is not None:
            self.current.averager.add_cells(cells)
            self._write(self.current)

    def poll(self) -> None:
        """Append rows of wrenches whose temperatures stay away."""
        if self.current is not None:
            self._write(self.current)

    def _write(self, recording: OwnRecording) -> None:
        """Append what is complete, or end the recording."""
        try:
            recording.write()
        except RecordingError as error:
            self._stop(recording).abandon()
            self.failure = (
                f'{error} The recording has ended after {recording.rows} thermal cells. '
                f'{_REMEDY}, then record again.'
            )
            self._log.error(self.failure)

    def follow_period(self) -> None:
        """End the recording when a new model has brought another thermal period."""
        recording, period_ns = self.current, self._compensator.tracker.grid.period_ns
        if recording is not None and recording.period_ns != period_ns:
            self.end()
            self.failure = (
                f'The recording into {recording.path} has ended: the new model has thermal cells '
                f'of {period_ns / NANOSECONDS:g} s. Record again.'
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
