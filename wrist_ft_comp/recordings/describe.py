"""What a file or a folder holds, for people: channels, and how they would be read."""

from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from wrist_ft_comp.channels import (
    AXES,
    axis_unit,
    FORCE_CHANNELS,
    REFERENCE_CHANNELS,
    ROTATION_CHANNEL,
)
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.payload.accelerometer import describe_force, ForceSummary, moments_of
from wrist_ft_comp.ranges import PERIODS_S
from wrist_ft_comp.recording import Topics
from wrist_ft_comp.recordings.bag import Bag
from wrist_ft_comp.recordings.bag_recording import gravity_samples, uppermost_frame
from wrist_ft_comp.recordings.bag_survey import (
    Candidate,
    RAW_WRENCH,
    suggested_topics,
    survey_bag,
    TEMPERATURE,
    TF,
)
from wrist_ft_comp.recordings.column_map import KINDS, listed
from wrist_ft_comp.recordings.log_proposal import OPEN, propose
from wrist_ft_comp.recordings.open_recording import BAG, open_recording, OpenTable, TABLE
from wrist_ft_comp.recordings.read_options import parse_options
from wrist_ft_comp.series import NANOSECONDS, Progress
from wrist_ft_comp.stream.batch_grid import SampleChecks
from wrist_ft_comp.wire.temperature_source import parse_source

REFERENCE = 'reference'
#: Thermal cells are as long as rows are apart where that is between these, s: rows that are more
#: than a day apart are those of a log in another unit.
_SLOW_S = 120.0, 86_400.0
SPECIFIC_FORCE = 'specific force'
#: Roles of channels that are no temperatures.
_ROLES = {
    **dict.fromkeys(AXES, RAW_WRENCH),
    **dict.fromkeys(REFERENCE_CHANNELS, REFERENCE),
    **dict.fromkeys((*FORCE_CHANNELS, ROTATION_CHANNEL), SPECIFIC_FORCE),
}


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
    #: Whether a person has to name some of them.
    is_open: bool = False
    #: Why a file cannot be read as a recording; empty where it can, and of a bag.
    refusal: str = ''
    #: Length of the thermal cells that fit: 1 s, or that from row to row of a slow log.
    period_s: float = 1.0


def describe_recording(
    path: Path | str, topics: Topics | None = None, progress: Progress | None = None
) -> RecordingSummary:
    """
    Describe a recording of any kind; it need not hold all that a calibration wants.

    Of a bag, the topics say which role which one has; what they don't name is chosen.
    RecordingError when it cannot be read.
    """
    topics = topics or Topics()
    with open_recording(Path(path), topics) as opened:
        if isinstance(opened, OpenTable):
            return _describe_table(opened, progress)
        return _describe_bag(opened.bag, topics, progress)


def _describe_table(opened: OpenTable, progress: Progress | None) -> RecordingSummary:
    """Describe a table; what cannot be read as it is, by a map that is proposed."""
    if not opened.columns.lacks(list(KINDS)):
        return _count_samples(opened, progress)
    topics, table = opened.options.topics, opened.table
    proposal, time = propose(opened.columns, table.shown_rows())
    columns = ','.join([*filter(None, [topics.columns]), proposal])
    topics = replace(topics, columns=columns, time=topics.time or time)
    if OPEN not in proposal:
        summary = _count_samples(OpenTable(table, parse_options(topics)), progress)
        return replace(summary, guessed=True)
    refusal = (
        f'Some of what a recording needs cannot be told from the columns of {table.name}: '
        f'{listed(table.names)}. Name a column in the place of {OPEN}, or give its number.'
    )
    summary = RecordingSummary(table.name, TABLE, (), None, None, topics=topics)
    return replace(summary, is_open=True, guessed=True, refusal=refusal)


def _count_samples(opened: OpenTable, progress: Progress | None) -> RecordingSummary:
    """Count samples, judge them one by one, and name every channel's unit and role."""
    checks, moments = SampleChecks(opened.name), np.zeros((4, 4))
    ends: list[int] = []
    spacings_s: list[float] = []
    for block in opened.samples(progress):
        if block.channels == FORCE_CHANNELS:
            moments += moments_of(block.values)
        if len(block.stamps_ns):
            ends += [int(block.stamps_ns.min()), int(block.stamps_ns.max())]
            ends = [min(ends), max(ends)]
        if len(block.stamps_ns) > 1:
            spacings_s.append(float(np.median(np.diff(block.stamps_ns))) / NANOSECONDS)
        checks.admit(block)
    period_s, spacing_s = 1.0, min(spacings_s, default=0.0)
    if _SLOW_S[0] < spacing_s < _SLOW_S[1]:  # as of a row in ten minutes for weeks
        period_s = min(float(round(spacing_s)), PERIODS_S[1])
    found: dict[str, ChannelSummary] = {}
    for channels, tally in checks.tallies.items():
        for channel in channels:
            role = _ROLES.get(channel, TEMPERATURE)
            unit = axis_unit(channel.removeprefix('reference_'))
            reads = (tally.least, tally.largest) if role == TEMPERATURE else None
            samples = tally.samples + (found[channel].samples if channel in found else 0)
            found[channel] = ChannelSummary(channel, '°C' if reads else unit, samples, role, reads)
    first_ns, last_ns = ends or (None, None)
    return RecordingSummary(
        opened.name, TABLE, tuple(found.values()), first_ns, last_ns,
        warnings=(*opened.warnings, *(sentence for sentence, _ in checks.judge())),
        topics=opened.options.topics, specific_force=describe_force(moments),
        refusal=opened.compensated, period_s=period_s)  # fmt: skip


def _describe_bag(bag: Bag, topics: Topics, progress: Progress | None) -> RecordingSummary:
    """Take topics, counts and times from the bag's own index, and survey what may be used."""
    candidates, warnings = survey_bag(bag, progress)
    topics = suggested_topics(candidates, topics)

    # Specific force of an IMU, or else by TF; say why there is none where it was asked for.
    force, asked = None, topics.gravity_frame
    if topics.imu:
        imus = (c.force for c in candidates if c.entry.strip('/') == topics.imu.strip('/'))
        force = next(imus, None)
    elif topics.wrench and (asked or any(c.role == TF for c in candidates)):
        moments = np.zeros((4, 4))
        try:
            topics = replace(topics, gravity_frame=asked or uppermost_frame(bag, topics))
            for block in gravity_samples(bag, topics):
                moments += moments_of(block.values) if block.channels == FORCE_CHANNELS else 0
            force = describe_force(moments)
        except RecordingError as error:
            topics = replace(topics, gravity_frame='')
            warnings = *warnings, *([str(error)] if asked else [])

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
    return RecordingSummary(
        bag.name, f'{BAG}, {bag.storage}{compressed}', channels, first_ns, last_ns,
        (*bag.warnings, *warnings), candidates, topics, force)  # fmt: skip
