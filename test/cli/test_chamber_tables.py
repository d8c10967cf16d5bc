"""The requirement on both sensors of the published chamber test, through the command line."""

import json

import numpy as np
import pytest

from wrist_ft_comp.calibration.chamber import compensate_table
from wrist_ft_comp.files.chamber_table import read_chamber_table
from wrist_ft_comp.files.model_file import load_model

#: Raw max |K_s|, %FS/°C, and zero spread, %FS, of both tables.
RAW = {
    'table1_sensor_a_raw.csv': (0.0687, 5.36),
    'table2_sensor_b_raw.csv': (0.1444, 7.51),
}
both = pytest.mark.parametrize('name', RAW)


@pytest.fixture(scope='module')
def known():
    return {}


@pytest.fixture
def fitted(done, make, known, tmp_path_factory):
    """Calibrate a sensor once; gives the model and what was said in text and JSON."""

    def fit(name, *options):
        if (name, *options) not in known:
            model = tmp_path_factory.mktemp('keller') / 'model.yaml'
            argv = ('calibrate', make.keller / name, '-o', model, *options)
            known[(name, *options)] = model, done(*argv), json.loads(done(*argv, '--json'))
        return known[(name, *options)]

    return fit


@both
def test_the_fit_meets_the_requirement(name, fitted, make):
    _, _, found = fitted(name)
    figures = found['chamber_tables'][str(make.keller / name)]
    k_s, spread = RAW[name]
    assert figures['raw']['max_sensitivity_drift'] == pytest.approx(k_s, abs=5e-5)
    assert figures['raw']['zero_spread'] == pytest.approx(spread, abs=5e-3)
    assert figures['fitted']['max_sensitivity_drift'] <= 0.010
    assert figures['fitted']['zero_spread'] <= 0.30


@both
def test_left_out_temperatures_stand_beside_the_fit(name, fitted, make):
    _, text, found = fitted(name)
    lines = text.splitlines()
    header = next(line for line in lines if line.endswith('left out'))
    assert header.split() == ['raw', 'fitted', 'left', 'out']
    figures = found['chamber_tables'][str(make.keller / name)]
    printed = next(line for line in lines if '|K_s|' in line).split()[-3:]
    keys = ('raw', 'fitted', 'left out')
    assert printed == [f'{figures[key]["max_sensitivity_drift"]:.4f}' for key in keys]
    assert figures['left out']['zero_spread'] > figures['fitted']['zero_spread']
    assert figures['left out'] != figures['raw']
    assert all(len(line) <= 80 for line in lines[-5:])


def test_the_copied_column_is_left_out_and_said_so(fitted, run, make):
    name = 'table1_sensor_a_raw.csv'
    model, text, found = fitted(name)
    assert 'warning: The column of 50 °C' in text
    assert any('50 °C' in warning for warning in found['warnings'])
    outcome = run('evaluate', model, make.keller / name)
    assert outcome.code == 0
    assert outcome.err.count('50 °C') == 1


def test_a_table_is_in_units_of_its_own(done, make, tmp_path):
    table, model = make.keller / 'table2_sensor_b_raw.csv', tmp_path / 'm.yaml'
    said = [done('calibrate', table, '-o', model), done('show', model), done('show', table)]
    said.append(done('evaluate', model, table))
    for text in said:
        assert 'output units' in text
        assert ' N ' not in text


def test_a_table_and_a_recording_are_not_mixed(run, make, drift_csv, model, tmp_path):
    table = make.keller / 'table2_sensor_b_raw.csv'
    recording = make.csv(tmp_path / 'loaded.csv', make.loaded())
    options = ('--reference', 'recorded')
    refused = run('calibrate', table, recording, '-o', tmp_path / 'm.yaml', *options)
    assert 'different units' in refused.sentence
    assert 'different units' in run('evaluate', model, table, drift_csv).sentence


@both
def test_evaluate_gives_the_figures_of_the_calibration(name, fitted, done, make):
    model, _, found = fitted(name)
    path = make.keller / name
    again = json.loads(done('evaluate', model, path, '--json'))
    fit = found['chamber_tables'][str(path)]['fitted']
    assert again['chamber_tables'][str(path)]['compensated'] == pytest.approx(fit)
    assert again['axes']['force_z']['rms_after'] < 0.2 * again['axes']['force_z']['rms_before']
    assert again['recordings'][0]['reference'] == 'recorded'


@both
def test_the_compensated_table_is_a_table_again(name, fitted, run, make, tmp_path):
    model, _, _ = fitted(name)
    out = tmp_path / 'out.csv'
    outcome = run('compensate', model, make.keller / name, '-o', out)
    assert outcome.code == 0
    assert outcome.err.count('warning') == (1 if 'table1' in name else 0)
    source = read_chamber_table(make.keller / name)
    expected = compensate_table(source, load_model(model).model)
    found = read_chamber_table(out)
    np.testing.assert_allclose(found.output, expected.output, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(found.load, source.load)
    np.testing.assert_array_equal(found.temperatures_c, source.temperatures_c)
    assert found.output[0, found.reference_column] == pytest.approx(0, abs=1e-9)
