"""
``tf2_msgs/TFMessage``: stamps and rotations, out of many messages at once.

The messages of a publisher differ in their numbers only. The first one is decoded by its
definition; the places of its numbers are those of all messages with the same lengths and texts.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import struct

import numpy as np
from numpy.typing import NDArray

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.signals import IntArray, NANOSECONDS
from wrist_ft_comp.wire.cdr import TF
from wrist_ft_comp.wire.cdr_fields import Definitions, follow, SEQUENCE
from wrist_ft_comp.wire.tf_tree import Transforms

_DEFINITIONS: Definitions = {
    TF: [('transforms', ('TransformStamped', SEQUENCE))],
    'TransformStamped': [
        ('header', ('Header', None)),
        ('child_frame_id', ('string', None)),
        ('translation', ('float64', 3)),
        ('rotation', ('float64', 4)),
    ],
    'Header': [('stamp', ('uint32', 2)), ('frame_id', ('string', None))],
}
#: Bytes of a stamp.
_STAMP = 8
#: Bytes of a quaternion.
_ROTATION = 32
#: A rotation is dropped where its squared norm differs from 1 by more.
_NORM_ERROR = 0.1
#: Most sizes of messages with remembered layouts: new names in every message must not fill memory.
_MOST_SIZES = 100
#: Most remembered layouts of one size: robots have a publisher or two.
_MOST_OF_A_SIZE = 4


@dataclass(frozen=True, eq=False)
class Layout:
    """Where names, stamps and rotations lie in every message that holds the same names."""

    #: Parent and child of every transform, without leading slashes.
    frames: tuple[tuple[str, str], ...]
    #: Bytes at which stamp and rotation of every transform lie, shape (k, 40).
    _numbers: IntArray
    #: Reads lengths and texts.
    _texts: struct.Struct
    #: Lengths and texts of every message.
    _expected: tuple[bytes, ...]

    def fits(self, data: bytes) -> bool:
        """Whether a message has this layout, and these names."""
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
        usable = np.abs((rotations**2).sum(axis=-1) - 1) < _NORM_ERROR
        all_usable = bool(usable.all())
        for column, place in enumerate(places):
            kept = slice(None) if all_usable else usable[:, column]
            frames = self.frames[place]
            yield Transforms(*frames, stamps_ns[kept, column], rotations[kept, column])


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
        found = _lay_out(data)
        if len(self._of_size) >= _MOST_SIZES:
            self._of_size.clear()
        self._of_size[len(data)] = [found, *layouts][:_MOST_OF_A_SIZE]
        return found


def decode_transforms(messages: Sequence[bytes]) -> Iterator[Transforms]:
    """Read messages; RecordingError, which names no topic, when one is no TFMessage."""
    layouts, alike = Layouts(), defaultdict[Layout, list[bytes]](list)
    for data in messages:
        alike[layouts.find(data)].append(data)
    for layout, fitting in alike.items():
        yield from layout.decode(fitting, range(len(layout.frames)))


def _lay_out(data: bytes) -> Layout:
    """Decode a message, and note what all messages with its layout have in common."""
    try:
        layout, message = follow(_DEFINITIONS, TF, data)
    except RecordingError as error:
        raise RecordingError(f'Expected a tf2_msgs/TFMessage. {error}') from error
    frames = [(link.header.frame_id, link.child_frame_id) for link in message.transforms]
    numbers = []
    for number in range(len(frames)):
        stamp = layout.places['transforms', number, 'header', 'stamp'].offset
        rotation = layout.places['transforms', number, 'rotation'].offset
        numbers.append([*range(stamp, stamp + _STAMP), *range(rotation, rotation + _ROTATION)])
    # A text follows its length at once.
    text_ends = dict(layout.texts)
    code, end = '=4s', 4
    for begin in layout.lengths:
        stop = text_ends.get(begin + 4, begin + 4)
        code += f'{begin - end}x{stop - begin}s'
        end = stop
    texts = struct.Struct(f'{code}{len(data) - end}x')
    return Layout(
        tuple((parent.strip('/'), child.strip('/')) for parent, child in frames),
        np.array(numbers, np.int64).reshape(-1, _STAMP + _ROTATION),
        texts,
        texts.unpack(data),
    )
