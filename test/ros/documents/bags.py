"""
Write two bags as a robot would: ``warm_up`` and ``another_day``, with a Bota driver's topics.

A program, so that the test asks nothing but rosbags and the core's simulated sensor.
"""

from pathlib import Path
import sys

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores

from wrist_ft_comp.simulation import ft_sensor
from wrist_ft_comp.simulation import run as simulated_run

PREFIX = '/bus0/ft_sensor0/ft_sensor_readings'
SECONDS = 7200
DAY_NS = 86_400 * 10**9
#: When the duty cycle of the motor changes, and to what.
DAYS = {
    'warm_up': ((0, 0.0), (600, 0.9), (4200, 0.0), (5700, 0.5)),
    'another_day': ((0, 0.2), (1200, 0.8), (3000, 0.1), (5400, 0.6)),
}


def simulate(number, duty):
    """Wrench and temperatures of a day, once a second."""
    rng = np.random.default_rng([1, number])
    sensor = ft_sensor.build_sensor(ft_sensor.FtSensorSettings(), 1)
    settings = simulated_run.RunSettings(
        duty_start_s=tuple(float(start) for start, _ in duty),
        duty_level=tuple(level for _, level in duty),
        force_n=0.0,
        torque_nm=0.0,
    )
    run = simulated_run.draw_run(settings, rng)
    elapsed_s = np.arange(SECONDS) + 0.5
    drive = simulated_run.drive(run, elapsed_s)
    start = ft_sensor.start(sensor, float(drive[0, 1]))
    true = simulated_run.true_wrench(run, elapsed_s)
    result = ft_sensor.simulate(sensor, start, drive, true, (rng, rng))
    return result.wrench, result.temperature_c


def write(folder, number, duty):
    """Write the bag of a day."""
    store = get_typestore(Stores.ROS2_JAZZY)
    of = store.types.__getitem__
    vector, time = of('geometry_msgs/msg/Vector3'), of('builtin_interfaces/msg/Time')
    wrench_type, heat_type = 'geometry_msgs/msg/WrenchStamped', 'sensor_msgs/msg/Temperature'
    wrenches, temperatures = simulate(number, duty)
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        wrench = bag.add_connection(f'{PREFIX}/wrench', wrench_type, typestore=store)
        heats = [
            bag.add_connection(topic, heat_type, typestore=store)
            for topic in (f'{PREFIX}/temperature', '/joint_6/temperature')
        ]
        for second in range(SECONDS):
            stamp_ns = number * DAY_NS + second * 10**9
            header = of('std_msgs/msg/Header')(time(stamp_ns // 10**9, 0), 'ft_sensor0')
            force, torque = (vector(*part) for part in wrenches[second].reshape(2, 3).tolist())
            message = of(wrench_type)(header, of('geometry_msgs/msg/Wrench')(force, torque))
            bag.write(wrench, stamp_ns, store.serialize_cdr(message, wrench_type))
            for heat, value in zip(heats, temperatures[second].tolist(), strict=True):
                message = of(heat_type)(header, value, 0.0)
                bag.write(heat, stamp_ns, store.serialize_cdr(message, heat_type))


if __name__ == '__main__':
    for number, (name, duty) in enumerate(DAYS.items(), start=1):
        write(Path(sys.argv[1], name), number, duty)
