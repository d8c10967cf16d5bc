"""
The front door to recordings of every kind: read them onto the thermal grid, rewrite, describe.

A recording is a rosbag2 folder, a bare ``.mcap`` or ``.db3`` file, a CSV recording, or a table of
a static chamber test.
"""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
import sqlite3
from tempfile import TemporaryDirectory

from rosbags.rosbag2 import WriterError

from wrist_ft_comp import RecordingError
from wrist_ft_comp.core.chamber import OUTPUT_UNIT
from wrist_ft_comp.core.recording import Recording
from wrist_ft_comp.core.sampling import GridBuilder
from wrist_ft_comp.files import bag_recording, csv_recording
from wrist_ft_comp.files.bag_file import Bag, open_bag, SUFFIXES
from wrist_ft_comp.files.bag_recording import Topics
from wrist_ft_comp.files.chamber_table import read_chamber_table
from wrist_ft_comp.files.csv_text import CsvText
from wrist_ft_comp.files.kinds import BAG, CSV, kind_of, TABLE
from wrist_ft_comp.files.rewriting import Correction, rewrite_bag, rewrite_csv, rewrite_table
from wrist_ft_comp.files.summary import ChannelSummary, describe_recording, RecordingSummary

__all__ = [
    'ChannelSummary',
    'RecordingSummary',
    'Topics',
    'describe_recording',
    'read_recording',
    'rewrite_recording',
]

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
