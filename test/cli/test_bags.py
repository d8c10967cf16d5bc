"""Bags of both storages, with a wrench at 1 kHz and temperatures at 10 Hz."""

import json

import pytest

both = pytest.mark.parametrize('storage', ['sqlite3', 'mcap'])


@pytest.fixture(scope='module')
def known():
    return {}


@pytest.fixture
def fitted(done, bags, known, tmp_path_factory):
    """The model of a bag, and what the calibration said."""

    def fit(storage):
        if storage not in known:
            path = tmp_path_factory.mktemp('model') / 'm.yaml'
            out = done('calibrate', bags[storage], '-o', path, '--method', 'pls', '--json')
            known[storage] = path, json.loads(out)
        return known[storage]

    return fit


@both
def test_a_bag_is_learnt_and_judged(storage, fitted, done, bags):
    model, said = fitted(storage)
    assert said['axes']['force_z']['rms_after'] < 0.2 * said['axes']['force_z']['rms_before']
    assert said['duration_s'] == 90
    found = json.loads(done('evaluate', model, bags[storage], '--json', '--tare', '2'))
    force = found['axes']['force_z']
    assert force['rms_after'] < 0.1 * force['rms_before']
    assert force['rms_before'] > 10


def test_the_output_topic_has_a_name(fitted, done, run, bags, tmp_path):
    model, _ = fitted('mcap')
    argv = ['compensate', model, bags['mcap'], '--output-topic']
    done(*argv, 'clean', '-o', tmp_path / 'out')
    assert '/clean ' in done('show', tmp_path / 'out')
    assert '/log already' in run(*argv, '/log', '-o', tmp_path / 'no').sentence
    assert not (tmp_path / 'no').exists()


def test_a_cut_off_mcap_is_read_to_its_last_chunk(fitted, run, bags, tmp_path):
    model, _ = fitted('mcap')
    whole = next(bags['mcap'].glob('*.mcap')).read_bytes()
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(whole[: len(whole) * 2 // 3])
    outcome = run('evaluate', model, cut, '--json')
    assert outcome.code == 0
    assert 'cut off' in outcome.err
    found = json.loads(outcome.out)['recordings'][0]
    assert any('cut off' in warning for warning in found['warnings'])
    assert 40 < found['duration_s'] < 90
