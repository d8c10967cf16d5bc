"""What the node says of itself; of faults that come in, see test_input_faults.py."""

import time

from moments import OK, SECOND, STALE, START, WARN
import numpy as np
import pytest
from rclpy.serialization import serialize_message

from wrist_ft_comp.node.raw_wrench import Counts, WrenchInput
from wrist_ft_comp.ros.topics import wrench_message
from wrist_ft_comp.stream.compensator import Compensator

LOAD = [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]


def test_statuses_are_published_named_after_the_node_and_the_frame(rig):
    node = rig()
    node.put(START, LOAD, frame='wrist_3_link')
    node.take()
    node.diagnosis('input', lambda status: status.values['frame'] == 'wrist_3_link')
    name = f'{node.namespace.lstrip("/")}/wrist_ft_comp'
    statuses = [status for status in node._report() if status.name.startswith(f'{name}:')]
    concerns = ('input', 'temperature', 'model', 'calibration', 'output', 'payload')
    assert [status.name for status in statuses] == [f'{name}: {c}' for c in concerns]
    assert {status.hardware_id for status in statuses} == {'wrist_3_link'}
    assert all(status.message for status in statuses)


def test_rates_and_ages_are_those_since_the_last_report(rig, monkeypatch):
    clock = [1000.0]
    monkeypatch.setattr('time.monotonic', lambda: clock[0])
    node = rig().node
    node.counts.wrenches = 1000
    node.counts.newest = START, LOAD, serialize_message(wrench_message(START, 'tool0', LOAD))
    node.wrench_input.poll()
    clock[0] += 2.0
    (status,) = node.wrench_input.statuses()
    assert (status.level, status.message) == (OK, '500 wrenches per second')
    assert (status.values['age_s'], status.values['frame']) == ('2.0', 'tool0')
    (status,) = node.wrench_input.statuses()
    assert status.level == STALE, 'none has come since'


@pytest.mark.parametrize(('kind', 'incompatible', 'words'), [
    ('geometry_msgs/msg/WrenchStamped', {}, 'the publisher of /wrench_raw sends nothing'),
    ('geometry_msgs/msg/Wrench', {},
     '/wrench_raw carries geometry_msgs/Wrench, not geometry_msgs/WrenchStamped'),
    ('geometry_msgs/msg/WrenchStamped', {'wrench_raw': 'a publisher offers less'},
     'a publisher offers less'),
])  # fmt: skip
def test_why_no_wrenches_arrive_is_said(fake_hub, kind, incompatible, words):
    part = WrenchInput(Counts(), Compensator(1))
    hub = fake_hub(part)
    hub.types, hub.incompatible = {'/wrench_raw': [kind]}, incompatible
    part.start()
    (status,) = part.statuses()
    assert status.level == STALE
    assert f'no raw wrenches arrive: {words}' in status.message


def test_temperatures_outside_the_calibrated_range_are_named(rig, make_model):
    model = make_model('m.yaml', range_c=(20.0, 30.0))
    node = rig(model=model, parameters={'temperature_timeout': 3600})
    node.warm_up(25.0)
    status = node.diagnosis('temperature')
    assert (status.level, status.message) == (OK, 'all thermometers report')
    assert status.values['thermometer_1_c'] == '25.00'
    assert node.diagnosis('output').values['force_z_drift_deviation'] == '0.1 N'
    node.warm_up(35.0, 8, first=3)
    status = node.diagnosis('temperature')
    assert status.level == WARN
    assert status.message.startswith(
        'thermometer 1 outside the calibrated range; the correction is extrapolated, and held '
        'further out; thermometer 1 '
    )
    # Three halves of a third beyond it: √3.25 times as much.
    assert node.diagnosis('output').values['force_z_drift_deviation'] == '0.1803 N'


def test_names_of_any_length_do_not_fill_the_diagnostics(rig):
    node = rig()
    node.refused_value('model_file', '/' + 'm' * 100_000)
    for frame in ('tool0', '', 'f' * 60_000):
        node.put(START, LOAD, frame=frame)
        assert node.take()[0].header.frame_id == frame
        assert node.diagnosis('input').values['frame'] == frame[:255]


@pytest.mark.parametrize('name', [b'a\0b\0', b'\xff\xfe\0', b'\0\0\0\0'])
def test_a_frame_that_is_no_text_does_not_end_the_node(rig, make_model, name):
    node = rig(model=make_model('m.yaml'))
    whole = serialize_message(wrench_message(START, 'abc', LOAD))
    node.put_bytes(whole[:16] + name.ljust(4, b'\0') + whole[20:])
    assert node.outputs.get()[:20] == whole[:16] + name.ljust(4, b'\0')
    node.warm_up(25.0, 4)
    assert node.diagnosis('input').values['received'] == '1'
    assert node.ask_output(START + 5 * SECOND, LOAD)[2] == pytest.approx(LOAD[2] - 10.0)


def test_the_figures_that_people_look_for_are_in_the_statuses(rig, make_model):
    node = rig(parameters={'temperature_timeout': 3600})
    status = node.diagnosis('model')
    assert status.level == WARN
    assert status.message == 'no model; record a warm-up and call ~/calibrate'
    model = make_model('m.yaml', {'force_z': (2.0, 0.001, 0.0)})
    assert node.set('model_file', str(model.path)).successful
    node.warm_up(30.0)
    node.ask_output(START + 3 * SECOND, LOAD)
    tare = np.array([1.0, 1.0, 3.0, 0.2, 0.2, 0.2])
    node.node.compensator.restore_tare(tare, np.zeros(6), tared=True)
    for name, words, values in (
        ('model', 'compensating 1 axis', {
            'axes': 'force_z', 'sha256': model.sha256, 'file': str(model.path),
            'thermometer_1_calibrated_c': '-50.0 to 150.0',
        }),
        ('output', '', {
            'force_z_drift': '20 N', 'force_z_sensitivity': '1 %', 'torque_x_tare': '0.2 N m',
            'tare': 'active', 'force_z_tare': '3 N',
        }),
    ):  # fmt: skip
        status = node.diagnosis(name, words)
        assert status.level == OK
        assert status.values.items() >= values.items()
    shown = node.diagnosis('temperature').values
    assert float(shown['rate_hz']) >= 0.0
    assert float(shown['thermometer_1_age_s']) < 60.0


def test_a_model_that_compensates_no_axis_is_a_warning(rig, make_model):
    node = rig(model=make_model('m.yaml', {}), parameters={'temperature_timeout': 3600})
    for second in range(65):  # after a minute it is judged whether they moved
        node.node.compensator.add_temperature(0, START + second * SECOND, 30.0 + second / 10)
    assert node.ask_output(START + 3 * SECOND, LOAD) == tuple(LOAD)
    for name, words in (
        ('model', 'the model compensates no axis, because nothing could be'),
        ('output', 'not compensated: the model compensates no axis'),
    ):
        assert node.diagnosis(name, words).level == WARN


@pytest.mark.parametrize(('before', 'left', 'level'), [(5, 3.8, WARN), (9, 3.8, OK), (1, 0.9, OK)])
def test_a_model_that_leaves_most_of_the_drift_is_a_warning(rig, make_model, before, left, level):
    # As of recordings of two sensors; the answer of ~/calibrate is gone after a restart.
    node = rig(model=make_model('m.yaml', {'force_z': (2.0, 0.0, 0.0)}))
    axis = node.node.live.stored.document['axes']['force_z']
    axis |= {'rms_before': before, 'rms_after': left}
    status = node.diagnosis('model')
    assert status.level == level
    assert (level == OK) == ('the model leaves 3.8 N (RMS) of' not in status.message)


def test_axes_that_no_recording_had_are_named_where_the_sensor_has_them(rig, make_model):
    node = rig(model=make_model('m.yaml', calibrated=('force_y', 'force_z')))
    node.warm_up(30.0)
    node.ask_output(START + 3 * SECOND, [1.0, 2.0, 3.0, 0.0, 0.0, np.nan])
    assert node.diagnosis('model', 'knows nothing of force_x, which drift').level == WARN
    output = node.diagnosis('output').values
    assert [f'force_{axis}_drift_deviation' in output for axis in 'xy'] == [False, True]


@pytest.mark.parametrize('stamped', [True, False])
def test_a_thermometer_on_another_clock_than_the_wrench_is_named(rig, monkeypatch, stamped):
    monkeypatch.setattr('wrist_ft_comp.stream.clock.APART_FOR_S', 0.0)
    node = rig(parameters={'temperature_timeout': 3600})
    for late_s, words in ((0, ''), (40, 'all drivers must use one clock')):
        now = time.time_ns()
        node.ask_output(now + (not stamped) * late_s * SECOND, LOAD)
        node.node.housekeep()
        if stamped:
            node.warm(now - late_s * SECOND, 25.0)
        else:
            node.node.inputs.take(0, None, 25.0)
        status = node.diagnosis('temperature', words)
        assert ('stamp' in status.message) == bool(words)
    assert f'stamps of {node.topic("temperature")} are 40.0 s behind those' in status.message
    assert status.level == WARN
