"""Specific force by TF, over DDS, and what is said where it cannot be heard."""

from geometry_msgs.msg import PoseArray
from moments import SECOND, START
import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from scipy.spatial.transform import Rotation

from wrist_ft_comp.channels import GRAVITY

pytestmark = pytest.mark.usefixtures('tf_messages')


def test_gravity_comes_by_tf_in_the_frame_of_the_wrench(wired, bench, messages):
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    static = bench.helper.create_publisher(PoseArray, '/tf_static', latched)
    mount = Rotation.from_euler('y', 0.5)
    static.publish(messages.transforms(0, [('flange', 'tool0', mount.as_quat())]))
    node = wired(parameters={'gravity.source': 'tf', 'gravity.frame': 'base'})
    force = node.node.specific_force
    node.wait_until(lambda: force._tree._links, 'the static transform')
    assert (
        force.problem() == 'the wrench has no frame_id, which TF is to turn; set it in its driver'
    )
    node.ask_output(START, [0.0] * 6)  # tells the frame, tool0
    publisher = bench.publisher(PoseArray, '/tf')
    for k in range(20):
        arm = Rotation.from_euler('z', 0.025 * k).as_quat()
        at = START + k * SECOND // 20
        publisher.publish(messages.transforms(at, [('base', 'flange', arm)]))
    at = START + SECOND // 2
    node.wait_until(lambda: force.forces.at(at) is not None and force.speed, 'the force')
    np.testing.assert_allclose(force.forces.at(at), mount.inv().apply([0, 0, GRAVITY]), atol=1e-9)
    assert force.speed == pytest.approx(0.5)
    topics = node.node.full_topics()
    assert (topics.imu, topics.gravity_frame) == ('', 'base')


def test_static_transforms_that_cannot_be_heard_are_named(wired, driver):
    node = wired(parameters={'gravity.source': 'tf', 'gravity.frame': 'base'})
    driver().helper.create_publisher(PoseArray, '/tf_static', 1)
    node.diagnosis('payload', '/tf_static passes nothing, because its quality of service differs')
