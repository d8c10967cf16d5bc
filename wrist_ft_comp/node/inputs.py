"""The part that hears thermometers, and judges all that comes in."""

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass
import time

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.node.field_inputs import FieldInputs
from wrist_ft_comp.node.gravity import Gravity
from wrist_ft_comp.node.input_health import InputHealth
from wrist_ft_comp.node.input_status import judge_temperatures, judge_wrenches
from wrist_ft_comp.node.live_model import LiveModel
from wrist_ft_comp.node.snapshot import Snapshot
from wrist_ft_comp.node.state_keeper import StateKeeper
from wrist_ft_comp.ros.hub import Hub, Part
from wrist_ft_comp.ros.node_log import Status
from wrist_ft_comp.ros.topic_types import wrong_type
from wrist_ft_comp.signals import is_plausible
from wrist_ft_comp.stream.compensator import Compensator, Wrench
from wrist_ft_comp.stream.stream_grid import CompletedCells
from wrist_ft_comp.wire.cdr import locate, TEMPERATURE_DOUBLES, WRENCH, WRENCH_DOUBLES
from wrist_ft_comp.wire.temperature_source import TemperatureSource

#: The newest raw wrench: stamp, ns, six numbers, N and N m, and the message's bytes.
Newest = tuple[int, Sequence[float], bytes]


@dataclass(eq=False)
class Inputs(Part):
    """Gives temperatures to the stream; thermometers are counted from 0."""

    _sources: Sequence[TemperatureSource]
    #: Full name of each thermometer's topic.
    topics: Sequence[str]
    _compensator: Compensator
    _newest: Callable[[], Newest | None]
    health: InputHealth
    _gravity: Gravity
    _live: LiveModel
    _state_keeper: StateKeeper

    title = 'temperature'

    def start(self, hub: Hub) -> None:
        """Subscribe to every thermometer."""
        self._hub = hub
        self._reported = time.monotonic(), copy(self.health.counts)
        self._wrench_topic = hub.resolve_topic_name('wrench_raw')
        named = zip(self.topics, self._sources, strict=True)
        heard = hub.guarded(self, self.on_temperature)
        self.fields = FieldInputs(hub, named, self._take, heard)

    def on_temperature(self, thermometer: int, data: bytes) -> None:
        """Take one sensor_msgs/Temperature."""
        try:
            stamp_ns, (temperature_c, _) = locate(data, TEMPERATURE_DOUBLES).decode(data)
        except RecordingError:
            self.health.counts.bad_temperatures += 1
            return
        self._take(thermometer, stamp_ns, temperature_c)

    def _take(self, thermometer: int, stamp_ns: int | None, temperature_c: float) -> None:
        """Give one temperature, °C, to the thermal grid; stamps, ns, are as in field_inputs."""
        if not is_plausible(temperature_c):
            self.health.drop_temperature(thermometer, temperature_c)
            return
        at_ns, newest = stamp_ns or self._hub.now_ns(), self._newest()
        # What comes from it would else be too late for the recording's cell.
        self._hub.do(self._gravity, self._gravity.poll)
        wrench: Wrench | None = newest and newest[:2]
        cells = self._compensator.add_temperature(thermometer, at_ns, temperature_c, wrench)
        stamped = None if stamp_ns is None else stamp_ns != 0
        self.health.take_temperature(time.monotonic(), thermometer, at_ns, stamped=stamped)
        if cells:
            self._hub.tell('on_cells', cells, at_ns)

    def on_cells(self, cells: Sequence[CompletedCells], _stamp_ns: int) -> None:
        """Watch for thermometers that jump."""
        for completed in cells:
            self.health.thermometers.look(completed, self._compensator.tracker.grid.period_ns)

    def poll(self) -> None:
        """Take temperatures that are fields, and look for faults that no single message shows."""
        self.fields.poll()
        self._look()

    def _look(self) -> None:
        """Look for faults that no single message shows."""
        now_s, newest = time.monotonic(), self._newest()
        if newest is not None:
            stamp_ns, raw, data = newest
            layout = locate(data, WRENCH_DOUBLES)
            stamped, frame = bool(layout.decode(data)[0]), layout.frame_id(data)
            self.health.look(now_s, stamp_ns, raw, frame, stamped=stamped)
        self.health.note_events(now_s, self._compensator.tracker)

    def statuses(self) -> Iterator[Status]:
        """Judge wrenches and thermometers."""
        self.fields.look()
        self._look()
        snapshot = self.snapshot()
        yield judge_wrenches(snapshot)
        yield judge_temperatures(snapshot)

    def snapshot(self) -> Snapshot:
        """Take down what the judges need."""
        hub, wrench = self._hub, self._wrench_topic
        reported_s, before = self._reported
        now_s = time.monotonic()
        self._reported = now_s, copy(self.health.counts)
        return Snapshot(
            now_s=now_s, health=self.health, incompatible=hub.incompatible,
            stream=self._compensator, live=self._live, state_keeper=self._state_keeper,
            before=before, elapsed_s=now_s - reported_s,
            wrench_topic=wrench,
            sources=tuple(self._sources),
            unreadable=self.fields.unreadable, thermometer_problems=self.fields.problems(),
            wrench_publishers=hub.count_publishers(wrench),
            wrench_problem='' if self._newest() else wrong_type(hub, wrench, WRENCH),
            temperature_publishers=tuple(map(hub.count_publishers, self.topics)),
        )  # fmt: skip
