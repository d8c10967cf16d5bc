from functools import partial
import signal
import sys
import threading
import time

import pytest
from rclpy.node import Node

from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.ros.parameters import declare, EXECUTOR_PARAMETER, Parameter
from wrist_ft_comp.ros.running import make_executor, run_nodes, spin, Stop

MODULE = 'example'
TIMEOUT_S = 20.0


class Example(Node):
    """Every 10 ms its timer does what it was given."""

    def __init__(self, line, **kwargs):
        super().__init__('example', **kwargs)
        speed = Parameter('speed', 1.0, 'How fast.', minimum=0.0)
        declare(self, [EXECUTOR_PARAMETER, speed])
        self.create_timer(0.01, lambda: line(self))


def tell(node):
    """Say what runs the node."""
    sys.stdout.write(f'{type(node.executor).__name__}\n')
    sys.stdout.flush()


def example():
    """Source of a program that runs until a signal."""
    lines = (
        'import runpy, sys',
        f'names = runpy.run_path({__file__!r})',
        "make = lambda **options: [names['Example'](names['tell'], **options)]",
        "sys.exit(names['run_nodes'](make, sys.argv))",
    )
    return {'source': '\n'.join(lines)}


@pytest.mark.parametrize(
    ('choice', 'kind', 'number'),
    [
        ('auto', 'EventsExecutor', signal.SIGTERM),
        ('events', 'EventsExecutor', signal.SIGINT),
        ('default', 'SingleThreadedExecutor', signal.SIGTERM),
    ],
)
def test_signal_ends_the_node_on_the_executor_that_was_chosen(executable, choice, kind, number):
    node = executable(MODULE, '-p', f'executor:={choice}', **example())
    assert node.process.stdout.readline().strip() == kind
    assert node.end(number) == (0, '')


def test_repeated_signals_end_the_node_as_quietly_as_one(executable):
    node = executable(MODULE, **example())
    assert node.process.stdout.readline()
    node.process.send_signal(signal.SIGINT)
    node.process.send_signal(signal.SIGINT)
    assert node.end(signal.SIGTERM) == (0, '')


@pytest.fixture
def run(ros_domain, capfd):  # noqa: ARG001
    """Run a node here that does something in its timer; the exit code, and what was logged."""

    def start(line, *arguments):
        words = ['example', *(['--ros-args', *arguments] if arguments else [])]
        code = run_nodes(lambda **options: [Example(line, **options)], words)
        return code, capfd.readouterr().err

    return start


@pytest.mark.parametrize(
    ('arguments', 'word'),
    [
        (['-p', 'speed:=fast'], "Parameter speed must be a number of at least 0; got 'fast'."),
        (['-p', 'speed'], 'The arguments behind --ros-args cannot be read'),
        (['-p', 'speed:=[1, 2.5]'], 'decimal point'),
        (['-p', 'topics:=[/state:data:K]'], 'need quotes: \'["/state:data[0]"]\'.'),
        (['--nonsense'], '--nonsense'),
    ],
)
def test_bad_argument_is_a_sentence_and_exit_code_1(run, arguments, word):
    code, errors = run(pytest.fail, *arguments)
    assert code == 1
    assert word in errors
    assert 'Traceback' not in errors


@pytest.mark.parametrize('choice', ['auto', 'default'])
def test_error_of_the_family_in_a_callback_is_a_sentence(run, choice):
    def refuse(_):
        raise WristFtCompError('The sensor is gone.')

    code, errors = run(refuse, '-p', f'executor:={choice}')
    assert code == 1
    assert 'The sensor is gone.' in errors
    assert 'Traceback' not in errors


def test_fault_of_ours_keeps_its_traceback(run):
    def fail(_):
        raise ValueError('a fault')

    with pytest.raises(ValueError, match='a fault'):
        run(fail)


def test_shutdown_by_the_node_itself_is_a_normal_end(run):
    assert run(lambda node: node.context.shutdown()) == (0, '')


@pytest.mark.parametrize('choice', ['events', 'default'])
def test_an_overloaded_node_hears_that_it_is_to_stop(bench, choice):
    """Its timer is due again before its callback has ended, so that the queue is never empty."""
    called = threading.Event()

    def overload(_):
        called.set()
        time.sleep(0.015)

    node = bench.make(partial(Example, overload))
    executor, stop = make_executor(choice, bench.context), Stop()
    executor.add_node(node)
    thread = threading.Thread(target=spin, args=(executor, bench.context, stop), daemon=True)
    thread.start()
    assert called.wait(TIMEOUT_S)
    stop.set()
    thread.join(TIMEOUT_S)
    assert not thread.is_alive()
    executor.shutdown()
