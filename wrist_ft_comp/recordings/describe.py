"""What a file or a folder holds, for people: channels, and how they would be read."""

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import takewhile
from pathlib import Path
import re

import numpy as np

from wrist_ft_comp.channels import AXES, axis_unit, is_plausible, temperature_channel
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.payload.accelerometer import describe_force, ForceSummary, moments_of
from wrist_ft_comp.recording import Recording, Topics
from wrist_ft_comp.recordings.bag import (
    Bag,
    Connection,
    decode,
    temperatures_inside,
    uppermost_frame,
)
from wrist_ft_comp.recordings.log_proposal import FAR, OPEN
from wrist_ft_comp.recordings.read import (
    BAG,
    open_recording,
    OpenBag,
    OpenTable,
    read_opened,
    TABLE,
)
from wrist_ft_comp.recordings.read_options import parse_options
from wrist_ft_comp.series import FloatArray, IntArray, NANOSECONDS, part_of, Progress
from wrist_ft_comp.wire import cdr
from wrist_ft_comp.wire.message_layout import NumberReader
from wrist_ft_comp.wire.message_layout import Path as FieldPath
from wrist_ft_comp.wire.temperature_source import parse_source, path_text

RAW_WRENCH, TEMPERATURE, IMU, TF = 'raw wrench', 'temperature', 'IMU', 'TF'
_ROLES = {cdr.WRENCH: RAW_WRENCH, cdr.TEMPERATURE: TEMPERATURE, cdr.IMU: IMU, cdr.TF: TF}
#: Names of wrenches that were processed before; /wrench is what compensate adds.
_TREATED = re.compile(
    r'^/wrench$|compensat|filter|tare|zero|bias|external|reference|drift', re.IGNORECASE
)
#: Names of temperatures of the sensor, or near it.
_NEAR = re.compile(r'sensor|force|wrench|torque|tool|flange|(?<![a-z])ft(?![a-z])', re.IGNORECASE)
#: A thermometer that changes by less, K, sees no warm-up.
_MOVES_K = 0.5
#: Number of thermometers that are suggested: one inside the sensor, one at the motor's side.
_SUGGESTED = 2


@dataclass(frozen=True)
class Candidate:
    """A topic, or a number in its messages, that may be used, and how good it is."""

    #: RAW_WRENCH, TEMPERATURE, IMU or TF.
    role: str
    #: As an option takes it: a topic, or ``topic:field``.
    entry: str
    samples: int
    #: Samples per second, on average; None where all came at once.
    rate_hz: float | None
    #: Whether the stamps are the headers'; else times of arrival.
    stamped: bool
    #: Lowest and highest reading, in the driver's unit; None but for temperatures.
    reads: tuple[float, float] | None = None

    @property
    def moves(self) -> bool:
        """Whether it is a temperature that moved."""
        return self.reads is not None and self.reads[1] - self.reads[0] >= _MOVES_K


@dataclass(eq=False)
class _Tally:
    """Statistics of the messages of a connection."""

    connection: Connection
    role: str
    #: Of messages of another type: where the temperatures are.
    paths: list[FieldPath] = field(default_factory=list)
    reader: NumberReader | None = None
    stamped: bool = False
    #: Earliest and latest stamp, ns.
    stamps_ns: list[int] = field(default_factory=list)
    #: Of each temperature.
    low: FloatArray | float = np.nan
    high: FloatArray | float = np.nan

    def add(self, times_ns: list[int], stamps_ns: IntArray, values: FloatArray) -> None:
        """Take messages into account."""
        # A single message without a stamp must not mix the clock of arrival with that of stamps.
        self.stamped |= bool(stamps_ns.any())
        used_ns = [*(stamps_ns[stamps_ns != 0].tolist() or times_ns), *self.stamps_ns]
        self.stamps_ns = [min(used_ns), max(used_ns)]
        self.low = np.fmin(self.low, np.fmin.reduce(values))
        self.high = np.fmax(self.high, np.fmax.reduce(values))

    def candidates(self) -> Iterator[Candidate]:
        """Make the candidates of the connection."""
        topic, samples = self.connection.topic, self.connection.msgcount
        span_ns = self.stamps_ns[1] - self.stamps_ns[0]
        rate_hz = (samples - 1) * NANOSECONDS / span_ns if span_ns else None
        if self.role != TEMPERATURE:
            yield Candidate(self.role, topic, samples, rate_hz, self.stamped)
            return
        # What has no stamp counts at its time of arrival where it is read as a field.
        plain: list[FieldPath] = [()] if self.stamped else [('temperature',)]
        lows, highs = np.atleast_1d(self.low), np.atleast_1d(self.high)
        for path, low, high in zip(self.paths or plain, lows, highs, strict=False):
            entry = f'{topic}:{path_text(path)}' if path else topic
            reads = float(low), float(high)
            yield Candidate(TEMPERATURE, entry, samples, rate_hz, self.stamped, reads)


def survey_bag(
    bag: Bag, progress: Progress | None = None
) -> tuple[tuple[Candidate, ...], tuple[str, ...]]:
    """List what may be used of a bag, by role and topic, and warnings."""
    warnings: list[str] = []
    found: list[Candidate] = []
    tallies: dict[int, _Tally] = {}
    for connection in (c for c in bag.connections if c.msgcount):
        topic, kind = connection.topic, connection.msgtype
        if kind == cdr.TF:
            found.append(Candidate(TF, topic, connection.msgcount, None, stamped=False))
        elif role := _ROLES.get(kind):
            tallies[connection.id] = _Tally(connection, role)
        else:
            try:
                definitions = bag.define(connection)
            except RecordingError as error:
                warnings.append(f'Whether it holds temperatures is not known: {error}')
                continue
            if paths := temperatures_inside(bag, connection):
                reader = NumberReader(definitions, kind, paths)
                tallies[connection.id] = _Tally(connection, TEMPERATURE, paths, reader)
    for tally, times_ns, messages in bag.grouped(tallies, progress):
        try:
            tally.add(times_ns, *decode(bag, tally.connection, messages, tally.reader))
        except RecordingError as error:  # noqa: PERF203 -- others are whole
            del tallies[tally.connection.id]
            warnings.append(f'{tally.connection.topic} cannot be used: {error}')
    found += [c for tally in tallies.values() if tally.stamps_ns for c in tally.candidates()]
    order = list(_ROLES.values())
    found.sort(key=lambda c: (order.index(c.role), c.entry.partition(':')[0]))
    return tuple(found), tuple(warnings)


def suggested_topics(candidates: Sequence[Candidate], topics: Topics) -> Topics:
    """
    Choose the topics of a bag: the named ones that it holds, else the most probable ones.

    The raw wrench is one whose name shows no processing. Topics with the name of another wrench's
    sensor are not used. The thermometer inside the sensor comes first: the one without the name of
    a motor, with the longest common beginning of its name and the wrench's, or with the name of
    something at the tool; the same holds for IMUs. In an array, the last element is taken for the
    nearest to the tool. Without a raw wrench, its topic is empty.
    """
    wrenches = [c for c in candidates if c.role == RAW_WRENCH]
    wrenches.sort(key=lambda c: (bool(_TREATED.search(c.entry)), -c.samples))
    wrenches.sort(key=lambda c: c.entry.strip('/') != topics.wrench.strip('/'))
    wrench = wrenches[0].entry if wrenches else ''

    def names(entry: str) -> set[str]:
        """Split a topic into the names between its slashes, and these into words."""
        return {*entry.lower().split('/'), *re.findall(r'[a-z]+', entry.lower())}

    ours = names(wrench)
    theirs = {name for other in wrenches[1:] for name in names(other.entry)}

    def distance(candidate: Candidate) -> tuple[bool, int, bool, int]:
        pairs = zip(candidate.entry.split('/'), wrench.split('/'), strict=False)
        common = list(takewhile(lambda pair: pair[0] == pair[1], pairs))
        indices = re.findall(r'\[(\d+)\]', candidate.entry)
        far, near = FAR.search(candidate.entry), _NEAR.search(candidate.entry)
        return far is not None, -len(common), near is None, -int(indices[-1] if indices else -1)

    topics = replace(topics, wrench=wrench)
    candidates = [
        candidate
        for candidate in sorted(candidates, key=distance)
        if names(candidate.entry) & (ours - theirs) or not names(candidate.entry) & (theirs - ours)
    ]
    imus = [c for c in candidates if c.role == IMU and c.stamped]
    if imus and not topics.imu and not topics.gravity_frame:
        topics = replace(topics, imu=imus[0].entry)
    if topics.temperatures != Topics().temperatures:
        return topics
    found = [c for c in candidates if c.role == TEMPERATURE]
    usable = [c for c in found if c.moves and all(map(is_plausible, c.reads or ()))]
    return replace(topics, temperatures=tuple(c.entry for c in (usable or found[:1])[:_SUGGESTED]))


REFERENCE = 'reference'
SPECIFIC_FORCE = 'specific force'


@dataclass(frozen=True)
class ChannelSummary:
    """One topic of a bag, or one channel of a file."""

    name: str
    #: Message type or unit.
    kind: str
    samples: int
    #: RAW_WRENCH, TEMPERATURE, both, REFERENCE, SPECIFIC_FORCE, or '' where it is not used.
    role: str
    #: Lowest and highest usable reading of a temperature in a file, °C.
    reads: tuple[float, float] | None = None


@dataclass(frozen=True)
class RecordingSummary:
    """What a file or folder holds."""

    name: str
    #: Such as ``rosbag2, sqlite3``.
    kind: str
    #: In the file's order.
    channels: tuple[ChannelSummary, ...]
    #: Earliest and latest stamp, ns; of a bag, the times of recording. None without samples.
    first_ns: int | None
    last_ns: int | None
    #: What could not be read, in sentences.
    warnings: tuple[str, ...] = ()
    #: What may be used, of a bag only, and what is used.
    candidates: tuple[Candidate, ...] = ()
    topics: Topics | None = None
    #: None where no specific force was recorded, or nothing can be learnt.
    specific_force: ForceSummary | None = None
    #: Whether the columns of ``topics`` are a guess, because nobody gave any.
    guessed: bool = False
    #: Why it cannot be read as a recording; empty where it can.
    refusal: str = ''
    #: Whether a reference was recorded that is zero throughout.
    is_unloaded: bool = False

    @property
    def is_open(self) -> bool:
        """Whether a person has to name some of the columns."""
        return self.topics is not None and OPEN in self.topics.columns


def describe_recording(
    path: Path | str, topics: Topics | None = None, progress: Progress | None = None
) -> tuple[RecordingSummary, Recording | None]:
    """
    Describe a recording of any kind; it need not hold all that a calibration wants.

    Of a bag, the topics say which role which one has; what they don't name is chosen. It is read
    on the way: the recording, or None. RecordingError when it is none at all.
    """
    topics = topics or Topics()
    with open_recording(Path(path), topics) as opened:
        if isinstance(opened, OpenTable):
            summary, recording = _describe_table(opened, progress)
        else:
            summary, recording = _describe_bag(opened.bag, topics, progress)
    if recording is None or recording.specific_force is None:
        return summary, recording
    known = np.isfinite(recording.specific_force).all(axis=1)
    force = describe_force(moments_of(recording.specific_force[known]))
    return replace(summary, specific_force=force), recording


def _describe_bag(
    bag: Bag, topics: Topics, progress: Progress | None
) -> tuple[RecordingSummary, Recording | None]:
    """Take topics, counts and times from the bag's own index, survey what may be used, read it."""
    parts = [part_of(progress, k, 2) if progress else None for k in range(2)]
    candidates, warnings = survey_bag(bag, parts[0])
    topics, asked = suggested_topics(candidates, topics), topics.gravity_frame
    if topics.wrench and not topics.force_source and any(c.role == TF for c in candidates):
        with suppress(RecordingError):
            topics = replace(topics, gravity_frame=uppermost_frame(bag, topics))
    # What TF does not tell is left out; it is said where a person asked for it.
    recording, refusal = None, ''
    for frame in dict.fromkeys((topics.gravity_frame, '')) if topics.wrench else ():
        topics = replace(topics, gravity_frame=frame)
        try:
            recording = read_opened(OpenBag(bag, parse_options(topics)), 1.0, progress=parts[1])
            refusal = ''
            break
        except RecordingError as error:
            refusal = str(error)
            warnings = *warnings, *([refusal] if frame and asked else [])

    temperatures = {parse_source(entry).topic.strip('/') for entry in topics.temperatures}
    wrench = topics.wrench.strip('/')
    both = f'{RAW_WRENCH}, {TEMPERATURE}' if wrench in temperatures else RAW_WRENCH
    roles = {
        (topics.imu or ('tf' if topics.gravity_frame else '')).strip('/'): SPECIFIC_FORCE,
        topics.reference.strip('/'): REFERENCE,
        **dict.fromkeys(temperatures, TEMPERATURE),
        wrench: both,
    }
    counts: Counter[tuple[str, str]] = Counter()
    for connection in bag.connections:
        counts[connection.topic, connection.msgtype] += connection.msgcount
    first_ns, last_ns = bag.span_ns if sum(counts.values()) else (None, None)
    channels = tuple(
        ChannelSummary(topic, kind, count, roles.get(topic.strip('/'), ''))
        for (topic, kind), count in sorted(counts.items())
    )
    compressed = f', {bag.compression} compression' if bag.compression else ''
    summary = RecordingSummary(
        bag.name, f'{BAG}, {bag.storage}{compressed}', channels, first_ns, last_ns,
        (*bag.warnings, *warnings), candidates, topics, refusal=refusal)  # fmt: skip
    return summary, recording


def _describe_table(
    opened: OpenTable, progress: Progress | None
) -> tuple[RecordingSummary, Recording | None]:
    """Describe a table, and read it; what cannot be read as it is, by a map that is proposed."""
    topics, lacking = opened.options.topics, opened.lacks()
    if lacking:
        proposal = opened.propose()
        columns = ','.join([*filter(None, [topics.columns]), proposal.columns])
        topics = replace(topics, columns=columns, time=topics.time or proposal.time)
        if OPEN in columns:
            refusal = proposal.refusal(opened.name, opened.names, lacking)
            summary = RecordingSummary(opened.name, TABLE, (), None, None, topics=topics)
            return replace(summary, guessed=True, refusal=refusal), None
        opened = OpenTable(opened.tables, parse_options(topics))
    recording, refusal = None, opened.compensated
    try:
        recording = read_opened(opened, opened.period_s, progress=progress)
    except RecordingError as error:
        if not opened.is_read:
            raise
        refusal = refusal or str(error)
    reads: dict[str, tuple[float, float]] = {}
    for j, celsius in enumerate(recording.temperature_c.T if recording else ()):
        reads[temperature_channel(j)] = float(celsius.min()), float(celsius.max())
    channels = []
    for channel, count in opened.counts.items():
        role = RAW_WRENCH if channel in AXES else SPECIFIC_FORCE
        role = REFERENCE if channel.startswith(REFERENCE) else role
        unit = axis_unit(channel.removeprefix('reference_'))
        if channel.startswith('temperature'):
            role, unit = TEMPERATURE, '°C'
        channels.append(ChannelSummary(channel, unit, count, role, reads.get(channel)))
    first_ns, last_ns = opened.span_ns or (None, None)
    summary = RecordingSummary(
        opened.name, TABLE, tuple(channels), first_ns, last_ns, opened.warnings, topics=topics,
        guessed=bool(lacking), refusal=refusal,
        is_unloaded=bool(recording and not np.nan_to_num(recording.reference).any()))  # fmt: skip
    return summary, recording
