"""Specific force of bags: by an IMU, or by TF, whatever TF does."""

from itertools import chain

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrist_ft_comp.channels import GRAVITY
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recording import Topics
from wrist_ft_comp.recordings import bag as bag_file
from wrist_ft_comp.recordings.read import read_recording

by_either_backend = pytest.mark.usefixtures('backend')
T0 = 1_723_248_197_000_000_000
TF, IMU = 'tf2_msgs/msg/TFMessage', 'sensor_msgs/msg/Imu'
BASE, MOUNT = Rotation.from_euler('xyz', [[0.2, -0.1, 1.0], [3.0, 0.05, 0.4]])
BY_TF = Topics(gravity_frame='world')
#: When the robot comes to rest, and how many seconds it is recorded.
REST, END = 6, 14


def stamps(seconds):
    return (T0 + np.rint(np.asarray(seconds) * 1e9).astype(int)).tolist()


def shoulder(seconds):
    turned = np.sin(0.7 * np.minimum(seconds, REST))
    return Rotation.from_rotvec(np.multiply.outer(turned, [0, 0, 1]))


def elbow(seconds):
    return Rotation.from_rotvec(np.multiply.outer(0.3 + np.minimum(seconds, REST), [1, 0, 0]))


def true_force(seconds):
    """Gravity in the sensor's frame, shape (n, 3), by scipy."""
    turned = BASE * shoulder(seconds) * elbow(seconds) * MOUNT
    return turned.inv().apply([0, 0, GRAVITY])


def means(cells, values):
    """Average a function of time over cells of 1 s."""
    return np.stack([values(k + (np.arange(1000) + 0.5) / 1000).mean(axis=0) for k in cells])


def true_square_speed(seconds):
    """Of two joints at right angles."""
    return ((0.7 * np.cos(0.7 * seconds)) ** 2 + 1) * (seconds < REST)


@pytest.fixture
def robot(messages, tmp_path):
    """Write a bag of a robot that moves, its TF changed as a test wants."""

    class Robot:
        static = ('world', 'base', BASE.as_quat()), ('/tool', 'ft_sensor', MOUNT.as_quat())

        def still(self, stamp_ns=T0, links=None):
            yield '/tf_static', TF, stamp_ns, messages.transforms(stamp_ns, links or self.static)

        def moving(self, seconds, frames=('base', 'arm', 'tool'), little=True, more=()):
            for second in seconds:
                at, (base, arm, tool) = T0 + round(second * 1e9), frames
                one = base, arm, shoulder(second).as_quat()
                other = arm, tool, -elbow(second).as_quat()  # its sign is free
                yield '/tf', TF, at, messages.transforms(at, [one, other, *more], little)

        def wrenches(self, seconds=END, frame='ft_sensor'):
            """Write as little of the rest as a recording needs."""
            for at in stamps(np.arange(0.05, seconds, 0.1)):
                wrench = messages.wrench(at, [1, 2, 3, 4, 5, 6], frame)
                yield '/wrench_raw', messages.wrench_type, at, wrench
                warm = messages.temperature(at, 25.0)
                yield '/temperature', messages.temperature_type, at, warm

        def write(self, *parts, storage='mcap', name='bag'):
            """Write what came, in order of arrival."""
            rows = sorted(chain.from_iterable(parts), key=lambda row: row[2])
            return messages.write(tmp_path / name, rows, storage)

    return Robot()


@by_either_backend
@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_an_imu_gives_mean_force_and_effective_speed(robot, messages, storage, monkeypatch):
    monkeypatch.setattr(bag_file, 'BATCH', 77)
    seconds = np.arange(0, END, 0.01)
    speeds = np.random.default_rng(1).normal(0, 0.3, (len(seconds), 3))
    rows = zip(stamps(seconds), 0.97 * true_force(seconds), speeds, strict=True)
    imu = [
        ('/arm/imu', IMU, at, messages.imu(at, force, speed, little=bool(k % 2)))
        for k, (at, force, speed) in enumerate(rows)
    ]
    path = robot.write(imu, robot.wrenches(), storage=storage)
    recording = read_recording(path, topics=Topics(imu='arm/imu'))
    expected = 0.97 * true_force(seconds).reshape(END, 100, 3).mean(axis=1)
    np.testing.assert_allclose(recording.specific_force, expected)
    square = (speeds**2).sum(axis=1).reshape(END, 100).mean(axis=1)
    np.testing.assert_allclose(recording.rotation_speed, np.sqrt(square))


def test_an_accelerometer_without_gyroscope_has_no_speed_of_rotation(robot, messages):
    times = stamps(np.arange(0, END, 0.1))
    imu = [('/imu', IMU, at, messages.imu(at, [0, 0, 9.8], [0, 0, 0])) for at in times]
    recording = read_recording(robot.write(imu, robot.wrenches()), topics=Topics(imu='/imu'))
    assert recording.rotation_speed is None
    np.testing.assert_allclose(recording.specific_force, [[0, 0, 9.8]] * END)


@by_either_backend
@pytest.mark.parametrize(('rate', 'tolerance'), [(10, 0.05), (100, 0.01)])
def test_tf_gives_gravity_in_the_frame_of_the_wrench(robot, rate, tolerance, monkeypatch):
    monkeypatch.setattr(bag_file, 'BATCH', 77)
    moving = robot.moving(np.arange(0, END + 0.1, 1 / rate))
    path = robot.write(robot.still(), moving, robot.wrenches())
    recording = read_recording(path, topics=BY_TF)
    cells = range(END)
    force, speed = recording.specific_force[:END], recording.rotation_speed[:END]
    np.testing.assert_allclose(force, means(cells, true_force), atol=tolerance)
    assert recording.origin_ns == stamps(0.05), 'TF begins earlier'
    expected = np.sqrt(means(cells, true_square_speed))
    expected[REST] = speed[REST]  # the step in which it stops ends there
    np.testing.assert_allclose(speed, expected, atol=0.02)


@pytest.mark.parametrize('ahead_s', [2.5, 5, 1000])
def test_one_transform_that_is_stamped_ahead_costs_no_force(robot, monkeypatch, ahead_s):
    monkeypatch.setattr(bag_file, 'BATCH', 100)
    moving = list(robot.moving(np.arange(0, END + 0.1, 0.01)))
    ((*_, ahead),) = robot.moving([3.2 + ahead_s])
    moving[320] = *moving[320][:3], ahead
    path = robot.write(robot.still(), moving, robot.wrenches())
    force = read_recording(path, topics=BY_TF).specific_force[:END]
    np.testing.assert_allclose(force, means(range(END), true_force), atol=0.05)


def test_tf_may_lie_in_one_namespace_and_lose_a_frame(robot):
    gripped = robot.moving(np.arange(0, REST, 0.05), more=[('tool', 'finger', [0, 0, 0, 1])])
    parts = robot.still(), gripped, robot.moving(np.arange(REST, END + 0.1, 0.05))
    inside = [(f'/left{topic}', *rest) for part in parts for topic, *rest in part]
    force = read_recording(robot.write(inside, robot.wrenches()), topics=BY_TF).specific_force
    np.testing.assert_allclose(force[:END], means(range(END), true_force), atol=0.02)
    others = [(topic.replace('left', 'right'), *rest) for topic, *rest in inside]
    both = robot.write(inside, others, robot.wrenches(), name='both')
    with pytest.raises(RecordingError, match='holds no topic /tf for the gravity'):
        read_recording(both, topics=BY_TF)


def test_a_bag_without_the_direction_of_gravity_is_refused(robot, messages):
    none, (arm, tool) = [0, 0, 0, 1], ('arm', 'tool')
    broken = [('/tf', TF, T0, messages.transforms(T0, [('a', 'b', none)])[:-40])]
    links = [(arm, tool, none), (tool, arm, none)]
    times = stamps(np.arange(0, 2, 0.1))
    loop = [('/tf', TF, at, messages.transforms(at, links)) for at in times]
    apart = robot.still(links=[('x', 'world', none), (tool, 'ft_sensor', none)])
    turned = robot.still(links=[('world', 'base', [0] * 4), (tool, 'ft_sensor', none)])
    for n, (parts, sentence) in enumerate((
        ([robot.still(), loop, robot.wrenches(2)], 'no chain of transforms, without a loop'),
        ([apart, robot.moving(np.arange(0, 2, 0.05)), robot.wrenches(2)], 'no chain of'),
        ([turned, robot.moving(np.arange(0, 2, 0.05)), robot.wrenches(2)], 'world is'),
        ([robot.moving(np.arange(5, 9, 0.05)), robot.wrenches(8)],
         'world and ft_sensor are missing.*arm, base, tool.* or all of a split bag'),
        ([robot.wrenches(1)], 'holds no topic /tf for the gravity'),
        ([robot.moving([0]), robot.wrenches(1, frame='')], 'has no frame_id'),
        ([broken, robot.wrenches(1)], 'A transform of .* is damaged. Expected a tf2_msgs'),
    )):  # fmt: skip
        path = robot.write(*parts, name=f'bag{n}')
        with pytest.raises(RecordingError, match=sentence):
            read_recording(path, topics=BY_TF)
