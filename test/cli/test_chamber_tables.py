"""The requirement on both sensors of the published chamber test, through the command line."""

from contextlib import redirect_stdout
from io import StringIO
import json

import numpy as np
import pytest

from wrist_ft_comp.cli.main import main
from wrist_ft_comp.recordings.chamber_table import compensate_table, read_chamber_table
from wrist_ft_comp.stored.model_file import load_model

TABLES = ('table1_sensor_a_raw.csv', 'table2_sensor_b_raw.csv')


@pytest.fixture(scope='module', params=TABLES)
def fitted(request, make, tmp_path_factory):
    """The table of a sensor, its model, and what the calibration printed in JSON."""
    table, model = make.keller / request.param, tmp_path_factory.mktemp('keller') / 'model.yaml'
    argv = ['calibrate', str(table), '-o', str(model), '--method', 'pls']
    with redirect_stdout(StringIO()) as out:
        assert main([*argv, '--json']) == 0
    return table, model, json.loads(out.getvalue())


def test_the_fit_meets_the_requirement(fitted):
    table, _, printed = fitted
    figures = printed['chamber_tables'][str(table)]
    assert figures['raw']['max_sensitivity_drift'] > 0.05
    assert figures['fitted']['max_sensitivity_drift'] <= 0.010
    assert figures['fitted']['zero_spread'] <= 0.30


@pytest.mark.parametrize('table', TABLES)
def test_the_default_leaves_the_gain_alone_and_zero_drift_holds_at_temperatures_left_out(
    table, done, make, tmp_path
):
    """Between a few temperatures a fit of the gain does more harm than good."""
    path = make.keller / table
    printed = json.loads(done('calibrate', path, '-o', tmp_path / 'm.yaml', '--json'))
    figures = printed['chamber_tables'][str(path)]
    for fitted in ('fitted', 'left out'):
        expected = pytest.approx(figures['raw']['max_sensitivity_drift'], rel=1e-6)
        assert figures[fitted]['max_sensitivity_drift'] == expected
    assert figures['fitted']['zero_spread'] < 0.05 * figures['raw']['zero_spread']
    assert figures['left out']['zero_spread'] < 0.4 * figures['raw']['zero_spread']


@pytest.mark.parametrize('fitted', TABLES[:1], indirect=True)
def test_left_out_temperatures_stand_beside_the_fit_in_units_of_the_table(fitted, done, tmp_path):
    table, model, printed = fitted
    text = done('calibrate', table, '-o', tmp_path / 'm.yaml', '--method', 'pls')
    lines = text.splitlines()
    header = next(line for line in lines if line.endswith('left out'))
    assert header.split() == ['raw', 'fitted', 'left', 'out']
    figures = printed['chamber_tables'][str(table)]
    row = next(line for line in lines if '|K_s|' in line).split()[-3:]
    keys = ('raw', 'fitted', 'left out')
    assert row == [f'{figures[key]["max_sensitivity_drift"]:.4f}' for key in keys]
    assert figures['left out']['zero_spread'] > figures['fitted']['zero_spread']
    assert figures['left out'] != figures['raw']
    assert all(len(line) <= 80 for line in lines[-5:])
    assert text.count('warning: The column of 50 °C') == 1
    judged = done('evaluate', model, table)
    for shown in (text, judged, done('show', model), done('show', table)):
        assert 'output units' in shown
        assert ' N ' not in shown


def test_two_temperatures_have_no_figures_of_leaving_one_out(done, make, tmp_path):
    header, *rows = (make.keller / TABLES[1]).read_text().splitlines()
    cells = [row.split(',') for row in (header, *rows, *rows)]
    path = tmp_path / 'two.csv'
    path.write_text('\n'.join(','.join((*row[:4], row[7])) for row in cells))
    printed = json.loads(done('calibrate', path, '-o', tmp_path / 'm.yaml', '--json'))
    assert set(printed['chamber_tables'][str(path)]) == {'raw', 'fitted'}


def test_a_table_and_a_recording_are_not_mixed(run, make, drift_csv, model, tmp_path):
    table = make.keller / 'table2_sensor_b_raw.csv'
    recording = make.csv(tmp_path / 'loaded.csv', make.loaded())
    options = ('--reference', 'recorded')
    refused = run('calibrate', table, recording, '-o', tmp_path / 'm.yaml', *options)
    assert 'different units' in refused.sentence
    said = run('evaluate', model, drift_csv, table).sentence
    assert 'corrects force_z in N, but the wrenches are in output units.' in said


def test_a_tables_model_corrects_no_newtons(fitted, run, drift_csv, tmp_path):
    of_table = fitted[1]
    for words in (('evaluate', of_table, drift_csv), ('compensate', of_table, drift_csv)):
        output = ('-o', tmp_path / 'out.csv') if words[0] == 'compensate' else ()
        said = run(*words, *output).sentence
        assert 'corrects force_z in output units, but the wrenches are in N. Calibrate' in said
    assert not (tmp_path / 'out.csv').exists()


def test_evaluate_gives_the_figures_and_warnings_of_the_calibration(fitted, run):
    table, model, printed = fitted
    outcome = run('evaluate', model, table, '--json')
    again = json.loads(outcome.out)
    copied = table.name == TABLES[0]
    assert outcome.err.count('The column of 50 °C') == copied
    assert len(printed['warnings']) == copied
    fit = printed['chamber_tables'][str(table)]['fitted']
    assert again['chamber_tables'][str(table)]['compensated'] == pytest.approx(fit)
    assert again['axes']['force_z']['rms_after'] < 0.2 * again['axes']['force_z']['rms_before']
    assert again['recordings'][0]['reference'] == 'recorded'


@pytest.mark.parametrize('comma', [False, True])
@pytest.mark.parametrize('fitted', TABLES[1:], indirect=True)
def test_a_table_with_semicolons_is_the_same_table(comma, fitted, done, tmp_path):
    """As spreadsheets write it where the comma is the decimal point."""
    table, model, printed = fitted
    text = table.read_text().replace(',', ';').replace('_20_c', '_20.0_c')
    path, out = tmp_path / 'table.csv', tmp_path / 'out.csv'
    path.write_text(text.replace('.', ',') if comma else text)
    assert 'chamber table' in done('show', path)
    learnt = ['calibrate', path, '-o', tmp_path / 'model.yaml', '--method', 'pls', '--json']
    figures = json.loads(done(*learnt))['chamber_tables'][str(path)]
    assert figures == printed['chamber_tables'][str(table)]
    done('compensate', model, path, '-o', out)
    expected = compensate_table(read_chamber_table(table), load_model(model).model)
    np.testing.assert_allclose(read_chamber_table(out).output, expected.output, atol=1e-9)
    assert ('.' in out.read_text()) != comma


def test_the_compensated_table_is_a_table_again(fitted, run, tmp_path):
    table, model, _ = fitted
    out = tmp_path / 'out.csv'
    outcome = run('compensate', model, table, '-o', out)
    assert outcome.code == 0
    assert outcome.err.count('warning') == (table.name == TABLES[0])
    source, written = read_chamber_table(table), read_chamber_table(out)
    expected = compensate_table(source, load_model(model).model)
    np.testing.assert_allclose(written.output, expected.output, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(written.load, source.load)
    np.testing.assert_array_equal(written.temperatures_c, source.temperatures_c)
    assert written.output[0, written.reference_column] == pytest.approx(0, abs=1e-9)
