"""Bulk CDR against rosbags, message by message."""

import struct

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from rosbags.typesys import get_typestore, Stores

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.files import cdr

STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = STORE.types
WRENCH, TEMPERATURE = 'geometry_msgs/msg/WrenchStamped', 'sensor_msgs/msg/Temperature'


def header(stamp_ns, frame):
    time = TYPES['builtin_interfaces/msg/Time'](*divmod(stamp_ns, 10**9))
    return TYPES['std_msgs/msg/Header'](time, frame)


def wrench(stamp_ns, values, frame='ft', little=True):
    vector = TYPES['geometry_msgs/msg/Vector3']
    body = TYPES['geometry_msgs/msg/Wrench'](vector(*values[:3]), vector(*values[3:]))
    message = TYPES[WRENCH](header(stamp_ns, frame), body)
    return bytes(STORE.serialize_cdr(message, WRENCH, little_endian=little))


def temperature(stamp_ns, value, frame='ft', little=True):
    message = TYPES[TEMPERATURE](header(stamp_ns, frame), value, 0.5)
    return bytes(STORE.serialize_cdr(message, TEMPERATURE, little_endian=little))


def textbook(message):
    read = STORE.deserialize_cdr(message, WRENCH)
    stamp, force, torque = read.header.stamp, read.wrench.force, read.wrench.torque
    return stamp.sec * 10**9 + stamp.nanosec, [
        *(force.x, force.y, force.z),
        *(torque.x, torque.y, torque.z),
    ]


frames = st.text(st.characters(exclude_characters='\0', exclude_categories=['Cs']), max_size=20)
doubles = st.floats(allow_nan=False)
wrenches = st.builds(
    wrench,
    st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1),
    st.lists(doubles, min_size=6, max_size=6),
    frames,
    st.booleans(),
)


@given(st.lists(wrenches, max_size=12))
def test_bulk_reading_agrees_with_rosbags_one_by_one(messages):
    stamps_ns, values = cdr.decode_many(messages, 6)
    expected = [textbook(message) for message in messages]
    assert stamps_ns.tolist() == [stamp for stamp, _ in expected]
    assert values.tolist() == [row for _, row in expected]


@given(st.lists(wrenches, min_size=1, max_size=12), st.randoms(use_true_random=False))
def test_replaced_doubles_are_read_back_and_headers_stay_byte_for_byte(messages, random):
    before = list(messages)
    values = np.array([[random.uniform(-1e3, 1e3) for _ in range(6)] for _ in messages])
    replaced = cdr.encode_many(messages, values)
    assert messages == before
    assert [message[:-48] for message in replaced] == [message[:-48] for message in messages]
    assert [textbook(message)[1] for message in replaced] == values.tolist()


@given(wrenches)
def test_replacing_doubles_by_themselves_changes_nothing(message):
    assert cdr.encode_many([message], cdr.decode_many([message], 6)[1]) == [message]


def test_many_equal_layouts_and_mixed_ones_give_the_same_numbers():
    same = [wrench(k * 10**6, [k, 1.0, 2.0, 3.0, 4.0, 5.0]) for k in range(50)]
    odd = [wrench(7, [0.0] * 6, 'a much longer frame'), wrench(8, [1.0] * 6, 'ft', little=False)]
    alone, mixed = cdr.decode_many(same, 6), cdr.decode_many([odd[0], *same, odd[1]], 6)
    np.testing.assert_array_equal(alone[0], mixed[0][1:-1])
    np.testing.assert_array_equal(alone[1], mixed[1][1:-1])
    assert alone[1].any()


@pytest.mark.parametrize('little', [True, False])
def test_temperature_is_the_first_of_two_doubles(little):
    stamps_ns, values = cdr.decode_many([temperature(3, 21.5, 'probe', little)], 2)
    assert stamps_ns.tolist() == [3]
    assert values.tolist() == [[21.5, 0.5]]


@pytest.mark.parametrize('little', [True, False])
def test_one_message_is_located_where_struct_finds_its_doubles(little):
    message = wrench(1, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 'frame', little)
    order = '<' if little else '>'
    offset = cdr.locate(message, 6).offset
    assert struct.unpack_from(f'{order}6d', message, offset) == (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)


def broken(change):
    message = bytearray(wrench(1, [0.0] * 6))
    change(message)
    return bytes(message)


@pytest.mark.parametrize(
    ('data', 'said'),
    [
        (b'', 'got 0 bytes'),
        (b'\0\1\0\0abc', 'got 7 bytes'),
        (b'\7' + wrench(1, [0.0] * 6)[1:], 'encapsulation 00 00 or 00 01'),
        (b'\0\6' + wrench(1, [0.0] * 6)[2:], 'got 00 06'),
        (broken(lambda m: struct.pack_into('<I', m, 12, 10**6)), 'frame_id.*1000000'),
        (broken(lambda m: struct.pack_into('<I', m, 12, 20)), 'Expected 84 bytes.*got 68'),
        (wrench(1, [0.0] * 6)[:-1], 'got 67'),
        (wrench(1, [0.0] * 6) + b'\0', 'got 69'),
        (temperature(1, 20.0), '6 doubles'),
    ],
    ids=range(9),
)
def test_what_is_not_the_message_is_refused_in_a_sentence(data, said):
    with pytest.raises(RecordingError, match=said):
        cdr.locate(data, 6)
    with pytest.raises(RecordingError, match=said):
        cdr.decode_many([wrench(1, [0.0] * 6), data], 6)
    with pytest.raises(RecordingError, match=said):
        cdr.encode_many([wrench(1, [0.0] * 6), data], np.zeros((2, 6)))


def test_no_messages_give_empty_arrays():
    stamps_ns, values = cdr.decode_many([], 6)
    assert stamps_ns.shape == (0,)
    assert values.shape == (0, 6)
    assert cdr.encode_many([], np.zeros((0, 6))) == []
