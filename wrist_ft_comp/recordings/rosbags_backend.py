"""Bags by rosbags, which needs no ROS and takes definitions from the bag itself."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, ExitStack, suppress
import errno
from functools import partial
from pathlib import Path
import sqlite3
from typing import Any

from rosbags import rosbag2
from rosbags.interfaces import MessageDefinitionFormat, Nodetype
from rosbags.interfaces.typing import FieldDesc, Typesdict
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.typesys import get_types_from_idl, get_types_from_msg, get_typestore, Stores

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recordings.bag import Bag, BagWriter, Connection
from wrist_ft_comp.wire import numbers_in_messages
from wrist_ft_comp.wire.numbers_in_messages import Definitions, FieldType

_MCAP_MAGIC = b'\x89MCAP0\r\n'
_MCAP_DATA_END = b'\x0f'


def open_bag(name: str, chosen: Path, stack: ExitStack) -> Bag:
    """Let rosbags open it; fall back on scanning an .mcap file that lost its end."""
    try:
        reader = stack.enter_context(rosbag2.Reader(chosen))
    except Exception:
        if salvaged := _salvage(name, chosen, stack):
            return salvaged
        raise
    storages = getattr(reader.storage, 'storages', [reader.storage])
    # rosbags' end is exclusive
    return Bag(
        name=name, storage='mcap' if isinstance(storages[0], McapReader) else 'sqlite3',
        compression=reader.compression_mode or '', connections=_connections(reader.connections),
        span_ns=(reader.start_time, reader.end_time - 1), define=_define,
        read=lambda wanted: iter(reader.messages([c.native for c in wanted])))  # fmt: skip


def _connections(found: Iterable[Any]) -> tuple[Connection, ...]:
    return tuple(Connection(c.id, c.topic, c.msgtype, c.msgcount, c) for c in found)


def _salvage(name: str, chosen: Path, stack: ExitStack) -> Bag | None:
    """Scan a cut-off .mcap file up to its last complete record; None where it is none."""
    files = sorted(chosen.glob('*.mcap')) if chosen.is_dir() else [chosen]
    if len(files) != 1 or files[0].suffix != '.mcap':
        return None
    (path,) = files
    size, opcode = path.stat().st_size, b''
    reader = McapReader(path)
    reader.bio = stack.enter_context(path.open('rb'))
    begin = reader.bio.read(len(_MCAP_MAGIC))
    reader.bio.seek(max(size - len(_MCAP_MAGIC), 0))
    if begin != _MCAP_MAGIC or reader.bio.read() == _MCAP_MAGIC:
        return None
    reader.data_start = end = len(_MCAP_MAGIC)
    # Hop over complete records (opcode, 8-byte length, content) up to the end of the data.
    while end <= size and opcode != _MCAP_DATA_END:
        reader.data_end = end
        reader.bio.seek(end)
        opcode, length = reader.bio.read(1), reader.bio.read(8)
        end += 9 + int.from_bytes(length, 'little') if len(length) == 8 else size
    reader.meta_scan()
    statistics = reader.statistics
    if statistics is None or not statistics.message_count:
        raise RecordingError(
            f"{name} is cut off before its first complete chunk. Record again, or 'mcap recover'."
        )
    counts = statistics.channel_message_counts
    counted = [c._replace(msgcount=counts.get(c.id, 0)) for c in reader.connections]
    lost = (
        f'{name} is cut off: {statistics.message_count} messages were read, but not the last '
        f'{size - reader.data_end} bytes. Was the recorder killed?'
    )
    return Bag(
        name=name, storage='mcap', compression='', connections=_connections(counted),
        span_ns=(statistics.start_time, statistics.end_time), define=_define, warnings=(lost,),
        read=lambda wanted: iter(reader.messages_scan([c.native for c in wanted])))  # fmt: skip


@contextmanager
def write_bag(folder: Path, storage: str) -> Iterator[BagWriter]:
    """Make a bag in a new folder; an OSError if it cannot be written."""
    try:
        plugin = rosbag2.StoragePlugin[storage.upper()]
        with rosbag2.Writer(folder, version=9, storage_plugin=plugin) as writer:
            yield partial(_add_topic, writer), writer.write
    except (rosbag2.WriterError, sqlite3.Error) as error:
        raise OSError(errno.EIO, str(error)) from error


def _add_topic(writer: rosbag2.Writer, like: Connection, topic: str, kind: str) -> Any:
    """Add a topic with the quality of service of another, and its definition or a standard one."""
    qos, store = like.native.ext.offered_qos_profiles, get_typestore(Stores.ROS2_JAZZY)
    if kind != like.msgtype:
        return writer.add_connection(topic, kind, typestore=store, offered_qos_profiles=qos)
    # Older and bare bags lack the definition or its hash; nobody can describe some types.
    text, digest = like.native.msgdef.data, like.native.digest or f'RIHS01_{0:064}'
    with suppress(Exception):
        if kind not in store.types:
            store.register(_parse(like.native))
        digest = like.native.digest or store.hash_rihs01(kind)
        text = text or store.generate_msgdef(kind, ros_version=2)[0]
    return writer.add_connection(topic, kind, msgdef=text, rihs01=digest, offered_qos_profiles=qos)


def _parse(connection: Any) -> Typesdict:
    """Parse the definition that the bag carries of a topic's type; empty where it has none."""
    text = connection.msgdef.data
    if connection.msgdef.format is MessageDefinitionFormat.IDL:
        return get_types_from_idl(text)
    return get_types_from_msg(text, connection.msgtype) if text else {}


def _define(connection: Connection) -> Definitions:
    """Collect definitions: the bag's own, and else those of ROS 2 Jazzy, or what is installed."""
    types = dict(get_typestore(Stores.ROS2_JAZZY).fielddefs)
    with suppress(Exception):  # a text that is no definition is none
        types.update(_parse(connection.native))
    if connection.msgtype not in types:
        return numbers_in_messages.define_installed(connection.topic, connection.msgtype)
    return {
        name: [(field, _field_type(what)) for field, what in fields]
        for name, (_, fields) in types.items()
    }


def _field_type(what: FieldDesc) -> FieldType:
    """Say in this package's words what rosbags says of a field."""
    if what[0] is Nodetype.ARRAY or what[0] is Nodetype.SEQUENCE:
        element, size = what[1]
        is_sequence = what[0] is Nodetype.SEQUENCE
        return _field_type(element)[0], numbers_in_messages.SEQUENCE if is_sequence else size
    return (what[1] if what[0] is Nodetype.NAME else what[1][0]), None
