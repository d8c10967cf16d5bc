"""
A simulated robot beside the wired node: heat, payloads, contacts, drivers, clocks and a disk.

The node's callbacks get serialized messages under a simulated clock, and nothing goes over DDS.
What the drivers do are attributes, which the events of ``truth.py`` change.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, ExitStack
from dataclasses import replace
import errno
import math
import os
from pathlib import Path
import shutil
import struct
import sys
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest import mock

BENCH = Path(__file__).resolve().parents[1]
sys.path.append(str(BENCH / 'accuracy'))

from geometry_msgs.msg import PoseArray
from judging import block_means, recording_of
import numpy as np
from rclpy.context import Context
from rclpy.impl.logging_severity import LoggingSeverity
from rclpy.logging import set_logger_level
from rclpy.node import Node
from stand import message, parameters_of
from std_srvs.srv import Trigger

from wrist_ft_comp.channels import AXES, GRAVITY
from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.node.compensator_node import CompensatorNode
from wrist_ft_comp.payload.weight import Payload
from wrist_ft_comp.series import FloatArray, NANOSECONDS
from wrist_ft_comp.simulation import ft_sensor
from wrist_ft_comp.simulation.ft_sensor import interpolation
from wrist_ft_comp.stored.model_file import save_model
from wrist_ft_comp.stored.safe_file import FileWriter
from wrist_ft_comp.wire.gravity_by_tf import tf_layouts

LIFE_S = 12 * 3600
#: Time from one duty cycle of the motor to the next, and a thermal cell of the models, s.
DUTY_S, CELL_S = 2400, 5
#: Share of temperatures that a busy driver loses.
_LOST = 0.1
#: For this long after a change the robot is simulated in short steps, later in long ones, s; while
#: a sensor saturates in pulses, in the shortest, those of the node's own looks.
FAST_S, SHORT_S, LONG_S, SHORTEST_S = 90.0, 0.25, 2.0, 0.1
#: Standard deviation of a reading, and what the sensor reads cold and empty, N and N m.
NOISE = np.array([0.05] * 3 + [0.002] * 3)
ZERO = np.array([13.0, -13.0, 32.0, 0.5, -0.3, 0.2])
#: Standard deviation of a reading of specific force, m/s².
IMU_NOISE = 0.01
#: Where the force saturates, N.
EXTREME_N = 100.0
ORIGIN_NS = 1_700_000_000 * NANOSECONDS
#: The clocks, by what they stamp.
CLOCKS = WRENCH, HEAT, IMU = 'wrench', 'heat', 'imu'
OWN_FRAME, OTHER_FRAME = b'tool0\0\0\0', b'other\0\0\0'
PLACES = (0.35, 0.1, 0.7)
TOOL = Payload(1.2, np.array([0.01, -0.02, 0.08]))
PART = Payload(2.1, np.array([0.0, 0.01, 0.13]))
#: Turns wrenches by 90 degrees about z.
TURN = np.kron(np.eye(2), np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]))
CONTACT_N = 20.0 * np.array([0.1, -0.2, -1.0, 0.02, 0.01, 0.0])


def warm(
    seconds: int, thermometers: int, rng: np.random.Generator, most: float = 0.8
) -> tuple[FloatArray, FloatArray]:
    """
    Warm the simulated wrist by a motor at duty cycles up to ``most``; 1 goes to the extremes.

    Gives what thermometers read, °C, (seconds, thermometers), and the drift, N and N m, (…, 6).
    """
    sensor, steps = ft_sensor.build_sensor(4), seconds // DUTY_S + 1
    levels = rng.uniform(0, most, steps) * (rng.random(steps) > 0.35)
    levels[0 if most < 1 else slice(3)] = most  # it begins with a warm-up
    room_c = 22 + (2 if most == 1 else 1) * np.sin(np.arange(seconds) / 1500 + rng.uniform(0, 6))
    drive = np.column_stack((np.repeat(levels, DUTY_S)[:seconds], room_c))
    nodes_c = ft_sensor.trajectory(sensor, room_c[0], drive)[:-1]
    places = interpolation(np.array(PLACES[:thermometers]))
    read_c = nodes_c @ places.T
    celsius = np.round(read_c + rng.normal(0, 0.01, read_c.shape), 2)
    return celsius, ft_sensor.measured_wrench(sensor, nodes_c, np.zeros(len(AXES)))


def learn(folder: Path, thermometers: int, mornings: int = 3) -> Path:
    """Learn a model from some mornings, unless there is one."""
    path = folder / f'{thermometers}_{mornings}.yaml'
    if path.exists():
        return path
    names = {'frame_id': ['tool0'], 'wrench_topic': ['/wrench_raw']}
    runs = []
    for morning in range(mornings):
        rng = np.random.default_rng(morning)
        celsius, drift = warm(6 * 3600, thermometers, rng, 1.0)
        wrench = drift + rng.normal(0, 1, drift.shape) * NOISE
        run = recording_of(block_means(celsius, CELL_S), block_means(wrench, CELL_S))
        runs.append(replace(run, period_ns=CELL_S * NANOSECONDS, sensor=names))
    return save_model(path, calibrate(runs)).path


class Robot:
    """A life: the node, and all that is around it."""

    #: What is wrong with the driver, and with specific force; nothing as a rule.
    wrench = imu = ''
    #: What was read last, for drivers that freeze, and by how much TF was turned, rad.
    frozen_n: tuple[float, ...] = (0.0,) * 6
    frozen_m_s2, tilted = (0.0, 0.0, GRAVITY), 0.0
    #: Unit of the driver, how often it was started, and its frame.
    unit, driver, publishers, frame = 1.0, 1, 1, OWN_FRAME
    #: Whether the disk is full, how many hold it still, whether it touches; turn by TF, rad.
    full, held_still, touches, tilt = False, 0, False, 0.0
    #: What is held, and what the operator said so.
    held: Payload | None = None
    named: Payload | None = None
    #: By how much the system's clock was set, s, and until when each step counts.
    set_s, fast_until_s, steady_s, work_s = 0.0, FAST_S, 1000.0, 0.0
    #: When the operator will tare, because a status asked for it.
    asked_s = math.inf
    node: Any = None

    def __init__(self, seed: int, models: Path, folder: Path, context: Any) -> None:
        self.seed, self.rng, self._context = seed, np.random.default_rng(seed), context
        self.thermometers = int(self.rng.integers(1, len(PLACES) + 1))
        self.gravity = str(self.rng.choice(['none', 'imu', 'imu', 'tf']))
        self._folder = folder / str(seed)
        #: A good one, and one of a single morning.
        learnt = [learn(models, self.thermometers, mornings) for mornings in (3, 1)]
        own = self._folder / 'models'
        own.mkdir(parents=True)
        self.models = [Path(shutil.copy(model, own)) for model in learnt]
        self._celsius, self._drift = warm(LIFE_S + 7200, self.thermometers, self.rng)
        self.thermometer, self.lies = [''] * self.thermometers, list(range(self.thermometers))
        self._frozen_c = self._celsius[0].tolist()
        self.ahead_s, self.stopped = dict.fromkeys(CLOCKS, 0.0), dict[str, int]()
        #: Turn of what the driver reads, and of what its frame_id announces; its bias, N and N m.
        self.turn, self.shown, self.bias = np.eye(6), np.eye(6), np.zeros(6)
        #: The true load now, and that and the contact which the last tare made zero, N and N m.
        self._load: FloatArray = np.zeros(6)
        self._tared: FloatArray = np.zeros(6)
        self.pushed: FloatArray = np.zeros(6)
        self._out: list[bytes] = []
        self._external: list[bytes] = []
        self.statuses: dict[str, Any] = {}
        #: Files that reach the disk when it becomes full or the node is killed: each save would
        #: take as long as the rest.
        self.saved: dict[str, Callable[[], None]] = {}

    # The node

    def start(self) -> None:
        """Start the node."""
        given = {
            'data_directory': str(self._folder), 'model_file': str(self.models[0]),
            'temperature_topics': [f'temperature_{j}' for j in range(self.thermometers)],
            'gravity.source': self.gravity, 'gravity.frame': 'base000',
        }  # fmt: skip
        overrides = parameters_of(given)
        self.node = CompensatorNode(context=self._context, parameter_overrides=overrides)
        set_logger_level('wrist_ft_comp', LoggingSeverity.FATAL)
        self.node._output.publish = self._out.append
        self.node.external.output.publish = self._external.append
        self.node._diagnostics.publish = self._note
        self.node.now_ns = lambda: self.now_ns() + ORIGIN_NS
        own = self.node.get_name(), self.node.get_namespace()
        self.node.get_node_names_and_namespaces = lambda: [own]
        self.node.get_publishers_info_by_topic = self._graph
        self.node.get_subscriptions_info_by_topic = lambda _topic: []
        self.node.count_publishers = lambda topic: len(self._graph(topic))
        self._layouts = tf_layouts()

    def _graph(self, topic: str) -> list[Any]:
        kind, count = 'sensor_msgs/msg/Temperature', int(not topic.endswith('drift'))
        if topic.endswith('imu'):
            kind = 'sensor_msgs/msg/Imu'
        elif topic.endswith('raw'):
            kind, count = 'geometry_msgs/msg/WrenchStamped', self.publishers
            count += self.wrench == 'mixed'
        return [
            SimpleNamespace(
                topic_type=kind, topic_type_hash=SimpleNamespace(version=0),
                endpoint_gid=[self.driver, n, *[0] * 14], node_name='driver', node_namespace='/',
            )
            for n in range(count)
        ]  # fmt: skip

    def _note(self, array: Any) -> None:
        self.statuses = {status.name.split(': ')[1]: status for status in array.status}

    def _put(
        self,
        writer: FileWriter,
        name: str,
        write: Callable[[], None],
        then: Callable[[str], None] | None = None,
    ) -> None:
        """Write a file: it lies on the disk when the node is killed, unless that is full now."""
        problem = ''
        try:
            if self.full:
                write()
            else:
                self.saved[name] = write
        except WristFtCompError as error:
            problem = str(error)
        writer.problems[name] = problem
        if then:
            writer._outcomes.append((then, problem))

    def _fsync(self, _handle: int) -> None:
        if self.full:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def kill(self, *, forget: bool = False) -> None:
        """Kill the node; perhaps its state is lost."""
        Node.destroy_node(self.node)  # type: ignore[no-untyped-call]
        self.node.store.release()
        self.node, self.statuses = None, {}
        self.flush()
        if forget:
            (self._folder / 'state.json').unlink(missing_ok=True)

    def flush(self) -> None:
        """Let what was written reach the disk."""
        full, self.full = self.full, False
        for write in self.saved.values():
            write()
        self.saved.clear()
        self.full = full

    def name(self, payload: Payload | None) -> None:
        """Tell the node what is held."""
        self.named = payload
        values: dict[str, Any] = {'payload.active': ''}
        if payload is not None:
            values = {
                'payload.active': 'manual', 'payload.mass': payload.mass_kg,
                'payload.center_of_mass': payload.center_m.tolist(),
            }  # fmt: skip
        if self.node and self.gravity != 'none':
            result = self.node.set_parameters_atomically(parameters_of(values))
            self.named = payload if result.successful else None

    def choose(self, model: Path) -> None:
        """Let the node run another model."""
        if self.node is not None:
            (result,) = self.node.set_parameters(parameters_of({'model_file': str(model)}))
            if not result.successful:
                raise WristFtCompError(result.reason)

    def tare(self) -> Iterator[float]:
        """Hold the robot still, when what it holds is named, and tare."""
        self.asked_s = math.inf
        while self.gravity != 'none' and self.held is not self.named:
            yield 5.0
        self.held_still += 1
        yield 1.0
        if self.node is not None:
            (served,) = (s for s in self.node.services if s.service_name.endswith('/tare'))
            (offer,) = (one for one in self.node._offered if one.service is served)
            answers: list[Any] = []
            offer._send = lambda response, answers: answers.append(response)
            untyped: Any = Trigger
            offer._on_header(served.callback(untyped.Request(), untyped.Response()), answers)
            yield 4.0
            if answers and answers[0].success:
                self._tared, self.pushed = self._load.copy(), self.push()
        self.held_still -= 1

    # The world

    def _force(self) -> tuple[float, float, float]:
        """Give specific force in the frame of the sensor, m/s²."""
        roll, pitch = self._angles()
        x, z = -GRAVITY * math.sin(pitch), GRAVITY * math.cos(pitch)
        return x, z * math.sin(roll), z * math.cos(roll)

    def _angles(self) -> tuple[float, float]:
        """Give roll and pitch of the sensor, rad."""
        return 1.2 * math.sin(self.work_s / 7.3), 0.9 * math.sin(self.work_s / 11.7)

    def push(self) -> FloatArray:
        """Give what the world does to the tool, N and N m."""
        swell = max(0.0, math.sin(self.work_s / 15) - 0.7) * 3
        return np.asarray((self.touches or swell) * CONTACT_N)

    def now_ns(self, *_: object) -> int:
        """Give the steady time."""
        return round(self.steady_s * NANOSECONDS)

    def stamp(self, source: str) -> int:
        """Give the time by the clock of a source, ns."""
        ahead_ns = round(self.ahead_s[source] * NANOSECONDS)
        return self.stopped.get(source, ORIGIN_NS + self.now_ns() + ahead_ns)

    def advance(self) -> None:
        """Let time pass until the next step."""
        step_s = LONG_S - self.elapsed_s % LONG_S
        if self.elapsed_s < self.fast_until_s:
            step_s = SHORT_S
        self.step(SHORTEST_S if self.wrench == 'pulses' else step_s)

    def step(self, step_s: float) -> None:
        """Let a time pass, and send what the drivers send then."""
        before_s, self.steady_s = self.steady_s, round(self.steady_s + step_s, 3)
        self.work_s += 0.0 if self.held_still else step_s
        force, is_second = self._force(), int(self.steady_s) > int(before_s)
        second = int(self.elapsed_s)
        weight = self.held.weight(np.array(force)) if self.held else np.zeros(6)
        self._load = weight + self.push()
        self._out.clear()
        self._external.clear()
        if self.node is None:
            return
        if self.gravity != 'none' and self.imu != 'silent':
            self._send_force(*force) if self.gravity == 'imu' else self._send_tf()
        for j in range(self.thermometers if is_second else 0):
            self._send_temperature(j, second)
        self.noise = self.rng.normal(0, 1, 6) * NOISE
        self._send_wrench(ZERO + self.bias + self._drift[second] + self._load + self.noise)
        self.node.housekeep()
        if is_second:
            self.node._diagnose()

    def _send_wrench(self, clean: FloatArray) -> None:
        how, raw = self.wrench, self.unit * self.turn @ clean
        if how == 'saturated' or (how == 'pulses' and self.steady_s % 8 < 4):
            raw[0] = EXTREME_N
        if how == 'stuck':
            raw[2] = self.frozen_n[2]
        if how == 'mixed' and round(self.steady_s * 10) % 3 == 0:
            raw = 0.2 * raw
        if how != 'frozen':
            self.frozen_n = tuple(raw)
        values = {'zeros': (0.0,) * 6, 'nan': (math.nan,) * 6}.get(how, self.frozen_n)
        stamp_ns = 0 if how == 'unstamped' else self.stamp(WRENCH)
        if how != 'silent':
            self.node._on_wrench(message(stamp_ns, values, self.frame))

    def _send_temperature(self, j: int, second: int) -> None:
        how, value = self.thermometer[j], float(self._celsius[second, self.lies[j]])
        # Some are lost, so that means of equal readings differ; never five in a row: that is said.
        if how == 'dead' or (how == 'sparse' and second % 30):
            return
        if self.rng.random() < _LOST and second % 3:
            return
        if how == 'frozen':
            value = self._frozen_c[j]
        self._frozen_c[j] = value
        changed = {
            'zero': 0.0, 'loose': value + 5.0, 'kelvin': value + 273.15, 'tenths': 10 * value,
            'fahrenheit': 1.8 * value + 32, 'nan': math.nan,
        }  # fmt: skip
        stamp_ns = self.stamp(HEAT) - (20 * NANOSECONDS if how == 'late' else 0)
        data = message(stamp_ns, (changed.get(how, value), 0.0))
        self.node.inputs.by_topic[j].read(data)

    def _send_force(self, x: float, y: float, z: float) -> None:
        """Send an Imu, of which only specific force is not 0."""
        if self.imu == 'frozen':
            x, y, z = self.frozen_m_s2
        else:
            x, y, z = (np.array((x, y, z)) + self.rng.normal(0, IMU_NOISE, 3)).tolist()
        self.frozen_m_s2 = x, y, z
        force = {
            'mirrored': (x, -y, z), 'turned': (-y, x, z), 'upside down': (x, -y, -z),
            'in g': (x / GRAVITY, y / GRAVITY, z / GRAVITY), 'nan': (math.nan,) * 3,
        }.get(self.imu, (x, y, z))  # fmt: skip
        data = message(self.stamp(IMU), [*[0.0] * 25, *force, *[0.0] * 9])
        self.node.do(self.node.specific_force, self.node.specific_force.on_imu, data)

    def _send_tf(self) -> None:
        """Send the orientation of now, and of 10 ms before where the frame was moved since."""
        part, tilt = self.node.specific_force, self.tilt if self.imu == 'moved' else 0.0
        moved = [(10_000_000, self.tilted)] if tilt != self.tilted else []
        for before_ns, turn in (*moved, (0, tilt)):
            roll, pitch = self._angles()
            (sr, cr), (sp, cp) = ((math.sin(a / 2), math.cos(a / 2)) for a in (roll + turn, pitch))
            seconds, nanoseconds = divmod(self.stamp(IMU) - before_ns, NANOSECONDS)
            names = 8, b'base000\0', 6, b'tool0\0'
            numbers = 0.0, 0.0, 0.0, cp * sr, sp * cr, -sp * sr, cp * cr
            head = b'\0\1\0\0', 1, seconds, nanoseconds
            data = struct.pack('<4sIIII8sI6s6x7d', *head, *names, *numbers)
            self.node.do(part, lambda data: part.on_tf(self._layouts, data, static=False), data)
        self.tilted = tilt

    # What is asked of it

    @property
    def elapsed_s(self) -> float:
        """Seconds since the life began."""
        return round(self.steady_s - type(self).steady_s, 3)

    def apart_k(self) -> float:
        """Tell how far the first two thermometers are apart, K."""
        one, other = self._celsius[int(self.elapsed_s), :2]
        return float(abs(one - other))

    def between(self, least: float, most: float) -> float:
        """Draw a number."""
        return float(self.rng.uniform(least, most))

    def errors(self) -> dict[str, FloatArray]:
        """Give by how much each output is off, N and N m, (6,); infinitely where there is none."""
        noise = self.unit * self.turn @ self.noise
        true = {'wrench': (self._out, self._load - self._tared)}
        if self.named is not None and self.gravity != 'none':
            true['wrench_external'] = self._external, self.push() - self.pushed
        return {
            name: np.array(struct.unpack('<6d', out[-1][-48:])) - self.shown @ load - noise
            if out
            else np.full(6, np.inf)
            for name, (out, load) in true.items()
        }

    @contextmanager
    def around(self) -> Iterator[None]:
        """Let the node have the clocks and the disk of this life."""

        def put(writer: FileWriter, *what: Any) -> None:
            self._put(writer, *what)

        with ExitStack() as stack:
            for name, fake in {
                'time.monotonic': lambda: self.steady_s,
                'time.monotonic_ns': self.now_ns,
                'time.clock_gettime_ns': self.now_ns,
                'time.time_ns': lambda: (
                    ORIGIN_NS + self.now_ns() + round(self.set_s * NANOSECONDS)
                ),
                'os.fsync': self._fsync,
                'wrist_ft_comp.stored.safe_file.FileWriter.put': put,
            }.items():
                stack.enter_context(mock.patch(name, fake))
            yield


@contextmanager
def surroundings() -> Iterator[Any]:
    """Give a context of ROS, and a type for /tf where its package is missing."""
    package: Any = ModuleType('tf2_msgs.msg')
    package.TFMessage = PoseArray
    context: Any = Context()
    context.init([])
    with mock.patch.dict(sys.modules, {'tf2_msgs': package, 'tf2_msgs.msg': package}):
        yield context
    context.try_shutdown()
