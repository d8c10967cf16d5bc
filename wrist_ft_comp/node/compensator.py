"""The node ``compensator``: it corrects every wrench, and its parts do all else."""

from collections.abc import Sequence
from functools import partial
import math
import sys
from typing import Any

from geometry_msgs.msg import WrenchStamped

from wrist_ft_comp.drift.drift_model import DriftModel
from wrist_ft_comp.errors import RecordingError, SettingsError
from wrist_ft_comp.node.calibrate import CalibrateService
from wrist_ft_comp.node.correction import Correction
from wrist_ft_comp.node.external_wrench import ExternalWrench, PayloadFiles
from wrist_ft_comp.node.identify_payload import IdentifyService
from wrist_ft_comp.node.inputs import Counts, Newest, TemperatureInput, WrenchInput
from wrist_ft_comp.node.jobs import JobMaker
from wrist_ft_comp.node.learner import Learner
from wrist_ft_comp.node.live_model import LiveModel
from wrist_ft_comp.node.output import Output
from wrist_ft_comp.node.parameters import PARAMETERS
from wrist_ft_comp.node.recorder import Recorder, RecordService
from wrist_ft_comp.node.specific_force import Gravity
from wrist_ft_comp.node.state_keeper import StateKeeper
from wrist_ft_comp.node.tare import TareService
from wrist_ft_comp.ros import messages
from wrist_ft_comp.ros.arguments import tell_unknown, usage
from wrist_ft_comp.ros.hub import Hub
from wrist_ft_comp.ros.parameters import declare, NODE_NAME, values
from wrist_ft_comp.ros.running import node_per_sensor, run_nodes
from wrist_ft_comp.signals import LARGEST, SensorNames, Topics
from wrist_ft_comp.stored.model_store import ModelStore, node_directory
from wrist_ft_comp.stored.state_file import StateWriter
from wrist_ft_comp.stream.compensator import Compensator, StreamSettings
from wrist_ft_comp.wire.cdr import locate, WRENCH_DOUBLES
from wrist_ft_comp.wire.temperature_source import parse_sources, TemperatureSource


class CompensatorNode(Hub):
    """
    Compensates one sensor; WristFtCompError when a parameter or its model file is unusable.

    Where a process serves several sensors, each has a name, and keeps its files in a folder of
    this name below ``data_directory``. Options are those of rclpy's Node, such as ``context``.
    """

    def __init__(self, sensor: str = '', **options: Any) -> None:
        super().__init__(NODE_NAME, **options)
        declare(self, PARAMETERS)
        chosen, log, name = self._settings(), self.log, self.get_fully_qualified_name()
        self._silent = chosen['uncalibrated'] == 'silent'
        self._newest: Newest | None = None
        self._sources = sources = self._thermometers(chosen['temperature_topics'])
        self._topics = tuple(self.resolve_topic_name(source.topic) for source in sources)
        self.store = store = ModelStore(node_directory(chosen['data_directory'], sensor, name))
        self.compensator = compensator = Compensator(len(sources), _stream_settings(chosen))
        self.counts = counts = Counts()
        source = chosen['gravity.source']
        writer = StateWriter(store.directory / 'state.json')
        writer.problem = store.check_writable()
        self._output = self.advertise(WrenchStamped, 'wrench', negotiable=True)
        raw_topic = chosen['wrench_topic']
        with messages.opening(raw_topic):
            self._raw_topic = self.resolve_topic_name(raw_topic)
        self._raw = self.subscribe(WrenchStamped, raw_topic, self._on_wrench, messages.FAST_SENSOR)

        # The parts, which meet in their constructors and begin in ``run``.
        self.live = live = LiveModel(
            store, chosen['model_file'], self.sensor, self._swap, writer, log
        )
        self.state_keeper = StateKeeper(compensator, lambda: live.sha256, writer, chosen, log)
        self.gravity = Gravity(chosen)
        self.wrench_input = WrenchInput(counts, self.newest, raw_topic)
        self.inputs = TemperatureInput(
            sources, self._topics, compensator, self.wrench_input, self.gravity, live,
            self.state_keeper,
        )  # fmt: skip
        self.recorder = Recorder(compensator, self.sensor, with_force=source != 'none')
        self.recording = RecordService(self.recorder, store, counts, log)
        payload_files = PayloadFiles(store.directory / 'models', live, source)
        self.external = ExternalWrench(
            compensator, self._settings, payload_files, self.gravity, self.newest,
            self.recorder, log,
        )  # fmt: skip
        self.jobs = JobMaker(store, self._settings, self._full_topics, self.recorder)
        self.identification = IdentifyService(
            compensator, self.external, payload_files, self.jobs, name, log
        )
        self.tare = TareService(
            compensator, self.external, self._settings, self.state_keeper.save, log
        )
        calibrated = partial(live.take, why='a person called ~/calibrate')
        self.calibration = CalibrateService(self.jobs.calibration, calibrated, self.recording, log)
        self.learning = Learner(chosen, live, self.calibration, self.jobs, log)
        self.output = Output(compensator, counts, self.hardware_id)
        self.correction = Correction(
            compensator, chosen['correction.rate'], self.newest, self.hardware_id
        )
        self.run((
            self.wrench_input, self.inputs, live, self.state_keeper, self.recorder,
            self.recording, self.calibration, self.output, self.correction, self.tare,
            self.gravity, self.external, self.identification, self.learning,
        ))  # fmt: skip
        self._check_topics()
        self.add_post_set_parameters_callback(self._follow_uncalibrated)
        later = (self.resolve_topic_name('wrench_reference'), self._raw_topic, *self._topics)
        tell_unknown(self, later, log)

    def _thermometers(self, entries: Sequence[str]) -> tuple[TemperatureSource, ...]:
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
        _, *outputs = self.own_topics
        for name, output in zip(('wrench', 'wrench_external'), outputs, strict=True):
            if self._raw_topic == output:
                raise SettingsError(
                    f'wrench_raw and {name} are both {output}: the node would hear itself. Remap '
                    f"wrench_raw to the driver's topic, and {name} to another."
                )

    def _on_wrench(self, data: bytes) -> None:
        """Correct one wrench and send it on, then hand it to parts; its header stays as it is."""
        counts = self.counts
        try:
            layout = locate(data, WRENCH_DOUBLES)
        except RecordingError:
            counts.malformed += 1
            return
        stamp_ns, raw = layout.decode(data)
        if not math.hypot(*raw) < LARGEST:  # one comparison for six numbers; false for NaN
            counts.drop(max(raw, key=abs) if all(map(math.isfinite, raw)) else math.nan)
            return
        stamp_ns = stamp_ns or self.now_ns()
        corrected = self.compensator.correct(stamp_ns, raw)
        if not self.silent:
            self._output.publish(layout.encode(data, corrected))
            counts.published += 1
        counts.wrenches += 1
        self._newest = stamp_ns, raw, data
        for part in self._listeners:
            self.do(part, part.on_wrench, stamp_ns, raw, data, layout)

    @property
    def silent(self) -> bool:
        """Whether nothing is published, because a model or the first temperature is missing."""
        return self._silent and not self.compensator.compensating

    def newest(self) -> Newest | None:
        """Give the newest raw wrench."""
        return self._newest

    @property
    def own_topics(self) -> tuple[str, str, str]:
        """Full names of the topics that no other sensor may use."""
        output, external = map(self.resolve_topic_name, ('wrench', 'wrench_external'))
        return self._raw_topic, output, external

    def hardware_id(self) -> str:
        """Give the sensor's frame; empty before the first wrench."""
        data = self._newest and self._newest[2]
        return locate(data, WRENCH_DOUBLES).frame_id(data) if data else ''

    def _settings(self) -> dict[str, Any]:
        simulated_time = bool(self.get_parameter('use_sim_time').value)
        return {**values(self, PARAMETERS), 'use_sim_time': simulated_time}

    def _follow_uncalibrated(self, parameters: Sequence[Any]) -> None:
        """Publish without a model, or not, as the parameter now says."""
        for parameter in parameters:
            if parameter.name == 'uncalibrated':
                self._silent = parameter.value == 'silent'

    def _swap(self, model: DriftModel | None) -> None:
        """Make a model live; the old one stays when this raises."""
        self.compensator.go_live(model, self._newest and self._newest[:2])
        if self.running:
            self.tell('on_model')

    def sensor(self) -> SensorNames:
        """Give the names of the sensor."""
        names = {
            'hardware_id': [self.get_parameter('hardware_id').value],
            'frame_id': [self.hardware_id()],
            'wrench_topic': [self.own_topics[0]],
            'temperature_topics': [
                topic + source.entry.removeprefix(source.topic)
                for topic, source in zip(self._topics, self._sources, strict=True)
            ],
        }
        return {fact: answers for fact, answers in names.items() if any(answers)}

    def _full_topics(self, chosen: dict[str, Any]) -> Topics:
        """Collect the full names of topics, for a job."""
        temperatures = tuple(self.sensor()['temperature_topics'])
        reference, source = self.resolve_topic_name('wrench_reference'), chosen['gravity.source']
        imu = self.resolve_topic_name('imu') if source == 'imu' else ''
        frame = chosen['gravity.frame'] if source == 'tf' else ''
        names = self.own_topics[0], temperatures, reference, imu, frame
        return Topics(*names, *self.gravity.frames())


def _stream_settings(chosen: dict[str, Any]) -> StreamSettings:
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

hears      wrench_raw (WrenchStamped) or wrench_topic, the topics in
           temperature_topics, imu or /tf (gravity.source) and, while
           recording, wrench_reference; -r maps them to the driver's own
publishes  wrench (compensated), wrench_external (without the payload, too),
           ~/drift, ~/correction (what a controller adds), /diagnostics
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
