"""
The codec of ``tf2_msgs/TFMessage``: stamps and rotations, of many messages at once.

Messages of a publisher differ in numbers only: one is followed, and what it says of where the
numbers lie holds for all with the same texts at the same places::

    byte 4  how many transforms, and of each, aligned by its type, counted from byte 4:
            sec, nanosec, frame_id, child_frame_id, 3 doubles translation, 4 doubles rotation
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import struct

import numpy as np
from numpy.typing import NDArray

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.signals import IntArray, NANOSECONDS
from wrist_ft_comp.wire.tf_tree import Transforms

#: The squared norm of a rotation is off from 1 by less.
_NORM_ERROR = 0.1
_STAMP, _TRANSLATION, _ROTATION = 8, 24, 32
#: Sizes of messages whose layouts are remembered, and layouts of one size. Robots have a publisher
#: or two; names that are new in every message must not fill the memory.
_MOST_SIZES, _MOST_OF_A_SIZE = 100, 4


@dataclass(frozen=True, eq=False)
class Layout:
    """Where names, stamps and rotations lie in every message that holds the same names."""

    #: Parent and child of every transform, without leading slashes.
    frames: tuple[tuple[str, str], ...]
    #: Bytes at which stamp and rotation of every transform lie, shape (k, 40).
    _numbers: IntArray
    #: Reads what is no number, and what that is.
    _texts: struct.Struct
    _expected: tuple[bytes, ...]

    def fits(self, data: bytes) -> bool:
        """Tell whether a message is laid out like this, and holds these names."""
        return len(data) == self._texts.size and self._texts.unpack(data) == self._expected

    def decode(self, messages: Sequence[bytes], places: Sequence[int]) -> Iterator[Transforms]:
        """Read the rotations at some places in ``frames`` out of messages that fit."""
        if not places:
            return
        order = '<' if messages[0][1] else '>'
        rows: NDArray[np.uint8] = np.frombuffer(b''.join(messages), np.uint8)
        parts = rows.reshape(len(messages), -1)[:, self._numbers[places]]
        stamps = np.ascontiguousarray(parts[..., :_STAMP]).view(f'{order}u4')
        stamps_ns = stamps[..., 0].astype(np.int64) * NANOSECONDS + stamps[..., 1]
        rotations = np.ascontiguousarray(parts[..., _STAMP:]).view(f'{order}f8').astype(float)
        known = np.abs((rotations**2).sum(axis=-1) - 1) < _NORM_ERROR
        well = bool(known.all())
        for column, place in enumerate(places):
            some = slice(None) if well else known[:, column]
            frames = self.frames[place]
            yield Transforms(*frames, stamps_ns[some, column], rotations[some, column])


class Layouts:
    """Remembers how the messages of a topic's publishers are laid out."""

    def __init__(self) -> None:
        self._of_size: dict[int, list[Layout]] = {}

    def find(self, data: bytes) -> Layout:
        """Find a message's layout; RecordingError when it is no TFMessage."""
        layouts = self._of_size.get(len(data), [])
        for layout in layouts:
            if layout.fits(data):
                return layout
        try:
            found = _follow(data)
        except (struct.error, UnicodeDecodeError) as error:
            raise RecordingError(f'Expected a tf2_msgs/TFMessage; {error}.') from error
        if len(self._of_size) >= _MOST_SIZES:
            self._of_size.clear()
        self._of_size[len(data)] = [found, *layouts][:_MOST_OF_A_SIZE]
        return found


def decode_transforms(messages: Sequence[bytes]) -> Iterator[Transforms]:
    """Read messages; RecordingError, which names no topic, when one is no TFMessage."""
    layouts, alike = Layouts(), defaultdict[Layout, list[bytes]](list)
    for data in messages:
        alike[layouts.find(data)].append(data)
    for layout, some in alike.items():
        yield from layout.decode(some, range(len(layout.frames)))


def _follow(data: bytes) -> Layout:
    """Find names, stamps and rotations, transform by transform."""
    number = struct.Struct('<I' if data[1:2] == b'\1' else '>I')
    code, at, end, frames, numbers = '=8s', 8, 8, [], []
    for _ in range(*number.unpack_from(data, 4)):
        stamp, names = _aligned(at, 4), []
        at = stamp + _STAMP
        for _ in range(2):
            begin = _aligned(at, 4)
            at = begin + 4 + sum(number.unpack_from(data, begin))
            code += f'{begin - end}x{at - begin}s'
            end = at
            names.append(data[begin + 4 : at].rstrip(b'\0').decode().strip('/'))
        rotation = _aligned(at, 8) + _TRANSLATION
        at = rotation + _ROTATION
        struct.unpack_from('4d', data, rotation)
        frames.append((names[0], names[1]))
        numbers.append([*range(stamp, stamp + _STAMP), *range(rotation, at)])
    texts = struct.Struct(f'{code}{len(data) - end}x')
    places = np.array(numbers, np.int64).reshape(-1, _STAMP + _ROTATION)
    return Layout(tuple(frames), places, texts, texts.unpack(data))


def _aligned(at: int, size: int) -> int:
    """Step to where a number of some bytes may begin."""
    return 4 + -(-(at - 4) // size) * size
