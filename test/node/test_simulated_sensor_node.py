from geometry_msgs.msg import WrenchStamped
import numpy as np
import pytest
from rclpy.qos import QoSReliabilityPolicy
from sensor_msgs.msg import Imu, Temperature

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.node import simulated_sensor as simulated_sensor_node
from wrist_ft_comp.node.simulated_sensor import LONGEST_WAKE_S, SETTLE_S, SimulatedSensor

BEST_EFFORT, RELIABLE = QoSReliabilityPolicy.BEST_EFFORT, QoSReliabilityPolicy.RELIABLE
TIMEOUT_S = 60.0
START_S = 1000
FAST = {
    'start_stamp_s': float(START_S),
    'speed': 100.0,
    'wrench_rate': 500.0,
    'temperature_rate': 100.0,
}


def stamp_ns(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def six(message):
    force, torque = message.wrench.force, message.wrench.torque
    return (force.x, force.y, force.z, torque.x, torque.y, torque.z)


def take(messages, count):
    return [messages.get(timeout=TIMEOUT_S) for _ in range(count)]


@pytest.mark.parametrize('executor', ['default', 'events'])
def test_every_topic_carries_type_frame_readings_and_the_clock_s_time(bench, executor):
    before_ns = bench.helper.get_clock().now().nanoseconds
    remap = {'wrench_raw': '/arm/ft', 'temperature': '/arm/heat'}
    raw = bench.listen(WrenchStamped, '/arm/ft')
    reference = bench.listen(WrenchStamped, 'wrench_reference')
    first = bench.listen(Temperature, '/arm/heat')
    second = bench.listen(Temperature, 'temperature_2')
    bench.start(SimulatedSensor, parameters={'frame_id': 'tool0'}, remap=remap, executor=executor)
    messages = [topic.get(timeout=TIMEOUT_S) for topic in (raw, reference, first, second)]
    assert before_ns <= stamp_ns(messages[0])
    assert stamp_ns(messages[0]) <= bench.helper.get_clock().now().nanoseconds + 10**9
    assert {message.header.frame_id for message in messages} == {'tool0'}
    assert np.isfinite([six(message) for message in messages[:2]]).all()
    assert all(15 < message.temperature < 30 for message in messages[2:])
    assert all(message.variance > 0 for message in messages[2:])


def test_stamps_advance_by_speed_over_rate(bench):
    raw = bench.listen(WrenchStamped, 'wrench_raw')
    temperature = bench.listen(Temperature, 'temperature')
    bench.start(SimulatedSensor, parameters={**FAST, 'temperature_rate': 40.0})
    for messages, step_ns in ((raw, 200_000_000), (temperature, 2_500_000_000)):
        stamps = np.array([stamp_ns(message) - START_S * 10**9 for message in take(messages, 20)])
        assert (stamps % step_ns == 0).all()
        assert (np.diff(stamps) == step_ns).all()


def record(bench, name, parameters, count=50):
    """Listen to a node of its own name and namespace; messages by topic and stamp."""
    listened = {
        topic: bench.listen(message_type, f'{name}/{topic}')
        for topic, message_type in (
            ('wrench_raw', WrenchStamped),
            ('wrench_reference', WrenchStamped),
            ('temperature', Temperature),
        )
    }
    bench.start(SimulatedSensor, namespace=name, parameters={**FAST, **parameters})
    return {
        topic: {stamp_ns(message): message for message in take(messages, count)}
        for topic, messages in listened.items()
    }


def common(one, other):
    stamps = sorted(one.keys() & other.keys())
    assert len(stamps) >= 10
    return [one[stamp] for stamp in stamps], [other[stamp] for stamp in stamps]


def test_same_parameters_give_the_same_messages_and_another_run_others(bench):
    parameters = {'one': {}, 'other': {}, 'later': {'run': 1}}
    one, other, later = (record(bench, name, {'seed': 3, **p}) for name, p in parameters.items())
    for topic in one:
        mine, theirs = common(one[topic], other[topic])
        assert mine == theirs
    for topic in ('wrench_raw', 'wrench_reference'):
        mine, theirs = common(one[topic], later[topic])
        assert all(six(a) != six(b) for a, b in zip(mine, theirs, strict=True))


@pytest.fixture
def unspun(ros_context, monkeypatch):
    """Make a node that only the test wakes, at times it chooses; give both and what was sent."""
    now = [0.0]
    monkeypatch.setattr(simulated_sensor_node.time, 'monotonic', lambda: now[0])
    rules = [part for item in FAST.items() for part in ('-p', '{}:={}'.format(*item))]
    node = SimulatedSensor(context=ros_context, cli_args=['--ros-args', *rules])
    sent = []
    monkeypatch.setattr(node, '_send_wrench', lambda *arguments: sent.append(arguments[2]))

    def wake(*times_s):
        for now[0] in times_s:
            node._wake()

    yield node, wake, sent
    node.destroy_node()


def test_run_waits_until_its_subscribers_have_come(unspun, monkeypatch):
    node, wake, sent = unspun
    subscribers = dict.fromkeys(('_to_raw', '_to_reference'), 0)
    for name in tuple(subscribers):
        publisher = getattr(node, name)
        monkeypatch.setattr(publisher, 'get_subscription_count', lambda k=name: subscribers[k])
    wake(0.0, 5.0, 10.0)
    subscribers['_to_raw'] = 1
    wake(15.0, 15.0 + 0.9 * SETTLE_S)
    subscribers['_to_reference'] = 1
    wake(16.0, 16.0 + 0.9 * SETTLE_S)
    assert sent == []
    wake(16.0 + SETTLE_S)
    assert sent == [0, 0]
    subscribers.update(_to_raw=0, _to_reference=0)
    wake(16.0 + SETTLE_S + LONGEST_WAKE_S)
    assert len(sent) > 2


def test_a_long_pause_is_caught_up_in_part(unspun, monkeypatch):
    node, wake, sent = unspun
    monkeypatch.setattr(node, '_may_begin', lambda _: True)
    wake(0.0, 0.0105, 10.0, 10.0105)
    ran_s = 0.0105 + LONGEST_WAKE_S + 0.0105
    assert len(sent) == 2 * (1 + int(ran_s * FAST['wrench_rate']))
    assert (np.diff(sent[::2]) == 200_000_000).all()


def test_schedule_that_cannot_be_followed_is_a_sentence(ros_context):
    words = ['--ros-args', '-p', 'duty_cycle.start_s:=[100.0, 50.0]']
    with pytest.raises(SettingsError, match='ascend'):
        SimulatedSensor(context=ros_context, cli_args=words)


def test_a_robot_at_work_publishes_its_imu_and_its_contacts(bench):
    """Weight is what raw holds beyond contacts: of the masses that were asked for, at rest."""
    topics = {'imu': Imu, 'wrench_reference': WrenchStamped}
    topics['wrench_external_reference'] = WrenchStamped
    heard = {topic: bench.listen(kind, topic) for topic, kind in topics.items()}
    work = {'tool_mass': 1.5}
    bench.start(SimulatedSensor, parameters={**FAST, **work})
    seen = {topic: {stamp_ns(m): m for m in take(heard[topic], 200)} for topic in topics}
    stamps = sorted(set.intersection(*map(set, seen.values())))
    assert len(stamps) > 100
    imu, whole, external = ([seen[topic][stamp] for stamp in stamps] for topic in topics)
    assert {message.header.frame_id for message in imu} == {'wrist_ft_imu'}
    turning = np.array([[getattr(m.angular_velocity, axis) for axis in 'xyz'] for m in imu])
    rest = np.linalg.norm(turning, axis=1) < 0.02
    weight = np.array([six(m) for m in whole]) - [six(m) for m in external]
    masses = np.linalg.norm(weight[rest, :3], axis=1) / 9.807
    assert np.all(np.min(np.abs(masses[:, None] - [1.5, 2.3]), axis=1) < 0.05)
    felt = np.array([[getattr(m.linear_acceleration, axis) for axis in 'xyz'] for m in imu])
    assert np.all(np.abs(np.linalg.norm(felt[rest], axis=1) - 9.807) < 0.4)
