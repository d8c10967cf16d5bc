"""Bulk CDR against rosbags, message by message."""

import struct

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.wire import cdr


@pytest.fixture(scope='module')
def textbook(messages):
    """Read a message as rosbags does: stamp, and force and torque."""

    def read(message):
        wrench = messages.store.deserialize_cdr(message, messages.wrench_type)
        stamp, force, torque = wrench.header.stamp, wrench.wrench.force, wrench.wrench.torque
        six = [getattr(vector, name) for vector in (force, torque) for name in 'xyz']
        return stamp.sec * 10**9 + stamp.nanosec, six

    return read


frames = st.text(st.characters(exclude_characters='\0', exclude_categories=['Cs']), max_size=20)
doubles = st.floats(allow_nan=False)
stamps_ns = st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1)
#: What messages.wrench takes.
wrenches = st.tuples(stamps_ns, st.lists(doubles, min_size=6, max_size=6), frames, st.booleans())


@settings(max_examples=50)
@given(parts=st.lists(wrenches, max_size=12))
def test_bulk_reading_and_writing_agree_with_rosbags_one_by_one(parts, messages, textbook):
    contents = [messages.wrench(*fields) for fields in parts]
    stamps, values = cdr.decode_many(contents, 6)
    expected = [textbook(content) for content in contents]
    assert stamps.tolist() == [stamp for stamp, _ in expected]
    assert values.shape == (len(contents), 6), 'without messages, too'
    assert values.tolist() == [row for _, row in expected]
    replaced = cdr.encode_many(contents, values[::-1])
    assert [content[:-48] for content in replaced] == [content[:-48] for content in contents]
    assert [textbook(content)[1] for content in replaced] == values[::-1].tolist()


def with_length(length):
    return lambda wrench: wrench[:12] + struct.pack('<I', length) + wrench[16:]


@pytest.mark.parametrize(('change', 'sentence'), [
    (lambda _: b'', 'got 0 bytes'), (lambda _: b'\0\1\0\0abc', 'got 7 bytes'),
    (lambda wrench: b'\7' + wrench[1:], 'encapsulation 00 00 or 00 01'),
    (lambda wrench: b'\0\6' + wrench[2:], 'got 00 06'),
    (with_length(10**6), 'frame_id.*1000000'), (with_length(20), 'Expected 84 bytes.*got 68'),
    (lambda wrench: wrench[:-1], 'got 67'), (lambda wrench: wrench + b'\0', 'got 69'),
    (lambda wrench: wrench[:-32], '6 doubles'),
], ids=range(9))  # fmt: skip
def test_bytes_of_another_message_are_refused_in_a_sentence(messages, change, sentence):
    wrench = messages.wrench(1, [0.0] * 6, 'ft')
    data = change(wrench)
    with pytest.raises(RecordingError, match=sentence):
        cdr.locate(data, 6)
    with pytest.raises(RecordingError, match=sentence):
        cdr.decode_many([wrench, data], 6)
    with pytest.raises(RecordingError, match=sentence):
        cdr.encode_many([wrench, data], np.zeros((2, 6)))
