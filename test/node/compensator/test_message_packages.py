"""Packages of messages as drivers bring them, built from their definitions, over DDS."""

import ctypes
from importlib import import_module
from pathlib import Path
import shlex
import sys

from geometry_msgs.msg import TransformStamped
import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
import yaml

from wrist_ft_comp.cli.main import main

BUILT = Path(__file__).parents[3] / 'build/messages'
pytestmark = pytest.mark.skipif(
    not BUILT.with_name('.messages').exists(),
    reason='no messages are built: make build/.messages (cmake, ninja, a C++ compiler)',
)
SECOND = 1_000_000_000
START = 1_700_000_000
#: A process that publishes the message of another version of the package.
OLDER = f"""
import ctypes, pathlib, sys, time
{{load}}
load(sys, ctypes, pathlib.Path({str(BUILT / 'older')!r}))
import rclpy
from flange_msgs.msg import State
rclpy.init()
state = rclpy.create_node('older').create_publisher(State, {{topic!r}}, 10)
while True:
    state.publish(State(voltage=24.1))
    time.sleep(0.02)
"""
LOAD = """
def load(sys, ctypes, prefix):
    sys.path[:0] = map(str, prefix.glob('lib/python3*/site-packages'))
    for library in sorted(prefix.glob('lib/*.so')):
        ctypes.CDLL(str(library))
"""


@pytest.fixture(scope='module')
def packages(ros_domain):  # noqa: ARG001
    """Let the packages be imported here; libraries are found by name once they are loaded."""
    path, loaded = list(sys.path), set(sys.modules)
    scope = {}
    exec(LOAD, scope)  # noqa: S102 -- as other processes do
    scope['load'](sys, ctypes, BUILT / 'install')
    yield import_module('flange_msgs.msg').State, import_module('tf2_msgs.msg').TFMessage
    sys.path[:] = path
    for name in set(sys.modules) - loaded:
        if name.split('.')[0] in {'flange_msgs', 'tf2_msgs'}:
            del sys.modules[name]


def test_show_calibrate_and_the_node_take_wrench_and_temperature_out_of_one_message(  # noqa: PLR0913, PLR0917
    packages, wired, messages, tmp_path, monkeypatch, capsys
):
    """What show prints for a bag makes a model, and lets the node run on the same messages."""
    kind, make = _definition(messages), messages.make

    def day():
        for k in range(900):
            inside = 22 + 12 * (1 - np.exp(-k / 250)) + 2 * np.sin(k / 90)
            halves = (
                make('geometry_msgs/msg/Vector3', 1.0, 2.0, 3.0 * (inside - 22)),
                make('geometry_msgs/msg/Vector3', 0.0, 0.0, 0.0),
            )
            whole = make('geometry_msgs/msg/Wrench', *halves)
            data = messages.pack(kind, (START + k) * SECOND, 0, whole, inside)
            yield '/flange/state', kind, (START + k) * SECOND, data

    messages.write(tmp_path / 'day', day(), 'mcap')
    monkeypatch.chdir(tmp_path)
    assert main(['show', 'day']) == 0
    calibrate, _, node = (shlex.split(c) for c in capsys.readouterr().out.splitlines()[-3:])
    assert main(calibrate[1:]) == 0
    given = dict(word.split(':=') for word in node if ':=' in word)
    assert set(given) == {'model_file', 'wrench_topic', 'temperature_topics'}
    given['temperature_topics'] = yaml.safe_load(given['temperature_topics'])
    given['model_file'] = str(tmp_path / given['model_file'])
    given['max_drift_rate'] = 1000.0
    running = wired(topics=given['temperature_topics'], parameters=given)
    state = running.bench.publisher(packages[0], '/flange/state')
    message, outputs = packages[0](), []
    message.header.stamp.sec, message.header.frame_id = START, 'flange'
    message.wrench.force.x = 1.0

    def at(celsius):
        message.temperature, message.wrench.force.z = celsius, 3.0 * (celsius - 22.0)
        message.header.stamp.sec += 1
        state.publish(message)
        while running.outputs.qsize():
            outputs.append(running.take()[0])
        held = running.node.compensator.tracker.temperature_c
        if held is None or held[0] != celsius:
            outputs.clear()  # of another drift
        return len(outputs) > 9

    running.wait_until(lambda: at(24.0), 'wrenches without their drift')
    before = outputs[-1]
    assert (before.header.frame_id, before.wrench.force.x) == ('flange', 1.0)
    running.wait_until(
        lambda: at(34.0) and abs(outputs[-1].wrench.force.z - before.wrench.force.z) < 0.5,
        'the wrench of before, with 30 N more of drift',
    )
    running.diagnosis('temperature', 'all thermometers report')


def _definition(messages):
    text = Path(__file__).parents[2] / 'support/messages/flange_msgs/State.msg'
    return messages.learn('flange_msgs/msg/State', text.read_text('utf-8'))


@pytest.mark.usefixtures('packages')
def test_a_message_of_another_version_is_a_warning_and_not_read(wired, executable):
    topic = '/other/state'
    executable('', source=OLDER.format(load=LOAD, topic=topic))
    node = wired(topics=[f'{topic}:temperature'], parameters={'wrench_topic': f'{topic}:wrench'})
    for status in ('input', 'temperature'):
        assert 'flange_msgs/State of another version' in node.diagnosis(status, 'version').message
    assert node.node.counts.wrenches == node.node.inputs.usable == 0


def test_gravity_comes_by_tf_from_real_transforms(packages, wired, bench):
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    static = bench.helper.create_publisher(packages[1], '/tf_static', latched)
    static.publish(packages[1](transforms=[_transform('flange', 'tool0', 0)]))
    node = wired(parameters={'gravity.source': 'tf', 'gravity.frame': 'base'})
    node.put(START * SECOND, [0.0] * 6)  # tells the frame, tool0
    moving = bench.publisher(packages[1], '/tf')
    second = iter(range(10**6))

    def felt(status):
        at = START + next(second)
        moving.publish(packages[1](transforms=[_transform('base', 'flange', at)]))
        return status.values['force_rate_hz'] != '0.0'

    node.diagnosis('payload', felt)


def _transform(parent, child, seconds):
    result = TransformStamped(child_frame_id=child)
    result.header.frame_id, result.header.stamp.sec = parent, seconds
    return result
