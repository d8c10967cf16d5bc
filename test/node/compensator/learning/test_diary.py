import os
import resource

import numpy as np
import pytest

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.learning import day_files
from wrist_ft_comp.learning.day_files import DayFiles
from wrist_ft_comp.node.compensator_node import CompensatorNode
from wrist_ft_comp.recordings.read import read_recording
from wrist_ft_comp.stream.cell_averager import row_channels

HOUR, DAY = 6, 144  # cells


def test_a_day_is_a_recording_of_24_h_with_five_digits(learner):
    node = learner()
    node.hear(DAY + 10)
    assert node.files() == ['day_00001.csv', 'day_00002.csv']
    recording = read_recording(node.days / 'day_00001.csv')
    assert len(recording) == DAY
    assert recording.wrench[7].tolist() == [12.346, 0.5, 123.457, 0.1, 0.2, 0.3]
    np.testing.assert_allclose(recording.temperature_c[:, 0], 25 + 0.01 * np.arange(DAY))
    np.testing.assert_allclose(recording.specific_force[1:], [[0, 0, 9.80665]] * (DAY - 1), 1e-4)
    np.testing.assert_allclose(recording.rotation_speed[1:], 0.01)


@pytest.mark.parametrize(('hours', 'days'), [(1.9, 1), (2.2, 2), (-3.0, 2)])
def test_a_silence_of_2_h_and_stamps_that_run_back_end_a_day(learner, hours, days):
    node = learner()
    node.hear(30, later=200)
    first = (node.days / 'day_00001.csv').read_bytes()
    node.hear(30, later=round(hours * HOUR))
    assert len(node.files()) == days
    assert (node.days / 'day_00001.csv').read_bytes().startswith(first), 'nothing is overwritten'


def test_a_silence_of_the_clock_ends_a_day_too(learner, monkeypatch):
    node = learner()
    node.hear(20)
    monkeypatch.setattr('wrist_ft_comp.node.learner.SILENCE_NS', 0)
    node.judged()
    assert [len(job['recordings']) for job in node.asked()] == [1]


def test_a_restart_goes_on_with_the_day_unless_it_is_over(learner):
    for later, files in ((0, 1), (1, 1), (40, 2)):
        node = learner()
        node.hear(20, later)
        node.node.destroy_node()
        assert len(node.files()) == files
    rows = [(node.days / name).read_text().count('\n') - 1 for name in node.files()]
    assert rows == [38, 19], 'the last cell of a run is not complete'


def test_a_killed_node_loses_the_last_row_at_most(learner):
    node = learner()
    node.hear(20)
    path = node.days / 'day_00001.csv'
    whole = path.read_bytes()
    assert whole.count(b'\n') == 20, 'a header and all cells but the last, which is not complete'
    path.write_bytes(whole[:-9])
    again = learner()
    again.hear(5)
    text = path.read_text()
    assert text.startswith(whole[: whole[:-1].rindex(b'\n') + 1].decode())
    assert len(read_recording(path)) == 24


def test_a_full_disk_is_a_warning_and_tried_again_while_the_stream_goes_on(learner, monkeypatch):
    node = learner()
    node.hear(20)
    path = node.days / 'day_00001.csv'
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size + 30, before[1]))
    try:
        node.hear(5)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    status = node.rig.diagnosis('learning', 'day_00001.csv cannot be written: File too large')
    assert status.level == b'\x01'
    assert len(node.rig.take(25)) == 25, 'wrenches went on'
    monkeypatch.setattr(node.node.learning.diary, '_wait_until', 0.0)
    node.rig.wait_until(lambda: node.node.learning.diary._recording, 'another try')
    node.hear(5)
    node.rig.diagnosis('learning', 'no better model is offered')
    assert node.files() == ['day_00001.csv']
    assert len(read_recording(path)) == 29, 'five are missing, one is not complete'


def test_the_days_never_take_more_than_their_room(learner, tmp_path):
    days = tmp_path / 'data/days'
    days.mkdir(parents=True)
    with (days / 'day_00001.csv').open('wb') as file:
        file.truncate(50_000_000 - day_files._MARGIN_BYTES + 2000)
    node = learner(**{'learning.max_mb': 50.0})
    node.hear(20)
    status = node.rig.diagnosis('learning', 'holds as much as learning.max_mb allows (50 MB)')
    assert status.level == b'\x01'
    assert status.values['megabytes'] == '49.8'
    assert node.files() == ['day_00001.csv']


@pytest.mark.parametrize(('apart_s', 'names'), [
    (50_000, ['day_00001.csv', 'day_00002.csv']), (3600, ['day_00001.csv']),
])  # fmt: skip
def test_two_clocks_do_not_fill_the_folder_with_files(tmp_path, apart_s, names):
    """Rows that leap to and fro end no day; an honest day before them stays."""
    files = DayFiles(tmp_path, ('force_x', 'temperature_c'), 1e9)
    for second in range(1050):
        files.append(second * 10**9, (1.0, 2.0))
        if second >= 1000:
            files.append((second + apart_s) * 10**9, (1.0, 2.0))
    files.close()
    assert sorted(file.name for file in (tmp_path / 'days').iterdir()) == names
    assert (tmp_path / 'days/day_00001.csv').read_text().count('\n') >= 1001


def test_a_day_of_two_thermometers_takes_less_than_10_mb(tmp_path):
    rng, channels = np.random.default_rng(4), row_channels(2, with_force=True)
    files = DayFiles(tmp_path, channels, 1e9)
    scale = [30.0] * 3 + [3.0] * 3 + [np.nan] * 6 + [10.0] * 2 + [6.0] * 3 + [0.3]
    for second, row in enumerate(rng.normal(0.0, scale, (864, len(channels)))):
        row[12:14] += 30.0
        files.append((1_700_000_000 + second) * 10**9 + 500_000_000, row.tolist())
    files.close()
    assert 5e6 < 100 * (tmp_path / 'days/day_00001.csv').stat().st_size < 10e6


def test_a_silent_thermometer_does_not_end_the_day(learner, monkeypatch):
    monkeypatch.undo()
    node = learner()
    for second in range(1500):
        stamp = 1_700_000_000 * 10**9 + second * 10**9
        node.rig.put(stamp, [1.0] * 6)
        node.node.broadcast('on_specific_force', stamp, (0.0, 0.0, 9.80665), None)
        if not 100 < second < 900:
            node.rig.put_temperature(stamp, 25.0)
        node.node.recorder.poll()
    assert node.files() == ['day_00001.csv']
    recording = read_recording(node.days / 'day_00001.csv')
    assert np.isfinite(recording.wrench).all(axis=1).sum() > 1400
    assert recording.warnings == ()


def test_days_from_before_a_smaller_bound_are_tidied_up(learner, tmp_path):
    node = learner()
    node.a_day()
    node.node.destroy_node()
    with (tmp_path / 'data/days/day_00001.csv').open('ab') as file:
        file.truncate(60_000_000)
    node = learner(**{'learning.max_mb': 50.0})
    node.hear(5)
    node.judged(2)
    assert node.node.learning.running_s is None, 'it is asked for once, not for ever'
    node.wait(lambda: node.node.learning.diary.files.full, 'another look')
    assert len(node.asked()) == 2


def test_a_second_node_names_the_process_that_holds_the_folder(learner, tmp_path):
    node = learner()
    with pytest.raises(SettingsError, match=f'process {os.getpid()} on') as refused:
        node.rig.bench.make(
            CompensatorNode,
            namespace='/other',
            parameters={'data_directory': str(tmp_path / 'data')},
        )
    assert 'data_directory of its own' in str(refused.value)
    node.node.destroy_node()
    assert learner().days == node.days
