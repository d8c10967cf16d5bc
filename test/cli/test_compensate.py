import json

import numpy as np
import pandas
import pytest

from wrist_ft_comp import compensate, load_model


def table(path):
    return pandas.read_csv(path, dtype=str, keep_default_na=False).to_dict('list')


def test_csv_is_corrected_as_columns_in_memory_are(done, make, model, tmp_path):
    columns, tare_s = make.drifting(seed=3), 30
    path = make.csv(tmp_path / 'run.csv', {**columns, 'remark': ['x'] * 400})
    out = tmp_path / 'out.csv'
    printed = done('compensate', model, path, '-o', out, '--tare', tare_s)
    assert printed == f'wrote {out}\n'
    written = table(out)
    for axis, values in compensate(load_model(model).model, columns, tare_s=tare_s).items():
        given = np.array(written.pop(axis), dtype=float)
        np.testing.assert_allclose(given, values, rtol=0, atol=1e-12)
    assert set(written.pop('compensated_by_wrist_ft_comp')) == {''}
    celsius = list(map(float, written.pop('temperature_c')))
    assert celsius == pytest.approx(columns['temperature_c'], rel=1e-12)
    assert list(map(int, written.pop('stamp_ns'))) == [10**9 * k for k in range(400)]
    assert not written


def test_a_compensated_recording_is_neither_compensated_nor_learnt_from(
    run, make, model, tmp_path
):
    path = make.csv(tmp_path / 'run.csv', make.drifting(seed=3))
    once = tmp_path / 'once.csv'
    assert run('compensate', model, path, '-o', once).code == 0
    twice = tmp_path / 'twice'
    for argv in (
        ['compensate', model, once, '-o', twice], ['evaluate', model, path, once],
        ['calibrate', path, once, '-o', twice],
    ):  # fmt: skip
        assert 'once.csv was compensated already' in run(*argv).sentence
        assert not twice.exists()
    assert run('show', once).code == 0


def test_the_copy_of_a_bag_is_not_compensated_again(model, done, run, bags, tmp_path):
    done('compensate', model, bags['mcap'], '-o', tmp_path / 'out')
    assert '/wrench_without_drift ' in done('show', tmp_path / 'out')
    said = run('compensate', model, tmp_path / 'out', '-o', tmp_path / 'again').sentence
    assert 'out holds /wrench_without_drift already. Name the raw recording.' in said


def test_compensation_without_a_tare_warns_of_the_offset(run, make, model, tmp_path):
    csv = make.csv(tmp_path / 'run.csv', make.drifting(offset=50.0))
    said = 'every axis keeps a constant offset'
    cases = ([csv], True), ([csv, '--tare', '10'], False)
    for number, (words, warned) in enumerate(cases):
        outcome = run('compensate', model, *words, '-o', tmp_path / f'{number}')
        assert (said in outcome.err) is warned
        target = tmp_path / f'again_{number}'
        outcome = run('compensate', model, *words, '-o', target, '--json')
        printed = json.loads(outcome.out)
        assert (said in ''.join(printed['warnings'][:1])) == warned == bool(printed['warnings'])
        assert (outcome.code, outcome.err, printed['output']) == (0, '', str(target))
        assert target.exists()
    assert np.array(table(tmp_path / '0')['force_z'], dtype=float).mean() > 10
    assert np.abs(np.array(table(tmp_path / '1')['force_z'], dtype=float)).mean() < 10
    assert printed['tare']['force_z'] != 0


def test_each_warning_comes_once(run, make, model, tmp_path):
    columns = make.drifting(seed=3)
    columns['force_z'][9] = 'inf'
    columns['temperature_c'][50:52] = [95.0, 95.0]
    path = make.csv(tmp_path / 'run.csv', columns)
    outcome = run('compensate', model, path, '-o', tmp_path / 'out.csv', '--tare', '30')
    lines = outcome.err.splitlines()
    assert outcome.code == 0
    assert len(lines) == 3
    assert len(set(lines)) == len(lines)
    assert all(line.startswith('warning: ') for line in lines)
    assert 'changed faster than metal can, first at stamp ' in lines[1]
    assert 'the model was learnt from' in lines[2]
