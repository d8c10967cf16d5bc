"""
The codec of ``tf2_msgs/TFMessage``: stamps and rotations of many messages at once.

Messages of a publisher differ in numbers only: one is followed, and all that have the same texts
at the same places are read together::

    byte 4  how many transforms, and of each, aligned by its type, counted from byte 4:
            sec, nanosec, frame_id, child_frame_id, 3 doubles translation, 4 doubles rotation
"""

from collections.abc import Iterator, Sequence
import struct

import numpy as np
from numpy.typing import NDArray

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.model.payload.tf_tree import Transforms
from wrist_ft_comp.model.signals import NANOSECONDS

_TRANSLATION, _ROTATION = 24, 32


def decode_transforms(messages: Sequence[bytes]) -> Iterator[Transforms]:
    """Read messages; RecordingError, which names no topic, when one is no TFMessage."""
    sizes = np.fromiter(map(len, messages), np.int64, len(messages))
    for size in np.unique(sizes):
        joined = b''.join(messages[place] for place in np.flatnonzero(sizes == size))
        rows: NDArray[np.uint8] = np.frombuffer(joined, np.uint8).reshape(-1, size)
        while len(rows):
            try:
                places, texts = _follow(rows[0].tobytes())
            except (struct.error, UnicodeDecodeError) as error:
                raise RecordingError(f'Expected a tf2_msgs/TFMessage; {error}.') from error
            order = '<' if rows[0, 1] else '>'
            alike = (rows[:, texts] == rows[0, texts]).all(axis=1)
            some, rows = rows[alike], rows[~alike]
            for parent, child, stamp, rotation in places:
                stamps = np.ascontiguousarray(some[:, stamp : stamp + 8]).view(f'{order}u4')
                stamps_ns = stamps[:, 0].astype(np.int64) * NANOSECONDS + stamps[:, 1]
                numbers = np.ascontiguousarray(some[:, rotation : rotation + _ROTATION])
                quaternions = numbers.view(f'{order}f8').astype(float)
                yield Transforms(parent, child, stamps_ns, quaternions)


def _follow(data: bytes) -> tuple[list[tuple[str, str, int, int]], NDArray[np.bool_]]:
    """Find names, and first bytes of stamp and rotation, of each transform; and shared bytes."""
    number = struct.Struct('<I' if data[1:2] == b'\1' else '>I')
    texts = np.zeros(len(data), bool)
    texts[:8] = True
    places, at = [], 8
    for _ in range(*number.unpack_from(data, 4)):
        stamp = _aligned(at, 4)
        at, names = stamp + 8, []
        for _ in range(2):
            begin = _aligned(at, 4)
            at = begin + 4 + sum(number.unpack_from(data, begin))
            texts[begin:at] = True
            names.append(data[begin + 4 : at].rstrip(b'\0').decode())
        rotation = _aligned(at, 8) + _TRANSLATION
        at = rotation + _ROTATION
        struct.unpack_from('4d', data, rotation)
        places.append((names[0], names[1], stamp, rotation))
    return places, texts


def _aligned(at: int, size: int) -> int:
    """Step to where a number of some bytes may begin."""
    return 4 + -(-(at - 4) // size) * size
