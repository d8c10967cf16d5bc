"""
Where the raw wrench comes from: a topic, or six numbers inside the messages of a topic.

The parameter ``wrench_topic``, or ``--wrench-topic``, is one of::

    /ft_sensor/wrench                 geometry_msgs/WrenchStamped
    /driver/state:wrench              a geometry_msgs/Wrench or WrenchStamped, at any depth
    /driver/frame:.                   a message that itself has the fields force and torque
    /driver/state:tcp_force           an array of six numbers: force, then torque
    /driver/state:data[6..11]         six neighbours in a longer array, the last one included

Force and torque are x, y and z, or arrays of three; in N and N m. Every such message is made a
geometry_msgs/WrenchStamped, so that all else knows one form only. Its header is the nearest one
around the numbers. Without any, its stamp is the time of arrival and its frame_id is empty.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from operator import itemgetter
import re
import struct
from typing import Any

from wrist_ft_comp.errors import RecordingError, SettingsError
from wrist_ft_comp.signals import NANOSECONDS
from wrist_ft_comp.wire.cdr import WRENCH_DOUBLES
from wrist_ft_comp.wire.cdr_fields import Definitions, follow, MessageLayout, Place
from wrist_ft_comp.wire.temperature_source import parse_path, Path, path_text, split_entry

_FORM = (
    'expected TOPIC of geometry_msgs/WrenchStamped, or TOPIC:FIELD, such as /driver/state:wrench '
    'or /driver/state:data[0..5]'
)
#: Six neighbours in an array.
_RANGE = re.compile(r'(?P<array>.+)\[(?P<first>\d+)\.\.(?P<last>\d+)\]')
#: Names of arrays of six numbers that are probably a wrench.
_WRENCH_NAME = re.compile(r'wrench|force|(?<![a-z])ft(?![a-z])', re.IGNORECASE)
#: Steps to three components of a vector: by name, or by index.
_COMPONENTS: tuple[Path, ...] = (('x', 'y', 'z'), (0, 1, 2))
#: Most remembered layouts: a driver has a few, unless texts in its messages vary.
_MOST_LAYOUTS = 100


@dataclass(frozen=True)
class WrenchSource:
    """The raw wrench: a topic, and where in its messages the six numbers are."""

    topic: str
    #: Names of fields, and indices; None for a topic of geometry_msgs/WrenchStamped.
    path: Path | None = None
    #: Index of force x in an array of which a range was named.
    first: int | None = None
    #: As it was written.
    entry: str = field(default='', compare=False)

    @property
    def inside(self) -> str:
        """What stands behind the topic: nothing, or a colon and the field."""
        return self.entry.removeprefix(self.topic)


def parse_wrench(entry: str) -> WrenchSource:
    """Parse an entry; SettingsError with what was expected where it is wrong."""
    entry = entry.strip()
    if ':' not in entry:
        return WrenchSource(entry, entry=entry)
    topic, *rest = split_entry(entry, 'wrench', _FORM)
    if len(rest) > 1 or not rest[0]:
        raise SettingsError(f'The wrench {entry!r} cannot be understood; {_FORM}.')
    if rest == ['.']:
        return WrenchSource(topic, (), entry=entry)
    part = _RANGE.fullmatch(rest[0])
    if part is None:
        return WrenchSource(topic, parse_path(rest[0], entry, 'wrench'), entry=entry)
    first, last = int(part['first']), int(part['last'])
    if last - first + 1 != WRENCH_DOUBLES:
        raise SettingsError(
            f'The wrench {entry!r} names {last - first + 1} numbers; expected six, such as '
            f'[{first}..{first + WRENCH_DOUBLES - 1}].'
        )
    return WrenchSource(topic, parse_path(part['array'], entry, 'wrench'), first, entry)


def wrenches_in(layout: MessageLayout) -> list[str]:
    """Find what is probably a wrench in a message, as an entry names it behind the colon."""
    found: list[Path] = []
    for path, place in layout.places.items():
        if path[-2:] == ('force', 'x'):
            found.append(path[:-2])
        elif path[-1:] == ('force',) and place.size == len(_COMPONENTS[0]):
            found.append(path[:-1])
        elif any(_WRENCH_NAME.search(str(step)) for step in path):
            found += [path] * (place.size == WRENCH_DOUBLES)
    return [path_text(path) or '.' for path in found if _six_numbers(layout, path)]


def _six_numbers(layout: MessageLayout, path: Path, first: int | None = None) -> list[Place]:
    """Find force and torque at a path of a message; empty where there are none."""
    array = layout.places.get(path)
    if array is not None and (first is not None or array.size == WRENCH_DOUBLES):
        begin = first or 0
        options = [[(*path, begin + k) for k in range(WRENCH_DOUBLES)]]
    else:
        options = [
            [(*path, *stamped, part, step) for part in ('force', 'torque') for step in steps]
            for stamped in ((), ('wrench',))
            for steps in _COMPONENTS
        ]
    for option in options:
        six = [place for place in map(layout.find, option) if place and place.code.kind == 'f']
        if len(six) == WRENCH_DOUBLES:
            return six
    return []


@dataclass(frozen=True, eq=False)
class _Form:
    """Where the parts lie in all messages that have the same size and lengths."""

    #: Picks the bytes of the encapsulation and of the lengths, and what they are in this form.
    pick: Callable[[bytes], Any]
    expected: Any
    #: Reads one of the six numbers, and the byte at which it begins.
    numbers: Sequence[tuple[struct.Struct, int]]
    #: Bytes of the header; None without one.
    header: slice | None
    #: Writes the doubles behind a header, or both where there is none.
    tail: struct.Struct


class WrenchReader:
    """Makes geometry_msgs/WrenchStamped of the messages of a topic, remembering their layouts."""

    def __init__(self, source: WrenchSource, kind: str, definitions: Definitions) -> None:
        self.source, self._kind, self._definitions = source, kind, definitions
        self._forms: dict[int, list[_Form]] = {}

    def stamped(self, data: bytes, arrival_ns: int) -> bytes:
        """
        Make one serialized WrenchStamped of a serialized message.

        Parameters
        ----------
        data : bytes
            A message of the reader's type.
        arrival_ns : int
            Its time of arrival, ns, for a message without a header.

        Returns
        -------
        bytes

        Raises
        ------
        RecordingError
            When it is no such message, or holds no wrench where the source says.

        """
        form = self._find(data)
        six = [number.unpack_from(data, at)[0] for number, at in form.numbers]
        if form.header is None:
            return form.tail.pack(data[:4], *divmod(arrival_ns, NANOSECONDS), 1, *six)
        return data[:4] + data[form.header] + form.tail.pack(*six)

    def _find(self, data: bytes) -> _Form:
        """Find the form of a message."""
        alike = self._forms.get(len(data), [])
        for form in alike:
            if form.pick(data) == form.expected:
                return form
        form = self._lay_out(data)
        if sum(map(len, self._forms.values())) >= _MOST_LAYOUTS:
            self._forms.clear()
        self._forms.setdefault(len(data), []).insert(0, form)
        return form

    def _lay_out(self, data: bytes) -> _Form:
        """Follow a message by its definition, and note what all alike have in common."""
        layout, _ = follow(self._definitions, self._kind, data)
        source = self.source
        six = _six_numbers(layout, source.path or (), source.first)
        if not six:
            there, array = wrenches_in(layout), layout.places.get(source.path or ())
            found = f'The message holds {", ".join(there) or "none"}.'
            if array is not None and array.size is not None:
                found = f'There is an array of {array.size}; name six of them, such as [0..5].'
            raise RecordingError(
                f'The wrench {source.entry!r} is not there: expected force and torque, or an '
                f'array of six numbers. {found}'
            )
        numbers = [(struct.Struct(layout.order + place.code.char), place.offset) for place in six]
        places = 0, 1, *(begin + k for begin in layout.lengths for k in range(4))
        pick, header = itemgetter(*places), _header(layout, source.path or ())
        lead, used = '4siIIx', 13
        if header is not None:
            lead, used = '', header.stop - header.start
        # Doubles are aligned to eight bytes behind the encapsulation.
        tail = struct.Struct(f'{layout.order}{lead}{-used % 8}x{WRENCH_DOUBLES}d')
        return _Form(pick, pick(data), numbers, header, tail)


def _header(layout: MessageLayout, path: Path) -> slice | None:
    """Find the bytes of the nearest header at a path or around it: stamp, then frame_id."""
    for depth in range(len(path), -1, -1):
        stamp = layout.places.get((*path[:depth], 'header', 'stamp', 'sec'))
        if stamp is not None:
            ends = dict(layout.texts)
            return slice(stamp.offset, ends[stamp.offset + 12])
    return None
