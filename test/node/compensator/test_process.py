"""The executable: its end, and a kill; what a kill leaves of files: bench/faults kills."""

from contextlib import suppress
import os
import signal

import pytest
from std_srvs.srv import Trigger


@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGKILL])
def test_the_end_of_a_node_ends_its_calibration_too(bench, executable, tmp_path, number):
    """A bag whose metadata is a pipe without a writer stands for a long fit."""
    metadata = tmp_path / 'data/endless/metadata.yaml'
    metadata.parent.mkdir(parents=True)
    os.mkfifo(metadata)
    given = f'data_directory:={tmp_path / "data"}', f'calibration.recordings:=[{metadata.parent}]'
    words = ['-r', '__ns:=/fits', '-r', '__node:=fits', '-p', given[0], '-p', given[1]]
    process = executable('wrist_ft_comp.node.compensator_node', *words, may_be_killed=True)
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
