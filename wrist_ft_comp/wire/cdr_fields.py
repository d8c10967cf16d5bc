"""
Numbers inside messages of any type, found by the type's definition: in one, or in many at once.

Where a number lies depends on nothing but the lengths of the texts and arrays before it. So one
message is followed field by field, and all messages that have the same lengths at the same places
are read together.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.signals import BoolArray, FloatArray, IntArray, NANOSECONDS
from wrist_ft_comp.wire.temperature_source import Path

#: What a field is, and how often: once (None), a fixed number of times, or SEQUENCE.
FieldType = tuple[str, int | None]
SEQUENCE = -1
#: Fields of every type in their order, by the type's name, such as ``std_msgs/msg/Header``.
Definitions = Mapping[str, Sequence[tuple[str, FieldType]]]
#: numpy's letter of every number, by its name in ROS and, where that differs, in IDL.
_CODES = {
    'bool': '?', 'boolean': '?', 'byte': 'B', 'octet': 'B', 'char': 'B', 'uint8': 'B', 'int8': 'b',
    'uint16': 'H', 'int16': 'h', 'uint32': 'I', 'int32': 'i', 'uint64': 'Q', 'int64': 'q',
    'float32': 'f', 'float': 'f', 'float64': 'd', 'double': 'd',
}  # fmt: skip
_SECONDS = ('header', 'stamp', 'sec')
_NANOSECONDS = ('header', 'stamp', 'nanosec')
#: A message that claims to hold more than this is damaged.
_MOST_PARTS = 100_000


class Decoded(SimpleNamespace):
    """A message, or a part of one, as rclpy would give it: its fields are attributes."""

    def get_fields_and_field_types(self) -> dict[str, Any]:
        """Name the fields."""
        return vars(self)


@dataclass(frozen=True)
class Place:
    """Where a number lies, or an array of numbers."""

    #: Byte of the message, counted from its beginning.
    offset: int
    code: np.dtype[Any]
    #: None for a single number.
    size: int | None

    def values(self, rows: NDArray[np.uint8]) -> FloatArray:
        """Read the number out of messages that are laid out alike, one per row."""
        bytes_ = rows[:, self.offset : self.offset + self.code.itemsize]
        with np.errstate(invalid='ignore'):  # a signalling NaN is one as any other
            return np.ascontiguousarray(bytes_).view(self.code)[:, 0].astype(float)


@dataclass
class MessageLayout:
    """One message, followed by its definition, and where its parts were found."""

    data: bytes
    definitions: Definitions
    #: ``<`` or ``>``.
    order: str
    #: Counted from byte 4, as alignment is.
    at: int = 0
    parts: int = 0
    #: Bytes that may be left behind the last field: senders fill up to a multiple of four, and
    #: ROS 2's own serialize_message sizes empty arrays of 8-byte numbers as if they were aligned.
    slack: int = 3
    places: dict[Path, Place] = field(default_factory=dict)
    #: First bytes of the lengths of arrays and texts; first and last byte of the texts.
    lengths: list[int] = field(default_factory=list)
    texts: list[tuple[int, int]] = field(default_factory=list)

    def find(self, path: Path) -> Place | None:
        """Find a number, which may be an element of an array."""
        place = self.places.get(path)
        if place is not None:
            return place if place.size is None else None
        array, index = self.places.get(path[:-1]), path[-1]
        if array is None or array.size is None or isinstance(index, str) or index >= array.size:
            return None
        return Place(array.offset + index * array.code.itemsize, array.code, None)

    def alike(self, rows: NDArray[np.uint8]) -> BoolArray:
        """Mark the messages of the same size, one per row, that have the same layout."""
        at = [0, 1, *(place + k for place in self.lengths for k in range(4))]
        expected = np.frombuffer(self.data, np.uint8)[at]
        return np.asarray((rows[:, at] == expected).all(axis=1))

    def message(self, kind: str, path: Path) -> Decoded:
        """Follow the fields of a message."""
        fields = self.definitions.get(kind)
        if fields is None:
            raise RecordingError(f'The definition of {kind} is missing.')
        if not fields:
            self._take(1, 1)  # a message without fields is sent as one byte
        return Decoded(**{name: self._field(*what, (*path, name)) for name, what in fields})

    def _field(self, kind: str, times: int | None, path: Path) -> Any:
        self.parts += 1
        if self.parts > _MOST_PARTS:
            raise RecordingError(f'It holds more than {_MOST_PARTS} parts.')
        size = self._length() if times == SEQUENCE else times
        if kind in _CODES:
            return self._numbers(np.dtype(self.order + _CODES[kind]), size, path)
        if size is not None:
            return [self._field(kind, None, (*path, index)) for index in range(size)]
        if kind == 'string':
            length = self._length()
            begin = self._take(length, 1)
            self.texts.append((begin, begin + length))
            return self.data[begin : begin + length].rstrip(b'\0').decode(errors='replace')
        return self.message(kind, path)

    def _numbers(self, code: np.dtype[Any], size: int | None, path: Path) -> Any:
        """Follow a number, or an array of numbers; true and false are none."""
        count = 1 if size is None else size
        self.slack += 8 if size == 0 and code.itemsize == 8 else 0
        offset = self._take(count * code.itemsize, code.itemsize if count else 1)
        if code.kind != 'b':
            self.places[path] = Place(offset, code, size)
        values = np.frombuffer(self.data, code, count, offset)
        return values.item() if size is None else values

    def _length(self) -> int:
        """Read the length of the array or text that follows."""
        offset = self._take(4, 4)
        self.lengths.append(offset)
        order: Literal['little', 'big'] = 'little' if self.order == '<' else 'big'
        return int.from_bytes(self.data[offset : offset + 4], order)

    def _take(self, size: int, alignment: int) -> int:
        """Step over the next bytes; returns where they begin."""
        begin = -(-self.at // alignment) * alignment
        self.at = begin + size
        if 4 + self.at > len(self.data):
            raise RecordingError(f'Its {len(self.data)} bytes end before its last field.')
        return 4 + begin


def follow(definitions: Definitions, kind: str, data: bytes) -> tuple[MessageLayout, Decoded]:
    """Follow a message through; RecordingError, without a topic, when it is none of this type."""
    if data[:2] not in {b'\0\0', b'\0\1'}:
        raise RecordingError(
            'Expected CDR encapsulation 00 00 or 00 01 at the start of the message; '
            f'got {data[:2].hex(" ") or "nothing"}.'
        )
    layout = MessageLayout(data, definitions, '<' if data[1] else '>')
    message = layout.message(kind, ())
    left = len(data) - 4 - layout.at
    if left > layout.slack:
        raise RecordingError(f'{left} of its {len(data)} bytes are left behind its last field.')
    return layout, message


def read_numbers(
    definitions: Definitions, kind: str, messages: Sequence[bytes], paths: Sequence[Path]
) -> tuple[IntArray, FloatArray]:
    """
    Read P numbers out of n messages of some type.

    Gives the stamps of their headers, ns, shape (n,), 0 where there is none, and the numbers,
    shape (n, P), NaN where a message has none at a path. RecordingError, which names neither file
    nor topic, when a message is none of this type.
    """
    stamps_ns = np.zeros(len(messages), np.int64)
    values = np.full((len(messages), len(paths)), np.nan)
    sizes = np.fromiter(map(len, messages), np.int64, len(messages))
    for size in np.unique(sizes):
        places = np.flatnonzero(sizes == size)
        joined = b''.join(messages[place] for place in places)
        rows: NDArray[np.uint8] = np.frombuffer(joined, np.uint8).reshape(len(places), size)
        while len(places):
            layout, _ = follow(definitions, kind, rows[0].tobytes())
            alike = layout.alike(rows)
            some, at = rows[alike], places[alike]
            for column, path in enumerate(paths):
                if number := layout.find(path):
                    values[at, column] = number.values(some)
            seconds, nanoseconds = layout.find(_SECONDS), layout.find(_NANOSECONDS)
            if seconds and nanoseconds:
                whole = seconds.values(some).astype(np.int64) * NANOSECONDS
                stamps_ns[at] = whole + nanoseconds.values(some).astype(np.int64)
            places, rows = places[~alike], rows[~alike]
    return stamps_ns, values
