import signal

import pytest

#: Runs until a signal; every 10 ms its timer does the line in its place.
SOURCE = """
import sys
from rclpy.node import Node
from wrist_ft_comp.errors import SettingsError, WristFtCompError
from wrist_ft_comp.ros.parameters import EXECUTOR_PARAMETER, Parameter, declare
from wrist_ft_comp.ros.running import run_nodes

class Example(Node):
    def __init__(self, **kwargs):
        super().__init__('example', **kwargs)
        declare(self, [EXECUTOR_PARAMETER, Parameter('speed', 1.0, 'How fast.', minimum=0.0)])
        self.create_timer(0.01, self.tick)

    def tick(self):
        LINE

code = run_nodes(lambda **options: [Example(**options)], sys.argv)
print('code', code)
sys.exit(code)
"""
MODULE = 'example'


def example(line='pass'):
    return {'source': SOURCE.replace('LINE', line)}


@pytest.mark.parametrize(
    ('choice', 'kind', 'number'),
    [
        ('auto', 'EventsExecutor', signal.SIGTERM),
        ('events', 'EventsExecutor', signal.SIGINT),
        ('default', 'SingleThreadedExecutor', signal.SIGTERM),
    ],
)
def test_signal_ends_the_node_on_the_executor_that_was_chosen(executable, choice, kind, number):
    tell = 'print(type(self.executor).__name__, flush=True)'
    node = executable(MODULE, '-p', f'executor:={choice}', **example(tell))
    assert node.process.stdout.readline().strip() == kind
    assert node.end(number) == (0, '')


def test_repeated_signals_end_the_node_as_quietly_as_one(bench, executable):
    node = executable(MODULE, '-r', '__node:=example_repeated', **example())
    bench.wait_for_node('example_repeated')
    node.process.send_signal(signal.SIGINT)
    node.process.send_signal(signal.SIGINT)
    assert node.end(signal.SIGTERM) == (0, '')


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
def test_bad_argument_is_a_sentence_and_exit_code_1(executable, arguments, word):
    code, errors = executable(MODULE, *arguments, **example()).result()
    assert code == 1
    assert word in errors
    assert 'Traceback' not in errors


@pytest.mark.parametrize('choice', ['auto', 'default'])
def test_error_of_the_family_in_a_callback_is_a_sentence(executable, choice):
    line = "raise WristFtCompError('The sensor is gone.')"
    code, errors = executable(MODULE, '-p', f'executor:={choice}', **example(line)).result()
    assert code == 1
    assert 'The sensor is gone.' in errors
    assert 'Traceback' not in errors


def test_fault_of_ours_keeps_its_traceback(executable):
    code, errors = executable(MODULE, **example("raise ValueError('a fault')")).result()
    assert code == 1
    assert 'Traceback' in errors
    assert 'ValueError: a fault' in errors


def test_shutdown_by_the_node_itself_is_a_normal_end(executable):
    code, errors = executable(MODULE, **example('self.context.shutdown()')).result()
    assert (code, errors) == (0, '')
