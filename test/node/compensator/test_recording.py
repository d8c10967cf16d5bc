"""The node's own recordings: rows, refusals, and what is said of cells that lack something."""

import math
import shutil
from types import SimpleNamespace

from moments import SECOND, START
import numpy as np
import pytest

from wrist_ft_comp.recordings.read import read_recording


def start_recording(rig):
    answer = rig.call('record', True)
    assert answer.success, answer.message
    (path,) = (rig.directory / 'recordings').glob('*.csv')
    assert str(path) in answer.message
    return path


def feed(rig, cells, *, first=0, celsius=(25.0,)):
    """Send cells of four wrenches that count up, and temperatures; return the wrenches by cell."""
    sent = []
    for cell in range(first, first + cells):
        wrenches = np.arange(4)[:, np.newaxis] + np.full(6, 10.0 * cell)
        rig.stream(START + cell * SECOND + np.arange(4) * (SECOND // 4), wrenches)
        rig.warm(START + cell * SECOND + SECOND // 2, *(value + 0.1 * cell for value in celsius))
        sent.append(wrenches)
    return sent


def test_rows_are_the_means_per_cell(rig):
    node = rig(thermometers=2, parameters={'gravity.source': 'imu'})
    path = start_recording(node)
    for k in range(8):
        node.send_reference(START + k * SECOND, [float(k)] * 6)
        node.send_reference(START + k * SECOND + 5, [k + 1.0] * 6)
        for speed in (0.3, 0.4):
            node.node.broadcast(FORCE, START + k * SECOND, (3.0, k + 10 * speed, 9.0), speed)
    sent = feed(node, 8, celsius=(20.0, 40.0))
    answer = node.call('record', False)
    assert answer.success
    assert answer.message == f'recorded 7 thermal cells (7 s) into {path}'
    table = np.genfromtxt(path, delimiter=',', names=True)
    assert table['stamp_ns'].tolist() == [START + k * SECOND + SECOND // 2 for k in range(7)]
    np.testing.assert_allclose(table['force_x'], [wrenches.mean() for wrenches in sent[:7]])
    np.testing.assert_allclose(table['torque_z'], [wrenches.mean() for wrenches in sent[:7]])
    np.testing.assert_allclose(table['reference_force_y'], np.arange(7) + 0.5)
    np.testing.assert_allclose(table['linear_acceleration_y'], np.arange(7) + 3.5)
    np.testing.assert_allclose(table['rotation_speed'], np.sqrt(0.125))
    np.testing.assert_allclose(table['temperature_c'], 20.0 + 0.1 * np.arange(7))
    np.testing.assert_allclose(table['temperature_2_c'], 40.0 + 0.1 * np.arange(7))


def test_a_recording_is_readable_while_it_runs_and_ends_with_the_node(rig):
    node = rig()
    path = start_recording(node)
    feed(node, 5)
    assert len(read_recording(path)) == 4
    node.bench.close()
    assert node.node.recorder.current is None
    assert len(read_recording(path)) == 4


@pytest.mark.parametrize(('wrenches', 'temperatures', 'gravity', 'words'), [
    (30, 30, 'none', ''), (28, 30, 'none', ''), (5, 30, 'imu', '24 of 29 cells hold no wrench'),
    (30, 0, 'imu', 'nothing was recorded, because no temperature came'),
    (30, 30, 'imu', 'specific force reported in no cell'),
])  # fmt: skip
def test_the_answer_says_what_a_recording_lacks(rig, wrenches, temperatures, gravity, words):
    node = rig(parameters={'gravity.source': gravity})
    start_recording(node)
    for second in range(30):
        if second < wrenches:
            node.put(START + second * SECOND, [1.0] * 6)
        if second < temperatures:
            node.put_temperature(START + second * SECOND, 25.0)
    answer = node.call('record', False)
    assert answer.success
    assert words in answer.message
    assert ('warning: ' in answer.message) == bool(words), answer.message


OTHERS = 'thermometer 2', 'wrench_reference'


@pytest.mark.parametrize('source', OTHERS)
def test_what_comes_by_another_clock_is_missing_in_the_recording(rig, source):
    node = rig(thermometers=2)
    start_recording(node)
    for second in range(130):
        stamp = START + second * SECOND
        late = {name: stamp - 1200 * SECOND * (name == source) for name in OTHERS}
        node.put(stamp, [1.0] * 6)
        node.send_reference(late['wrench_reference'], [1.0] * 6)
        for j, at in enumerate((stamp, late['thermometer 2'])):
            node.node.inputs.take(j, at, 25.0)
    assert node.diagnosis('calibration', f'recorded without {source}').level == b'\1'
    assert f'warning: {source} reported in no' in node.call('record', False).message


def test_a_recording_goes_on_in_its_file_after_a_kill(rig, tmp_path, monkeypatch):
    node = rig()
    path = start_recording(node)
    feed(node, 5)
    killed = shutil.copytree(node.directory, tmp_path / 'killed')
    node.call('record', False)
    path = killed / 'recordings' / path.name
    with path.open('a') as file:
        file.write('1700')  # of a row
    again = rig(directory=killed, namespace=node.namespace)
    assert again.diagnosis('calibration').message == 'recording'
    feed(again, 5, first=20)
    assert '4 thermal cells (4 s) since the node was' in again.call('record', False).message
    stamps_ns = np.genfromtxt(path, delimiter=',', names=True)['stamp_ns']
    assert ((stamps_ns - START) // SECOND).tolist() == [0, 1, 2, 3, 20, 21, 22, 23]
    shutil.copytree(node.directory, tmp_path / 'late')
    (tmp_path / 'late/recordings/unfinished').write_text(path.name)
    monkeypatch.setattr('wrist_ft_comp.node.recorder._CUT_OFF_S', -1.0)
    late = rig(directory=tmp_path / 'late').diagnosis('calibration')
    assert (late.level, 'was cut off when the node' in late.message) == (b'\1', True)


@pytest.mark.parametrize(('first', 'begins_s'), [
    (8, (100, 2_000_000_000)), (7, (9000, 2000)), (7, (9000, 8940)),
])  # fmt: skip
def test_a_clock_that_is_set_or_begins_anew_begins_another_file(rig, first, begins_s):
    node = rig()
    path = start_recording(node)
    for begin_s in begins_s:
        for second in range(begin_s, begin_s + 8):
            node.put(second * SECOND, [1.0] * 6)
            node.put_temperature(second * SECOND, 25.0)
    assert f'before a clock was set in {path}, into' in node.call('record', False).message
    assert [len(read_recording(p)) for p in sorted(path.parent.glob('*.csv'))] == [first, 7]


def test_starting_twice_and_ending_twice_are_refused(rig):
    node = rig()
    assert node.diagnosis('calibration', 'idle').values['last'] == 'none yet'
    assert node.refusal('calibrate') == node.diagnosis('calibration', 'idle').values['last']
    assert node.refusal('record', False) == 'No recording runs. Start one with ~/record.'
    path = start_recording(node)
    assert node.diagnosis('calibration').message == 'recording'
    assert f'A recording runs already, into {path}' in node.refusal('record', True)
    assert f'recorded 0 thermal cells (0 s) into {path}\n' in node.call('record', False).message


@pytest.mark.parametrize('torque', [3.0, math.nan])
def test_a_reference_is_listened_to_while_recording_and_unusable_ones_are_left_out(rig, torque):
    node = rig()
    topic = node.topic('wrench_reference')
    assert node.node.count_subscribers(topic) == 0
    path = start_recording(node)
    node.wait_until(lambda: node.node.count_subscribers(topic) == 1, 'the subscription')
    node.send_reference(START, [math.nan] * 6)
    node.send_reference(START, [1e10, -1e10, 0, 0, 0, 0])
    reference = [3.0] * 3 + [torque] * 3
    node.send_reference(START + 1, reference)
    feed(node, 2)
    node.call('record', False)
    node.wait_until(lambda: node.node.count_subscribers(topic) == 0, 'its end')
    np.testing.assert_equal(read_recording(path).reference[0].tolist(), reference)


def test_a_recording_keeps_its_cells_where_a_model_brings_longer_ones(rig, make_model):
    model = make_model('slow.yaml', period_s=10.0)
    node = rig()
    path = start_recording(node)
    feed(node, 4)
    assert node.set('model_file', str(model.path)).successful
    feed(node, 60, first=4)
    assert node.call('record', False).success
    table = np.genfromtxt(path, delimiter=',', names=True)
    cells = (table['stamp_ns'] - START) // SECOND
    np.testing.assert_array_equal(cells, np.arange(len(cells)))
    assert len(cells) > 40
    np.testing.assert_allclose(table['force_z'], 1.5 + 10 * cells)
    measured = np.isfinite(table['temperature_c'])
    assert cells[measured].tolist() == [0, 1, 2, 5, 15, 25, 35, 45, 55]
    recording = read_recording(path, period_s=10.0)
    np.testing.assert_allclose(recording.temperature_c[2:4, 0], [27.45, 28.45])


def test_a_recording_that_ends_leaves_the_other_which_waits_for_no_reference(rig):
    node, written = rig(), []
    writer = SimpleNamespace(append=lambda *row: written.append(row), close=lambda: None)
    node.node.recorder.begin_recording(writer)
    start_recording(node)
    node.send_reference(START, [1.0] * 6)
    feed(node, 5)
    assert node.call('record', False).success
    feed(node, 5, first=5)
    assert [(stamp_ns - START) // SECOND for stamp_ns, _ in written] == list(range(9))


@pytest.mark.parametrize('more', [0, 5], ids=['at the end', 'at a row'])
def test_a_recording_whose_file_is_deleted_ends_with_a_sentence(rig, more):
    node = rig()
    path = start_recording(node)
    feed(node, 5)
    path.unlink()
    feed(node, more, first=5)
    sentence = node.refusal('record', False)
    assert f'{path} cannot be written: it was deleted in the meantime.' in sentence
    assert 'has ended after 4 thermal cells. See that its file stays' in sentence
    assert start_recording(node).exists()
    feed(node, 3, first=6 + more)
    assert 'recorded 3 thermal cells' in node.call('record', False).message


FORCE, REFERENCE, WRENCH = 'on_specific_force', 'send_reference', 'put'


@pytest.mark.parametrize('apart_s', [None, 3600])
@pytest.mark.parametrize(
    ('lacking', 'words'),
    [
        (FORCE, 'recorded without specific force'),
        (REFERENCE, 'recorded without wrench_reference'),
        (WRENCH, 'recorded without raw wrenches'),
    ],
)
def test_a_minute_without_what_was_there_before_is_a_warning(rig, lacking, apart_s, words):
    node = rig(parameters={'gravity.source': 'imu'})
    start_recording(node)
    for second in range(140):
        if second == 10:
            assert node.diagnosis('calibration').level == b'\0'
        felt = (0.0, 0.0, 9.8 + second * 1e-3)
        for verb, send in {
            WRENCH: lambda at: node.put(at, [1.0] * 6),
            FORCE: lambda at, felt=felt: node.node.broadcast(FORCE, at, felt, None),
            REFERENCE: lambda at: node.send_reference(at, [1.0] * 6),
        }.items():
            is_lacking = verb == lacking and second >= 10
            if not is_lacking or apart_s is not None:
                send(START + (second + is_lacking * (apart_s or 0)) * SECOND)
        node.put_temperature(START + second * SECOND, 25.0)
    found = node.diagnosis('calibration')
    assert (found.level, words in found.message) == (b'\1', True), found.message
