"""Quality of service, each profile with its reason."""

from copy import copy
from typing import Any

from rclpy.qos import QoSProfile, ReliabilityPolicy

_profile: Any = QoSProfile  # its constructor carries no types

#: Drivers publish best effort. Sensor-data QoS keeps only 5 messages, which a pause of a
#: millisecond overruns at 8 kHz; 1000 are an eighth of a second there.
FAST_SENSOR: QoSProfile = _profile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)

#: Thermometers are slow (up to 100 Hz) and best effort, too; one second is kept.
SLOW_SENSOR: QoSProfile = _profile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)

#: Reliable, so that every tool receives it; a controller wants the newest values, not old ones.
OUTPUT: QoSProfile = _profile(depth=10, reliability=ReliabilityPolicy.RELIABLE)


def own(profile: QoSProfile) -> QoSProfile:
    """
    Copy a profile for one topic: rclpy writes what parameters override into the one it is given.

    Parameters
    ----------
    profile : QoSProfile
        One of the above.

    Returns
    -------
    QoSProfile
        Equal to it.

    """
    return copy(profile)
