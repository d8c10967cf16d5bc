"""The service ~/record: starting and ending the node's own recording."""

from contextlib import suppress
from pathlib import Path
from typing import Any, TYPE_CHECKING

from geometry_msgs.msg import WrenchStamped
from rclpy.qos_overriding_options import QoSOverridingOptions

from wrist_ft_comp.errors import RecordingError, WristFtCompError
from wrist_ft_comp.files.csv_file import CsvRecordingWriter
from wrist_ft_comp.model.signals import NANOSECONDS
from wrist_ft_comp.model.stream_grid import CompletedCells
from wrist_ft_comp.ros import messages as qos
from wrist_ft_comp.stream.cell_averager import CellAverager, row_channels

if TYPE_CHECKING:
    from wrist_ft_comp.ros.compensator_node import CompensatorNode


class OwnRecording:
    """
    A recording in progress.

    Parameters
    ----------
    path : Path
        A new CSV file.
    period_ns : int
        Cell length h, ns.
    thermometers : int
        Number of thermometers J.

    Raises
    ------
    RecordingError
        When the file cannot be made.

    """

    def __init__(self, path: Path, period_ns: int, thermometers: int) -> None:
        self.path = path
        self.period_ns = period_ns
        self.rows = 0
        self.averager = CellAverager(period_ns, thermometers)
        self._writer = CsvRecordingWriter(path, row_channels(thermometers))

    def write(self, *, final: bool = False) -> None:
        """
        Append the rows that are complete.

        Parameters
        ----------
        final : bool
            Whether nothing more will come.

        Raises
        ------
        RecordingError
            When the disk refuses.

        """
        for stamp_ns, values in self.averager.rows(final=final):
            self._writer.append(stamp_ns, values)
            self.rows += 1

    def close(self) -> None:
        """
        Write what is left, and close.

        Raises
        ------
        RecordingError
            When the disk refuses; the file is closed nevertheless.

        """
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


class RecordingControl:
    """
    Owns the recording that runs, if one does, and the subscription to its reference.

    Parameters
    ----------
    node : CompensatorNode
        The owner.

    """

    def __init__(self, node: 'CompensatorNode') -> None:
        #: The recording that runs.
        self.current: OwnRecording | None = None
        #: Why the last one ended early; empty when it did not.
        self.failure = ''
        self._node = node
        self._reference: Any = None

    def on_request(self, request: Any, response: Any) -> Any:
        """Start or end the recording, as SetBool's data says."""
        try:
            response.message = self._start() if request.data else self._end()
            response.success = True
        except WristFtCompError as error:
            response.success, response.message = False, str(error)
            self._node.note_refusal('~/record', str(error))
        return response

    def _start(self) -> str:
        """Start recording; say where to."""
        if self.current is not None:
            raise RecordingError(
                f'A recording runs already, into {self.current.path}. End it first, with data: '
                'false.'
            )
        node = self._node
        remedy = 'Make room or choose another data_directory.'
        try:
            path = node.store.new_recording_path()
            self.current = OwnRecording(
                path, node.compensator.tracker.grid.period_ns, node.compensator.thermometers
            )
        except OSError as error:
            raise RecordingError(
                f'{node.store.directory} cannot be written: {error.strerror}. {remedy}'
            ) from error
        except RecordingError as error:
            raise RecordingError(f'{error} {remedy}') from error
        # Only while recording: a reference at a kilohertz costs as much as the wrench itself.
        self._reference = node.create_subscription(
            WrenchStamped,
            'wrench_reference',
            node.on_reference,
            qos.own(qos.FAST_SENSOR),
            raw=True,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )
        self.failure = ''
        return f'recording into {path}'

    def _end(self) -> str:
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
        self._node.destroy_subscription(self._reference)
        return recording

    def add_cells(self, cells: list[CompletedCells]) -> None:
        """
        Append rows for completed cells; a disk that refuses ends the recording, not the stream.

        Parameters
        ----------
        cells : list of CompletedCells
            From the thermal grid.

        """
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
                f'{error} The recording has ended after {recording.rows} thermal cells. Make '
                'room or choose another data_directory, then record again.'
            )
            self._node.console.error(self.failure)

    def follow_period(self) -> None:
        """End the recording when a new model has brought another thermal period."""
        recording, period_ns = self.current, self._node.compensator.tracker.grid.period_ns
        if recording is not None and recording.period_ns != period_ns:
            self.end()
            self.failure = (
                f'The recording into {recording.path} has ended: the new model has thermal cells '
                f'of {period_ns / NANOSECONDS:g} s. Record again.'
            )
            self._node.console.warning(self.failure)

    def end(self) -> None:
        """Close the recording that runs, if one does, and log what it holds."""
        if self.current is None:
            return
        try:
            self._node.console.info(self._end())
        except RecordingError as error:
            self._node.console.error(str(error))
