"""Recordings of days: where one begins and ends, what survives, and what the disk allows."""

import os
import resource

import numpy as np
import pytest

from wrist_ft_comp.errors import RecordingError, SettingsError
from wrist_ft_comp.learning.day_files import DayFiles
from wrist_ft_comp.node.compensator_node import CompensatorNode
from wrist_ft_comp.recordings.read import read_recording

DAY, SECOND = 1440, 10**9
CHANNELS = ('force_x', 'temperature_c')


@pytest.fixture
def write(tmp_path):
    """Write a row at each of some minutes, as one run of a node; rows of every day there is."""

    def write(minutes, values=(1.0, 20.0), max_bytes=1e9):
        files = DayFiles(tmp_path, CHANNELS, max_bytes)
        try:
            for minute in minutes:
                files.append(round(minute * 60 * SECOND), values)
        finally:
            files.close()
        paths = sorted((tmp_path / 'days').glob('*'))
        return [path.read_text().count('\n') - 1 for path in paths]

    return write


@pytest.mark.parametrize(
    ('runs', 'rows'),
    [
        ([range(DAY + 20)], [DAY, 20]),
        ([[*range(60), *range(60 + 114, 234)]], [120]),
        ([[*range(60), *range(60 + 132, 252)]], [60, 60]),
        ([[*range(200, 260), *range(60)]], [60, 59]),
        ([[*range(60), 30, *range(60, 70)]], [70]),
        ([range(60), range(60, 120)], [120]),
        ([range(60), range(300, 360)], [60, 60]),
        ([range(5), range(300, 360)], [60]),
    ],
    ids=[
        'a day', 'silent for 1.9 h', 'silent for 2.2 h', 'time ran back', 'a stray row',
        'a restart', 'a late restart', 'minutes only',
    ],
)  # fmt: skip
def test_a_day_ends_after_24_h_a_silence_of_2_h_and_where_time_ran_back(write, runs, rows):
    assert [write(run) for run in runs][-1] == rows


@pytest.mark.parametrize(('apart', 'days'), [(833, 2), (60, 1)])
def test_two_clocks_do_not_fill_the_folder_with_files(write, apart, days):
    """Rows that leap to and fro end no day; an honest day before them stays."""
    both = (minute for pair in range(1000, 1050) for minute in (pair, pair + apart))
    rows = write([*range(1000), *both])
    assert len(rows) == days
    assert rows[0] >= 1000


def test_temperatures_from_before_a_silence_begin_no_day(tmp_path):
    files = DayFiles(tmp_path, CHANNELS, 1e9)
    for second in (*range(700), 100, 101, 102):
        files.append(second * SECOND, (1.0 if second > 102 else np.nan, 20.0))
    files.close()
    assert len(list((tmp_path / 'days').iterdir())) == 1


def test_a_killed_node_loses_the_last_row_at_most(write, tmp_path):
    write(range(20))
    path = tmp_path / 'days/day_00001.csv'
    whole = path.read_bytes()
    path.write_bytes(whole[:-9])
    assert write(range(20, 25)) == [24]
    assert path.read_bytes().startswith(whole[: whole[:-1].rindex(b'\n') + 1])


def test_the_days_never_take_more_than_their_room(write, tmp_path):
    (tmp_path / 'days').mkdir()
    with (tmp_path / 'days/day_00001.csv').open('wb') as file:
        file.truncate(50_000_010)
    with pytest.raises(RecordingError, match=r'as much as learning.max_mb allows \(50 MB\)'):
        write(range(1, 20), max_bytes=5e7)
    assert len(list((tmp_path / 'days').iterdir())) == 1


def test_a_node_writes_what_it_hears_and_a_silence_by_the_clock_ends_the_day(learner, monkeypatch):
    node = learner()
    node.hear(20)
    recording = read_recording(node.days / 'day_00001.csv')
    assert recording.wrench[7].tolist() == [12.346, 0.5, 123.457, 0.1, 0.2, 0.3]
    np.testing.assert_allclose(recording.temperature_c[:, 0], 25 + 0.01 * np.arange(19))
    np.testing.assert_allclose(recording.specific_force[1:], [[0, 0, 9.80665]] * 18, 1e-4)
    np.testing.assert_allclose(recording.rotation_speed[1:], 0.01)
    monkeypatch.setattr('wrist_ft_comp.node.learner.SILENCE_NS', 0)
    node.judged()
    assert [len(job['recordings']) for job in node.asked()] == [1]


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
    node.hear(5)
    node.rig.diagnosis('learning', 'no better model is offered')
    assert node.files() == ['day_00001.csv']
    assert len(read_recording(path)) == 29, 'five are missing, one is not complete'


def test_a_job_makes_room_once_where_days_take_more_than_they_may(learner, tmp_path):
    node = learner()
    node.a_day()
    node.node.destroy_node()
    with (tmp_path / 'data/days/day_00001.csv').open('ab') as file:
        file.truncate(60_000_000)
    node = learner(**{'learning.max_mb': 50.0})
    node.hear(5)
    node.judged(2)
    node.wait(lambda: node.node.learning.diary.files.full, 'another look')
    assert len(node.asked()) == 2
    assert node.rig.diagnosis('learning', 'learning.max_mb').values['megabytes'] == '60.0'


def test_a_second_node_names_the_process_that_holds_the_folder(learner, tmp_path):
    node, given = learner(), {'data_directory': str(tmp_path / 'data')}
    with pytest.raises(SettingsError, match=f'process {os.getpid()} on .*of its own'):
        node.rig.bench.make(CompensatorNode, namespace='/other', parameters=given)
    node.node.destroy_node()
    assert learner().days == node.days
