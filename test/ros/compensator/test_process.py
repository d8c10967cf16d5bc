"""The executable: how it starts, ends, and what is left when it is killed."""

from contextlib import suppress
import os
import signal

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='the node tests need ROS 2 (rclpy)')

from std_srvs.srv import Trigger

from wrist_ft_comp.files.recordings import read_recording

MODULE = 'wrist_ft_comp.ros.compensator_node'
TIMEOUT_S = 60.0
START_S = 1_700_000_000
#: The executable, which tells what runs it.
TELL_EXECUTOR = """
import sys
from wrist_ft_comp.ros import compensator_node, running
make = running.make_executor
def tell(*arguments):
    executor = make(*arguments)
    sys.stderr.write(f'runs on {type(executor).__name__}\\n')
    return executor
running.make_executor = tell
sys.exit(compensator_node.main())
"""
signals = pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])


@pytest.fixture
def start(bench, executable, tmp_path):
    """Start the executable under a name of its own, and wait until it is up."""

    def launch(name, *arguments):
        process = executable(
            MODULE,
            *('-r', f'__ns:=/{name}', '-r', f'__node:={name}'),
            *('-p', f'data_directory:={tmp_path / "data"}'),
            *arguments,
            may_be_killed=True,
        )
        bench.wait_for_node(name)
        return process

    return launch


def ends_well(process, number):
    code, errors = process.end(number)
    assert code == 0, errors
    assert 'Traceback' not in errors
    assert 'terminate called' not in errors
    return errors


@pytest.mark.parametrize(
    ('choice', 'number'), [('events', signal.SIGINT), ('default', signal.SIGTERM)]
)
def test_a_signal_ends_the_node_with_exit_code_0(bench, start, choice, number):
    name = f'ends_{choice}_{int(number)}'
    process = start(name, '-p', f'executor:={choice}')
    answer = bench.call(Trigger, f'/{name}/{name}/reset_tare', Trigger.Request())
    assert answer.success
    assert 'no model' in ends_well(process, number)


def test_the_log_says_once_what_the_node_does(bench, start, make_model):
    make_model('a.yaml')
    process = start('says_once', '-p', 'model_file:=models/a.yaml')
    bench.call(Trigger, '/says_once/says_once/reset_tare', Trigger.Request())
    errors = ends_well(process, signal.SIGINT)
    assert errors.count('compensating 1 axis with ') == 1
    assert 'models/a.yaml' in errors


@signals
def test_a_signal_ends_a_calibration_too(bench, peer, start, tmp_path, number):
    """A pipe without a writer takes the place of a long fit."""
    recording = tmp_path / 'data/endless.csv'
    recording.parent.mkdir()
    os.mkfifo(recording)
    name = f'fits_{int(number)}'
    process = start(name, '-p', f'calibration.recordings:=[{recording}]')
    answer = peer(f'/{name}', name).ask('calibrate')
    # Opening the other end waits until the calibration process has opened this one.
    with recording.open('wb'):
        ends_well(process, number)
    bench.wait_until(answer.done, 'the answer')
    assert answer.result().message == 'The node is shutting down; the model is unchanged.'
    with pytest.raises(OSError, match='No such device'):
        os.close(os.open(recording, os.O_WRONLY | os.O_NONBLOCK))  # nobody reads it any more


def rows_of(path):
    """Rows of a recording that are whole."""
    return path.read_bytes().count(b'\n') - 1


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGINT])
def test_a_recording_survives_the_end_of_the_process(bench, peer, start, tmp_path, number):
    name = f'records_{int(number)}'
    process = start(name)
    driver = peer(f'/{name}', name)
    assert driver.call('record', data=True).success
    (path,) = (tmp_path / 'data/recordings').glob('*.csv')

    def has_rows():
        driver.cells()
        return rows_of(path) >= 5

    bench.wait_until(has_rows, 'five rows')
    if number == signal.SIGKILL:
        code, _ = process.end(number)
        assert code == -signal.SIGKILL
    else:
        assert 'thermal cells' in ends_well(process, number)
    recording = read_recording(path)
    assert len(recording) >= 5
    assert (recording.wrench[np.isfinite(recording.wrench)] == 1.0).all()
    assert recording.warnings == ()


def test_a_bad_model_file_is_one_sentence_and_exit_code_1(executable, tmp_path):
    path = tmp_path / 'bad.yaml'
    path.write_text('format: other')
    code, errors = executable(MODULE, '-p', f'model_file:={path}').result()
    assert code == 1
    assert len(errors.splitlines()) == 1, errors
    assert f'{path} is not a model file' in errors
    assert 'Make one with wrist_ft_comp calibrate.' in errors


@pytest.mark.parametrize(
    ('argument', 'words'),
    [
        ('temperature_topics:=[""]', 'temperature_topics must name at least one topic'),
        ('temperature_topics:=["not a topic"]', 'not a topic'),
        ('thermal_period:=0.0', 'from 0.1 to 600 s'),
    ],
)
def test_a_bad_argument_is_a_sentence_and_exit_code_1(executable, argument, words):
    code, errors = executable(MODULE, '-p', argument).result()
    assert code == 1
    assert words in errors
    assert 'Traceback' not in errors


@pytest.mark.parametrize(
    ('choice', 'kind'), [('events', 'EventsExecutor'), ('default', 'SingleThreadedExecutor')]
)
def test_the_executor_is_the_one_that_was_chosen(bench, executable, tmp_path, choice, kind):
    name = f'chooses_{choice}'
    process = executable(
        MODULE,
        *('-r', f'__node:={name}', '-p', f'executor:={choice}'),
        *('-p', f'data_directory:={tmp_path}'),
        source=TELL_EXECUTOR,
    )
    bench.wait_for_node(name)
    assert f'runs on {kind}\n' in ends_well(process, signal.SIGINT)


def test_a_killed_node_leaves_no_calibration_behind(bench, peer, start, tmp_path):
    """A pipe without a writer takes the place of a long fit."""
    recording = tmp_path / 'data/endless.csv'
    recording.parent.mkdir()
    os.mkfifo(recording)
    process = start('killed', '-p', f'calibration.recordings:=[{recording}]')
    peer('/killed', 'killed').ask('calibrate')
    with recording.open('wb'):
        code, _ = process.end(signal.SIGKILL)
        assert code == -signal.SIGKILL

    def nobody_reads():
        with suppress(OSError):
            os.close(os.open(recording, os.O_WRONLY | os.O_NONBLOCK))
            return False
        return True

    bench.wait_until(nobody_reads, 'the end of the calibration')
