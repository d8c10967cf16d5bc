"""A recording is learnt while wrenches go on, also where that fails."""

import os
import signal
import sys

from moments import SECOND, START
import numpy as np
import pytest

from wrist_ft_comp.stored.model_file import load_model

LOAD = (1.0, 2.0, 3.0, 0.1, 0.2, 0.3)
COMMAND = 'wrist_ft_comp.node.calibration_services.COMMAND'


def stream_goes_on(node, second=0):
    """Tell whether the stream goes on, as it was; each wrench is answered."""
    stamps = START + second * SECOND + np.arange(5)
    return np.allclose(node.stream(stamps, [LOAD] * 5), LOAD, atol=1e-9)


@pytest.fixture
def node(rig, make, haste):  # noqa: ARG001
    """Make a node that has a recording to calibrate from."""
    made = rig()
    (made.directory / 'recordings').mkdir()
    make.csv(made.directory / 'recordings/run.csv', make.drifting())
    return made


def test_a_calibration_answers_and_goes_live_without_a_step_while_wrenches_go_on(node):
    node.warm_up(30.0)
    answers = node.ask('calibrate')

    def answered():
        assert stream_goes_on(node, 3)
        return not answers.empty()

    node.wait_until(answered, 'the answer')
    answer = answers.get()
    assert answer.success, answer.message
    assert stream_goes_on(node, 3), 'a new model makes no step'
    lines, stored = answer.message.splitlines(), node.node.live.stored
    report = stored.path.with_suffix('.html')
    assert lines[-2:] == [f'saved as {stored.path}', f'report: {report}']
    assert 'Is it good?' in report.read_text(encoding='utf-8')
    assert load_model(stored.path).sha256 == stored.sha256
    assert stored.model.axes
    for axis in stored.model.axes:
        assert any(line.startswith(f'{axis}: ') and ' RMS' in line for line in lines), lines
    assert node.node.compensator.compensating


def check_refused(node, said, *words):
    assert not said.success
    assert all(word in said.message for word in words), said.message
    status = node.diagnosis('calibration', 'idle')
    assert status.values['last'] == said.message
    assert stream_goes_on(node)


def python(source):
    return sys.executable, '-c', source


def test_a_second_call_is_refused_and_a_killed_process_is_a_sentence(node, monkeypatch):
    monkeypatch.setattr(COMMAND, python('import time; time.sleep(600)'))
    answers = node.ask('calibrate')
    node.wait_until(lambda: node.node.running_s('~/calibrate') is not None, 'the calibration')
    job = node.node._requests['~/calibrate'].work.gi_yieldfrom.gi_yieldfrom
    process = job.gi_frame.f_locals['process']
    second = node.refusal('calibrate')
    assert 'has been running for ' in second
    assert 'wait for its answer, then call again' in second
    assert node.diagnosis('calibration').message.startswith('running for ')
    assert stream_goes_on(node)
    assert answers.empty()
    os.kill(process._process.pid, signal.SIGKILL)
    words = 'was ended by signal 9 and gave no result', 'The running model stays; call again.'
    check_refused(node, node.answered(answers), *words)


@pytest.mark.parametrize(
    ('command', 'words'),
    [
        (python('raise ValueError("a fault")'), 'code 1 and gave no result (ValueError: a fault)'),
        (python('pass'), 'with code 0 and gave no result (it said nothing)'),
        (python('import sys; sys.stderr.write("x" * 10**6); print("half {")'), 'with code 0'),
        (('/nowhere/python',), 'cannot be started: [Errno 2] No such file'),
    ],
)
def test_a_process_without_a_result_is_a_sentence(node, monkeypatch, command, words):
    monkeypatch.setattr(COMMAND, command)
    check_refused(node, node.call('calibrate'), words, 'call again')


def test_a_model_that_cannot_be_remembered_is_live_with_a_warning(node, make_model, monkeypatch):
    stored = make_model('later.yaml', {'force_z': (2.0, 0.0, 600.0)})

    def find(_job):
        yield
        return {**vars(stored), 'path': str(stored.path), 'message': 'learnt'}

    monkeypatch.setattr('wrist_ft_comp.node.calibration_services.run_job', find)
    (node.directory / 'active.json').mkdir()
    said = node.call('calibrate')
    assert said.success
    assert '\nwarning: ' in said.message
    assert 'active.json cannot be written' in said.message
    assert node.node.live.stored is not None
    assert 'active.json' in node.diagnosis('model', lambda status: status.level == b'\1').message
