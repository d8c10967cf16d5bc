"""
The executable ``simulated_sensor``: a wrist sensor that warms up, and a robot, as drivers' nodes.

Simulated time runs ``speed`` times as fast as the wall clock and shows in the stamps only, so
hours of warm-up pass in seconds. A run is the same for the same parameters, message by message.
Where the machine stalls or is too slow, the run falls behind the wall clock: messages of at most
LONGEST_WAKE_S are made up for at once, and no message is left out.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from functools import partial
from math import floor
from operator import itemgetter
import sys
import time
from typing import Any, cast

from geometry_msgs.msg import WrenchStamped
import numpy as np
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import Imu, Temperature
from std_msgs.msg import Header

from wrist_ft_comp.ros.parameters import at_start as _row
from wrist_ft_comp.ros.parameters import Parameters, usage, warn_of_unknown
from wrist_ft_comp.ros.running import run_node
from wrist_ft_comp.ros.topics import opening, SLOW_SENSOR
from wrist_ft_comp.series import FloatArray, IntArray, NANOSECONDS
from wrist_ft_comp.simulation import ft_sensor
from wrist_ft_comp.simulation import robot_at_work as robot

_RUN = ft_sensor.RunSettings()
PARAMETERS = (
    _row('seed', 1, 'Draws the specimen of the sensor, its gauges and their places.', minimum=0),
    _row('run', 0, 'Draws noise, loads and room of this run, for the same sensor.', minimum=0),
    _row('speed', 1.0, 'Simulated seconds per wall second.', minimum=0.01, maximum=10000.0),
    _row('wrench_rate', 100.0, 'Wrenches per wall second.', 'Hz', 0.1, 8000.0),
    _row('temperature_rate', 10.0, 'Temperatures per wall second, of each thermometer.',
         'Hz', 0.1, 1000.0),
    _row('start_stamp_s', 0.0, 'First stamp; 0 means the time of the start.',
         's', 0.0, 2.0**31 - 1),
    _row('loaded', True, f'Whether loads of up to {_RUN.force_n:g} N and {_RUN.torque_nm:g} N m '
         'come and go; a robot at work has others.'),
    _row('tool_mass', 0.0,
         'Mass of a tool on a robot at work: it moves, picks up a part, presses on things, and '
         'publishes imu and wrench_external_reference; 0 is a robot that stands still.',
         'kg', 0.0, 100.0),
    _row('duty_cycle.start_s', _RUN.duty_start_s,
         'Ascending times at which the duty cycle of the motor changes.', 'simulated s', 0.0),
    _row('duty_cycle.level', _RUN.duty_level, 'Duty cycle from each of these times on.',
         minimum=0.0, maximum=1.0))  # fmt: skip

#: Messages due within this time leave in one wake-up, which costs less than a wake-up for each.
SHORTEST_WAKE_S = 0.004
#: The longest pause that is made up for, s.
LONGEST_WAKE_S = 0.05
#: The run begins when no subscriber has come for this time, s: a node's topics are not found at
#: once, and at a high speed a second without a thermometer is the beginning of a warm-up.
SETTLE_S = 1.0
#: Frames of wrenches and temperatures, and of the IMU.
_FRAME, _IMU_FRAME = 'wrist_ft', 'wrist_ft_imu'


class _Topic:
    """A topic and its message, of which only the stamp and numbers of some parts change."""

    def __init__(
        self, node: Node, name: str, message: Any, parts: Sequence[Any], fields: Sequence[str]
    ) -> None:
        with opening(name):  # best effort as real drivers', and deep enough for one wake-up
            self.publisher: Any = node.create_publisher(
                type(message), name, copy(SLOW_SENSOR),
                qos_overriding_options=QoSOverridingOptions.with_default_policies())  # fmt: skip
        self._message, self._stamp = message, message.header.stamp
        self._places = [(part, name) for part in parts for name in fields]

    def send(self, stamp_ns: int, numbers: Sequence[float]) -> None:
        """Publish numbers."""
        self._stamp.sec, self._stamp.nanosec = divmod(stamp_ns, NANOSECONDS)
        for (owner, name), number in zip(self._places, numbers, strict=True):
            setattr(owner, name, number)
        self.publisher.publish(self._message)


def _wrench_topic(node: Node, name: str) -> _Topic:
    message = WrenchStamped(header=Header(frame_id=_FRAME))
    return _Topic(node, name, message, (message.wrench.force, message.wrench.torque), 'xyz')


class SimulatedSensor(Node):
    """Publishes what the sensor reads, what its thermometers read, and the true wrench."""

    def __init__(self, **options: Any) -> None:
        super().__init__('simulated_sensor', **options)
        chosen = Parameters(self, PARAMETERS).values()
        seeds = [chosen['seed'], chosen['run']]
        random = np.random.SeedSequence(seeds).spawn(3)
        draws, self._wrench_rng, self._temperature_rng = map(np.random.default_rng, random)
        settings = ft_sensor.RunSettings(chosen['duty_cycle.start_s'], chosen['duty_cycle.level'])
        if chosen['tool_mass'] > 0 or not chosen['loaded']:
            settings = replace(settings, force_n=0.0, torque_nm=0.0)
        self._run = ft_sensor.draw_run(settings, draws)
        self._sensor = ft_sensor.build_sensor(chosen['seed'])
        self._state = ft_sensor.room_temperature(self._run, 0.0)
        #: Steps of the heat flow that are done.
        self._step = 0
        self._speed, self._wrench_rate = chosen['speed'], chosen['wrench_rate']
        self._temperature_rate = chosen['temperature_rate']
        self._start_ns = round(chosen['start_stamp_s'] * NANOSECONDS)
        #: How long the run has lasted, s, below 0 before its first message, and when it was looked
        #: at last; None before it begins.
        self._ran_s, self._woken_s = -1e-9, cast('float | None', None)
        #: How many subscribers each topic had, and since when.
        self._subscribers, self._subscribed_s = list[int](), 0.0
        self._raw = _wrench_topic(self, 'wrench_raw')
        self._reference = _wrench_topic(self, 'wrench_reference')
        self._thermometers: list[_Topic] = []
        for name in ('temperature', 'temperature_2'):
            variance = ft_sensor.THERMOMETER_NOISE_K**2
            heat = Temperature(header=Header(frame_id=_FRAME), variance=variance)
            self._thermometers.append(_Topic(self, name, heat, [heat], ['temperature']))
        #: Of a robot at work: its program.
        self._work: robot.Work | None = None
        if (mass_kg := chosen['tool_mass']) > 0:
            tools, program, self._imu_rng, imu_rng = (
                np.random.default_rng(seed)
                for seed in ([seeds[0], 4], [*seeds, 2], [*seeds, 3], [seeds[0], 1])
            )
            self._accelerometer = robot.draw_accelerometer(imu_rng)
            imu = Imu(header=Header(frame_id=_IMU_FRAME))
            imu.orientation_covariance[0] = -1.0  # REP 145: no orientation
            felt = imu.linear_acceleration, imu.angular_velocity
            self._imu = _Topic(self, 'imu', imu, felt, 'xyz')
            self._contact = _wrench_topic(self, 'wrench_external_reference')
            self._work = robot.draw_work(robot.WorkSettings(mass_kg), program, tools)
        logger = cast('Any', self).get_logger()
        warn_of_unknown(self, logger)
        logger.info('Waiting for subscribers; the run begins when the last of them has come.')
        wake_s = max(SHORTEST_WAKE_S, 1.0 / max(self._wrench_rate, self._temperature_rate))
        # A steady clock: neither a simulated nor a stepped clock changes the rate.
        self.create_timer(wake_s, self._wake, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _wake(self) -> None:
        """Publish what has become due since the last wake-up, in the order of the stamps."""
        now_s = time.monotonic()
        if self._woken_s is None:
            # The run begins when somebody listens, and nobody has come or gone lately.
            topics = (self._raw, self._reference, *self._thermometers)
            subscribers = [topic.publisher.get_subscription_count() for topic in topics]
            if subscribers != self._subscribers:
                self._subscribers, self._subscribed_s = subscribers, now_s
            if not any(subscribers) or now_s - self._subscribed_s < SETTLE_S:
                return
            self._start_ns = self._start_ns or self.get_clock().now().nanoseconds
            self._woken_s = now_s
        before_s, passed_s = self._ran_s, min(now_s - self._woken_s, LONGEST_WAKE_S)
        self._ran_s, self._woken_s = max(before_s, 0.0) + passed_s, now_s
        due_ns: list[IntArray] = []
        for rate in (self._wrench_rate, self._temperature_rate):
            numbers = np.arange(floor(before_s * rate) + 1, floor(self._ran_s * rate) + 1)
            due_ns.append(np.rint(numbers * (self._speed / rate * NANOSECONDS)).astype(np.int64))
        wrench_ns, temperature_ns = due_ns
        # Advance the heat to the latest of these times; node temperatures at each of them.
        first, step_ns = self._step, round(ft_sensor.STEP_S * NANOSECONDS)
        steps = [times_ns // step_ns for times_ns in due_ns]
        self._step = int(np.concatenate(steps).max(initial=first))
        begins_s: FloatArray = np.arange(first, self._step, dtype=np.float64) * ft_sensor.STEP_S
        drive = ft_sensor.drive(self._run, begins_s)
        nodes_c = ft_sensor.trajectory(self._sensor, self._state, drive)
        self._state = nodes_c[-1]
        wrench_nodes_c, temperature_nodes_c = (
            nodes_c[np.maximum(step - first, 0)] for step in steps
        )
        elapsed_s = wrench_ns / NANOSECONDS
        true = ft_sensor.true_wrench(self._run, elapsed_s)
        rng = self._temperature_rng
        read = ft_sensor.digitised_temperatures(self._sensor, temperature_nodes_c, rng)
        # Topics with the times and numbers of their messages; those of one time go in this order.
        streams: list[tuple[_Topic, IntArray, FloatArray]] = [
            (topic, temperature_ns, read[:, [j]]) for j, topic in enumerate(self._thermometers)
        ]
        if self._work is not None:
            motion = robot.move(self._work, elapsed_s)
            near_c = ft_sensor.thermometer_temperatures(self._sensor, wrench_nodes_c)[:, 0]
            warmth_k = near_c - ft_sensor.NOMINAL_C
            felt = robot.read_imu(self._accelerometer, motion, warmth_k, self._imu_rng)
            contact = true + motion.contact
            true = contact + motion.weight
            streams += [(self._imu, wrench_ns, felt), (self._contact, wrench_ns, contact)]
        ideal = ft_sensor.measured_wrench(self._sensor, wrench_nodes_c, true)
        raw = ft_sensor.digitised_wrench(ideal, self._wrench_rng)
        streams += [(self._reference, wrench_ns, true), (self._raw, wrench_ns, raw)]
        due = [
            (elapsed_ns, topic, numbers)
            for topic, times_ns, rows in streams
            for elapsed_ns, numbers in zip(times_ns.tolist(), rows.tolist(), strict=True)
        ]
        for elapsed_ns, topic, numbers in sorted(due, key=itemgetter(0)):
            topic.send(self._start_ns + elapsed_ns, numbers)


#: What --help says, between the first line and the parameters.
_USAGE = """\
Simulates a wrist force/torque sensor that warms up, as a driver's node, to try
the compensator on:

  simulated_sensor --ros-args -p speed:=100.0 -p temperature_rate:=100.0 \\
    -p loaded:=false

publishes  wrench_raw, wrench_reference (the true wrench), temperature, and
           temperature_2; with -p tool_mass:=1.4 also imu and
           wrench_external_reference (what pushes on the tool)
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the node until a signal ends it; returns the exit code."""
    explain = partial(usage, 'simulated_sensor', _USAGE, PARAMETERS)
    return run_node(SimulatedSensor, argv, explain)


if __name__ == '__main__':
    sys.exit(main())
