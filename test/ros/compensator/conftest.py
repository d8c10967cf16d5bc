"""A compensator under test, what talks to it, and models with a known drift."""

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
import itertools
from pathlib import Path
import queue
import threading
from typing import Any

import numpy as np
import pytest

from wrist_ft_comp.calibration.result import AxisFit, Calibration
from wrist_ft_comp.files.model_file import save_model
from wrist_ft_comp.model.arx import relaxation
from wrist_ft_comp.model.arx_pls import ArxPls
from wrist_ft_comp.model.axis_model import AxisModel
from wrist_ft_comp.model.drift_model import DriftModel, StoredModel
from wrist_ft_comp.model.features import Features

with suppress(ImportError):
    from diagnostic_msgs.msg import DiagnosticArray
    from geometry_msgs.msg import WrenchStamped
    from rcl_interfaces.srv import SetParameters
    from rclpy.parameter import Parameter
    from rclpy.qos import QoSProfile
    from sensor_msgs.msg import Temperature
    from std_srvs.srv import SetBool, Trigger

    from wrist_ft_comp.ros.compensator_node import CompensatorNode
    from wrist_ft_comp.ros.messages import wrench_message

TIMEOUT_S = 60.0
SECOND = 1_000_000_000
#: So few messages are under way at once that best effort loses none.
WINDOW = 40
#: Shorter than the node's own, for the tests' sake.
DIAGNOSTICS_PERIOD_S, TARE_GRACE_S = 0.05, 0.2
_NUMBERS = itertools.count()


def six(message: Any) -> tuple[float, ...]:
    """Six numbers of a message, N and N m."""
    force, torque = message.wrench.force, message.wrench.torque
    return (force.x, force.y, force.z, torque.x, torque.y, torque.z)


def stamp_ns(message: Any) -> int:
    """Header stamp, ns."""
    return message.header.stamp.sec * SECOND + message.header.stamp.nanosec


class Rig:
    """
    A compensator in a namespace of its own, and everything around it.

    Attributes
    ----------
    node : CompensatorNode
        Under test, in a thread of its own.
    outputs : queue of WrenchStamped
        What it published on ``wrench`` and nobody took yet.

    """

    def __init__(self, bench: Any, namespace: str, directory: Path, **options: Any) -> None:
        self.bench = bench
        self.namespace = namespace
        self.directory = directory
        self.thermometers = options.pop('thermometers', 1)
        topics = ['temperature', *(f'temperature_{j}' for j in range(2, self.thermometers + 1))]
        parameters = {
            'data_directory': str(directory),
            'temperature_topics': topics,
            **options.pop('parameters', {}),
        }
        self.node = options.pop('node', None) or bench.start(
            CompensatorNode, namespace=namespace, parameters=parameters, **options
        )
        self.arrays = bench.listen(DiagnosticArray, '/diagnostics')
        self.outputs = bench.listen(WrenchStamped, self.topic('wrench'), QoSProfile(depth=5000))
        bench.wait_until(lambda: self.node._output.get_subscription_count() > 0, 'a listener')
        self._raw = bench.publisher(WrenchStamped, self.topic('wrench_raw'))
        self._temperatures = [bench.publisher(Temperature, self.topic(t)) for t in topics]
        self._clients: dict[str, Any] = {}

    def topic(self, name: str) -> str:
        """Topic of the node, by its relative name."""
        return f'{self.namespace}/{name}'

    def reference(self) -> Callable[[int, Sequence[float]], None]:
        """Give what publishes reference wrenches; only while a recording runs."""
        publisher = self.bench.publisher(WrenchStamped, self.topic('wrench_reference'))
        return lambda stamp, values: publisher.publish(wrench_message(stamp, 'world', values))

    def put(self, stamp: int, values: Iterable[float], frame: str = 'tool0') -> None:
        """Send one raw wrench."""
        self._raw.publish(wrench_message(stamp, frame, values))

    def put_bytes(self, data: bytes) -> None:
        """Send bytes where a raw wrench belongs."""
        self._raw.publish(data)

    def put_temperature(self, stamp: int, *values: float, first: int = 0) -> None:
        """Send one reading per value, of the thermometers from first on."""
        for publisher, value in zip(self._temperatures[first:], values, strict=False):
            message = Temperature(temperature=float(value))
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, SECOND)
            publisher.publish(message)

    def warm(self, stamp: int, *values: float) -> None:
        """Send one reading per thermometer, and wait until the node has them."""
        counts = self.node.health.counts
        goal = counts.temperatures + counts.bad_temperatures + len(values)
        self.put_temperature(stamp, *values)
        pause = threading.Event()
        for _ in range(int(TIMEOUT_S / 0.001)):
            if counts.temperatures + counts.bad_temperatures >= goal:
                return
            pause.wait(0.001)
        pytest.fail('waited for the temperatures')

    def take(self, count: int = 1) -> list[Any]:
        """Take outputs in their order."""
        return [self.outputs.get(timeout=TIMEOUT_S) for _ in range(count)]

    def ask_output(self, stamp: int, values: Iterable[float]) -> tuple[float, ...]:
        """Send one raw wrench; return what it is corrected to."""
        self.put(stamp, values)
        (message,) = self.take()
        assert stamp_ns(message) == stamp
        return six(message)

    def stream(self, stamps: Sequence[int], wrenches: Any) -> np.ndarray:
        """Send raw wrenches; return what they are corrected to, shape (n, 6)."""
        found = []
        for first in range(0, len(stamps), WINDOW):
            part = stamps[first : first + WINDOW]
            for stamp, values in zip(part, wrenches[first : first + WINDOW], strict=True):
                self.put(int(stamp), values)
            messages = self.take(len(part))
            assert [stamp_ns(each) for each in messages] == [int(stamp) for stamp in part]
            found += [six(each) for each in messages]
        return np.array(found)

    def ask(self, service: str, data: bool | None = None) -> 'queue.Queue[Any]':
        """Call a service of the node; its answer comes in the queue."""
        kind, request = Trigger, Trigger.Request()
        if data is not None:
            kind, request = SetBool, SetBool.Request(data=data)
        if service not in self._clients:
            name = f'{self.namespace}/wrist_ft_comp/{service}'
            self._clients[service] = self.bench.helper.create_client(kind, name)
        client = self._clients[service]
        assert client.wait_for_service(timeout_sec=TIMEOUT_S), f'{service} is not offered'
        answers: queue.Queue[Any] = queue.Queue()
        client.call_async(request).add_done_callback(lambda done: answers.put(done.result()))
        return answers

    def call(self, service: str, data: bool | None = None) -> Any:
        """Call a service of the node and return its answer."""
        return self.ask(service, data).get(timeout=TIMEOUT_S)

    def set(self, name: str, value: Any) -> Any:
        """Set a parameter over the graph; return the verdict."""
        request = SetParameters.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg()]
        )
        service = f'{self.namespace}/wrist_ft_comp/set_parameters'
        return self.bench.call(SetParameters, service, request).results[0]

    def diagnosis(self, concern: str, wanted: Callable[[Any], bool] | None = None) -> Any:
        """Return the next status of a concern, or the next one that is as wanted."""
        name = f'{self.namespace.lstrip("/")}/wrist_ft_comp: {concern}'
        while not self.arrays.empty():
            self.arrays.get()
        found = 0
        for _ in range(round(TIMEOUT_S / DIAGNOSTICS_PERIOD_S)):
            for status in self.arrays.get(timeout=TIMEOUT_S).status:
                if status.name != name:
                    continue
                found += 1  # the first may have been on its way before the call
                if found > 1 if wanted is None else wanted(status):
                    return status
        pytest.fail(f'waited for {name} to be as wanted')


@pytest.fixture
def rig(bench: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Rig]:
    """Start compensators; each in its own namespace, all with the same data_directory."""
    period = 'wrist_ft_comp.ros.compensator_node._DIAGNOSTICS_PERIOD_S'
    monkeypatch.setattr(period, DIAGNOSTICS_PERIOD_S)
    monkeypatch.setattr('wrist_ft_comp.ros.services.tare._GRACE_S', TARE_GRACE_S)
    started: list[Rig] = []

    def start(**options: Any) -> Rig:
        namespace = options.pop('namespace', None) or f'/t{next(_NUMBERS)}'
        directory = options.pop('directory', tmp_path / 'data')
        started.append(Rig(bench, namespace, directory, **options))
        return started[-1]

    return start


def lag_model(
    axes: dict[str, tuple[float, float, float]],
    *,
    period_s: float = 1.0,
    thermometers: int = 1,
    range_c: tuple[float, float] = (-50.0, 150.0),
) -> DriftModel:
    """Build a model by hand: per axis gain of o and of s per K above 20 °C, and time constant."""
    ones = np.ones(thermometers)
    return DriftModel(
        period_ns=round(period_s * SECOND),
        thermometers=thermometers,
        axes={
            axis: AxisModel(
                Features('powers', 20.0 * ones, range_c[0] * ones, range_c[1] * ones),
                ArxPls(
                    input_mean=np.zeros(thermometers),
                    input_weight=ones,
                    rotations=ones[:, np.newaxis] / thermometers,
                    latents=(relaxation(tau, period_s),),
                    output_loadings=np.array([[zero], [sensitivity]]),
                    output_weight=np.ones(2),
                    output_mean=np.zeros(2),
                ),
            )
            for axis, (zero, sensitivity, tau) in axes.items()
        },
    )


@pytest.fixture
def make_model(tmp_path: Path) -> Callable[..., StoredModel]:
    """Write a model file as lag_model, below data/models when only a name is given."""

    def make(name: str | Path, axes: Any = None, **more: Any) -> StoredModel:
        model = lag_model(axes or {'force_z': (2.0, 0.0, 0.0)}, **more)
        fits = {
            axis: AxisFit(each, 'by hand', (), 1.0, 0.1, (1.0,))
            for axis, each in model.axes.items()
        }
        ranges = np.tile(more.get('range_c', (-50.0, 150.0)), (model.thermometers, 1))
        path = tmp_path / 'data/models' / name
        return save_model(path, Calibration(model, fits, ranges, 3600.0, ()), {})

    return make
