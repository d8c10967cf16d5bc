"""
Recordings as rosbag2: their topics as samples, and copies with the corrected wrench added.

Times are the messages' header stamps, not the times at which the recorder got them.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.files import cdr
from wrist_ft_comp.files.bag import add_topic, Bag, SUFFIXES, write_bag
from wrist_ft_comp.model.signals import (
    AXES,
    Correction,
    FloatArray,
    IntArray,
    Progress,
    REFERENCE_CHANNELS,
    Samples,
    temperature_channel,
    Topics,
)

_WRENCH = 'geometry_msgs/msg/WrenchStamped', cdr.WRENCH_DOUBLES
_TEMPERATURE = 'sensor_msgs/msg/Temperature', cdr.TEMPERATURE_DOUBLES
_ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'


@dataclass(frozen=True, eq=False)
class _Stream:
    """What a topic's messages are."""

    topic: str
    channels: tuple[str, ...]
    doubles: int


def read_bag(bag: Bag, topics: Topics, progress: Progress | None = None) -> Iterator[Samples]:
    """Read wrench, temperatures and, where it is there, the reference; by topic and batch."""
    streams = _streams(bag, topics)
    total, seen = sum(c.msgcount for c in bag.connections if c.id in streams), 0
    unstamped = set(streams.values())
    for groups in bag.grouped(streams):
        for stream, messages in groups.items():
            stamps_ns, values = _decode(bag, stream.topic, messages, stream.doubles)
            if stamps_ns.any():
                unstamped.discard(stream)
            yield Samples(stream.channels, stamps_ns, values[:, : len(stream.channels)])
            seen += len(messages)
        if progress:
            progress(min(seen / max(total, 1), 1.0))
    for stream in unstamped:
        raise RecordingError(
            f'Every message on {stream.topic} of {bag.name} has the header stamp 0; expected the '
            'time of measurement. Let the driver fill header.stamp, and record again.'
        )


def _streams(bag: Bag, topics: Topics) -> dict[int, _Stream]:
    """Find the topics; by the connection's number."""
    wanted: list[tuple[str, str, tuple[str, ...], tuple[str, int]]] = [
        (topics.wrench, 'raw wrench', AXES, _WRENCH),
        *(
            (topic, 'temperature', (temperature_channel(j),), _TEMPERATURE)
            for j, topic in enumerate(topics.temperatures)
        ),
    ]
    reference = topics.reference.strip('/')
    holds_reference = any(c.topic.strip('/') == reference and c.msgcount for c in bag.connections)
    if holds_reference or topics.reference != Topics().reference:
        wanted.append((topics.reference, 'reference', REFERENCE_CHANNELS, _WRENCH))
    streams: dict[int, _Stream] = {}
    for topic, role, channels, (kind, doubles) in wanted:
        for connection in bag.find(topic, kind, role):
            if connection.id in streams:
                raise RecordingError(f'Topic {topic} is named twice; each must be another one.')
            streams[connection.id] = _Stream(connection.topic, channels, doubles)
    return streams


def _decode(
    bag: Bag, topic: str, messages: list[bytes], doubles: int
) -> tuple[IntArray, FloatArray]:
    """Read stamps and doubles, naming bag and topic where a message is none of this form."""
    try:
        return cdr.decode_many(messages, doubles)
    except RecordingError as error:
        if messages[0].startswith(_ZSTD_MAGIC):
            raise RecordingError(
                f'Messages on {topic} of {bag.name} are compressed one by one, which only '
                "metadata.yaml tells. Name the bag's folder, after 'ros2 bag reindex' if need be."
            ) from error
        raise RecordingError(f'A message on {topic} of {bag.name} is damaged. {error}') from error


def rewrite_bag(  # noqa: PLR0913, PLR0917 - the front door's settings, passed through
    bag: Bag,
    target: Path,
    correct: Correction,
    topics: Topics,
    output_topic: str,
    progress: Progress | None = None,
) -> tuple[str, ...]:
    """
    Copy a bag with every message, and add the corrected wrench at the raw one's times.

    Storage and compression are those of the source. The target is a folder or, where it is named
    like one, the bare storage file. Says what was lost.
    """
    bare = target.suffix in SUFFIXES
    if bare and SUFFIXES[target.suffix] != bag.storage:
        raise RecordingError(
            f'{target.name} names another storage than that of {bag.name}, {bag.storage}; name a '
            'folder, or a file with the suffix of that storage.'
        )
    folder = target.with_name(f'{target.stem}_bag') if bare else target
    compression = '' if bare else bag.compression
    wrench, doubles = _WRENCH
    raw = {connection.id for connection in bag.find(topics.wrench, wrench, 'raw wrench')}
    if any(c.topic.strip('/') == output_topic.strip('/') for c in bag.connections):
        raise RecordingError(
            f'{bag.name} holds {output_topic} already; name another topic for the output.'
        )
    total, seen = sum(connection.msgcount for connection in bag.connections), 0
    first = next(c for c in bag.connections if c.id in raw)
    with write_bag(folder, bag.storage, compression) as writer:
        copies = {c.id: add_topic(writer, c, c.topic) for c in bag.connections}
        output = add_topic(writer, first, f'/{output_topic.strip("/")}')
        for batch in bag.batches(bag.connections):
            messages = [data for connection, _, data in batch if connection.id in raw]
            if messages:
                stamps_ns, values = _decode(bag, first.topic, messages, doubles)
                messages = cdr.encode_many(messages, correct(stamps_ns, values))
            corrected = iter(messages)
            for connection, stamp, data in batch:
                writer.write(copies[connection.id], stamp, data)
                if connection.id in raw:
                    writer.write(output, stamp, next(corrected))
            seen += len(batch)
            if progress:
                progress(min(seen / total, 1.0))
    if bare:
        (folder / f'{folder.name}{target.suffix}').rename(target)
    return bag.warnings
