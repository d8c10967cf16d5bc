"""The node ``compensator``: it corrects every wrench, and its parts do all else."""

from collections.abc import Sequence
from functools import partial
import math
import sys
import traceback
from typing import Any

from geometry_msgs.msg import WrenchStamped

from wrist_ft_comp.channels import LARGEST, SensorNames
from wrist_ft_comp.errors import RecordingError, SettingsError
from wrist_ft_comp.node.calibration_services import Jobs
from wrist_ft_comp.node.drift_topic import DriftTopic
from wrist_ft_comp.node.external_wrench import ExternalWrench
from wrist_ft_comp.node.learner import Learner
from wrist_ft_comp.node.live_model import LiveModel
from wrist_ft_comp.node.payload_choice import PayloadChoice
from wrist_ft_comp.node.raw_wrench import Counts, is_silent, WrenchInput
from wrist_ft_comp.node.recorder import Recorder
from wrist_ft_comp.node.specific_force import SpecificForceInput
from wrist_ft_comp.node.state_keeper import StateKeeper
from wrist_ft_comp.node.tare_services import TareService
from wrist_ft_comp.node.temperature_topics import TemperatureInput, Thermometer
from wrist_ft_comp.recording import Topics
from wrist_ft_comp.ros.diagnostics import ERROR
from wrist_ft_comp.ros.hub import Hub, Part
from wrist_ft_comp.ros.parameters import at_start, NODE_NAME, Parameter, usage, warn_of_unknown
from wrist_ft_comp.ros.running import run_node
from wrist_ft_comp.ros.topics import FAST_SENSOR, opening
from wrist_ft_comp.stored.node_folder import node_directory, NodeFolder
from wrist_ft_comp.stored.safe_file import FileWriter
from wrist_ft_comp.stream.compensator import Compensator, StreamSettings
from wrist_ft_comp.wire.cdr import locate, WRENCH_DOUBLES
from wrist_ft_comp.wire.temperature_source import parse_sources

#: Every feature of the node, in the order of their start and of the diagnostics: the folder is
#: taken and the first model goes live (LiveModel) before its thermal state goes on (StateKeeper).
PARTS: tuple[type[Part], ...] = (
    WrenchInput, TemperatureInput, LiveModel, StateKeeper, Recorder,
    Jobs, DriftTopic, TareService, SpecificForceInput,
    ExternalWrench, Learner,
)  # fmt: skip
_STREAM = StreamSettings()
#: Parameters of the stream itself, which all parts share, and of all parts.
PARAMETERS = (
    at_start(
        'temperature_topics', ('temperature',),
        'The thermometers, the one inside the sensor first: topics of sensor_msgs/Temperature, or '
        'TOPIC:FIELD for a number in messages of any type, such as '
        '/driver/state:joints[wrist].temperature:K, with a factor where it is in other steps, '
        'such as /plc/state:data[3]*0.1 for tenths of a degree.'),
    at_start(
        'hardware_id', '',
        'Serial number of the sensor, which no topic holds. Recordings and models keep it, and a '
        'model of another sensor gives a warning.'),
    at_start(
        'data_directory', '',
        'Where models and own recordings are kept, for one node; empty takes wrist_ft_comp/NODE '
        'below ROS_HOME (or ~/.ros).'),
    at_start(
        'temperature_timeout', _STREAM.temperature_timeout_s,
        'Silence of a thermometer after which a warning is given. Its last value is held from '
        'then on, or from 10 s on.',
        's', 0.1, 3600.0),
    at_start(
        'max_drift', _STREAM.max_drift_n,
        'Largest zero drift that is subtracted from a force; from a torque, a tenth of it in N m.',
        'N', 0.0, 1e6),
    at_start(
        'max_drift_rate', _STREAM.max_drift_rate_n_s,
        'How fast the zero drift that is subtracted from a force may move; from a torque, a tenth '
        'of it in N m/s. A tare and its reset step at once; a change of model never steps.',
        'N/s', 0.001, 1e6),
    Parameter(
        'uncalibrated', 'passthrough',
        'What to publish without a model or before the first temperature: the raw wrench, tared '
        '(passthrough), or nothing (silent).', choices=('passthrough', 'silent')),
    *(row for part in PARTS for row in part.parameters),
)  # fmt: skip
#: What topics and services are for, by name.
TOPICS = {
    'wrench_raw': 'raw wrench of the driver, to which it is remapped',
    'wrench': "compensated and tared wrench, with the input's header",
    **dict(topic for part in PARTS for topic in part.topics),
    '/diagnostics': 'state of the node, once a second',
}
SERVICES = {service.name: service.purpose for part in PARTS for service in part.services()}


class CompensatorNode(Hub):
    """Compensates one sensor; WristFtCompError when a parameter or its model file is unusable."""

    def __init__(self, **options: Any) -> None:
        super().__init__(NODE_NAME, PARAMETERS, **options)
        chosen = self.chosen()
        if not chosen['temperature_topics']:
            raise SettingsError(
                'temperature_topics must name at least one topic; got none. The first is the '
                'thermometer inside the sensor.'
            )
        with opening('temperature_topics'):
            sources = parse_sources(chosen['temperature_topics'], self.resolve_topic_name)
        self.thermometers = [
            Thermometer(source, self.resolve_topic_name(source.topic)) for source in sources
        ]
        self._raw_topic = self.resolve_topic_name('wrench_raw')
        for output in ('wrench', 'wrench_external'):
            if self._raw_topic == self.resolve_topic_name(output):
                raise SettingsError(
                    f'wrench_raw and {output} are both {self._raw_topic}: the node would hear '
                    f"itself. Remap wrench_raw to the driver's topic, and {output} to another."
                )
        name = self.get_fully_qualified_name()
        self.store = NodeFolder(node_directory(chosen['data_directory'], name))
        self.counts = Counts()
        settings = StreamSettings(
            temperature_timeout_s=chosen['temperature_timeout'], max_drift_n=chosen['max_drift'],
            max_drift_rate_n_s=chosen['max_drift_rate'],
        )  # fmt: skip
        self.compensator = Compensator(len(sources), settings)
        self._output = self.advertise(WrenchStamped, 'wrench', negotiable=True)
        self._raw = self.subscribe(WrenchStamped, 'wrench_raw', self._on_wrench, FAST_SENSOR)
        self.log.info(f'{len(sources)} thermometers; files are kept in {self.store.directory}')
        self.run(self._make_parts(chosen))
        warn_of_unknown(self, self.log)

    def _make_parts(self, chosen: dict[str, Any]) -> tuple[Part, ...]:
        """Make one of each of PARTS; they meet here, and start in ``run``."""
        store, stream, counts = self.store, self.compensator, self.counts
        self.writer = writer = FileWriter()
        self.live = live = LiveModel(store, self.sensor, stream, counts, writer)
        self.state_keeper = StateKeeper(
            stream, live, counts, writer, store.directory / 'state.json'
        )
        self.specific_force = force = SpecificForceInput(chosen, stream)
        self.wrench_input = WrenchInput(counts, stream)
        self.inputs = TemperatureInput(self.thermometers, live, force)
        self.recorder = Recorder(live, with_force=force.source != 'none')
        self.external = ExternalWrench(stream, PayloadChoice(live, force), force, counts)
        self.tare = TareService(stream, self.external, self.wrench_input, self.state_keeper)
        self.jobs = Jobs(live, self.recorder, self.external, self.full_topics)
        self.learning = Learner(live, self.jobs, self.recorder)
        self.drift_topic = DriftTopic(stream, counts)
        return (
            self.wrench_input, self.inputs, live, self.state_keeper, self.recorder,
            self.jobs, self.drift_topic, self.tare,
            self.specific_force, self.external, self.learning,
        )  # fmt: skip

    def _on_wrench(self, data: bytes) -> None:
        """Correct one wrench and send it on, then hand it to parts; its header stays as it is."""
        counts = self.counts
        try:
            layout = locate(data, WRENCH_DOUBLES)
            stamp_ns, raw = layout.decode(data)
            # One comparison for six numbers; false for NaN, and for zeros.
            if not 0.0 < math.hypot(*raw) < LARGEST and not self.wrench_input.admits(raw):
                return
            stamp_ns = stamp_ns or self.now_ns()
            corrected = self.compensator.correct(stamp_ns, raw)
            if not is_silent(self, self.compensator):
                self._output.publish(layout.encode(data, corrected))
                counts.published += 1
            counts.wrenches += 1
            counts.before, counts.newest = counts.newest, (stamp_ns, raw, data)
            for part in self._listeners:
                self.do(part, part.on_wrench, stamp_ns, raw, data, layout)
        except RecordingError:  # its bytes are no wrench
            counts.dropped, counts.strange = counts.dropped + 1, None
        except Exception as error:  # the next wrench goes on; a new fault is logged once
            fault = f'{type(error).__name__}: {error}'
            if fault != counts.fault:
                self.log.write(ERROR, f'A wrench was lost:\n{traceback.format_exc()}')
            counts.failed, counts.fault = counts.failed + 1, fault

    def hardware_id(self) -> str:
        """Give the sensor's frame; empty before the first wrench."""
        if self.counts.newest is None:
            return ''
        data = self.counts.newest[2]
        return locate(data, WRENCH_DOUBLES).frame_id(data)

    def sensor(self) -> SensorNames:
        """Give the names of the sensor."""
        names = {
            'hardware_id': [self.get_parameter('hardware_id').value],
            'frame_id': [self.hardware_id()],
            'wrench_topic': [self._raw_topic],
            'temperature_topics': [
                one.topic + one.source.entry.removeprefix(one.source.topic)
                for one in self.thermometers
            ],
        }
        return {fact: answers for fact, answers in names.items() if any(answers)}

    def full_topics(self) -> Topics:
        """Collect the full names of topics, for a job."""
        source = self.specific_force.source
        return Topics(
            self._raw_topic,
            tuple(self.sensor()['temperature_topics']),
            self.resolve_topic_name('wrench_reference'),
            self.resolve_topic_name('imu') if source == 'imu' else '',
            self.chosen()['gravity.frame'] if source == 'tf' else '',
            *self.specific_force.frames(),
        )


#: What --help says before topics, services and parameters.
_ABOUT = """\
Removes the temperature drift of a wrist force/torque sensor beside any driver:

  compensator --ros-args -r wrench_raw:=/driver/wrench \\
    -p 'temperature_topics:=["/driver/temperature", "/driver/state:data[3]:K"]'

Without a model wrenches pass as they are: record a warm-up with ~/record, then
call ~/calibrate. docs/tutorial.md of the package goes through it, and
wrist_ft_comp --help shows what works on files.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the node until a signal ends it; returns the exit code."""
    ends = ('topics (-r FROM:=TO):', TOPICS), ('services:', SERVICES)
    explain = partial(usage, 'compensator', _ABOUT, PARAMETERS, *ends)
    return run_node(CompensatorNode, argv, explain)


if __name__ == '__main__':
    sys.exit(main())
