import inspect
import math

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='the node tests need ROS 2 (rclpy)')


from rclpy.serialization import serialize_message

from wrist_ft_comp.ros import compensator_node
from wrist_ft_comp.ros.messages import wrench_message

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
OK, WARN, ERROR, STALE = b'\0', b'\1', b'\2', b'\3'
LOAD = [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]


def numbers(status):
    return {each.key: each.value for each in status.values}


def test_one_status_per_concern_named_after_the_node(rig):
    node = rig()
    node.put(START, LOAD, frame='wrist_3_link')
    node.take()
    name = f'{node.namespace.lstrip("/")}/wrist_ft_comp'
    expected = [f'{name}: {c}' for c in ('input', 'temperature', 'model', 'calibration', 'output')]
    for _ in range(100):
        array = node.arrays.get(timeout=20.0)
        statuses = [each for each in array.status if each.name.startswith(f'{name}:')]
        if statuses and statuses[0].hardware_id:
            break
    assert [each.name for each in statuses] == expected
    assert {each.hardware_id for each in statuses} == {'wrist_3_link'}
    assert all(each.message for each in statuses)
    assert array.header.stamp.sec > 0


def test_diagnostics_come_once_a_second_unless_a_test_hurries_them():
    source = inspect.getsource(compensator_node)
    assert '_DIAGNOSTICS_PERIOD_S = 1.0' in source


def test_the_hardware_follows_the_frame(rig):
    node = rig()
    for frame in ('tool0', 'wrist_3_link', ''):
        node.put(START, LOAD, frame=frame)
        node.take()
        assert node.node.frame_id == frame


def test_input_is_stale_or_well_or_unusable(rig):
    node = rig()
    status = node.diagnosis('input')
    assert status.level == STALE
    topic = node.topic('wrench_raw')
    assert status.message == (
        f'no raw wrenches arrive, though {topic} has a publisher; is the sensor running?'
    )
    sent = iter(START + 1000 * np.arange(10_000))
    status = node.diagnosis(
        'input', lambda each: node.ask_output(int(next(sent)), LOAD) and each.level == OK
    )
    assert 'wrenches per second' in status.message
    assert int(numbers(status)['received']) > 0
    # Sent again and again, because a period's report is over soon.
    status = node.diagnosis(
        'input', lambda each: node.put(START, [math.nan] * 6) or each.level == WARN
    )
    assert status.message == 'all wrenches are unusable and dropped; check the driver'
    assert node.diagnosis('input', lambda each: each.level == STALE)


def test_a_thermometer_that_never_reported_is_named(rig):
    node = rig(thermometers=2)
    node.warm(START, 25.0)
    status = node.diagnosis('temperature', lambda each: '1, 2' not in each.message)
    assert status.level == WARN
    assert status.message == 'thermometer 2 has not reported; drift waits for it'
    assert numbers(status)['thermometer_2_age_s'] == 'never'


def test_a_silent_thermometer_is_named(rig):
    node = rig(parameters={'temperature_timeout': 0.1})
    node.warm(START, 25.0)
    status = node.diagnosis('temperature', lambda each: 'silent' in each.message)
    assert status.level == WARN
    assert status.message == 'thermometer 1 silent for more than 0.1 s; drift is held'


def test_temperatures_outside_the_calibrated_range_are_named(rig, make_model):
    model = make_model('m.yaml', range_c=(20.0, 30.0))
    node = rig(parameters={'model_file': str(model.path), 'temperature_timeout': 3600})
    for second in range(3):
        node.warm(START + second * SECOND, 25.0)
    status = node.diagnosis('temperature', lambda each: 'thermometer_1_c' in numbers(each))
    assert (status.level, status.message) == (OK, 'all thermometers report')
    assert numbers(status)['thermometer_1_c'] == '25.00'
    assert numbers(node.diagnosis('output'))['force_z_drift_deviation'] == '0.1 N'
    for second in range(3, 6):
        node.warm(START + second * SECOND, 35.0)
    status = node.diagnosis('temperature', lambda each: each.level == WARN)
    assert status.message == (
        'thermometer 1 outside the calibrated range; drift is less certain there, and held '
        'further out'
    )
    # 5 K beyond the range, at 2 N/K.
    assert numbers(node.diagnosis('output'))['force_z_drift_deviation'] == '10 N'


def test_stamps_of_two_clocks_are_told(rig):
    node = rig()
    node.ask_output(50 * SECOND, LOAD)
    node.warm(START, 25.0)
    status = node.diagnosis(
        'temperature', lambda each: each.level == WARN and 'apart' in each.message
    )
    assert 'both drivers must use one clock' in status.message


def test_stamps_that_stand_still_are_told(rig):
    node = rig(parameters={'temperature_timeout': 3600})
    status = node.diagnosis(
        'temperature', lambda each: node.warm(START, 25.0) or 'stamps' in each.message
    )
    assert status.level == WARN
    assert status.message == 'temperatures are dropped: their stamps do not increase'
    assert int(numbers(status)['rejected']) > 0


def test_the_model_and_what_it_does_are_told(rig, make_model):
    node = rig()
    status = node.diagnosis('model')
    assert status.level == WARN
    assert status.message == 'no model; record a warm-up and call ~/calibrate'
    assert node.diagnosis('output').level == WARN
    model = make_model('m.yaml', {'force_z': (2.0, 0.001, 0.0)})
    assert node.set('model_file', str(model.path)).successful
    for second in range(3):
        node.warm(START + second * SECOND, 30.0)
    status = node.diagnosis('model', lambda each: each.level == OK)
    assert status.message == 'compensating 1 axis'
    assert numbers(status)['axes'] == 'force_z'
    assert numbers(status)['sha256'] == model.sha256
    status = node.diagnosis('output', lambda each: each.level == OK)
    shown = numbers(status)
    assert shown['force_z_drift'] == '20 N'
    assert shown['force_z_sensitivity'] == '1 %'
    assert shown['torque_x_tare'] == '0 N m'


def test_recordings_and_refusals_are_told(rig):
    node = rig()
    assert node.diagnosis('calibration').message == 'idle'
    assert node.call('record', True).success
    status = node.diagnosis('calibration', lambda each: each.message == 'recording')
    assert numbers(status)['recording'] == str(node.node.recording.current.path)
    assert node.call('record', False).success
    answer = node.call('calibrate')
    assert not answer.success
    status = node.diagnosis('calibration', lambda each: each.level == WARN)
    assert numbers(status)['last'] == answer.message


def test_names_of_any_length_do_not_fill_the_diagnostics(rig):
    node = rig()
    assert not node.set('model_file', '/' + 'm' * 100_000).successful
    status = node.diagnosis('calibration')
    refusal = numbers(status)['last_refusal']
    assert refusal.startswith('set_parameters: model_file set at run time must lie inside')
    assert len(refusal) == 1000
    node.put(START, LOAD, frame='f' * 60_000)
    (message,) = node.take()
    assert message.header.frame_id == 'f' * 60_000
    status = node.diagnosis('input', lambda each: each.hardware_id)
    assert status.hardware_id == numbers(status)['frame'] == 'f' * 255


@pytest.mark.parametrize('name', [b'a\0b\0', b'\xff\xfe\0', b'\xed\xa0\x80\0', b'\0\0\0\0'])
def test_a_frame_that_is_no_text_does_not_end_the_node(rig, make_model, name):
    node = rig(parameters={'model_file': str(make_model('m.yaml').path)})
    whole = serialize_message(wrench_message(START, 'abc', LOAD))
    node.put_bytes(whole[:16] + name.ljust(4, b'\0') + whole[20:])
    node.bench.wait_until(lambda: node.node.health.counts.published == 1, 'the output')
    node.outputs.queue.clear()
    for second in range(4):
        node.warm(START + second * SECOND, 25.0)
    assert node.diagnosis('input', lambda each: int(numbers(each)['received']) == 1)
    assert node.ask_output(START + 5 * SECOND, LOAD)[2] == pytest.approx(LOAD[2] - 10.0)


def test_what_people_look_for_is_there(rig, make_model):
    """Rates, ages, counts, drift and its error, model and hash, tare, the last refusal."""
    model = make_model('m.yaml', {'force_z': (2.0, 0.0, 0.0)})
    node = rig(parameters={'model_file': str(model.path), 'temperature_timeout': 3600})
    for second in range(3):
        node.warm(START + second * SECOND, 30.0)
    node.ask_output(START + 3 * SECOND, LOAD)
    assert not node.call('rollback').success
    assert not node.set('model_file', '/etc/passwd').successful
    node.node.compensator.restore_tare(np.array([0, 0, 3.0, 0, 0, 0]))
    shown = numbers(node.diagnosis('input', lambda each: numbers(each)['age_s'] != 'never'))
    assert float(shown['age_s']) < 60.0
    assert shown['received'] == '1'
    assert shown['frame'] == 'tool0'
    shown = numbers(node.diagnosis('temperature'))
    assert float(shown['thermometer_1_age_s']) < 60.0
    assert float(shown['rate_hz']) >= 0.0
    shown = numbers(node.diagnosis('model'))
    assert (shown['sha256'], shown['file']) == (model.sha256, str(model.path))
    assert shown['thermometer_1_calibrated_c'] == '-50.0 to 150.0'
    shown = numbers(node.diagnosis('output'))
    assert (shown['tare'], shown['force_z_tare']) == ('active', '3 N')
    assert shown['force_z_drift'] == '20 N'
    assert shown['force_z_drift_deviation'] == '0.1 N'
    shown = numbers(node.diagnosis('calibration'))
    assert shown['last_refusal'].startswith('set_parameters: model_file set at run time must lie')
