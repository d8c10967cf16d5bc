"""
A stand-in of rosbag2_py, which comes with a system ROS only: its documented interface, by rosbags.

It knows what the package uses, and is as strict as pybind11 about types. Errors of C++ arrive in
Python as RuntimeError.
"""

from collections import namedtuple
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

from rosbags import rosbag2

ConverterOptions = namedtuple('ConverterOptions', 'input_format output_format')
StorageFilter = namedtuple('StorageFilter', 'topics')
TopicMetadata = namedtuple(
    'TopicMetadata', 'id name type serialization_format offered_qos_profiles type_description_hash'
)


@dataclass
class StorageOptions:
    uri: str
    storage_id: str = ''

    def __post_init__(self):
        assert type(self.uri) is str
        assert self.storage_id in {'', 'mcap', 'sqlite3'}


class SequentialReader:
    """Reads what is not compressed; storage is found out where it is not named."""

    _compressed = False

    def open(self, storage_options, converter_options):
        assert isinstance(converter_options, ConverterOptions)
        self._reader = rosbag2.Reader(Path(storage_options.uri))
        try:
            self._reader.open()
        except Exception as error:
            raise RuntimeError(str(error)) from error
        if bool(self._reader.compression_mode) is not self._compressed:
            raise RuntimeError('No storage could be initialized from the inputs.')
        self._topics = []
        self._start()

    def _start(self):
        used = [c for c in self._reader.connections if not self._topics or c.topic in self._topics]
        self._messages = self._reader.messages(used) if used else iter(())
        self._next = None

    def close(self):
        if self._reader.is_open:
            self._reader.close()

    def set_filter(self, storage_filter):
        self._topics = list(storage_filter.topics)
        self._start()

    def has_next(self):
        if self._next is None:
            try:
                self._next = next(self._messages, None)
            except Exception as error:
                raise RuntimeError(str(error)) from error
        return self._next is not None

    def read_next(self):
        if not self.has_next():
            raise RuntimeError('Bag is at end. No next message.')
        connection, time_ns, data = self._next
        self._next = None
        return connection.topic, bytes(data), time_ns

    def get_all_topics_and_types(self):
        return [
            TopicMetadata(c.id, c.topic, c.msgtype, 'cdr', c.ext.offered_qos_profiles, c.digest)
            for c in self._reader.connections
        ]

    def get_metadata(self):
        reader = self._reader
        storages = getattr(reader.storage, 'storages', [reader.storage])
        storage = 'mcap' if 'Mcap' in type(storages[0]).__name__ else 'sqlite3'
        counts = [
            SimpleNamespace(topic_metadata=topic, message_count=c.msgcount)
            for topic, c in zip(self.get_all_topics_and_types(), reader.connections, strict=True)
        ]
        return SimpleNamespace(
            storage_identifier=storage,
            starting_time=SimpleNamespace(nanoseconds=reader.start_time),
            duration=SimpleNamespace(nanoseconds=reader.duration - 1),
            topics_with_message_count=counts,
        )


class SequentialCompressionReader(SequentialReader):
    """Reads what was compressed by file or by message."""

    _compressed = True


class SequentialWriter:
    """Writes into a folder that must not be there yet."""

    def open(self, storage_options, converter_options):
        assert isinstance(converter_options, ConverterOptions)
        plugin = rosbag2.StoragePlugin[storage_options.storage_id.upper()]
        try:
            self._writer = rosbag2.Writer(storage_options.uri, version=9, storage_plugin=plugin)
        except rosbag2.WriterError as error:
            raise RuntimeError(str(error)) from error
        self._writer.open()
        self._connections = {}

    def create_topic(self, topic):
        assert isinstance(topic, TopicMetadata)
        self._connections[topic.name] = self._writer.add_connection(
            topic.name, topic.type, msgdef='',
            rihs01=topic.type_description_hash or f'RIHS01_{0:064}',
            offered_qos_profiles=topic.offered_qos_profiles,
        )  # fmt: skip

    def write(self, topic_name, message, time_stamp):
        assert (type(topic_name), type(message), type(time_stamp)) == (str, bytes, int)
        if topic_name not in self._connections:
            raise RuntimeError(f"Topic '{topic_name}' has not been created yet!")
        self._writer.write(self._connections[topic_name], time_stamp, message)

    def close(self):
        if self._writer.storage is not None:
            self._writer.close()
            self._writer.storage = None

    __del__ = close
