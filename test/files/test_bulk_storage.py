import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.rosbag2 import (
    CompressionFormat,
    CompressionMode,
    Reader,
    ReaderError,
    StoragePlugin,
    Writer,
)
from rosbags.typesys import Stores, get_typestore

from wrist_ft_comp.files.bulk_storage import BulkMcapReader, BulkReader, BulkWriter, _parse

STORE = get_typestore(Stores.ROS2_JAZZY)
storages = pytest.mark.parametrize('storage', list(StoragePlugin))
topics = ('/wrench_raw', '/temperature', '/other')
kinds = ('geometry_msgs/msg/WrenchStamped', 'sensor_msgs/msg/Temperature', 'std_msgs/msg/String')
#: Which topic, time of recording, size.
sent = st.lists(
    st.tuples(st.integers(0, 2), st.integers(0, 2**40), st.integers(0, 200)), max_size=30
)


def payload(number, size):
    return struct.pack('<I', number) + bytes(size)


def write(writer, path, messages, storage, mode=CompressionMode.NONE):
    """Write a bag, message by message or all at once."""
    made = writer(path, version=9, storage_plugin=storage)
    made.set_compression(mode, CompressionFormat.ZSTD)
    with made:
        connections = [
            made.add_connection(topic, kind, typestore=STORE)
            for topic, kind in zip(topics, kinds, strict=True)
        ]
        rows = [(connections[t], at, payload(k, n)) for k, (t, at, n) in enumerate(messages)]
        if writer is BulkWriter:
            made.write_all(rows[: len(rows) // 2])
            made.write_all(rows[len(rows) // 2 :])
        else:
            for row in rows:
                made.write(*row)


def contents(reader, path, chosen=topics):
    with reader(path) as bag:
        wanted = [c for c in bag.connections if c.topic in chosen]
        counts = {c.topic: c.msgcount for c in bag.connections}
        messages = [(c.topic, at, bytes(data)) for c, at, data in bag.messages(wanted)]
        return counts, bag.start_time, bag.end_time, bag.message_count, messages


@storages
@given(sent)
@settings(max_examples=10, deadline=None)
def test_what_is_written_in_bulk_is_what_rosbags_writes(tmp_path_factory, storage, messages):
    one, bulk = (tmp_path_factory.mktemp('bags') / 'bag' for _ in range(2))
    write(Writer, one, messages, storage)
    write(BulkWriter, bulk, messages, storage)
    assert contents(Reader, bulk) == contents(Reader, one)
    if storage == StoragePlugin.MCAP:
        assert (bulk / 'bag.mcap').read_bytes() == (one / 'bag.mcap').read_bytes()


@pytest.mark.parametrize(
    ('storage', 'mode'),
    [
        (storage, mode)
        for storage in StoragePlugin
        for mode in CompressionMode
        if (storage, mode) != (StoragePlugin.SQLITE3, CompressionMode.STORAGE)  # no such thing
    ],
)
def test_compression_is_rosbags_own(tmp_path, storage, mode):
    messages = [(k % 3, 1000 + k, k % 50) for k in range(200)]
    for name, writer in (('one', Writer), ('all', BulkWriter)):
        write(writer, tmp_path / name, messages, storage, mode)
    assert contents(Reader, tmp_path / 'all') == contents(Reader, tmp_path / 'one')
    assert contents(BulkReader, tmp_path / 'one') == contents(Reader, tmp_path / 'one')


@given(sent, st.sets(st.sampled_from(topics), min_size=1))
@settings(max_examples=10, deadline=None)
def test_what_is_read_in_bulk_is_what_rosbags_reads(tmp_path_factory, messages, chosen):
    folder = tmp_path_factory.mktemp('bags') / 'bag'
    write(Writer, folder, messages, StoragePlugin.MCAP)
    assert contents(BulkReader, folder, chosen) == contents(Reader, folder, chosen)


@pytest.mark.parametrize('order', ['forward', 'backward', 'random'])
def test_many_chunks_are_read_in_the_order_of_time(tmp_path, order):
    """3 MB: several chunks, which overlap unless time runs forward."""
    times = np.arange(16_000)
    times = {'forward': times, 'backward': times[::-1]}.get(
        order, np.random.default_rng(1).permutation(times)
    )
    messages = [(k % 3, int(at), 150) for k, at in enumerate(times)]
    write(BulkWriter, tmp_path / 'bag', messages, StoragePlugin.MCAP)
    with BulkReader(tmp_path / 'bag' / 'bag.mcap') as bag:
        assert isinstance(bag.storage, BulkMcapReader)
        assert len(bag.storage.chunks) > 2
    found = contents(BulkReader, tmp_path / 'bag')
    assert found == contents(Reader, tmp_path / 'bag')
    assert [at for _, at, _ in found[-1]] == list(range(16_000))


def test_a_part_of_the_time_is_read_as_rosbags_does(tmp_path):
    messages = [(k % 3, k, 10) for k in range(100)]
    write(Writer, tmp_path / 'bag', messages, StoragePlugin.MCAP)
    with BulkReader(tmp_path / 'bag') as bag:
        assert [at for _, at, _ in bag.messages(start=20, stop=40)] == list(range(20, 40))


def test_a_chunk_that_ends_inside_a_record_is_an_error():
    record = struct.pack('<BQHIQQ', 5, 22 + 8, 1, 0, 7, 7) + bytes(8)
    assert _parse(record, {1: 'connection'}) == [('connection', 7, bytes(8))]
    with pytest.raises(ReaderError, match='inside a record'):
        _parse(record[:-1], {1: 'connection'})
