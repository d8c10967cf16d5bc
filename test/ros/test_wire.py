from contextlib import suppress
import math
import struct

import pytest

pytest.importorskip('rclpy', reason='the node tests need ROS 2 (rclpy)')

from geometry_msgs.msg import WrenchStamped
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import get_typestore, Stores
from sensor_msgs.msg import Temperature

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.ros import messages as wire
from wrist_ft_comp.ros.messages import wrench_message

pytestmark = pytest.mark.usefixtures('ros_domain')

STORE = get_typestore(Stores.ROS2_JAZZY)
KIND = 'geometry_msgs/msg/WrenchStamped'
stamps = st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1)
frames = st.text(st.characters(exclude_categories=['Cs'], exclude_characters='\0'), max_size=60)
wrenches = st.lists(st.floats(), min_size=6, max_size=6)


def six(message):
    force, torque = message.wrench.force, message.wrench.torque
    return [force.x, force.y, force.z, torque.x, torque.y, torque.z]


def same(one, other):
    return all(
        a == b or (math.isnan(a) and math.isnan(b)) for a, b in zip(one, other, strict=True)
    )


def serialized(stamp, frame, values, little):
    """Serialize by an independent implementation, which knows both byte orders."""
    types = STORE.types
    vector = types['geometry_msgs/msg/Vector3']
    wrench = types['geometry_msgs/msg/Wrench'](vector(*values[:3]), vector(*values[3:]))
    time = types['builtin_interfaces/msg/Time'](*divmod(stamp, 10**9))
    message = types[KIND](types['std_msgs/msg/Header'](time, frame), wrench)
    return bytes(STORE.serialize_cdr(message, KIND, little_endian=little))


@given(stamps, frames, wrenches, wrenches)
def test_bytes_say_what_the_typed_message_says(stamp, frame, values, others):
    message = wrench_message(stamp, frame, values)
    data = serialize_message(message)
    layout, found_stamp, found = wire.Wire(6).read(data)
    assert found_stamp == stamp
    assert same(found, values)
    assert wire.frame_id(layout, data) == frame
    after = deserialize_message(wire.replace(layout, data, others), WrenchStamped)
    assert after.header == message.header
    assert same(six(after), others)


@given(stamps, frames, wrenches, wrenches, st.booleans())
def test_both_byte_orders_are_read_and_kept(stamp, frame, values, others, little):
    data = serialized(stamp, frame, values, little)
    layout, found_stamp, found = wire.Wire(6).read(data)
    assert found_stamp == stamp
    assert same(found, values)
    assert wire.frame_id(layout, data) == frame
    assert wire.replace(layout, data, others) == serialized(stamp, frame, others, little)


@given(st.lists(st.tuples(frames, wrenches, st.booleans()), max_size=20))
def test_messages_of_changing_layouts_are_told_apart(sent):
    shared = wire.Wire(6)
    for frame, values, little in sent:
        data = serialized(7, frame, values, little)
        layout, _, found = shared.read(data)
        assert wire.frame_id(layout, data) == frame
        assert same(found, values)


def test_many_layouts_do_not_pile_up():
    shared = wire.Wire(6)
    for length in range(1000):
        data = serialized(7, 'f' * length, [0.0] * 6, little=True)
        assert wire.frame_id(shared.layout(data), data) == 'f' * min(length, 255), 'no longer one'
    assert len(shared._known) <= 100


@given(stamps, frames, st.floats(), st.floats())
def test_temperatures_are_read_as_wrenches_are(stamp, frame, celsius, variance):
    message = Temperature(temperature=celsius, variance=variance)
    message.header = wrench_message(stamp, frame, [0.0] * 6).header
    data = serialize_message(message)
    _, found_stamp, found = wire.Wire(2).read(data)
    assert found_stamp == stamp
    assert same(found, (celsius, variance))


def test_bytes_that_only_align_are_no_part_of_the_frame_name():
    data = bytearray(serialized(7, 'tool', [0.0] * 6, little=True))
    data[21:24] = b'xyz'
    assert wire.frame_id(wire.Wire(6).layout(bytes(data)), bytes(data)) == 'tool'


@given(st.binary(max_size=200))
def test_other_bytes_are_refused_or_have_the_length_of_a_message(data):
    with suppress(RecordingError):
        layout, _, found = wire.Wire(6).read(data)
        assert len(data) == layout.offset + 48
        assert len(found) == 6


@pytest.mark.parametrize('length', [0, 3, 4, 15, 16, 40, 71, 73, 80])
def test_a_message_that_was_cut_or_grew_is_refused(length):
    data = serialized(7, 'tool0', [0.0] * 6, little=True)
    assert len(data) == 76
    shared = wire.Wire(6)
    shared.read(data)
    with pytest.raises(RecordingError):
        shared.read((data + bytes(8))[:length])


def test_a_frame_length_beyond_the_message_is_refused():
    data = bytearray(serialized(7, 'tool0', [0.0] * 6, little=True))
    struct.pack_into('<I', data, 12, 2**32 - 1)
    with pytest.raises(RecordingError, match='frame_id'):
        wire.Wire(6).read(bytes(data))
