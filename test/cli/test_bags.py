"""Bags of both storages, with a wrench at 1 kHz and temperatures at 10 Hz."""

import json

import pytest


@pytest.mark.parametrize('storage', ['sqlite3', 'mcap'])
def test_a_bag_is_learnt_and_judged(storage, done, bags, tmp_path):
    path = tmp_path / 'm.yaml'
    learnt = json.loads(done('calibrate', bags[storage], '-o', path, '--method', 'pls', '--json'))
    assert learnt['axes']['force_z']['rms_after'] < 0.2 * learnt['axes']['force_z']['rms_before']
    assert learnt['duration_s'] == 90
    judged = json.loads(done('evaluate', path, bags[storage], '--json', '--tare', '2'))
    force = judged['axes']['force_z']
    assert force['rms_after'] < 0.1 * force['rms_before']
    assert force['rms_before'] > 10


def test_the_output_topic_has_a_name(model, done, run, bags, tmp_path):
    argv = ['compensate', model, bags['mcap'], '--output-topic']
    done(*argv, 'clean', '-o', tmp_path / 'out')
    assert '/clean ' in done('show', tmp_path / 'out')
    assert '/log already' in run(*argv, '/log', '-o', tmp_path / 'no').sentence
    assert not (tmp_path / 'no').exists()
