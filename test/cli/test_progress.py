"""A bar where somebody watches: a terminal of our own."""

import fcntl
import os
import pty
import struct
import subprocess
import sys
import termios

import pytest


def watch(*argv):
    """Run a command whose standard error is a terminal; give exit code, output and bar."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack('4H', 24, 80, 0, 0))
    command = [sys.executable, '-m', 'wrist_ft_comp', *map(str, argv)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=theirs, text=True) as child:
        os.close(theirs)
        seen = b''
        while True:
            try:
                part = os.read(ours, 4096)
            except OSError:  # the terminal's other end was closed
                break
            if not part:
                break
            seen += part
        out = child.stdout.read()
    os.close(ours)
    return child.returncode, out, seen.decode()


@pytest.mark.parametrize('command', ['calibrate', 'evaluate', 'compensate'])
def test_long_work_shows_how_far_it_is(command, drift_csv, model, tmp_path):
    argv = {
        'calibrate': [drift_csv, '-o', tmp_path / 'm.yaml', '--method', 'pls'],
        'evaluate': [model, drift_csv],
        'compensate': [model, drift_csv, '-o', tmp_path / 'out.csv'],
    }[command]
    code, out, seen = watch(command, *argv)
    assert code == 0
    assert out
    assert '%|' in seen
    assert '%|' not in out
    last = seen.rsplit('\r', 1)[-1]
    assert not last.strip(), 'the bar is wiped away in the end'
