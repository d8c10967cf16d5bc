"""The executable: how it starts, ends, and what is left when it is killed."""

from contextlib import suppress
import os
import signal

from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
import pytest

from wrist_ft_comp.recordings.read import read_recording
from wrist_ft_comp.stored.state_file import load_state

MODULE = 'wrist_ft_comp.node.compensator_node'
TIMEOUT_S = 60.0


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


def endless(tmp_path):
    """Make a pipe without a writer, which takes the place of a long fit."""
    recording = tmp_path / 'data/endless.csv'
    recording.parent.mkdir()
    os.mkfifo(recording)
    return recording


@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGKILL])
def test_the_end_of_a_node_ends_its_calibration_too(bench, peer, start, tmp_path, number):
    recording = endless(tmp_path)
    process = start('fits', '-p', f'calibration.recordings:=[{recording}]')
    answers = peer('/fits', 'fits').ask('calibrate')
    # Opening the other end waits until the calibration process has opened this one.
    with recording.open('wb'):
        code, errors = process.end(number)
    if number == signal.SIGTERM:
        assert code == 0, errors
        assert 'Traceback' not in errors
        assert 'terminate called' not in errors
        answer = answers.get(timeout=20.0)
        assert answer.message == 'The node is shutting down.'

    def nobody_reads():
        with suppress(OSError):
            os.close(os.open(recording, os.O_WRONLY | os.O_NONBLOCK))
            return False
        return True

    bench.wait_until(nobody_reads, 'the end of the calibration')


def test_a_recording_and_the_thermal_state_survive_the_kill_of_the_process(
    bench, peer, start, make_model, tmp_path
):
    model = make_model('m.yaml', {'force_z': (2.0, 0.0, 600.0)})
    process, driver = (
        start('records', '-p', f'model_file:={model.path}'),
        peer('/records', 'records'),
    )
    assert driver.ask('record', data=True).get(timeout=TIMEOUT_S).success
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
