"""Packages of messages as drivers bring them, built from their definitions, over DDS."""

import ctypes
from importlib import import_module
from pathlib import Path
import sys

from geometry_msgs.msg import TransformStamped
from moments import SECOND, START
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile

BUILT = Path(__file__).parents[3] / 'build/messages'
pytestmark = pytest.mark.skipif(
    not BUILT.with_name('.messages').exists(),
    reason='no messages are built: make build/.messages (cmake, ninja, a C++ compiler)',
)
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


@pytest.mark.usefixtures('packages')
def test_a_message_of_another_version_is_a_warning_and_not_read(wired, executable):
    topic = '/other/state'
    executable('', source=OLDER.format(load=LOAD, topic=topic))
    node = wired(topics=[f'{topic}:temperature'])
    said = node.diagnosis('temperature', 'version').message
    assert 'flange_msgs/State of another version' in said
    assert node.node.inputs.usable == 0


def test_gravity_comes_by_tf_from_real_transforms(packages, wired, bench):
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    static = bench.helper.create_publisher(packages[1], '/tf_static', latched)
    static.publish(packages[1](transforms=[_transform('flange', 'tool0', 0)]))
    node = wired(parameters={'gravity.source': 'tf', 'gravity.frame': 'base'})
    node.put(START, [0.0] * 6)  # tells the frame, tool0
    moving = bench.publisher(packages[1], '/tf')
    second = iter(range(10**6))

    def felt(status):
        at = START // SECOND + next(second)
        moving.publish(packages[1](transforms=[_transform('base', 'flange', at)]))
        return status.values['force_rate_hz'] != '0.0'

    node.diagnosis('payload', felt)


def _transform(parent, child, seconds):
    result = TransformStamped(child_frame_id=child)
    result.header.frame_id, result.header.stamp.sec = parent, seconds
    return result
