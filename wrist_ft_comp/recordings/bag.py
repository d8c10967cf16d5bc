"""What a bag is, whichever backend reads it."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
import difflib
from itertools import islice
from typing import Any, TypeVar

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.series import Progress
from wrist_ft_comp.wire.message_layout import Definitions

#: Storage plugin by suffix.
SUFFIXES = {'.mcap': 'mcap', '.db3': 'sqlite3'}
#: Messages in memory at once.
BATCH = 20_000
_Stream = TypeVar('_Stream')


@dataclass(frozen=True, eq=False)
class Connection:
    """A topic of a bag; where its publishers are recorded separately, one of them."""

    id: int  # noqa: A003 -- as rosbags names it
    topic: str
    #: Such as ``std_msgs/msg/String``.
    msgtype: str
    msgcount: int
    #: What the backend knows of it.
    native: Any


#: A connection (by its ``id``), the time of arrival at the recorder, ns, and the bytes.
Message = tuple[Any, int, bytes]


@dataclass(frozen=True, eq=False)
class Bag:
    """An open bag."""

    name: str
    #: ``sqlite3`` or ``mcap``.
    storage: str
    #: ``file``, ``message`` or ''.
    compression: str
    connections: tuple[Connection, ...]
    #: When the first and the last message arrived, ns; meaningless without messages.
    span_ns: tuple[int, int]
    #: Gives the messages of given connections, from the beginning.
    read: Callable[[Sequence[Connection]], Iterator[Message]]
    #: Gives the definition of a connection's type and of all it is made of.
    define: Callable[[Connection], Definitions]
    #: What was lost.
    warnings: tuple[str, ...] = ()

    def batches(
        self, connections: Sequence[Connection], progress: Progress | None = None
    ) -> Iterator[list[Message]]:
        """Read messages of the given connections, BATCH at a time, in order of recording."""
        messages = self.read(connections)
        total, seen = sum(connection.msgcount for connection in connections), 0
        while True:
            with translated(self.name):
                batch = list(islice(messages, BATCH))
            if not batch:
                return
            yield batch
            seen += len(batch)
            if progress:
                progress(min(seen / max(total, 1), 1.0))

    def grouped(
        self, streams: Mapping[int, _Stream], progress: Progress | None = None
    ) -> Iterator[tuple[_Stream, list[int], list[bytes]]]:
        """Read batches per stream, by connection: the stream, times of arrival, ns, and bytes."""
        wanted = [c for c in self.connections if c.id in streams]
        for batch in self.batches(wanted, progress):
            groups: dict[int, tuple[list[int], list[bytes]]] = {c.id: ([], []) for c in wanted}
            for connection, time_ns, data in batch:
                times_ns, messages = groups[connection.id]
                times_ns.append(time_ns)
                messages.append(data)
            for number, stream in list(streams.items()):
                if groups[number][0]:
                    yield stream, *groups[number]

    def first(self, connection: Connection) -> bytes | None:
        """Read the first message of a connection; None when there is none."""
        with translated(self.name):
            return next((data for _, _, data in self.read([connection])), None)

    def named(self, topic: str) -> list[Connection]:
        """List the connections of a topic, with or without its leading slash."""
        return [c for c in self.connections if c.topic.strip('/') == topic.strip('/')]

    def find(self, topic: str, message_type: str | None, role: str) -> list[Connection]:
        """Find a topic's connections, of a type or any (None); RecordingError where none fits."""
        named_so = self.named(topic)
        if not named_so:
            wanted = topic.strip('/')
            present = {c.topic: c.msgtype for c in self.connections}
            listed = ', '.join(f'{name} ({kind})' for name, kind in present.items())
            fitting = [name for name, kind in present.items() if message_type in {kind, None}]
            near = difflib.get_close_matches(f'/{wanted}', fitting, 1, 0.3) or fitting
            raise RecordingError(
                f'{self.name} holds no topic /{wanted} for the {role}; it holds '
                f'{listed or "no topic at all"}.'
                + (f' Did you mean {near[0]}? Then name that topic.' if near else '')
            )
        for connection in named_so:
            if message_type not in {connection.msgtype, None}:
                raise RecordingError(
                    f'{connection.topic} of {self.name} is {connection.msgtype}; the {role} must '
                    f'be {message_type}. Name another topic.'
                )
        if not sum(connection.msgcount for connection in named_so):
            raise RecordingError(
                f'{named_so[0].topic} of {self.name} holds no messages; was the {role} published '
                'while recording?'
            )
        return named_so


#: Two functions that write a bag. The first adds a topic like a connection, by name and type,
#: which is the connection's or a standard one. The second writes a message: what the first one
#: returned, the time of arrival, ns, and bytes.
BagWriter = tuple[Callable[[Connection, str, str], Any], Callable[[Any, int, bytes], None]]


@contextmanager
def translated(name: str) -> Iterator[None]:
    """Turn any exception of a backend, such as for a broken file, into a RecordingError."""
    try:
        yield
    except RecordingError:
        raise
    except Exception as error:
        what = ' '.join(str(error).split()) or 'its structure is broken'
        raise RecordingError(
            f'{name} cannot be read as a bag ({type(error).__name__}: {what[:200].rstrip(".")}). '
            "Try 'ros2 bag reindex' on the folder, 'mcap recover' on an .mcap file, or "
            "'sqlite3 FILE .recover' on a .db3 file."
        ) from error
