"""Specific force in the node's own recording, over DDS."""

from geometry_msgs.msg import AccelStamped, PoseArray
import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from scipy.spatial.transform import Rotation

from wrist_ft_comp.channels import GRAVITY
from wrist_ft_comp.recordings.read import read_recording
from wrist_ft_comp.stream.stream_grid import FORCE

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
CELLS = 4


def record(node, put):
    """Record some cells of 20 wrenches, each with what is put beside it; give the table."""
    answer = node.call('record', True)
    assert answer.success, answer.message
    (path,) = (node.directory / 'recordings').glob('*.csv')
    node.ask_output(START - SECOND, [0.0] * 6)  # tells the frame, tool0
    averager = node.node.recording.current.averager
    for cell in range(CELLS + 1):
        stamps = START + cell * SECOND + np.arange(20) * SECOND // 20
        for stamp in stamps.tolist():
            put(stamp)
        node.wait_until(lambda: averager._latest.get(FORCE) == cell + START // SECOND, 'the force')  # noqa: B023
        node.stream(stamps, np.ones((20, 6)))
        node.warm(int(stamps[10]), 25.0)
    assert node.call('record', False).success
    return read_recording(path)


@pytest.mark.usefixtures('tf_messages')
def test_gravity_by_tf_is_recorded_beside_the_wrench(wired, bench, messages):
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    static = bench.helper.create_publisher(PoseArray, '/tf_static', latched)
    mount = Rotation.from_euler('y', 0.5)
    static.publish(messages.transforms(0, [('flange', 'tool0', mount.as_quat())]))
    node = wired(parameters={'gravity.source': 'tf', 'gravity.frame': 'base'})
    node.wait_until(lambda: node.node.specific_force._tree._links, 'the static transform')
    publisher = bench.publisher(PoseArray, '/tf')

    def put(stamp):
        arm = Rotation.from_euler('z', 0.5 * (stamp - START) / SECOND)
        publisher.publish(messages.transforms(stamp, [('base', 'flange', arm.as_quat())]))

    recording = record(node, put)
    force = mount.inv().apply([0, 0, GRAVITY])
    np.testing.assert_allclose(recording.specific_force[:CELLS], [force] * CELLS, atol=1e-9)
    np.testing.assert_allclose(recording.rotation_speed[:CELLS], 0.5, atol=1e-6)
    topics = node.node.calibration.job().topics
    assert (topics.imu, topics.gravity_frame) == ('', 'base')


@pytest.mark.usefixtures('tf_messages')
@pytest.mark.parametrize(
    ('source', 'kind', 'topic', 'said'),
    [
        ('imu', AccelStamped, 'imu', 'carries geometry_msgs/AccelStamped, not sensor_msgs/Imu'),
        ('tf', PoseArray, '/tf_static', 'offers less durability than is asked for'),
    ],
)
def test_a_publisher_that_cannot_be_heard_is_named(  # noqa: PLR0913, PLR0917 -- fixtures
    wired, driver, source, kind, topic, said
):
    """Of another type, and transforms that are not kept for those who come later."""
    node = wired(parameters={'gravity.source': source, 'gravity.frame': 'base'})
    name = topic if topic[0] == '/' else node.topic(topic)
    driver().helper.create_publisher(kind, name, 1)
    node.diagnosis('payload', said)
