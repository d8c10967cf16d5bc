"""The executable: its end, and a kill; what a kill leaves of files: bench/faults kills."""

from contextlib import suppress
import os
import signal

import pytest
from std_srvs.srv import Trigger


@pytest.fixture
def start(bench, executable, tmp_path):
    """Start the executable under a name of its own, and wait until it is up."""

    def launch(name, *arguments):
        folder = tmp_path / 'data'
        words = [
            '-r', f'__ns:=/{name}', '-r', f'__node:={name}', '-p', f'data_directory:={folder}',
        ]  # fmt: skip
        module = 'wrist_ft_comp.node.compensator_node'
        process = executable(module, *words, *arguments, may_be_killed=True)
        bench.wait_for_node(name)
        return process

    return launch


@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGKILL])
def test_the_end_of_a_node_ends_its_calibration_too(bench, start, tmp_path, number):
    """A bag whose metadata is a pipe without a writer stands for a long fit."""
    metadata = tmp_path / 'data/endless/metadata.yaml'
    metadata.parent.mkdir(parents=True)
    os.mkfifo(metadata)
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
