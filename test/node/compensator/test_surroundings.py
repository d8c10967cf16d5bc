"""Remapping, namespaces, simulated time, quality of service: what a ROS user expects of a node."""

from builtin_interfaces.msg import Time
from geometry_msgs.msg import WrenchStamped
from rclpy.qos import QoSReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Temperature
from std_srvs.srv import SetBool, Trigger

from wrist_ft_comp.node.compensator_node import CompensatorNode
from wrist_ft_comp.ros import topics as qos
from wrist_ft_comp.ros.topics import wrench_message

SECOND = 1_000_000_000
LOAD = [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]
TIMEOUT_S = 60.0


def test_topics_and_the_node_can_be_remapped(bench, tmp_path):
    rules = {
        'wrench_raw': '/driver/ft',
        'wrench': '/clean/ft',
        'temperature': '/driver/heat',
        '__node': 'left_ft',
        '__ns': '/cell_1',
    }
    node = bench.start(CompensatorNode, remap=rules, parameters={'data_directory': str(tmp_path)})
    outputs = bench.listen(WrenchStamped, '/clean/ft')
    bench.publisher(Temperature, '/driver/heat')
    bench.wait_until(lambda: node._output.get_subscription_count() > 0, 'the listener')
    bench.publisher(WrenchStamped, '/driver/ft').publish(wrench_message(7, 'tool0', LOAD))
    assert outputs.get(timeout=TIMEOUT_S).header.stamp.nanosec == 7
    answer = bench.call(Trigger, '/cell_1/left_ft/rollback', Trigger.Request())
    assert 'no earlier model' in answer.message
    node.recording.begin()
    job_topics = node.calibration.job().topics
    assert (job_topics.wrench, job_topics.temperatures) == ('/driver/ft', ('/driver/heat',))


def test_simulated_time_stamps_what_has_no_stamp(wired, bench):
    node = wired(parameters={'use_sim_time': True, 'tare.duration': 0.01})
    clocks = bench.publisher(Clock, '/clock')
    clocks.publish(Clock(clock=Time(sec=4321)))
    bench.wait_until(lambda: node.node.now_ns() == 4321 * SECOND, 'the clock')
    assert node.ask_output(0, LOAD) == tuple(LOAD)
    assert node.node.counts.newest[0] == 4321 * SECOND
    assert node.diagnosis('input').name.endswith('input')
    answer = node.call('tare')
    assert 'was to last 0.01 s' in answer.message, 'timers are steady'


def test_quality_of_service_can_be_overridden_for_one_topic_only(bench, tmp_path):
    prefix = 'qos_overrides./other'
    node = bench.start(
        CompensatorNode,
        namespace='/other',
        parameters={
            'data_directory': str(tmp_path),
            f'{prefix}/wrench.publisher.reliability': 'best_effort',
            f'{prefix}/wrench_raw.subscription.reliability': 'reliable',
            f'{prefix}/temperature.subscription.depth': 7,
            f'{prefix}/wrench_reference.subscription.depth': 8,
        },
    )
    best_effort, reliable = QoSReliabilityPolicy.BEST_EFFORT, QoSReliabilityPolicy.RELIABLE
    assert node._output.qos_profile.reliability == best_effort
    assert node.drift_topic.drift.qos_profile.reliability == reliable
    assert node._raw.qos_profile.reliability == reliable
    for data in (True, False, True):  # the reference is subscribed to again
        request = SetBool.Request(data=data)
        assert bench.call(SetBool, '/other/wrist_ft_comp/record', request).success
    depths = {s.topic_name: s.qos_profile.depth for s in node.subscriptions}
    assert (depths['/other/temperature'], depths['/other/wrench_reference']) == (7, 8)
    assert (qos.OUTPUT.reliability, qos.FAST_SENSOR.reliability) == (reliable, best_effort)
    assert qos.SLOW_SENSOR.depth == 100
