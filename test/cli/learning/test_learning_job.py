import fcntl
import json
import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time

import numpy as np
import pytest

from wrist_ft_comp.calibration.settings import CalibrationSettings, IdentificationSettings
from wrist_ft_comp.cli.calibration_job import _answer
from wrist_ft_comp.files.days.diary import alone, days, diary_path, load_diary
from wrist_ft_comp.files.job_request import ANOTHER_LEARNS, CalibrationJob, encode_job, Learning
from wrist_ft_comp.files.model_file import load_model

QUICK = CalibrationSettings('payload', identification=IdentificationSettings('pls', degree=1))
CELLS, PERIOD_S = 300, 4.0
COLUMNS = (
    'stamp_s', 'force_x', 'force_y', 'force_z', 'torque_x', 'torque_y', 'torque_z',
    'temperature_c', 'linear_acceleration_x', 'linear_acceleration_y', 'linear_acceleration_z',
)  # fmt: skip


@pytest.fixture(autouse=True)
def own_lock(tmp_path, monkeypatch):
    """No other test of this computer is in the way."""
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path))


def write_day(directory, number):
    """Write a day at work: a kilogram that turns, and drift with temperature."""
    rng = np.random.default_rng(number)
    warm = 20 + rng.uniform(0, 4) + 10 * (1 - np.exp(-np.arange(CELLS) / rng.uniform(60, 200)))
    pose = np.repeat(rng.normal(size=(CELLS // 3, 3)), 3, axis=0)
    force = 9.807 * pose / np.linalg.norm(pose, axis=1, keepdims=True)
    raw = np.concatenate((-force, np.cross((0.0, 0.0, 0.1), -force)), axis=1)
    raw += np.array([1, -1, 0.5, 0.05, 0.03, -0.02]) * (0.4 * warm[:, None] + rng.normal(size=6))
    raw += rng.normal(0, 0.01, raw.shape) * np.array([1, 1, 1, 0.05, 0.05, 0.05])
    stamps = 86_400.0 * number + PERIOD_S * (np.arange(CELLS) + 0.5)
    rows = np.column_stack((stamps, raw, warm + rng.normal(0, 0.01, CELLS), force))
    path = directory / 'days' / f'day_{number:05d}.csv'
    path.parent.mkdir(exist_ok=True)
    lines = [','.join(COLUMNS), *(','.join(f'{each:.9g}' for each in row) for row in rows)]
    path.write_text('\n'.join(lines) + '\n')
    return path


@pytest.fixture(scope='module')
def sensor(tmp_path_factory):
    """A sensor's folder with three days."""
    directory = tmp_path_factory.mktemp('sensor')
    for number in (1, 2, 3):
        write_day(directory, number)
    return directory


def job_of(directory, count, champion=None, *, report=False, **more):
    models = directory / 'models'
    return CalibrationJob(
        tuple(days(directory)[:count]), models / f'model_{count}.yaml', QUICK, PERIOD_S,
        report=models / f'model_{count}.html' if report else None,
        learning=Learning(champion, **more))  # fmt: skip


@pytest.fixture(scope='module')
def answers(sensor):
    """What the first two days give."""
    return [_answer(job_of(sensor, count, report=True)) for count in (1, 2)]


def test_days_give_a_model_a_report_and_a_diary(sensor, answers):
    first, second = answers
    assert (first['success'], first['learnt'], first['paused']) == (True, False, '')
    assert first['incident'] == ''
    assert (second['success'], second['learnt'], second['paused']) == (True, True, '')
    assert 'was better' in second['message']
    stored = load_model(second['path'])
    assert stored.sha256 == second['sha256']
    provenance = stored.document['provenance']
    sources = [Path(each['path']).name for each in provenance['recordings']]
    assert sources == ['day_00001.csv', 'day_00002.csv']
    assert provenance['settings']['reference'] == 'payload'
    assert '<html' in stored.path.with_suffix('.html').read_text()
    diary = load_diary(sensor)
    assert [each.name for each in diary.days] == sources
    assert stored.path.name in diary.decisions[0].sentence


def test_a_lost_diary_and_a_live_model_are_no_hurdle(sensor, answers):
    champion = Path(answers[1]['path'])
    diary_path(sensor).write_text('{"format": ')
    again = _answer(job_of(sensor, 3, champion, since='day_00001.csv'))
    assert again['success']
    diary = load_diary(sensor)
    assert len(diary.days) == 3
    live = load_model(champion).sha256[:12]
    assert {each.live for each in diary.days} == {live}
    assert all(np.isfinite(each.left[live]).all() for each in diary.days)
    assert diary.decisions[0].day == 'day_00001.csv'
    assert 'The live model left 0.0' in again['message']


def test_what_cannot_be_is_said_and_nothing_is_changed(sensor, answers, tmp_path):
    assert answers[0]['success']
    before = diary_path(sensor).read_bytes()
    broken = _answer(job_of(sensor, 3, tmp_path / 'gone.yaml'))
    assert (broken['success'], broken['learnt']) == (False, False)
    assert 'gone.yaml cannot be read' in broken['message']
    none = _answer(CalibrationJob((), tmp_path, learning=Learning()))
    assert 'No day has ended' in none['message']
    with alone() as mine:
        assert mine
        busy = _answer(job_of(sensor, 3))
        assert (busy['success'], ANOTHER_LEARNS in busy['message']) == (False, True)
    assert diary_path(sensor).read_bytes() == before


def test_the_lock_goes_with_its_process(tmp_path):
    with alone() as mine:
        assert mine
        with (tmp_path / f'wrist_ft_comp_learning_{os.getuid()}.lock').open() as file, \
                pytest.raises(BlockingIOError):  # fmt: skip
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    with alone() as again:
        assert again


def test_a_job_that_is_killed_leaves_files_that_load(sensor, answers, tmp_path):
    assert answers[0]['success']
    rng = np.random.default_rng(7)
    for _ in range(2):
        process = subprocess.Popen(
            [sys.executable, '-m', 'wrist_ft_comp.cli.calibration_job'],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            env={**os.environ, 'TMPDIR': str(tmp_path)}, text=True)  # fmt: skip
        process.stdin.write(encode_job(job_of(sensor, 3)))
        process.stdin.close()
        process.stdin = None
        time.sleep(rng.uniform(0.2, 2.5))
        process.kill()
        process.communicate()
        assert json.loads(diary_path(sensor).read_text())['version'] == 1
        for path in sensor.glob('models/*.yaml'):
            load_model(path)
