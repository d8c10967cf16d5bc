"""Recordings in progress: what is pushed to the ``Recorder`` goes, as rows, to all that run."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Protocol

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.ros.hub import Hub, Part
from wrist_ft_comp.signals import SensorNames
from wrist_ft_comp.stream.cell_averager import CellAverager, row_channels
from wrist_ft_comp.stream.compensator import Compensator
from wrist_ft_comp.stream.stream_grid import CompletedCells

#: Ends every sentence of a disk that refuses.
REMEDY = 'Make room or choose another data_directory'


class Writer(Protocol):
    """What rows go to: stamp, ns, and a value per channel; RecordingError when it refuses."""

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
    #: Told when the disk refuses, after which nothing more is written, and when thermal cells get
    #: another length.
    on_failure: Callable[[RecordingError], None]
    on_period: Callable[[], None]
    rows: int = 0

    def write(self, *, final: bool = False) -> None:
        """Append the rows that are complete; all there are when nothing more will come."""
        try:
            for stamp_ns, values in self.averager.rows(final=final):
                self._writer.append(stamp_ns, values)
                self.rows += 1
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

    def __init__(
        self, compensator: Compensator, sensor: Callable[[], SensorNames], *, with_force: bool
    ) -> None:
        self.thermometers = compensator.thermometers
        #: Of a row.
        self.channels = row_channels(self.thermometers, with_force=with_force)
        #: Tells what the sensor is called.
        self.sensor = sensor
        self._compensator = compensator
        self._with_force = with_force
        self._running: list[OwnRecording] = []
        self._hub: Hub | None = None

    def start(self, hub: Hub) -> None:
        """Listen to wrenches as soon as a recording runs."""
        self._hub = hub
        self._listen()

    def _listen(self) -> None:
        """Listen to wrenches while somebody wants them."""
        if self._hub is not None:
            self._hub.listen(self, wanted=bool(self._running))

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
        """Let a recording take part; OwnRecording says what its owner is told."""
        period_ns = self.period_ns
        averager = CellAverager(period_ns, self.thermometers, with_force=self._with_force)
        recording = OwnRecording(writer, averager, period_ns, on_failure, on_period)
        self._running.append(recording)
        self._listen()
        return recording

    def leave(self, recording: OwnRecording) -> None:
        """Let nothing more come into a recording, which its owner closes."""
        self._running.remove(recording)
        self._listen()

    def on_wrench(self, stamp_ns: int, raw: Sequence[float], *_: Any) -> None:
        """Take one raw wrench, N and N m."""
        for each in self._running:
            each.averager.add_raw(stamp_ns, raw)

    def on_force(
        self, stamp_ns: int, force: tuple[float, float, float], speed: float | None
    ) -> None:
        """Take one specific force, m/s², and the speed of rotation, rad/s, where it is known."""
        for each in self._running:
            each.averager.add_force(stamp_ns, force, speed)

    def on_cells(self, cells: Sequence[CompletedCells], _stamp_ns: int) -> None:
        """Append rows for thermal cells."""
        for each in self._running:
            each.averager.add_cells(cells)
        self.poll()

    def poll(self) -> None:
        """Append the rows there are; a full disk ends a recording, not the stream."""
        for each in tuple(self._running):
            self._write(each)

    def _write(self, recording: OwnRecording) -> None:
        """Append what is complete, or end the recording."""
        try:
            recording.write()
        except RecordingError as error:
            self.leave(recording)
            recording.on_failure(error)

    def on_model(self) -> None:
        """Tell those whose thermal cells have another length than a new model's."""
        for each in tuple(self._running):
            if each.period_ns != self.period_ns:
                each.on_period()
