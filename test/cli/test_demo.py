"""The demonstration without its nodes, and with nodes that fail."""

import contextlib
import io
import os
import subprocess
from types import SimpleNamespace

import pytest

from wrist_ft_comp.cli import demo, options
from wrist_ft_comp.cli.main import main
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.stored.node_folder import HistoryEntry, NodeFolder


@pytest.fixture
def played(monkeypatch, make):
    """Put a node's files where the demonstration looks for them, instead of playing it."""

    def play(folder):
        store = NodeFolder(folder)
        day, model = store.new_recording_path(), store.new_model_path()
        make.csv(day, make.loaded(900))
        model.parent.mkdir()
        words = ['calibrate', day, '-o', model, '--reference', 'recorded', '--method', 'pls']
        with contextlib.redirect_stdout(io.StringIO()):
            assert main([*map(str, words)]) == 0
        make.csv(store.new_recording_path(), make.loaded(900, seed=3))
        store.activate([HistoryEntry(model)])

    monkeypatch.setattr(options, 'find_spec', lambda _: object())
    monkeypatch.setattr(demo, 'play', play)


@pytest.mark.usefixtures('played')
def test_it_ends_with_the_report_and_what_to_do_next_or_fails(run, tmp_path, monkeypatch):
    outcome = run('demo', '--output', tmp_path)
    report = tmp_path / 'demo.html'
    assert outcome.code == 0, outcome
    assert report.read_text().startswith('<!doctype html>')
    (folder,) = tmp_path.glob('demo_*')
    for word in (f': {report}\n', f': {folder}\n', 'PASS: ', ' times smaller; 10 times '):
        assert outcome.out.count(word) == 1
    assert outcome.out.splitlines()[-1] == '  wrist_ft_comp show RECORDING'
    monkeypatch.setattr(demo, '_RATIO', 1e6)
    outcome = run('demo', '--output', tmp_path)
    assert (outcome.code, 'FAIL: ' in outcome.out) == (1, True), 'drift has to fall'
    assert len(list(tmp_path.glob('demo_*'))) == 2, "the first run's files stay"


def listen(recorded_s, **programs):
    """Watch a node that says how long its recording is."""
    statuses = {'calibration': SimpleNamespace(values={'recording_s': recorded_s})}
    operator = SimpleNamespace(wait_for=lambda is_over, _: is_over())
    watch = SimpleNamespace(operator=operator, statuses=statuses)
    demo.listen(watch, 11_400, programs, lambda _: None)


def test_a_day_is_as_long_as_the_node_says_and_one_without_end_is_a_sentence():
    listen('11400')
    with pytest.raises(RecordingError, match='did not record a day within 317 s'):
        listen('11399')


def test_a_program_that_ends_early_is_named_and_what_runs_is_ended(tmp_path):
    log = (tmp_path / 'log').open('wb')
    with log, demo.process('no_such_node', {'a': 1}, log) as failing:
        failing.wait(60)
        with pytest.raises(RecordingError, match=r'sensor of .* ended early'):
            listen('99', sensor=failing)
    assert b'no_such_node' in (tmp_path / 'log').read_bytes()


def test_a_process_is_ended_by_its_own_id(monkeypatch):
    genuine = subprocess.Popen
    script = 'import signal; signal.pause()'
    monkeypatch.setattr(
        demo.subprocess, 'Popen', lambda argv, **more: genuine([argv[0], '-c', script], **more)
    )
    with demo.process('compensator', {}, subprocess.DEVNULL) as process:
        assert process.poll() is None
    assert process.returncode is not None


def test_the_demonstration_keeps_out_of_the_user_s_domain(monkeypatch):
    domain = demo.own_domain()['ROS_DOMAIN_ID']
    assert int(domain) in range(60, 101)
    monkeypatch.setenv('ROS_DOMAIN_ID', domain)
    chosen = demo.own_domain()
    assert chosen['ROS_DOMAIN_ID'] != domain
    assert chosen['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'
    assert os.environ['ROS_DOMAIN_ID'] == domain
