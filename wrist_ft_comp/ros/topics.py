"""
Topics: their quality of service with its reasons, their types, and what is said where one fails.

The type of a topic is known to the ROS graph once there is a publisher.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from copy import copy
import difflib
from typing import Any

from geometry_msgs.msg import WrenchStamped
from rclpy import qos
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.node import Node
from rclpy.qos_overriding_options import InvalidQosOverridesError
from rclpy.serialization import serialize_message

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.errors import SettingsError, WristFtCompError
from wrist_ft_comp.series import NANOSECONDS
from wrist_ft_comp.wire.numbers_in_messages import message_class

#: A topic of whatever type is probably meant where its name is as similar as this, 0 to 1.
_LEAST_SIMILARITY = 0.8

# A topic is given a copy of a profile: rclpy writes what parameters override into the one given.
_profile: Any = qos.QoSProfile  # its constructor carries no types
_BEST_EFFORT, _RELIABLE = qos.ReliabilityPolicy.BEST_EFFORT, qos.ReliabilityPolicy.RELIABLE
#: Drivers publish best effort. Sensor-data QoS keeps only 5 messages, which a pause of a
#: millisecond overruns at 8 kHz; 1000 are an eighth of a second there.
FAST_SENSOR: qos.QoSProfile = _profile(depth=1000, reliability=_BEST_EFFORT)
#: Thermometers are slow (up to 100 Hz) and best effort, too; one second is kept.
SLOW_SENSOR: qos.QoSProfile = _profile(depth=100, reliability=_BEST_EFFORT)
#: Where only the newest message counts, which is polled; ten are kept, as nodes may share a topic.
NEWEST: qos.QoSProfile = _profile(depth=10, reliability=_BEST_EFFORT)
#: What is sent once and kept for those who come later: static transforms.
LATCHED: qos.QoSProfile = _profile(
    depth=100, reliability=_RELIABLE, durability=qos.DurabilityPolicy.TRANSIENT_LOCAL
)
#: Reliable, so that every tool receives it; a controller wants the newest values, not old ones.
OUTPUT: qos.QoSProfile = _profile(depth=10, reliability=_RELIABLE)
#: As any service's, but twenty calls at once overrun the usual queue of 10 without an error.
SERVICE: qos.QoSProfile = copy(qos.qos_profile_services_default)
SERVICE.depth = 1000


#: What rclpy raises for names, parameters and overrides of a quality of service.
ROS_REFUSALS = NameValidationException, ParameterException, InvalidQosOverridesError


@contextmanager
def opening(topic: str) -> Iterator[None]:
    """Turn rclpy's errors about a topic into a SettingsError."""
    try:
        yield
    except (RuntimeError, ValueError, *ROS_REFUSALS) as error:
        # rcl ends its message with ", at FILE:LINE" of its sources; rclpy draws below its own.
        reason = str(error).split(', at /')[0].split('\n')[0].rstrip(':')
        raise SettingsError(
            f'The topic {topic} cannot be used: {reason}. Check its name, its qos_overrides, and '
            'that nothing in this process uses it with another type.'
        ) from error


def disagreement(node: Node, name: str) -> str:
    """Say why another node on a topic, by its relative name, and this one share nothing."""
    topic, here = node.resolve_topic_name(name), (node.get_name(), node.get_namespace())
    for publisher in node.get_publishers_info_by_topic(topic):
        for subscriber in node.get_subscriptions_info_by_topic(topic):
            ends = {(end.node_name, end.node_namespace) for end in (publisher, subscriber)}
            if here not in ends:  # there may be thousands of pairs on /tf
                continue
            found, why = qos.qos_check_compatible(publisher.qos_profile, subscriber.qos_profile)
            if found == qos.QoSCompatibility.ERROR:
                why = why.removeprefix('ERROR: ').rstrip(';')
                return (
                    f'{topic} passes nothing, because its quality of service differs ({why}): set '
                    f'that of the other side; reliability, also by qos_overrides.{topic} here'
                )
    return ''


def types_on(node: Node, topic: str) -> list[str]:
    """List the types that the publishers of a topic, by its full name, have."""
    return sorted({end.topic_type for end in node.get_publishers_info_by_topic(topic)})


def short(name: str) -> str:
    """Write a type as people do, package/Type."""
    return name.replace('/msg/', '/')


def load_type(topic: str, name: str) -> Any:
    """Import the class of a type that a topic carries; WristFtCompError when it can't be used."""
    try:
        found = message_class(topic, name)
        serialize_message(found())  # loads its libraries
    except WristFtCompError:
        raise
    except Exception as error:  # others' code: it may raise anything
        reason = str(error).split('\n')[0].split(', at /')[0].rstrip(':.')
        package = name.partition('/')[0]
        raise SettingsError(
            f'{topic} carries {short(name)}, but the Python package {package} with this type is '
            f'not installed here, or not sourced, or its libraries cannot be loaded ({reason}). '
            f'Install it, such as by apt install ros-$ROS_DISTRO-{package.replace("_", "-")}, '
            'source the workspace that it is in, and start the node again'
        ) from error
    return found


def other_version(node: Node, topic: str) -> str:
    """Say that a publisher's message is defined otherwise than ours, which the node subscribed."""
    here = node.get_name(), node.get_namespace()
    ours = {
        str(end.topic_type_hash)
        for end in node.get_subscriptions_info_by_topic(topic)
        if (end.node_name, end.node_namespace) == here and end.topic_type_hash.version > 0
    }
    for publisher in node.get_publishers_info_by_topic(topic):
        theirs = publisher.topic_type_hash
        if ours and theirs.version > 0 and str(theirs) not in ours:
            # Of a hash RIHS01_ and eight letters, which tell versions apart.
            return (
                f'{topic} carries {short(publisher.topic_type)} of another version, which is not '
                f'read: its hash is {str(theirs)[:15]}…, that of the package installed '
                f'here {min(ours)[:15]}…. Install the version that the driver uses'
            )
    return ''


def wrong_type(node: Node, topic: str, wanted: str) -> str:
    """Say that a topic's publishers, if there are any, are not of the type that is wanted."""
    types = types_on(node, topic)
    if not types or wanted in types:
        return ''
    return f'{topic} carries {short(types[0])}, not {short(wanted)}'


def why_silent(hub: Any, name: str, wanted: str) -> str:
    """Say why no message, of a wanted type or any, comes on a topic; which one may be meant."""
    topic = hub.resolve_topic_name(name)
    if hub.count_publishers(topic):
        said: str = hub.disagreement(name) or (wanted and wrong_type(hub, topic, wanted))
        return said or f'the publisher of {topic} sends nothing; is the sensor running?'
    own = {publisher.topic_name for publisher in hub.publishers}
    others = [
        other
        for other, types in hub.get_topic_names_and_types()
        if other not in own and (not wanted or wanted in types) and hub.count_publishers(other)
    ]
    similarity = 0.0 if wanted else _LEAST_SIMILARITY
    alike = difflib.get_close_matches(topic, others, 1, similarity)
    what = f', a {short(wanted)},' if wanted else ''
    question = f', or is {alike[0]}{what} meant' if alike else ''
    return f'{topic} has no publisher (is the driver running{question}?)'


def wrench_message(stamp_ns: int, frame_id: str, values: Iterable[float]) -> WrenchStamped:
    """Build a message of six numbers, N and N m, axis order AXES."""
    message = WrenchStamped()
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, NANOSECONDS)
    message.header.frame_id = frame_id
    for axis, value in zip(AXES, values, strict=True):
        part, component = axis.split('_')
        setattr(getattr(message.wrench, part), component, float(value))
    return message
