"""The command as a process, its exit codes, and its help."""

import json
import os
from pathlib import Path
import subprocess
import sys

import pytest

import wrist_ft_comp
from wrist_ft_comp.cli import options
from wrist_ft_comp.cli.main import build_parser
from wrist_ft_comp.errors import RecordingError

COMMANDS = ('calibrate', 'evaluate', 'compensate', 'show', 'demo', 'completion')


@pytest.mark.parametrize('command', [(), *((name,) for name in COMMANDS)])
def test_help_has_examples_and_fits_the_screen(command, run, monkeypatch):
    monkeypatch.setenv('COLUMNS', '80')
    outcome = run(*command, '--help')
    assert (outcome.code, outcome.err) == (0, '')
    assert 'examples:\n  wrist_ft_comp' in outcome.out
    assert max(map(len, outcome.out.splitlines())) <= 80


def test_help_names_every_command(run):
    assert all(f'    {command}' in run('--help').out for command in COMMANDS)


def test_the_version_is_the_package_s(run):
    assert run('--version').out.strip() == wrist_ft_comp.__version__


@pytest.mark.parametrize(
    'argv',
    [
        [], ['fly'], ['calibrate'], ['calibrate', 'a.csv'], ['evaluate', 'm.yaml'], ['show'],
        ['compensate', 'm.yaml', 'a.csv'], ['show', 'a', 'b'], ['evaluate', 'a', 'b', '--tare'],
        ['calibrate', 'a', '-o', 'b', '--reference', 'felt'], ['demo', '--speed', '0'],
        ['demo', '--seed', 'x'], ['demo', '--seed', '-1'], ['demo', '--seed', '9' * 19],
        ['demo', '--speed', '0.05'], ['demo', '--speed', '2000'],
        ['show', '--unknown', 'a'], ['demo', '--speed', 'x'],
    ],
)  # fmt: skip
def test_wrong_usage_is_exit_code_2(argv, run):
    outcome = run(*argv)
    assert (outcome.code, outcome.out) == (2, '')
    assert outcome.err.startswith('usage: ')
    assert 'Did you mean' not in outcome.err, 'it is like nothing'


@pytest.mark.parametrize(
    ('argv', 'meant'),
    [
        (['calibrat', 'a.csv'], 'Did you mean calibrate?'),
        (['shwo', 'a.csv'], 'Did you mean show?'),
        (['calibrate', 'a.csv', '--ouput', 'm.yaml'], 'Did you mean --output?'),
        (['calibrate', 'a.csv', '-o', 'm', '--methd=pls'], 'Did you mean --method?'),
        (['calibrate', 'a.csv', '-o', 'm', '--method', 'atuo'], 'Did you mean auto?'),
        (['calibrate', 'a.csv', '-o', 'm', '--features', 'hat'], 'Did you mean hats?'),
        (['evaluate', 'm', 'a', '--reference', 'unload'], 'Did you mean unloaded?'),
        (['completion', 'bahs'], 'Did you mean bash?'),
        (['--verison'], 'Did you mean --version?'),
    ],
)
def test_a_mistyped_word_gets_a_suggestion(argv, meant, run):
    outcome = run(*argv)
    assert (outcome.code, outcome.out) == (2, '')
    assert meant in outcome.err


def test_the_beginning_of_an_option_is_enough(done, drift_csv, tmp_path):
    done('calibrate', drift_csv, '--out', tmp_path / 'm.yaml', '--meth', 'pls')
    assert (tmp_path / 'm.yaml').exists()


def test_words_after_two_dashes_are_names(run):
    assert '--odd.csv does not exist' in run('show', '--', '--odd.csv').sentence


def test_a_mistyped_axis_is_a_warning(done, make, tmp_path):
    columns = make.drifting()
    columns['torqe_x'] = columns.pop('torque_x')
    path = make.csv(tmp_path / 'run.csv', columns)
    out = done('calibrate', path, '-o', tmp_path / 'm.yaml', '--method', 'pls')
    assert 'not understood and not used: torqe_x. Is torqe_x meant to be torque_x' in out


def test_a_long_sentence_is_one_line(run, monkeypatch, drift_csv):
    def fail(*_):
        raise RecordingError('First\nsecond\n  third.. See ../x..')

    monkeypatch.setattr('wrist_ft_comp.cli.show.describe_recording', fail)
    assert run('show', drift_csv).sentence == 'wrist_ft_comp: First second third. See ../x.'


def test_a_reader_that_leaves_is_no_error(process, drift_csv):
    for argv in (['show', drift_csv], ['--help'], ['show', '--help']):
        reading, writing = os.pipe()
        os.close(reading)
        with process(*argv, stdout=writing) as child:
            os.close(writing)
            _, err = child.communicate(timeout=60)
        assert (child.returncode, err) == (0, '')


@pytest.mark.skipif(not Path('/dev/full').exists(), reason='this system has no /dev/full')
def test_a_full_disk_behind_standard_output_is_one_sentence(process, drift_csv):
    with Path('/dev/full').open('w') as full, process('show', drift_csv, stdout=full) as child:
        _, err = child.communicate(timeout=60)
    assert child.returncode == 1
    assert err.count('\n') == 1
    assert err.startswith('wrist_ft_comp: Reading or writing: No space left on device.')


def test_closed_standard_streams_are_no_error(drift_csv, tmp_path):
    for closed in ('>&-', '2>&-', '>&- 2>&-', '<&- >&- 2>&-'):
        target = tmp_path / 'm.yaml'
        shell = f'exec "$0" -m wrist_ft_comp calibrate "$1" -o "$2" --method pls {closed}'
        words = ['/bin/sh', '-c', shell, sys.executable, drift_csv, target]
        done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
        assert (done.returncode, done.stderr) == (0, ''), closed
        assert ('saved as' in done.stdout) is (closed == '2>&-')
        target.unlink()
        shell = f'exec "$0" -m wrist_ft_comp show "$1" {closed}'
        words = ['/bin/sh', '-c', shell, sys.executable, tmp_path / 'no']
        done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
        assert done.returncode == 1
        assert done.stderr.count('\n') == ('2>&-' not in closed)


@pytest.mark.parametrize(
    'case',
    [
        (['show', '/nowhere', '--json'], 1, 'recording'),
        (['evaluate', '/nowhere.yaml', '/nowhere', '--json'], 1, 'recording'),
        (['show', '{csv}', '--picture', 'p.png', '--js'], 1, 'settings'),
        (['evaluate', '{model}', '{csv}', '--report', '/dev/null', '--json'], 1, 'output'),
        (['calibrate', '{csv}', '-o', 'm', '--min-t', '99', '--json'], 1, 'calibration_refused'),
        (['show', '--json', '--picture'], 2, 'usage'),
    ],
)  # fmt: skip
def test_json_tells_of_an_error_too(case, run, drift_csv, model):
    argv, code, kind = case
    outcome = run(*(word.format(csv=drift_csv, model=model) for word in argv))
    (error,) = json.loads(outcome.out).values()
    assert (outcome.code, error['kind']) == (code, kind)
    assert error['message'] in outcome.err
    assert '--json' not in argv or not run(*argv[: argv.index('--json')]).out


def test_json_tells_of_what_the_system_refuses(run, drift_csv, monkeypatch):
    for error, code, kind in ((OSError(28, 'No space left'), 1, 'operating_system'),
                              (KeyboardInterrupt(), 130, 'interrupted')):  # fmt: skip
        monkeypatch.setattr('wrist_ft_comp.cli.show.describe_recording', fail_with(error))
        outcome = run('show', drift_csv, '--json')
        assert (outcome.code, json.loads(outcome.out)['error']['kind']) == (code, kind)


def fail_with(error):
    def fail(*_):
        raise error

    return fail


def test_a_narrow_locale_gets_escapes(process, drift_csv, tmp_path):
    environment = {**os.environ, 'PYTHONIOENCODING': 'ascii'}
    with process('calibrate', drift_csv, '-o', tmp_path / 'm.yaml', '--method', 'pls',
                 stdout=subprocess.PIPE, env=environment) as child:  # fmt: skip
        out, err = child.communicate(timeout=60)
    assert (child.returncode, err) == (0, '')
    assert '\\xb0C' in out


def test_values_below_zero_belong_to_the_option_before_them():
    parser, _ = build_parser()
    argv = ['calibrate', 'a', '-.5', '--hat', '-40,0', '-o', '-1', '--json', '--min-t=2']
    arguments = parser.parse_args(argv)
    assert arguments.hat_temperatures == (-40.0, 0.0)
    assert arguments.output == Path('-1')
    assert arguments.recordings == [Path('a'), Path('-.5')]


def test_json_knows_no_nan(capsys):
    options.print_json({'a': [float('nan'), 1.5, (float('inf'),)], 'b': Path('x')})
    assert json.loads(capsys.readouterr().out) == {'a': [None, 1.5, [None]], 'b': 'x'}


def test_progress_is_told_in_shares(capsys):
    with options.progress_bar('working') as progress:
        for share in (0.1, 0.05, 1.0):
            progress(share)
    assert capsys.readouterr().err == ''
