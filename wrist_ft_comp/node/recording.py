"""The parts that feed the node's own recordings, and that answer ~/record."""

from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
import math
from pathlib import Path
from typing import Any, Protocol

from geometry_msgs.msg import WrenchStamped
from std_srvs.srv import SetBool

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.node.inputs import Counts
from wrist_ft_comp.ros import messages
from wrist_ft_comp.ros.hub import Hub
from wrist_ft_comp.ros.node_log import NodeLog
from wrist_ft_comp.ros.part import Part, Service, Vector
from wrist_ft_comp.signals import (
    FORCE_CHANNELS,
    LARGEST,
    NANOSECONDS,
    REFERENCE_CHANNELS,
    SensorNames,
)
from wrist_ft_comp.stored.documents import writing
from wrist_ft_comp.stored.model_store import ModelStore
from wrist_ft_comp.stream.cell_averager import CellAverager, row_channels
from wrist_ft_comp.stream.compensator import Compensator
from wrist_ft_comp.stream.stream_grid import ThermalCell
from wrist_ft_comp.wire.cdr import locate, WRENCH_DOUBLES

#: What to do, in every message about a disk that refuses.
REMEDY = 'Make room or choose another data_directory'
#: A warning comes where a channel was not recorded for this time, s; shorter gaps do no harm.
LACKING_S = 60.0


class Writer(Protocol):
    """Takes rows of a stamp, ns, and a value per channel; RecordingError when the disk refuses."""

    def append(self, stamp_ns: int, values: Sequence[float]) -> None:
        """Write a row."""

    def close(self) -> None:
        """Write what is left."""


@dataclass(eq=False)
class OwnRecording:
    """A recording in progress, a row per thermal cell; RecordingError when the disk refuses."""

    _writer: Writer
    averager: CellAverager
    period_ns: int
    #: Called when the disk refuses; nothing more is written after that.
    on_failure: Callable[[RecordingError], None]
    #: Called when a new model has thermal cells of another length.
    on_period: Callable[[], None]
    #: Names of a row's values.
    channels: Sequence[str]
    rows: int = 0
    #: By channel, how many of the newest rows have no value of it.
    lacking: Counter[str] = field(default_factory=Counter)

    def lacking_s(self, channel: str) -> float:
        """Find for how long nothing of a channel was recorded, s."""
        return self.lacking[channel] * self.period_ns / NANOSECONDS

    def write(self, *, final: bool = False) -> None:
        """Append the rows that are complete; all there are when nothing more will come."""
        try:
            for stamp_ns, values in self.averager.rows(final=final):
                self._writer.append(stamp_ns, values)
                self.rows += 1
                for channel, value in zip(self.channels, values, strict=True):
                    self.lacking[channel] = self.lacking[channel] + 1 if math.isnan(value) else 0
        except RecordingError:
            with suppress(RecordingError):  # what the disk took stays, the rest is lost
                self._writer.close()
            raise

    def close(self) -> None:
        """Write what is left, and close, also when the disk refuses."""
        self.write(final=True)
        self._writer.close()


class Recorder(Part):
    """Feeds the recordings that run; while there is none, it does not listen to wrenches."""

    title = 'recorder'
    hub: Hub

    def __init__(
        self, compensator: Compensator, sensor: Callable[[], SensorNames], *, with_force: bool
    ) -> None:
        self.thermometers = compensator.thermometers
        #: Names of a row's values.
        self.channels = row_channels(self.thermometers, with_force=with_force)
        #: Gives the names of the sensor.
        self.sensor = sensor
        self._compensator = compensator
        self._with_force = with_force
        self._running: list[OwnRecording] = []

    def _listen(self) -> None:
        """Listen to wrenches while a recording runs."""
        self.hub.listen(self, wanted=bool(self._running))

    @property
    def records_force(self) -> bool:
        """Whether a recording runs that is to hold specific force."""
        return self._with_force and bool(self._running)

    @property
    def lacking_force(self) -> bool:
        """Whether a recording has got no specific force for LACKING_S."""
        return any(one.lacking_s(FORCE_CHANNELS[0]) >= LACKING_S for one in self._running)

    @property
    def period_ns(self) -> int:
        """Length of a row's thermal cell, ns."""
        return self._compensator.tracker.grid.period_ns

    def begin(
        self,
        writer: Writer,
        on_failure: Callable[[RecordingError], None],
        on_period: Callable[[], None],
    ) -> OwnRecording:
        """Feed a new recording from now on; OwnRecording says when the callbacks are called."""
        period_ns = self.period_ns
        averager = CellAverager(period_ns, self.thermometers, with_force=self._with_force)
        recording = OwnRecording(writer, averager, period_ns, on_failure, on_period, self.channels)
        self._running.append(recording)
        self._listen()
        return recording

    def leave(self, recording: OwnRecording) -> None:
        """Feed a recording no longer; its owner closes it."""
        self._running.remove(recording)
        self._listen()

    def on_wrench(self, stamp_ns: int, raw: Sequence[float], *_: Any) -> None:
        """Take one raw wrench, N and N m."""
        for recording in self._running:
            recording.averager.add_raw(stamp_ns, raw)

    def on_force(self, stamp_ns: int, force: Vector, speed: float | None) -> None:
        """Take one specific force, m/s², and the speed of rotation, rad/s, where it is known."""
        for recording in self._running:
            recording.averager.add_force(stamp_ns, force, speed)

    def on_cells(self, cells: Sequence[ThermalCell], _stamp_ns: int) -> None:
        """Append rows for thermal cells."""
        for recording in self._running:
            recording.averager.add_cells(cells)
        self.poll()

    def poll(self) -> None:
        """Append the rows there are; a full disk ends a recording, not the stream."""
        for recording in tuple(self._running):
            self._write(recording)

    def _write(self, recording: OwnRecording) -> None:
        """Append what is complete, or end the recording."""
        try:
            recording.write()
        except RecordingError as error:
            self.leave(recording)
            recording.on_failure(error)

    def on_model(self) -> None:
        """Call on_period of recordings with other thermal cells than the new model has."""
        for recording in tuple(self._running):
            if recording.period_ns != self.period_ns:
                recording.on_period()


@dataclass(eq=False)
class RecordService(Part):
    """Starts and ends the node's own recording, and hears the reference wrench meanwhile."""

    _recorder: Recorder
    _store: ModelStore
    _counts: Counts
    _log: NodeLog
    hub: Hub = field(init=False)
    _reference: Any = None
    #: The recording that runs, and its file, or that of the last one.
    current: OwnRecording | None = None
    path: Path = Path()
    #: Why the last one ended early; empty when it did not.
    failure: str = ''
    #: Whether the one that runs has heard its reference.
    _heard: bool = False

    title = 'recording'

    def services(self) -> Sequence[Service]:
        """Offer ~/record."""
        return (Service(SetBool, '~/record', self.on_request),)

    def on_request(self, request: Any, _reply: Any) -> str:
        """Start or end the recording, as SetBool's data says; say where to, or what it holds."""
        return self._begin() if request.data else self._finish()

    def _begin(self) -> str:
        """Start recording; say where to."""
        from wrist_ft_comp.recordings import csv_writer  # noqa: PLC0415 -- rare

        if self.current is not None:
            raise RecordingError(
                f'A recording runs already, into {self.path}. End it first, with data: false.'
            )
        # Only while recording: a reference at a kilohertz costs as much as the wrench itself. And
        # first of all: an override of its quality of service that cannot be had is refused here.
        take = self.hub.guarded(self, self.on_reference)
        reference = self.hub.subscribe(
            WrenchStamped, 'wrench_reference', take, messages.FAST_SENSOR
        )
        try:
            with writing(self._store.directory):
                path = self._store.new_recording_path()
                origin = csv_writer.origin_column(self._recorder.sensor())
                columns = *self._recorder.channels, origin
                writer = csv_writer.CsvRecordingWriter(path, columns)
        except RecordingError as error:
            self.hub.destroy_subscription(reference)
            raise RecordingError(f'{error} {REMEDY}.') from error
        self._reference, self.path, self.failure, self._heard = reference, path, '', False
        self.current = self._recorder.begin(writer, self._fail, self._follow_period)
        return f'recording into {path}'

    def _finish(self) -> str:
        """End the recording; say what it holds."""
        recording = self.current
        if recording is None:
            raise RecordingError(self.failure or 'No recording runs. Start one with data: true.')
        self._recorder.leave(recording)
        self._forget()
        try:
            recording.close()
        except RecordingError as error:
            raise RecordingError(_ended(error, recording.rows)) from error
        seconds = recording.rows * recording.period_ns / NANOSECONDS
        return f'recorded {recording.rows} thermal cells ({seconds:.0f} s) into {self.path}'

    def _forget(self) -> None:
        self.current = None
        self.hub.destroy_subscription(self._reference)

    def on_reference(self, data: bytes) -> None:
        """Take one reference wrench."""
        try:
            stamp_ns, reference = locate(data, WRENCH_DOUBLES).decode(data)
        except RecordingError:
            self._counts.bad_references += 1
            return
        if not math.hypot(*reference) < LARGEST:  # false for NaN
            self._counts.bad_references += 1
        elif self.current is not None:
            self._heard = True
            at_ns = stamp_ns or self.hub.now_ns()
            self.current.averager.add_reference(at_ns, reference)

    def doubt(self) -> str:
        """Say that the reference was heard and is not recorded any more; empty where it is."""
        lacking_s = self.current.lacking_s(REFERENCE_CHANNELS[0]) if self.current else 0.0
        if not self._heard or lacking_s < LACKING_S:
            return ''
        return (
            f'the last {lacking_s:.0f} s were recorded without wrench_reference: it is silent, or '
            'its stamps are of another clock than those of the wrench'
        )

    def _fail(self, error: RecordingError) -> None:
        """Say that the disk has ended the recording."""
        rows = self.current.rows if self.current else 0
        self._forget()
        self.failure = _ended(error, rows)
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


def _ended(error: RecordingError, rows: int) -> str:
    """Say what has ended a recording, and what to do."""
    return (
        f'{error} The recording has ended after {rows} thermal cells. See that its file stays and '
        'the disk has room, or choose another data_directory, then record again.'
    )
