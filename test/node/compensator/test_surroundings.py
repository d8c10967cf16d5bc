"""Remapping, namespaces, simulated time, quality of service: what a ROS user expects of a node."""

from builtin_interfaces.msg import Time
from geometry_msgs.msg import WrenchStamped
from moments import SECOND, TIMEOUT_S
from rclpy.qos import QoSReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from wrist_ft_comp.node.compensator_node import CompensatorNode
from wrist_ft_comp.ros import topics as qos
from wrist_ft_comp.ros.topics import wrench_message

LOAD = [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]


def test_topics_and_the_node_can_be_remapped(bench, tmp_path):
    rules = {
        'wrench_raw': '/driver/ft', 'wrench': '/clean/ft', 'temperature': '/driver/heat',
        '__node': 'left_ft', '__ns': '/cell_1',
    }  # fmt: skip
    node = bench.start(CompensatorNode, remap=rules, parameters={'data_directory': str(tmp_path)})
    outputs = bench.listen(WrenchStamped, '/clean/ft')
    bench.wait_until(lambda: node._output.get_subscription_count() > 0, 'the listener')
    bench.publisher(WrenchStamped, '/driver/ft').publish(wrench_message(7, 'tool0', LOAD))
    assert outputs.get(timeout=TIMEOUT_S).header.stamp.nanosec == 7
    answer = bench.call(Trigger, '/cell_1/left_ft/rollback', Trigger.Request())
    assert 'no earlier model' in answer.message
    topics = node.full_topics()
    assert (topics.wrench, topics.temperatures) == ('/driver/ft', ('/driver/heat',))


def test_of_names_that_are_remapped_in_a_chain_the_driver_is_seen(bench, tmp_path):
    """The driver publishes on wrench, and what is corrected gets another name."""
    rules = {'wrench_raw': 'wrench', 'wrench': 'clean'}
    given = {'data_directory': str(tmp_path)}
    node = bench.start(CompensatorNode, namespace='/chain', remap=rules, parameters=given)
    driver = bench.publisher(WrenchStamped, '/chain/wrench')
    bench.wait_until(lambda: node.counts.drivers, 'the driver')
    bench.helper.destroy_publisher(driver)
    bench.helper.create_publisher(WrenchStamped, '/chain/wrench', 1)
    words = 'the publisher of /chain/wrench has left and another one came: its zero may be'
    doubts = node.compensator.lasting_doubts
    bench.wait_until(lambda: any(words in why for why in doubts), 'the doubt')


def test_simulated_time_stamps_what_has_no_stamp(wired, bench):
    node = wired(parameters={'use_sim_time': True, 'tare.duration': 0.01})
    node.ask_output(0, LOAD)
    assert 'nobody publishes /clock' in node.diagnosis('input').message
    clocks = bench.publisher(Clock, '/clock')
    clocks.publish(Clock(clock=Time(sec=4321)))
    bench.wait_until(lambda: node.node.now_ns() == 4321 * SECOND, 'the clock')
    assert node.ask_output(0, LOAD) == tuple(LOAD)
    assert node.node.counts.newest[0] == 4321 * SECOND
    assert 'nobody' not in node.diagnosis('input').message
    answer = node.call('tare')
    assert 'was to last 0.01 s' in answer.message, 'timers are steady'


def test_quality_of_service_can_be_overridden_for_one_topic_only(rig):
    best_effort, reliable = QoSReliabilityPolicy.BEST_EFFORT, QoSReliabilityPolicy.RELIABLE
    overrides = {
        'wrench.publisher.reliability': 'best_effort',
        'wrench_raw.subscription.reliability': 'reliable',
        'temperature.subscription.depth': 7,
        'wrench_reference.subscription.depth': 8,
    }
    given = {f'qos_overrides./other/{name}': value for name, value in overrides.items()}
    one = rig(namespace='/other', parameters=given)
    node = one.node
    assert node._output.qos_profile.reliability == best_effort
    assert node.drift_topic.drift.qos_profile.reliability == reliable
    assert node._raw.qos_profile.reliability == reliable
    for data in (True, False, True):  # the reference is subscribed to again
        assert one.call('record', data).success
    depths = {s.topic_name: s.qos_profile.depth for s in node.subscriptions}
    assert (depths['/other/temperature'], depths['/other/wrench_reference']) == (7, 8)
    assert (qos.OUTPUT.reliability, qos.FAST_SENSOR.reliability) == (reliable, best_effort)
    assert qos.SLOW_SENSOR.depth == 100
