"""Every bad input ends in one sentence: what was expected, what came, where, and what to do."""

import subprocess

import pytest


@pytest.mark.parametrize('command', ['calibrate', 'evaluate', 'evaluate by', 'compensate', 'show'])
@pytest.mark.parametrize('name', ['missing.csv', 'missing.mcap', 'missing', 'x' * 300])
def test_a_missing_file_is_named(command, name, run, model, drift_csv, tmp_path):  # noqa: PLR0913, PLR0917
    path = tmp_path / name
    argv = {
        'calibrate': [path, '-o', tmp_path / 'm.yaml'],
        'evaluate': [model, path],
        'evaluate by': [path, drift_csv],
        'compensate': [model, path, '-o', tmp_path / 'out'],
        'show': [path],
    }[command]
    assert name[:200] in run(command.split()[0], *argv).sentence
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize('content', ['', '\n', '\ufeff', 'hello', '1,2,3\n4,5,6\n', '\0\0\0'])
def test_a_file_that_is_no_recording_is_refused(content, run, model, tmp_path):
    path = tmp_path / 'no.csv'
    path.write_text(content, encoding='utf-8')
    assert 'no.csv' in run('calibrate', path, '-o', tmp_path / 'm.yaml').sentence
    assert 'no.csv' in run('evaluate', model, path).sentence
    assert 'no.csv' in run('compensate', model, path, '-o', tmp_path / 'out.csv').sentence
    assert [each.name for each in tmp_path.iterdir()] == ['no.csv']


def test_a_load_that_was_declared_absent_is_refused(run, make, tmp_path):
    path = make.csv(tmp_path / 'run.csv', make.loaded())
    assert 'jumps' in run('calibrate', path, '-o', tmp_path / 'm.yaml').sentence


def test_model_and_recording_with_other_thermometers_are_refused(run, make, model, tmp_path):
    path = make.csv(tmp_path / 'two.csv', make.drifting(both=True))
    for argv in (['evaluate', model, path], ['compensate', model, path, '-o', tmp_path / 'out']):
        sentence = run(*argv).sentence
        assert '2 thermometers' in sentence
        assert 'expects 1' in sentence


def test_a_recording_named_twice_is_refused(run, drift_csv, tmp_path):
    assert 'twice' in run('calibrate', drift_csv, drift_csv, '-o', tmp_path / 'm.yaml').sentence


def test_model_and_recording_in_each_other_s_place_are_told(run, model, drift_csv, bags, tmp_path):
    for command, more in (('evaluate', []), ('compensate', ['-o', tmp_path / 'out'])):
        for recording in (drift_csv, bags['mcap']):
            sentence = run(command, recording, model, *more).sentence
            assert f'{recording} is a recording, where a model file was expected' in sentence
            assert 'Name the model first' in sentence
        assert 'is a model file, where a recording' in run(command, model, model, *more).sentence


@pytest.mark.parametrize('target', ['/proc/nowhere/m.yaml', '/dev/null/m.yaml', 'file/m.yaml'])
def test_an_unwritable_folder_is_refused(target, run, drift_csv, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'file').touch()
    sentence = run('calibrate', drift_csv, '-o', target, '--method', 'pls').sentence
    assert target.removesuffix('/m.yaml') in sentence


def test_a_process_says_one_line_and_no_traceback(process, tmp_path):
    with process('show', tmp_path / 'no.csv', stdout=subprocess.PIPE) as child:
        out, err = child.communicate(timeout=60)
    assert (child.returncode, out, err.count('\n')) == (1, '', 1)


def test_what_never_ends_is_refused_at_once(run, tmp_path):
    for words in (['show', '/dev/zero'], ['calibrate', '/dev/zero', '-o', tmp_path / 'm.yaml']):
        assert 'is a device, which may never end' in run(*words).sentence
