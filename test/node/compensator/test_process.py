"""The executable: how it starts, ends, and what is left when it is killed."""

from contextlib import suppress
import os
import queue
import signal

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
import numpy as np
import pytest
from sensor_msgs.msg import Temperature
from std_srvs.srv import SetBool, Trigger

from wrist_ft_comp.recordings.read import read_recording
from wrist_ft_comp.ros.topics import wrench_message
from wrist_ft_comp.stored.state_file import load_state

MODULE = 'wrist_ft_comp.node.compensator_node'
TIMEOUT_S = 60.0
START_S = 1_700_000_000


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


class Driver:
    """Sends to a process's node, over DDS that may lose messages, until it is heard."""

    def __init__(self, bench, namespace):
        self._outputs = bench.listen(WrenchStamped, f'{namespace}/wrench')
        self._raw = bench.publisher(WrenchStamped, f'{namespace}/wrench_raw')
        self._heat = bench.publisher(Temperature, f'{namespace}/temperature')
        self._second = START_S

    def cell(self):
        """Send a thermal cell, with a wrench of one newton that passes."""
        self._second += 1
        warm = Temperature(temperature=25.0)
        warm.header.stamp.sec = self._second
        self._heat.publish(warm)
        sent = wrench_message(self._second * 10**9, 'tool0', [1.0] * 6)
        for _ in range(100):
            self._raw.publish(sent)
            with suppress(queue.Empty):
                while self._outputs.get(timeout=0.2).header.stamp != sent.header.stamp:
                    pass
                return
        raise queue.Empty


def endless(tmp_path):
    """Make a bag whose metadata is a pipe without a writer, which stands for a long fit."""
    metadata = tmp_path / 'data/endless/metadata.yaml'
    metadata.parent.mkdir(parents=True)
    os.mkfifo(metadata)
    return metadata


@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGKILL])
def test_the_end_of_a_node_ends_its_calibration_too(bench, start, tmp_path, number):
    metadata = endless(tmp_path)
    process = start('fits', '-p', f'calibration.recordings:=[{metadata.parent}]')
    answers = bench.ask(Trigger, '/fits/fits/calibrate', Trigger.Request())

    def nobody_reads():
        with suppress(OSError):
            os.close(os.open(metadata, os.O_WRONLY | os.O_NONBLOCK))
            return False
        return True

    # Opening the other end waits until the calibration process has opened this one.
    with metadata.open('wb'):
        code, errors = process.end(number)
        bench.wait_until(nobody_reads, 'the end of the calibration')
    if number == signal.SIGTERM:
        assert code == 0, errors
        assert 'Traceback' not in errors
        assert 'terminate called' not in errors
        answer = answers.get(timeout=20.0)
        assert answer.message == 'The node is shutting down.'


def test_a_recording_and_the_thermal_state_survive_the_kill_of_the_process(
    bench, start, make_model, tmp_path
):
    model = make_model('m.yaml', {'force_z': (2.0, 0.0, 600.0)})
    process = start('records', '-p', f'model_file:={model.path}')
    driver = Driver(bench, '/records')
    assert bench.call(SetBool, '/records/records/record', SetBool.Request(data=True)).success
    (path,) = (tmp_path / 'data/recordings').glob('*.csv')

    def kept():
        driver.cell()
        state = load_state(tmp_path / 'data/state.json')
        return state and state.thermal and path.read_bytes().count(b'\n') > 5

    bench.wait_until(kept, 'five rows and a state')
    assert process.end(signal.SIGKILL)[0] == -signal.SIGKILL
    recording = read_recording(path)
    assert len(recording) >= 5
    assert (recording.wrench[np.isfinite(recording.wrench)] == 1.0).all()
    assert recording.warnings == ()
    start('records')
    shown = bench.listen(DiagnosticArray, '/diagnostics')
    texts = set()

    def restarted():
        texts.update(
            value.value
            for status in shown.get(timeout=TIMEOUT_S).status
            for value in status.values
        )
        return any('saved before the restart is held' in text for text in texts)

    bench.wait_until(restarted, 'the drift from before')
