"""
Numbers inside messages of any type: definition, layout, number by path, for bags and nodes alike.

Where a number lies depends on nothing but the lengths of the texts and arrays before it. So one
message is followed field by field, and its layout holds for all messages of the same size that
have the same lengths at the same bytes: for each one that arrives, or for many at once.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
import importlib
from operator import itemgetter
import re
import struct
from typing import Any, Generic, TypeVar

import numpy as np

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.series import FloatArray, IntArray, NANOSECONDS
from wrist_ft_comp.wire.cdr import byte_order, group_alike, Rows

#: What a field is, and how often: once (None), a fixed number of times, or SEQUENCE.
FieldType = tuple[str, int | None]
SEQUENCE = -1
#: Fields of every type in their order, by the type's name, such as ``std_msgs/msg/Header``.
Definitions = Mapping[str, Sequence[tuple[str, FieldType]]]
#: Names of fields, and indices, from a message down to a number in it. ``[wrist_3]``, in brackets,
#: is the index at which an array of texts beside has this name.
Path = tuple[str | int, ...]
_Made = TypeVar('_Made')
#: numpy's letter of every number, by its name in ROS and, where that differs, in IDL.
_CODES = {
    'bool': '?', 'boolean': '?', 'byte': 'B', 'octet': 'B', 'char': 'B', 'uint8': 'B', 'int8': 'b',
    'uint16': 'H', 'int16': 'h', 'uint32': 'I', 'int32': 'i', 'uint64': 'Q', 'int64': 'q',
    'float32': 'f', 'float': 'f', 'float64': 'd', 'double': 'd',
}  # fmt: skip
#: A stamp of a message's header.
_STAMP: tuple[Path, Path] = ('header', 'stamp', 'sec'), ('header', 'stamp', 'nanosec')
#: What may be imported: names come from a file, or from the network.
_MESSAGE_NAME = re.compile(r'([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)')
#: Such as ``double``, ``string<9>``, ``std_msgs/Header``; and arrays of these.
_FIELD_TYPE = re.compile(
    r'(?:sequence<)?(?P<element>[\w/]+)(?:<\d+>)?(?:(?P<sequence>(?:, \d+)?>)|\[(?P<size>\d+)\])?'
)
#: What a name in brackets is made of; a number would be an index.
_NAME = re.compile(r'[A-Za-z_/][^][:*]*')
#: A message that claims to hold more than this is damaged.
_MOST_PARTS = 100_000
#: Most sizes of messages with remembered layouts: new texts in every message must not fill memory.
_MOST_SIZES = 100
#: Most remembered layouts of one size: a topic has a publisher or two.
_MOST_OF_A_SIZE = 4


def message_class(topic: str, kind: str) -> Any:
    """Import the class of a topic's type; RecordingError where the name is none of a message."""
    parts = _MESSAGE_NAME.fullmatch(kind)
    if parts is None:
        raise RecordingError(f'{topic} carries {kind!r}, which is no message of ROS.')
    package, name = parts.groups()
    return getattr(importlib.import_module(f'{package}.msg'), name)


def define_installed(topic: str, kind: str) -> Definitions:
    """Collect definitions from the Python packages installed; RecordingError where one is not."""
    definitions: dict[str, list[tuple[str, FieldType]]] = {}
    missing = [kind]
    while missing:
        part = missing.pop()
        try:
            message = message_class(topic, part)
        except (ImportError, AttributeError) as error:
            package = part.partition('/')[0]
            raise RecordingError(
                f'{topic} is {kind}, and {part} is not known here ({error}). Install and source '
                f"its package {package}; or, of bags of Iron or later, run 'pip install rosbags'."
            ) from error
        definitions[part] = []
        for field_name, text in message.get_fields_and_field_types().items():
            what: FieldType = text, None
            if match := _FIELD_TYPE.fullmatch(text):
                size = int(match['size']) if match['size'] else None
                element = match['element'].replace('/', '/msg/')
                what = element, SEQUENCE if match['sequence'] else size
            definitions[part].append((field_name, what))
            if '/' in what[0] and what[0] not in definitions:
                missing.append(what[0])
    return definitions


@dataclass(frozen=True)
class Place:
    """Where a number lies, or an array of numbers."""

    #: Byte of the message, counted from its beginning.
    offset: int
    #: Byte order and letter, as struct and numpy know them.
    code: str
    #: None for a single number.
    size: int | None

    def values(self, rows: Rows) -> FloatArray:
        """Read the number out of n messages, shape (n,), or the array, shape (n, size)."""
        bytes_ = struct.calcsize(self.code) * (1 if self.size is None else self.size)
        found = np.ascontiguousarray(rows[:, self.offset : self.offset + bytes_]).view(self.code)
        with np.errstate(invalid='ignore'):  # a signalling NaN is one as any other
            numbers = found.astype(float)
        return numbers[:, 0] if self.size is None else numbers


@dataclass(eq=False)
class Layout:
    """What a message holds, by path, and where."""

    data: bytes
    #: Numbers and arrays of numbers; true and false are none.
    places: dict[Path, Place] = field(default_factory=dict)
    #: Bytes of texts, with the NUL behind them.
    texts: dict[Path, slice] = field(default_factory=dict)
    #: How many elements each array has; None for what is no array.
    sizes: dict[Path, int | None] = field(default_factory=dict)
    #: Bytes that hold the lengths of arrays and texts.
    lengths: list[slice] = field(default_factory=list)

    def find(self, path: Path) -> Place | None:
        """Find a number, which may be an element of an array."""
        path = self.numbered(path)
        place, array, index = self.places.get(path), self.places.get(path[:-1]), path[-1]
        if place is None and array and isinstance(index, int) and index < (array.size or 0):
            return Place(array.offset + index * struct.calcsize(array.code), array.code, None)
        return place if place and place.size is None else None

    @cached_property
    def _names(self) -> dict[tuple[Path, str | int], str]:
        """Give the names in arrays of texts, by what the array is in, and by index."""
        texts = {path: self.text(path) for path in self.texts if isinstance(path[-1], int)}
        names = [(p[:-2], p[-1], text) for p, text in texts.items() if _NAME.fullmatch(text)]
        return {(outside, index): f'[{text}]' for outside, index, text in reversed(names)}

    def numbered(self, path: Path) -> Path:
        """Put an index in the place of each name in brackets that is found."""
        if '[' not in ''.join(map(str, path)):
            return path
        indices = {(outside, name): index for (outside, index), name in self._names.items()}
        found: Path = ()
        for step in path:
            found += (indices.get((found[:-1], str(step)), step),)
        return found

    def named(self, path: Path) -> Path:
        """Put names in the places of indices, where this is clear."""
        named = tuple(self._names.get((path[: n - 1], s), s) for n, s in enumerate(path))
        return named if self.numbered(named) == path else path

    def text(self, path: Path) -> str:
        """Read a text."""
        return self.data[self.texts[path]].rstrip(b'\0').decode(errors='replace')


def follow(definitions: Definitions, kind: str, data: bytes) -> Layout:
    """Follow a message through; RecordingError, without a topic, when it is none of this type."""
    follower = _Follower(Layout(data), definitions, byte_order(data))
    follower.message(kind, ())
    left = len(data) - 4 - follower.at
    if left > follower.slack:
        raise RecordingError(f'{left} of its {len(data)} bytes are left behind its last field.')
    return follower.layout


@dataclass
class _Follower:
    """Goes through the bytes of a message, field by field."""

    layout: Layout
    definitions: Definitions
    byte_order: str
    #: Counted from byte 4, as alignment is.
    at: int = 0
    #: Bytes that may be left behind the last field: senders fill up to a multiple of four, and
    #: ROS 2's own serialize_message sizes empty arrays of 8-byte numbers as if they were aligned.
    slack: int = 3

    def message(self, kind: str, path: Path) -> None:
        fields = self.definitions.get(kind)
        if fields is None:
            raise RecordingError(f'The definition of {kind} is missing.')
        if not fields:
            self._step(1, 1)  # a message without fields is sent as one byte
        for name, (part, times) in fields:
            self._field(part, times, (*path, name))

    def _field(self, kind: str, times: int | None, path: Path) -> None:
        size = self._length() if times == SEQUENCE else times
        self.layout.sizes[path] = size
        if len(self.layout.sizes) > _MOST_PARTS:
            raise RecordingError(f'It holds more than {_MOST_PARTS} parts.')
        if kind in _CODES:
            code = f'{self.byte_order}{_CODES[kind]}'
            bytes_, count = struct.calcsize(code), 1 if size is None else size
            self.slack += 8 if size == 0 and bytes_ == 8 else 0
            offset = self._step(count * bytes_, bytes_ if count else 1)
            if kind not in {'bool', 'boolean'}:
                self.layout.places[path] = Place(offset, code, size)
        elif size is not None:
            for index in range(size):
                self._field(kind, None, (*path, index))
        elif kind == 'string':
            length = self._length()
            begin = self._step(length, 1)
            self.layout.texts[path] = slice(begin, begin + length)
        else:
            self.message(kind, path)

    def _length(self) -> int:
        offset = self._step(4, 4)
        self.layout.lengths.append(slice(offset, offset + 4))
        (length,) = struct.unpack_from(f'{self.byte_order}I', self.layout.data, offset)
        return int(length)

    def _step(self, size: int, alignment: int) -> int:
        """Step over the next bytes; returns where they begin."""
        begin = -(-self.at // alignment) * alignment
        self.at = begin + size
        if 4 + self.at > len(self.layout.data):
            size = len(self.layout.data)
            raise RecordingError(f'Its {size} bytes end before its last field.')
        return 4 + begin


@dataclass(eq=False)
class Layouts(Generic[_Made]):
    """
    Remembers what ``make`` made of the layouts of a type's messages.

    With ``same_texts``, messages of one layout have the same texts, too. Methods raise
    RecordingError, which names neither file nor topic, when a message is none of the type.
    """

    definitions: Definitions
    kind: str
    make: Callable[[Layout], _Made]
    same_texts: bool = False
    #: By size of the message: what picks the bytes that all messages of a layout share out of
    #: one, these bytes, where they are, and what was made.
    _of_size: dict[int, list[tuple[Any, object, IntArray, _Made]]] = field(default_factory=dict)

    def find(self, data: bytes) -> _Made:
        """Find what was made of the layout of a message."""
        return self._find(data)[1]

    def _find(self, data: bytes) -> tuple[IntArray, _Made]:
        """Find where the bytes are that messages of one layout share, and what was made of it."""
        of_size = self._of_size.get(len(data), [])
        for known_pick, bytes_, at, made in of_size:
            if known_pick(data) == bytes_:
                return at, made
        layout = follow(self.definitions, self.kind, data)
        shared = [slice(0, 2), *layout.lengths]
        shared += layout.texts.values() if self.same_texts else []
        pick: Callable[[bytes], object] = itemgetter(*shared)
        at = np.concatenate([np.arange(part.start, part.stop) for part in shared])
        made = self.make(layout)
        if len(self._of_size) >= _MOST_SIZES:
            self._of_size.clear()
        self._of_size[len(data)] = [(pick, pick(data), at, made), *of_size][:_MOST_OF_A_SIZE]
        return at, made

    def group(self, messages: Sequence[bytes]) -> Iterator[tuple[_Made, IntArray, Rows]]:
        """Group messages by layout: what was made of it, their numbers from 0, and their bytes."""
        return group_alike(messages, self._find)


class NumberReader:
    """Reads P numbers, by their paths, out of messages of a type."""

    def __init__(self, definitions: Definitions, kind: str, paths: Sequence[Path]) -> None:
        #: Whether messages of the type have a header.
        self.has_header = any(name == 'header' for name, _ in definitions.get(kind, ()))
        wanted = [*_STAMP, *paths]
        self._columns = len(wanted)
        by_name = any(str(step).startswith('[') for path in paths for step in path)
        self._layouts = Layouts(
            definitions, kind, lambda layout: list(map(layout.find, wanted)), same_texts=by_name
        )

    def read(self, messages: Sequence[bytes]) -> tuple[IntArray, FloatArray]:
        """
        Read the numbers of n messages.

        Gives the stamps of their headers, ns, shape (n,), 0 where there is none, and the numbers,
        shape (n, P), NaN where a message has none at a path. RecordingError, which names neither
        file nor topic, when a message is none of the type.
        """
        values = np.full((len(messages), self._columns), np.nan)
        for places, numbers, rows in self._layouts.group(messages):
            for column, place in enumerate(places):
                if place is not None:
                    values[numbers, column] = place.values(rows)
        seconds, nanoseconds = np.nan_to_num(values[:, :2]).astype(np.int64).T
        return seconds * NANOSECONDS + nanoseconds, values[:, 2:]
