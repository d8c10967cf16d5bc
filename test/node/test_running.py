"""How a node starts, runs and ends: on signals, wrong arguments, a wrong environment, faults."""

from functools import partial
import signal
import sys
import threading
import time

import pytest
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node

from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.ros.parameters import Parameter, Parameters
from wrist_ft_comp.ros.rclpy_internals import Stop
from wrist_ft_comp.ros.running import run_node, spin

TIMEOUT_S = 20.0


class Example(Node):
    """Every 10 ms its timer does what it was given."""

    def __init__(self, line, **kwargs):
        super().__init__('example', **kwargs)
        Parameters(self, [Parameter('speed', 1.0, 'How fast.', minimum=0.0)])
        self.create_timer(0.01, lambda: line(self))


def say(node):
    sys.stdout.write(f'{type(node.executor).__name__}\n')
    sys.stdout.flush()


#: A program that runs until a signal.
PROGRAM = f"""
import runpy, sys
names = runpy.run_path({__file__!r})
make = lambda **options: names['Example'](names['say'], **options)
sys.exit(names['run_node'](make, sys.argv, str))
"""


def test_signals_end_the_node_quietly_however_often(executable):
    node = executable('', source=PROGRAM)
    assert node.process.stdout.readline().strip() == 'EventsExecutor'
    for _ in range(2):
        node.process.send_signal(signal.SIGINT)
    assert node.end(signal.SIGTERM) == (0, '')


@pytest.fixture
def run(ros_domain, capfd):  # noqa: ARG001
    """Run a node here that does something in its timer; the exit code, and what was logged."""

    def start(line, *arguments):
        words = ['example', *(['--ros-args', *arguments] if arguments else [])]
        code = run_node(partial(Example, line), words, str)
        return code, capfd.readouterr().err

    return start


def refuse(_):
    raise WristFtCompError('The sensor is gone.')


@pytest.mark.parametrize(('line', 'arguments', 'word'), [
    (pytest.fail, ['-p', 'speed:=fast'], "speed must be a number of at least 0; got 'fast'"),
    (pytest.fail, ['-p', 'speed:=[1, 2.5]'], 'decimal point'),
    (pytest.fail, ['-p', 'topics:=[/state:data:K]'], 'quotes: \'["/state:data[0]"]\'.'),
    (pytest.fail, ['--nonsense'], "['--nonsense']"), (refuse, [], 'The sensor is gone.'),
])  # fmt: skip
def test_a_refusal_is_a_sentence_and_exit_code_1(run, line, arguments, word):
    code, errors = run(line, *arguments)
    assert code == 1
    assert word in errors
    assert 'Traceback' not in errors


def test_a_wrong_environment_is_not_called_a_wrong_argument(executable, monkeypatch):
    monkeypatch.setenv('ROS_LOG_DIR', '/proc/nowhere')
    code, errors = executable('', source=PROGRAM).result()
    assert code == 1
    assert 'ROS 2 does not begin: ' in errors
    assert 'ROS_LOG_DIR' in errors
    assert 'arguments' not in errors
    assert 'Traceback' not in errors


def test_a_fault_of_ours_keeps_its_traceback(run):
    def fail(_):
        raise ValueError('a fault')

    with pytest.raises(ValueError, match='a fault'):
        run(fail)


def test_an_overloaded_node_hears_that_it_is_to_stop(bench):
    """Its timer is due again before its callback has ended, so that the queue is never empty."""
    called = threading.Event()

    def overload(_):
        called.set()
        time.sleep(0.015)

    node = bench.make(partial(Example, overload))
    executor, stop = EventsExecutor(context=bench.context), Stop()
    executor.add_node(node)
    thread = threading.Thread(target=spin, args=(executor, bench.context, stop), daemon=True)
    thread.start()
    assert called.wait(TIMEOUT_S)
    stop.set()
    thread.join(TIMEOUT_S)
    assert not thread.is_alive()
    executor.shutdown()
