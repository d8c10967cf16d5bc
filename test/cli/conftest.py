"""The command line run in this process, its models and bags."""

import subprocess
import sys
from typing import NamedTuple

import numpy as np
import pytest

from wrist_ft_comp.cli.main import main


class Outcome(NamedTuple):
    """What a command left: exit code, standard output, standard error."""

    code: int
    out: str
    err: str

    @property
    def sentence(self):
        assert (self.code, self.out) == (1, ''), self
        (line,) = self.err.splitlines()
        assert line.startswith('wrist_ft_comp: ')
        assert line.endswith('.')
        return line


@pytest.fixture(autouse=True, scope='module')
def quick_reports(without_pictures):
    """Nobody looks at the pictures of these reports."""


@pytest.fixture
def run(capsys):
    def invoke(*argv):
        capsys.readouterr()
        try:
            code = main([str(word) for word in argv])
        except SystemExit as stop:
            code = int(stop.code or 0)
        return Outcome(code, *capsys.readouterr())

    return invoke


@pytest.fixture
def done(run):
    """Run a command that has to succeed; gives its standard output."""

    def invoke(*argv):
        outcome = run(*argv)
        assert outcome.code == 0, outcome
        return outcome.out

    return invoke


@pytest.fixture
def process():
    def start(*argv, **more):
        command = [sys.executable, '-m', 'wrist_ft_comp', *map(str, argv)]
        return subprocess.Popen(command, text=True, **{'stderr': subprocess.PIPE, **more})

    return start


@pytest.fixture(scope='session')
def drift_csv(tmp_path_factory, make):
    """One thermometer, unloaded."""
    return make.csv(tmp_path_factory.mktemp('csv') / 'drift.csv', make.drifting())


@pytest.fixture(scope='session')
def model(tmp_path_factory, drift_csv):
    """A model of that recording; read-only."""
    path = tmp_path_factory.mktemp('model') / 'model.yaml'
    assert main(['calibrate', str(drift_csv), '-o', str(path), '--method', 'pls']) == 0
    return path


@pytest.fixture(scope='session')
def bags(tmp_path_factory, messages):
    """Bags of both storages: 200 Hz wrenches, 2 Hz temperatures of an accelerated warm-up."""
    rng = np.random.default_rng(0)
    t = np.arange(4500) / 200
    inside = 20 + 15 * (1 - np.exp(-t / 25)) + 2 * np.sin(t / 4 + rng.uniform(0, 6))
    wrenches = np.tile([0.1, -0.2, 0.0, 0.01, 0.02, 0.03], (len(t), 1))
    wrenches[:, 2] = 1.0 + 2.0 * (inside - 20) + rng.normal(0, 0.05, len(t))
    stamps_ns = 1_700_000_000_000_000_000 + 5 * 10**6 * np.arange(len(t))
    folder = tmp_path_factory.mktemp('bags')
    written = {}
    for storage in ('sqlite3', 'mcap'):
        parts = messages.run(stamps_ns, wrenches, inside)
        written[storage] = messages.write(folder / storage, parts, storage)
    return written
