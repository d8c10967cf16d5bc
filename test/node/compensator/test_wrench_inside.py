"""Raw wrenches inside messages of other types, over DDS."""

from geometry_msgs.msg import Vector3, Wrench
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import MultiDOFJointState
from std_msgs.msg import Float64MultiArray

from wrist_ft_comp.errors import SettingsError

SECOND = 1_000_000_000
START_S = 1_700_000_000
SIX = (1.0, 2.0, 3.0, 0.1, 0.2, 0.3)


def wrench(values=SIX):
    return Wrench(force=Vector3(x=values[0], y=values[1], z=values[2]),
                  torque=Vector3(x=values[3], y=values[4], z=values[5]))  # fmt: skip


def joints(second, frame='flange'):
    message = MultiDOFJointState(wrench=[wrench((0.0,) * 6), wrench()])
    message.header.stamp.sec, message.header.frame_id = START_S + second, frame
    return message


def made(wired, entry, **parameters):
    return wired(parameters={'wrench_topic': entry, **parameters})


@pytest.mark.parametrize('executor', ['default', 'events'])
def test_a_wrench_inside_a_message_is_compensated_as_one_of_its_own(wired, make_model, executor):
    model = make_model('m.yaml', {'force_z': (2.0, 0.0, 0.0)})
    chosen = {'wrench_topic': 'joints:wrench[1]'}
    node = wired(model=model, parameters=chosen, executor=executor)
    node.warm_up(23.0)
    state = node.bench.publisher(MultiDOFJointState, node.topic('joints'))
    state.publish(joints(2))
    (out,) = node.take()
    assert (out.header.stamp.sec, out.header.frame_id) == (START_S + 2, 'flange')
    assert out.wrench.force.z == pytest.approx(3.0 - 6.0)
    assert out.wrench.torque == wrench().torque
    status = node.diagnosis('input', 'per second')
    assert status.values['frame'] == 'flange'
    assert node.node.sensor()['wrench_topic'] == [f'{node.topic("joints")}:wrench[1]']


def test_six_numbers_of_an_array_come_with_their_time_of_arrival(wired):
    node = made(wired, 'state:data[2..7]')
    state = node.bench.publisher(Float64MultiArray, node.topic('state'))
    before = node.node.get_clock().now().nanoseconds
    state.publish(Float64MultiArray(data=[9.0, 9.0, *SIX]))
    (out,) = node.take()
    assert (out.wrench, out.header.frame_id) == (wrench(), '')
    assert before < out.header.stamp.sec * SECOND + out.header.stamp.nanosec


def test_a_message_without_the_wrench_is_a_warning_until_one_has_it(wired):
    node = made(wired, 'joints:wrench[1]')
    state = node.bench.publisher(MultiDOFJointState, node.topic('joints'))
    state.publish(MultiDOFJointState(wrench=[wrench()]))
    said = node.diagnosis('input', 'is not there').message
    assert 'all wrenches are unusable' in said
    assert said.endswith('The message holds wrench[0]')
    state.publish(serialize_message(joints(1))[:60])
    node.diagnosis('input', lambda status: status.values['dropped_malformed'] == '2')
    state.publish(joints(3))
    assert node.take()[0].wrench == wrench()


@pytest.mark.parametrize(
    ('entry', 'words'),
    [
        ('state:data[0..4]', 'names 5 numbers; expected six'),
        ('state:', 'cannot be understood'),
        ('a b:wrench', 'does not begin with the name of a topic'),
        ('wrench:wrench', 'the node would hear itself'),
    ],
)
def test_a_wrong_entry_is_refused(rig, entry, words):
    with pytest.raises(SettingsError, match=words):
        rig(parameters={'wrench_topic': entry})
