"""
What a bag is, what is read of it, whichever backend does that, and which topics may be used.

Topics are named by a person, or the most probable ones of those that the bag holds.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from itertools import chain, islice
import re
from typing import Any, NamedTuple

import numpy as np

from wrist_ft_comp import channels
from wrist_ft_comp.channels import AXES, FORCE_CHANNELS, is_plausible, SensorNames
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recording import Samples, Topics
from wrist_ft_comp.recordings.column_proposal import FAR, TREATED
from wrist_ft_comp.series import FloatArray, IntArray, NANOSECONDS, Progress
from wrist_ft_comp.stream.clock import BAG_APART_S, NO_TIME
from wrist_ft_comp.wire import cdr, temperature_source
from wrist_ft_comp.wire.gravity_by_tf import GAP_NS, GravityByTf, tf_layouts
from wrist_ft_comp.wire.numbers_in_messages import Definitions, follow, NumberReader, Path
from wrist_ft_comp.wire.temperature_source import path_text, temperatures_in, TemperatureSource

#: Storage plugin by suffix.
SUFFIXES = {'.mcap': 'mcap', '.db3': 'sqlite3'}
#: Messages in memory at once.
BATCH = 20_000


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
        messages = self.read(connections) if connections else iter(())
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
        self, ids: Container[int], progress: Progress | None = None
    ) -> Iterator[tuple[int, list[int], list[bytes]]]:
        """Read batches by connections, as they begin: the id, times of arrival, ns, and bytes."""
        wanted = [c for c in self.connections if c.id in ids]
        for batch in self.batches(wanted, progress):
            groups = defaultdict[int, list[Message]](list)
            for message in batch:
                groups[message[0].id].append(message)
            for number, group in groups.items():
                yield number, [ns for _, ns, _ in group], [data for _, _, data in group]

    def first(self, connection: Connection) -> bytes:
        """Read the first message of a connection; nothing when there is none."""
        with translated(self.name):
            return next((data for _, _, data in self.read([connection])), b'')

    def named(self, topic: str) -> list[Connection]:
        """List the connections of a topic, with or without its leading slash."""
        return [c for c in self.connections if c.topic.strip('/') == topic.strip('/')]

    def find(self, topic: str, message_type: str | None, role: str) -> list[Connection]:
        """Find a topic's connections, of a type or any (None); RecordingError where none fits."""
        found, name = self.named(topic), f'/{topic.strip("/")}'
        if not found:
            fitting = {c.topic for c in self.connections if message_type in {c.msgtype, None}}
            raise RecordingError(
                f'{self.name} holds no topic {name} for the {role}; it holds '
                f'{", ".join(sorted(fitting)) or "none of its type"}. Name another topic.'
            )
        for connection in found:
            if message_type not in {connection.msgtype, None}:
                raise RecordingError(
                    f'{connection.topic} of {self.name} is {connection.msgtype}; the {role} must '
                    f'be {message_type}. Name another topic, or of a temperature TOPIC:FIELD.'
                )
        holding = [connection for connection in found if connection.msgcount]
        if not holding:
            raise RecordingError(f'{name} of {self.name} holds no messages; was it published?')
        return holding


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


#: Gravity by TF is computed once in this time, ns.
_STEP_NS = NANOSECONDS // 50


@dataclass(eq=False)
class _TopicStream:
    """A topic that is read: a header and doubles, or any message with numbers in it."""

    connection: Connection
    #: Channels of the first doubles.
    channels: tuple[str, ...] = ()
    #: Or, by channel, what the reader reads.
    sources: Mapping[str, TemperatureSource] = field(default_factory=dict)
    reader: NumberReader | None = None
    #: How far times are ahead of arrival, ns: the least and the most of each batch.
    ahead_ns: list[int] = field(default_factory=list)


def read_bag(bag: Bag, topics: Topics, progress: Progress | None = None) -> Iterator[Samples]:
    """Read wrench, temperatures and, where they are, reference and specific force; by batch."""
    streams = {stream.connection.id: stream for stream in _streams(bag, topics)}
    #: Of the temperatures that are fields, those that gave no number yet.
    silent = {channel: stream for stream in streams.values() for channel in stream.sources}
    for number, arrived_ns, messages in bag.grouped(streams, progress):
        stream = streams[number]
        connection = stream.connection
        stamps_ns, values = decode(bag, connection, messages, stream.reader)
        times_ns = np.where(stamps_ns, stamps_ns, arrived_ns if stream.sources else NO_TIME)
        ahead_ns = (times_ns - arrived_ns)[times_ns > NO_TIME]
        if len(ahead_ns):
            stream.ahead_ns += int(ahead_ns.min()), int(ahead_ns.max())
        if not stream.sources:
            frames = cdr.RecentFrames(cdr.DOUBLES[connection.msgtype])
            frames.look(*messages)
            if frames.mixed:
                raise RecordingError(
                    f'Messages on {connection.topic} of {bag.name} are of two sensors: those of '
                    f'{frames.mixed}. Let each driver have a topic of its own, and record again.'
                )
            if connection.msgtype == cdr.IMU:
                yield Samples(FORCE_CHANNELS, times_ns, values[:, cdr.ACCELERATION])
                speed = np.linalg.norm(values[:, cdr.ROTATION], axis=1, keepdims=True)
                measured = speed[:, 0] > 0  # an accelerometer alone leaves it empty
                yield Samples((channels.ROTATION_CHANNEL,), times_ns[measured], speed[measured])
            else:
                yield Samples(stream.channels, times_ns, values[:, : len(stream.channels)])
            continue
        for (channel, source), column in zip(stream.sources.items(), values.T, strict=True):
            # Nodes may share a topic, and a sensor may begin without a reading: as an empty cell.
            held = ~np.isnan(column)
            if held.any():
                silent.pop(channel, None)
            yield Samples((channel,), times_ns[held], source.celsius(column[held, np.newaxis]))
    for channel, stream in silent.items():
        connection = stream.connection
        layout = follow(bag.define(connection), connection.msgtype, bag.first(connection))
        raise RecordingError(f'{bag.name}: {stream.sources[channel].missing(layout)}')
    for stream in streams.values():
        if not stream.ahead_ns:
            topic = stream.connection.topic
            raise RecordingError(
                f'Every message on {topic} of {bag.name} has the header stamp 0; expected the '
                'time of measurement. Let the driver fill header.stamp, and record again; of a '
                f'temperature, {topic}:temperature takes the times of arrival.'
            )
    # Who sends late, in batches or again, and a bag that is played, have some message in time.
    wrench, *others = streams.values()
    for other in others:
        behind_ns = min(wrench.ahead_ns) - max(other.ahead_ns)
        apart_s = max(behind_ns, min(other.ahead_ns) - max(wrench.ahead_ns)) / NANOSECONDS
        if apart_s > BAG_APART_S:
            raise RecordingError(
                f'Stamps of {other.connection.topic} of {bag.name} are {apart_s:.0f} s '
                f'{"behind" if behind_ns > 0 else "ahead of"} those of {wrench.connection.topic}, '
                'compared with their arrival, which counts where there is no stamp; all drivers '
                'must use one clock. Set it, and record again.'
            )
    # Last: times count from the same stamp with it and without.
    if topics.gravity_frame:
        yield from gravity_samples(bag, topics)


def _streams(bag: Bag, topics: Topics) -> list[_TopicStream]:
    """Find the topics; a stream for each connection."""
    named = [(topics.wrench, cdr.WRENCH, 'raw wrench', tuple[str, ...](AXES))]
    fields: defaultdict[str, dict[str, TemperatureSource]] = defaultdict(dict)
    sources = temperature_source.parse_sources(topics.temperatures, lambda topic: topic.strip('/'))
    for number, source in enumerate(sources):
        channel = channels.temperature_channel(number)
        if source.path:
            fields[source.topic.strip('/')][channel] = source
        else:
            named.append((source.topic, cdr.TEMPERATURE, 'temperature', (channel,)))
    holds_reference = any(connection.msgcount for connection in bag.named(topics.reference))
    if holds_reference or topics.reference != Topics().reference:
        named.append((topics.reference, cdr.WRENCH, 'reference', channels.REFERENCE_CHANNELS))
    if topics.imu:
        named.append((topics.imu, cdr.IMU, 'IMU', FORCE_CHANNELS))
    streams = [
        _TopicStream(connection, group)
        for topic, message_type, role, group in named
        for connection in bag.find(topic, message_type, role)
    ]
    for topic, of_topic in fields.items():
        paths = [source.path for source in of_topic.values()]
        for connection in bag.find(topic, None, 'temperature'):
            reader = NumberReader(bag.define(connection), connection.msgtype, paths)
            streams.append(_TopicStream(connection, sources=of_topic, reader=reader))
    topics_read = Counter(stream.connection.id for stream in streams)
    for stream in streams:
        if topics_read[stream.connection.id] > 1:
            raise RecordingError(f'{stream.connection.topic} is named twice; name it once.')
    return streams


def decode(
    bag: Bag, connection: Connection, messages: list[bytes], reader: NumberReader | None = None
) -> tuple[IntArray, FloatArray]:
    """Read stamps, ns, (n,), and doubles, or the reader's numbers, (n, P), or RecordingError."""
    try:
        if reader is not None:
            return reader.read(messages)
        return cdr.decode_many(messages, cdr.DOUBLES[connection.msgtype])
    except RecordingError as error:
        raise RecordingError(
            f'A message on {connection.topic} of {bag.name} is damaged, or is compressed and the '
            f"bag's folder was not named. {error}"
        ) from error


def sensor_of(bag: Bag, topics: Topics) -> SensorNames:
    """Find the names of the sensor of a bag."""
    wrench = bag.find(topics.wrench, cdr.WRENCH, 'raw wrench')[0]
    temperatures = [f'/{entry.strip("/")}' for entry in topics.temperatures]
    names = {'wrench_topic': [wrench.topic], 'temperature_topics': temperatures}
    # Who decodes the wrench says what is wrong with it.
    with suppress(RecordingError):
        data = bag.first(wrench)
        if frame_id := cdr.locate(data, cdr.WRENCH_DOUBLES).frame_id(data):
            names['frame_id'] = [frame_id]
    return names


def gravity_samples(bag: Bag, topics: Topics) -> Iterator[Samples]:
    """Compute specific force by TF, 50 times a second; RecordingError where TF gives none."""
    moving = bag.find(_tf_topic(bag, '/tf'), cdr.TF, 'gravity')
    gravity = _static_gravity(bag, topics)
    due: IntArray = np.empty(0, np.int64)
    last_step, found = 0, False
    for batch in chain(bag.batches(moving), [[]]):
        steps = np.unique(_add_transforms(bag, gravity, batch) // _STEP_NS)
        # A transform may be used in the steps after it, until a gap would begin.
        due = np.union1d(due, np.add.outer(steps, np.arange(GAP_NS // _STEP_NS)))
        settled_ns = gravity.settled_ns() if batch else None
        now = due * _STEP_NS <= (settled_ns or np.iinfo(np.int64).max) - _STEP_NS // 2
        steps, due = due[now & (due > last_step)], due[~now]
        times_ns = steps * _STEP_NS + _STEP_NS // 2
        force, speed = gravity.read(times_ns)
        gravity.forget()
        linked, turned = np.isfinite(force[:, 0]), np.isfinite(speed)
        last_step = int(steps[linked].max(initial=last_step))  # none of a stamp that is ahead
        found |= bool(linked.any())
        yield Samples(FORCE_CHANNELS, times_ns[linked], force[linked])
        yield Samples((channels.ROTATION_CHANNEL,), times_ns[turned], speed[turned, np.newaxis])
    if not found:
        raise RecordingError(
            f'{bag.name}: {gravity.missing()} Name another --gravity-frame, or all of a split bag.'
        )


def uppermost_frame(bag: Bag, topics: Topics) -> str:
    """Find the frame that most probably has z upwards: the one above all that hold the sensor."""
    gravity = _static_gravity(bag, topics)
    for batch in islice(bag.batches(bag.named(_tf_topic(bag, '/tf'))), 1):
        _add_transforms(bag, gravity, batch)
    return gravity.root()


def _static_gravity(bag: Bag, topics: Topics) -> GravityByTf:
    """Begin with the frame of the raw wrench and the static transforms of all of the bag."""
    sensor = sensor_of(bag, topics)
    if 'frame_id' not in sensor:
        raise RecordingError(
            f'{sensor["wrench_topic"][0]} of {bag.name} has no frame_id, so TF cannot say how the '
            'sensor is turned. Let the driver fill header.frame_id, or use an IMU.'
        )
    gravity = GravityByTf(topics.gravity_frame, sensor['frame_id'][0])
    for batch in bag.batches(bag.named(_tf_topic(bag, '/tf_static'))):
        _add_transforms(bag, gravity, batch, static=True)
    return gravity


def _tf_topic(bag: Bag, name: str) -> str:
    """Find a topic of TF, also in a namespace if there is one only."""
    found = {c.topic for c in bag.connections if c.topic.endswith(name)}
    return found.pop() if len(found) == 1 else name


def _add_transforms(
    bag: Bag, gravity: GravityByTf, batch: Sequence[Message], *, static: bool = False
) -> IntArray:
    """Take the transforms of messages in; returns their stamps, ns."""
    stamps_ns: list[IntArray] = [np.empty(0, np.int64)]
    try:
        groups = tf_layouts().group([data for _, _, data in batch])
        for layout, _, rows in sorted(groups, key=lambda group: group[1][-1]):  # as they ended
            for transforms in layout.decode(rows, range(len(layout.frames))):
                gravity.add(transforms, static=static)
                stamps_ns.append(transforms.stamps_ns)
    except RecordingError as error:
        raise RecordingError(
            f'A transform of {bag.name} is damaged. Expected a tf2_msgs/TFMessage. {error}'
        ) from error
    return np.concatenate(stamps_ns)


RAW_WRENCH, TEMPERATURE, IMU, TF = 'raw wrench', 'temperature', 'IMU', 'TF'
_ROLES = {cdr.WRENCH: RAW_WRENCH, cdr.TEMPERATURE: TEMPERATURE, cdr.IMU: IMU, cdr.TF: TF}
#: Names of temperatures of the sensor, or near it.
_NEAR = re.compile(r'sensor|force|wrench|torque|tool|flange|(?<![a-z])ft(?![a-z])', re.IGNORECASE)
#: A thermometer that changes by less, K, sees no warm-up.
_MOVES_K = 0.5
#: Number of thermometers that are suggested: one inside the sensor, one at the motor's side.
_SUGGESTED = 2


@dataclass(frozen=True)
class Candidate:
    """A topic, or a number in its messages, that may be used, and how good it is."""

    role: str
    #: As an option takes it: a topic, or ``topic:field``.
    entry: str
    samples: int
    #: Whether the stamps are the headers'; else times of arrival.
    stamped: bool
    #: Lowest and highest reading, in the driver's unit; NaN but for temperatures.
    reads: tuple[float, float]

    @property
    def moves(self) -> bool:
        """Whether it is a temperature that moved."""
        return self.reads[1] - self.reads[0] >= _MOVES_K


class _Usable(NamedTuple):
    """A connection that may be used, as what, and where its messages have temperatures."""

    connection: Connection
    role: str
    #: Empty of a sensor_msgs/Temperature.
    paths: Sequence[Path] = ((),)
    reader: NumberReader | None = None


def survey_bag(
    bag: Bag, progress: Progress | None = None
) -> tuple[tuple[Candidate, ...], tuple[str, ...]]:
    """List what may be used of a bag, by role and topic, and warnings."""
    warnings: list[str] = []
    usable: dict[int, _Usable] = {}
    for connection in (c for c in bag.connections if c.msgcount):
        topic, kind = connection.topic, connection.msgtype
        if role := _ROLES.get(kind):
            usable[connection.id] = _Usable(connection, role)
            continue
        try:
            definitions = bag.define(connection)
            layout = follow(definitions, kind, bag.first(connection))
        except RecordingError as error:
            warnings.append(f'Whether {topic} holds temperatures is not known: {error}')
            continue
        if paths := temperatures_in(layout, topic):
            reader = NumberReader(definitions, kind, paths)
            usable[connection.id] = _Usable(connection, TEMPERATURE, paths, reader)
    stamped = set[int]()
    #: Lowest and highest of each temperature, (2, P).
    reads: dict[int, FloatArray] = {
        number: np.full((2, len(one.paths)), np.nan) for number, one in usable.items()
    }
    read = {number for number, one in usable.items() if one.role != TF}
    for number, _, messages in bag.grouped(read, progress):
        if not (one := usable.get(number)):
            continue
        try:
            stamps_ns, values = decode(bag, one.connection, messages, one.reader)
        except RecordingError as error:
            del usable[number]
            warnings.append(f'{one.connection.topic} cannot be used: {error}')
            continue
        if stamps_ns.any():
            stamped.add(number)
        if one.role == TEMPERATURE:
            # Behind a Temperature is its variance.
            both = np.vstack((reads[number], values[:, : len(one.paths)]))
            reads[number] = np.stack((np.fmin.reduce(both), np.fmax.reduce(both)))
    found = []
    for number, one in usable.items():
        topic, count, has_stamps = one.connection.topic, one.connection.msgcount, number in stamped
        # A temperature without a stamp counts at its time of arrival where it is read as a field.
        plain = topic if has_stamps or one.role != TEMPERATURE else f'{topic}:temperature'
        for path, low, high in zip(one.paths, *reads[number].tolist(), strict=True):
            entry = f'{topic}:{path_text(path)}' if path else plain
            found.append(Candidate(one.role, entry, count, has_stamps, (low, high)))
    found.sort(key=lambda c: ([*_ROLES.values()].index(c.role), c.entry.partition(':')[0]))
    return tuple(found), tuple(warnings)


def suggested_topics(candidates: Sequence[Candidate], topics: Topics) -> Topics:
    """
    Choose the topics of a bag: the named ones that it holds, else the most probable ones.

    The raw wrench is one whose name shows no processing. Topics with the name of another wrench's
    sensor are not used. The thermometer inside the sensor comes first: the one without the name of
    a motor, with most words of the wrench's topic, or with the name of something at the tool; the
    same holds for IMUs. Of an array, the highest number. Without a raw wrench, its topic is empty.
    """
    raw = [c for c in candidates if c.role == RAW_WRENCH]
    # /wrench is what the node publishes.
    raw.sort(key=lambda c: (c.entry == '/wrench' or bool(TREATED.search(c.entry)), -c.samples))
    raw.sort(key=lambda c: c.entry.strip('/') != topics.wrench.strip('/'))
    wrench = raw[0].entry if raw else ''

    def names(entry: str) -> set[str]:
        """Split a topic into the names between its slashes, and these into words."""
        return {*entry.lower().split('/'), *re.findall(r'[a-z]+', entry.lower())}

    ours = names(wrench)
    theirs = {name for other in raw[1:] for name in names(other.entry)}

    def distance(candidate: Candidate) -> tuple[bool, int, bool, list[int]]:
        numbers = [-int(n) for n in re.findall(r'\d+', candidate.entry.partition(':')[2])]
        far, near = FAR.search(candidate.entry), _NEAR.search(candidate.entry)
        return far is not None, -len(names(candidate.entry) & ours), near is None, numbers or [1]

    def may_be_ours(candidate: Candidate) -> bool:
        words = names(candidate.entry)
        return bool(words & (ours - theirs)) or not words & (theirs - ours)

    topics = replace(topics, wrench=wrench)
    candidates = sorted(filter(may_be_ours, candidates), key=distance)
    imus = [c for c in candidates if c.role == IMU and c.stamped]
    if imus and not topics.force_source:
        topics = replace(topics, imu=imus[0].entry)
    if topics.temperatures != Topics().temperatures:
        return topics
    found = [c for c in candidates if c.role == TEMPERATURE]
    usable = [c for c in found if c.moves and all(map(is_plausible, c.reads))]
    return replace(topics, temperatures=tuple(c.entry for c in (usable or found[:1])[:_SUGGESTED]))
