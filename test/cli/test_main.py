"""The command as a process: exit codes, help, streams, interruption."""

import fcntl
import json
import os
from pathlib import Path
import pty
import re
import shutil
import signal
import struct
import subprocess
import sys
import termios

import pytest

import wrist_ft_comp
from wrist_ft_comp import __main__ as executables
from wrist_ft_comp.cli.main import build_parser
from wrist_ft_comp.errors import RecordingError

COMMANDS = ('calibrate', 'evaluate', 'compensate', 'show', 'demo')
INTERRUPTED = 'wrist_ft_comp: interrupted; nothing was left half-written.'


@pytest.mark.parametrize('command', [(), *((name,) for name in COMMANDS)])
def test_help_fits_the_screen(command, run, monkeypatch):
    monkeypatch.setenv('COLUMNS', '80')
    outcome = run(*command, '--help')
    assert (outcome.code, outcome.err) == (0, '')
    assert 'exit code: 0 done, 1 refused' in outcome.out
    assert max(map(len, outcome.out.splitlines())) <= 80
    assert command or all(f'    {name}' in outcome.out for name in COMMANDS)
    assert run('--version').out.strip() == wrist_ft_comp.__version__


CALIBRATE = ['calibrate', 'a.csv', '-o', 'm']


@pytest.mark.parametrize(('argv', 'words'), [
    ([], ['required']), (['compensate', 'm.yaml', 'a.csv'], ['--output']),
    (['calibrat', 'a.csv'], ["invalid choice: 'calibrat' (choose from", 'calibrate']),
    ([*CALIBRATE, '--refrence', 'unloaded'], ['unrecognized arguments: --refrence']),
    ([*CALIBRATE, '--reference', 'felt'], ["'felt' (choose from", 'unloaded']),
])  # fmt: skip
def test_wrong_usage_is_exit_code_2_and_names_what_was_expected(argv, words, run):
    outcome = run(*argv)
    assert (outcome.code, outcome.out) == (2, '')
    (line,) = outcome.err.splitlines()
    assert re.match(r'wrist_ft_comp: .* See wrist_ft_comp( [a-z]+)? --help\.$', line)
    assert all(word in line for word in words)


def test_values_below_zero_and_beginnings_of_options_are_understood():
    parser = build_parser()
    argv = ['calibrate', 'a', '-.5', '-o', '-1', '--json', '--thermal-p=0.1']
    arguments = parser.parse_args(argv)
    assert arguments.thermal_period == 0.1, 'a limit is allowed'
    assert arguments.output == Path('-1')
    assert arguments.recordings == [Path('a'), Path('-.5')]


@pytest.mark.parametrize(('error', 'code', 'kind', 'sentence'), [
    (RecordingError('A\nb\n  c.. See ../x..'), 1, 'recording', 'A b c. See ../x.'),
    (OSError(28, 'It is full'), 1, 'operating_system', 'Reading or writing: It is full.'),
    (KeyboardInterrupt(), 130, 'interrupted', 'interrupted; nothing was left half-written.'),
])  # fmt: skip
def test_an_error_is_a_line_and_in_json(error, code, kind, sentence, run, drift_csv, monkeypatch):  # noqa: PLR0913, PLR0917
    def fail(*_):
        raise error

    monkeypatch.setattr('wrist_ft_comp.cli.show.describe_recording', fail)
    outcome = run('show', drift_csv, '--json')
    assert (outcome.code, json.loads(outcome.out)['error']['kind']) == (code, kind)
    assert outcome.err.startswith(f'wrist_ft_comp: {sentence}')
    assert outcome.err.count('\n') == 1


@pytest.mark.parametrize('case', [
    (['show', '/nowhere', '--json'], 1, 'recording'),
    (['show', '{model}', '--picture', 'p.png', '--json'], 1, 'recording'),
    (['evaluate', '{model}', '{csv}', '--report', '/dev/null', '--json'], 1, 'output'),
    (['calibrate', '{csv}', '-o', 'm', '--thermal-p', '600', '--json'],
     1, 'calibration_refused'),
    (['calibrate', '{csv}', '-o', 'm', '--thermal-p', '0', '--json'], 1, 'settings'),
    (['evaluate', '{model}', '{csv}', '--tare', '0', '--json'], 1, 'settings'),
    (['compensate', '{model}', '{csv}', '-o', 'm', '--tare', 'nan', '--json'], 1, 'settings'),
    (['show', '--json', '--picture'], 2, 'usage'),
])  # fmt: skip
def test_json_holds_an_error_too(case, run, drift_csv, model):
    argv, code, kind = case
    outcome = run(*(word.format(csv=drift_csv, model=model) for word in argv))
    (error,) = json.loads(outcome.out).values()
    assert (outcome.code, error['kind']) == (code, kind)
    assert error['message'] in outcome.err
    assert '--json' not in argv or not run(*argv[: argv.index('--json')]).out


def test_a_reader_that_leaves_is_no_error(process, drift_csv):
    for argv in (['show', drift_csv], ['--help']):
        reading, writing = os.pipe()
        os.close(reading)
        with process(*argv, stdout=writing) as child:
            os.close(writing)
            _, err = child.communicate(timeout=60)
        assert (child.returncode, err) == (0, '')
    with process('show', drift_csv, preexec_fn=lambda: os.close(1)) as child:
        assert (child.communicate(timeout=60)[1], child.returncode) == ('', 0)


def test_ctrl_c_while_numpy_is_loaded_is_a_line(monkeypatch, capsys):
    class Loading:
        def __getattr__(self, name):
            raise KeyboardInterrupt

    monkeypatch.setitem(sys.modules, 'wrist_ft_comp.cli.main', Loading())
    code = executables.main()
    assert (code, capsys.readouterr().err) == (130, 'wrist_ft_comp: interrupted.\n')


@pytest.mark.skipif(not Path('/dev/full').exists(), reason='this system has no /dev/full')
def test_a_full_disk_behind_standard_output_is_one_sentence(process, drift_csv):
    with Path('/dev/full').open('w') as full, process('show', drift_csv, stdout=full) as child:
        _, err = child.communicate(timeout=60)
    assert child.returncode == 1
    assert err.count('\n') == 1
    assert 'No space left on device' in err


def test_a_narrow_locale_gets_escapes(process, drift_csv):
    environment = {**os.environ, 'PYTHONIOENCODING': 'ascii'}
    with process('show', drift_csv, stdout=subprocess.PIPE, env=environment) as child:
        out, err = child.communicate(timeout=60)
    assert (child.returncode, err) == (0, '')
    assert '\\xb0C' in out


def test_a_terminal_sees_how_far_long_work_is(process, drift_csv, tmp_path):
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack('4H', 24, 80, 0, 0))
    argv = drift_csv, '-o', tmp_path / 'm.yaml', '--method', 'pls'
    seen = b''
    with process('calibrate', *argv, stdout=subprocess.PIPE, stderr=theirs) as child:
        os.close(theirs)
        try:
            while part := os.read(ours, 4096):
                seen += part
        except OSError:  # the terminal's other end was closed
            pass
        out = child.stdout.read()
    os.close(ours)
    assert child.returncode == 0
    assert out
    assert '100%' not in out
    bar, wiped, _ = seen.decode().rpartition('\x1b[2K')
    assert '100%' in bar
    assert wiped, 'the bar is wiped away in the end'


#: Says so and waits when everything is written and nothing has taken its place yet.
HELD = """
import pathlib, signal, sys
from wrist_ft_comp.cli.main import main

# What a shell starts in the background ignores it, and its children do.
signal.signal(signal.SIGINT, signal.default_int_handler)

def hold(*_):
    print('written', flush=True)
    signal.pause()

pathlib.Path.rename = pathlib.Path.replace = hold
sys.exit(main(sys.argv[1:]))
"""


def contents(folder):
    return {path.name: path.is_file() and path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize('kind', ['model', 'copy'])
def test_ctrl_c_while_saving_leaves_what_was_there(kind, drift_csv, model, tmp_path):
    old = shutil.copy(model, tmp_path / 'm.yaml')
    before = contents(tmp_path)
    argv = {
        'model': ['calibrate', drift_csv, '-o', old, '--method', 'pls'],
        'copy': ['compensate', old, drift_csv, '-o', tmp_path / 'out'],
    }[kind]
    command = [sys.executable, '-c', HELD, *map(str, argv)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, text=True, stdout=pipe, stderr=pipe) as child:
        lines = iter(child.stdout.readline, '')
        assert 'written\n' in lines
        child.send_signal(signal.SIGINT)
        _, err = child.communicate(timeout=60)
    assert (child.returncode, err.splitlines()[-1]) == (130, INTERRUPTED)
    assert contents(tmp_path) == before
