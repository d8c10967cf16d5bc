"""
A stand for reliability benches: a compensator as a process of its own, a sensor and a listener.

The sensor's drift follows its temperature with a lag that the model knows, and nothing is loaded,
so whatever comes out beyond noise is wrong.
"""

from collections.abc import Sequence
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

from wrist_ft_comp.jobs.calibration import run_job
from wrist_ft_comp.jobs.request import CalibrationJob
from wrist_ft_comp.signals import AXES, NANOSECONDS

NODE = 'stand'
#: Lag of the sensor, s, and its drift, N/K and N m/K.
LAG_S = 600.0
GAINS = (0.05, -0.1, 0.4, 0.01, -0.01, 0.02)
COLD_C = 20.0
NOISE = np.array([0.02, 0.02, 0.02, 0.002, 0.002, 0.002])
TIMEOUT_S = 60.0


class Sensor:
    """
    Temperature, and the drift that follows it.

    Parameters
    ----------
    seed : int
        Of the noise.

    """

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self._heat = 0.0
        self._lagged = 0.0
        self._at_s = 0.0

    def advance(self, seconds: float) -> None:
        """Let time pass up to some seconds after the start."""
        while self._at_s < seconds:
            self._at_s += 0.1
            self._heat = 15.0 * (1 - np.exp(-self._at_s / 400)) + np.sin(self._at_s / 40)
            self._lagged += (1 - np.exp(-0.1 / LAG_S)) * (self._heat - self._lagged)

    @property
    def celsius(self) -> float:
        """Temperature, °C."""
        return COLD_C + float(self._heat)

    @property
    def zero(self) -> Any:
        """Zero drift, shape (6,), N and N m."""
        return self._lagged * np.array(GAINS)

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
    return run_job(CalibrationJob((recording,), path)).stored.path


def message(stamp_ns: int, doubles: Sequence[float], frame: bytes = b'tool0\0\0\0') -> bytes:
    """Serialize a header and doubles; the frame takes eight bytes."""
    seconds, nanoseconds = divmod(stamp_ns, NANOSECONDS)
    head = struct.pack('<4siII8s', b'\0\1\0\0', seconds, nanoseconds, 8, frame) + bytes(4)
    return head + struct.pack(f'<{len(doubles)}d', *doubles)


class Stand:
    """
    The compensator's process, and a node that talks to it.

    Parameters
    ----------
    data : Path
        The compensator's data_directory.
    *parameters : str
        Further parameters, as NAME:=VALUE.

    """

    def __init__(self, data: Path, *parameters: str) -> None:
        from rclpy.context import Context  # noqa: PLC0415 -- after the environment is set
        from rclpy.node import Node  # noqa: PLC0415

        from wrist_ft_comp.ros.running import make_executor, spin  # noqa: PLC0415

        self.data = data
        self.log = data / 'node.log'
        self._parameters = parameters
        self._context: Any = Context()
        self._context.init([])
        self.node: Any = Node('stand_helper', context=self._context)
        #: Publishes; no executor waits for its publishers, so they may come and go.
        self.talker: Any = Node('stand_sensor', context=self._context)
        executor = make_executor('default', self._context)
        executor.add_node(self.node)
        self._executor = executor
        self._stop = threading.Event()
        self._thread = threading.Thread(target=spin, args=(executor, self._context, self._stop))
        self._thread.start()
        self.process: subprocess.Popen[bytes] | None = None
        self._clients: dict[str, Any] = {}

    def start_node(self) -> None:
        """Start the compensator."""
        words = [f'data_directory:={self.data}', *self._parameters]
        arguments = [word for pair in words for word in ('-p', pair)]
        self.data.mkdir(parents=True, exist_ok=True)
        with self.log.open('ab') as log:
            self.process = subprocess.Popen(
                [
                    *(sys.executable, '-m', 'wrist_ft_comp.node.compensator', '--ros-args'),
                    *('-r', f'__node:={NODE}', *arguments),
                ],
                stderr=log,
                stdout=log,
            )

    def end_node(self, number: int = signal.SIGKILL) -> int:
        """Send the compensator a signal; return its exit code."""
        if self.process is None:
            return 0
        self.process.send_signal(number)
        return self.process.wait(TIMEOUT_S)

    def call(self, name: str, kind: Any, request: Any) -> None:
        """Ask for a service, if it is there, and wait for nothing."""
        if name not in self._clients:
            self._clients[name] = self.node.create_client(kind, f'/{NODE}/{name}')
        if self._clients[name].service_is_ready():
            self._clients[name].call_async(request)

    def ready(self, name: str) -> bool:
        """Whether a Trigger service of the node is there."""
        from std_srvs.srv import Trigger  # noqa: PLC0415 -- after the environment is set

        if name not in self._clients:
            self._clients[name] = self.node.create_client(Trigger, f'/{NODE}/{name}')
        return bool(self._clients[name].service_is_ready())

    def wait(self, condition: Any, what: str) -> None:
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
        profile = Path(__file__).with_name('loopback.xml')
        os.environ['FASTRTPS_DEFAULT_PROFILES_FILE'] = str(profile)
