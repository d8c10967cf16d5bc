"""
The codec of messages that are a header, then doubles: one by one, or many at once.

``geometry_msgs/WrenchStamped`` (6 doubles), ``sensor_msgs/Temperature`` (2) and
``sensor_msgs/Imu`` (37) share it::

    byte   0        1      2..3     4..7   8..11     12..15     16..        o
           0   1=little  options     sec  nanosec  frame length  frame_id   doubles
               0=big                int32  uint32     uint32     with NUL   float64 …

Alignment counts from byte 4, so ``o = 4 + 8 ceil((12 + frame length) / 8)``. Bytes before ``o``
are never changed.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
import struct
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.series import FloatArray, IntArray, NANOSECONDS

#: Bytes of n messages, one per row, shape (n, size).
Rows = NDArray[np.uint8]
_Made = TypeVar('_Made')
#: Doubles of a wrench, force and torque, and of an IMU: orientation, rotation and acceleration,
#: all with a covariance.
WRENCH_DOUBLES, IMU_DOUBLES = 6, 37
#: Where rotation and acceleration are among those of an IMU.
ROTATION, ACCELERATION = slice(13, 16), slice(25, 28)
WRENCH = 'geometry_msgs/msg/WrenchStamped'
TEMPERATURE = 'sensor_msgs/msg/Temperature'
IMU = 'sensor_msgs/msg/Imu'
TF = 'tf2_msgs/msg/TFMessage'
#: By type; a temperature has itself and its variance.
DOUBLES = {WRENCH: WRENCH_DOUBLES, TEMPERATURE: 2, IMU: IMU_DOUBLES}
#: Byte at which frame_id begins, and those that say how a message is laid out.
_FRAME, _SHARED = 16, np.array([0, 1, 12, 13, 14, 15])
#: Most bytes of a frame name that are shown; no sensor's is longer.
_SHOWN = 255
#: Messages that show whether two sensors come by turns.
_NEWEST = 40


@dataclass(frozen=True, eq=False)
class Layout:
    """Where the parts lie in every message of one size, byte order and length of frame_id."""

    #: First byte behind frame_id, and first byte of the doubles.
    frame_end: int
    offset: int
    #: Of the doubles, and of a whole message: seconds, nanoseconds, doubles.
    _doubles: struct.Struct
    _numbers: struct.Struct
    #: A whole message as numpy sees it.
    record: np.dtype[np.void]

    def decode(self, data: bytes) -> tuple[int, tuple[float, ...]]:
        """Read the header's stamp, ns, and the doubles."""
        numbers = self._numbers.unpack(data)
        return numbers[0] * NANOSECONDS + numbers[1], numbers[2:]

    def encode(self, data: bytes, doubles: Sequence[float]) -> bytes:
        """Write other doubles behind the same header."""
        return data[: self.offset] + self._doubles.pack(*doubles)

    def frame_id(self, data: bytes) -> str:
        """Read the frame's name, its first 255 bytes only."""
        end = min(self.frame_end, _FRAME + _SHOWN)
        return data[_FRAME:end].rstrip(b'\0').decode(errors='replace')


def locate(data: bytes, count: int) -> Layout:
    """
    Find the layout of a serialized message, with ``count`` doubles after its header.

    RecordingError, which names neither file nor topic, when the bytes are no such message.
    """
    return _layout(len(data), data[:2], data[12:_FRAME], count)


def byte_order(data: bytes) -> str:
    """Tell a message's byte order as struct writes it, < or >; RecordingError if it is none."""
    if data[:2] not in {b'\0\0', b'\0\1'}:
        raise RecordingError(
            'Expected CDR encapsulation 00 00 or 00 01 at the start of the message; '
            f'got {data[:2].hex(" ") or "nothing"}.'
        )
    return '<' if data[1] else '>'


class RecentFrames:
    """The frame_ids of a topic's newest messages: two sensors may come by turns."""

    def __init__(self, doubles: int) -> None:
        self._doubles, self.names = doubles, deque[str](maxlen=_NEWEST)

    def look(self, *messages: bytes) -> None:
        """Look at messages; empty ones are none."""
        for data in filter(None, messages[-_NEWEST:]):
            self.names.append(locate(data, self._doubles).frame_id(data))

    @property
    def mixed(self) -> str:
        """Say which come by turns; empty where one does."""
        changes = sum(before != name for before, name in pairwise(self.names))
        names = sorted(name or 'no frame' for name in set(self.names))
        return f'{" and ".join(names)} come by turns, and are mixed' if changes > 1 else ''


@lru_cache  # a topic has one layout, but a sender may vary its frame names
def _layout(size: int, encapsulation: bytes, frame_length: bytes, count: int) -> Layout:
    if size < _FRAME:
        raise RecordingError(f'Expected a header and {count} doubles; got {size} bytes.')
    order = byte_order(encapsulation)
    (frame_bytes,) = struct.unpack(f'{order}I', frame_length)
    if frame_bytes > size - _FRAME:
        raise RecordingError(
            f'Expected a frame_id within {size} bytes; its length is given as {frame_bytes}.'
        )
    offset = 4 + -(-(12 + frame_bytes) // 8) * 8
    if size != offset + 8 * count:
        raise RecordingError(
            f'Expected {offset + 8 * count} bytes of a header and {count} doubles; got {size}.'
        )
    record = np.dtype({
        'names': ['seconds', 'nanoseconds', 'doubles'],
        'formats': [f'{order}i4', f'{order}u4', f'({count},){order}f8'],
        'offsets': [4, 8, offset], 'itemsize': size,
    })  # fmt: skip
    doubles = struct.Struct(f'{order}{count}d')
    numbers = struct.Struct(f'{order}4xiI{offset - 12}x{count}d')
    return Layout(_FRAME + frame_bytes, offset, doubles, numbers, record)


def decode_many(messages: Sequence[bytes], count: int) -> tuple[IntArray, FloatArray]:
    """Read stamps, ns, shape (n,), and doubles, shape (n, count), of n messages at once."""
    stamps_ns = np.empty(len(messages), np.int64)
    values = np.empty((len(messages), count))
    for places, records in _records(messages, count):
        seconds = records['seconds'].astype(np.int64)
        stamps_ns[places] = seconds * NANOSECONDS + records['nanoseconds']
        values[places] = records['doubles']
    return stamps_ns, values


def encode_many(messages: Sequence[bytes], values: FloatArray) -> list[bytes]:
    """Write other doubles, shape (n, count), behind the headers of n messages at once."""
    encoded = list(messages)
    for places, records in _records(messages, values.shape[1]):
        records['doubles'] = values[places]
        whole, size = records.tobytes(), records.itemsize
        for begin, place in zip(range(0, len(whole), size), places.tolist(), strict=True):
            encoded[place] = whole[begin : begin + size]
    return encoded


def _records(messages: Sequence[bytes], count: int) -> Iterator[tuple[IntArray, NDArray[np.void]]]:
    """Yield the places of messages that share a layout, and a writable copy of these messages."""
    for layout, places, rows in group_alike(messages, lambda data: (_SHARED, locate(data, count))):
        yield places, rows.view(layout.record)[:, 0]


def group_alike(
    messages: Sequence[bytes], find: Callable[[bytes], tuple[IntArray, _Made]]
) -> Iterator[tuple[_Made, IntArray, Rows]]:
    """
    Group messages by layout: what was made of it, their numbers from 0, and a copy of their bytes.

    ``find`` tells of a message where all that are alike have the same bytes, and what was made.
    """
    sizes = np.fromiter(map(len, messages), np.int64, len(messages))
    for size in np.unique(sizes):
        numbers = np.flatnonzero(sizes == size)
        joined = b''.join([messages[number] for number in numbers])
        rows: Rows = np.frombuffer(joined, np.uint8).reshape(len(numbers), size)
        while len(numbers):
            at, made = find(messages[numbers[0]])
            alike = (rows[:, at] == rows[0, at]).all(axis=1)
            yield made, numbers[alike], rows[alike]
            numbers, rows = numbers[~alike], rows[~alike]
