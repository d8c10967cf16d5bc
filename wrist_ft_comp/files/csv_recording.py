"""
CSV recordings as samples, read chunk by chunk.

Empty cells mean that a channel has no sample at that stamp; ``nan`` and ``inf`` are samples that
are not finite. Stamps become integer nanoseconds without passing through a float.
"""

from collections.abc import Callable, Iterator, Sequence
from decimal import Decimal

import numpy as np

from wrist_ft_comp import RecordingError
from wrist_ft_comp.core.recording import (
    AXES,
    BoolArray,
    FloatArray,
    IntArray,
    NANOSECONDS,
    Samples,
)
from wrist_ft_comp.files.csv_text import CsvChunk, CsvLayout, CsvText
from wrist_ft_comp.files.csv_writer import CsvRecordingWriter

__all__ = ['CsvRecordingWriter', 'numbers', 'read_blocks', 'samples', 'sound_chunks', 'stamps_ns']


def _nanoseconds(text: str) -> int:
    """Convert decimal seconds to nanoseconds exactly."""
    whole, _, fraction = text.partition('.')
    if len(fraction) <= 9 and (fraction or whole.strip()[-1:]).isdigit():
        try:
            return int(whole + fraction.ljust(9, '0'))
        except ValueError:  # an exponent, or no number at all
            pass
    return int((Decimal(text) * NANOSECONDS).to_integral_value())


#: How a stamp column is converted, and what it is expected to hold.
_STAMPS: dict[str, tuple[Callable[[str], int], str]] = {
    'stamp_ns': (int, 'a whole number of nanoseconds'),
    'stamp_s': (_nanoseconds, 'a decimal number of seconds'),
}


def _refusal(
    where: str, lines: Sequence[int], cells: Sequence[str], convert: Callable[[str], object]
) -> RecordingError:
    """Find the first cell that does not convert, and say where it is."""

    def converts(cell: str) -> bool:
        try:
            convert(cell)
        except (ValueError, ArithmeticError):
            return False
        return True

    line, cell = next(
        (line, cell) for line, cell in zip(lines, cells, strict=True) if not converts(cell)
    )
    return RecordingError(f'Line {line} of {where}, got {cell[:60]!r}. Repair or remove the line.')


def stamps_ns(layout: CsvLayout, chunk: CsvChunk) -> IntArray:
    """
    Convert a chunk's stamps.

    Parameters
    ----------
    layout : CsvLayout
        What the file's header says.
    chunk : CsvChunk
        Rows of that file.

    Returns
    -------
    ndarray of int64, shape (n,)
        Stamps, ns, exact.

    Raises
    ------
    RecordingError
        Naming the line when a stamp is no time.

    """
    cells = chunk.columns[layout.columns.index(layout.stamp)]
    convert, expected = _STAMPS[layout.stamp]
    try:
        return np.fromiter(map(convert, cells), np.int64, len(cells))
    except (ValueError, ArithmeticError):
        where = f'{layout.name}, column {layout.stamp}: expected {expected}'
        error = _refusal(where, chunk.lines, cells, lambda cell: np.int64(convert(cell)))
    raise error


def numbers(layout: CsvLayout, chunk: CsvChunk, channel: str) -> tuple[FloatArray, BoolArray]:
    """
    Convert one channel of a chunk.

    Parameters
    ----------
    layout : CsvLayout
        What the file's header says.
    chunk : CsvChunk
        Rows of that file.
    channel : str
        Column name.

    Returns
    -------
    values : ndarray, shape (n,)
        NaN where the cell is empty.
    filled : ndarray of bool, shape (n,)
        Whether there is anything in the cell.

    Raises
    ------
    RecordingError
        Naming the line when a cell is neither empty nor a number.

    """
    cells = chunk.columns[layout.columns.index(channel)]
    try:
        return np.fromiter(map(float, cells), float, len(cells)), np.ones(len(cells), bool)
    except ValueError:  # a cell is empty, or worse
        stripped = list(map(str.strip, cells))
    filled = np.fromiter(map(bool, stripped), bool, len(cells))
    where = np.flatnonzero(filled)
    values = np.full(len(cells), np.nan)
    try:
        values[where] = [float(stripped[row]) for row in where]
    except ValueError:
        found = _refusal(
            f'{layout.name}, column {channel}: expected a number with a decimal point',
            [chunk.lines[row] for row in where],
            [stripped[row] for row in where],
            float,
        )
    else:
        return values, filled
    raise found


def samples(layout: CsvLayout, chunk: CsvChunk) -> list[Samples]:
    """
    Convert a chunk's known channels.

    Parameters
    ----------
    layout : CsvLayout
        What the file's header says.
    chunk : CsvChunk
        Rows of that file.

    Returns
    -------
    list of Samples
        One block per group of channels, without the rows in which the group is empty; one per
        channel where rows fill only a part of the group.

    Raises
    ------
    RecordingError
        As stamps_ns and numbers.

    """
    times = stamps_ns(layout, chunk)
    blocks = []
    for group in layout.groups:
        columns = [numbers(layout, chunk, channel) for channel in group]
        values = np.stack([column for column, _ in columns])
        filled = np.stack([here for _, here in columns])
        if (filled == filled[0]).all():
            blocks.append(_filled(group, times, values, filled[0]))
        else:
            blocks.extend(
                _filled((channel,), times, values[[row]], filled[row])
                for row, channel in enumerate(group)
            )
    return blocks


def _filled(
    channels: tuple[str, ...], times: IntArray, values: FloatArray, filled: BoolArray
) -> Samples:
    """Make a block of the filled rows; values come with shape (C, n)."""
    if not filled.all():
        times, values = times[filled], values[:, filled]
    return Samples(channels, times, np.ascontiguousarray(values.T))


def sound_chunks(
    text: CsvText, progress: Callable[[float], None] | None = None
) -> Iterator[tuple[CsvChunk, list[Samples]]]:
    """
    Read chunks with their samples; a last line that was cut off is left out with a warning.

    Parameters
    ----------
    text : CsvText
        The recording; its warnings grow.
    progress : callable, optional
        Given the fraction read so far, 0 to 1.

    Yields
    ------
    tuple of CsvChunk and list of Samples
        As CsvText.chunks and samples.

    Raises
    ------
    RecordingError
        As CsvText.chunks and samples.

    """
    for chunk in text.chunks(progress):
        try:
            found = samples(text.layout, chunk)
        except RecordingError:
            if chunk.ended:
                raise
            text.warn_of_cut(chunk.lines[0])
            continue
        if not chunk.ended:
            text.warn_of_missing_end(chunk)
        yield chunk, found


def read_blocks(
    text: CsvText, progress: Callable[[float], None] | None = None
) -> Iterator[Samples]:
    """
    Read a recording that has a wrench and a temperature.

    Parameters
    ----------
    text : CsvText
        The recording; its warnings grow.
    progress : callable, optional
        Given the fraction read so far, 0 to 1.

    Yields
    ------
    Samples
        In order of the file.

    Raises
    ------
    RecordingError
        When the header names no wrench or no temperature, and as sound_chunks.

    """
    text.layout.require('raw wrench', AXES)
    text.layout.require('temperature', ('temperature_c',))
    for _, found in sound_chunks(text, progress):
        yield from found
