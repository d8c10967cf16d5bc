"""Typed messages from numbers."""

from collections.abc import Iterable

from geometry_msgs.msg import WrenchStamped

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.series import NANOSECONDS


def wrench_message(stamp_ns: int, frame_id: str, values: Iterable[float]) -> WrenchStamped:
    """Build a message of six numbers, N and N m, axis order AXES."""
    message = WrenchStamped()
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, NANOSECONDS)
    message.header.frame_id = frame_id
    for axis, value in zip(AXES, values, strict=True):
        part, component = axis.split('_')
        setattr(getattr(message.wrench, part), component, float(value))
    return message
