"""The node's own recorder: CSV, row by row, each row handed to the operating system at once."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
import csv
from dataclasses import dataclass, replace
from decimal import Decimal
import difflib
import io
from math import isnan
import os
from pathlib import Path
import re
from types import TracebackType

import numpy as np

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.model.signals import (
    AXES,
    BoolArray,
    FloatArray,
    IntArray,
    NANOSECONDS,
    REFERENCE_CHANNELS,
    Samples,
)

STAMP_COLUMNS = ('stamp_ns', 'stamp_s')


_THERMOMETER = re.compile(r'temperature(_([2-9]|[1-9]\d+))?_c')


#: Characters per chunk, the bound of what is in memory: some 10 000 rows.
CHUNK = 1_000_000


@dataclass(frozen=True)
class CsvLayout:
    """
    What the header says.

    Attributes
    ----------
    name : str
        The file's name, for messages.
    columns : tuple of str
        All column names in order, without surrounding blanks.
    delimiter : str
        Comma, semicolon or tab.
    stamp : str
        ``stamp_ns`` or ``stamp_s``, whichever is there; the first where both are.
    groups : tuple of tuple of str
        Known channels that share their samples: raw wrench, each thermometer, reference.

    """

    name: str
    columns: tuple[str, ...]
    delimiter: str
    stamp: str
    groups: tuple[tuple[str, ...], ...]

    def require(self, kind: str, names: Sequence[str]) -> None:
        """Refuse when none of the named columns is there, suggesting one that looks like it."""
        if set(names) & set(self.columns):
            return
        near = [(c, difflib.get_close_matches(c.lower(), names, 1)) for c in self.columns]
        remedy = next((f'Is {c!r} meant to be {m[0]!r}? Rename it.' for c, m in near if m), '')
        raise RecordingError(
            f'{self.name} has no {kind} column; expected {" or ".join(names)}, got '
            f'{", ".join(self.columns)}. {remedy or "Rename or add the column."}'
        )


@dataclass(frozen=True)
class CsvChunk:
    """
    Some rows, as text.

    Attributes
    ----------
    lines : sequence of int
        Each row's line number in the file, counted from 1.
    columns : list of list of str
        The cells of each column, verbatim.
    ended : bool
        False for the last row of a file that ends without a line end: perhaps only the beginning
        of what was to be written.

    """

    lines: Sequence[int]
    columns: list[list[str]]
    ended: bool = True


def parse_header(name: str, line: str) -> CsvLayout:
    """
    Understand the first line.

    Parameters
    ----------
    name : str
        The file's name, for messages.
    line : str
        The line.

    Returns
    -------
    CsvLayout
        With at least a stamp.

    Raises
    ------
    RecordingError
        When it is no header, lacks a stamp, or names a known column twice.

    """
    delimiter = max(',;\t', key=line.count)
    columns = tuple(cell.strip() for cell in next(csv.reader([line.strip()], delimiter=delimiter)))
    if all(re.fullmatch(r'[-+.\deE]*', column) for column in columns):
        raise RecordingError(
            f'Line 1 of {name} must be a header naming the columns, such as '
            f'stamp_s,force_z,temperature_c; got {line.strip()[:60]!r}.'
        )
    thermometers = tuple((c,) for c in columns if _THERMOMETER.fullmatch(c))
    wrench, reference = (tuple(c for c in w if c in columns) for w in (AXES, REFERENCE_CHANNELS))
    groups = tuple(group for group in (wrench, *thermometers, reference) if group)
    for column in (*STAMP_COLUMNS, *(channel for group in groups for channel in group)):
        if columns.count(column) > 1:
            raise RecordingError(f'{name} has the column {column} twice; remove or rename one.')
    stamp = next((column for column in STAMP_COLUMNS if column in columns), '')
    layout = CsvLayout(name, columns, delimiter, stamp, groups)
    layout.require('stamp', STAMP_COLUMNS)
    return layout


def _mistyped(layout: CsvLayout) -> list[str]:
    """Warn of columns that are not used but named almost like ones that would be."""
    used = {layout.stamp, *(channel for group in layout.groups for channel in group)}
    known = {*AXES, *REFERENCE_CHANNELS, 'temperature_c', 'temperature_2_c'} - used
    near = {c: difflib.get_close_matches(c.lower(), known, 1, 0.85) for c in layout.columns}
    return [
        f'The column {column} of {layout.name} is not used; if it is {found[0]}, rename it.'
        for column, found in near.items()
        if found and column not in used
    ]


class CsvText:
    """
    One CSV recording, read in chunks of cells.

    Parameters
    ----------
    path : Path
        The file.

    Attributes
    ----------
    header : str
        The first line, verbatim.
    layout : CsvLayout
        What it says.
    warnings : list of str
        What was left out; complete when the chunks are through.

    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.warnings: list[str] = []
        with self._open() as text:
            first = self._lines(text, 1)
        if not first or not first[0].strip():
            raise RecordingError(
                f'{path.name} is empty; expected a header such as '
                'stamp_s,force_z,temperature_c and rows below it.'
            )
        self.header = first[0].rstrip('\n')
        try:
            self.layout = parse_header(path.name, self.header)
        except csv.Error as error:
            raise RecordingError(f'{path.name} is no CSV recording: {error}.') from error
        self.warnings += _mistyped(self.layout)

    def _open(self) -> io.TextIOWrapper:
        """Open the file as text; a byte order mark at its start is skipped."""
        try:
            return io.TextIOWrapper(self.path.open('rb'), encoding='utf-8-sig')
        except OSError as error:
            raise RecordingError(f'{self.path} cannot be read: {error.strerror}.') from error

    def _lines(self, text: io.TextIOWrapper, characters: int) -> list[str]:
        """Read whole lines of about as many characters."""
        try:
            return text.readlines(characters)
        except UnicodeDecodeError as error:
            raise RecordingError(
                f'{self.path.name} is no UTF-8 text (byte {error.object[error.start]:#04x}); '
                'expected a CSV recording. Save it as UTF-8.'
            ) from error
        except OSError as error:
            raise RecordingError(f'{self.path} cannot be read: {error.strerror}.') from error

    def chunks(self, progress: Callable[[float], None] | None = None) -> Iterator[CsvChunk]:
        """
        Read the rows as text, piece by piece.

        Parameters
        ----------
        progress : callable, optional
            Given the fraction read so far, 0 to 1.

        Yields
        ------
        CsvChunk
            A last line that was cut off is left out, and said in warnings.

        Raises
        ------
        RecordingError
            When a row has another number of cells than the header, or there is no row.

        """
        rows = 0
        with self._open() as text:
            size = os.fstat(text.fileno()).st_size
            self._lines(text, 1)
            line = 2
            while lines := self._lines(text, CHUNK):
                tail = '' if lines[-1].endswith('\n') else lines.pop()
                for chunk in (self._split(lines, line), self._last(tail, line + len(lines))):
                    if chunk.lines:
                        yield chunk
                    rows += len(chunk.lines)
                line += len(lines)
                if progress:
                    progress(os.lseek(text.fileno(), 0, os.SEEK_CUR) / size)
        if not rows:
            raise RecordingError(
                f'{self.path.name} holds a header and no complete row; nothing was recorded.'
            )

    def _split(self, lines: list[str], first: int) -> CsvChunk:
        """Cut lines into columns; blank lines are skipped."""
        delimiter, width = self.layout.delimiter, len(self.layout.columns)
        whole = ''.join(lines)
        numbers: Sequence[int] = range(first, first + len(lines))
        if '"' in whole:
            return self._split_quoted(lines, first)
        if any(count != width - 1 for count in {line.count(delimiter) for line in lines}):
            filled = [(n, line) for n, line in zip(numbers, lines, strict=True) if line.strip()]
            for number, line in filled:
                self._check_width(number, line.count(delimiter) + 1)
            numbers, lines = [n for n, _ in filled], [line for _, line in filled]
            whole = ''.join(lines)
        cells = whole.replace('\n', delimiter).split(delimiter)
        return CsvChunk(numbers, [cells[c : len(lines) * width : width] for c in range(width)])

    def _split_quoted(self, lines: list[str], first: int) -> CsvChunk:
        """Cut lines that hold quotes."""
        reader = csv.reader(lines, delimiter=self.layout.delimiter)
        numbers, rows = [], []
        try:
            for row in reader:
                if row:
                    numbers.append(first + reader.line_num - 1)
                    rows.append(row)
                    self._check_width(numbers[-1], len(row))
        except csv.Error as error:
            raise RecordingError(f'{self.path.name} is no CSV recording: {error}.') from error
        return CsvChunk(
            numbers, [[row[c] for row in rows] for c in range(len(self.layout.columns))]
        )

    def _check_width(self, line: int, cells: int) -> None:
        """Refuse a row that is longer or shorter than the header."""
        if cells != len(self.layout.columns):
            raise RecordingError(
                f'Line {line} of {self.path.name} has {cells} cells; the header names '
                f'{len(self.layout.columns)} columns. Repair or remove the line.'
            )

    def _last(self, tail: str, line: int) -> CsvChunk:
        """Split a last line without line end; too short, it is what a power failure left."""
        if not tail:
            return CsvChunk([], [])
        try:
            return replace(self._split([tail], line), ended=False)
        except RecordingError:
            self.warn_of_cut(line)
            return CsvChunk([], [])

    def warn_of_cut(self, line: int) -> None:
        """Note that the last line was left out."""
        self.warnings.append(
            f'Line {line} of {self.path.name} is cut off in its middle; it was left out.'
        )

    def warn_of_missing_end(self, chunk: CsvChunk) -> None:
        """Note that nobody can tell whether the last line is all of what was to be written."""
        self.warnings.append(
            f'Line {chunk.lines[0]} of {self.path.name} has no line end; if it was cut off, its '
            f'last value ({self.layout.columns[-1]} = {chunk.columns[-1][0]!r}) is incomplete.'
        )


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


class CsvRecordingWriter:
    """
    Writes a new CSV recording row by row; what was appended survives the end of the process.

    Parameters
    ----------
    path : Path
        The file to make; it must not exist yet.
    channels : sequence of str
        Column names behind ``stamp_ns``.

    """

    def __init__(self, path: Path, channels: Sequence[str]) -> None:
        self._path = path
        self._width = len(channels)
        try:
            self._file = path.open('xb')
        except FileExistsError as error:
            raise RecordingError(f'{path} exists already; name a new file.') from error
        except OSError as error:
            raise RecordingError(f'{path} cannot be written: {error.strerror}.') from error
        try:
            self._write(','.join(('stamp_ns', *channels)))
        except RecordingError:
            with suppress(OSError):
                self._file.close()
            raise

    def append(self, stamp_ns: int, values: Sequence[float]) -> None:
        """
        Write one row and hand it to the operating system.

        Parameters
        ----------
        stamp_ns : int
            Time of measurement, ns.
        values : sequence of float, length C
            In the order of the channels; NaN, no sample, becomes an empty cell.

        Raises
        ------
        RecordingError
            When the number of values is wrong, or the disk is full.

        """
        if len(values) != self._width:
            raise RecordingError(
                f'A row of {self._path.name} has {self._width} values; got {len(values)}.'
            )
        cells = ('' if isnan(value) else repr(float(value)) for value in values)
        self._write(','.join((str(int(stamp_ns)), *cells)))

    def _write(self, row: str) -> None:
        """Write a line through to the operating system."""
        try:
            self._file.write(f'{row}\n'.encode())
            self._file.flush()
        except OSError as error:
            raise RecordingError(f'{self._path} cannot be written: {error.strerror}.') from error

    def sync(self) -> None:
        """Wait until the disk holds everything, so that a power failure takes nothing of it."""
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            raise RecordingError(f'{self._path} cannot be written: {error.strerror}.') from error

    def close(self) -> None:
        """Sync and close; a second call does nothing."""
        if not self._file.closed:
            try:
                self.sync()
            finally:
                self._close()

    def _close(self) -> None:
        """Close the file; what it could not write by then is an error of ours."""
        try:
            self._file.close()
        except OSError as error:
            raise RecordingError(f'{self._path} cannot be written: {error.strerror}.') from error

    def __enter__(self) -> 'CsvRecordingWriter':
        """Return the writer itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close."""
        self.close()
