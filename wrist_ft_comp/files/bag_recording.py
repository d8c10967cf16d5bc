"""
Recordings as rosbag2: which topics hold what, and their messages as samples, batch by batch.

Times are the messages' header stamps, not the times at which the recorder got them.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from wrist_ft_comp import RecordingError
from wrist_ft_comp.core.recording import (
    AXES,
    FloatArray,
    IntArray,
    REFERENCE_CHANNELS,
    Samples,
    temperature_channel,
)
from wrist_ft_comp.files import cdr
from wrist_ft_comp.files.bag_file import Bag

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
        return cdr.unpack(messages, doubles)
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
