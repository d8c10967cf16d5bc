"""The parts that average what the node's own recordings get, and that answer ~/record."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
import math
from pathlib import Path
from typing import Any

from geometry_msgs.msg import WrenchStamped
from std_srvs.srv import SetBool

from wrist_ft_comp.channels import (
    AXES,
    FORCE_CHANNELS,
    LARGEST,
    REFERENCE_CHANNELS,
    SensorNames,
    temperature_channel,
)
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.ros.diagnostics import ERROR, OK
from wrist_ft_comp.ros.hub import Hub, Part, Vector
from wrist_ft_comp.ros.services import Reply, Service
from wrist_ft_comp.ros.topics import FAST_SENSOR
from wrist_ft_comp.series import NANOSECONDS
from wrist_ft_comp.stored.model_store import FileWriter, ModelStore
from wrist_ft_comp.stored.own_file import writing
from wrist_ft_comp.stream.compensator import Compensator
from wrist_ft_comp.stream.stream_grid import (
    CellAverager,
    RAW,
    REFERENCE,
    Row,
    row_channels,
    ThermalCell,
)
from wrist_ft_comp.wire.cdr import locate, WRENCH_DOUBLES

#: A warning comes where a channel was not recorded for this time, s; shorter gaps do no harm.
LACKING_S = 60.0


@dataclass(eq=False)
class OwnRecording:
    """A recording in progress, with what averages for it."""

    averager: CellAverager
    #: Has ``append(stamp_ns, values)`` and ``close()``, RecordingError when the disk refuses.
    writer: Any
    #: Called when the disk refuses; nothing more is written after that.
    on_failure: Callable[[RecordingError], None]
    rows: int = 0
    #: By channel, how many of the newest rows have no value of it.
    lacking: Counter[str] = field(default_factory=Counter)
    #: By channel, its least and its largest value.
    spans: dict[str, tuple[float, float]] = field(default_factory=dict)


class Recorder(Part):
    """
    Feeds all recordings that run; while there is none, it hears no wrenches.

    Its cells have the length that thermal cells have without a model, and keep it, whichever model
    goes live. ``sensor`` gives the names of the sensor.
    """

    title = 'recorder'
    hub: Hub

    def __init__(
        self, compensator: Compensator, sensor: Callable[[], SensorNames], *, with_force: bool
    ) -> None:
        self.thermometers = thermometers = compensator.thermometers
        #: Names of a row's values.
        self.channels = row_channels(thermometers, with_force=with_force)
        self.sensor = sensor
        #: Length of a row's cell, ns.
        self.period_ns = round(NANOSECONDS * compensator.settings.thermal_period_s)
        self._compensator, self._with_force = compensator, with_force
        self._running: list[OwnRecording] = []

    @property
    def thermal_period_ns(self) -> int:
        """Length of the live model's thermal cells, ns; without a model, that of a row's cell."""
        return self._compensator.tracker.grid.period_ns

    def doubt(self) -> str:
        """Say what a recording lacks that it needs, or had before, for LACKING_S; else empty."""
        for recording in self._running:
            rows, had_reference = recording.lacking, REFERENCE_CHANNELS[0] in recording.spans
            lacking_s = min(rows[axis] for axis in AXES) * self.period_ns / NANOSECONDS
            if lacking_s >= LACKING_S:
                return (
                    f'the last {lacking_s:.0f} s were recorded without raw wrenches: they are '
                    'silent, or their stamps are of another clock than those of the temperatures. '
                    'Nothing can be learnt from that; set one clock, then record again'
                )
            for channel, source, is_wanted in (
                (FORCE_CHANNELS[0], 'specific force', self._with_force),
                (REFERENCE_CHANNELS[0], 'wrench_reference', had_reference),
            ):
                lacking_s = rows[channel] * self.period_ns / NANOSECONDS
                if is_wanted and lacking_s >= LACKING_S:
                    return (
                        f'the last {lacking_s:.0f} s were recorded without {source}: it is '
                        'silent, or its stamps are of another clock than those of the wrench'
                    )
        return ''

    def begin(self, writer: Any, on_failure: Callable[[RecordingError], None]) -> OwnRecording:
        """Feed a new recording from now on."""
        averager = CellAverager(self.period_ns, self.thermometers, with_force=self._with_force)
        recording = OwnRecording(averager, writer, on_failure)
        self._running.append(recording)
        self.hub.listen(self, wanted=True)
        return recording

    def finish(self, recording: OwnRecording) -> None:
        """
        Write all that a recording gets, and let go of it; its owner closes its writer.

        RecordingError when the disk refuses.
        """
        self._leave(recording)
        if error := self._write(recording, recording.averager.rows(final=True)):
            raise error

    def _leave(self, recording: OwnRecording) -> None:
        self._running.remove(recording)
        self.hub.listen(self, wanted=bool(self._running))

    def _write(self, recording: OwnRecording, rows: Sequence[Row]) -> RecordingError | None:
        """Write rows into a recording, and note what they lack; give why the disk refuses."""
        try:
            for stamp_ns, values in rows:
                recording.writer.append(stamp_ns, values)
                recording.rows += 1
                for channel, value in zip(self.channels, values, strict=True):
                    count = recording.lacking[channel] + 1 if math.isnan(value) else 0
                    recording.lacking[channel] = count
                    if not count:
                        least, most = recording.spans.get(channel, (value, value))
                        recording.spans[channel] = min(least, value), max(most, value)
        except RecordingError as error:
            return error
        return None

    def on_wrench(self, stamp_ns: int, raw: Sequence[float], *_: Any) -> None:
        """Take one raw wrench, N and N m."""
        for recording in self._running:
            recording.averager.add(RAW, stamp_ns, raw)

    def on_specific_force(
        self, stamp_ns: int, specific_force: Vector, speed: float | None
    ) -> None:
        """Take one specific force, m/s², and the speed of rotation, rad/s, where it is known."""
        for recording in self._running:
            recording.averager.add_force(stamp_ns, specific_force, speed)

    def on_cells(self, cells: Sequence[ThermalCell], _stamp_ns: int) -> None:
        """Take the temperatures of thermal cells, which the live model may have made longer."""
        if not self._running:
            return
        thermal_ns = self.thermal_period_ns
        if thermal_ns != self.period_ns:
            middles = [cell.number * thermal_ns + thermal_ns // 2 for cell in cells]
            cells = [
                replace(cell, number=middle_ns // self.period_ns)
                for cell, middle_ns in zip(cells, middles, strict=True)
            ]
        for recording in self._running:
            recording.averager.add_cells(cells)
        self.poll()

    def poll(self) -> None:
        """Write the rows there are; a full disk ends a recording, not the stream."""
        for recording in tuple(self._running):
            if error := self._write(recording, recording.averager.rows()):
                self._leave(recording)
                recording.on_failure(error)


@dataclass(eq=False, kw_only=True)
class RecordService(Part):
    """
    Starts and ends the node's own recording, and hears the reference wrench meanwhile.

    ``writer`` waits for the disk at its end, so that no wrench does.
    """

    recorder: Recorder
    store: ModelStore
    writer: FileWriter
    hub: Hub = field(init=False)
    #: The recording that runs, and its file, or that of the last one.
    current: OwnRecording | None = None
    path: Path = Path()
    #: Why the last one ended early; empty when it did not.
    failure: str = ''
    _reference: Any = None

    title = 'recording'
    topics = (('wrench_reference', 'true wrench; subscribed to while recording only'),)

    @classmethod
    def services(cls) -> Sequence[Service]:
        """Offer ~/record."""
        purpose = "starts (data: true) or ends (data: false) the node's own recording"
        return (Service(SetBool, '~/record', purpose, cls.on_request),)

    def on_request(self, request: Any, reply: Reply) -> str | None:
        """Start or end the recording, as SetBool's data says; say where to, or what it holds."""
        if request.data:
            return self.begin()
        if self.current is None:
            raise RecordingError(self.failure or 'No recording runs. Start one with data: true.')
        self._finish(self.current, reply)
        return None

    def begin(self) -> str:
        """Start recording; say where to."""
        from wrist_ft_comp.recordings import table_form  # noqa: PLC0415 -- rare
        from wrist_ft_comp.recordings.read_options import origin_column  # noqa: PLC0415

        if self.current is not None:
            raise RecordingError(
                f'A recording runs already, into {self.path}. End it first, with data: false.'
            )
        # Only while recording: a reference at a kilohertz costs as much as the wrench itself. And
        # first of all: an override of its quality of service that cannot be had is refused here.
        take = self.hub.guarded(self, self.on_reference)
        reference = self.hub.subscribe(WrenchStamped, 'wrench_reference', take, FAST_SENSOR)
        try:
            with writing(self.store.directory):
                path = self.store.new_recording_path()
                origin = origin_column(self.recorder.sensor())
                writer = table_form.CsvRecordingWriter(path, (*self.recorder.channels, origin))
        except RecordingError as error:
            self.hub.destroy_subscription(reference)
            remedy = 'Make room or choose another data_directory.'
            raise RecordingError(f'{error} {remedy}') from error
        self._reference, self.path, self.failure = reference, path, ''
        self.current = self.recorder.begin(writer, self._fail)
        return f'recording into {path}'

    def _finish(self, recording: OwnRecording, reply: Callable[..., None]) -> None:
        """End the recording; answer what it holds when that is on the disk."""
        path, problem = self.path, ''
        self._forget()
        try:
            self.recorder.finish(recording)
        except RecordingError as error:
            problem = str(error)
        rows = recording.rows
        seconds = rows * self.recorder.period_ns / NANOSECONDS

        def answer(unwritten: str) -> None:
            if why := problem or unwritten:
                reply(success=False, message=_ended(why, rows))
            else:
                said = f'recorded {rows} thermal cells ({seconds:.0f} s) into {path}'
                reply(success=True, message=said)

        self.writer.put(str(path), recording.writer.close, answer)

    def _forget(self) -> None:
        self.current = None
        self.hub.destroy_subscription(self._reference)

    def on_reference(self, data: bytes) -> None:
        """Take one reference wrench."""
        try:
            stamp_ns, reference = locate(data, WRENCH_DOUBLES).decode(data)
        except RecordingError:
            return
        # The comparison is false for NaN.
        if self.current is not None and math.hypot(*reference) < LARGEST:
            self.current.averager.add(REFERENCE, stamp_ns or self.hub.now_ns(), reference)

    def spans(self) -> dict[str, str]:
        """Give how long the present recording is, and which temperatures it spans."""
        if self.current is None or not self.current.rows:
            return {}
        values = {'recording_s': f'{self.current.rows * self.recorder.period_ns / NANOSECONDS:g}'}
        for j in range(self.recorder.thermometers):
            if span := self.current.spans.get(temperature_channel(j)):
                values[f'recording_thermometer_{j + 1}_c'] = '{:.1f} to {:.1f}'.format(*span)
        return values

    def _fail(self, error: RecordingError) -> None:
        if (recording := self.current) is not None:
            self._forget()
            self.writer.put(str(self.path), recording.writer.close)
            self.failure = _ended(str(error), recording.rows)
            self.hub.log.error(self.failure)

    def end(self) -> bool:
        """Close the recording that runs, if one does, and log what it holds."""

        def report(*, success: bool, message: str) -> None:
            self.hub.log.write(OK if success else ERROR, message)

        if self.current is not None:
            self._finish(self.current, report)
        return False


def _ended(problem: str, rows: int) -> str:
    return (
        f'{problem} The recording has ended after {rows} thermal cells. See that its file stays '
        'and the disk has room, or choose another data_directory, then record again.'
    )
