"""Days that a node records: what it writes, and what the disk and another node allow."""

import os
import resource
import shutil

from moments import WARN
import numpy as np
import pytest

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.node.compensator_node import CompensatorNode
from wrist_ft_comp.recordings.read import read_recording


def test_a_node_writes_what_it_hears_and_a_silence_by_the_clock_ends_the_day(learner, monkeypatch):
    node = learner()
    node.hear(20)
    recording = read_recording(node.days / 'day_00001.csv')
    assert recording.wrench[7].tolist() == [12.346, 0.5, 123.457, 0.1, 0.2, 0.3]
    np.testing.assert_allclose(recording.temperature_c[:, 0], 25 + 0.01 * np.arange(19))
    np.testing.assert_allclose(recording.specific_force[1:], [[0, 0, 9.80665]] * 18, 1e-4)
    np.testing.assert_allclose(recording.rotation_speed[1:], 0.01)
    monkeypatch.setattr('wrist_ft_comp.learning.days.SILENCE_NS', 0)
    node.judged()
    assert [len(job['recordings']) for job in node.asked()] == [1]


def test_a_full_disk_is_a_warning_and_tried_again_while_the_stream_goes_on(learner):
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
    node.node.learning._recording.goes_on_s = 0.0
    node.hear(5)
    node.rig.diagnosis('learning', 'no better model is offered')
    assert node.files() == ['day_00001.csv']
    assert len(read_recording(path)) == 29, 'five are missing, one is not complete'


def test_a_day_whose_folder_is_deleted_is_a_warning_and_another_one_begins(learner):
    node = learner()
    node.hear(20)
    shutil.rmtree(node.days)
    node.hear(5)
    assert node.rig.diagnosis('learning', 'day_00001.csv cannot be written: it was').level == WARN
    node.node.learning._recording.goes_on_s = 0.0
    node.hear(20)
    node.rig.diagnosis('learning', 'no better model is offered')
    assert node.files() == ['day_00002.csv']
    assert len(node.rig.take(45)) == 45, 'wrenches went on'


def test_a_job_makes_room_once_where_days_take_more_than_they_may(learner, tmp_path):
    node = learner()
    node.a_day()
    node.node.destroy_node()
    with (tmp_path / 'data/days/day_00001.csv').open('ab') as file:
        file.truncate(60_000_000)
    node = learner(**{'learning.max_mb': 50.0})
    node.hear(5)
    node.judged(2)
    node.wait(lambda: node.node.learning.files.full, 'another look')
    assert len(node.asked()) == 2
    assert node.rig.diagnosis('learning', 'learning.max_mb').values['megabytes'] == '60.0'


def test_a_second_node_names_the_process_that_holds_the_folder(learner, tmp_path):
    node, given = learner(), {'data_directory': str(tmp_path / 'data')}
    with pytest.raises(SettingsError, match=f'process {os.getpid()} on .*of its own'):
        node.rig.bench.make(CompensatorNode, namespace='/other', parameters=given)
    node.node.destroy_node()
    assert learner().days == node.days
