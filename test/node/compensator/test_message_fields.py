"""Temperatures that are fields of other messages, over DDS."""

from importlib import import_module
import itertools
from pathlib import Path
import shutil
import sys

from geometry_msgs.msg import Wrench, WrenchStamped
import pytest
from rclpy.qos import QoSProfile, QoSReliabilityPolicy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import BatteryState, FluidPressure, JointState, Temperature
from std_msgs.msg import Float64MultiArray, Header
from stereo_msgs.msg import DisparityImage

from wrist_ft_comp.errors import SettingsError

SECOND = 1_000_000_000
START_S = 1_700_000_000
START = START_S * SECOND
LOAD = (1.0, 2.0, 3.0, 0.1, 0.2, 0.3)
BEST_EFFORT = QoSProfile(depth=5, reliability=QoSReliabilityPolicy.BEST_EFFORT)


def header(second):
    result = Header()
    result.stamp.sec = START_S + second
    return result


def battery(second, celsius):
    return BatteryState(header=header(second), temperature=float(celsius))


def joints(second, *efforts):
    return JointState(header=header(second), effort=[float(effort) for effort in efforts])


def send(node, publisher, *messages):
    """Publish messages, each until the node has read it, or could not: best effort may lose it."""
    inputs = node.node.inputs
    for message in messages:
        before, bad, looks = readings_handled(node), inputs.unreadable, itertools.count()
        at = message.header.stamp.sec * SECOND if hasattr(message, 'header') else None

        def arrived(message=message, before=before, bad=bad, looks=looks, at=at):
            if next(looks) % 300 == 0:
                publisher.publish(message)
            # What was sent twice may come while the next one is waited for.
            mine = at in {None, inputs._stamp_ns} or inputs.unreadable > bad
            return mine and readings_handled(node) > before

        node.wait_until(arrived, 'the temperature')


def readings_handled(node):
    """Temperatures that the node took, dropped, or could not read."""
    inputs = node.node.inputs
    return inputs.usable + inputs.unusable + inputs.unreadable


def publisher(node, kind, name, qos=1000):
    return node.bench.publisher(kind, node.topic(name), qos)


def held_c(node):
    """Temperatures of the last cell, °C."""
    held = node.node.compensator.tracker.temperature_c
    return None if held is None else held.tolist()


def wait_until_well(node, celsius):
    """Wait until nothing is wrong with the thermometers, and the first reads so."""
    node.diagnosis(
        'temperature',
        lambda status: (status.level, status.values.get('thermometer_1_c')) == (b'\0', celsius),
    )


def wrenches_pass(node):
    """Tell whether wrenches pass."""
    return (node.stream([START + k for k in range(20)], [LOAD] * 20) == LOAD).all()


@pytest.mark.parametrize('executor', ['default', 'events'])
def test_a_field_moves_the_drift_as_a_temperature_does(wired, make_model, executor):
    model = make_model('m.yaml', {'force_z': (2.0, 0.0, 0.0)})
    node = wired(topics=['state:temperature'], model=model, executor=executor)
    state = publisher(node, BatteryState, 'state', BEST_EFFORT)
    send(node, state, *(battery(second, 23.0) for second in range(4)))
    assert node.ask_output(START + 9 * SECOND, [0.0] * 6)[2] == pytest.approx(-6.0)
    wait_until_well(node, '23.00')


def test_without_a_header_the_time_of_arrival_counts_and_hides_no_doubt(wired, make_model):
    model = make_model('m.yaml', {'force_z': (2.0, 0.0, 0.0)}, thermometers=2, range_c=(15, 65))
    node = wired(topics=['heat:data[1]', 'heat:data[0]*0.1:K'], model=model)
    heat = publisher(node, Float64MultiArray, 'heat')
    before = node.node.get_clock().now().nanoseconds
    message = Float64MultiArray(data=[3001.5, 22.0])
    while held_c(node) is None:
        send(node, heat, message)
    assert held_c(node) == pytest.approx([22.0, 27.0])
    assert before < node.node.compensator.tracker.end_ns
    assert node.node.compensator.tracker.clocks.rejected == 0
    status = node.diagnosis('temperature', 'all thermometers report')
    assert status.values['thermometer_2_time'].startswith('of arrival')
    message.data[1] = 95.0
    while held_c(node)[0] < 90.0:
        send(node, heat, message)
    said = node.diagnosis('temperature', 'outside the calibrated range').message
    assert '; thermometer 1 jumped by' in said, 'the worst first, and all of them'


def test_thermometers_in_one_message_share_a_subscription(wired):
    node = wired(topics=['joints:effort[2]', 'joints:effort[0]', 'temperature'])
    state = publisher(node, JointState, 'joints')
    send(node, state, *(joints(second, 21.0, 22.0, 23.0) for second in range(3)))
    assert node.node.count_subscribers(node.topic('joints')) == 1
    for second in range(3):
        node.put_temperature_bytes(
            0, serialize_message(Temperature(header=header(second), temperature=30.0))
        )
    node.wait_until(lambda: held_c(node) is not None, 'a cell of all')
    assert held_c(node) == [23.0, 21.0, 30.0]


def test_a_topic_at_a_kilohertz_is_read_ten_times_a_second(wired):
    node = wired(topics=['state:temperature'], executor='events')
    state = publisher(node, BatteryState, 'state', BEST_EFFORT)
    send(node, state, battery(0, 20.0))
    assert node.topic('state') not in [s.topic_name for s in node.node.subscriptions]
    message = battery(0, 20.0)
    for second in range(1, 5):
        message.header.stamp.sec = START_S + second
        message.temperature = 20.0 + 0.1 * second
        for millisecond in range(1000):
            message.header.stamp.nanosec = millisecond * 1_000_000
            state.publish(message)
        assert wrenches_pass(node)
    before = readings_handled(node)
    assert before < 1000, 'of 4001'
    send(node, state, battery(5, 20.5), battery(6, 20.6))
    assert held_c(node) == [20.5]


@pytest.mark.parametrize(
    ('efforts', 'words'),
    [
        ([20.0, 21.0], 'expected an index from 0 to 1. Its numbers are effort[1], effort[0]'),
        ([], 'is an array of 0. The message holds no number at all'),
    ],
)
def test_a_number_that_is_not_there_is_a_warning_until_it_comes(wired, efforts, words):
    node = wired(topics=['joints:effort[2]'])
    state = publisher(node, JointState, 'joints')
    send(node, state, joints(0, *efforts))
    said = node.diagnosis('temperature', words).message
    assert said.startswith('thermometer 1: ')
    assert said.endswith('; drift waits for it')
    assert wrenches_pass(node)
    bad = node.node.inputs.unreadable
    assert node.diagnosis('temperature').values['unusable'] == str(bad)
    while held_c(node) is None:
        second = readings_handled(node)
        send(node, state, joints(second, 20.0, 21.0, 22.0))
    assert held_c(node) == [22.0]
    wait_until_well(node, '22.00')


def test_a_type_that_is_not_installed_is_a_warning(wired, monkeypatch):
    node = wired(topics=['image:image.height'])
    monkeypatch.setitem(sys.modules, 'stereo_msgs.msg', None)  # which makes imports fail
    stereo = node.bench.helper.create_publisher(DisparityImage, node.topic('image'), 10)
    said = node.diagnosis('temperature', 'not installed').message
    topic = node.topic('image')
    assert said.startswith(
        f'thermometer 1: {topic} carries stereo_msgs/DisparityImage, but the Python package '
        'stereo_msgs with this type is not installed here, or not sourced, or '
    )
    assert 'apt install ros-$ROS_DISTRO-stereo-msgs' in said
    assert wrenches_pass(node)
    monkeypatch.undo()
    node.wait_until(lambda: stereo.get_subscription_count() > 0, 'the subscription')


@pytest.fixture
def unloadable(tmp_path, monkeypatch):
    """Let stereo_msgs be there without its libraries; gives the class of a message."""
    source = Path(sys.modules['stereo_msgs'].__file__).parent
    shutil.copytree(source, tmp_path / 'stereo_msgs', ignore=shutil.ignore_patterns('*.so'))
    monkeypatch.syspath_prepend(tmp_path)
    for name in [name for name in sys.modules if name.split('.')[0] == 'stereo_msgs']:
        monkeypatch.delitem(sys.modules, name)
    return import_module('stereo_msgs.msg').DisparityImage


@pytest.mark.usefixtures('unloadable')
def test_a_package_whose_library_cannot_be_loaded_is_a_warning(rig, driver):
    node = rig(topics=['image:image.height'])
    driver().helper.create_publisher(DisparityImage, node.topic('image'), 10)
    said = node.diagnosis('temperature', 'stereo_msgs').message
    assert 'its libraries cannot be loaded (Could not import' in said


def test_a_wrong_entry_of_one_sensor_leaves_the_right_one_of_another(rig, wired, driver, tmp_path):
    """In one process DDS knows a topic by one type."""
    wrong = rig(topics=['/heat'])
    right = wired(topics=['/heat:temperature'], directory=tmp_path / 'right')
    heat = driver().helper.create_publisher(BatteryState, '/heat', BEST_EFFORT)
    wrong.diagnosis('temperature', 'not sensor_msgs/Temperature')
    send(right, heat, *(battery(second, 22.0) for second in range(3)))
    assert held_c(right) == [22.0]


def test_a_publisher_may_come_late_die_and_come_back_as_another_type(wired, driver):
    node = wired(
        topics=['state:temperature'], parameters={'temperature_timeout': 0.1}, executor='events'
    )
    late = f'thermometer 1: {node.topic("state")} has no publisher (is the driver running'
    assert node.diagnosis('temperature', 'no publisher').message.startswith(late)
    topic = node.topic('state')
    first = driver()
    heat = first.publisher(Temperature, topic)
    send(node, heat, *(Temperature(header=header(s), temperature=21.0) for s in range(3)))
    assert held_c(node) == [21.0]
    first.close()
    said = node.diagnosis('temperature', 'silent').message
    assert said == 'thermometer 1 silent for more than 0.1 s; drift is held'
    assert wrenches_pass(node)
    second = driver()
    state = second.publisher(BatteryState, topic)
    send(node, state, *(battery(s, 22.0) for s in range(3, 6)))
    assert held_c(node) == [22.0]
    second.close()
    send(node, driver().publisher(FluidPressure, topic), FluidPressure(header=header(7)))
    words = 'no temperature. Its numbers are fluid_pressure, variance'
    assert words in node.diagnosis('temperature', words).message


def test_bytes_that_are_no_message_of_the_type_are_a_warning(wired):
    node = wired(topics=['joints:effort[0]'])
    state = publisher(node, JointState, 'joints')
    good = serialize_message(joints(0, 20.0))
    send(node, state, joints(0, 20.0))  # so that both ends know each other
    state.publish(good[:20])
    said = node.diagnosis('temperature', "can't be read as sensor_msgs/JointState").message
    assert 'is the package here of the same version as where it comes from?' in said
    assert wrenches_pass(node)
    send(node, state, *(joints(second, 20.0) for second in range(1, 4)))
    assert held_c(node) == [20.0]
    wait_until_well(node, '20.00')


@pytest.mark.parametrize(
    ('kind', 'written'),
    [
        (BatteryState, 'write {0}:temperature to take a number in it'),
        (FluidPressure, 'write {0}:fluid_pressure or {0}:variance to take a number in it'),
        (JointState, 'write {0}:FIELD to take a number in it'),
    ],
)
def test_a_plain_topic_of_another_type_says_what_to_write(rig, driver, kind, written):
    node = rig(topics=['state'])
    topic = node.topic('state')
    other = driver()
    other.helper.create_publisher(kind, topic, 10)
    said = node.diagnosis('temperature', 'not sensor_msgs/Temperature').message
    assert said == (
        f'thermometer 1: {topic} carries sensor_msgs/{kind.__name__}, not '
        f'sensor_msgs/Temperature; {written.format(topic)}; drift waits for it'
    )
    other.close()
    driver().helper.create_publisher(Temperature, topic, 10)
    node.diagnosis('temperature', 'has not reported')


def test_wrenches_of_another_type_are_a_warning(rig, driver):
    node = rig()
    topic = node.topic('wrench_raw')
    other = driver()
    other.helper.create_publisher(Wrench, topic, 10)
    said = f'{topic} carries geometry_msgs/Wrench, not geometry_msgs/WrenchStamped'
    node.diagnosis('input', f'no raw wrenches arrive: {said}')
    other.close()
    driver().helper.create_publisher(WrenchStamped, topic, 10)
    node.diagnosis('input', f'{topic} has a publisher that sends none')


def test_a_misspelt_topic_is_named_and_the_one_that_is_probably_meant(rig, driver):
    node, other = rig(topics=['heat', 'state:data[0]']), driver()
    there = {'wrench_row': WrenchStamped, 'temperature': Temperature, 'stat': JointState}
    for name, kind in there.items():
        other.helper.create_publisher(kind, node.topic(name), 10)
    meant = f'or is {node.topic("wrench_row")}, a geometry_msgs/WrenchStamped, meant?)'
    said = node.diagnosis('input', meant).message
    silent = f'{node.topic("wrench_raw")} has no publisher (is the driver running, '
    assert said == f'no raw wrenches arrive: {silent}{meant}'
    said = node.diagnosis('temperature', f'or is {node.topic("stat")} meant?').message
    assert f'1 has not reported: {node.topic("heat")} has no publisher' in said
    assert f'or is {node.topic("temperature")}, a sensor_msgs/Temperature, meant?)' in said


def test_the_same_temperature_twice_is_refused(rig):
    with pytest.raises(SettingsError, match='are one and the same'):
        rig(namespace='/t', topics=['state', '/t/state:temperature'])
