"""The commands of a document: every line of every ``sh`` block, run as it is written."""

from contextlib import redirect_stdout
import io
from itertools import chain
import os
from pathlib import Path
import queue
import re
import shlex
import shutil
import signal
import subprocess
import sys

import pytest
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Temperature

from wrist_ft_comp.cli.main import main

ROOT = Path(__file__).parents[3]
#: Modules of the programs that go on, by their names on the PATH.
PROGRAMS = {
    'compensator': 'wrist_ft_comp.node.compensator_node',
    'simulated_sensor': 'wrist_ft_comp.node.simulated_sensor',
}
#: Far above what is normal, so that only a fault hits.
TIMEOUT_S = 240.0


def read_commands(document):
    """Read every command of a document, split as a shell splits it."""
    text = (ROOT / document).read_text('utf-8')
    blocks = re.findall(r'^```sh\n(.*?)^```', text, re.M | re.S)
    return [shlex.split(line) for block in blocks for line in block.splitlines() if line]


def node_of(words):
    """Name the program that a command starts and that goes on; None where it is none."""
    name = words[3] if words[:2] == ['ros2', 'run'] else words[0]
    return name if name in PROGRAMS else None


class Terminal:
    """Runs commands as a reader does, who ends a program before starting it again."""

    def __init__(self, folder):
        self.folder = folder
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def run(self, words):
        if words[0] == 'ros2' and shutil.which('ros2') is None:
            return ''  # only rclpy is installed
        named = [name for word in words for name in self._expanded(word)]
        if named[0] == 'wrist_ft_comp':  # what is imported stays imported
            with redirect_stdout(io.StringIO()) as out:
                code = main(named[1:])
            printed = out.getvalue()
        else:
            done = subprocess.run(
                named, cwd=self.folder, capture_output=True, text=True, timeout=TIMEOUT_S,
                check=False,
            )  # fmt: skip
            code, printed = done.returncode, done.stdout + done.stderr
        assert code == 0, f'{shlex.join(words)}\n{printed}'
        return printed

    def _expanded(self, word):
        if '*' not in word:
            return [word]
        paths = sorted(str(path) for path in self.folder.glob(word))
        assert paths, f'nothing is called {word}'
        return paths

    def start(self, words):
        """Start a program that goes on, by its own name or by ros2 run."""
        name = node_of(words)
        self.end(name)
        program = [sys.executable, '-m', PROGRAMS[name]]
        if words[0] == 'ros2':
            words = words[3:] if shutil.which('ros2') is None else words
            program = program if shutil.which('ros2') is None else ['ros2']
        self._running[name] = subprocess.Popen(
            [*program, *words[1:]], cwd=self.folder, env={**os.environ, 'PYTHONPATH': str(ROOT)},
            start_new_session=True,
        )  # fmt: skip

    def end(self, name=''):
        """End a program, as Ctrl-C does; without a name, all of them, the last one first."""
        for program in [name] if name else list(reversed(self._running)):
            process = self._running.pop(program, None)
            if process is not None and process.poll() is None:
                os.killpg(process.pid, signal.SIGINT)
                process.wait(TIMEOUT_S)


@pytest.fixture
def commands():
    return read_commands


@pytest.fixture
def terminal(tmp_path, monkeypatch):
    """Give a terminal in a folder that looks like the project's root to the commands."""
    for name in ('data', 'config', 'examples'):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    result = Terminal(tmp_path)
    yield result
    result.end()


class Player:
    """Runs a document from its beginning to its end, as a reader who waits where it says so."""

    def __init__(self, bench, terminal):
        self._bench = bench
        self._terminal = terminal

    def play(self, enough, *documents):
        """
        Run documents; a recording is ended when a temperature message is enough.

        What works on files is run when all programs have ended, as the documents say.
        Returned is how many times the drift of force z fell, by the first evaluation.
        """
        fell = []
        for words in chain.from_iterable(map(read_commands, documents)):
            if node_of(words):
                self._start(words)
                continue
            if words[0] == 'wrist_ft_comp' and words[1] != 'node':
                self._terminal.end()
            if words[1:] == ['node', 'stop']:
                self._wait(enough)
            printed = self._terminal.run(words)
            if words[1] == 'evaluate':
                row = next(line.split() for line in printed.splitlines() if 'force_z' in line)
                fell.append(float(row[3]) / float(row[4]))
        return fell[0]

    def _start(self, words):
        """Start a program; a compensator is started with nothing else running."""
        if node_of(words) == 'compensator':
            self._terminal.end()
            self._bench.wait_until(lambda: not self._node_is_there(), 'the end of the one before')
        self._terminal.start(words)
        if node_of(words) == 'compensator':
            self._bench.wait_until(self._node_is_there, 'the node')

    def _node_is_there(self):
        # Names of nodes that have ended may stay in the graph; what they publish does not.
        topics = self._bench.helper.get_topic_names_and_types()
        return any(name.endswith('/wrist_ft_comp/drift') for name, _ in topics)

    def _wait(self, enough):
        """Wait for a temperature that is enough; the simulation begins without this listener."""
        helper, temperatures = self._bench.helper, queue.Queue()
        heard = helper.create_subscription(
            Temperature, 'temperature_2', temperatures.put, qos_profile_sensor_data
        )
        while not enough(temperatures.get(timeout=TIMEOUT_S)):
            pass
        helper.destroy_subscription(heard)


@pytest.fixture
def play(bench, terminal, monkeypatch):
    """Give what runs a document; programs that go on end with the test."""
    monkeypatch.setenv('ROS_HOME', str(terminal.folder / 'ros_home'))
    # A node at hundreds of times real time answers late where other programs run, too.
    monkeypatch.setattr('wrist_ft_comp.cli.service_calls.DISCOVERY_S', TIMEOUT_S / 4)
    return Player(bench, terminal).play
