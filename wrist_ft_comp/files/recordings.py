"""What a recording holds, without putting it on a grid: kind, channels, counts, time span."""

from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
import sqlite3
from tempfile import TemporaryDirectory

from rosbags.rosbag2 import WriterError

from wrist_ft_comp.calibration.chamber import OUTPUT_UNIT
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.files import bag as bag_recording
from wrist_ft_comp.files import csv_file as csv_recording
from wrist_ft_comp.files.bag import Bag, open_bag, SUFFIXES, Topics
from wrist_ft_comp.files.chamber_table import is_chamber_table, read_chamber_table
from wrist_ft_comp.files.csv_file import CsvText, sound_chunks
from wrist_ft_comp.files.model_file import FORMAT
from wrist_ft_comp.files.rewriting import Correction, rewrite_bag, rewrite_csv, rewrite_table
from wrist_ft_comp.model.batch_grid import GridBuilder
from wrist_ft_comp.model.signals import AXES, axis_unit, Recording, Samples

#: By this a page is known again.
GENERATOR = 'wrist_ft_comp report'


_BEGINNING = 4096


def looks_like_model(path: Path) -> bool:
    """
    Tell whether a file names the format of models near its beginning.

    Parameters
    ----------
    path : Path
        Whatever was named; it need not exist.

    Returns
    -------
    bool
        Also True for models of versions that this package does not read.

    """
    return FORMAT.encode() in _beginning(path)


def looks_like_report(path: Path) -> bool:
    """
    Tell whether a file is a page that this package wrote.

    Parameters
    ----------
    path : Path
        Whatever was named; it need not exist.

    Returns
    -------
    bool
        True for reports of calibrations and of evaluations.

    """
    return GENERATOR.encode() in _beginning(path)


def _beginning(path: Path) -> bytes:
    """Read the beginning of a file; of what is none, nothing."""
    try:
        with path.open('rb') as file:
            return file.read(_BEGINNING)
    except (OSError, ValueError):
        return b''


def looks_like_recording(path: Path) -> bool:
    """
    Tell whether a file is named like a recording, or is a chamber table.

    Parameters
    ----------
    path : Path
        Whatever was named; it need not exist.

    Returns
    -------
    bool
        False for models.

    """
    try:
        named_so = path.is_dir() or path.suffix in {*SUFFIXES, '.csv'}
    except (OSError, ValueError):
        return False
    return (named_so or is_chamber_table(path)) and not looks_like_model(path)


def is_worth_keeping(path: Path) -> bool:
    """
    Tell whether a file holds something that a model must not overwrite.

    Parameters
    ----------
    path : Path
        Where a model is to go.

    Returns
    -------
    bool
        False when there is nothing, an empty file, or another model.

    """
    try:
        return path.is_file() and path.stat().st_size > 0 and not looks_like_model(path)
    except (OSError, ValueError):
        return False


BAG, CSV, TABLE = 'rosbag2', 'CSV recording', 'chamber table'


def kind_of(path: Path) -> str:
    """
    Tell what kind of recording a path is, from its name and its first line.

    Parameters
    ----------
    path : Path
        File or folder.

    Returns
    -------
    str
        BAG, CSV or TABLE; CSV also for files that turn out to be nothing of the kind.

    Raises
    ------
    RecordingError
        When there is no such file, or its kind is known not to be readable.

    """
    if not path.exists():
        raise RecordingError(
            f'{path} does not exist; expected a bag folder, an .mcap, .db3 or CSV file.'
        )
    if path.is_dir() or path.suffix in SUFFIXES:
        return BAG
    if path.suffix in {'.bag', '.zstd', '.zst'}:
        raise RecordingError(
            f'{path.name} cannot be read alone. Of a compressed bag, name the folder; convert a '
            "ROS 1 bag with 'rosbags-convert'."
        )
    return TABLE if is_chamber_table(path) else CSV


Progress = Callable[[float], None]


def read_recording(  # noqa: PLR0913 - settings by keyword, each with its default
    path: Path | str,
    *,
    period_s: float = 1.0,
    topics: Topics | None = None,
    max_bad_share: float = 0.01,
    keep_copied_columns: bool = False,
    progress: Progress | None = None,
) -> Recording:
    """
    Read a recording of any kind onto the thermal grid, in memory independent of its length.

    Parameters
    ----------
    path : Path or str
        The file or folder.
    period_s : float
        Length of a thermal cell, s.
    topics : Topics, optional
        Where a bag holds what; the node's own names by default.
    max_bad_share : float
        Largest share of unusable samples per channel, 0 to 1.
    keep_copied_columns : bool
        As in read_chamber_table.
    progress : callable, optional
        Given the fraction done, 0 to 1.

    Returns
    -------
    Recording
        Its warnings say what was left out.

    Raises
    ------
    RecordingError
        When it cannot be read, or does not hold what a recording must.

    """
    path = Path(path)
    kind = kind_of(path)
    builder = GridBuilder(path.name, period_s, max_bad_share)
    warnings: list[str] = []
    with ExitStack() as stack:
        if kind == BAG:
            bag = stack.enter_context(open_bag(path))
            warnings.extend(bag.warnings)
            blocks = bag_recording.read_blocks(bag, topics or Topics(), progress)
        elif kind == CSV:
            text = CsvText(path)
            warnings = text.warnings
            blocks = csv_recording.read_blocks(text, progress)
        else:
            table = read_chamber_table(path, keep_copied_columns=keep_copied_columns)
            warnings.extend(f'{reason} It was left out.' for _, reason in table.left_out)
            blocks = iter(table.samples())
        for block in blocks:
            builder.add(block)
    recording = builder.build()
    unit = OUTPUT_UNIT if kind == TABLE else ''
    return replace(recording, warnings=(*recording.warnings, *warnings), unit=unit)


def rewrite_recording(  # noqa: PLR0913 - as read_recording
    source: Path | str,
    target: Path | str,
    correct: Correction,
    *,
    topics: Topics | None = None,
    output_topic: str = '/wrench',
    progress: Progress | None = None,
) -> tuple[str, ...]:
    """
    Copy a recording with its wrench corrected, into the same kind of file.

    A CSV recording and a chamber table get their wrench columns replaced; a bag gets the
    corrected wrench on a topic of its own. A failure leaves nothing behind.

    Parameters
    ----------
    source, target : Path or str
        The target must not exist. For a bag it is a folder, or, with the suffix of the source's
        storage, one file.
    correct : callable
        Given stamps_ns (n,) and raw wrenches (n, 6), N and N m, NaN for absent axes, in
        consecutive pieces; returns corrected wrenches (n, 6).
    topics : Topics, optional
        Where a bag holds the raw wrench.
    output_topic : str
        Where a bag gets the corrected one.
    progress : callable, optional
        Given the fraction done, 0 to 1.

    Returns
    -------
    tuple of str
        What was left out, in sentences.

    Raises
    ------
    RecordingError
        When the source cannot be read or the target cannot be made.

    """
    source, target = Path(source), Path(target)
    kind = kind_of(source)
    _check_target(source, target)
    try:
        with TemporaryDirectory(prefix=f'.{target.name}.', dir=target.parent) as folder:
            made = Path(folder) / target.name
            if kind == BAG:
                with open_bag(source) as bag:
                    settings = topics or Topics(), output_topic, progress
                    made, warnings = _copy_bag(
                        bag, made, lambda b, folder: rewrite_bag(b, folder, correct, *settings)
                    )
            elif kind == CSV:
                warnings = rewrite_csv(source, made, correct, progress)
            else:
                warnings = rewrite_table(source, made, correct)
            _check_target(source, target)
            made.rename(target)
    except (OSError, WriterError, sqlite3.Error) as error:
        reason = getattr(error, 'strerror', None) or error
        raise RecordingError(f'{target} cannot be written: {reason}.') from error
    return warnings


def _check_target(source: Path, target: Path) -> None:
    """Refuse a target that would overwrite or cannot be made."""
    if target.resolve() == source.resolve():
        raise RecordingError(f'{target} is the source itself; name another target.')
    if target.exists() or target.is_symlink():
        raise RecordingError(f'{target} exists already; name a new file or remove it first.')
    if not target.parent.is_dir():
        raise RecordingError(f'{target.parent} is no folder; make it first.')


def _copy_bag(
    bag: Bag, made: Path, copy: Callable[[Bag, Path], tuple[str, ...]]
) -> tuple[Path, tuple[str, ...]]:
    """Make the folder or, where the target is named like one, the bare storage file."""
    if made.suffix not in SUFFIXES:
        return made, copy(bag, made)
    if SUFFIXES[made.suffix] != bag.storage:
        raise RecordingError(
            f'{made.name} names another storage than that of {bag.name}, {bag.storage}; name a '
            'folder, or a file with the suffix of that storage.'
        )
    folder = made.with_suffix('')
    warnings = copy(replace(bag, compression=''), folder)
    return folder / made.name, warnings


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
