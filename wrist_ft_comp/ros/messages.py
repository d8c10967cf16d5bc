"""Wrenches as typed messages, where speed does not matter."""

from collections.abc import Iterable, Sequence
from copy import copy
import struct
from typing import Any, NamedTuple

from geometry_msgs.msg import WrenchStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy

from wrist_ft_comp.files.cdr import locate
from wrist_ft_comp.model.signals import AXES, NANOSECONDS

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


#: Byte at which frame_id begins.
_FRAME = 16


#: As much of a frame's name is shown, bytes; no sensor's is longer.
_SHOWN = 255


#: Layouts kept per topic; a sender that varies its frame names starts the collection anew.
_MAX_LAYOUTS = 100


class Layout(NamedTuple):
    """
    Where the parts of a message lie.

    Attributes
    ----------
    key : tuple
        What tells messages of this layout from others: size, byte order and frame length.
    frame_end : int
        First byte behind frame_id.
    offset : int
        First byte of the doubles.
    doubles : struct.Struct
        The doubles.
    numbers : struct.Struct
        Of a whole message: seconds and nanoseconds of its stamp, and the doubles.

    """

    key: tuple[int, bytes, bytes]
    frame_end: int
    offset: int
    doubles: struct.Struct
    numbers: struct.Struct


class Wire:
    """
    Reads messages of one topic: a header, then doubles.

    Parameters
    ----------
    count : int
        Number of doubles: 6 of a WrenchStamped, 2 of a Temperature.

    """

    def __init__(self, count: int) -> None:
        self._count = count
        # A topic's messages share one layout, so the checks are made once per layout.
        self._known: dict[tuple[int, bytes, bytes], Layout] = {}
        self._latest: Layout | None = None

    def read(self, data: bytes) -> tuple[Layout, int, tuple[float, ...]]:
        """
        Read stamp and doubles.

        Parameters
        ----------
        data : bytes
            Serialized message.

        Returns
        -------
        tuple of Layout, int and tuple of float
            For replace and frame_id; header stamp, ns; the doubles.

        Raises
        ------
        RecordingError
            When the bytes are no such message.

        """
        layout = self._latest
        if layout is None or layout.key != (len(data), data[:2], data[12:_FRAME]):
            layout = self._latest = self.layout(data)
        numbers = layout.numbers.unpack(data)
        return layout, numbers[0] * NANOSECONDS + numbers[1], numbers[2:]

    def layout(self, data: bytes) -> Layout:
        """
        Find out where the parts lie.

        Parameters
        ----------
        data : bytes
            Serialized message.

        Returns
        -------
        Layout
            For replace and frame_id.

        Raises
        ------
        RecordingError
            When the bytes are no such message.

        """
        key = (len(data), data[:2], data[12:_FRAME])
        known = self._known.get(key)
        if known is None:
            located = locate(data, self._count)
            offset, order = located.offset, '<' if data[1] else '>'
            known = Layout(
                key,
                located.frame_end,
                offset,
                struct.Struct(f'{order}{self._count}d'),
                struct.Struct(f'{order}4xiI{offset - 12}x{self._count}d'),
            )
            if len(self._known) >= _MAX_LAYOUTS:
                self._known.clear()
            self._known[key] = known
        return known


def frame_id(layout: Layout, data: bytes) -> str:
    """
    Read the frame name.

    Parameters
    ----------
    layout : Layout
        From Wire.layout of the same bytes.
    data : bytes
        Serialized message.

    Returns
    -------
    str
        Without the bytes that only align what follows it; its first 255 bytes only.

    """
    end = min(layout.frame_end, _FRAME + _SHOWN)
    return data[_FRAME:end].rstrip(b'\0').decode(errors='replace')


def replace(layout: Layout, data: bytes, doubles: Sequence[float]) -> bytes:
    """
    Write other doubles behind the same header.

    Parameters
    ----------
    layout : Layout
        From Wire.layout of the same bytes.
    data : bytes
        Serialized message.
    doubles : sequence of float
        As many as the message holds.

    Returns
    -------
    bytes
        A new message; header and byte order are the old one's.

    """
    return data[: layout.offset] + layout.doubles.pack(*doubles)


def wrench_message(stamp_ns: int, frame_id: str, values: Iterable[float]) -> WrenchStamped:
    """
    Build a message.

    Parameters
    ----------
    stamp_ns : int
        Header stamp, ns.
    frame_id : str
        Header frame.
    values : iterable of 6 floats
        N and N m, axis order AXES.

    Returns
    -------
    WrenchStamped
        The message.

    """
    message = WrenchStamped()
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, NANOSECONDS)
    message.header.frame_id = frame_id
    for axis, value in zip(AXES, values, strict=True):
        part, component = axis.split('_')
        setattr(getattr(message.wrench, part), component, float(value))
    return message
