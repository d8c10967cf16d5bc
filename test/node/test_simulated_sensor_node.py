"""The simulated sensor: its topics, its times, and what it waits for."""

from collections import defaultdict
from copy import deepcopy
from types import SimpleNamespace

from geometry_msgs.msg import WrenchStamped
from moments import six_of, stamp_of, TIMEOUT_S
import numpy as np
import pytest
from sensor_msgs.msg import Temperature

from wrist_ft_comp.node import simulated_sensor as simulated_sensor_node
from wrist_ft_comp.node.simulated_sensor import LONGEST_WAKE_S, SETTLE_S, SimulatedSensor

START_S = 1000
FAST = {
    'start_stamp_s': float(START_S), 'speed': 100.0, 'wrench_rate': 500.0,
    'temperature_rate': 100.0,
}  # fmt: skip


def test_every_topic_carries_type_frame_readings_and_the_clock_s_time(bench):
    before_ns = bench.helper.get_clock().now().nanoseconds
    remap = {'wrench_raw': '/arm/ft', 'temperature': '/arm/heat'}
    queues = [bench.listen(WrenchStamped, topic) for topic in ('/arm/ft', 'wrench_reference')]
    queues += [bench.listen(Temperature, topic) for topic in ('/arm/heat', 'temperature_2')]
    bench.start(SimulatedSensor, remap=remap)
    messages = [topic.get(timeout=TIMEOUT_S) for topic in queues]
    assert before_ns <= stamp_of(messages[0])
    assert stamp_of(messages[0]) <= bench.helper.get_clock().now().nanoseconds + 10**9
    assert {message.header.frame_id for message in messages} == {'wrist_ft'}
    assert np.isfinite([six_of(message) for message in messages[:2]]).all()
    assert all(15 < message.temperature < 30 for message in messages[2:])
    assert all(message.variance > 0 for message in messages[2:])


@pytest.fixture
def make(bench, monkeypatch):
    """Make a node without DDS, what wakes it at times, its messages by stamp, its listeners."""

    def start(**parameters):
        sent, listeners, now = defaultdict(dict), defaultdict(lambda: 1), [0.0]

        def advertise(_, _kind, topic, *_qos, **_options):
            def send(message):
                if hasattr(message, 'header'):
                    sent[topic][stamp_of(message)] = deepcopy(message)

            return SimpleNamespace(publish=send, get_subscription_count=lambda: listeners[topic])

        def wake(*times_s):
            for now[0] in times_s:
                node._wake()

        monkeypatch.setattr(SimulatedSensor, 'create_publisher', advertise)
        monkeypatch.setattr(simulated_sensor_node.time, 'monotonic', lambda: now[0])
        node = bench.make(SimulatedSensor, parameters={**FAST, **parameters})
        return node, wake, sent, listeners

    return start


@pytest.fixture
def simulate(make):
    """Run half a second of a simulation; messages by topic and stamp, ns."""

    def run(**parameters):
        _, wake, sent, _ = make(**parameters)
        wake(*np.arange(0.0, SETTLE_S + 0.5, 0.01))
        return sent

    return run


def test_stamps_advance_by_speed_over_rate(simulate):
    sent = simulate(temperature_rate=40.0)
    for topic, step_ns in (('wrench_raw', 200_000_000), ('temperature', 2_500_000_000)):
        first = np.array(list(sent[topic])[:18]) - START_S * 10**9
        assert first.tolist() == [k * step_ns for k in range(18)]


def test_same_parameters_give_the_same_messages_and_another_run_others(simulate):
    one, other, later = (simulate(seed=3, run=run) for run in (0, 0, 1))
    for topic in ('wrench_raw', 'wrench_reference', 'temperature'):
        assert len(one[topic]) > 40
        assert one[topic] == other[topic]
    for topic in ('wrench_raw', 'wrench_reference'):
        assert all(six_of(one[topic][at]) != six_of(later[topic][at]) for at in one[topic])


def test_a_robot_at_work_publishes_its_imu_and_its_contacts(simulate):
    """Weight is what raw holds beyond contacts: of the masses that were asked for, at rest."""
    sent = simulate(tool_mass=1.5)
    topics = 'imu', 'wrench_reference', 'wrench_external_reference'
    imu, whole, external = (list(sent[topic].values()) for topic in topics)
    assert len(imu) == len(whole) == len(external) > 200
    assert {message.header.frame_id for message in imu} == {'wrist_ft_imu'}
    turning = np.array([[getattr(m.angular_velocity, axis) for axis in 'xyz'] for m in imu])
    rest = np.linalg.norm(turning, axis=1) < 0.02
    weight = np.array([six_of(m) for m in whole]) - [six_of(m) for m in external]
    masses = np.linalg.norm(weight[rest, :3], axis=1) / 9.807
    assert np.all(np.min(np.abs(masses[:, None] - [1.5, 2.3]), axis=1) < 0.05)
    felt = np.array([[getattr(m.linear_acceleration, axis) for axis in 'xyz'] for m in imu])
    assert np.all(np.abs(np.linalg.norm(felt[rest], axis=1) - 9.807) < 0.4)


def test_run_waits_until_its_subscribers_have_come(make):
    _, wake, sent, listeners = make()
    raw, reference = 'wrench_raw', 'wrench_reference'
    listeners.update(dict.fromkeys((raw, reference, 'temperature', 'temperature_2'), 0))
    wake(0.0, 5.0, 10.0)
    listeners[raw] = 1
    wake(15.0, 15.0 + 0.9 * SETTLE_S)
    listeners[reference] = 1
    wake(16.0, 16.0 + 0.9 * SETTLE_S)
    assert sent == {}
    wake(16.0 + SETTLE_S)
    assert list(sent[raw]) == list(sent[reference]) == [START_S * 10**9]
    listeners.update({raw: 0, reference: 0})
    wake(16.0 + SETTLE_S + LONGEST_WAKE_S)
    assert len(sent[raw]) > 1


def test_a_long_pause_is_caught_up_in_part(make):
    node, wake, sent, _ = make()
    node._woken_s = 0.0  # it has begun
    wake(0.0, 0.0105, 10.0, 10.0105)
    ran_s, stamps = 0.0105 + LONGEST_WAKE_S + 0.0105, list(sent['wrench_raw'])
    assert len(stamps) == 1 + int(ran_s * FAST['wrench_rate'])
    assert (np.diff(stamps) == 200_000_000).all()
