"""Raw wrenches inside drivers' own messages, in every form, in bags by every backend."""

import numpy as np
import pytest

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recordings.compensated_copy import rewrite_recording
from wrist_ft_comp.recordings.read import read_recording
from wrist_ft_comp.signals import Topics

T0 = 1_723_248_197_000_000_000
SECONDS, ARRIVES_LATER_NS = 40, 250_000_000
#: A text that changes in length lies before all numbers.
FRAME = """
string text
Inner inner
float32[3] force
float32[3] torque
float64[] numbers
float64[6] tcp_force
Other other
float64 temperature
================================================================================
MSG: forms_msgs/Other
OtherHeader header
geometry_msgs/Wrench wrench
================================================================================
MSG: forms_msgs/OtherHeader
builtin_interfaces/Time stamp
uint64 count
================================================================================
MSG: forms_msgs/Inner
std_msgs/Header header
geometry_msgs/WrenchStamped stamped
geometry_msgs/Wrench bare
"""
#: What each form adds to the six numbers; whose time its wrenches have; and its frame.
FORMS = {
    'inner.stamped': (0.0, 'own', 'sensor'),
    'inner.stamped.wrench': (0.0, 'own', 'sensor'),
    'inner.bare': (10.0, 'inner', 'here'),
    '.': (20.0, 'arrival', None),
    'numbers[2..7]': (30.0, 'arrival', None),
    'tcp_force': (40.0, 'arrival', None),
    'other': (50.0, 'arrival', None),
}


def six(second):
    return np.array([second, -1.0, 0.5 * second, 0.25, 0.5, 1.0])


def parts(messages, seconds=SECONDS, without=()):
    kind = messages.learn('forms_msgs/msg/Frame', FRAME)
    make, store = messages.make, messages.store

    def bare(values):
        halves = (make('geometry_msgs/msg/Vector3', *values[i : i + 3].tolist()) for i in (0, 3))
        return make('geometry_msgs/msg/Wrench', *halves)

    for second in range(seconds):
        at, values = T0 + second * 10**9, six(second)
        whole = store.deserialize_cdr(messages.wrench(at, values, 'sensor'), messages.wrench_type)
        inner = make('forms_msgs/msg/Inner', at + 10**8, whole, bare(values + 10))
        halves = np.split((values + 20).astype(np.float32), 2)
        numbers = np.r_[7.0, 7.0, values + 30, 7.0][: 0 if second in without else None]
        time = make('builtin_interfaces/msg/Time', 5, 6)
        count = make('forms_msgs/msg/OtherHeader', time, 7)
        other = store.types['forms_msgs/msg/Other'](count, bare(values + 50))
        fields = inner, *halves, numbers, values + 40, other, 20.0 + second / 10
        data = messages.pack(kind, 'x' * (second % 3), *fields)
        yield '/frame', kind, at + ARRIVES_LATER_NS, data


@pytest.fixture
def bag(messages, tmp_path, backend, request):  # noqa: ARG001 -- chosen before a bag is opened
    path = messages.write(tmp_path / 'bag', parts(messages), 'mcap')
    request.getfixturevalue('installed')
    return path


def topics(inside):
    return Topics(f'/frame:{inside}', ('/frame:temperature',))


@pytest.mark.parametrize('inside', FORMS)
def test_every_form_is_read_and_rewritten_as_a_wrench_of_its_own(bag, tmp_path, inside):
    added, clock, frame = FORMS[inside]
    recording = read_recording(bag, topics=topics(inside))
    expected = np.array([six(second) for second in range(SECONDS)]) + added
    assert recording.sensor.get('frame_id') == ([frame] if frame else None)
    assert recording.sensor['wrench_topic'] == [f'/frame:{inside}']
    seen = []

    def doubled(stamps_ns, raw):
        seen.extend(stamps_ns.tolist())
        return 2 * raw

    rewrite_recording(bag, tmp_path / 'out', doubled, topics=topics(inside))
    begins = T0 + {'own': 0, 'inner': 10**8, 'arrival': ARRIVES_LATER_NS}[clock]
    assert seen == [begins + second * 10**9 for second in range(SECONDS)]
    # The temperature has no header around it, so that its cells are those of arrival.
    again = read_recording(tmp_path / 'out', topics=Topics('/wrench', ('/frame:temperature',)))
    assert again.wrench == pytest.approx(2 * expected, nan_ok=True)
    assert recording.wrench == pytest.approx(expected, nan_ok=True)


@pytest.mark.parametrize(
    ('inside', 'words'),
    [
        ('numbers', r'an array of 9; name six of them, such as \[0..5\]'),
        ('numbers[4..9]', 'an array of 9'),
        (
            'inner',
            'The message holds inner.stamped.wrench, inner.bare, ., tcp_force, other.wrench',
        ),
        ('text', 'is not there'),
    ],
)
def test_without_a_wrench_the_sentence_names_the_fields_there_are(bag, inside, words):
    with pytest.raises(RecordingError, match=words):
        read_recording(bag, topics=topics(inside))


def test_messages_without_the_wrench_are_dropped_and_counted(messages, tmp_path):
    path = messages.write(tmp_path / 'bag', parts(messages, 240, without={0, 20}), 'mcap')
    recording = read_recording(path, topics=topics('numbers[2..7]'))
    assert np.flatnonzero(np.isnan(recording.wrench[:, 2])).tolist() == [0, 20]
    assert [warning for warning in recording.warnings if '2 of 240' in warning], recording.warnings
    path = messages.write(tmp_path / 'none', parts(messages, 5, without=range(5)), 'mcap')
    with pytest.raises(RecordingError, match='array of 0'):
        read_recording(path, topics=topics('numbers[2..7]'))
