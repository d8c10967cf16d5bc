import math

import numpy as np
import pytest

from wrist_ft_comp.recordings.read import read_recording

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND


def start_recording(rig):
    answer = rig.call('record', True)
    assert answer.success, answer.message
    (path,) = (rig.directory / 'recordings').glob('*.csv')
    assert str(path) in answer.message
    return path


def feed(rig, cells, *, first=0, per_cell=4, celsius=(25.0,)):
    """Send cells of wrenches that count up, and temperatures; return the wrenches, per cell."""
    sent = []
    for cell in range(first, first + cells):
        stamps = START + cell * SECOND + np.arange(per_cell) * (SECOND // per_cell)
        wrenches = np.arange(per_cell)[:, np.newaxis] + np.full(6, 10.0 * cell)
        rig.stream(stamps, wrenches)
        rig.warm(START + cell * SECOND + SECOND // 2, *(value + cell for value in celsius))
        sent.append(wrenches)
    return sent


def test_rows_are_the_means_per_cell(rig):
    node = rig(thermometers=2)
    path = start_recording(node)
    for k in range(8):
        node.send_reference(START + k * SECOND, [float(k)] * 6)
        node.send_reference(START + k * SECOND + 5, [k + 1.0] * 6)
    sent = feed(node, 8, celsius=(20.0, 40.0))
    answer = node.call('record', False)
    assert answer.success
    assert answer.message == f'recorded 7 thermal cells (7 s) into {path}'
    table = np.genfromtxt(path, delimiter=',', names=True)
    assert table['stamp_ns'].tolist() == [START + k * SECOND + SECOND // 2 for k in range(7)]
    np.testing.assert_allclose(table['force_x'], [wrenches.mean() for wrenches in sent[:7]])
    np.testing.assert_allclose(table['torque_z'], [wrenches.mean() for wrenches in sent[:7]])
    np.testing.assert_allclose(table['reference_force_y'], np.arange(7) + 0.5)
    np.testing.assert_allclose(table['temperature_c'], 20.0 + np.arange(7))
    np.testing.assert_allclose(table['temperature_2_c'], 40.0 + np.arange(7))


def test_a_recording_is_readable_while_it_runs(rig):
    node = rig()
    path = start_recording(node)
    feed(node, 5)
    assert node.node.recording.current.rows == 4
    recording = read_recording(path)
    np.testing.assert_allclose(recording.temperature_c[:, 0], 25.0 + np.arange(4))
    np.testing.assert_allclose(recording.wrench[:, 2], 1.5 + 10 * np.arange(4))
    assert np.isnan(recording.reference).all()
    assert recording.warnings == ()
    node.bench.close()
    assert node.node.recording.current is None, 'it ends with the node'
    assert len(read_recording(path)) == 4


def test_beside_a_live_model_raw_wrenches_are_recorded(rig, make_model):
    node = rig(model=make_model('m.yaml', {'force_z': (2.0, 0.0, 0.0)}))
    path = start_recording(node)
    feed(node, 5)
    assert node.node.compensator.compensation.zero[2] > 5.0
    np.testing.assert_allclose(read_recording(path).wrench[:, 2], 1.5 + 10 * np.arange(4))


def test_starting_twice_and_ending_twice_are_refused(rig):
    node = rig()
    assert node.refusal('record', False) == 'No recording runs. Start one with data: true.'
    path = start_recording(node)
    assert f'A recording runs already, into {path}' in node.refusal('record', True)
    assert node.call('record', False).message == f'recorded 0 thermal cells (0 s) into {path}'
    node.refusal('record', False)


def test_a_reference_is_listened_to_while_recording_and_unusable_ones_are_left_out(rig):
    node = rig()
    topic = node.topic('wrench_reference')
    assert node.node.count_subscribers(topic) == 0
    path = start_recording(node)
    node.wait_until(lambda: node.node.count_subscribers(topic) == 1, 'the subscription')
    node.send_reference(START, [math.nan] * 6)
    node.send_reference(START, [1e10, -1e10, 0, 0, 0, 0])
    node.send_reference(START + 1, [3.0] * 6)
    assert node.node.counts.bad_references == 2
    feed(node, 2)
    node.call('record', False)
    node.wait_until(lambda: node.node.count_subscribers(topic) == 0, 'its end')
    assert read_recording(path).reference[0].tolist() == [3.0] * 6


def test_a_model_of_another_period_ends_the_recording(rig, make_model):
    model = make_model('slow.yaml', period_s=10.0)
    node = rig()
    path = start_recording(node)
    feed(node, 4)
    assert node.set('model_file', str(model.path)).successful
    assert 'the new model has thermal cells of 10 s' in node.refusal('record', False)
    assert len(read_recording(path)) == 3
    assert node.call('record', True).success


def test_a_recording_that_cannot_hear_its_reference_does_not_begin(rig):
    override = 'qos_overrides./deaf/wrench_reference.subscription.reliability'
    node = rig(namespace='/deaf', parameters={override: 'bestest'})
    assert 'bestest' in node.refusal('record', True)
    assert not (node.directory / 'recordings').exists()
    assert node.diagnosis('calibration').message == 'idle'
    node.refusal('record', False)


def test_wrenches_that_come_late_are_recorded_also_after_stamps_ran_back(rig):
    node = rig()
    path = start_recording(node)
    feed(node, 6, first=100)
    for cell in range(20):
        node.warm(START + cell * SECOND + SECOND // 2, 25.0)
        if cell >= 2:
            node.stream([START + (cell - 2) * SECOND], [[float(cell - 2)] * 6])
    assert node.call('record', False).success
    table = np.genfromtxt(path, delimiter=',', names=True)
    cells = (table['stamp_ns'] - START) // SECOND
    np.testing.assert_allclose(table['force_x'][cells < 17], np.arange(17.0))


@pytest.mark.parametrize('ahead_s', [3600, -3600])
def test_a_reference_of_another_clock_neither_doubles_nor_disorders_cells(rig, ahead_s):
    node = rig()
    path = start_recording(node)
    for second in range(1500):
        stamp = START + second * SECOND
        node.send_reference(stamp + ahead_s * SECOND, [3.0] * 6)
        node.put(stamp, [float(second)] * 6)
        node.node.recorder.poll()
        node.put_temperature(stamp, 25.0)
    assert 'recorded 1499 thermal cells (1499 s)' in node.call('record', False).message
    table = np.genfromtxt(path, delimiter=',', names=True)
    np.testing.assert_array_equal(table['force_x'], np.arange(1499.0))
    assert np.isnan(table['reference_force_x']).all()


@pytest.mark.parametrize('more', [0, 5], ids=['at the end', 'at a row'])
def test_a_recording_whose_file_is_deleted_ends_with_a_sentence(rig, more):
    node = rig()
    path = start_recording(node)
    feed(node, 5)
    path.unlink()
    feed(node, more, first=5)
    sentence = node.refusal('record', False)
    assert f'{path} cannot be written: it was deleted in the meantime.' in sentence
    assert 'The recording has ended after 4 thermal cells.' in sentence
    assert sentence.endswith(
        ' See that its file stays and the disk has room, or choose another data_directory, then '
        'record again.'
    )
    assert start_recording(node).exists()
    feed(node, 3, first=20)
    assert 'recorded 3 thermal cells' in node.call('record', False).message


@pytest.mark.parametrize('kind', ['force', 'reference'])
@pytest.mark.parametrize(
    ('off_s', 'said'),
    [
        (None, 'stays away'),
        (3600, '3600 s apart: two clocks'),
        (-3600, '3600 s apart: two clocks'),
        (600, '600 s apart: two clocks'),
    ],
)
def test_cells_without_what_was_there_before_are_a_warning(rig, kind, off_s, said):
    node = rig(parameters={'gravity.source': 'imu'})
    start_recording(node)
    status, words = 'payload', f'{said}; cells are recorded without it'
    if kind == 'reference':
        status, words = 'calibration', 'recorded without wrench_reference: it is silent, or its '

    def go_on(first, cells, off_s):
        for second in range(first, first + cells):
            stamp = START + second * SECOND
            node.put(stamp, [1.0] * 6)
            if off_s is not None and kind == 'force':
                at = stamp + off_s * SECOND
                node.node.tell('on_force', at, (0.0, 0.0, 9.8 + second * 1e-3), None)
            elif off_s is not None:
                node.send_reference(stamp + off_s * SECOND, [1.0] * 6)
            node.put_temperature(stamp, 25.0)

    go_on(0, 100, 0)
    assert node.diagnosis(status).level == b'\0'
    go_on(100, 130, off_s)
    found = node.diagnosis(status)
    assert (found.level, words in found.message) == (b'\1', True), found.message
    go_on(230, 5, 0)
    assert node.diagnosis(status).level == b'\0'


@pytest.mark.parametrize('source', ['tf', 'imu'])
def test_a_robot_at_rest_by_tf_and_an_imu_in_g_are_no_warning_while_recording(rig, source):
    node = rig(parameters={'gravity.source': 'imu'})
    # Of the package that is missing here, the node needs nothing for what is asked of it.
    node.node.external._files.source = source
    start_recording(node)
    for second in range(10):
        feed(node, 1, first=second)
        force = 9.807 if source == 'tf' else 1.0 + second * 1e-3
        node.node.tell('on_force', START + second * SECOND, (0.0, 0.0, force), None)
        assert node.diagnosis('payload').level == b'\0'


def test_a_recording_that_hears_no_specific_force_is_a_warning(rig):
    node = rig(parameters={'gravity.source': 'imu'})
    feed(node, 2)
    assert node.diagnosis('payload').level == b'\0'
    start_recording(node)
    feed(node, 3, first=2)
    words = 'no specific force has come'
    assert node.diagnosis('payload', words).level == b'\1'
    assert node.call('record', False).success
