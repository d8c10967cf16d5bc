"""The reliability benches, a little of each: that they run, and find nothing."""

import json
import os
from pathlib import Path
import subprocess
import sys

import pytest

pytest.importorskip('rclpy', reason='the benches need ROS 2 (rclpy)')

ROOT = Path(__file__).parents[2]
TIMEOUT_S = 180.0


@pytest.fixture
def run(ros_domain):
    """Run a bench; its exit code and what it printed."""

    def start(name, *words):
        done = subprocess.run(
            [sys.executable, str(ROOT / 'bench' / name), *words],
            env={**os.environ, 'PYTHONPATH': str(ROOT)},
            capture_output=True,
            text=True,
            timeout=TIMEOUT_S,
            check=False,
        )
        return done.returncode, done.stdout + done.stderr

    assert ros_domain
    return start


def test_damaged_inputs_are_taken_or_refused(run):
    code, printed = run('fuzz.py', '200')
    assert code == 0, printed
    for reader in ('wire', 'model file', 'state file', 'list of models', 'CSV', 'mcap', 'sqlite'):
        assert f'{reader} ' in printed


def test_every_file_loads_after_kills(run):
    code, printed = run('kills.py', '3')
    assert code == 0, printed
    assert json.loads(printed)['loaded']['states'] == 3


def test_a_killed_node_goes_on_where_it_was(run):
    code, printed = run('restart.py', '1')
    assert code == 0, printed
    assert 'restarted: off by 0.' in printed


def test_a_killed_node_comes_back(run):
    code, printed = run('comes_back.py', '2')
    assert code == 0, printed
    found = json.loads(printed)
    assert (found['kills'], found['deaf']) == (2, 0)
    assert 0.0 < found['median_s'] <= found['longest_s']


def test_nothing_wrong_comes_out_while_faults_come_in(run):
    """How long the stream was away depends on the machine, so only what came is judged."""
    _, printed = run('endurance.py', '0.15', '--rate', '200')
    found = json.loads(printed)
    assert found['counts']['arrived'] > 0, printed
    assert sum(found['faults'].values()) >= 4
    assert not [what for what in found['counts'] if what.startswith('wrong')], printed
    assert found['tracebacks'] == 0


def test_pauses_are_measured(run):
    code, printed = run('pauses.py')
    assert code == 0, printed
    assert 'go live with 6 h of history' in printed
