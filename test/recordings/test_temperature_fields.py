"""Temperatures that are fields of drivers' own messages, in bags of every kind."""

from importlib import import_module
import sys

import bag_samples
import numpy as np
import pytest

from wrist_ft_comp.channels import temperature_channel
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recording import Topics
from wrist_ft_comp.recordings import bag as bag_file
from wrist_ft_comp.recordings.read import backend as chosen_backend
from wrist_ft_comp.wire.numbers_in_messages import define_installed

BAGS = 'wrist_ft_comp.recordings'
T0 = 1_723_248_197_000_000_000
FRAME = """
std_msgs/Header header
Status status
geometry_msgs/Wrench wrench
float32 temperature
uint64 counter
================================================================================
MSG: driver_msgs/Status
bool overloaded
string text
"""
STATE = """
string[] names
float64[] temperatures
Motor[<=9] motors
std_msgs/Empty[2] nothing
int16[2] raw_temperature
================================================================================
MSG: driver_msgs/Motor
string<=20 name
byte mode
float32 temperature
"""


class Driver:
    """Two topics: frames with a header, and states without one."""

    def __init__(self, messages):
        self.messages = messages
        self.frame = messages.learn('driver_msgs/msg/Frame', FRAME)
        self.state = messages.learn('driver_msgs/msg/State', STATE)

    def of_frame(self, stamp_ns, kelvin, text='fine', little=True):
        make = self.messages.make
        zero = make('geometry_msgs/msg/Vector3', 0.0, 0.0, 0.0)
        wrench = make('geometry_msgs/msg/Wrench', zero, zero)
        status = make('driver_msgs/msg/Status', False, text)
        fields = self.frame, stamp_ns, status, wrench, kelvin, 7
        return self.messages.pack(*fields, little=little)

    def of_state(self, degrees, names=('shoulder', 'elbow'), little=True):
        make = self.messages.make
        motors = [make('driver_msgs/msg/Motor', name, 1, degrees + 10) for name in names]
        empty = make('std_msgs/msg/Empty', 0)
        array = np.array([degrees + k for k in range(6)])
        raw = np.array([1, round(degrees)], np.int16)
        fields = self.state, list(names), array, motors, [empty, empty], raw
        return self.messages.pack(*fields, little=little)

    def parts(self, count=2000):
        """A second of 1 kHz is 1000 frames; every hundredth comes with a wrench and a state."""
        for k in range(count):
            at = T0 + k * 10**6
            # Texts and arrays that change in length move what lies behind them.
            text = ('fine', 'a bit warm', '')[k % 3]
            names = ('shoulder', 'elbow', 'wrist')[: 2 + k // 100 % 2]
            frame = self.of_frame(at, 293.15 + k / 1000, text)
            yield '/driver/frame', self.frame, at + 5000, frame
            if k % 100 == 0:
                wrench = self.messages.wrench(at, [1.0] * 6)
                yield '/wrench_raw', self.messages.wrench_type, at + 4000, wrench
                yield '/driver/state', self.state, at + 7000, self.of_state(30 + k / 1000, names)


@pytest.fixture(scope='session')
def driver(messages):
    return Driver(messages)


@pytest.fixture
def ready(backend, driver, installed):
    """Whatever the backend needs to know the driver's types."""


def read(path, *temperatures):
    """Stamps and values of each thermometer."""
    parts, _ = bag_samples.read(path, Topics(temperatures=temperatures))
    found = [parts[temperature_channel(k),] for k in range(len(temperatures))]
    return [(stamps_ns.tolist(), values[:, 0].tolist()) for stamps_ns, values in found]


@pytest.mark.usefixtures('ready')
@pytest.mark.parametrize('storage', ['sqlite3', 'mcap'])
def test_both_storages_give_any_temperature(driver, messages, storage, tmp_path, monkeypatch):
    monkeypatch.setattr(bag_file, 'BATCH', 70)
    path = messages.write(tmp_path / 'bag', driver.parts(), storage)
    frame, first, last, motor, wrist = read(
        path, '/driver/frame:temperature:K', '/driver/state:temperatures[0]',
        'driver/state:temperatures.5:F', '/driver/state:motors[1].temperature*0.1',
        '/driver/state:temperatures[wrist]',
    )  # fmt: skip
    assert frame[0] == [T0 + k * 10**6 for k in range(2000)], 'stamps of the header'
    expected = [float(np.float32(293.15 + k / 1000)) - 273.15 for k in range(2000)]
    assert frame[1] == pytest.approx(expected, abs=1e-9)
    arrived = [T0 + k * 10**6 + 7000 for k in range(0, 2000, 100)]
    degrees = np.array([30 + k / 1000 for k in range(0, 2000, 100)])
    assert first == (arrived, pytest.approx(degrees)), 'times of arrival'
    assert last == (arrived, pytest.approx((degrees + 5 - 32) / 1.8))
    assert motor == (arrived, pytest.approx((degrees + 10) / 10))
    assert wrist == (arrived[1::2], pytest.approx(degrees[1::2] + 2)), 'others name no wrist'


WRONG = [
    ('/driver/frame:temprature', 'bag: .*/driver/frame:temprature.* is not there: .* are temp'),
    ('/driver/frame', 'is driver_msgs/msg/Frame; .* of a temperature TOPIC:FIELD'),
    ('/driver/frame:FIELD', 'is not there: the numbers there are temperature,'),
    ('/wrench_raw', 'is geometry_msgs/msg/WrenchStamped; the temperature must be sensor_msgs/m'),
    ('/wrench_raw:wrench.force.x', '/wrench_raw is named twice'),
    ('/nobody:temperature', 'no topic /nobody for the temperature; it holds /'),
]


@pytest.mark.usefixtures('ready')
@pytest.mark.parametrize(('entry', 'sentence'), WRONG, ids=[entry for entry, _ in WRONG])
def test_every_wrong_entry_gets_its_sentence(driver, messages, tmp_path, entry, sentence):
    path = messages.write(tmp_path / 'bag', driver.parts(101))
    with pytest.raises(RecordingError, match=sentence):
        read(path, entry)


@pytest.mark.usefixtures('ready')
def test_messages_that_arrive_at_once_all_count(driver, messages, tmp_path):
    """As in simulated time, which stands still between two messages of its clock."""
    parts = [('/wrench_raw', messages.wrench_type, T0, messages.wrench(T0, range(6)))]
    kind, state = driver.state, driver.of_state
    parts += [('/driver/state', kind, T0 + k // 10, state(20.0 + k)) for k in range(30)]
    path = messages.write(tmp_path / 'bag', parts)
    found = read(path, '/driver/state:temperatures[0]', '/driver/state:temperatures[1]')
    for j, (stamps_ns, values) in enumerate(found):
        assert stamps_ns == [T0 + k // 10 for k in range(30)]
        assert values == [20.0 + k + j for k in range(30)]


@pytest.mark.usefixtures('ready')
def test_times_of_arrival_are_not_compared_with_another_clock_s_stamps(driver, messages, tmp_path):
    since_boot_ns = 55 * 10**9
    wrenches = [
        ('/wrench_raw', messages.wrench_type, T0 + k, messages.wrench(since_boot_ns + k, range(6)))
        for k in range(3)
    ]
    frame = '/driver/frame', driver.frame, T0 + 4, driver.of_frame(since_boot_ns, 20.0)
    state = '/driver/state', driver.state, T0 + 4, driver.of_state(20.0)
    sentence = r'/driver/state of bag_\d are 17232\d{5} s ahead of .* where there is no stamp'
    for name, parts in ('bag_1', [*wrenches, frame, state]), ('bag_2', [state, frame, *wrenches]):
        path = messages.write(tmp_path / name, parts)
        assert read(path, '/driver/frame:temperature') == [([since_boot_ns], [20.0])]
        with pytest.raises(RecordingError, match=sentence):
            read(path, '/driver/state:temperatures[0]')


@pytest.mark.usefixtures('driver')
def test_a_type_that_nobody_can_describe_is_named(backend, messages, tmp_path, monkeypatch):
    frame, content = messages.learn('gone_msgs/msg/Heat', 'float64 temperature'), b'\0\1\0\0' * 3
    wrench = '/wrench_raw', messages.wrench_type, 1, messages.wrench(1, range(6))
    path = messages.write(tmp_path / 'bag', [wrench, ('/heat', frame, 1, content)])
    if backend == 'rosbags':  # as if the recorder had not known the type either
        rosbags_backend = import_module(f'{BAGS}.rosbags_backend')
        monkeypatch.setattr(rosbags_backend, '_parse', lambda _: {})
    with pytest.raises(RecordingError, match=r'/heat is gone_msgs/msg/Heat, .*gone_msgs'):
        read(path, '/heat:temperature')


@pytest.mark.parametrize('kind', ['os/path', 'os.path/msg/Join', 'a/msg/B;', ''])
def test_a_bag_cannot_make_the_package_import_what_is_no_message(kind):
    with pytest.raises(RecordingError, match=r'/heat carries .* no message of ROS'):
        define_installed('/heat', kind)


def test_without_rosbags_the_other_backend_is_taken(backend):
    assert chosen_backend().__name__ == f'{BAGS}.{backend.removesuffix("_py")}_backend'


def test_without_any_backend_the_sentence_says_what_to_install(monkeypatch, tmp_path):
    for name in ('rosbags', 'rosbag2'):
        monkeypatch.setitem(sys.modules, f'{BAGS}.{name}_backend', None)
    (tmp_path / 'a.mcap').write_bytes(b'x')
    with pytest.raises(RecordingError, match=r"rosbags .*rosbag2_py .*'pip install rosbags'"):
        read(tmp_path / 'a.mcap', '/temperature')
