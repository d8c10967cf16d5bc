import os
import resource
import subprocess
import sys

import numpy as np
import pytest

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.learning import day_files
from wrist_ft_comp.learning.day_files import DayFiles
from wrist_ft_comp.node.compensator import CompensatorNode
from wrist_ft_comp.recordings.read import read_recording
from wrist_ft_comp.stored.model_store import ModelStore
from wrist_ft_comp.stream.cell_averager import row_channels

HOUR, DAY = 6, 144  # cells


def test_a_day_is_a_recording_of_24_h_with_five_digits(learner):
    node = learner()
    node.hear(DAY + 10)
    assert node.files() == ['day_00001.csv', 'day_00002.csv']
    recording = read_recording(node.days / 'day_00001.csv', period_s=600.0)
    assert len(recording) == DAY
    assert recording.wrench[7].tolist() == [12.346, 0.5, 123.457, 0.1, 0.2, 0.3]
    np.testing.assert_allclose(recording.temperature_c[:, 0], 25 + 0.01 * np.arange(DAY))
    np.testing.assert_allclose(recording.specific_force[1:], [[0, 0, 9.80665]] * (DAY - 1), 1e-4)
    np.testing.assert_allclose(recording.rotation_speed[1:], 0.01)


def test_a_day_of_more_cells_than_a_recording_may_have_goes_on_in_another_file(
    learner, monkeypatch
):
    monkeypatch.setattr('wrist_ft_comp.stream.batch_grid.MAX_NUMBERS', 100)
    node = learner()
    node.hear(121)
    lengths = [len(read_recording(node.days / name, period_s=600.0)) for name in node.files()]
    assert lengths == [49, 49, 22]


@pytest.mark.parametrize(('hours', 'days'), [(1.9, 1), (2.2, 2), (-1.0, 2), (-20.0, 2)])
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
    assert len(read_recording(path, period_s=600.0)) == 24


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
    assert len(read_recording(path, period_s=600.0)) == 29, 'five are missing, one is not complete'


def test_the_days_never_take_more_than_their_room(learner, tmp_path, monkeypatch):
    monkeypatch.setattr(day_files, '_MEASURED_EVERY_ROWS', 1)
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
    for second in range(1000):
        files.append(second * 10**9, (1.0, 2.0))
    for second in range(1000, 1050):
        files.append(second * 10**9, (1.0, 2.0))
        files.append((second + apart_s) * 10**9, (1.0, 2.0))
    files.close()
    assert sorted(file.name for file in (tmp_path / 'days').iterdir()) == names
    assert (tmp_path / 'days/day_00001.csv').read_text().count('\n') >= 1001


def test_a_day_of_two_thermometers_takes_less_than_10_mb(tmp_path):
    rng, day = np.random.default_rng(4), 86_400
    channels = row_channels(2, with_force=True)
    files = DayFiles(tmp_path, channels, 1e9)
    scale = [30.0] * 3 + [3.0] * 3 + [np.nan] * 6 + [10.0] * 2 + [6.0] * 3 + [0.3]
    rows = rng.normal(0.0, 1.0, (day // 100, len(channels))) * scale
    rows[:, 12:14] += 30.0
    for second, row in enumerate(rows.tolist()):
        files.append((1_700_000_000 + second) * 10**9 + 500_000_000, row)
    files.close()
    assert 5e6 < 100 * (tmp_path / 'days/day_00001.csv').stat().st_size < 10e6


def test_a_silent_thermometer_does_not_end_the_day(learner):
    node = learner(thermal_period=1.0)
    for second in range(1500):
        stamp = 1_700_000_000 * 10**9 + second * 10**9
        node.rig.put(stamp, [1.0] * 6)
        node.node.tell('on_force', stamp, (0.0, 0.0, 9.80665), None)
        if not 100 < second < 900:
            node.rig.put_temperature(stamp, 25.0)
        node.node.recorder.poll()
    assert node.files() == ['day_00001.csv']
    recording = read_recording(node.days / 'day_00001.csv')
    assert np.isfinite(recording.wrench).all(axis=1).sum() > 1400
    assert recording.warnings == ()


@pytest.mark.parametrize('ahead_s', [3600, 86_400, -3600])
def test_an_imu_whose_clock_is_off_for_a_while_spoils_no_day(learner, ahead_s):
    node = learner(thermal_period=1.0)
    for second in range(1500):
        stamp = (1_700_000_000 + second) * 10**9
        at = stamp + (ahead_s * 10**9 if second < 700 else 0)
        node.node.tell('on_force', at, (0.0, 0.0, 9.0 + (second < 700)), None)
        node.rig.put(stamp, [1.0] * 6)
        node.node.recorder.poll()
        node.rig.put_temperature(stamp, 25.0)
    node.node.destroy_node()
    assert node.files() == ['day_00001.csv']
    day = np.genfromtxt(node.days / 'day_00001.csv', delimiter=',', names=True)
    np.testing.assert_array_equal(day['stamp_s'] - 1_700_000_000, np.arange(1499) + 0.5)
    assert np.isfinite([day['force_x'], day['temperature_c']]).all()
    assert np.isnan(day['linear_acceleration_z'][:650]).all()
    np.testing.assert_array_equal(day['linear_acceleration_z'][700:], 9.0)


def test_a_day_ends_when_it_has_its_share_of_the_room(learner, tmp_path, monkeypatch):
    monkeypatch.setattr(day_files, '_MEASURED_EVERY_ROWS', 1)
    days = tmp_path / 'data/days'
    days.mkdir(parents=True)
    node = learner(**{'learning.max_mb': 50.0})
    node.hear(20)
    with (days / 'day_00001.csv').open('ab') as file:
        file.write(b'#' * 10_000_000)
    node.hear(20)
    node.judged()
    assert node.files() == ['day_00001.csv', 'day_00002.csv']


def test_days_from_before_a_smaller_bound_are_tidied_up(learner, tmp_path, monkeypatch):
    monkeypatch.setattr(day_files, '_MEASURED_EVERY_ROWS', 1)
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


def test_a_killed_process_leaves_no_lock(tmp_path):
    source = (
        'import os, signal, sys; from pathlib import Path\n'
        'from wrist_ft_comp.stored.model_store import ModelStore\n'
        'store = ModelStore(Path(sys.argv[1]))\n'
        'store.sweep(); os.kill(os.getpid(), signal.SIGKILL)'
    )
    process = subprocess.run([sys.executable, '-c', source, str(tmp_path)], check=False)
    assert process.returncode == -9
    assert ModelStore(tmp_path).sweep() == 0
