"""The node ``compensator``: what it hears and offers, wired to the stream and to its services."""

from collections.abc import Callable, Sequence
from copy import copy
from functools import partial
import math
import sys
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from sensor_msgs.msg import Temperature
from std_srvs.srv import SetBool, Trigger

from wrist_ft_comp.errors import RecordingError, SettingsError, WristFtCompError
from wrist_ft_comp.files.cdr import locate, TEMPERATURE_DOUBLES, WRENCH, WRENCH_DOUBLES
from wrist_ft_comp.files.model_store import ModelStore, node_directory
from wrist_ft_comp.model.drift_model import DriftModel
from wrist_ft_comp.model.signals import Topics
from wrist_ft_comp.model.temperature_source import parse_sources, TemperatureSource
from wrist_ft_comp.ros import messages
from wrist_ft_comp.ros.arguments.unknown import tell_unknown
from wrist_ft_comp.ros.arguments.usage import usage
from wrist_ft_comp.ros.diagnostics import diagnostic_array, diagnostics
from wrist_ft_comp.ros.gravity.source import GravitySource
from wrist_ft_comp.ros.inputs.field_inputs import FieldInputs
from wrist_ft_comp.ros.inputs.health import InputHealth
from wrist_ft_comp.ros.inputs.raw_node import RawNode
from wrist_ft_comp.ros.inputs.topic_types import no_temperature, wrong_type
from wrist_ft_comp.ros.learning.learning import Learner
from wrist_ft_comp.ros.learning.status import learning_status
from wrist_ft_comp.ros.live_model import LiveModel
from wrist_ft_comp.ros.parameters import declare, NODE_NAME, PARAMETERS, values
from wrist_ft_comp.ros.payload.external_wrench import ExternalWrench, Shelf
from wrist_ft_comp.ros.payload.identify import IdentifyService
from wrist_ft_comp.ros.payload.status import PayloadReport
from wrist_ft_comp.ros.running import node_per_sensor, run_nodes
from wrist_ft_comp.ros.services.calibrate import CalibrateService, JobMaker
from wrist_ft_comp.ros.services.deferred import DeferredService
from wrist_ft_comp.ros.services.record import RecordService
from wrist_ft_comp.ros.services.recorder import Recorder
from wrist_ft_comp.ros.services.tare import TareService
from wrist_ft_comp.ros.snapshot import Snapshot
from wrist_ft_comp.ros.state_keeper import StateKeeper
from wrist_ft_comp.stream.compensator import Compensator, StreamSettings
from wrist_ft_comp.stream.input_checks import is_plausible

_HOUSEKEEPING_PERIOD_S = 0.1
_DIAGNOSTICS_PERIOD_S = 1.0
#: An answer that the asker has not taken yet is lost when its sender leaves the network.
_FAREWELL_S = 0.5


class CompensatorNode(RawNode):
    """Compensates one sensor; WristFtCompError when a parameter or its model file is unusable."""

    # Where a process serves several sensors, each has a name, and keeps its files in a folder of
    # this name below ``data_directory``. Options are those of rclpy's Node, such as ``context``.

    def __init__(self, sensor: str = '', **options: Any) -> None:
        super().__init__(NODE_NAME, **options)
        log = self.log
        declare(self, PARAMETERS)
        chosen = self._settings()
        sources = self._thermometers(chosen['temperature_topics'])
        name = self.get_fully_qualified_name()
        store = ModelStore(node_directory(chosen['data_directory'], sensor, name))
        self.live = LiveModel(store, chosen['model_file'], len(sources), self._swap, log)
        model = None if self.live.stored is None else self.live.stored.model
        compensator = Compensator(len(sources), _stream_settings(chosen), model)
        self._sources = sources
        self.store = store
        self.compensator = compensator
        self.health = InputHealth(len(sources))
        self.state_keeper = StateKeeper(
            compensator, lambda: self.live.sha256, store.directory / 'state.json', chosen, log
        )
        self.state_keeper.writer.problem = store.check_writable()
        self.recorder = Recorder(compensator, with_force=chosen['gravity.source'] != 'none')
        self.recording = RecordService(self.recorder, store, self._subscribe_reference, log)
        shelf = Shelf(store.directory / 'models', self.live, chosen['gravity.source'])
        self.external = ExternalWrench(compensator, self._settings, shelf, log)
        self.identification = IdentifyService(compensator, self.external, shelf, name, log)
        self.tare = TareService(
            compensator, self.external, self._settings, self.state_keeper.save, log
        )
        self.jobs = JobMaker(store, self._settings, self._full_topics, self.recorder)
        self.calibration = CalibrateService(self.jobs.calibration, self.live.take, log)
        self.learning = Learner(chosen, self.live, self.calibration, self.jobs, log)
        self._silent = chosen['uncalibrated'] == 'silent'
        self._newest: tuple[int, Sequence[float], bytes] | None = None
        self._reported = time.monotonic(), copy(self.health.counts)
        self._create_publishers()
        self._raw = self.subscribe(
            WrenchStamped, 'wrench_raw', self._on_wrench, messages.FAST_SENSOR
        )
        self._topics = tuple(self.resolve_topic_name(each.topic) for each in sources)
        for j, source in enumerate(sources):
            if not source.path:
                callback = partial(self._on_temperature, j)
                self.subscribe(Temperature, source.topic, callback, messages.SLOW_SENSOR)
        named = zip(self._topics, sources, strict=True)
        self._fields = FieldInputs(self, named, self._take_temperature)
        subscribe = self.subscribe, self.subscribe_unserved
        self.gravity = GravitySource(chosen, *subscribe, lambda: self.frame_id, self._on_force)
        self.external.poll, self.external.mount = self.gravity.poll, self.gravity.mount
        self._payload_report = PayloadReport(
            compensator, self.external, self.identification, self.gravity.problem
        )
        self._offered = [
            DeferredService(self, kind, f'~/{name}', handler, log.note_refusal)
            for kind, name, handler in (
                (Trigger, 'calibrate', self.calibration.on_request),
                (Trigger, 'tare', self.tare.on_request),
                (Trigger, 'reset_tare', self.tare.reset),
                (Trigger, 'identify_payload', self.identification.on_request),
                (SetBool, 'record', self.recording.on_request),
                (Trigger, 'rollback', self.live.roll_back),
                (Trigger, 'adopt', self.learning.adopt),
            )
        ]
        self.add_on_set_parameters_callback(self._validate_parameters)
        self.add_post_set_parameters_callback(self._apply_parameters)
        self._check_topics()
        tell_unknown(self, (self.resolve_topic_name('wrench_reference'), *self._topics), log)
        # A steady clock: the node looks after itself where simulated time stands still, too.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_HOUSEKEEPING_PERIOD_S, self._keep_house, clock=steady)
        self.create_timer(_DIAGNOSTICS_PERIOD_S, self._diagnose, clock=steady)

    def _thermometers(self, entries: Sequence[str]) -> tuple[TemperatureSource, ...]:
        """Understand temperature_topics."""
        if not entries:
            raise SettingsError(
                'temperature_topics must name at least one topic; got none. The first is the '
                'thermometer inside the sensor.'
            )

        def resolve(topic: str) -> str:
            with messages.opening(topic):
                return self.resolve_topic_name(topic)

        return parse_sources(entries, resolve)

    def _check_topics(self) -> None:
        """Refuse remaps that make the node hear itself."""
        raw, *outputs = self.own_topics
        for name, output in zip(('wrench', 'wrench_external'), outputs, strict=True):
            if raw == output:
                raise SettingsError(
                    f'wrench_raw and {name} are both {raw}: the node would hear itself. Remap '
                    f"wrench_raw to the driver's topic, and {name} to another."
                )

    def _create_publishers(self) -> None:
        """Create publishers; QoS of the output may be overridden by parameters."""
        self._output, self._external_output = (
            self.advertise(WrenchStamped, topic, negotiable=True)
            for topic in ('wrench', 'wrench_external')
        )
        self.external.publish = self._external_output.publish
        self._drift = self.advertise(WrenchStamped, '~/drift')
        self._diagnostics = self.advertise(DiagnosticArray, '/diagnostics')

    def _subscribe_reference(self) -> Callable[[], object]:
        """Subscribe to the reference wrench; what is returned ends that again."""
        topic, qos = 'wrench_reference', messages.FAST_SENSOR
        reference = self.subscribe(WrenchStamped, topic, self._on_reference, qos)
        return partial(self.destroy_subscription, reference)

    def _on_wrench(self, data: bytes) -> None:
        """Correct one wrench and send it on; the header passes through untouched."""
        counts = self.health.counts
        try:
            layout = locate(data, WRENCH_DOUBLES)
        except RecordingError:
            counts.malformed += 1
            return
        stamp_ns, raw = layout.decode(data)
        if not math.isfinite(sum(raw)):
            counts.not_finite += 1
            return
        stamp_ns = stamp_ns or self._now_ns()
        corrected = self.compensator.correct(stamp_ns, raw)
        if not self._silent or self.compensator.compensating:
            self._output.publish(layout.encode(data, corrected))
            counts.published += 1
            if self.external.on_wrench is not None:
                self.external.on_wrench(stamp_ns, raw, data, layout)
        counts.wrenches += 1
        self._newest = stamp_ns, raw, data
        self.recorder.add_raw(stamp_ns, raw)
        self.tare.add(stamp_ns, raw)

    def _on_temperature(self, thermometer: int, data: bytes) -> None:
        """Take one sensor_msgs/Temperature."""
        try:
            stamp_ns, (temperature_c, _) = locate(data, TEMPERATURE_DOUBLES).decode(data)
        except RecordingError:
            self.health.counts.bad_temperatures += 1
            return
        self._take_temperature(thermometer, stamp_ns, temperature_c)

    def _take_temperature(self, thermometer: int, stamp_ns: int, temperature_c: float) -> None:
        """Give one temperature, °C, to the thermal grid; a stamp, ns, of 0 is none."""
        if not is_plausible(temperature_c):
            self.health.drop_temperature(thermometer, temperature_c)
            return
        at_ns, compensator = stamp_ns or self._now_ns(), self.compensator
        newest = self._newest and self._newest[:2]
        self.gravity.poll()  # or what comes from it would be too late for the recording's cell
        cells = compensator.add_temperature(thermometer, at_ns, temperature_c, newest)
        self.recorder.add_cells(cells)
        self.health.take_temperature(time.monotonic(), thermometer, at_ns, stamped=bool(stamp_ns))
        for each in cells:
            self.health.thermometers.look(each, compensator.tracker.grid.period_ns)
        if cells and compensator.compensating:
            zero = compensator.compensation.zero
            self._drift.publish(messages.wrench_message(at_ns, self.frame_id, zero))

    def _on_reference(self, data: bytes) -> None:
        """Add one reference wrench to the recording."""
        try:
            stamp_ns, reference = locate(data, WRENCH_DOUBLES).decode(data)
        except RecordingError:
            self.health.counts.bad_references += 1
            return
        if math.isfinite(sum(reference)):
            self.recording.add_reference(stamp_ns or self._now_ns(), reference)
        else:
            self.health.counts.bad_references += 1

    def _on_force(
        self, stamp_ns: int, force: tuple[float, float, float], speed: float | None
    ) -> None:
        """Take one specific force, m/s², and the speed of rotation, rad/s, where it is known."""
        at_ns = stamp_ns or self._now_ns()
        self.external.add_force(at_ns, force, speed)
        self.recorder.add_force(at_ns, force, speed)

    def _now_ns(self) -> int:
        """Time for drivers that do not stamp."""
        return int(self.get_clock().now().nanoseconds)

    @property
    def own_topics(self) -> tuple[str, str, str]:
        """Full names of the topics that no other sensor may use."""
        outputs = self._output.topic_name, self._external_output.topic_name
        return self._raw.topic_name, *outputs

    @property
    def frame_id(self) -> str:
        """The sensor's frame; empty before the first wrench."""
        data = self._newest and self._newest[2]
        return locate(data, WRENCH_DOUBLES).frame_id(data) if data else ''

    def _settings(self) -> dict[str, Any]:
        """Read the present parameters."""
        simulated_time = bool(self.get_parameter('use_sim_time').value)
        return {**values(self, PARAMETERS), 'use_sim_time': simulated_time}

    def _swap(self, model: DriftModel | None) -> None:
        """Make a model live; the old one stays when this raises."""
        self.compensator.go_live(model, self._newest and self._newest[:2])
        self.recorder.follow_period()

    def _full_topics(self, chosen: dict[str, Any]) -> Topics:
        """Tell topics by their full names."""
        temperatures = tuple(
            topic + source.entry.removeprefix(source.topic)
            for topic, source in zip(self._topics, self._sources, strict=True)
        )
        reference, by = self.resolve_topic_name('wrench_reference'), chosen['gravity.source']
        imu = self.resolve_topic_name('imu') if by == 'imu' else ''
        frame = chosen['gravity.frame'] if by == 'tf' else ''
        return Topics(self._raw.topic_name, temperatures, reference, imu, frame)

    def _validate_parameters(self, parameters: Sequence[Any]) -> SetParametersResult:
        """Allow or refuse parameters, changing nothing that runs."""
        try:
            for owner in (self.live, self.external):
                owner.check_parameters(parameters)
        except WristFtCompError as error:
            self.log.note_refusal('set_parameters', str(error))
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply_parameters(self, parameters: Sequence[Any]) -> None:
        """Make parameters that changed take effect; the others are read when they are needed."""
        self.external.apply_parameters(parameters)
        for parameter in parameters:
            if parameter.name == 'uncalibrated':
                self._silent = parameter.value == 'silent'
            elif parameter.name == 'model_file' and parameter.value:
                self.live.use_file(parameter.value)

    def _keep_house(self) -> None:
        """Look after what does not come by message."""
        self.calibration.poll()
        self.recorder.poll()
        self.learning.poll()
        self.tare.poll()
        self.gravity.poll()
        self.external.look()
        self.identification.poll()
        self.state_keeper.poll()
        self._fields.poll()
        self._look()

    def _look(self) -> None:
        """Look for faults that no single message shows."""
        now_s = time.monotonic()
        if self._newest is not None:
            stamp_ns, raw, data = self._newest
            stamped = bool(locate(data, WRENCH_DOUBLES).decode(data)[0])
            self.health.look(now_s, stamp_ns, raw, self.frame_id, stamped=stamped)
        self.health.note_events(now_s, self.compensator.tracker)

    def _snapshot(self) -> Snapshot:
        """Take down what the diagnostics need."""
        self._look()
        reported_s, before = self._reported
        now_s, raw = time.monotonic(), self._raw.topic_name
        self._reported = now_s, copy(self.health.counts)
        return Snapshot(
            now_s=now_s, health=self.health, incompatible=self.incompatible,
            stream=self.compensator, live=self.live,
            state_keeper=self.state_keeper, calibration=self.calibration,
            recording=self.recording, last_refusal=self.log.last_refusal,
            before=before, elapsed_s=now_s - reported_s,
            wrench_topic=raw, temperature_topics=tuple(each.topic for each in self._sources),
            unreadable=self._fields.unreadable, thermometer_problems=self._thermometer_problems(),
            wrench_publishers=self.count_publishers(raw),
            wrench_problem='' if self._newest else wrong_type(self, raw, WRENCH),
            temperature_publishers=tuple(map(self.count_publishers, self._topics)),
        )  # fmt: skip

    def _thermometer_problems(self) -> dict[int, str]:
        """Tell, by thermometer from 0, why no temperatures can be had of what it is on."""
        found = self._fields.problems()
        for j, (topic, source) in enumerate(zip(self._topics, self._sources, strict=True)):
            if not source.path and self.health.last_temperature_s[j] is None:
                found[j] = no_temperature(self, topic)
        return {j: problem for j, problem in found.items() if problem}

    def _diagnose(self) -> None:
        """Publish diagnostics."""
        self._fields.look()
        payload = self._payload_report.status(self._newest and self._newest[0])
        statuses = [*diagnostics(self._snapshot()), payload, *learning_status(self.learning)]
        self.log.tell(statuses)
        stamp = self.get_clock().now().to_msg()
        name = self.get_fully_qualified_name().lstrip('/')
        self._diagnostics.publish(diagnostic_array(stamp, name, self.frame_id, statuses))

    def destroy_node(self) -> None:
        """End what runs beside the node; an open recording is closed, and who waits is told."""
        waiting = [each.end() for each in (self.calibration, self.tare, self.identification)]
        self.recording.end()
        self.learning.end()
        self.state_keeper.end()
        if any(waiting):
            time.sleep(_FAREWELL_S)
        super().destroy_node()


def _stream_settings(chosen: dict[str, Any]) -> StreamSettings:
    """Translate the stream's parameters."""
    return StreamSettings(
        thermal_period_s=chosen['thermal_period'],
        temperature_timeout_s=chosen['temperature_timeout'],
        max_drift_n=chosen['max_drift'],
        max_drift_rate_n_s=chosen['max_drift_rate'],
    )


#: What --help says, between the first line and the parameters.
_USAGE = """\
Removes the temperature drift of a wrist force/torque sensor beside any driver:

  compensator --ros-args -r wrench_raw:=/driver/wrench \\
    -p 'temperature_topics:=["/driver/temperature", "/driver/state:data[3]:K"]'

hears      wrench_raw (WrenchStamped), the topics in temperature_topics, imu or
           /tf (gravity.source) and, while recording, wrench_reference; -r maps
           them to the driver's own
publishes  wrench (compensated), wrench_external (without the payload, too),
           ~/drift, /diagnostics
serves     ~/record, ~/calibrate, ~/identify_payload, ~/tare, ~/reset_tare,
           ~/rollback, ~/adopt

Without a model wrenches pass as they are: record a warm-up with ~/record, then
call ~/calibrate. docs/tutorial.md of the package goes through it, and
wrist_ft_comp --help shows what works on files.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a node per sensor until a signal ends them; returns the exit code."""
    explained = usage('compensator', _USAGE, PARAMETERS)
    return run_nodes(partial(node_per_sensor, CompensatorNode), argv, explained)


if __name__ == '__main__':
    sys.exit(main())
