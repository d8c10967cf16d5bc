"""A compensator under test, what talks to it, and models with a known drift."""

from contextlib import closing, ExitStack
from functools import partial
import itertools
import queue
from typing import Any
from unittest import mock
from weakref import WeakValueDictionary

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from moments import SECOND, six_of, stamp_of, START, TIMEOUT_S
import numpy as np
import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Temperature
from std_srvs.srv import SetBool, Trigger

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.fit.settings import CalibrationSettings, IdentificationSettings
from wrist_ft_comp.node.compensator_node import CompensatorNode
from wrist_ft_comp.ros.diagnostics import Status
from wrist_ft_comp.ros.topics import wrench_message
from wrist_ft_comp.stream.compensator import StreamSettings

#: Shorter than the node's own, for the tests' sake.
DIAGNOSTICS_PERIOD_S, TARE_PATIENCE_S = 0.05, 0.2
_NUMBERS = itertools.count()


def short_cells(period_s):
    """Let nodes that are made have thermal cells of another length."""
    settings = partial(StreamSettings, thermal_period_s=period_s)
    return mock.patch('wrist_ft_comp.node.compensator_node.StreamSettings', settings)


#: The newest node of a data_directory.
_NEWEST: WeakValueDictionary[Any, CompensatorNode] = WeakValueDictionary()


class Rig:
    """A compensator in a namespace of its own, whose callbacks are called as an executor would."""

    def __init__(self, bench, namespace, directory, **options):
        self.bench = bench
        self.namespace = namespace
        self.directory = directory
        self.thermometers = options.pop('thermometers', 1)
        more = (f'temperature_{j}' for j in range(2, self.thermometers + 1))
        self.topics = options.pop('topics', ['temperature', *more])
        model = options.pop('model', None)
        #: Length of a thermal cell without a model, s.
        self._period_s = options.pop('period_s', 1.0)
        options['parameters'] = {
            'data_directory': str(directory),
            'temperature_topics': self.topics,
            **({'model_file': str(model.path)} if model else {}),
            **options.pop('parameters', {}),
        }
        #: What was published on ``wrench``, as bytes or messages, and nobody took yet.
        self.outputs: queue.Queue[Any] = queue.Queue()
        #: What was published on ``wrench_external``, as bytes.
        self.externals: queue.Queue[bytes] = queue.Queue()
        self._connect(options)

    def _connect(self, options):
        """Make the node, and catch what it sends."""
        if self.directory in _NEWEST:  # that one counts as killed, when its files are written
            _NEWEST[self.directory].writer.end(TIMEOUT_S)
            _NEWEST[self.directory].store.release()
        with short_cells(self._period_s):
            self.node = self.bench.make(CompensatorNode, namespace=self.namespace, **options)
        _NEWEST[self.directory] = self.node
        self._statuses: list[Any] = []
        self.node._output.publish = self.outputs.put
        self.node.external.output.publish = self.externals.put
        self.node._diagnostics.publish = lambda array: self._statuses.extend(array.status)
        for service in self.node._offered:
            service._send = lambda response, answers: answers.put(response)

    def topic(self, name):
        return f'{self.namespace}/{name}'

    def send_reference(self, stamp, values):
        topic = self.topic('wrench_reference')
        (reference,) = (s for s in self.node.subscriptions if s.topic_name == topic)
        reference.callback(serialize_message(wrench_message(stamp, 'world', values)))

    def put(self, stamp, values, frame='tool0'):
        self.put_bytes(serialize_message(wrench_message(stamp, frame, values)))

    def put_bytes(self, data):
        self.node._on_wrench(data)

    def put_temperature(self, stamp, *values):
        for j, value in enumerate(values):
            message = Temperature(temperature=float(value))
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, SECOND)
            self.put_temperature_bytes(j, serialize_message(message))

    def put_temperature_bytes(self, thermometer, data):
        for topic in self.node.inputs.by_topic:
            if thermometer in topic.sources:
                topic.read(data)

    def warm(self, stamp, *values):
        """Send one reading per thermometer, and wait until the node has them."""
        inputs = self.node.inputs
        goal = inputs.usable + inputs.unusable + len(values)
        self.put_temperature(stamp, *values)
        self.wait_until(lambda: inputs.usable + inputs.unusable >= goal, 'the temperatures')

    def warm_up(self, celsius, seconds=3, first=0):
        for second in range(first, first + seconds):
            self.warm(START + second * SECOND, *[celsius] * self.thermometers)

    def take(self, count=1):
        taken = [self.outputs.get(timeout=TIMEOUT_S) for _ in range(count)]
        return [
            deserialize_message(output, WrenchStamped) if isinstance(output, bytes) else output
            for output in taken
        ]

    def ask_output(self, stamp, values):
        """Send one raw wrench; return what it is corrected to."""
        self.put(stamp, values)
        (message,) = self.take()
        assert stamp_of(message) == stamp
        return six_of(message)

    def stream(self, stamps, wrenches):
        """Send raw wrenches; return what they are corrected to, shape (n, 6)."""
        sent = zip(stamps, wrenches, strict=True)
        return np.array([self.ask_output(int(stamp), values) for stamp, values in sent])

    def ask(self, service, data=None):
        answers: queue.Queue[Any] = queue.Queue()
        name = f'{self.namespace}/wrist_ft_comp/{service}'
        (served,) = (service for service in self.node.services if service.service_name == name)
        kind, request = _request(data)
        response = served.callback(request, kind.Response())
        deferred = {id(getattr(offer, 'service', None)): offer for offer in self.node._offered}
        if id(served) in deferred:
            deferred[id(served)]._on_header(response, answers)
        else:
            answers.put(response)
        return answers

    def answered(self, answers):
        """Wait for the answer of a service that was asked."""
        self.wait_until(lambda: not answers.empty(), 'the answer')
        return answers.get()

    def call(self, service, data=None):
        return self.answered(self.ask(service, data))

    def refusal(self, service, data=None):
        answer = self.call(service, data)
        assert not answer.success, answer.message
        return answer.message

    def refused_value(self, name, value):
        """Set a parameter that has to be refused; return the sentence."""
        verdict = self.set(name, value)
        assert not verdict.successful
        return verdict.reason

    def set(self, name, value):
        return self.node.set_parameters([Parameter(name, value=value)])[0]

    def wait_until(self, condition, what):
        """Wait, while the node looks after itself."""
        self.bench.wait_until(lambda: condition() or self.node.housekeep(), what)

    def diagnosis(self, name, wanted=''):
        """Return the next status of a name that says some words, or is as wanted."""
        full = f'{self.namespace.lstrip("/")}/wrist_ft_comp: {name}'
        statuses: list[Status] = []

        def as_wanted():
            statuses.extend(
                Status(s.name, s.level, s.message, {v.key: v.value for v in s.values})
                for s in self._report()
                if s.name == full
            )
            if not statuses or callable(wanted):
                return bool(statuses) and wanted(statuses[-1])
            return wanted in statuses[-1].message

        self.wait_until(as_wanted, f'{full} to be as wanted')
        return statuses[-1]

    def _report(self):
        self._statuses.clear()
        self.node.housekeep()
        self.node._diagnose()
        return self._statuses


class WiredRig(Rig):
    """A compensator in a thread of its own, and everything around it, over DDS."""

    def _connect(self, options):
        """Start the node, unless there is one, and what talks to it."""
        bench, namespace = self.bench, self.namespace
        with short_cells(self._period_s):
            self.node = bench.start(CompensatorNode, namespace=namespace, **options)
        self.outputs = bench.listen(WrenchStamped, self.topic('wrench'), QoSProfile(depth=5000))
        bench.wait_until(lambda: self.node._output.get_subscription_count() > 0, 'a listener')
        self._arrays = bench.listen(DiagnosticArray, '/diagnostics')
        self._raw = bench.publisher(WrenchStamped, self.topic('wrench_raw'))
        plain = (self.topic(name) for name in self.topics if ':' not in name)
        self._temperatures = [bench.publisher(Temperature, topic) for topic in plain]

    def put_bytes(self, data):
        self._raw.publish(data)

    def put_temperature_bytes(self, thermometer, data):
        self._temperatures[thermometer].publish(data)

    def ask(self, service, data=None):
        kind, request = _request(data)
        return self.bench.ask(kind, f'{self.namespace}/wrist_ft_comp/{service}', request)

    def set(self, name, value):
        asked = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
        service = f'{self.namespace}/wrist_ft_comp/set_parameters'
        return self.bench.call(SetParameters, service, asked).results[0]

    def wait_until(self, condition, what):
        self.bench.wait_until(condition, what)

    def _report(self):
        return list(self._arrays.get(timeout=TIMEOUT_S).status)


def _request(data):
    """Make a request: Trigger's, or SetBool's with data."""
    if data is None:
        return Trigger, Trigger.Request()
    return SetBool, SetBool.Request(data=data)


@pytest.fixture
def rig(bench, tmp_path):
    """Make compensators with the same data_directory; ``model`` is a stored one to start with."""
    return partial(_make_rig, Rig, bench, tmp_path)


@pytest.fixture
def driver(bench, make_context):
    """Make participants: within one, a topic has one type only."""
    with ExitStack() as stack:
        yield lambda: stack.enter_context(closing(type(bench)(make_context())))


@pytest.fixture
def wired(bench, tmp_path, monkeypatch):
    """Start compensators that talk over DDS, and often of their health."""
    period = 'wrist_ft_comp.ros.hub.DIAGNOSTICS_PERIOD_S'
    monkeypatch.setattr(period, DIAGNOSTICS_PERIOD_S)
    return partial(_make_rig, WiredRig, bench, tmp_path)


@pytest.fixture(autouse=True)
def short_patience(monkeypatch):
    """Wait less for the wrenches of a tare, and for callers at the end."""
    monkeypatch.setattr('wrist_ft_comp.node.tare_services._PATIENCE_S', TARE_PATIENCE_S)
    monkeypatch.setattr('wrist_ft_comp.ros.hub.FAREWELL_S', 0.0)


def _make_rig(kind, bench, tmp_path, **options):
    namespace = options.pop('namespace', None) or f'/t{next(_NUMBERS)}'
    return kind(bench, namespace, options.pop('directory', tmp_path / 'data'), **options)


@pytest.fixture
def haste(monkeypatch):
    """Let calibrations take the quickest method, and states be saved often."""
    quickest = IdentificationSettings(method='pls')
    settings = partial(CalibrationSettings, identification=quickest)
    monkeypatch.setattr('wrist_ft_comp.node.calibration_services.CalibrationSettings', settings)
    monkeypatch.setattr('wrist_ft_comp.node.state_keeper.SAVE_PERIOD_S', 0.1)


@pytest.fixture
def make_model(make_model, save, tmp_path):
    """Write a model's file, below data/models when only a name is given; it may be without lag."""

    def make(name, axes=None, calibrated=AXES, **more):
        range_c = more.setdefault('range_c', (-50.0, 150.0))
        gains = {'force_z': (2.0, 0.0, 0.0)} if axes is None else axes
        model = make_model({a: (o, s, tau or 1e-9) for a, (o, s, tau) in gains.items()}, **more)
        return save(tmp_path / 'data/models' / name, model, range_c, calibrated)

    return make
