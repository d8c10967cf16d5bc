"""Ctrl-C at the worst moment: a real SIGINT, and what it leaves on the disk."""

import signal
import subprocess
import sys

import pytest

SENTENCE = 'wrist_ft_comp: interrupted; nothing was left half-written.'
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


def interrupt(argv):
    """Run until all is written, press Ctrl-C, and give what was said."""
    command = [sys.executable, '-c', HELD, *map(str, argv)]
    pipes = {'stdout': subprocess.PIPE, 'stderr': subprocess.PIPE}
    with subprocess.Popen(command, text=True, **pipes) as child:
        line = child.stdout.readline()
        while line and line != 'written\n':
            line = child.stdout.readline()
        child.send_signal(signal.SIGINT)
        _, err = child.communicate(timeout=60)
    assert line == 'written\n', err
    return child.returncode, err


def test_ctrl_c_while_saving_keeps_the_old_model(drift_csv, model, tmp_path):
    target = tmp_path / 'm.yaml'
    target.write_bytes(model.read_bytes())
    before = contents(tmp_path)
    code, err = interrupt(['calibrate', drift_csv, '-o', target, '--method', 'pls'])
    assert (code, err.splitlines()[-1]) == (130, SENTENCE)
    assert contents(tmp_path) == before


def test_ctrl_c_while_reporting_keeps_the_old_report(drift_csv, model, tmp_path):
    target = tmp_path / 'r.html'
    old = '<meta name="generator" content="wrist_ft_comp report">'
    target.write_text(old)
    code, err = interrupt(['evaluate', model, drift_csv, '--report', target])
    assert (code, err.splitlines()[-1]) == (130, SENTENCE)
    assert contents(tmp_path) == {'r.html': old.encode()}


@pytest.mark.parametrize('kind', ['csv', 'sqlite3', 'mcap'])
def test_ctrl_c_while_compensating_leaves_nothing(kind, drift_csv, bags, model, tmp_path):
    source = drift_csv if kind == 'csv' else bags[kind]
    code, err = interrupt(['compensate', model, source, '-o', tmp_path / 'out'])
    assert (code, err.splitlines()[-1]) == (130, SENTENCE)
    assert contents(tmp_path) == {}


def test_ctrl_c_while_the_program_loads_is_one_sentence():
    """Also where the code that is being loaded would swallow it."""
    code = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
class Loader:
    def find_spec(self, name, *_):
        if name == 'numpy':
            try:
                os.kill(os.getpid(), signal.SIGINT)
            except KeyboardInterrupt:
                raise ImportError(name)
sys.meta_path.insert(0, Loader())
from wrist_ft_comp.cli.entry import main
sys.exit(main())
"""
    words = [sys.executable, '-c', code]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr, done.stdout) == (130, f'{SENTENCE}\n', '')
