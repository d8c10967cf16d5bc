"""Recordings with a known drift, and the command line run in this process."""

import subprocess
import sys
from types import SimpleNamespace
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
        """The one line of a refusal."""
        lines = self.err.splitlines()
        assert self.code == 1, self
        assert len(lines) == 1, self.err
        assert not self.out, self.out
        assert lines[0].startswith('wrist_ft_comp: ')
        assert lines[0].endswith('.')
        assert 'Traceback' not in self.err
        return lines[0]


@pytest.fixture(autouse=True, scope='module')
def quick_reports(without_pictures):
    """Nobody looks at the pictures of these reports."""


@pytest.fixture
def run(capsys):
    """Run a command in this process."""

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
    """Start a command as a process of its own."""

    def start(*argv, **more):
        command = [sys.executable, '-m', 'wrist_ft_comp', *map(str, argv)]
        return subprocess.Popen(command, text=True, **{'stderr': subprocess.PIPE, **more})

    return start


def warm_up(seconds, seed=0):
    """A warm-up, sampled once a second, with two thermometers."""
    rng = np.random.default_rng(seed)
    t = np.arange(seconds, dtype=float)
    inside = 20 + 12 * (1 - np.exp(-t / 150)) + 3 * np.sin(t / rng.uniform(60, 90))
    outside = 20 + 6 * (1 - np.exp(-t / 400)) + 2 * np.sin(t / 150)
    return {
        'stamp_s': t.tolist(),
        'temperature_c': inside.tolist(),
        'temperature_2_c': outside.tolist(),
    }


def drifting(seconds=400, seed=0, *, both=False, offset=3.0):
    """An unloaded recording: force z drifts with the temperatures, torque x hardly."""
    columns = warm_up(seconds, seed)
    rng = np.random.default_rng(seed + 100)
    inside = np.array(columns['temperature_c'])
    outside = np.array(columns['temperature_2_c'])
    drift = 1.5 * (inside - 20) - (0.8 * (outside - 20) if both else 0.0)
    force = offset + drift + rng.normal(0, 0.02, seconds)
    torque = 0.01 * (inside - 20) + rng.normal(0, 0.001, seconds)
    if not both:
        del columns['temperature_2_c']
    return {**columns, 'force_z': force.tolist(), 'torque_x': torque.tolist()}


def loaded(seconds=600, seed=0):
    """A loaded recording with its reference: zero 0.5 N/K, gain -0.2 %/K."""
    columns = warm_up(seconds, seed)
    del columns['temperature_2_c']
    rng = np.random.default_rng(seed + 200)
    inside = np.array(columns['temperature_c'])
    load = np.repeat(rng.uniform(-50, 50, seconds // 5), 5)[:seconds]
    load[:60] = 0.0
    raw = (1 - 0.002 * (inside - 20)) * load + 0.5 * (inside - 20) + rng.normal(0, 0.01, seconds)
    return {**columns, 'force_z': raw.tolist(), 'reference_force_z': load.tolist()}


@pytest.fixture(scope='session')
def drift_csv(tmp_path_factory, write_table):
    """One thermometer, unloaded."""
    return write_table(tmp_path_factory.mktemp('csv') / 'drift.csv', drifting())


@pytest.fixture(scope='session')
def model(tmp_path_factory, drift_csv):
    """A model of that recording; read-only."""
    path = tmp_path_factory.mktemp('model') / 'model.yaml'
    assert main(['calibrate', str(drift_csv), '-o', str(path), '--method', 'pls']) == 0
    return path


@pytest.fixture(scope='session')
def report(tmp_path_factory, model, drift_csv):
    """A report of that model; read-only."""
    path = tmp_path_factory.mktemp('report') / 'report.html'
    assert main(['evaluate', str(model), str(drift_csv), '--report', str(path)]) == 0
    return path


@pytest.fixture(scope='session')
def bags(tmp_path_factory, messages):
    """Bags of both storages: 200 Hz wrenches, 2 Hz temperatures of an accelerated warm-up."""
    rng = np.random.default_rng(0)
    t = np.arange(18_000) / 200
    inside = 20 + 15 * (1 - np.exp(-t / 25)) + 2 * np.sin(t / 4 + rng.uniform(0, 6))
    wrenches = np.tile([0.1, -0.2, 0.0, 0.01, 0.02, 0.03], (len(t), 1))
    wrenches[:, 2] = 1.0 + 2.0 * (inside - 20) + rng.normal(0, 0.05, len(t))
    stamps_ns = 1_700_000_000_000_000_000 + 5 * 10**6 * np.arange(len(t))
    folder = tmp_path_factory.mktemp('bags')
    return {
        storage: messages.write(
            folder / storage, messages.run(stamps_ns, wrenches, inside), storage
        )
        for storage in ('sqlite3', 'mcap')
    }


@pytest.fixture(scope='session')
def make(write_table):
    """The builders above, for tests: fixtures are what importlib mode shares."""
    return SimpleNamespace(csv=write_table, drifting=drifting, loaded=loaded)
