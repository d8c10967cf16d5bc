"""Fixtures of the node tests: an own domain, nodes in threads, queues with timeouts, processes."""

from contextlib import ExitStack
from functools import cached_property
from importlib import import_module
import os
from pathlib import Path
import queue
import signal
import socket
import subprocess
import sys
import threading
from types import ModuleType, SimpleNamespace
from typing import Any
import warnings

from geometry_msgs.msg import PoseArray
from moments import TIMEOUT_S
import pytest
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, QoSReliabilityPolicy

import wrist_ft_comp
from wrist_ft_comp.ros.rclpy_internals import Stop
from wrist_ft_comp.ros.running import spin
from wrist_ft_comp.ros.topics import NEWEST

ROOT = Path(wrist_ft_comp.__file__).parents[1]
#: Between two looks at what a test waits for, s.
PAUSE_S = 0.02
#: Environment of a process that talks over the loopback interface, and not by shared memory.
LOOPBACK_UDP = {
    'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SYSTEM_DEFAULT',
    'FASTRTPS_DEFAULT_PROFILES_FILE': str(ROOT / 'bench/loopback.xml'),
}
#: Participants of one process find one another as those of several do: by the shortcut that Fast
#: DDS has within a process, one in ten that joined while a subscription was made never learnt of
#: it. They announce themselves five times a second, not every 3 s.
PROFILES = """\
<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <library_settings><intraprocess_delivery>USER_DATA_ONLY</intraprocess_delivery></library_settings>
  <profiles>
    <participant profile_name="test" is_default_profile="true">
      <rtps><builtin><discovery_config>
        <leaseAnnouncement><sec>0</sec><nanosec>200000000</nanosec></leaseAnnouncement>
      </discovery_config></builtin></rtps>
    </participant>
  </profiles>
</dds>
"""


@pytest.fixture(scope='session')
def ros_domain(tmp_path_factory):
    """Reserve a ROS domain for this test process; child processes inherit it."""
    with warnings.catch_warnings():
        # A parser that comes with ROS 2 imports a deprecated module of Python's.
        warnings.simplefilter('ignore', DeprecationWarning)
        import_module('rosidl_generator_py')
    logs = tmp_path_factory.mktemp('ros')
    with ExitStack() as stack:
        environment = stack.enter_context(pytest.MonkeyPatch.context())
        domain = _reserve_domain(stack)
        environment.setenv('ROS_DOMAIN_ID', str(domain))
        environment.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        profiles = logs / 'profiles.xml'
        profiles.write_text(PROFILES)
        environment.setenv('FASTRTPS_DEFAULT_PROFILES_FILE', str(profiles))
        environment.setenv('ROS_HOME', str(logs))
        environment.setenv('ROS_LOG_DIR', str(logs))
        yield domain


def _reserve_domain(stack):
    """Take the first free domain of 1 to 100 (higher ones meet ephemeral ports)."""
    # Taken is what has a socket name of the kernel, which leaves nothing behind.
    for domain in range(1, 101):
        try:
            name = f'\0wrist_ft_comp_test_domain_{domain}'
            stack.enter_context(socket.socket(socket.AF_UNIX)).bind(name)
        except OSError:
            continue
        return domain
    pytest.fail('No ROS domain of 1 to 100 is free.')


@pytest.fixture
def make_context(ros_domain):
    """Initialise own rclpy contexts; they are shut down after every node and executor."""
    with ExitStack() as stack:

        def make(*words):
            context = Context()
            context.init(list(words), domain_id=ros_domain)
            stack.callback(context.try_shutdown)
            return context

        yield make


@pytest.fixture
def ros_context(make_context):
    return make_context()


class FakeHub:
    """Stands for the hub beside one part: its parameters, what it logs, opens and hands out."""

    def __init__(self, part, **chosen):
        self.values = {row.name: row.default for row in part.parameters} | chosen
        self.logged, self.sent, self.topics, self.incompatible = [], [], {}, {}
        self.frame, self.listening, self.publishers, self.behind_s = 'tool0', False, 1, 0.0
        #: The node that publishes all.
        self.publisher = '/driver'
        #: What is published on topics, by full name; of others, ``publishers`` are counted.
        self.types = {}
        note = self.logged.append
        write = {'write': lambda _, line: note(line)}
        self.log = SimpleNamespace(info=note, warning=note, error=note, **write)
        part.hub = self

    def chosen(self):
        return dict(self.values)

    def set(self, part, **changed):
        """Set parameters, as the hub does: checked first, then followed."""
        given = [SimpleNamespace(name=name, value=value) for name, value in changed.items()]
        part.check_parameters(given)
        self.values |= changed
        part.apply_parameters(given)

    def hardware_id(self):
        return self.frame

    def do(self, _part, verb, *arguments):
        return verb(*arguments)

    def guarded(self, _part, callback):
        return callback

    def broadcast(self, *verb_and_arguments):
        self.sent.append(verb_and_arguments)

    def listen(self, _part, *, wanted):
        self.listening = wanted

    def advertise(self, _kind, topic, **_):
        self.topics[topic] = []
        return SimpleNamespace(publish=self.topics[topic].append)

    def subscribe(self, _kind, topic, callback, _qos):
        self.topics[topic] = callback
        return topic

    def subscribe_unserved(self, _kind, topic, qos=NEWEST):
        return self.topics.setdefault(topic, KeptMessages(topic, qos))

    def destroy_subscription(self, subscription):
        del self.topics[getattr(subscription, 'topic_name', subscription)]

    def count_publishers(self, topic):
        return len(self.types[topic]) if topic in self.types else self.publishers

    def get_publishers_info_by_topic(self, topic):
        namespace, _, name = self.publisher.rpartition('/')
        same = {
            'topic_type_hash': SimpleNamespace(version=0), 'endpoint_gid': b'1',
            'node_name': name, 'node_namespace': namespace or '/',
        }  # fmt: skip
        return [SimpleNamespace(topic_type=kind, **same) for kind in self.types.get(topic, ())]

    def get_subscriptions_info_by_topic(self, _topic):
        return []

    def disagreement(self, topic):
        return self.incompatible.get(topic, '')

    def resolve_topic_name(self, name):
        return f'/{name}'

    def get_name(self):
        return 'node'

    def get_namespace(self):
        return '/'

    def get_parameter(self, name):
        return SimpleNamespace(value=self.values.get(name, False))

    def now_ns(self):
        return 0


class KeptMessages:
    """A subscription that only keeps messages."""

    def __init__(self, topic, qos):
        self.handle, self.msg_type, self.topic_name, self.qos_profile = self, None, topic, qos
        self.messages = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None

    def take_message(self, *_):
        return (self.messages.pop(0), None) if self.messages else None


@pytest.fixture
def tf_messages(monkeypatch):
    """Of the package that is missing here, the node needs a type only: bytes are bytes."""
    package = ModuleType('tf2_msgs.msg')
    package.TFMessage = PoseArray
    monkeypatch.setitem(sys.modules, 'tf2_msgs', package)
    monkeypatch.setitem(sys.modules, 'tf2_msgs.msg', package)


@pytest.fixture
def fake_hub():
    return FakeHub


class Bench:
    """Runs nodes in threads of their own, beside a helper that listens, publishes and calls."""

    def __init__(self, context):
        self.context = context
        self._stack = ExitStack()
        self._stops: list[Stop] = []
        self._clients: dict[str, Any] = {}

    @cached_property
    def helper(self):
        return self.start(Node, 'helper', use_global_arguments=False)

    def make(self, factory, **kwargs):
        """Make a node as ``start`` does, whose callbacks nobody calls."""
        node = factory(context=self.context, **_node_arguments(kwargs))
        self._stack.callback(node.destroy_node)
        return node

    def start(self, factory, *args, **kwargs):
        """Make a node and spin it until the test ends; ``executor`` is default or events."""
        if kwargs.pop('executor', 'default') == 'events':
            executor = EventsExecutor(context=self.context)
        else:
            executor = SingleThreadedExecutor(context=self.context)
        node = factory(*args, context=self.context, **_node_arguments(kwargs))
        executor.add_node(node)
        stop = Stop()
        self._stops.append(stop)
        thread = threading.Thread(target=spin, args=(executor, self.context, stop))
        thread.start()

        def take_down():
            stop.set()
            thread.join(TIMEOUT_S)
            assert not thread.is_alive(), f'{node.get_name()} did not stop'
            executor.shutdown()
            node.destroy_node()

        self._stack.callback(take_down)
        return node

    def listen(self, message_type, topic, qos=None):
        """Subscribe; without qos it is best effort, which hears every publisher, and deep."""
        best_effort = QoSReliabilityPolicy.BEST_EFFORT
        profile = qos or QoSProfile(depth=5000, reliability=best_effort)
        messages: queue.Queue[Any] = queue.Queue()
        self.helper.create_subscription(message_type, topic, messages.put, profile)
        return messages

    def publisher(self, message_type, topic, qos=1000):
        """Make a publisher that already has a subscriber, so that nothing is lost."""
        result = self.helper.create_publisher(message_type, topic, qos)
        self.wait_until(lambda: result.get_subscription_count() > 0, f'a subscriber of {topic}')
        return result

    def ask(self, service_type, name, request):
        """Call a service; its response comes in the queue."""
        if name not in self._clients:
            self._clients[name] = self.helper.create_client(service_type, name)
        client = self._clients[name]
        assert client.wait_for_service(timeout_sec=TIMEOUT_S), f'{name} is not offered'
        responses: queue.Queue[Any] = queue.Queue()
        client.call_async(request).add_done_callback(lambda done: responses.put(done.result()))
        return responses

    def call(self, service_type, name, request):
        return self.ask(service_type, name, request).get(timeout=TIMEOUT_S)

    def wait_until(self, condition, what):
        pause = threading.Event()
        for _ in range(int(TIMEOUT_S / PAUSE_S)):
            if condition():
                return
            pause.wait(PAUSE_S)
        pytest.fail(f'waited {TIMEOUT_S} s for {what}')

    def close(self):
        for stop in self._stops:
            stop.set()  # all at once, because each thread looks at its flag now and then only
        self._stack.close()


def _node_arguments(kwargs):
    """Translate ``parameters`` and ``remap`` into rclpy's node arguments."""
    rest = dict(kwargs)
    parameters = rest.pop('parameters', {})
    remaps = rest.pop('remap', {})
    if parameters:
        rest['parameter_overrides'] = [Parameter(k, value=v) for k, v in parameters.items()]
    if remaps:
        rules = [part for item in remaps.items() for part in ('-r', '{}:={}'.format(*item))]
        rest['cli_args'] = ['--ros-args', *rules]
    return rest


@pytest.fixture
def bench(ros_context):
    result = Bench(ros_context)
    try:
        yield result
    finally:
        result.close()


class Executable:
    """A node as a process of its own: ``python -m MODULE --ros-args ARGS``, or ``-c SOURCE``."""

    def __init__(self, module, *ros_args, source='', may_be_killed=False):
        command = [sys.executable, *(['-c', source] if source else ['-m', module])]
        command += ['--ros-args', *ros_args] if ros_args else []
        # A SIGKILL can leave shared memory that makes the next process deaf.
        environment = {**os.environ, **(LOOPBACK_UDP if may_be_killed else {})}
        pipes = {'stdout': subprocess.PIPE, 'stderr': subprocess.PIPE, 'text': True}
        self.process = subprocess.Popen(command, cwd=ROOT, env=environment, **pipes)

    def end(self, number=signal.SIGINT):
        self.process.send_signal(number)
        return self.result()

    def result(self):
        _, errors = self.process.communicate(timeout=TIMEOUT_S)
        return self.process.returncode, errors


@pytest.fixture
def executable(ros_domain):  # noqa: ARG001
    """Start executables; those still running when the test ends are killed by their pid."""
    running: list[Executable] = []

    def start(*words, **options):
        running.append(Executable(*words, **options))
        return running[-1]

    yield start
    for program in running:
        if program.process.poll() is None:
            program.process.kill()
        program.process.communicate(timeout=TIMEOUT_S)


@pytest.fixture
def run_python(ros_domain):  # noqa: ARG001
    """Run Python to its end, which has to succeed; gives what it printed."""

    def run(*words, may_fail=False):
        done = subprocess.run(
            [sys.executable, *words], cwd=ROOT, env={**os.environ, 'PYTHONPATH': str(ROOT)},
            capture_output=True, text=True, timeout=3 * TIMEOUT_S, check=False,
        )  # fmt: skip
        assert may_fail or done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    return run
