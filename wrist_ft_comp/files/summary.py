"""What a recording holds, without putting it on a grid: kind, channels, counts, time span."""

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from wrist_ft_comp.core.chamber import OUTPUT_UNIT
from wrist_ft_comp.core.recording import AXES, axis_unit, Samples
from wrist_ft_comp.files.bag_file import open_bag
from wrist_ft_comp.files.bag_recording import Topics
from wrist_ft_comp.files.chamber_table import read_chamber_table
from wrist_ft_comp.files.csv_recording import sound_chunks
from wrist_ft_comp.files.csv_text import CsvText
from wrist_ft_comp.files.kinds import BAG, CSV, kind_of, TABLE

RAW_WRENCH, TEMPERATURE, REFERENCE = 'raw wrench', 'temperature', 'reference'


@dataclass(frozen=True)
class ChannelSummary:
    """
    One topic of a bag, or one channel of a file.

    Attributes
    ----------
    name : str
        Topic or column.
    kind : str
        Message type or unit.
    samples : int
        How many.
    role : str
        ``raw wrench``, ``temperature``, ``reference``, or '' where it is not used.

    """

    name: str
    kind: str
    samples: int
    role: str


@dataclass(frozen=True)
class RecordingSummary:
    """
    What a file holds.

    Attributes
    ----------
    name : str
        The file's or folder's name.
    kind : str
        Such as ``rosbag2, sqlite3``.
    channels : tuple of ChannelSummary
        In the file's order.
    first_ns, last_ns : int or None
        Earliest and latest stamp, ns; of a bag, the times of recording. None without samples.
    warnings : tuple of str
        What could not be read, in sentences.

    """

    name: str
    kind: str
    channels: tuple[ChannelSummary, ...]
    first_ns: int | None
    last_ns: int | None
    warnings: tuple[str, ...] = ()


def describe_recording(
    path: Path | str,
    topics: Topics | None = None,
    progress: Callable[[float], None] | None = None,
) -> RecordingSummary:
    """
    Describe a recording of any kind; it need not hold all that a calibration wants.

    Parameters
    ----------
    path : Path or str
        File or folder.
    topics : Topics, optional
        Which role a bag's topics have.
    progress : callable, optional
        Given the fraction done, 0 to 1; a bag knows its counts and is not read through.

    Returns
    -------
    RecordingSummary
        What it holds.

    Raises
    ------
    RecordingError
        When it cannot be read.

    """
    path = Path(path)
    kind = kind_of(path)
    if kind == BAG:
        return _describe_bag(path, topics or Topics())
    if kind == CSV:
        text = CsvText(path)
        blocks = (block for _, blocks in sound_chunks(text, progress) for block in blocks)
        return _describe_samples(path.name, CSV, blocks, text.warnings)
    table = read_chamber_table(path)
    left_out = [f'{reason} It is left out.' for _, reason in table.left_out]
    return _describe_samples(path.name, TABLE, table.samples(), left_out)


def _describe_bag(path: Path, topics: Topics) -> RecordingSummary:
    """Take topics, counts and times from the bag's own index."""
    roles = {
        topics.reference.strip('/'): REFERENCE,
        **{topic.strip('/'): TEMPERATURE for topic in topics.temperatures},
        topics.wrench.strip('/'): RAW_WRENCH,
    }
    with open_bag(path) as bag:
        counts: Counter[tuple[str, str]] = Counter()
        for connection in bag.connections:
            counts[connection.topic, connection.msgtype] += connection.msgcount
        first, last = bag.span_ns if sum(counts.values()) else (None, None)
        compressed = f', {bag.compression} compression' if bag.compression else ''
        return RecordingSummary(
            name=path.name,
            kind=f'{BAG}, {bag.storage}{compressed}',
            channels=tuple(
                ChannelSummary(topic, kind, count, roles.get(topic.strip('/'), ''))
                for (topic, kind), count in sorted(counts.items())
            ),
            first_ns=first,
            last_ns=last,
            warnings=bag.warnings,
        )


def _describe_samples(
    name: str, kind: str, blocks: Iterable[Samples], warnings: list[str]
) -> RecordingSummary:
    """Count samples and find their time span."""
    counts: Counter[str] = Counter()
    first: int | None = None
    last: int | None = None
    for block in blocks:
        counts.update(dict.fromkeys(block.channels, len(block.stamps_ns)))
        if len(block.stamps_ns):
            low, high = int(block.stamps_ns.min()), int(block.stamps_ns.max())
            first = low if first is None else min(first, low)
            last = high if last is None else max(last, high)
    channels = tuple(
        _describe_channel(channel, count, OUTPUT_UNIT if kind == TABLE else '')
        for channel, count in counts.items()
    )
    return RecordingSummary(name, kind, channels, first, last, tuple(warnings))


def _describe_channel(channel: str, samples: int, unit: str) -> ChannelSummary:
    """Name unit and role of a channel; the unit is given where it is not N and N m."""
    axis = channel.removeprefix('reference_')
    if axis not in AXES:
        return ChannelSummary(channel, '°C', samples, TEMPERATURE)
    role = RAW_WRENCH if axis == channel else REFERENCE
    return ChannelSummary(channel, unit or axis_unit(axis), samples, role)
