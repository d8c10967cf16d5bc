"""
The executable ``simulated_sensor``: a wrist sensor that warms up, and a robot, as drivers' nodes.

Simulated time runs ``speed`` times as fast as the wall clock and shows in the stamps only, so
hours of warm-up pass in seconds. A run is the same for the same parameters, message by message.
Where the machine stalls or is too slow, the run falls behind the wall clock: messages of at most
LONGEST_WAKE_S are made up for at once, and no message is left out.
"""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from functools import partial
from importlib import import_module
from importlib.util import find_spec
import sys
import time
from typing import Any, cast

from geometry_msgs.msg import TransformStamped, WrenchStamped
import numpy as np
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import Imu, Temperature

from wrist_ft_comp.ros.parameters import at_start as _row
from wrist_ft_comp.ros.parameters import Parameters, usage, warn_of_unknown
from wrist_ft_comp.ros.running import run_node
from wrist_ft_comp.ros.topics import opening, SLOW_SENSOR
from wrist_ft_comp.series import FloatArray, IntArray, NANOSECONDS
from wrist_ft_comp.simulation import ft_sensor
from wrist_ft_comp.simulation.ft_sensor import FtSensorSettings, NOMINAL_C
from wrist_ft_comp.simulation.run import (
    draw_run,
    drive,
    room_temperature,
    RunSettings,
    true_wrench,
)
from wrist_ft_comp.simulation.work import (
    draw_accelerometer,
    draw_work,
    move,
    read_imu,
    WorkSettings,
)

_RUN = RunSettings()
PARAMETERS = (
    _row('seed', 1, 'Draws the specimen of the sensor, its gauges and their places.', minimum=0),
    _row('run', 0, 'Draws noise, loads and room of this run, for the same sensor.', minimum=0),
    _row('speed', 1.0, 'Simulated seconds per wall second.', minimum=0.01, maximum=10000.0),
    _row('wrench_rate', 100.0, 'Wrenches per wall second.', 'Hz', 0.1, 8000.0),
    _row('temperature_rate', 10.0, 'Temperatures per wall second, of each thermometer.',
         'Hz', 0.1, 1000.0),
    _row('frame_id', 'wrist_ft', 'Frame of the messages.'),
    _row('start_stamp_s', 0.0, 'First stamp; 0 means the time of the start.',
         's', 0.0, 2.0**31 - 1),
    _row('loaded', True, f'Whether loads of up to {_RUN.force_n:g} N and {_RUN.torque_nm:g} N m '
         'come and go; a robot at work has others.'),
    _row('tool_mass', 0.0,
         'Mass of a tool on a robot at work: it moves, picks up a part, presses on things, and '
         'publishes imu, /tf (where tf2_msgs is installed) and wrench_external_reference; 0 is a '
         'robot that stands still.', 'kg', 0.0, 100.0),
    _row('duty_cycle.start_s', _RUN.duty_start_s,
         'Ascending times at which the duty cycle of the motor changes.', 'simulated s', 0.0),
    _row('duty_cycle.level', _RUN.duty_level, 'Duty cycle from each of these times on.',
         minimum=0.0, maximum=1.0),
)  # fmt: skip

#: Messages due within this time leave in one wake-up, which costs less than a wake-up for each.
SHORTEST_WAKE_S = 0.004
#: The longest pause that is made up for.
LONGEST_WAKE_S = 0.05
#: The run begins when no subscriber has come for this time, s: a node's topics are not found at
#: once, and at a high speed a second without a thermometer is the beginning of a warm-up.
SETTLE_S = 1.0


class SimulatedSensor(Node):
    """Publishes what the sensor reads, what its thermometers read, and the true wrench."""

    def __init__(self, **options: Any) -> None:
        super().__init__('simulated_sensor', **options)
        chosen = Parameters(self, PARAMETERS).values()
        seeds = [chosen['seed'], chosen['run']]
        random = np.random.SeedSequence(seeds).spawn(3)
        draws, self._wrench_rng, self._temperature_rng = map(np.random.default_rng, random)
        at_work = chosen['tool_mass'] > 0
        settings = RunSettings(chosen['duty_cycle.start_s'], chosen['duty_cycle.level'])
        if at_work or not chosen['loaded']:
            settings = replace(settings, force_n=0.0, torque_nm=0.0)
        self._run = draw_run(settings, draws)
        self._sensor = ft_sensor.build_sensor(FtSensorSettings(), chosen['seed'])
        self._state = ft_sensor.start(self._sensor, float(room_temperature(self._run, 0.0)))
        #: Steps of the heat flow that are done.
        self._step = 0
        self._wrenches = _Ticks(chosen['wrench_rate'], chosen['speed'])
        self._temperatures = _Ticks(chosen['temperature_rate'], chosen['speed'])
        self._start_ns = round(chosen['start_stamp_s'] * NANOSECONDS)
        #: How long the run has lasted, s, and when it was looked at last; None before it begins.
        self._ran_s, self._woken_s = 0.0, cast('float | None', None)
        #: How many subscribers each topic had, and since when.
        self._subscribers, self._subscribed_s = list[int](), 0.0
        self._open_topics(chosen['frame_id'])
        self._robot = None
        if at_work:
            work = WorkSettings(chosen['tool_mass'])
            self._robot = SimulatedRobot(work, seeds, self._raw, self._advertise)
        wake_s = max(SHORTEST_WAKE_S, 1.0 / max(self._wrenches.rate, self._temperatures.rate))
        # A steady clock: neither a simulated nor a stepped clock changes the rate.
        self.create_timer(wake_s, self._wake, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _open_topics(self, frame_id: str) -> None:
        """Make publishers, and messages, of which only stamps and readings change."""
        self._reference, self._raw = WrenchStamped(), WrenchStamped()
        self._readings = [Temperature(), Temperature()]
        for message in (self._reference, self._raw, *self._readings):
            message.header.frame_id = frame_id
        for reading in self._readings:
            reading.variance = self._sensor.settings.thermometer_noise_k**2
        self._to_raw = self._advertise(WrenchStamped, 'wrench_raw')
        self._to_reference = self._advertise(WrenchStamped, 'wrench_reference')
        self._to_temperatures = [
            self._advertise(Temperature, topic) for topic in ('temperature', 'temperature_2')
        ]
        logger = cast('Any', self).get_logger()
        warn_of_unknown(self, logger)
        logger.info('Waiting for subscribers; the run begins when the last of them has come.')

    def _advertise(self, message_type: Any, topic: str) -> Any:
        """Make a publisher, best effort as real drivers' and deep enough for one wake-up."""
        with opening(topic):
            return self.create_publisher(
                message_type,
                topic,
                copy(SLOW_SENSOR),
                qos_overriding_options=QoSOverridingOptions.with_default_policies(),
            )

    def _wake(self) -> None:
        """Publish what has become due since the last wake-up, in the order of the stamps."""
        now_s = time.monotonic()
        if self._woken_s is None:
            # The run begins when somebody listens, and nobody has come or gone lately.
            publishers = (self._to_raw, self._to_reference, *self._to_temperatures)
            subscribers = [publisher.get_subscription_count() for publisher in publishers]
            if subscribers != self._subscribers:
                self._subscribers, self._subscribed_s = subscribers, now_s
            if not any(subscribers) or now_s - self._subscribed_s < SETTLE_S:
                return
            self._start_ns = self._start_ns or self.get_clock().now().nanoseconds
            self._woken_s = now_s
        self._ran_s += min(now_s - self._woken_s, LONGEST_WAKE_S)
        self._woken_s = now_s
        wrench_ns = self._wrenches.due(self._ran_s)
        temperature_ns = self._temperatures.due(self._ran_s)
        # Advance the heat to the latest of these times; node temperatures at each of them.
        step_s, first = self._sensor.settings.step_s, self._step
        steps = [due_ns // round(step_s * NANOSECONDS) for due_ns in (wrench_ns, temperature_ns)]
        self._step = max(first, *(int(step[-1]) for step in steps if len(step)), first)
        begins_s: FloatArray = np.arange(first, self._step, dtype=np.float64) * step_s
        nodes_c = ft_sensor.trajectory(self._sensor, self._state, drive(self._run, begins_s))
        self._state = nodes_c[-1]
        wrench_nodes_c, temperature_nodes_c = (
            nodes_c[np.maximum(step - first, 0)] for step in steps
        )
        elapsed_s = wrench_ns / NANOSECONDS
        true = true_wrench(self._run, elapsed_s)
        if self._robot is not None:
            near_c = ft_sensor.thermometer_temperatures(self._sensor, wrench_nodes_c)[:, 0]
            true = self._robot.move(elapsed_s, near_c, true)
        ideal = ft_sensor.measured_wrench(self._sensor, wrench_nodes_c, true)
        raw = ft_sensor.digitised_wrench(self._sensor, ideal, self._wrench_rng)
        read = ft_sensor.digitised_temperatures(
            self._sensor, temperature_nodes_c, self._temperature_rng
        )
        wrenches = zip(true.tolist(), raw.tolist(), strict=True)
        due = [
            *((ns, 0, values) for ns, values in zip(temperature_ns.tolist(), read, strict=True)),
            *((ns, 1, pair) for ns, pair in zip(wrench_ns.tolist(), wrenches, strict=True)),
        ]
        number = 0
        for elapsed_ns, is_wrench, values in sorted(due, key=lambda one: one[:2]):
            if not is_wrench:
                outputs = zip(self._to_temperatures, self._readings, values, strict=True)
                for publisher, message, celsius in outputs:
                    self._stamp(message, elapsed_ns)
                    message.temperature = float(celsius)
                    publisher.publish(message)
                continue
            load, reading = values
            self._send_wrench(self._to_reference, self._reference, elapsed_ns, load)
            if self._robot is not None:
                self._stamp(self._raw, elapsed_ns)
                self._robot.send(number)
            self._send_wrench(self._to_raw, self._raw, elapsed_ns, reading)
            number += 1

    def _stamp(self, message: Any, elapsed_ns: int) -> None:
        stamp = message.header.stamp
        stamp.sec, stamp.nanosec = divmod(self._start_ns + elapsed_ns, NANOSECONDS)

    def _send_wrench(
        self, publisher: Any, message: Any, elapsed_ns: int, wrench: list[float]
    ) -> None:
        """Send a wrench, N and N m in the order of AXES."""
        self._stamp(message, elapsed_ns)
        force, torque = message.wrench.force, message.wrench.torque
        force.x, force.y, force.z, torque.x, torque.y, torque.z = wrench
        publisher.publish(message)


class SimulatedRobot:
    """
    Moves, holds tools and presses; its messages have the stamp of ``wrench``.

    The seeds are those of the specimen and of the run; ``advertise`` makes a publisher.
    """

    def __init__(
        self,
        settings: WorkSettings,
        seeds: Sequence[int],
        wrench: WrenchStamped,
        advertise: Callable[[Any, str], Any],
    ) -> None:
        self._accelerometer = draw_accelerometer(np.random.default_rng([seeds[0], 1]))
        tools = np.random.default_rng([seeds[0], 4])
        self._work = draw_work(settings, np.random.default_rng([*seeds, 2]), tools)
        self._rng = np.random.default_rng([*seeds, 3])
        #: Readings (n, 6), quaternions (n, 4), and contacts (n, 6) of the last call of ``move``.
        self._moved: tuple[list[list[float]], ...] = ()
        frame_id = wrench.header.frame_id
        self._imu, self._pose, self._contact = Imu(), TransformStamped(), WrenchStamped()
        self._imu.header.frame_id = f'{frame_id}_imu'
        self._imu.orientation_covariance[0] = -1.0  # REP 145: no orientation
        self._pose.header.frame_id, self._pose.child_frame_id = 'world', frame_id
        self._contact.header.frame_id = frame_id
        for message in (self._imu, self._pose, self._contact):
            message.header.stamp = wrench.header.stamp  # one object, which the wrench's owner sets
        self._to_imu = advertise(Imu, 'imu')
        self._to_contact = advertise(WrenchStamped, 'wrench_external_reference')
        #: Wheels of ROS 2 lack tf2_msgs; a system's installation has it.
        self._tf: Any = import_module('tf2_msgs.msg').TFMessage if find_spec('tf2_msgs') else None
        self._to_tf: Any = self._tf and advertise(self._tf, '/tf')

    def move(self, elapsed_s: FloatArray, near_c: FloatArray, load: FloatArray) -> FloatArray:
        """
        Move at times, s, and temperatures, °C, (n,); give the whole wrench on the sensor, (n, 6).

        ``load``, N and N m, (n, 6), is added to the contacts.
        """
        motion = move(self._work, elapsed_s)
        readings = read_imu(self._accelerometer, motion, near_c - NOMINAL_C, self._rng)
        contact = load + motion.contact
        self._moved = readings.tolist(), motion.pose.as_quat().tolist(), contact.tolist()
        return np.asarray(contact + motion.weight)

    def send(self, number: int) -> None:
        """Publish the messages of one of the times."""
        reading, pose, contact = (values[number] for values in self._moved)
        felt, turning = self._imu.linear_acceleration, self._imu.angular_velocity
        felt.x, felt.y, felt.z, turning.x, turning.y, turning.z = reading
        self._to_imu.publish(self._imu)
        if self._tf is not None:
            rotation = self._pose.transform.rotation
            rotation.x, rotation.y, rotation.z, rotation.w = pose
            self._to_tf.publish(self._tf(transforms=[self._pose]))
        force, torque = self._contact.wrench.force, self._contact.wrench.torque
        force.x, force.y, force.z, torque.x, torque.y, torque.z = contact
        self._to_contact.publish(self._contact)


class _Ticks:
    """Counts the messages of one stream: which are due, and their simulated times."""

    def __init__(self, rate: float, speed: float) -> None:
        self.rate = rate
        self._step_ns = speed / rate * NANOSECONDS
        self._sent = 0

    def due(self, ran_s: float) -> IntArray:
        """Give the simulated times of the messages due after ran_s of wall time, ns, and count."""
        total = int(ran_s * self.rate) + 1
        ticks = np.arange(self._sent, total)
        self._sent = max(total, self._sent)
        return np.asarray(np.rint(ticks * self._step_ns).astype(np.int64))


#: What --help says, between the first line and the parameters.
_USAGE = """\
Simulates a wrist force/torque sensor that warms up, as a driver's node, to try
the compensator on:

  simulated_sensor --ros-args -p speed:=100.0 -p temperature_rate:=100.0 \\
    -p loaded:=false

publishes  wrench_raw, wrench_reference (the true wrench), temperature, and
           temperature_2; with -p tool_mass:=1.4 also imu, /tf, and
           wrench_external_reference (what pushes on the tool)
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the node until a signal ends it; returns the exit code."""
    explain = partial(usage, 'simulated_sensor', _USAGE, PARAMETERS)
    return run_node(SimulatedSensor, argv, explain)


if __name__ == '__main__':
    sys.exit(main())
