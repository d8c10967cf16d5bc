"""
Bags of rosbag2: opened, also when cut off, and written. The only module that knows rosbags.

It hands over connections and serialized bytes; what they mean is for ``bag_recording``.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, ExitStack, suppress
from dataclasses import dataclass
import difflib
import errno
from itertools import islice
from pathlib import Path
import sqlite3
from typing import BinaryIO, TypeVar

from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinitionFormat
from rosbags.rosbag2 import (
    CompressionFormat,
    CompressionMode,
    Reader,
    StoragePlugin,
    Writer,
    WriterError,
)
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.typesys import get_types_from_idl, get_types_from_msg, get_typestore, Stores

from wrist_ft_comp.errors import RecordingError

#: Storage plugin by suffix.
SUFFIXES = {'.mcap': 'mcap', '.db3': 'sqlite3'}
#: Messages in memory at once.
BATCH = 20_000
_MCAP_MAGIC = b'\x89MCAP0\r\n'
_MCAP_DATA_END = 0x0F
_COMPRESSION = {
    '': CompressionMode.NONE,
    'file': CompressionMode.FILE,
    'message': CompressionMode.MESSAGE,
}
_Key = TypeVar('_Key')
Message = tuple[Connection, int, bytes]


@dataclass(frozen=True, eq=False)
class Bag:
    """An open bag."""

    name: str
    #: ``sqlite3`` or ``mcap``.
    storage: str
    #: ``file``, ``message`` or ''.
    compression: str
    #: What rosbags knows of each topic.
    connections: tuple[Connection, ...]
    #: When the first and the last message were recorded, ns; meaningless without messages.
    span_ns: tuple[int, int]
    #: Gives (connection, time of recording in ns, bytes) of the given connections' messages.
    read: Callable[[Sequence[Connection]], Iterator[Message]]
    #: What was lost.
    warnings: tuple[str, ...] = ()

    def batches(self, connections: Sequence[Connection]) -> Iterator[list[Message]]:
        """Read messages of the given connections, BATCH at a time, in order of recording."""
        messages = self.read(connections)
        while True:
            with _translated(self.name):
                batch = list(islice(messages, BATCH))
            if not batch:
                return
            yield batch

    def grouped(self, streams: Mapping[int, _Key]) -> Iterator[dict[_Key, list[bytes]]]:
        """Read messages, BATCH at a time, by what each connection's number stands for."""
        messages = self.read([c for c in self.connections if c.id in streams])
        while True:
            groups: defaultdict[_Key, list[bytes]] = defaultdict(list)
            with _translated(self.name):
                for connection, _, data in islice(messages, BATCH):
                    groups[streams[connection.id]].append(data)
            if not groups:
                return
            yield groups

    def find(self, topic: str, message_type: str, role: str) -> list[Connection]:
        """
        Find the connections of a topic that has messages of some type.

        The role it is needed for is told, with what is there, when there is no such topic.
        """
        wanted = topic.strip('/')
        named_so = [c for c in self.connections if c.topic.strip('/') == wanted]
        if not named_so:
            there = {c.topic: c.msgtype for c in self.connections}
            listed = ', '.join(f'{name} ({kind})' for name, kind in there.items())
            fitting = [name for name, kind in there.items() if kind == message_type]
            near = difflib.get_close_matches(f'/{wanted}', fitting, 1, 0.3) or fitting
            raise RecordingError(
                f'{self.name} holds no topic /{wanted} for the {role}; it holds '
                f'{listed or "no topic at all"}.'
                + (f' Did you mean {near[0]}? Then name that topic.' if near else '')
            )
        for connection in named_so:
            if connection.msgtype != message_type:
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


@contextmanager
def _translated(name: str) -> Iterator[None]:
    """Turn whatever a broken file makes rosbags, SQLite or zstd raise into a RecordingError."""
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


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """
    Open a bag for reading, for as long as the context lasts.

    A folder without ``metadata.yaml``, as a killed recorder leaves it, is read when it holds one
    storage file. Of a cut-off ``.mcap``, everything up to its last complete chunk is read.
    """
    chosen = _choose(path)
    with ExitStack() as stack:
        with _translated(path.name):
            bag = _open(path.name, chosen, stack)
        yield bag


def _choose(path: Path) -> Path:
    """Decide what to hand to rosbags: the folder, or a storage file."""
    if not path.exists():
        raise RecordingError(f'{path} does not exist; expected a bag folder, .mcap or .db3 file.')
    chosen = path
    if path.is_dir() and not (path / 'metadata.yaml').exists():
        files = sorted(file for file in path.iterdir() if file.suffix in SUFFIXES)
        if len(files) > 1:
            raise RecordingError(
                f'{path} holds {len(files)} storage files and no metadata.yaml. Run '
                f"'ros2 bag reindex {path}', or name one of the files."
            )
        if not files:
            raise RecordingError(
                f'{path} is no bag: expected a folder with metadata.yaml or one .mcap or .db3 '
                'file. Name the folder that ros2 bag record made.'
            )
        chosen = files[0]
    if chosen.is_file() and chosen.suffix not in SUFFIXES:
        raise RecordingError(f'{path} is no bag: expected a folder, .mcap or .db3 file.')
    if chosen.is_file() and not chosen.stat().st_size:
        raise RecordingError(f'{chosen} is empty (0 bytes); nothing was recorded. Record again.')
    journals = chosen.glob('*.db3-wal') if chosen.is_dir() else [Path(f'{chosen}-wal')]
    for journal in journals:
        if journal.exists() and journal.stat().st_size:
            database = str(journal).removesuffix('-wal')
            raise RecordingError(
                f'{journal} holds messages which are not in the bag yet: its recorder is running '
                f"or was killed. Stop it, then run: sqlite3 {database} 'PRAGMA wal_checkpoint'"
            )
    return chosen


def _open(name: str, chosen: Path, stack: ExitStack) -> Bag:
    """Let rosbags open it; fall back on scanning an .mcap file that lost its end."""
    try:
        reader = stack.enter_context(Reader(chosen))
    except Exception:
        cut = _cut_mcap(chosen)
        if cut is None:
            raise
        return _salvage(name, cut, stack)
    storages = getattr(reader.storage, 'storages', [reader.storage])
    return Bag(
        name=name,
        storage='mcap' if isinstance(storages[0], McapReader) else 'sqlite3',
        compression=reader.compression_mode or '',
        connections=tuple(reader.connections),
        span_ns=(reader.start_time, reader.end_time - 1),  # rosbags' end is exclusive
        read=reader.messages,
    )


def _cut_mcap(chosen: Path) -> Path | None:
    """Return the .mcap file if there is one, it begins as one and does not end as one."""
    files = sorted(chosen.glob('*.mcap')) if chosen.is_dir() else [chosen]
    if len(files) != 1 or files[0].suffix != '.mcap':
        return None
    with files[0].open('rb') as file:
        begins = file.read(len(_MCAP_MAGIC)) == _MCAP_MAGIC
        file.seek(-min(len(_MCAP_MAGIC), file.seek(0, 2)), 2)
        ends = file.read() == _MCAP_MAGIC and file.tell() > len(_MCAP_MAGIC)
    return files[0] if begins and not ends else None


def _salvage(name: str, path: Path, stack: ExitStack) -> Bag:
    """Scan a cut-off .mcap file without its index, up to the last complete record."""
    reader = McapReader(path)
    reader.bio = stack.enter_context(path.open('rb'))
    reader.data_start = len(_MCAP_MAGIC)
    reader.data_end = _end_of_last_record(reader.bio)
    reader.meta_scan()
    statistics = reader.statistics
    if statistics is None or not statistics.message_count:
        raise RecordingError(
            f'{name} is cut off before its first complete chunk of messages; nothing can be read. '
            "Record again, or try 'mcap recover'."
        )
    counts = statistics.channel_message_counts
    lost = (
        f'{name} is cut off: {statistics.message_count} messages could be read, and the last '
        f'{path.stat().st_size - reader.data_end} bytes could not. The recorder was probably '
        'killed.'
    )
    return Bag(
        name=name,
        storage='mcap',
        compression='',
        connections=tuple(c._replace(msgcount=counts.get(c.id, 0)) for c in reader.connections),
        span_ns=(statistics.start_time, statistics.end_time),
        read=reader.messages_scan,
        warnings=(lost,),
    )


def _end_of_last_record(file: BinaryIO) -> int:
    """Hop over complete records (opcode, 8-byte length, content) up to the end of the data."""
    size = file.seek(0, 2)
    end = len(_MCAP_MAGIC)
    while True:
        file.seek(end)
        head = file.read(9)
        following = end + 9 + int.from_bytes(head[1:], 'little')
        if len(head) < 9 or head[0] == _MCAP_DATA_END or following > size:
            return end
        end = following


@contextmanager
def write_bag(folder: Path, storage: str, compression: str) -> Iterator[Writer]:
    """Make a bag in a new folder, for as long as the context lasts; an OSError if it cannot be."""
    try:
        writer = Writer(folder, version=9, storage_plugin=StoragePlugin[storage.upper()])
        writer.set_compression(_COMPRESSION[compression], CompressionFormat.ZSTD)
        with writer:
            yield writer
    except (WriterError, sqlite3.Error) as error:
        raise OSError(errno.EIO, str(error)) from error


def add_topic(writer: Writer, like: Connection, topic: str) -> Connection:
    """Add a topic with the type, definition and quality of service of another."""
    text, digest = _definition(like)
    extra = like.ext
    qos = extra.offered_qos_profiles if isinstance(extra, ConnectionExtRosbag2) else []
    return writer.add_connection(
        topic, like.msgtype, msgdef=text, rihs01=digest, offered_qos_profiles=qos
    )


def _definition(connection: Connection) -> tuple[str, str]:
    """Find a topic's message definition and its hash, which older and bare bags lack."""
    kind, text = connection.msgtype, connection.msgdef.data
    digest = connection.digest
    if text and digest:
        return text, digest
    parsers = {
        MessageDefinitionFormat.MSG: lambda: get_types_from_msg(text, kind),
        MessageDefinitionFormat.IDL: lambda: get_types_from_idl(text),
    }
    store = get_typestore(Stores.ROS2_JAZZY)
    with suppress(Exception):  # a type that nobody can describe is copied without description
        if kind not in store.types:
            store.register(parsers[connection.msgdef.format]())
        digest = digest or store.hash_rihs01(kind)
        text = text or store.generate_msgdef(kind, ros_version=2)[0]
    return text, digest or f'RIHS01_{0:064}'
