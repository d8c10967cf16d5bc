"""Every bad input ends in one sentence: what was expected, what came, where, and what to do."""

import subprocess
import sys

import pytest
import yaml


@pytest.mark.parametrize('command', ['calibrate', 'evaluate', 'compensate', 'show'])
@pytest.mark.parametrize('name', ['missing.csv', 'missing.mcap', 'missing', 'x' * 300])
def test_a_missing_file_is_named(command, name, run, model, tmp_path):
    path = tmp_path / name
    argv = {
        'calibrate': [path, '-o', tmp_path / 'm.yaml'],
        'evaluate': [model, path],
        'compensate': [model, path, '-o', tmp_path / 'out'],
        'show': [path],
    }[command]
    assert name[:200] in run(command, *argv).sentence
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize('name', ['missing.yaml', 'missing'])
def test_a_missing_model_is_named(name, run, drift_csv, tmp_path):
    assert name in run('evaluate', tmp_path / name, drift_csv).sentence


@pytest.mark.parametrize('content', ['', '\n', '\ufeff', 'hello', '1,2,3\n4,5,6\n', '\0\0\0'])
def test_a_file_that_is_no_recording_is_refused(content, run, model, tmp_path):
    path = tmp_path / 'no.csv'
    path.write_text(content, encoding='utf-8')
    assert 'no.csv' in run('calibrate', path, '-o', tmp_path / 'm.yaml').sentence
    assert 'no.csv' in run('evaluate', model, path).sentence
    assert 'no.csv' in run('compensate', model, path, '-o', tmp_path / 'out.csv').sentence
    assert [each.name for each in tmp_path.iterdir()] == ['no.csv']


def test_bytes_that_are_no_text_are_refused(run, tmp_path):
    path = tmp_path / 'no.csv'
    path.write_bytes(b'stamp_s,force_z\n0,\xff\xfe\n')
    assert 'no.csv' in run('calibrate', path, '-o', tmp_path / 'm.yaml').sentence


@pytest.mark.parametrize(
    ('column', 'expected'),
    [('temperature_c', 'temperature'), ('stamp_s', 'stamp'), ('force_z', 'wrench')],
)
def test_a_missing_column_is_named(column, expected, run, make, tmp_path):
    columns = make.drifting()
    del columns['torque_x'], columns[column]
    path = make.csv(tmp_path / 'run.csv', columns)
    sentence = run('calibrate', path, '-o', tmp_path / 'm.yaml').sentence
    assert expected in sentence
    assert 'run.csv' in sentence


def test_a_cell_that_is_no_number_is_named_with_its_line(run, make, tmp_path):
    columns = make.drifting()
    columns['force_z'][41] = '1,5'.replace(',', ';')
    path = make.csv(tmp_path / 'run.csv', columns)
    sentence = run('calibrate', path, '-o', tmp_path / 'm.yaml').sentence
    assert '43' in sentence
    assert 'force_z' in sentence
    assert '1;5' in sentence


@pytest.mark.parametrize('value', ['nan', 'inf', '-inf'])
@pytest.mark.parametrize('column', ['force_z', 'temperature_c'])
def test_too_many_values_that_are_not_finite_are_refused(column, value, run, make, tmp_path):
    columns = make.drifting()
    for row in range(100, 120):
        columns[column][row] = value
    path = make.csv(tmp_path / 'run.csv', columns)
    sentence = run('calibrate', path, '-o', tmp_path / 'm.yaml').sentence
    assert column in sentence
    assert 'run.csv' in sentence


@pytest.mark.parametrize('how', ['repeat', 'run back'])
def test_stamps_out_of_order_are_refused(how, run, make, tmp_path):
    columns = make.drifting()
    stamps = columns['stamp_s']
    columns['stamp_s'] = [s // 2 for s in stamps] if how == 'repeat' else stamps[::-1]
    path = make.csv(tmp_path / 'run.csv', columns)
    sentence = run('calibrate', path, '-o', tmp_path / 'm.yaml').sentence
    assert 'run.csv' in sentence
    assert 'stamp' in sentence


def test_too_short_a_recording_is_refused(run, make, tmp_path):
    columns = {name: values[:20] for name, values in make.drifting().items()}
    path = make.csv(tmp_path / 'run.csv', columns)
    argv = ['calibrate', path, '-o', tmp_path / 'm.yaml', '--min-temperature-span', '0']
    assert '30' in run(*argv).sentence


def test_a_load_that_was_declared_absent_is_refused(run, make, tmp_path):
    path = make.csv(tmp_path / 'run.csv', make.loaded())
    assert 'jumps' in run('calibrate', path, '-o', tmp_path / 'm.yaml').sentence


def test_model_and_recording_with_other_thermometers_are_refused(run, make, model, tmp_path):
    path = make.csv(tmp_path / 'two.csv', make.drifting(both=True))
    for argv in (['evaluate', model, path], ['compensate', model, path, '-o', tmp_path / 'out']):
        sentence = run(*argv).sentence
        assert '2 thermometers' in sentence
        assert 'expects 1' in sentence


def test_recordings_with_other_thermometers_are_not_mixed(run, make, drift_csv, tmp_path):
    path = make.csv(tmp_path / 'two.csv', make.drifting(both=True))
    sentence = run('calibrate', drift_csv, path, '-o', tmp_path / 'm.yaml').sentence
    assert 'drift.csv has 1 thermometers and two.csv has 2' in sentence


def test_a_recording_named_twice_is_refused(run, drift_csv, tmp_path):
    assert 'twice' in run('calibrate', drift_csv, drift_csv, '-o', tmp_path / 'm.yaml').sentence


@pytest.mark.parametrize('command', ['evaluate', 'compensate'])
def test_model_and_recording_in_each_other_s_place_are_told(  # noqa: PLR0913, PLR0917 -- fixtures
    command, run, model, drift_csv, bags, make, tmp_path
):  # fmt: skip
    more = ['-o', tmp_path / 'out'] if command == 'compensate' else []
    table = make.keller / 'table2_sensor_b_raw.csv'
    for recording in (drift_csv, bags['mcap'], next(bags['mcap'].glob('*.mcap')), table):
        sentence = run(command, recording, model, *more).sentence
        assert f'{recording} is a recording, where a model file was expected' in sentence
        assert 'Name the model first' in sentence
    assert 'is a model file, where a recording' in run(command, model, model, *more).sentence


def test_a_model_is_nothing_to_learn_from(run, model, tmp_path):
    sentence = run('calibrate', model, '-o', tmp_path / 'm.yaml').sentence
    assert 'is a model file, where a recording was expected' in sentence


@pytest.mark.parametrize(
    'content',
    [
        b'',
        b'[1, 2',
        b'a: &x 1\nb: *x\n',
        b'\xff\xfe\x00',
        b'!!python/object:os.system {}',
        b'--- 1',
    ],
)
def test_a_file_that_is_no_model_is_refused(content, run, drift_csv, tmp_path):
    path = tmp_path / 'no.yaml'
    path.write_bytes(content)
    assert 'no.yaml' in run('evaluate', path, drift_csv).sentence


@pytest.mark.parametrize('version', [0, 2, 99, '1', None])
def test_a_model_of_another_version_is_refused(version, run, model, drift_csv, tmp_path):
    document = {**yaml.safe_load(model.read_text()), 'version': version}
    path = tmp_path / 'm.yaml'
    path.write_text(yaml.safe_dump(document))
    assert f'version {version!r}' in run('evaluate', path, drift_csv).sentence


@pytest.mark.parametrize('target', ['/proc/nowhere/m.yaml', '/dev/null/m.yaml'])
def test_an_unwritable_folder_is_refused(target, run, drift_csv):
    assert target in run('calibrate', drift_csv, '-o', target, '--method', 'pls').sentence


def test_a_folder_is_no_model_file(run, drift_csv, tmp_path):
    sentence = run('calibrate', drift_csv, '-o', tmp_path).sentence
    assert str(tmp_path / 'model.yaml') in sentence


def test_a_target_below_a_file_is_refused(run, drift_csv, tmp_path):
    (tmp_path / 'file').touch()
    assert 'no folder' in run('calibrate', drift_csv, '-o', tmp_path / 'file' / 'm.yaml').sentence


def test_a_process_says_one_line_and_no_traceback(tmp_path):
    ended = subprocess.run(
        [sys.executable, '-m', 'wrist_ft_comp.cli.main', 'show', str(tmp_path / 'no.csv')],
        capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    assert (ended.returncode, ended.stdout, ended.stderr.count('\n')) == (1, '', 1)
