"""Bags by rosbag2_py of a system ROS; definitions come from the packages that are installed."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, ExitStack
import errno
from functools import partial
from pathlib import Path
from typing import Any

import rosbag2_py
import yaml

from wrist_ft_comp.recordings.bag import Bag, BagWriter, Connection, Message
from wrist_ft_comp.wire.numbers_in_messages import define_installed


def open_bag(name: str, chosen: Path, stack: ExitStack) -> Bag:
    """Open a bag folder or a storage file; the stack closes it."""
    compression = ''  # file, message or nothing, as only the folder's metadata tells
    if chosen.is_dir():
        text = (chosen / 'metadata.yaml').read_text(encoding='utf-8')
        mode = yaml.safe_load(text)['rosbag2_bagfile_information'].get('compression_mode') or ''
        compression = '' if mode.lower() == 'none' else mode.lower()
    reader = _reader(chosen, compression, stack)
    metadata = reader.get_metadata()
    counts = {t.topic_metadata.name: t.message_count for t in metadata.topics_with_message_count}
    topics = {
        topic.name: Connection(number, topic.name, topic.type, counts.get(topic.name, 0), topic)
        for number, topic in enumerate(reader.get_all_topics_and_types())
    }
    begin_ns = metadata.starting_time.nanoseconds
    return Bag(
        name=name, storage=metadata.storage_identifier, compression=compression,
        connections=tuple(topics.values()),
        span_ns=(begin_ns, begin_ns + metadata.duration.nanoseconds),
        read=partial(_read, chosen, compression, topics),
        define=lambda topic: define_installed(topic.topic, topic.msgtype))  # fmt: skip


def _reader(chosen: Path, compression: str, stack: ExitStack) -> Any:
    kind = rosbag2_py.SequentialCompressionReader if compression else rosbag2_py.SequentialReader
    reader = kind()
    reader.open(rosbag2_py.StorageOptions(uri=str(chosen)), rosbag2_py.ConverterOptions('', ''))
    if hasattr(reader, 'close'):  # in older versions, the last one to hold it closes it
        stack.callback(reader.close)
    return reader


def _read(
    chosen: Path, compression: str, topics: dict[str, Connection], wanted: Sequence[Connection]
) -> Iterator[Message]:
    with ExitStack() as stack:
        reader = _reader(chosen, compression, stack)
        reader.set_filter(rosbag2_py.StorageFilter(topics=[topic.topic for topic in wanted]))
        while reader.has_next():
            name, data, time_ns = reader.read_next()
            yield topics[name], time_ns, data


@contextmanager
def write_bag(folder: Path, storage: str) -> Iterator[BagWriter]:
    """Make a bag in a new folder; an OSError if it cannot be written."""
    writers = [rosbag2_py.SequentialWriter()]
    try:
        where = rosbag2_py.StorageOptions(uri=str(folder), storage_id=storage)
        writers[0].open(where, rosbag2_py.ConverterOptions('', ''))
        yield (
            lambda like, topic, kind: _add_topic(writers[0], like, topic, kind),
            lambda topic, time_ns, data: writers[0].write(topic, data, time_ns),
        )
        writers[0].close()
    except RuntimeError as error:
        raise OSError(errno.EIO, str(error)) from error
    finally:
        writers.clear()


def _add_topic(writer: Any, like: Connection, topic: str, kind: str) -> str:
    """Add a topic with the quality of service of another, and with its hash if of its type."""
    kept = 'serialization_format', 'offered_qos_profiles', 'type_description_hash'
    same = {name: getattr(like.native, name) for name in kept}
    if kind != like.msgtype:
        same['type_description_hash'] = ''
    writer.create_topic(rosbag2_py.TopicMetadata(id=0, name=topic, type=kind, **same))
    return topic
