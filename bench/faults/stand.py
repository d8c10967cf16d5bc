"""
A stand for the benches of faults: a compensator as a process of its own, a sensor and a listener.

The sensor's drift follows its temperature with a lag that the model has learnt, and nothing loads
the sensor, so whatever comes out beyond noise is wrong.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import json
import os
from pathlib import Path
import signal
import struct
import subprocess
import sys
import threading
import time
from typing import Any

import numpy as np
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.jobs.calibration_job import run_job
from wrist_ft_comp.jobs.job_process import CalibrationJob
from wrist_ft_comp.node.compensator_node import CompensatorNode
from wrist_ft_comp.ros.rclpy_internals import Stop
from wrist_ft_comp.ros.running import spin
from wrist_ft_comp.series import FloatArray, NANOSECONDS

BENCH = Path(__file__).resolve().parents[1]
NODE = 'stand'
#: Time constant of the sensor's lag behind its thermometer, s.
LAG_S = 600.0
#: Drift per kelvin, N/K and N m/K, axis order AXES.
GAINS = (0.05, -0.1, 0.4, 0.01, -0.01, 0.02)
COLD_C = 20.0
#: Standard deviation of a reading, N and N m.
NOISE = np.array([0.02, 0.02, 0.02, 0.002, 0.002, 0.002])
TIMEOUT_S = 60.0


class Sensor:
    """Temperature, and the drift that follows it; the seed is that of the noise."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self._warmth_k = 0.0
        self._lagged_k = 0.0
        self._elapsed_s = 0.0

    def advance(self, elapsed_s: float) -> None:
        """Let time pass until some seconds after the start."""
        while self._elapsed_s < elapsed_s:
            self._elapsed_s += 0.1
            heated_k = 15.0 * (1 - np.exp(-self._elapsed_s / 400))
            self._warmth_k = heated_k + np.sin(self._elapsed_s / 40)
            self._lagged_k += (1 - np.exp(-0.1 / LAG_S)) * (self._warmth_k - self._lagged_k)

    @property
    def celsius(self) -> float:
        """Temperature, °C."""
        return COLD_C + float(self._warmth_k)

    @property
    def zero(self) -> FloatArray:
        """Zero drift, shape (6,), N and N m."""
        return self._lagged_k * np.array(GAINS)

    def raw(self) -> list[float]:
        """Read the sensor, N and N m."""
        values: list[float] = (self.zero + self.rng.normal(0, 1, 6) * NOISE).tolist()
        return values


def write_warm_up(path: Path, seconds: int = 5400, period_s: int = 1) -> Path:
    """Write a recording of the sensor's warm-up."""
    sensor = Sensor(7)
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [','.join(['stamp_s', *AXES, 'temperature_c'])]
    for second in range(0, seconds, period_s):
        sensor.advance(float(second))
        lines.append(','.join(f'{x:.6f}' for x in (second, *sensor.raw(), sensor.celsius)))
    path.write_text('\n'.join([*lines, '']), 'utf-8')
    return path


def make_model(recording: Path, path: Path) -> Path:
    """Calibrate from a recording."""
    return run_job(CalibrationJob((recording,), path))[1].stored.path


def message(stamp_ns: int, doubles: Sequence[float], frame: bytes = b'tool0\0\0\0') -> bytes:
    """Serialize a header and doubles; the frame takes eight bytes."""
    seconds, nanoseconds = divmod(stamp_ns, NANOSECONDS)
    head = struct.pack('<4siII8s', b'\0\1\0\0', seconds, nanoseconds, 8, frame) + bytes(4)
    return head + struct.pack(f'<{len(doubles)}d', *doubles)


#: Makes a node hasty: its thermal state is saved every 0.1 s, and the quickest method calibrates.
HASTE = """
from functools import partial
from wrist_ft_comp.fit.settings import IdentificationSettings
from wrist_ft_comp.node import calibration_services, state_keeper
state_keeper.SAVE_PERIOD_S = 0.1
quickest = IdentificationSettings(method='pls')
quick = partial(calibration_services.CalibrationSettings, identification=quickest)
calibration_services.CalibrationSettings = quick
"""


class Stand:
    """
    The compensator's process, and nodes that talk to it and listen to it.

    ``parameters`` are NAME:=VALUE beside data_directory; ``source`` is what the process does
    before it becomes a node, such as HASTE.
    """

    def __init__(self, data: Path, *parameters: str, source: str = '') -> None:
        self.data = data
        self.log = data / 'node.log'
        self.process: subprocess.Popen[bytes] | None = None
        self._parameters, self._source = parameters, source
        self._context: Any = Context()
        self._context.init([])
        self.node: Any = Node('stand_helper', context=self._context)
        #: Publishes; no executor waits for its publishers, so they may come and go.
        self.talker: Any = Node('stand_sensor', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._stop = Stop()
        arguments = (self._executor, self._context, self._stop)
        self._thread = threading.Thread(target=spin, args=arguments)
        self._thread.start()
        self._clients: dict[str, Any] = {}

    def start_node(self) -> None:
        """Start the compensator."""
        words = ['-r', f'__node:={NODE}']
        for parameter in (f'data_directory:={self.data}', *self._parameters):
            words += ['-p', parameter]
        main = 'from wrist_ft_comp.node.compensator_node import main\nmain()'
        self.data.mkdir(parents=True, exist_ok=True)
        with self.log.open('ab') as log:
            self.process = subprocess.Popen(
                [sys.executable, '-c', f'{self._source}\n{main}', '--ros-args', *words],
                stderr=log, stdout=log,
            )  # fmt: skip

    def end_node(self, number: int = signal.SIGKILL) -> int:
        """Send the compensator a signal; return its exit code."""
        if self.process is None:
            return 0
        self.process.send_signal(number)
        return self.process.wait(TIMEOUT_S)

    def call(self, name: str, kind: Any = Trigger, request: Any = None) -> bool:
        """Ask for a service, if the node offers it now, and wait for nothing; whether it does."""
        if name not in self._clients:
            self._clients[name] = self.node.create_client(kind, f'/{NODE}/{name}')
        is_ready = bool(self._clients[name].service_is_ready())
        if is_ready:
            self._clients[name].call_async(request or kind.Request())
        return is_ready

    def wait(self, condition: Callable[[], bool], what: str) -> None:
        """Wait until something holds."""
        end = time.monotonic() + TIMEOUT_S
        while not condition():
            if time.monotonic() > end:
                sys.exit(f'waited {TIMEOUT_S} s for {what}\n{self.log.read_text("utf-8")}')
            time.sleep(0.01)

    def close(self) -> None:
        """End everything."""
        if self.process is not None and self.process.poll() is None:
            # Not SIGINT: Python shows a traceback when it comes while modules are loaded.
            self.end_node(signal.SIGTERM)
        self._stop.set()
        self._thread.join(TIMEOUT_S)
        self._executor.shutdown()
        self.node.destroy_node()
        self.talker.destroy_node()
        self._context.try_shutdown()


def own_domain(domain: int, *, shared_memory: bool = False) -> None:
    """
    Keep to this machine, in a domain that nobody else has unless one was chosen.

    Without shared memory by default: what a SIGKILL leaves there can make the next process deaf
    (see docs/reliability.md).
    """
    os.environ.setdefault('ROS_DOMAIN_ID', str(domain))
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    if not shared_memory:
        # LOCALHOST would put shared memory back.
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'SYSTEM_DEFAULT'
        os.environ['FASTRTPS_DEFAULT_PROFILES_FILE'] = str(BENCH / 'loopback.xml')


def keep(name: str, content: object) -> None:
    """Write a file into out/: bytes and a text as they are, figures as JSON."""
    if not isinstance(content, (bytes, str)):
        content = json.dumps(content, indent=1)
    folder = BENCH.parent / 'out'
    folder.mkdir(exist_ok=True)
    (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())


def tell(name: str, figures: object) -> None:
    """Print figures, and keep them in out/."""
    print(json.dumps(figures, indent=1))
    keep(f'{name}.json', figures)


def parameters_of(values: dict[str, Any]) -> list[Any]:
    """Make parameters by name."""
    untyped: Any = Parameter
    return [untyped(name, value=value) for name, value in values.items()]


@contextmanager
def node_here(folder: Path, model: Path) -> Iterator[Any]:
    """Make the node with a model in this process, for calls of its callbacks."""
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'OFF'
    context: Any = Context()
    context.init([])
    chosen = parameters_of({'data_directory': str(folder), 'model_file': str(model)})
    node = CompensatorNode(context=context, parameter_overrides=chosen)
    yield node
    node.destroy_node()
    context.try_shutdown()
