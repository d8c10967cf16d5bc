"""Where down is, live: bytes of an IMU or of TF in, specific force out."""

import sys

from moments import SECOND, START
import numpy as np
import pytest
from rclpy.serialization import serialize_message
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import Imu

from wrist_ft_comp.channels import GRAVITY
from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.node.specific_force import RecentForces, SpecificForceInput
from wrist_ft_comp.payload.weight import ForceFrame
from wrist_ft_comp.stream.compensator import Compensator

NO_TURN = [0.0, 0.0, 0.0, 1.0]
UP, AWAY = (0.0, 0.0, 9.8), (9.8, 0.0, 0.0)
TO_TOOL = 'arm', 'tool', NO_TURN
FROZEN = 'specific force has not changed by a bit for seconds; is the IMU frozen?'


@pytest.fixture
def start(fake_hub):
    def make(source='tf', upper='world', frame='tool'):
        chosen = {'gravity.source': source, 'gravity.frame': upper, 'gravity.timeout': 0.2}
        part = SpecificForceInput(chosen, Compensator(1))
        hub = fake_hub(part, **chosen)
        hub.frame = frame
        part.start()
        return part, hub

    return make


def samples(hub):
    assert {verb for verb, *_ in hub.sent} <= {'on_specific_force'}
    return [tuple(sample) for _, *sample in hub.sent]


@pytest.fixture
def without_tf2(monkeypatch):
    """Let it be missing, as it is where there are only wheels."""
    monkeypatch.setitem(sys.modules, 'tf2_msgs.msg', None)


@pytest.fixture
def moving(messages):
    """Send the transform of an arm that turns about x by 1 rad/s to a source."""

    def send(hub, milliseconds, *more):
        at = START + round(milliseconds * 1e6)
        turned = Rotation.from_euler('x', milliseconds / 1000).as_quat()
        hub.topics['/tf'](messages.transforms(at, [('/world', 'arm', turned), *more]))

    return send


def true_force(seconds):
    return Rotation.from_euler('x', seconds).inv().apply([0, 0, GRAVITY])


@pytest.mark.usefixtures('without_tf2')
def test_imu_samples_are_passed_on_and_unusable_ones_are_counted(start, messages):
    part, hub = start('imu')
    assert list(hub.topics) == ['imu']
    hub.topics['imu'].messages += [
        messages.imu(START, [1, 2, 9], [0.3, 0, 0.4]),
        messages.imu(START + 1, [1, 2, 9], [0, 0, 0], little=False),
        messages.imu(START, [1, np.nan, 9], [0, 0, 0]),
        b'nonsense',
    ]
    part.poll()
    assert samples(hub) == [(START, (1, 2, 9), 0.5), (START + 1, (1, 2, 9), None)]
    assert part.unreadable == 2


@pytest.mark.usefixtures('ros_domain', 'tf_messages')
def test_tf_gives_samples_where_all_transforms_are_there(start, messages, moving):
    part, hub = start()
    assert part.problem().startswith('TF does not say how tool is turned against world: ')
    for milliseconds in range(0, 2000, 4):
        moving(hub, milliseconds)
        if milliseconds % 50 == 0:  # of the faster one some are there already
            at = START + (milliseconds - 2) * 10**6
            hub.topics['/tf'](messages.transforms(at, [TO_TOOL]))
    assert part.problem() == ''
    at, forces, speeds = zip(*samples(hub), strict=True)
    seconds = (np.array(at) - START) / 1e9
    np.testing.assert_allclose(forces, true_force(seconds), atol=1e-4)
    assert speeds[0] is None
    np.testing.assert_allclose(speeds[1:], 1.0, rtol=1e-3)
    np.testing.assert_allclose(np.diff(seconds), 0.1)


@pytest.mark.usefixtures('ros_domain', 'tf_messages')
@pytest.mark.parametrize('source', ['tf', 'imu'])
def test_by_tf_nothing_is_judged_in_a_swing_and_for_a_second_after_it(start, source):
    part, _ = start(source)
    calm = []
    for k, speed in enumerate([None, *[0.5] * 9, *[0.1] * 20, 0.3, 0.1]):
        part.on_specific_force(START + k * SECOND // 10, UP, speed)
        calm.append(part.is_calm(START + k * SECOND // 10))
    by_tf = [False] * 20 + [True] * 10 + [False] * 2
    assert calm == (by_tf if source == 'tf' else [True] * 32)


@pytest.mark.usefixtures('ros_domain', 'tf_messages')
def test_a_frame_that_is_moved_on_the_robot_is_doubted_until_the_next_tare(start, moving):
    part, hub = start()
    stream, turned = part._compensator, Rotation.from_euler('y', 30, degrees=True).as_quat()
    for milliseconds in range(0, 100, 10):
        moving(hub, milliseconds, TO_TOOL)
    assert stream.zero_doubts == []
    for milliseconds, quaternion in ((100, turned), (3200, NO_TURN), (6300, turned)):
        moving(hub, milliseconds, ('arm', 'tool', quaternion))
        moving(hub, milliseconds + 10, ('arm', 'tool', quaternion))
        (doubt,) = stream.zero_doubts
        assert doubt.startswith('by TF the frame of the wrench turned faster than a robot')
        if milliseconds < 3200:  # later ones add no sentence
            stream.reset_tare()


@pytest.mark.usefixtures('ros_domain', 'tf_messages')
def test_frames_of_made_up_names_and_transforms_sent_again_fill_no_memory(start, messages, moving):
    part, hub = start()
    for k in range(1200):
        hub.topics['/tf'](messages.transforms(START, [('world', f'object_{k}', NO_TURN)]))
        hub.topics['/tf_static'](messages.transforms(START, [(f'map_{k}', f'mark_{k}', NO_TURN)]))
        hub.topics['/tf_static'](messages.transforms(START + k, [TO_TOOL]))
    links = part._tree._links
    assert sum(1 + len(link._columns[0]) for link in links.values()) <= 2002
    assert part.problem().count(', ') < 30
    moving(hub, 0)
    np.testing.assert_allclose(samples(hub)[0][1], true_force(0), atol=1e-9)


@pytest.mark.usefixtures('without_tf2')
def test_without_tf2_msgs_or_a_frame_tf_is_refused(start):
    with pytest.raises(SettingsError, match='package tf2_msgs with this type is not installed'):
        start()
    with pytest.raises(SettingsError, match='is empty; expected the frame whose z'):
        start(upper='')


@pytest.mark.usefixtures('without_tf2')
def test_what_is_wrong_with_an_imu_is_said(start):
    part, hub = start('imu')
    assert part.doubt() == ''
    hub.publishers = 2
    assert part.doubt() == 'imu has 2 publishers; their readings are mixed'
    hub.publishers, hub.incompatible = 1, {'imu': 'too little is offered'}
    assert part.doubt() == 'too little is offered'
    hub.incompatible, hub.types = {}, {'imu': ['geometry_msgs/msg/AccelStamped']}
    assert part.doubt() == 'imu carries geometry_msgs/AccelStamped, not sensor_msgs/Imu'
    hub.types = {}
    part.on_imu(b'nonsense')
    assert part.doubt() == '1 messages of the IMU could not be read, or hold no numbers'
    assert part.doubt() == ''
    by_turns = ['specific force of imu and no frame come by turns']
    for frame, said in (('imu', []), ('', []), ('imu', by_turns)):
        message = Imu()
        message.header.frame_id = frame
        part.on_imu(serialize_message(message))
        found = list(part.value_doubts(ForceFrame()))
        assert [why.removesuffix(', and are mixed') for why in found] == said


@pytest.mark.parametrize('simulated', [False, True])
def test_a_frozen_imu_is_said_but_one_without_noise_in_a_simulation_is_none(start, simulated):
    part, hub = start('imu')
    hub.values['use_sim_time'] = simulated
    for second in range(30):
        part.on_specific_force(START + second * SECOND, UP, None)
        list(part.timing_doubts(None, {'forces': 1, 'came': 1, 'missed': 0}, 1.0))
    assert [*part.value_doubts(ForceFrame())] == [FROZEN][simulated:]


def test_the_newest_sample_at_or_before_a_wrench_holds_or_else_the_nearest():
    forces = RecentForces(0.2)
    assert forces.at(0) is None
    for k in range(5):
        forces.add(START + 10 * k, (k, 0.0, 0.0))
    for at, number in ((20, 2), (21, 2), (19, 1), (SECOND // 5 + 40, 4), (-SECOND // 5, 0)):
        assert forces.at(START + at) == (number, 0.0, 0.0)
    for at in (SECOND // 5 + 41, -SECOND // 5 - 1):
        assert forces.at(START + at) is None, 'beyond the timeout'
    forces.add(START + 2 * SECOND, UP)
    assert forces.at(START + 40) is None, 'a clock that is ahead'


def test_a_late_sample_is_left_out_and_another_time_begins_anew():
    forces = RecentForces(0.2)
    forces.add(START, UP)
    forces.add(START - SECOND // 10, AWAY)
    assert forces.at(START) == forces.at(START - SECOND // 10) == UP
    forces.add(START - SECOND, AWAY)
    assert forces.at(START - SECOND) == AWAY
    assert forces.at(START) is None
