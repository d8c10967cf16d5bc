"""Quality of service: profiles with their reasons, and what parameters may override of them."""

from collections.abc import Iterator
from contextlib import contextmanager
from copy import copy
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    qos_profile_services_default,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions

from wrist_ft_comp.errors import SettingsError

# A topic is given a copy of a profile: rclpy writes what parameters override into the one given.
_profile: Any = QoSProfile  # its constructor carries no types
#: Drivers publish best effort. Sensor-data QoS keeps only 5 messages, which a pause of a
#: millisecond overruns at 8 kHz; 1000 are an eighth of a second there.
FAST_SENSOR: QoSProfile = _profile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
#: Thermometers are slow (up to 100 Hz) and best effort, too; one second is kept.
SLOW_SENSOR: QoSProfile = _profile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
#: Where only the newest message counts, which is polled.
NEWEST: QoSProfile = _profile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
#: What is sent once and kept for those who come later: static transforms.
LATCHED: QoSProfile = _profile(
    depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
#: Reliable, so that every tool receives it; a controller wants the newest values, not old ones.
OUTPUT: QoSProfile = _profile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
#: As any service's, but twenty calls at once overrun the usual queue of 10 without an error.
SERVICE: QoSProfile = copy(qos_profile_services_default)
SERVICE.depth = 1000


def overridable() -> QoSOverridingOptions:
    """Let parameters override history, depth and reliability; a depth that holds nothing can't."""

    def check(profile: QoSProfile) -> SetParametersResult:
        holds = profile.depth > 0 or profile.history == HistoryPolicy.KEEP_ALL
        reason = f'depth must be an integer of at least 1; got {profile.depth}'
        return SetParametersResult(successful=holds, reason='' if holds else reason)

    return QoSOverridingOptions.with_default_policies(callback=check)


#: What rclpy raises for a topic, for its name, or for an override of its quality of service.
_REFUSALS = (
    RuntimeError,
    ValueError,
    NameValidationException,
    InvalidQosOverridesError,
    ParameterException,
)


@contextmanager
def opening(topic: str) -> Iterator[None]:
    """Turn rclpy's errors about a topic into a SettingsError."""
    try:
        yield
    except _REFUSALS as error:
        # rcl ends its message with ", at FILE:LINE" of its sources; rclpy draws below its own.
        reason = str(error).split(', at /')[0].split('\n')[0].rstrip(':')
        raise SettingsError(
            f'The topic {topic} cannot be used: {reason}. Check its name, its qos_overrides, and '
            'that nothing in this process uses it with another type.'
        ) from error
