"""
``tf2_msgs/TFMessage``: stamps and rotations, out of one message or many at once.

The messages of a publisher differ in their numbers only: those with the same names are alike.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.series import IntArray, NANOSECONDS
from wrist_ft_comp.wire import message_layout
from wrist_ft_comp.wire.cdr import TF
from wrist_ft_comp.wire.message_layout import Definitions, SEQUENCE
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


@dataclass(frozen=True, eq=False)
class Layout:
    """Where stamps and rotations lie in every message that holds the same names."""

    #: Parent and child of every transform, without leading slashes.
    frames: tuple[tuple[str, str], ...]
    #: Bytes at which stamp and rotation of every transform lie, shape (k, 40).
    _numbers: IntArray

    def decode(self, messages: Sequence[bytes], places: Sequence[int]) -> Iterator[Transforms]:
        """Read the rotations at some places in ``frames`` out of messages of this layout."""
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


class Layouts(message_layout.Layouts[Layout]):
    """Remembers how the messages of a topic's publishers are laid out."""

    def __init__(self) -> None:
        super().__init__(_DEFINITIONS, TF, _lay_out, same_texts=True)


def decode_transforms(messages: Sequence[bytes]) -> Iterator[Transforms]:
    """Read messages; RecordingError, which names no topic, when one is no TFMessage."""
    layouts, alike = Layouts(), defaultdict[Layout, list[bytes]](list)
    try:
        for data in messages:
            alike[layouts.find(data)].append(data)
    except RecordingError as error:
        raise RecordingError(f'Expected a tf2_msgs/TFMessage. {error}') from error
    for layout, fitting in alike.items():
        yield from layout.decode(fitting, range(len(layout.frames)))


def _lay_out(message: message_layout.Layout) -> Layout:
    """Note the frames of a message, and where its numbers lie."""
    frames, numbers = [], []
    for index in range(message.sizes['transforms',] or 0):
        parent = message.text(('transforms', index, 'header', 'frame_id'))
        child = message.text(('transforms', index, 'child_frame_id'))
        frames.append((parent.strip('/'), child.strip('/')))
        stamp = message.places['transforms', index, 'header', 'stamp'].offset
        rotation = message.places['transforms', index, 'rotation'].offset
        numbers.append([*range(stamp, stamp + _STAMP), *range(rotation, rotation + _ROTATION)])
    return Layout(tuple(frames), np.array(numbers, np.int64).reshape(-1, _STAMP + _ROTATION))
