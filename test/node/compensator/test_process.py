"""The executable: how it starts, ends, and what is left when it is killed."""

from contextlib import suppress
import os
from pathlib import Path
import signal

import numpy as np
import pytest
from rcl_interfaces.srv import GetParameters
from rclpy.parameter import parameter_value_to_python
import yaml

from wrist_ft_comp.node.parameters import PARAMETERS
from wrist_ft_comp.recordings.read import read_recording

MODULE = 'wrist_ft_comp.node.compensator'


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
        assert answer.message == 'The node is shutting down; the model is unchanged.'

    def nobody_reads():
        with suppress(OSError):
            os.close(os.open(recording, os.O_WRONLY | os.O_NONBLOCK))
            return False
        return True

    bench.wait_until(nobody_reads, 'the end of the calibration')


def rows_of(path):
    """Rows of a recording that are whole."""
    return path.read_bytes().count(b'\n') - 1


def test_a_recording_survives_the_kill_of_the_process(bench, peer, start, tmp_path):
    process, driver = start('records'), peer('/records', 'records')
    assert driver.call('record', data=True).success
    (path,) = (tmp_path / 'data/recordings').glob('*.csv')

    def has_rows():
        driver.cells()
        return rows_of(path) >= 5

    bench.wait_until(has_rows, 'five rows')
    assert process.end(signal.SIGKILL)[0] == -signal.SIGKILL
    recording = read_recording(path)
    assert len(recording) >= 5
    assert (recording.wrench[np.isfinite(recording.wrench)] == 1.0).all()
    assert recording.warnings == ()


def flat(tree, prefix=''):
    """Names with dots, as the node has them."""
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from flat(value, f'{prefix}{key}.')
        else:
            yield f'{prefix}{key}', value


def test_the_file_of_parameters_that_is_installed_is_taken(bench, start):
    path = Path(__file__).parents[3] / 'config/compensator.yaml'
    wanted = dict(flat(yaml.safe_load(path.read_text('utf-8'))['/**']['ros__parameters']))
    assert set(wanted) <= {row.name for row in PARAMETERS}
    start('from_file', '--params-file', str(path))
    request = GetParameters.Request(names=list(wanted))
    answer = bench.call(GetParameters, '/from_file/from_file/get_parameters', request)
    assert [parameter_value_to_python(value) for value in answer.values] == list(wanted.values())
