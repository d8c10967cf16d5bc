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

from collections.abc import Callable
from dataclasses import dataclass, field
from math import nan
from operator import itemgetter
import re
import struct

from wrist_ft_comp.errors import SettingsError
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
#: Picks bytes of a message; makes a WrenchStamped of it, arrived at a time, ns.
_Pick = Callable[[bytes], object]
_Make = Callable[[bytes, int], bytes]


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


class WrenchReader:
    """
    Makes geometry_msgs/WrenchStamped of the messages of a topic, remembering their layouts.

    Messages without such a wrench are refused, or, with ``fills``, become NaN.
    """

    def __init__(
        self, source: WrenchSource, kind: str, definitions: Definitions, *, fills: bool = False
    ) -> None:
        self.source, self._kind, self._definitions = source, kind, definitions
        self._fills = fills
        #: How many messages became NaN, and why the last one did.
        self.filled, self.misread = 0, ''
        #: By the size of messages: what to pick of them, what that is where they are laid out
        #: alike, and what makes a WrenchStamped of these.
        self._forms: dict[int, list[tuple[_Pick, object, _Make]]] = {}

    def stamped(self, data: bytes, arrival_ns: int) -> bytes:
        """
        Make a WrenchStamped of a message, both serialized; ``arrival_ns`` is its time of arrival.

        RecordingError when it is no such message, SettingsError when it holds no such wrench.
        """
        for pick, expected, make in self._forms.get(len(data), ()):
            if pick(data) == expected:
                return make(data, arrival_ns)
        pick, make = self._lay_out(data)
        if sum(map(len, self._forms.values())) >= _MOST_LAYOUTS:
            self._forms.clear()
        self._forms.setdefault(len(data), []).insert(0, (pick, pick(data), make))
        return make(data, arrival_ns)

    def _lay_out(self, data: bytes) -> tuple[_Pick, _Make]:
        """Follow a message by its definition: how to tell all alike, and how to read them."""
        layout, _ = follow(self._definitions, self._kind, data)
        source, order = self.source, layout.order
        six = _six_numbers(layout, source.path or (), source.first)
        if not six:
            self.misread = self._missing(layout)
            if not self._fills:
                raise SettingsError(self.misread)
        numbers = [(struct.Struct(order + p.code.char).unpack_from, p.offset) for p in six]
        header, arrival = _header(layout, source.path or ()), struct.Struct(f'{order}iIIx')
        size = arrival.size if header is None else header.stop - header.start
        # Doubles are aligned to eight bytes, counted from behind the encapsulation.
        doubles = struct.Struct(f'{order}{-size % 8}x{WRENCH_DOUBLES}d')

        def make(data: bytes, arrival_ns: int) -> bytes:
            stamp = divmod(arrival_ns, NANOSECONDS)
            head = arrival.pack(*stamp, 1) if header is None else data[header]
            values = [read(data, at)[0] for read, at in numbers]
            if not values:
                self.filled, values = self.filled + 1, [nan] * WRENCH_DOUBLES
            return data[:4] + head + doubles.pack(*values)

        lengths = (begin + k for begin in layout.lengths for k in range(4))
        return itemgetter(0, 1, *lengths), make

    def _missing(self, layout: MessageLayout) -> str:
        """Say that a message has no such wrench, and which it has."""
        wrenches, array = wrenches_in(layout), layout.places.get(self.source.path or ())
        found = f'The message holds {", ".join(wrenches) or "none"}.'
        if array is not None and array.size is not None:
            found = f'There is an array of {array.size}; name six of them, such as [0..5].'
        return (
            f'The wrench {self.source.entry!r} is not there: expected force and torque, or an '
            f'array of six numbers. {found}'
        )


def _header(layout: MessageLayout, path: Path) -> slice | None:
    """Find the bytes of the nearest header at a path or around it: stamp, then frame_id."""
    text_ends = dict(layout.texts)
    for depth in range(len(path), -1, -1):
        stamp = layout.places.get((*path[:depth], 'header', 'stamp', 'sec'))
        # Others' headers may be something else: a std_msgs/Header's text follows its stamp.
        if stamp is not None and stamp.offset + 12 in text_ends:
            return slice(stamp.offset, text_ends[stamp.offset + 12])
    return None
