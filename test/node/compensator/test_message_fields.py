"""Temperatures that are numbers in messages of any type: taken, or said why they are not."""

from geometry_msgs.msg import WrenchStamped
from moments import SECOND, START
import pytest
from rclpy.qos import QoSProfile, QoSReliabilityPolicy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import BatteryState, JointState, Temperature
from std_msgs.msg import Float64MultiArray, Header

from wrist_ft_comp.node.temperature_topics import TemperatureTopic
from wrist_ft_comp.ros.hub import Part
from wrist_ft_comp.wire.temperature_source import parse_sources

BEST_EFFORT = QoSProfile(depth=5, reliability=QoSReliabilityPolicy.BEST_EFFORT)


def stamped(message, second=0):
    message.header = Header()
    message.header.stamp.sec = START // SECOND + second
    return message


def joints(*efforts, second=0, name=()):
    return stamped(JointState(name=name, effort=[float(effort) for effort in efforts]), second)


class Listening:
    """Listens to /state beside a fake hub; keeps the readings that are handed out."""

    def __init__(self, fake_hub, *entries):
        part = Part()
        part.take, self.hub, self.taken = self.take, fake_hub(part), []
        sources = dict(enumerate(parse_sources(entries, str)))
        self.topic = TemperatureTopic(part, '/state', sources)

    def take(self, thermometer, stamp_ns, celsius):
        self.taken.append((thermometer, stamp_ns, pytest.approx(celsius)))

    def carry(self, name):
        """Let a publisher of a type come in the place of the one before."""
        self.hub.types['/state'] = [name]
        for look in (self.topic.poll, self.topic.look, self.topic.look):
            look()

    def hear(self, message):
        """Let a publisher of the message's type come, and send it."""
        kind = type(message)
        self.carry(f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}')
        self.hear_bytes(serialize_message(message))

    def hear_bytes(self, data):
        subscription = self.hub.topics.get('/state')
        if callable(subscription):
            subscription(data)
        elif subscription is not None:
            subscription.messages.append(data)
            self.topic.poll()

    def problem(self):
        return self.topic.trouble or self.topic.problems.get(0, '')


@pytest.fixture
def listen(fake_hub, ros_domain):  # noqa: ARG001 -- which readies what comes with ROS 2
    return lambda *entries: Listening(fake_hub, *entries)


@pytest.mark.parametrize(('entries', 'message', 'taken'), [
    (['/state:temperature'], stamped(BatteryState(temperature=23.0)), [(0, START, 23.0)]),
    (['/state:effort[2]', '/state:effort[0]'], joints(21, 22, 23),
     [(0, START, 23.0), (1, START, 21.0)]),
    (['/state:data[1]', '/state:data[0]*0.1:K'], Float64MultiArray(data=[3001.5, 22.0]),
     [(0, None, 22.0), (1, None, 27.0)]),
    (['/state'], stamped(Temperature(temperature=21.0)), [(0, START, 21.0)]),
])  # fmt: skip
def test_thermometers_in_one_message_are_read_with_its_stamp(listen, entries, message, taken):
    listening = listen(*entries)
    listening.hear(message)
    assert listening.taken == taken
    assert listening.problem() == ''


@pytest.mark.parametrize(('entry', 'message', 'words', 'good'), [
    ('effort[2]', joints(20, 21), 'there are effort[0], effort[1]', joints(1, 2, 9)),
    ('effort[2]', joints(), 'numbers there are none', joints(1, 2, 9)),
    ('', BatteryState(), 'sensor_msgs/BatteryState, not sensor_msgs/Temperature', None),
    ('', JointState(), 'write /state:FIELD to take a number in it', None),
])  # fmt: skip
def test_why_a_number_cannot_be_taken_is_said_until_it_can(listen, entry, message, words, good):
    listening = listen(f'/state:{entry}' if entry else '/state')
    listening.hear(message)
    assert words in listening.problem()
    listening.hear(good or stamped(Temperature(temperature=9.0)))
    assert (listening.problem(), listening.taken) == ('', [(0, START, 9.0)])


@pytest.mark.parametrize(
    ('name', 'words'),
    [
        ('nowhere_msgs/msg/State', 'but the Python package nowhere_msgs with this type is not'),
        ('sensor_msgs/msg/Nothing', 'package sensor_msgs with this type is not installed'),
        *((name, 'which is no message of ROS') for name in ('os/path', 'a.b/msg/State')),
    ],
)
def test_a_type_that_cannot_be_imported_is_a_sentence(listen, name, words):
    listening = listen('/state:temperature')
    listening.carry(name)
    assert listening.problem().startswith('/state carries ')
    assert words in listening.problem()


def test_bytes_that_are_no_message_are_named(listen):
    listening = listen('/state:effort[0]')
    listening.hear(joints(20))
    listening.hear_bytes(serialize_message(joints(20))[:20])
    assert "can't be read as sensor_msgs/JointState" in listening.problem()
    assert listening.topic.unreadable == 1
    listening.hear(joints(20))
    assert (listening.problem(), len(listening.taken)) == ('', 2)


def test_a_field_over_dds_moves_the_drift_and_wakes_no_executor(wired, make_model):
    topics = ['state:effort[wrist]']
    node = wired(topics=topics, model=make_model('m.yaml'), executor='events')
    topic, inputs = node.topic('state'), node.node.inputs
    arm, gripper = (node.bench.publisher(JointState, topic, BEST_EFFORT) for _ in range(2))
    for second in range(4):

        def arrived(second=second):
            arm.publish(joints(21, 23, second=second, name=['elbow', 'wrist']))
            gripper.publish(joints(5, second=second, name=['finger']))
            return inputs.thermometers[0].newest[0] == START + second * SECOND

        node.wait_until(arrived, 'the temperature')
    assert node.topic('state') not in [s.topic_name for s in node.node.subscriptions]
    assert node.ask_output(START + 9 * SECOND, [0.0] * 6)[2] == pytest.approx(-6.0)
    status = node.diagnosis('temperature', lambda of: of.values.get('thermometer_1_c') == '23.00')
    assert 'mixed' not in status.message


def test_a_misspelt_topic_is_named_and_the_one_that_is_probably_meant(rig, driver):
    node, other = rig(topics=['heat', 'state:data[0]']), driver()
    there = {'wrench_row': WrenchStamped, 'temperature': Temperature, 'stat': JointState}
    for name, kind in there.items():
        other.helper.create_publisher(kind, node.topic(name), 10)
    meant = f'or is {node.topic("wrench_row")}, a geometry_msgs/WrenchStamped, meant?)'
    said = node.diagnosis('input', meant).message
    assert f'{node.topic("wrench_raw")} has no publisher' in said
    said = node.diagnosis('temperature', f'or is {node.topic("stat")} meant?').message
    assert f'thermometer 1 has not reported: {node.topic("heat")} has no publisher' in said
    assert f'or is {node.topic("temperature")}, a sensor_msgs/Temperature, meant?)' in said
    assert f'thermometer 2 has not reported: {node.topic("state")} has no publisher' in said
    assert said.endswith('; nothing is compensated until then')
