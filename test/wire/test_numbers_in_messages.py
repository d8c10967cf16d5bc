"""Numbers in messages of any type, against rosbags, one by one and many at once."""

import struct

import numpy as np
import pytest

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.wire.numbers_in_messages import follow, Layouts, NumberReader


@pytest.mark.parametrize('little', [True, False])
@pytest.mark.parametrize('k', range(5))
def test_every_part_is_found_as_rosbags_decodes_it(frame, define, messages, k, little):
    layout = follow(define(frame.kind), frame.kind, frame(k, little))
    true = messages.store.deserialize_cdr(frame(k, little), frame.kind)
    paths = {
        ('temperature',): true.temperature, ('counter',): true.counter, ('raw', 1): true.raw[1],
        ('header', 'stamp', 'nanosec'): true.header.stamp.nanosec,
    }  # fmt: skip
    for n, motor in enumerate(true.motors):
        paths['motors', n, 'mode'] = motor.mode
        paths.update({('motors', n, 'heat', i): heat for i, heat in enumerate(motor.heat)})
        assert layout.text(('motors', n, 'name')) == motor.name
    row = np.frombuffer(layout.data, np.uint8)[np.newaxis]
    assert {path: layout.find(path).values(row)[0] for path in paths} == paths
    assert layout.text(('text',)) == true.text
    assert layout.sizes['motors',] == len(true.motors)
    for path in (('on',), ('text',), ('raw',), ('raw', 2), ('raw', 'x'), ('motors', 4, 'mode')):
        assert layout.find(path) is None


def test_numbers_of_many_messages_are_those_of_each(frame, define):
    contents = [frame(k, little=k % 2 == 0) for k in range(60)]
    paths = [('temperature',), ('counter',), ('motors', 1, 'heat', 0), ('nothing', 3)]
    reader = NumberReader(define(frame.kind), frame.kind, paths)
    assert reader.has_header
    stamps_ns, values = reader.read(contents)
    assert stamps_ns.tolist() == [frame.start_ns + k for k in range(60)]
    assert values[:, 0].tolist() == [20.0 + k for k in range(60)]
    assert (values[:, 1] == 7).all()
    assert np.isfinite(values[:, 2]).tolist() == [k % 4 > 1 and k % 3 > 0 for k in range(60)]
    assert np.isnan(values[:, 3]).all()
    one_by_one = [reader.read([content])[1][0] for content in contents]
    np.testing.assert_array_equal(one_by_one, values)
    assert reader.read([])[1].shape == (0, 4)


def test_new_texts_in_every_message_do_not_fill_memory(define, messages):
    kind = 'std_msgs/msg/String'
    layouts = Layouts(define(kind), kind, lambda layout: layout.text(('data',)), same_texts=True)
    for k in range(3000):
        text = f'{k:04}' + 'x' * (k % 300)
        assert layouts.find(messages.pack(kind, text)) == text
    assert sum(map(len, layouts._of_size.values())) <= 400


def test_a_signalling_nan_is_no_number_and_no_warning(frame, define):
    content = frame(0)
    signalling = content.replace(struct.pack('<f', 20.0), struct.pack('<I', 0x7F800001))
    reader = NumberReader(define(frame.kind), frame.kind, [('temperature',)])
    np.testing.assert_equal(reader.read([signalling, content])[1][:, 0], [np.nan, 20.0])


@pytest.mark.parametrize('damage', [
    lambda _: b'', lambda whole: whole[:3], lambda whole: b'\7\7' + whole[2:],
    lambda whole: whole[:-9], lambda whole: whole + whole,
    lambda whole: whole[:12] + b'\xff' * 4 + whole[16:],
])  # fmt: skip
def test_a_damaged_message_is_refused(frame, define, damage):
    with pytest.raises(RecordingError):
        NumberReader(define(frame.kind), frame.kind, []).read([damage(frame(2))])


def test_padding_behind_the_last_field_is_no_damage():
    """Bytes of a sensor_msgs/JointState of two efforts and empty arrays, as rclpy wrote them."""
    data = bytes.fromhex(
        '00010000 00000000 00000000 01000000 009475ee 00000000 00000000 00000000 02000000'
        '00000000 00000000 00000000 00803540 0c7f0000 70ab3dea'
    )
    numbers = ('float64', -1)
    definitions = {
        'JointState': [
            ('header', ('Header', None)),
            ('name', ('string', -1)),
            *((name, numbers) for name in ('position', 'velocity', 'effort')),
        ],
        'Header': [('stamp', ('Time', None)), ('frame_id', ('string', None))],
        'Time': [('sec', ('int32', None)), ('nanosec', ('uint32', None))],
    }
    _, values = NumberReader(definitions, 'JointState', [('effort', 1)]).read([data] * 2)
    assert values.tolist() == [[21.5], [21.5]]
    with pytest.raises(RecordingError, match='28 of its 80 bytes are left behind'):
        follow(definitions, 'JointState', data + bytes(20))
