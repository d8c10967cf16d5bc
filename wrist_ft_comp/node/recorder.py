"""The part that averages what the node's own recordings get, and that answers ~/record."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
import math
from pathlib import Path
import time
from typing import Any, cast

from geometry_msgs.msg import WrenchStamped
from std_srvs.srv import SetBool

from wrist_ft_comp.channels import (
    AXES,
    FORCE_CHANNELS,
    LARGEST,
    REFERENCE_CHANNELS,
    temperature_channel,
)
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.learning.days import go_on, span_of
from wrist_ft_comp.node.live_model import LiveModel
from wrist_ft_comp.ros.diagnostics import ERROR, OK
from wrist_ft_comp.ros.hub import Part, Vector
from wrist_ft_comp.ros.services import service, warned, Work
from wrist_ft_comp.ros.topics import FAST_SENSOR
from wrist_ft_comp.series import NANOSECONDS
from wrist_ft_comp.stored.recording_writer import CsvRecordingWriter, origin_column
from wrist_ft_comp.stored.safe_file import writing
from wrist_ft_comp.stream import thermal_cells as grid
from wrist_ft_comp.wire.cdr import locate, WRENCH_DOUBLES

#: A warning comes where a channel was not recorded for this time, s; shorter gaps do no harm.
LACKING_S = 60.0
#: Rows that are farther apart, ns, are of a clock that was set: a computer began in 1970.
_OTHER_CLOCK_NS = 86_400 * NANOSECONDS
#: So are rows that are this far before the newest, ns: such a file could not be read.
_SET_BACK_NS = 5 * NANOSECONDS
#: A recording that was cut off goes on after this time at most, s.
_CUT_OFF_S = 600.0
#: The answer of ~/record warns where more than this share of the rows holds no wrench.
_LACKING_SHARE = 0.1


@dataclass(eq=False)
class OwnRecording:
    """A recording in progress, with what averages for it."""

    averager: grid.CellAverager
    #: Has ``append(stamp_ns, values)`` and ``close()``, RecordingError when the disk refuses.
    writer: Any
    #: Where the disk has refused, nothing is written for this time, s.
    pause_s: float = math.inf
    #: Ends a writer and gives another, for rows of another clock.
    renew: Callable[[Any], Any] | None = None
    rows: int = 0
    #: Whether a reference wrench has come, of whatever clock.
    has_reference: bool = False
    #: Stamp of the newest row, ns.
    last_ns: int | None = None
    #: Why the disk refused the newest row that was to be written; None while all is well.
    error: RecordingError | None = None
    #: When the newest row came, and when rows are written again, by the steady clock.
    came_s: float = field(default_factory=time.monotonic)
    goes_on_s: float = 0.0
    #: By channel, how many of the newest rows, and of all, have no value of it.
    lacking: Counter[str] = field(default_factory=Counter)
    lacked: Counter[str] = field(default_factory=Counter)

    def write(self, channels: Sequence[str], rows: Sequence[grid.Row]) -> None:
        """Write rows, and note what they lack."""
        for stamp_ns, values in rows:
            self.came_s = time.monotonic()
            if self.came_s < self.goes_on_s:
                return
            later_ns = 1 if self.last_ns is None else stamp_ns - self.last_ns
            absent = [name for name, v in zip(channels, values, strict=True) if math.isnan(v)]
            if self.renew is not None and later_ns <= 0 and set(absent).issuperset(AXES):
                continue  # a temperature from before a silence, or of another clock
            is_far = not -_SET_BACK_NS <= later_ns <= _OTHER_CLOCK_NS
            self.last_ns = stamp_ns
            try:
                if is_far and self.renew is not None:
                    self.writer = self.renew(self.writer)
                self.writer.append(stamp_ns, values)
            except RecordingError as error:
                self.error, self.goes_on_s = error, self.came_s + self.pause_s
                return
            self.error = None
            self.rows += 1
            self.lacked.update(absent)
            self.lacking = Counter({name: self.lacking[name] + 1 for name in absent})


class Recorder(Part):
    """
    Feeds all recordings that run, and starts and ends the one of ``~/record``.

    While none runs, it hears no wrenches, and no reference wrench while that of ``~/record`` does
    not. Its cells have the length that thermal cells have without a model, and keep it, whichever
    model goes live.
    """

    title = 'recording'
    topics = (('wrench_reference', 'true wrench; subscribed to while recording only'),)

    def __init__(self, live: LiveModel, *, with_force: bool) -> None:
        self._compensator, self._with_force = live.compensator, with_force
        self._store, self._writer, self.sensor = live.store, live.writer, live.sensor
        #: Names of a row's values.
        self.channels = grid.row_channels(live.compensator.thermometers, with_force=with_force)
        #: Length of a row's cell, s and ns.
        self.period_s = live.compensator.settings.thermal_period_s
        self.period_ns = round(NANOSECONDS * self.period_s)
        self._running: list[OwnRecording] = []
        #: That of ``~/record``, its file, or that of the last one, and its subscription.
        self.current: OwnRecording | None = None
        self.path, self._reference = Path(), cast('Any', None)
        #: Why the last one ended early; empty when it did not.
        self.failure = ''
        #: What was special, in words for an answer: the node was killed, or a clock was set.
        self._remark = ''

    def start(self) -> None:
        """Go on with a recording that was cut off just now, when the node was killed."""
        path, age_s = self._store.cut_off_recording()
        if path is None:
            return
        self.failure = f'{path} was cut off when the node was killed; record again if it is short'
        if not 0 <= age_s <= _CUT_OFF_S:  # as by the evening's power switch
            self._store.mark_recording(None)
            return
        answer = self.hub.do(self, self.begin, path)
        if answer is not None:
            self._remark = ' since the node was started again'
            self.hub.log.warning(f'the node was killed while it recorded; now {answer}')

    def doubt(self) -> str:
        """Say what a recording lacks that it needs, or had before, for LACKING_S; else empty."""
        for recording in self._running:
            for source, cells in self._lacking(recording):
                if (lacking_s := self.period_s * cells) >= LACKING_S:
                    return (
                        f'the last {lacking_s:.0f} s were recorded without {source}, and nothing '
                        'can be learnt from that: it is silent, or its stamps are of another '
                        'clock; mend that, then record again'
                    )
        return ''

    def _lacking(self, recording: OwnRecording) -> Iterator[tuple[str, int]]:
        """Name what the newest rows lack, and how many these are; thermometers: all rows."""
        sources: dict[str, Sequence[str]] = {'raw wrenches': AXES}
        if self._with_force:
            sources['specific force'] = FORCE_CHANNELS
        if recording.has_reference:
            sources['wrench_reference'] = REFERENCE_CHANNELS
        for j in range(self._compensator.thermometers):  # some report seldom
            if recording.lacked[temperature_channel(j)] == recording.rows:
                sources[f'thermometer {j + 1}'] = (temperature_channel(j),)
        for source, channels in sources.items():
            yield source, min(recording.lacking[channel] for channel in channels)

    def begin_recording(self, writer: Any, pause_s: float = math.inf) -> OwnRecording:
        """Feed a new recording until ``finish``; where the disk refuses, after a pause again."""
        thermometers = self._compensator.thermometers
        averager = grid.CellAverager(self.period_ns, thermometers, with_force=self._with_force)
        recording = OwnRecording(averager, writer, pause_s)
        self._running.append(recording)
        self.hub.listen(self, wanted=True)
        return recording

    def finish(self, recording: OwnRecording) -> None:
        """Write all that a recording gets, and let go of it; its owner closes its writer."""
        recording.write(self.channels, recording.averager.rows(final=True))
        self._running = [other for other in self._running if other is not recording]
        self.hub.listen(self, wanted=bool(self._running))

    def on_wrench(self, stamp_ns: int, raw: Sequence[float], *_: Any) -> None:
        """Take one raw wrench, N and N m."""
        for recording in self._running:
            recording.averager.add(grid.RAW, stamp_ns, raw)

    def on_specific_force(self, stamp_ns: int, force: Vector, speed: float | None) -> None:
        """Take one specific force, m/s², and the speed of rotation, rad/s, where it is known."""
        values = force if speed is None else (*force, speed * speed)
        for recording in self._running:
            recording.averager.add(grid.FORCE, stamp_ns, values)

    def on_reference(self, data: bytes) -> None:
        """Take one reference wrench."""
        try:
            stamp_ns, reference = locate(data, WRENCH_DOUBLES).decode(data)
        except RecordingError:
            return
        numbers = [value for value in reference if not math.isnan(value)]
        if self.current is not None and numbers and math.hypot(*numbers) < LARGEST:
            self.current.has_reference = True
            self.current.averager.add(grid.REFERENCE, stamp_ns or self.hub.now_ns(), reference)

    def on_cells(self, cells: Sequence[grid.ThermalCell], _stamp_ns: int) -> None:
        """Take the temperatures of thermal cells, which the live model may have made longer."""
        thermal_ns, own_ns = self._compensator.tracker.grid.period_ns, self.period_ns
        own = [
            replace(cell, number=(cell.number * thermal_ns + thermal_ns // 2) // own_ns)
            for cell in cells
        ]
        for recording in self._running:
            recording.averager.add_cells(own)
        self.poll()

    def poll(self) -> None:
        """Write the rows there are; a full disk ends a recording, not the stream."""
        for recording in self._running:
            recording.write(self.channels, recording.averager.rows())
        current = self.current
        if current is not None and current.error is not None:
            self.failure = self._ended(str(current.error), current.rows)
            self._close(current)

    @service(
        '~/record', "starts (data: true) or ends (data: false) the node's own recording", SetBool
    )
    def record(self, request: Any) -> Work:
        """Start or end the recording, as SetBool's data says; say where to, or what it holds."""
        if request.data:
            return self.begin()
        if (recording := self.current) is None:
            raise RecordingError(self.failure or 'No recording runs. Start one with ~/record.')
        problems: list[str] = []
        self._close(recording, problems.append)
        while not problems:
            yield
        if problem := str(recording.error or problems[0]):
            raise RecordingError(self._ended(problem, recording.rows))
        rows, lacks = recording.rows, ''
        lost = min(recording.lacked[axis] for axis in AXES)
        if not rows:
            lacks = 'nothing was recorded, because no temperature came; see its status'
        elif lost > max(_LACKING_SHARE * rows, 1):
            lacks = (
                f'{lost} of {rows} cells hold no wrench, and nothing is learnt from them: less '
                f'than one came in {self.period_s:g} s of its stamps'
            )
        elif never := [source for source, cells in self._lacking(recording) if cells == rows]:
            lacks = f'{", ".join(never)} reported in no cell of these stamps'
        length = f'{rows} thermal cells ({rows * self.period_s:.0f} s)'
        return warned(f'recorded {length}{self._remark} into {self.path}', lacks)

    def begin(self, cut_off: Path | None = None) -> str:
        """Start the recording of ``~/record``, or go on with one; say where to."""
        if self.current is not None:
            raise RecordingError(
                f'A recording runs already, into {self.path}. End it first, with data: false.'
            )
        # Only while recording: a reference at a kilohertz costs as much as the wrench itself. And
        # first of all: an override of its quality of service that cannot be had is refused here.
        take = self.hub.guarded(self, self.on_reference)
        reference = self.hub.subscribe(WrenchStamped, 'wrench_reference', take, FAST_SENSOR)
        try:
            with writing(self._store.directory):
                path, writer, last_ns = cut_off or Path(), None, None
                if cut_off is not None and (span := span_of(path)) is not None:
                    writer = go_on(CsvRecordingWriter, path, span, self.channels, self.sensor())
                    last_ns = span.last_ns // NANOSECONDS  # its stamps are in ns, not in s
                if writer is None:
                    path, last_ns = self._store.new_recording_path(), None
                    writer = CsvRecordingWriter(path, self._columns())
        except RecordingError as error:
            self.hub.destroy_subscription(reference)
            remedy = 'Make room or choose another data_directory.'
            raise RecordingError(f'{error} {remedy}') from error
        self._reference, self.path, self.failure, self._remark = reference, path, '', ''
        self._store.mark_recording(path)
        self.current = self.begin_recording(writer)
        self.current.renew, self.current.last_ns = self._renew, last_ns
        return f'recording into {path}'

    def _columns(self) -> tuple[str, ...]:
        return *self.channels, origin_column(self.sensor())

    def _renew(self, writer: CsvRecordingWriter) -> CsvRecordingWriter:
        """Go on in another file, because a clock was set."""
        self._writer.put(str(self.path), writer.close)
        self._remark = f', those before a clock was set in {self.path},'
        with writing(self._store.directory):
            self.path = self._store.new_recording_path()
            self._store.mark_recording(self.path)
            return CsvRecordingWriter(self.path, self._columns())

    def _close(self, recording: OwnRecording, then: Callable[[str], None] | None = None) -> None:
        """End the recording of ``~/record``; ``then`` gets why its file could not be closed."""
        self.current = None
        self.hub.destroy_subscription(self._reference)
        self.finish(recording)
        self._store.mark_recording(None)
        self._writer.put(str(self.path), recording.writer.close, then)

    def _ended(self, problem: str, rows: int) -> str:
        return (
            f'{problem} The recording has ended after {rows} thermal cells. See that its file '
            'stays and the disk has room, or choose another data_directory, then record again.'
        )

    def end(self) -> None:
        """Close the recording that runs, if one does, and log what it holds."""
        if (recording := self.current) is not None:

            def report(problem: str) -> None:
                said = f'recorded {recording.rows} thermal cells into {self.path}'
                self.hub.log.write(ERROR if problem else OK, problem or said)

            self._close(recording, report)
