"""
CSV recordings as text: what the header says, and chunks of cells with their line numbers.

Columns: ``stamp_s`` (s) or ``stamp_ns``; any of ``force_x`` … ``torque_z``, ``temperature_c``,
``temperature_2_c`` …, ``reference_force_x`` …. Cells are empty where a channel has no sample.
"""

from collections.abc import Callable, Iterator, Sequence
import csv
from dataclasses import dataclass, replace
import difflib
import io
import os
from pathlib import Path
import re

from wrist_ft_comp import RecordingError
from wrist_ft_comp.core.recording import AXES, REFERENCE_CHANNELS

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
