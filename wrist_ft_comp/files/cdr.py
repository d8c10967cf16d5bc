"""
Layout of the CDR messages this package reads and writes: a header, then doubles.

``geometry_msgs/WrenchStamped`` (6 doubles) and ``sensor_msgs/Temperature`` (2 doubles) share it::

    byte   0        1      2..3     4..7   8..11     12..15     16..        o
           0   1=little  options     sec  nanosec  frame length  frame_id   doubles
               0=big                int32  uint32     uint32     with NUL   float64 …

Alignment counts from byte 4, so ``o = 4 + 8 ceil((12 + frame length) / 8)``. Bytes before ``o``
are never interpreted beyond this and never changed.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import struct

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.model.signals import FloatArray, IntArray, NANOSECONDS

#: Doubles in a message of these types: force and torque; temperature and its variance.
WRENCH_DOUBLES = 6


TEMPERATURE_DOUBLES = 2


#: Bytes up to and including the length of frame_id.
_HEAD = 16


#: A frame name longer than this is not a frame name.
MAX_FRAME_BYTES = 65536


def locate_doubles(data: bytes | bytearray | memoryview, count: int) -> tuple[int, str]:
    """
    Find the doubles in one message, checking that it is such a message.

    Parameters
    ----------
    data : bytes-like
        One serialized message, with its 4-byte encapsulation header.
    count : int
        How many doubles follow the header: 6 for a WrenchStamped, 2 for a Temperature.

    Returns
    -------
    offset : int
        Byte at which the doubles begin; they reach to the end.
    order : str
        '<' for little endian, '>' for big endian, as numpy and struct spell it.

    Raises
    ------
    RecordingError
        When the bytes are no such message; it names neither file nor topic.

    """
    if len(data) < _HEAD:
        raise RecordingError(
            f'Expected a CDR message with a header and {count} doubles; got {len(data)} bytes.'
        )
    if data[0] != 0 or data[1] not in (0, 1):
        raise RecordingError(
            'Expected CDR encapsulation 00 00 or 00 01 at the start of the message; '
            f'got {data[0]:02x} {data[1]:02x}.'
        )
    order = '<' if data[1] else '>'
    (frame_bytes,) = struct.unpack_from(f'{order}I', data, 12)
    if frame_bytes > min(len(data) - _HEAD, MAX_FRAME_BYTES):
        raise RecordingError(
            f'Expected a frame_id that fits into the message of {len(data)} bytes; '
            f'its length is given as {frame_bytes} bytes.'
        )
    offset: int = 4 + -(-(12 + frame_bytes) // 8) * 8
    if len(data) != offset + 8 * count:
        raise RecordingError(
            f'Expected {offset + 8 * count} bytes for a message with a header and {count} '
            f'doubles; got {len(data)}.'
        )
    return offset, order


@dataclass(frozen=True, eq=False)
class _Joined:
    """
    Many messages in one buffer.

    Attributes
    ----------
    buffer : ndarray of uint8, shape (sum of lengths,)
        The messages, one behind the other.
    starts : ndarray of int64, shape (n,)
        Byte at which each begins.
    lengths : ndarray of int64, shape (n,)
        Bytes of each.

    """

    buffer: NDArray[np.uint8]
    starts: IntArray
    lengths: IntArray

    def rows(self, which: IntArray | slice, offset: int, width: int) -> NDArray[np.uint8]:
        """Copy ``width`` bytes from ``offset`` on out of the chosen messages, shape (k, width)."""
        return sliding_window_view(self.buffer, width)[self.starts[which] + offset]


def _join(messages: Sequence[bytes], count: int) -> _Joined:
    """Put the messages into one writable buffer, refusing any that is shorter than a header."""
    lengths = np.fromiter(map(len, messages), np.int64, len(messages))
    shortest = int(lengths.argmin())
    if lengths[shortest] < _HEAD:
        locate_doubles(messages[shortest], count)
    buffer = np.frombuffer(bytearray().join(messages), np.uint8)
    return _Joined(buffer, np.cumsum(lengths) - lengths, lengths)


def _layouts(
    joined: _Joined, messages: Sequence[bytes], count: int
) -> Iterator[tuple[IntArray | slice, int, str]]:
    """Yield the messages that share a layout, with its offset and byte order."""
    head = joined.rows(slice(None), 0, _HEAD)[:, (0, 1, 12, 13, 14, 15)]
    if (joined.lengths == joined.lengths[0]).all() and (head == head[0]).all():
        yield slice(None), *locate_doubles(messages[0], count)
        return
    keys = np.column_stack((joined.lengths, head))
    _, first, group = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    for number, index in enumerate(first):
        which = np.flatnonzero(group.reshape(-1) == number)
        yield which, *locate_doubles(messages[index], count)


def unpack(messages: Sequence[bytes], count: int) -> tuple[IntArray, FloatArray]:
    """
    Read stamps and doubles of many messages at once.

    Parameters
    ----------
    messages : sequence of bytes
        Serialized messages of one type; frame names and byte orders may differ.
    count : int
        Doubles per message.

    Returns
    -------
    stamps_ns : ndarray of int64, shape (n,)
        Header stamps.
    values : ndarray, shape (n, count)
        The doubles, in the message's order and unit.

    Raises
    ------
    RecordingError
        As locate_doubles, for the first message of the first layout that does not fit.

    """
    stamps_ns = np.empty(len(messages), np.int64)
    values = np.empty((len(messages), count))
    if not messages:
        return stamps_ns, values
    joined = _join(messages, count)
    for which, offset, order in _layouts(joined, messages, count):
        stamp = joined.rows(which, 4, 8)
        seconds = stamp[:, :4].copy().view(f'{order}i4')[:, 0].astype(np.int64)
        stamps_ns[which] = seconds * NANOSECONDS + stamp[:, 4:].copy().view(f'{order}u4')[:, 0]
        values[which] = joined.rows(which, offset, 8 * count).view(f'{order}f8')
    return stamps_ns, values


def replace_doubles(messages: Sequence[bytes], values: FloatArray) -> list[bytes]:
    """
    Write other doubles into copies of many messages.

    Parameters
    ----------
    messages : sequence of bytes, length n
        Serialized messages; they stay as they are.
    values : ndarray, shape (n, count)
        New doubles.

    Returns
    -------
    list of bytes, length n
        Each message with its own header, byte for byte, and the new doubles.

    Raises
    ------
    RecordingError
        As locate_doubles.

    """
    if not messages:
        return []
    count = values.shape[1]
    joined = _join(messages, count)
    for which, offset, order in _layouts(joined, messages, count):
        windows = sliding_window_view(joined.buffer, 8 * count, writeable=True)
        doubles = np.ascontiguousarray(values[which], dtype=f'{order}f8')
        windows[joined.starts[which] + offset] = doubles.view(np.uint8)
    whole, starts = joined.buffer.tobytes(), joined.starts.tolist()
    ends = [*starts[1:], len(whole)]
    return [whole[start:end] for start, end in zip(starts, ends, strict=True)]
