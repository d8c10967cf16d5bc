"""A simulated robot at work: publishes imu, /tf (with tf2_msgs), and the contact wrench."""

from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from geometry_msgs.msg import TransformStamped, WrenchStamped
import numpy as np
from sensor_msgs.msg import Imu

from wrist_ft_comp.series import FloatArray
from wrist_ft_comp.simulation.ft_sensor import NOMINAL_C
from wrist_ft_comp.simulation.work import (
    draw_accelerometer,
    draw_work,
    move,
    read_imu,
    WorkSettings,
)


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
