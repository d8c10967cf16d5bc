"""What ~/calibrate says where it gives no model, while the wrenches go on."""

import os
import signal
import sys

import numpy as np
import pytest

START = 1_700_000_000_000_000_000
pytestmark = pytest.mark.usefixtures('haste')
LOAD = (1.0, 2.0, 3.0, 0.1, 0.2, 0.3)
COMMAND = 'wrist_ft_comp.node.jobs.COMMAND'


def begin(node):
    """Call calibrate; return where the answer comes, and the process."""
    answers = node.ask('calibrate')
    node.wait_until(lambda: node.node.running_s('~/calibrate') is not None, 'the calibration')
    job = node.node._requests['~/calibrate'].work.gi_yieldfrom.gi_yieldfrom
    return answers, job.gi_frame.f_locals['process']


def stream_goes_on(node):
    """Tell whether the stream goes on; each wrench is answered."""
    stamps = START + np.arange(50)
    return (node.stream(stamps, [LOAD] * 50) == LOAD).all()


def python(source):
    return sys.executable, '-c', source


@pytest.fixture
def ready(rig, make):
    """Make a node that has a recording to calibrate from, perhaps one of little heat."""

    def start(share=1.0, **options):
        node, columns = rig(**options), make.drifting()
        columns['temperature_c'] = [20 + share * (t - 20) for t in columns['temperature_c']]
        (node.directory / 'recordings').mkdir()
        make.csv(node.directory / 'recordings/run.csv', columns)
        return node

    return start


def check_refused(node, said, *words):
    assert not said.success
    assert all(word in said.message for word in words), said.message
    status = node.diagnosis('calibration', lambda status: status.level != b'\0')
    assert status.values['last'] == said.message
    assert stream_goes_on(node)


def test_too_small_a_span_leaves_the_live_model(ready, make_model):
    live = make_model('live.yaml', {'torque_z': (0.0, 0.0, 0.0)})
    node = ready(0.1, model=live)
    said = node.call('calibrate')
    check_refused(node, said, 'spans 1.', 'at least 3.0 K are needed', 'Record a warm-up')
    assert 'gave no result' not in said.message
    assert node.node.live.stored.sha256 == live.sha256
    assert [path.name for path in (node.directory / 'models').iterdir()] == ['live.yaml']


def test_a_second_call_is_refused_and_a_killed_process_is_a_sentence(ready, monkeypatch):
    node = ready()
    with monkeypatch.context() as patch:
        patch.setattr(COMMAND, python('import time; time.sleep(600)'))
        answers, process = begin(node)
    second = node.refusal('calibrate')
    assert 'has been running for ' in second
    assert 'wait for its answer, then call again' in second
    assert node.diagnosis('calibration').message.startswith('running for ')
    assert stream_goes_on(node)
    assert answers.empty()
    os.kill(process.pid, signal.SIGKILL)
    node.wait_until(lambda: not answers.empty(), 'the answer')
    check_refused(
        node,
        answers.get(),
        'The calibration process was ended by signal 9 and gave no result',
        'The running model stays; call again.',
    )
    assert node.call('calibrate').success


@pytest.mark.parametrize(
    ('command', 'words'),
    [
        (python('raise ValueError("a fault")'), 'code 1 and gave no result (ValueError: a fault)'),
        (python('pass'), 'with code 0 and gave no result (it said nothing)'),
        (python('import sys; sys.stderr.write("x" * 10**6); print("half {")'), 'with code 0'),
        (('/nowhere/python',), 'cannot be started: [Errno 2] No such file'),
    ],
)
def test_a_process_without_a_result_is_a_sentence(ready, monkeypatch, command, words):
    node = ready()
    monkeypatch.setattr(COMMAND, command)
    check_refused(node, node.call('calibrate'), words, 'call again')


def test_a_model_that_cannot_be_remembered_is_live_with_a_warning(ready):
    node = ready()
    (node.directory / 'active.json').mkdir()
    said = node.call('calibrate')
    assert said.success
    assert '\nwarning: ' in said.message
    assert 'active.json cannot be written' in said.message
    assert node.node.live.stored is not None
    assert 'active.json' in node.diagnosis('model', lambda status: status.level == b'\1').message
