"""The bytes of messages say what rclpy's typed messages say."""

import math

import pytest

pytest.importorskip('rclpy', reason='the node tests need ROS 2 (rclpy)')

from geometry_msgs.msg import WrenchStamped
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Temperature

from wrist_ft_comp.files.cdr import locate
from wrist_ft_comp.ros.messages import wrench_message

pytestmark = pytest.mark.usefixtures('ros_domain')
stamps = st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1)
frames = st.text(st.characters(exclude_categories=['Cs'], exclude_characters='\0'), max_size=60)
wrenches = st.lists(st.floats(), min_size=6, max_size=6)


def same(one, other):
    return all(
        a == b or (math.isnan(a) and math.isnan(b)) for a, b in zip(one, other, strict=True)
    )


@given(stamps, frames, wrenches, wrenches)
def test_of_a_wrench(stamp, frame, values, others):
    message = wrench_message(stamp, frame, values)
    data = serialize_message(message)
    layout = locate(data, 6)
    decoded_stamp, decoded = layout.decode(data)
    assert (decoded_stamp, layout.frame_id(data)) == (stamp, frame)
    assert same(decoded, values)
    after = deserialize_message(layout.encode(data, others), WrenchStamped)
    assert after.header == message.header
    force, torque = after.wrench.force, after.wrench.torque
    assert same([force.x, force.y, force.z, torque.x, torque.y, torque.z], others)


@given(stamps, frames, st.floats(), st.floats())
def test_of_a_temperature(stamp, frame, celsius, variance):
    message = Temperature(temperature=celsius, variance=variance)
    message.header = wrench_message(stamp, frame, [0.0] * 6).header
    data = serialize_message(message)
    decoded_stamp, decoded = locate(data, 2).decode(data)
    assert decoded_stamp == stamp
    assert same(decoded, (celsius, variance))
