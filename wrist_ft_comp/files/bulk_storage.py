"""
The storages of rosbag2 in bulk, as plugins of the package rosbags.

rosbags hands every message through a dozen calls of its own, which cost more than all that is
done with the message. These plugins keep its opening, indexing and closing, and replace only the
loops over messages; whatever is unusual goes the usual way.
"""

import struct
from collections import Counter, defaultdict
from collections.abc import Collection, Generator, Mapping, Sequence
from io import SEEK_END, BytesIO
from itertools import pairwise
from operator import itemgetter
from types import MappingProxyType
from typing import Any

from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionMode, Reader, ReaderError, StoragePlugin, Writer
from rosbags.rosbag2.reader import DirectoryReader
from rosbags.rosbag2.storage_mcap import (
    ChunkInfo,
    McapReader,
    McapWriter,
    PendingChunk,
    decompress,
)
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer

_MESSAGE, _CHUNK, _INDEX = 0x05, 0x06, 0x07
#: A record's opcode and length; of a message also channel, sequence number and both times.
_RECORD = struct.Struct('<BQ')
_MESSAGE_HEAD = struct.Struct('<BQHIQQ')
_IN_MESSAGE = _MESSAGE_HEAD.size - _RECORD.size
#: In a chunk's record: where its checksum is, and what lies before the name of the compression.
_CRC, _FIXED = struct.Struct('<I'), 40
#: The size at which rosbags closes a chunk.
_CHUNK_BYTES = 2**20

#: Connection, time of recording in ns, and bytes.
Message = tuple[Connection, int, bytes]
_Messages = Generator[Message, None, None]


class BulkMcapReader(McapReader):
    """Reads an indexed mcap file chunk by chunk."""

    def messages(
        self,
        connections: Collection[Connection],
        start: int | None = None,
        stop: int | None = None,
    ) -> _Messages:
        """Read as rosbags does; where chunks overlap in time, or a part is wanted, by rosbags."""
        chunks = sorted(self.chunks, key=itemgetter(0, 2))  # by first time, then by place
        overlap = any(a.message_end_time > b.message_start_time for a, b in pairwise(chunks))
        if not chunks or overlap or start is not None or stop is not None:
            yield from super().messages(connections, start, stop)
            return
        wanted = {connection.id: connection for connection in connections}
        for chunk in chunks:
            if any(chunk.channel_count.get(number) for number in wanted):
                yield from sorted(_parse(self._content(chunk), wanted), key=itemgetter(1))

    def _content(self, chunk: ChunkInfo) -> bytes:
        """Read a chunk's records, decompressed and checked."""
        file: Any = self.bio
        file.seek(chunk.chunk_start_offset)
        record = file.read(chunk.chunk_length)
        begin = _RECORD.size + _FIXED + len(chunk.compression)
        (crc,) = _CRC.unpack_from(record, _RECORD.size + 24)
        compressed = record[begin : begin + chunk.compressed_size]
        return decompress(compressed, chunk.compression, chunk.uncompressed_size, crc)


def _parse(content: bytes, wanted: Mapping[int, Connection]) -> list[Message]:
    """Find the messages of the wanted channels among a chunk's records."""
    found: list[Message] = []
    unpack, at, end = _MESSAGE_HEAD.unpack_from, 0, len(content)
    content += bytes(_IN_MESSAGE)  # so that the last record can be looked at like any other
    while at < end:
        kind, size, channel, _, recorded, _ = unpack(content, at)
        following = at + _RECORD.size + size
        if kind == _MESSAGE and channel in wanted:
            data = content[at + _MESSAGE_HEAD.size : following]
            found.append((wanted[channel], recorded, data))
        at = following
    if at != end:
        raise ReaderError('A chunk ends inside a record.')
    return found


class BulkDirectoryReader(DirectoryReader):
    """Reads a bag's folder."""

    STORAGE_PLUGINS = MappingProxyType({**DirectoryReader.STORAGE_PLUGINS, 'mcap': BulkMcapReader})


class BulkReader(Reader):
    """Reads a bag's folder or storage file."""

    STORAGE_PLUGINS = MappingProxyType(
        {
            **Reader.STORAGE_PLUGINS,
            'dir': BulkDirectoryReader,
            '.mcap': BulkMcapReader,
        }
    )


def _span(messages: Sequence[Message]) -> tuple[int, int]:
    """Find the first and the last time of recording, ns; at least one message is needed."""
    times = [recorded for _, recorded, _ in messages]
    return min(times), max(times)


class BulkSqlite3Writer(Sqlite3Writer):
    """Writes a database."""

    def write_all(self, messages: Sequence[Message]) -> None:
        """Write messages in their order."""
        self.cursor.executemany(
            'INSERT INTO messages (topic_id, timestamp, data) VALUES(?, ?, ?)',
            ((connection.id, recorded, data) for connection, recorded, data in messages),
        )


class BulkMcapWriter(McapWriter):
    """Writes an mcap file; the layout of its records is the one that rosbags writes."""

    def write_all(self, messages: Sequence[Message]) -> None:
        """Write messages in their order."""
        first, last = _span(messages)
        self.message_start_time = min(self.message_start_time, first)
        self.message_end_time = max(self.message_end_time, last)
        parts: list[bytes] = []
        at, pack = self.chunk.bio.tell(), _MESSAGE_HEAD.pack
        for connection, recorded, data in messages:
            number, size = connection.id, len(data)
            self.chunk.msgs[number].append((recorded, at))
            parts += (pack(_MESSAGE, _IN_MESSAGE + size, number, 0, recorded, recorded), data)
            at += _MESSAGE_HEAD.size + size
            if at > _CHUNK_BYTES:
                self._fill(parts)
                self.close_chunk()
                parts, at = [], 0
        self._fill(parts)

    def write(self, connection: Connection, timestamp: int, data: bytes | memoryview) -> None:
        """Write one message."""
        self.write_all([(connection, timestamp, bytes(data))])

    def _fill(self, parts: list[bytes]) -> None:
        """Put records into the chunk that is being filled."""
        self.chunk.bio.write(b''.join(parts))

    def close_chunk(self) -> None:
        """Write the chunk, behind it an index per channel, and keep its entry for the summary."""
        chunk, compressed = self.chunk, self.compressor(self.chunk.bio.getvalue())
        times = [recorded for entries in chunk.msgs.values() for recorded, _ in entries]
        span = struct.pack('<QQ', min(times, default=2**63 - 1), max(times, default=0))
        size = struct.pack('<Q', chunk.bio.tell())
        name = struct.pack('<I', len(self.compression)) + self.compression.encode()
        stored = struct.pack('<Q', len(compressed))
        begin = self.bio.tell()
        self._record(_CHUNK, span, size, bytes(4), name, stored, compressed)
        end, indices = self.bio.tell(), b''
        for number, entries in chunk.msgs.items():
            self.channel_stats[number] += len(entries)
            indices += struct.pack('<HQ', number, self.bio.tell())
            flat = [value for entry in entries for value in entry]
            body = struct.pack(f'<{len(flat)}Q', *flat)
            self._record(_INDEX, struct.pack('<HI', number, len(body)), body)
        place = struct.pack('<QQI', begin, end - begin, len(indices))
        length = struct.pack('<Q', self.bio.tell() - end)
        self.chunks.append(BytesIO(b''.join((span, place, indices, length, name, stored, size))))
        self.chunks[-1].seek(0, SEEK_END)
        self.chunk = PendingChunk(2**63 - 1, 0, BytesIO(), defaultdict(list))

    def _record(self, kind: int, *parts: bytes) -> None:
        """Write one record."""
        content = b''.join(parts)
        self.bio.write(_RECORD.pack(kind, len(content)) + content)


class BulkWriter(Writer):
    """Writes a bag's folder."""

    STORAGE_PLUGINS = MappingProxyType(
        {
            StoragePlugin.SQLITE3: BulkSqlite3Writer,
            StoragePlugin.MCAP: BulkMcapWriter,
        }
    )

    def write_all(self, messages: Sequence[Message]) -> None:
        """
        Write messages in their order.

        Parameters
        ----------
        messages : sequence of (Connection, int, bytes)
            Connections are the writer's own; times of recording in ns.

        """
        if self.compression_mode == CompressionMode.MESSAGE:
            for message in messages:
                self.write(*message)
        elif messages:
            storage: Any = self.storage
            storage.write_all(messages)
            first, last = _span(messages)
            self.min_timestamp = min(self.min_timestamp, first)
            self.max_timestamp = max(self.max_timestamp, last)
            for number, count in Counter(c.id for c, _, _ in messages).items():
                self.counts[number] += count
