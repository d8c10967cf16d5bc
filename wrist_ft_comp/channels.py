"""
The channels of a recording, named like the columns of its CSV file.

``force_x`` … ``torque_z`` (raw wrench, N and N m), ``reference_force_x`` … (reference wrench),
``temperature_c``, ``temperature_2_c`` …, ``linear_acceleration_x`` … (specific force, m/s²: +9.81
upwards at rest), ``rotation_speed`` (rad/s); their units, and what a sensor can read.
"""

from collections.abc import Mapping, Sequence
import math

#: The names of a sensor, by fact: one name, but of temperature_topics one per thermometer.
#: A fact that is not known is left out.
SensorNames = Mapping[str, Sequence[str]]
SENSOR_FACTS = ('hardware_id', 'frame_id', 'wrench_topic', 'temperature_topics')

#: Axis order of every wrench array in this package.
AXES = ('force_x', 'force_y', 'force_z', 'torque_x', 'torque_y', 'torque_z')
REFERENCE_CHANNELS = tuple(f'reference_{axis}' for axis in AXES)
FORCE_CHANNELS = ('linear_acceleration_x', 'linear_acceleration_y', 'linear_acceleration_z')
ROTATION_CHANNEL = 'rotation_speed'
#: Channels with one name, which are sampled together; thermometers have a number and a unit.
GROUPS = (AXES, REFERENCE_CHANNELS, FORCE_CHANNELS, (ROTATION_CHANNEL,))
CHANNELS = tuple(channel for group in GROUPS for channel in group)
#: By the first words of channels: their units. Those of torques are N m.
_UNITS = {'temperature': '°C', 'force': 'N', 'linear': 'm/s²', 'rotation': 'rad/s'}
#: Norm of the specific force at rest, m/s².
GRAVITY = 9.807
#: A thermometer of a wrist reads between these, °C; 0 K and readings in kelvin lie outside.
PLAUSIBLE_C = (-100.0, 200.0)
#: Every other channel stays below this in any unit; a larger number is damaged: sums overflow.
LARGEST = 1e9


def axis_unit(axis: str) -> str:
    """Return the unit of an axis, or of any other channel."""
    return _UNITS.get(axis.removeprefix('reference_').partition('_')[0], 'N m')


def is_plausible(value: float) -> bool:
    """Tell whether a thermometer may read a value, °C; NaN and infinities may not."""
    return PLAUSIBLE_C[0] < value < PLAUSIBLE_C[1]


def temperature_channel(thermometer: int) -> str:
    """Name the channel of a thermometer, counted from 0, which is the one inside the sensor."""
    return 'temperature_c' if thermometer == 0 else f'temperature_{thermometer + 1}_c'


def why_unusable(channel: str, value: float) -> str:
    """Say what is wrong with readings of a channel such as a value that no sensor makes."""
    if not math.isfinite(value):
        return 'not finite'
    (low, high), unit = limits_of(channel), ' °C' if channel.startswith('temperature') else ''
    return f'outside {low:g} to {high:g}{unit}, which no sensor reads, such as {value:.4g}{unit}'


def limits_of(channel: str) -> tuple[float, float]:
    """Tell between which numbers every reading of a channel lies."""
    return PLAUSIBLE_C if channel.startswith('temperature') else (-LARGEST, LARGEST)
