"""
Recordings as rosbag2: which topics hold what, and their messages as samples, batch by batch.

Times are the messages' header stamps, not the times at which the recorder got them.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, ExitStack
from dataclasses import dataclass
import difflib
from itertools import islice
from pathlib import Path
from typing import BinaryIO, TypeVar

from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.storage_mcap import McapReader

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.files import cdr
from wrist_ft_comp.model.signals import (
    AXES,
    FloatArray,
    IntArray,
    REFERENCE_CHANNELS,
    Samples,
    temperature_channel,
)

#: Storage plugin by suffix.
SUFFIXES = {'.mcap': 'mcap', '.db3': 'sqlite3'}


#: Messages in memory at once.
BATCH = 20_000


_MCAP_MAGIC = b'\x89MCAP0\r\n'


_MCAP_DATA_END = 0x0F


_Key = TypeVar('_Key')


Message = tuple[Connection, int, bytes]


@dataclass(frozen=True, eq=False)
class Bag:
    """
    An open bag.

    Attributes
    ----------
    name : str
        For messages.
    storage : str
        ``sqlite3`` or ``mcap``.
    compression : str
        ``file``, ``message`` or ''.
    connections : tuple of Connection
        What rosbags knows of each topic.
    span_ns : tuple of two int
        When the first and the last message were recorded, ns; meaningless without messages.
    read : callable
        Gives (connection, time of recording in ns, bytes) of the given connections' messages.
    warnings : tuple of str
        What was lost.

    """

    name: str
    storage: str
    compression: str
    connections: tuple[Connection, ...]
    span_ns: tuple[int, int]
    read: Callable[[Sequence[Connection]], Iterator[Message]]
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
        Find the connections of a topic.

        Parameters
        ----------
        topic : str
            With or without the leading slash.
        message_type : str
            What its messages must be.
        role : str
            What it is needed for, for messages.

        Returns
        -------
        list of Connection
            At least one, and at least one message among them.

        Raises
        ------
        RecordingError
            When the topic is missing, empty, or of another type; it lists what is there.

        """
        wanted = topic.strip('/')
        found = [c for c in self.connections if c.topic.strip('/') == wanted]
        if not found:
            there = {c.topic: c.msgtype for c in self.connections}
            listed = ', '.join(f'{name} ({kind})' for name, kind in there.items())
            fitting = [name for name, kind in there.items() if kind == message_type]
            near = difflib.get_close_matches(f'/{wanted}', fitting, 1, 0.3) or fitting
            raise RecordingError(
                f'{self.name} holds no topic /{wanted} for the {role}; it holds '
                f'{listed or "no topic at all"}.'
                + (f' Did you mean {near[0]}? Then name that topic.' if near else '')
            )
        for connection in found:
            if connection.msgtype != message_type:
                raise RecordingError(
                    f'{connection.topic} of {self.name} is {connection.msgtype}; the {role} must '
                    f'be {message_type}. Name another topic.'
                )
        if not sum(connection.msgcount for connection in found):
            raise RecordingError(
                f'{found[0].topic} of {self.name} holds no messages; was the {role} published '
                'while recording?'
            )
        return found


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

    Parameters
    ----------
    path : Path
        A rosbag2 folder, or one storage file. A folder without ``metadata.yaml``, as a killed
        recorder leaves it, is read when it holds one storage file.

    Yields
    ------
    Bag
        Of a cut-off ``.mcap``, everything up to its last complete chunk.

    Raises
    ------
    RecordingError
        When it is missing, empty, no bag, or broken.

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


WRENCH_TYPE = 'geometry_msgs/msg/WrenchStamped'


TEMPERATURE_TYPE = 'sensor_msgs/msg/Temperature'


_ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'


@dataclass(frozen=True)
class Topics:
    """
    Where a bag holds what; names match with or without the leading slash.

    Attributes
    ----------
    wrench : str
        Raw wrench, WrenchStamped.
    temperatures : tuple of str
        One topic per thermometer, Temperature; the first is the one inside the sensor.
    reference : str
        Reference wrench, WrenchStamped; the default one may be absent.

    """

    wrench: str = '/wrench_raw'
    temperatures: tuple[str, ...] = ('/temperature',)
    reference: str = '/wrench_reference'


@dataclass(frozen=True, eq=False)
class _Stream:
    """What a topic's messages are."""

    topic: str
    channels: tuple[str, ...]
    doubles: int


def unpack(
    bag: Bag, topic: str, messages: list[bytes], doubles: int
) -> tuple[IntArray, FloatArray]:
    """
    Read stamps and doubles of a topic's messages.

    Parameters
    ----------
    bag : Bag
        Where they come from, for messages.
    topic : str
        The same.
    messages : list of bytes
        n raw messages.
    doubles : int
        Doubles per message.

    Returns
    -------
    stamps_ns : ndarray of int64, shape (n,)
        Header stamps.
    values : ndarray, shape (n, doubles)
        As in the message.

    Raises
    ------
    RecordingError
        Naming bag and topic when a message is not of that form.

    """
    try:
        return cdr.decode_many(messages, doubles)
    except RecordingError as error:
        if messages[0].startswith(_ZSTD_MAGIC):
            raise RecordingError(
                f'Messages on {topic} of {bag.name} are compressed one by one, which only '
                "metadata.yaml tells. Name the bag's folder, after 'ros2 bag reindex' if need be."
            ) from error
        raise RecordingError(f'A message on {topic} of {bag.name} is damaged. {error}') from error


def _streams(bag: Bag, topics: Topics) -> dict[int, _Stream]:
    """Find the topics; by the connection's number."""
    wrench = (WRENCH_TYPE, cdr.WRENCH_DOUBLES)
    temperature = (TEMPERATURE_TYPE, cdr.TEMPERATURE_DOUBLES)
    wanted: list[tuple[str, str, tuple[str, ...], tuple[str, int]]] = [
        (topics.wrench, 'raw wrench', AXES, wrench),
        *(
            (topic, 'temperature', (temperature_channel(j),), temperature)
            for j, topic in enumerate(topics.temperatures)
        ),
    ]
    reference = topics.reference.strip('/')
    holds_reference = any(c.topic.strip('/') == reference and c.msgcount for c in bag.connections)
    if holds_reference or topics.reference != Topics().reference:
        wanted.append((topics.reference, 'reference', REFERENCE_CHANNELS, wrench))
    streams: dict[int, _Stream] = {}
    for topic, role, channels, (kind, doubles) in wanted:
        for connection in bag.find(topic, kind, role):
            if connection.id in streams:
                raise RecordingError(f'Topic {topic} is named twice; each must be another one.')
            streams[connection.id] = _Stream(connection.topic, channels, doubles)
    return streams


def read_blocks(
    bag: Bag, topics: Topics, progress: Callable[[float], None] | None = None
) -> Iterator[Samples]:
    """
    Read wrench, temperatures and, where it is there, the reference.

    Parameters
    ----------
    bag : Bag
        An open bag.
    topics : Topics
        Where it holds what.
    progress : callable, optional
        Given the fraction read so far, 0 to 1.

    Yields
    ------
    Samples
        One per topic and batch.

    Raises
    ------
    RecordingError
        When a topic is missing or of the wrong type, a message is damaged, or a topic's messages
        have no header stamps.

    """
    streams = _streams(bag, topics)
    total, seen = sum(c.msgcount for c in bag.connections if c.id in streams), 0
    unstamped = set(streams.values())
    for messages in bag.grouped(streams):
        for stream, raw in messages.items():
            stamps_ns, values = unpack(bag, stream.topic, raw, stream.doubles)
            if stamps_ns.any():
                unstamped.discard(stream)
            yield Samples(stream.channels, stamps_ns, values[:, : len(stream.channels)])
            seen += len(raw)
        if progress:
            progress(min(seen / max(total, 1), 1.0))
    for stream in unstamped:
        raise RecordingError(
            f'Every message on {stream.topic} of {bag.name} has the header stamp 0; expected the '
            'time of measurement. Let the driver fill header.stamp, and record again.'
        )
