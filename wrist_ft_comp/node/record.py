"""The service ~/record: starting and ending the node's own recording."""

from collections.abc import Sequence
from dataclasses import dataclass, field
import math
from pathlib import Path
from typing import Any

from geometry_msgs.msg import WrenchStamped
from std_srvs.srv import SetBool

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.node.input_health import Counts
from wrist_ft_comp.node.recorder import OwnRecording, Recorder, REMEDY
from wrist_ft_comp.ros import messages
from wrist_ft_comp.ros.hub import Hub, Part, Service
from wrist_ft_comp.ros.node_log import NodeLog
from wrist_ft_comp.signals import NANOSECONDS
from wrist_ft_comp.stored.documents import writing
from wrist_ft_comp.stored.model_store import ModelStore
from wrist_ft_comp.wire.cdr import locate, WRENCH_DOUBLES


@dataclass(eq=False)
class RecordService(Part):
    """Starts and ends the node's own recording, and hears the reference wrench meanwhile."""

    _recorder: Recorder
    _store: ModelStore
    _counts: Counts
    _log: NodeLog
    _hub: Hub = field(init=False)
    _reference: Any = None
    #: The recording that runs, and its file, or that of the last one.
    current: OwnRecording | None = None
    path: Path = Path()
    #: Why the last one ended early; empty when it did not.
    failure: str = ''

    title = 'recording'

    def services(self) -> Sequence[Service]:
        """Offer ~/record."""
        return (Service(SetBool, '~/record', self.on_request),)

    def start(self, hub: Hub) -> None:
        """Keep what subscribes."""
        self._hub = hub

    def on_request(self, request: Any, _reply: Any) -> str:
        """Start or end the recording, as SetBool's data says; say where to, or what it holds."""
        return self._begin() if request.data else self._finish()

    def _begin(self) -> str:
        """Start recording; say where to."""
        from wrist_ft_comp.recordings import csv_file  # noqa: PLC0415 -- rare

        if self.current is not None:
            raise RecordingError(
                f'A recording runs already, into {self.path}. End it first, with data: false.'
            )
        # Only while recording: a reference at a kilohertz costs as much as the wrench itself. And
        # first of all: an override of its quality of service that cannot be had is refused here.
        reference = self._hub.subscribe_for(
            self, WrenchStamped, 'wrench_reference', self.on_reference, messages.FAST_SENSOR
        )
        try:
            with writing(self._store.directory):
                path = self._store.new_recording_path()
                origin = csv_file.origin_column(self._recorder.sensor())
                columns = *self._recorder.channels, origin
                writer = csv_file.CsvRecordingWriter(path, columns)
        except RecordingError as error:
            self._hub.destroy_subscription(reference)
            raise RecordingError(f'{error} {REMEDY}.') from error
        self._reference, self.path, self.failure = reference, path, ''
        self.current = self._recorder.begin(writer, self._fail, self._follow_period)
        return f'recording into {path}'

    def _finish(self) -> str:
        """End the recording; say what it holds."""
        recording = self.current
        if recording is None:
            raise RecordingError(self.failure or 'No recording runs. Start one with data: true.')
        self._recorder.leave(recording)
        self._forget()
        recording.close()
        seconds = recording.rows * recording.period_ns / NANOSECONDS
        return f'recorded {recording.rows} thermal cells ({seconds:.0f} s) into {self.path}'

    def _forget(self) -> None:
        """Listen to the reference no longer."""
        self.current = None
        self._hub.destroy_subscription(self._reference)

    def on_reference(self, data: bytes) -> None:
        """Take one reference wrench."""
        try:
            stamp_ns, reference = locate(data, WRENCH_DOUBLES).decode(data)
        except RecordingError:
            self._counts.bad_references += 1
            return
        if not math.isfinite(sum(reference)):
            self._counts.bad_references += 1
        elif self.current is not None:
            at_ns = stamp_ns or self._hub.now_ns()
            self.current.averager.add_reference(at_ns, reference)

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

    def end(self) -> bool:
        """Close the recording that runs, if one does, and log what it holds."""
        if self.current is not None:
            try:
                self._log.info(self._finish())
            except RecordingError as error:
                self._log.error(str(error))
        return False
