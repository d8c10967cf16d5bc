"""Recordings of every kind: read them, copy them with another wrench, describe them."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
import hashlib
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from wrist_ft_comp.drift.drift_model import order_problem
from wrist_ft_comp.errors import OutputError, RecordingError
from wrist_ft_comp.payload.specific_force_motion import describe_force, ForceSummary, moments_of
from wrist_ft_comp.recordings.bag import Bag, SUFFIXES
from wrist_ft_comp.recordings.bag_opening import open_bag
from wrist_ft_comp.recordings.bag_recording import (
    gravity_samples,
    read_bag,
    rewrite_bag,
    sensor_of,
    uppermost_frame,
)
from wrist_ft_comp.recordings.bag_survey import (
    Candidate,
    RAW_WRENCH,
    suggested_topics,
    survey_bag,
    TEMPERATURE,
    TF,
)
from wrist_ft_comp.recordings.columns import COMPENSATED, require_channels
from wrist_ft_comp.recordings.csv_file import CsvRecording, rewrite_csv, sensor_in
from wrist_ft_comp.recordings.csv_header import first_rows
from wrist_ft_comp.recordings.excerpt import parse_part
from wrist_ft_comp.recordings.foreign_log import (
    guessed_map,
    log_map,
    map_beside,
    with_guessed_force_unit,
)
from wrist_ft_comp.signals import (
    AXES,
    axis_unit,
    Correction,
    FORCE_CHANNELS,
    Progress,
    Recording,
    REFERENCE_CHANNELS,
    ROTATION_CHANNEL,
    Samples,
    SensorNames,
    Topics,
)
from wrist_ft_comp.stored.own_file import beginning, Output, writing
from wrist_ft_comp.stream.batch_grid import grid_samples, GridBuilder
from wrist_ft_comp.stream.clock import NO_TIME
from wrist_ft_comp.stream.sample_checks import SampleChecks
from wrist_ft_comp.wire.temperature_source import parse_source, parse_sources, TemperatureSource

BAG, CSV = 'rosbag2', 'CSV recording'
REFERENCE = 'reference'
SPECIFIC_FORCE = 'specific force'
EXTERNAL_TOPIC = '/wrench_external'
#: Roles of channels that are no temperatures.
_ROLES = {
    **dict.fromkeys(AXES, RAW_WRENCH),
    **dict.fromkeys(REFERENCE_CHANNELS, REFERENCE),
    **dict.fromkeys((*FORCE_CHANNELS, ROTATION_CHANNEL), SPECIFIC_FORCE),
}
#: Bytes of a file that are hashed at once.
_HASHED_AT_ONCE = 1 << 20


def kind_of(path: Path) -> str:
    """Find the kind of a recording from its name; CSV if in doubt."""
    if not path.exists():
        raise RecordingError(
            f'{path} does not exist; expected a bag folder, an .mcap, .db3 or CSV file.'
        )
    if path.is_char_device() or path.is_block_device():
        raise RecordingError(
            f'{path} is a device, which may never end; expected a file or a folder. Write what '
            'it gives into a file first.'
        )
    if path.is_dir() or path.suffix in SUFFIXES:
        return BAG
    if path.suffix in {'.bag', '.zstd', '.zst'}:
        raise RecordingError(
            f'{path.name} cannot be read alone. Of a compressed bag, name the folder; convert a '
            "ROS 1 bag with 'rosbags-convert'."
        )
    return CSV


def read_recording(
    path: Path | str,
    *,
    period_s: float = 1.0,
    topics: Topics | None = None,
    max_bad_share: float = 0.01,
    progress: Progress | None = None,
) -> Recording:
    """
    Read a recording of any kind onto thermal cells of ``period_s``.

    Memory grows with the number of cells only. Topics of a bag are the node's own names by
    default. The recording's warnings say what was left out. RecordingError when it cannot be read,
    when more than ``max_bad_share`` of a channel cannot be used, or when a channel is missing.
    """
    path = Path(path)
    kind = kind_of(path)
    blocks: Iterable[Samples]
    warnings: Iterable[str]
    topics = topics or Topics()
    sensor: SensorNames = {}
    sources: Sequence[TemperatureSource] = ()
    with ExitStack() as stack:
        if kind == BAG:
            bag = stack.enter_context(open_bag(path))
            blocks, warnings = read_bag(bag, topics, progress), bag.warnings
            sources = parse_sources(topics.temperatures)
        else:
            text = CsvRecording(path, map_beside(path, topics.columns, topics.time))
            require_channels(path.name, text.columns)
            sensor = sensor_in(text.columns)
            blocks, warnings = text.samples(progress), text.warnings
        part = parse_part(topics.begin, topics.end, topics.exclude)
        origin: list[int] = []
        blocks = _noting_first_stamp(blocks, origin)
        recording = grid_samples(
            blocks if part.whole else part.of(blocks, path.name),
            name=path.name,
            period_s=period_s,
            max_bad_share=max_bad_share,
            temperatures=sources,
        )
        if kind == BAG:
            sensor = sensor_of(bag, topics)
    if problem := order_problem({'temperature_topics': topics.temperatures}, sensor):
        raise RecordingError(f'{path.name} has its thermometers in another order: {problem}')
    done = filter(None, [_compensated(path)])
    warnings = *done, *recording.warnings, *warnings
    return replace(recording, warnings=warnings, sensor=sensor, origin_ns=origin[0])


def _noting_first_stamp(blocks: Iterable[Samples], origin: list[int]) -> Iterator[Samples]:
    """Pass blocks on; the first stamp of all comes into ``origin``."""
    for block in blocks:
        timed = block.stamps_ns[block.stamps_ns != NO_TIME]
        if len(timed) and not origin:
            origin.append(int(timed[0]))
        yield block


def rewrite_recording(  # noqa: PLR0913 - settings by keyword, each with its default
    source: Path | str,
    target: Path | str,
    correct: Correction,
    *,
    topics: Topics | None = None,
    output_topic: str = '/wrench',
    external: Correction | None = None,
    progress: Progress | None = None,
) -> tuple[str, ...]:
    """
    Copy a recording with its wrench corrected, into the same kind of file; says what was left out.

    A CSV recording gets its wrench columns replaced; a bag gets the corrected wrench on a topic of
    its own, ``output_topic``. What ``external`` makes of the raw wrench comes
    beside it, in columns ``external_force_x`` … or on EXTERNAL_TOPIC. The target must not exist;
    for a bag it is a folder, or, with the suffix of the source's storage, one file. ``correct``
    gets consecutive pieces, NaN for absent axes. RecordingError when the source cannot be read or
    the target cannot be made; a failure leaves nothing behind.
    """
    source, target, topics = Path(source), Path(target), topics or Topics()
    kind = kind_of(source)
    outputs = {output_topic: correct, **({EXTERNAL_TOPIC: external} if external else {})}
    copy = check_copy(source, target, list(outputs))
    with writing(target):
        target.parent.mkdir(parents=True, exist_ok=True)
    with (
        writing(target),
        TemporaryDirectory(prefix=f'.{target.name}.', dir=target.parent) as folder,
    ):
        made = Path(folder) / target.name
        if kind == BAG:
            with open_bag(source) as bag:
                warnings = rewrite_bag(bag, made, outputs, topics, progress)
        else:
            names = map_beside(source, topics.columns, topics.time)
            warnings = rewrite_csv(source, made, correct, external, progress, names)
        copy.check_target(target)
        made.rename(target)
    return warnings


def check_copy(
    source: Path, target: Path, topics: Sequence[str] = (), others: Sequence[Path] = ()
) -> Output:
    """Refuse a target of a copy, or topics that are added to it, before anything is read."""
    copy = Output(name='copy', endings='.csv')
    if done := _compensated(source):
        raise RecordingError(done)
    if kind_of(source) == BAG:
        with open_bag(source) as bag:
            taken = {connection.topic.strip('/') for connection in bag.connections}
            for topic in topics:
                if topic.strip('/') in taken:
                    raise OutputError(
                        f'{bag.name} holds {topic} already; name another topic for the output.'
                    )
                taken.add(topic.strip('/'))
            (ending,) = (end for end, storage in SUFFIXES.items() if storage == bag.storage)
        copy = replace(copy, endings=ending)
    copy.check_target(target, [source, *others])
    return copy


def _compensated(path: Path) -> str:
    """Say that drift was removed from a file, by its header; empty where it was not."""
    done = COMPENSATED in beginning(path).partition('\n')[0]
    return f'{path.name} was compensated already. Name the raw recording.' if done else ''


def hash_recording(path: Path) -> str:
    """
    Hash a file's bytes, or those of a bag's storage files in order: SHA-256, hexadecimal.

    What else lies in the folder may change: metadata.yaml, notes, a database's journal.
    """
    digest, files = hashlib.sha256(), [path]
    if path.is_dir():
        files = sorted(file for file in path.iterdir() if {*SUFFIXES} & {*file.suffixes})
    for file in filter(Path.is_file, files):
        with file.open('rb') as content:
            while part := content.read(_HASHED_AT_ONCE):
                digest.update(part)
    return digest.hexdigest()


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
    #: None where no specific force was recorded.
    specific_force: ForceSummary | None = None
    #: Whether the columns of ``topics`` are a guess, because nobody gave any.
    guessed: bool = False
    #: Why a file cannot be read as a recording; empty where it can, and of a bag.
    refusal: str = ''


def describe_recording(
    path: Path | str, topics: Topics | None = None, progress: Progress | None = None
) -> RecordingSummary:
    """
    Describe a recording of any kind; it need not hold all that a calibration wants.

    Of a bag, the topics say which role which one has; what they don't name is chosen.
    RecordingError when it cannot be read.
    """
    path = Path(path)
    kind = kind_of(path)
    if kind == BAG:
        return _describe_bag(path, topics or Topics(), progress)
    return _describe_csv(path, topics or Topics(), progress)


def _describe_csv(path: Path, topics: Topics, progress: Progress | None) -> RecordingSummary:
    """Describe a CSV file; a log that cannot be read as it is with a map that is guessed."""
    names, guessed = map_beside(path, topics.columns, topics.time), False
    if not names.names and (guess := guessed_map(*first_rows(path)))[0]:
        columns, time = guess[0], topics.time or guess[1]
        text = CsvRecording(path, log_map(columns, time))
        columns = with_guessed_force_unit(columns, text.samples())
        topics, guessed = replace(topics, columns=columns, time=time), True
        names = log_map(columns, time)
    text = CsvRecording(path, names)
    summary = _describe_samples(path.name, text.samples(progress), text.warnings)
    return replace(summary, topics=topics, guessed=guessed)


def _describe_bag(path: Path, topics: Topics, progress: Progress | None) -> RecordingSummary:
    """Take topics, counts and times from the bag's own index, and survey what may be used."""
    with open_bag(path) as bag:
        candidates, warnings = survey_bag(bag, progress)
        topics = suggested_topics(candidates, topics)
        topics, force, doubts = _survey_gravity(bag, candidates, topics)
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
        first, last = bag.span_ns if sum(counts.values()) else (None, None)
        compressed = f', {bag.compression} compression' if bag.compression else ''
        channels = tuple(
            ChannelSummary(topic, kind, count, roles.get(topic.strip('/'), ''))
            for (topic, kind), count in sorted(counts.items())
        )
        kind = f'{BAG}, {bag.storage}{compressed}'
        warnings = *bag.warnings, *warnings, *doubts, *_judge_samples(bag, topics)
        found = first, last, warnings, candidates, topics, force
        return RecordingSummary(path.name, kind, channels, *found)


def _survey_gravity(
    bag: Bag, candidates: Sequence[Candidate], topics: Topics
) -> tuple[Topics, ForceSummary | None, tuple[str, ...]]:
    """Describe the specific force of a bag, of an IMU or else by TF, and say why there is none."""
    if topics.imu:
        imus = (c.force for c in candidates if c.entry.strip('/') == topics.imu.strip('/'))
        return topics, next(imus, None), ()
    asked, moments = topics.gravity_frame, np.zeros((4, 4))
    if not topics.wrench or not (asked or any(c.role == TF for c in candidates)):
        return topics, None, ()
    try:
        topics = replace(topics, gravity_frame=asked or uppermost_frame(bag, topics))
        for block in gravity_samples(bag, topics):
            moments += moments_of(block.values) if block.channels == FORCE_CHANNELS else 0
    except RecordingError as error:
        return replace(topics, gravity_frame=''), None, (str(error),) if asked else ()
    return topics, describe_force(moments), ()


def _judge_samples(bag: Bag, topics: Topics) -> tuple[str, ...]:
    """Say what of a bag's wrench and temperatures cannot be used, as read_recording would."""
    sources = parse_sources(topics.temperatures)
    named = topics.wrench, *(source.topic for source in sources)
    if not all(map(bag.named, named)):
        return ()
    checks = SampleChecks(bag.name, sources)
    try:
        for block in read_bag(bag, replace(topics, imu='', gravity_frame='')):
            checks.admit(block)
    except RecordingError as error:
        return (str(error),)
    return tuple(sentence for sentence, _ in checks.judge())


def _describe_samples(
    name: str, blocks: Iterable[Samples], warnings: Iterable[str]
) -> RecordingSummary:
    """Count samples, judge them as read_recording does, and name every channel's unit and role."""
    builder, moments = GridBuilder(name), np.zeros((4, 4))
    ends: list[int] = []
    for block in blocks:
        if block.channels == FORCE_CHANNELS:
            moments += moments_of(block.values)
        if len(block.stamps_ns):
            ends += [int(block.stamps_ns.min()), int(block.stamps_ns.max())]
            ends = [min(ends), max(ends)]
        builder.add(block)
    refusal = ''
    try:
        judged = builder.build().warnings
    except RecordingError as error:
        refusal = str(error)
        judged = tuple(s for s, _ in builder.checks.judge() if s != refusal)
    found: dict[str, ChannelSummary] = {}
    for channels, tally in builder.checks.tallies.items():
        for channel in channels:
            role = _ROLES.get(channel, TEMPERATURE)
            unit = axis_unit(channel.removeprefix('reference_'))
            reads = (tally.least, tally.largest) if role == TEMPERATURE else None
            samples = tally.samples + (found[channel].samples if channel in found else 0)
            found[channel] = ChannelSummary(channel, '°C' if reads else unit, samples, role, reads)
    return RecordingSummary(
        name,
        CSV,
        tuple(found.values()),
        ends[0] if ends else None,
        ends[1] if ends else None,
        warnings=(*warnings, *judged),
        specific_force=describe_force(moments),
        refusal=refusal,
    )
