"""
The wire path: six doubles read from a message's bytes, and replaced, everything else untouched.

A typed message costs several times the processor time of its bytes, and the header needs no
understanding: it goes out as it came in.
"""

import struct
from collections.abc import Sequence
from typing import NamedTuple

from wrist_ft_comp.core.recording import NANOSECONDS
from wrist_ft_comp.files.cdr import locate_doubles

#: Byte at which frame_id begins.
_FRAME = 16
#: Layouts kept per topic; a sender that varies its frame names starts the collection anew.
_MAX_LAYOUTS = 100


class Layout(NamedTuple):
    """
    Where the parts of a message lie.

    Attributes
    ----------
    frame_end : int
        First byte behind frame_id.
    offset : int
        First byte of the doubles.
    doubles : struct.Struct
        The doubles.
    stamp : struct.Struct
        Seconds and nanoseconds, at byte 4.

    """

    frame_end: int
    offset: int
    doubles: struct.Struct
    stamp: struct.Struct


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
            For read, replace and frame_id.

        Raises
        ------
        RecordingError
            When the bytes are no such message.

        """
        key = (len(data), data[:2], data[12:_FRAME])
        known = self._known.get(key)
        if known is None:
            offset, order = locate_doubles(data, self._count)
            (frame_bytes,) = struct.unpack_from(f'{order}I', data, 12)
            known = Layout(
                _FRAME + frame_bytes,
                offset,
                struct.Struct(f'{order}{self._count}d'),
                struct.Struct(f'{order}iI'),
            )
            if len(self._known) >= _MAX_LAYOUTS:
                self._known.clear()
            self._known[key] = known
        return known


def read(layout: Layout, data: bytes) -> tuple[int, tuple[float, ...]]:
    """
    Read stamp and doubles.

    Parameters
    ----------
    layout : Layout
        From Wire.layout of the same bytes.
    data : bytes
        Serialized message.

    Returns
    -------
    tuple of int and tuple of float
        Header stamp, ns, and the doubles.

    """
    seconds, nanoseconds = layout.stamp.unpack_from(data, 4)
    return seconds * NANOSECONDS + nanoseconds, layout.doubles.unpack_from(data, layout.offset)


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
        Without the bytes that only align what follows it.

    """
    return data[_FRAME : layout.frame_end].rstrip(b'\0').decode(errors='replace')


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
