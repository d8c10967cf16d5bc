"""What a file or a folder holds, for people: channels, and the commands that would read them."""

from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
import re
import shlex

import numpy as np

from wrist_ft_comp.channels import AXES, axis_unit, GRAVITY, temperature_channel
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.payload.mass_and_center import CONTRAST
from wrist_ft_comp.recording import Recording, Topics
from wrist_ft_comp.recordings import bag_topics, read
from wrist_ft_comp.recordings.bag import Bag, uppermost_frame
from wrist_ft_comp.recordings.bag_topics import RAW_WRENCH, TEMPERATURE, TF
from wrist_ft_comp.recordings.column_proposal import OPEN
from wrist_ft_comp.recordings.read_options import MAP_FILE, parse_options
from wrist_ft_comp.report.advice import run_command
from wrist_ft_comp.series import FloatArray, part_of, Progress
from wrist_ft_comp.wire.temperature_source import parse_source

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
    #: What is used.
    topics: Topics
    #: What could not be read, in sentences.
    warnings: tuple[str, ...] = ()
    #: What may be used, of a bag only.
    candidates: tuple[bag_topics.Candidate, ...] = ()
    #: Along how many directions gravity moved in the sensor's frame; a payload needs two. None
    #: where no specific force was recorded, or nothing can be learnt.
    gravity_directions: int | None = None
    #: Whether the columns of ``topics`` are a guess, because nobody gave any.
    guessed: bool = False
    #: Why it cannot be read as a recording; empty where it can.
    refusal: str = ''
    #: Whether a reference was recorded that is zero throughout.
    is_unloaded: bool = False

    @property
    def is_open(self) -> bool:
        """Whether a person has to name some of the columns."""
        return OPEN in self.topics.columns


#: What was found, and the recording where it can be read.
Description = tuple[RecordingSummary, Recording | None]


def describe_recording(
    path: Path | str, topics: Topics | None = None, progress: Progress = lambda _: None
) -> Description:
    """
    Describe a recording of any kind; it need not hold all that a calibration wants.

    Of a bag, the topics say which role which one has; what they don't name is chosen.
    RecordingError when it is none at all.
    """
    topics = topics or Topics()
    with read.open_recording(Path(path), topics) as opened:
        if isinstance(opened, read.OpenTable):
            summary, recording = _describe_table(opened, progress)
        else:
            summary, recording = _describe_bag(opened.bag, topics, progress)
    if recording is None or recording.specific_force is None:
        return summary, recording
    return replace(summary, gravity_directions=directions_of(recording.specific_force)), recording


def _describe_bag(bag: Bag, topics: Topics, progress: Progress) -> Description:
    """Take topics, counts and times from the bag's own index, survey what may be used, read it."""
    candidates, warnings = bag_topics.survey_bag(bag, part_of(progress, 0, 2))
    asked, topics = topics.gravity_frame, bag_topics.suggested_topics(candidates, topics)
    if topics.wrench and not topics.force_source and any(c.role == TF for c in candidates):
        with suppress(RecordingError):
            topics = replace(topics, gravity_frame=uppermost_frame(bag, topics))
    # What TF does not tell is left out; it is said where a person asked for it.
    recording, refusal = None, ''
    for frame in dict.fromkeys((topics.gravity_frame, '')) if topics.wrench else ():
        topics = replace(topics, gravity_frame=frame)
        try:
            opened = read.OpenBag(bag, parse_options(topics))
            recording = read.read_opened(opened, 1.0, progress=part_of(progress, 1, 2))
            refusal = ''
            break
        except RecordingError as error:
            refusal = str(error)
            warnings = *warnings, *([refusal] if frame and asked else [])

    temperatures = {parse_source(entry).topic.strip('/') for entry in topics.temperatures}
    wrench = topics.wrench.strip('/')
    roles = {
        (topics.imu or ('tf' if topics.gravity_frame else '')).strip('/'): SPECIFIC_FORCE,
        topics.reference.strip('/'): REFERENCE,
        **dict.fromkeys(temperatures, TEMPERATURE),
        wrench: f'{RAW_WRENCH}, {TEMPERATURE}' if wrench in temperatures else RAW_WRENCH,
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
        bag.name, f'{read.BAG}, {bag.storage}{compressed}', channels, first_ns, last_ns, topics,
        (*bag.warnings, *warnings), candidates, refusal=refusal)  # fmt: skip
    return summary, recording


def _describe_table(opened: read.OpenTable, progress: Progress) -> Description:
    """Describe a table, and read it; what cannot be read as it is, by a map that is proposed."""
    topics, lacking = opened.options.topics, opened.lacks()
    if lacking:
        proposal = opened.propose()
        columns = ','.join([*filter(None, [topics.columns]), proposal.columns])
        topics = replace(topics, columns=columns, time=topics.time or proposal.time)
        if OPEN in columns:
            refusal = proposal.refusal(opened.name, opened.names, lacking, 'as below.')
            return RecordingSummary(
                opened.name, read.TABLE, (), None, None, topics, guessed=True, refusal=refusal
            ), None
        opened = read.OpenTable(opened.tables, parse_options(topics))
    recording, refusal = None, opened.compensated
    try:
        period_s = read.fitting_period_s([opened.slowness_s])
        recording = read.read_opened(opened, period_s, progress=progress)
    except RecordingError as error:
        if not opened.is_read:
            raise
        refusal = refusal or str(error)
    columns_c = recording.temperature_c.T if recording else ()
    reads = {temperature_channel(j): (c.min(), c.max()) for j, c in enumerate(columns_c)}
    channels = []
    for channel, count in opened.counts.items():
        role = RAW_WRENCH if channel in AXES else SPECIFIC_FORCE
        role = REFERENCE if channel.startswith(REFERENCE) else role
        role = TEMPERATURE if channel.startswith(TEMPERATURE) else role
        unit = axis_unit(channel)
        channels.append(ChannelSummary(channel, unit, count, role, reads.get(channel)))
    first_ns, last_ns = opened.span_ns or (None, None)
    summary = RecordingSummary(
        opened.name, read.TABLE, tuple(channels), first_ns, last_ns, topics, opened.warnings,
        guessed=bool(lacking), refusal=refusal,
        is_unloaded=bool(recording and not np.nan_to_num(recording.reference).any()))  # fmt: skip
    return summary, recording


def commands(summary: RecordingSummary, path: Path) -> list[str]:
    """Write the commands that learn from a recording and judge; of a bag, that run, too."""
    topics, usual, is_bag = summary.topics, Topics(), bool(summary.candidates)
    referred = any(c.role == REFERENCE and c.samples for c in summary.channels)
    referred &= not summary.is_unloaded
    at_work = bool(summary.gravity_directions) and not referred
    reference = 'recorded' if referred else 'payload' if at_work else ''
    words = ['--reference', reference] if reference else []
    if topics.wrench.strip('/') != usual.wrench.strip('/'):
        words += ['--wrench-topic', topics.wrench]
    if topics.temperatures != usual.temperatures:
        for entry in topics.temperatures:
            words += ['--temperature-topic', entry]
    words += topics.options(reference)
    if not at_work:
        topics = replace(topics, imu='', gravity_frame='')
    # Two recordings in one folder have two models, and none is the map of their columns.
    first = path.name.partition('+')[0]
    name = re.sub(r'(\.[a-z]\w*)+$', '', first, flags=re.IGNORECASE)
    model = 'model.yaml' if f'{name}.yaml' in {'.yaml', MAP_FILE} else f'{name}.yaml'
    another = f'ANOTHER_DAY{"" if is_bag else first.removeprefix(name)}'
    calibrate = ['wrist_ft_comp', 'calibrate', str(path), '-o', model]
    evaluate = ['wrist_ft_comp', 'evaluate', model, another]
    if not is_bag:
        return [shlex.join([*command, *words]) for command in (calibrate, evaluate)]
    calibrate += ['--report', f'{Path(model).stem}.html', *words]
    evaluate += ['--report', 'evaluation.html', *words]
    return [shlex.join(calibrate), shlex.join(evaluate), run_command(topics, model)]


def directions_of(force: FloatArray) -> int | None:
    """Count the directions along which specific force, (n, 3), moved; None without samples."""
    force = force[np.isfinite(force).all(axis=1)]
    if not len(force):
        return None
    norm = float(np.sqrt(np.mean(np.sum(force**2, axis=1))))
    moved = np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(force.T, bias=True)), 0))
    return int(np.sum(moved * (GRAVITY / norm if norm else 0.0) > CONTRAST))
