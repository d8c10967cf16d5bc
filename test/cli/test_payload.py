"""The reference payload on the command line: learnt, and judged on another day."""

from contextlib import redirect_stdout
import io
import json

import numpy as np
import pytest

from wrist_ft_comp.cli.main import main
from wrist_ft_comp.errors import ModelFileError
from wrist_ft_comp.jobs import calibration_job
from wrist_ft_comp.stored.payload_file import load_payloads


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp('work')


@pytest.fixture(scope='module')
def days(folder, make_working_day, write_working_day):
    """Two days to learn from, one in whose middle the driver tared, and a short one."""
    paths, long = [], {'cells': 1200}
    kinds = {0: long, 1: long, 2: {**long, 'tare_at': 607}, 4: {'cells': 600, 'part': False}}
    for seed, kind in kinds.items():
        day = make_working_day(seed, **kind)
        sensor = {'recorded_from?frame_id=left_ft': np.full(len(day), '')}
        paths.append(write_working_day(folder / f'day{seed}.csv', day, sensor))
    return paths


@pytest.fixture(scope='module')
def learnt(folder, days):
    """A model that was learnt from both days, and what was printed."""
    path, said = folder / 'cell.yaml', io.StringIO()
    argv = ['calibrate', *days[:2], '--reference', 'payload', '--method', 'pls', '-o', path]
    with redirect_stdout(said):
        assert main([str(word) for word in argv]) == 0
    return path, said.getvalue()


def test_payloads_are_printed_and_kept_beside_the_model(days, done, learnt):
    path, text = learnt
    argv = 'calibrate', days[3], '--reference', 'payload', '--method', 'pls'
    assert 'payload cell-1: 1.3' in text
    assert 'mm' in text
    assert 'roll, pitch, yaw of 0.0, 0.0, 90.0' in text
    other = '-o', path.with_name('other.yaml'), '--imu-topic', 'imu', '--json'
    said = json.loads(done(*argv, *other))
    assert said['advice'][-1].endswith('ANOTHER_DAY --imu-topic imu')
    (printed,) = said['payloads']
    assert printed['name'] == 'other-1'
    assert printed['mass_error_kg'] > 0
    kept = load_payloads(path.with_name('payloads.json'))
    assert list(kept) == ['cell-1', 'cell-2', 'other-1']
    masses = [payload.mass_kg for payload, _ in kept.values()]
    assert masses == pytest.approx([1.3, 2.1, printed['mass_kg']], rel=0.005)
    assert masses[2] == printed['mass_kg']
    assert [frame.source for _, frame in kept.values()] == ['imu'] * 3
    assert {frame.wrench_frame for _, frame in kept.values()} == {'left_ft'}


def test_some_parts_of_a_day_with_specific_force_are_enough(
    done, tmp_path, make_working_day, write_working_day
):
    day = make_working_day(0, 1500, part=False)
    day.specific_force[np.r_[:310, 590:910, 1190:1500]] = np.nan
    path = write_working_day(tmp_path / 'day.csv', day)
    argv = 'calibrate', path, '--reference', 'payload', '--method', 'pls'
    assert 'payload m-1: 1.3' in done(*argv, '-o', tmp_path / 'm.yaml')


def test_payloads_need_their_model_and_a_model_goes_without_them(days, run, tmp_path, monkeypatch):
    argv = 'calibrate', days[3], '--reference', 'payload', '--method', 'pls', '-o'
    kept, save = tmp_path / 'payloads.json', calibration_job.save_model

    def fail(*_):
        raise ModelFileError('The disk is full.')

    def save_and_break(*arguments):
        kept.write_text('{')
        return save(*arguments)

    monkeypatch.setattr(calibration_job, 'save_model', fail)
    assert run(*argv, tmp_path / 'lost.yaml').sentence
    assert not kept.exists()
    monkeypatch.setattr(calibration_job, 'save_model', save_and_break)
    assert 'its payloads are not: ' in ' '.join(run(*argv, tmp_path / 'cell.yaml').err.split())
    assert (tmp_path / 'cell.yaml').exists()


def test_a_day_is_judged_as_its_model_was_learnt_where_no_reference_is_named(days, done, learnt):
    argv = 'evaluate', learnt[0], days[2]
    judged = json.loads(done(*argv, '--json'))
    assert judged == json.loads(done(*argv, '--reference', 'payload', '--json'))
    assert judged['recordings'][0]['reference'] == 'payload'
    assert 'payload' not in ' '.join(judged['warnings'])
    force = judged['axes']['force_z']
    assert force['rms_after'] < 0.1 * force['rms_before']
    judged = json.loads(done(*argv, '--reference', 'unloaded', '--json'))
    assert judged['recordings'][0]['reference'] == 'unloaded'
