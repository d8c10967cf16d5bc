"""
Recordings as CSV: read, and copied with the wrench corrected, row by row; and the node's own.

Stamps become integer nanoseconds exactly. An empty cell is no sample. A last line without a line
end may be cut off; where it is incomplete, it is left out.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
import csv
from dataclasses import dataclass
from decimal import Decimal
import errno
from functools import partial
from io import TextIOWrapper
from itertools import islice
from math import isnan, nan
import os
from pathlib import Path
import re
import shlex
from typing import Any
from urllib.parse import parse_qs, urlencode

import numpy as np

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recordings.columns import (
    channels_in,
    COMPENSATED,
    in_channel_unit,
    ORIGIN,
    require_column,
    samples_of,
    stamp_column,
    STAMP_NANOSEC,
    STAMPS,
    unknown_columns,
)
from wrist_ft_comp.recordings.csv_header import (
    cells_of,
    delimiter_of,
    find_header,
    is_comment,
    is_number,
    LONGEST_LINE,
)
from wrist_ft_comp.recordings.foreign_log import LogMap, MAP_FILE, time_unit, unclear_units
from wrist_ft_comp.signals import (
    AXES,
    BoolArray,
    Correction,
    FloatArray,
    IntArray,
    NANOSECONDS,
    Progress,
    Samples,
    SensorNames,
)
from wrist_ft_comp.stored.own_file import writing

#: Rows in memory at once.
ROWS = 10_000
#: Turns a table of a chamber test into a recording.
_CONVERTER = 'examples/paper/chamber_table.py'
#: What to do about a line that is broken.
_REPAIR = 'Repair or remove the line.'
#: What to do about a stamp that is no number.
_TIME_FORMS = (
    'If every line has such a time, say what it is: --time iso, or a form such as --time '
    '"%d.%m.%Y %H:%M:%S"; the date and the time of day must stand in one column. If not, repair '
    'or remove the line.'
)


def origin_column(sensor: SensorNames) -> str:
    """Name the column that says what the sensor is called."""
    return ORIGIN + urlencode(sensor, doseq=True, safe='/:[]')


def sensor_in(columns: Sequence[str]) -> SensorNames:
    """Read what the sensor is called from the names of columns."""
    return parse_qs(''.join(c.removeprefix(ORIGIN) for c in columns if c.startswith(ORIGIN)))


def nanoseconds(text: str, unit_ns: int | Decimal = NANOSECONDS) -> int:
    """Convert a decimal number of seconds, or of another unit, to nanoseconds exactly."""
    return round(Decimal(text) * unit_ns)


@dataclass(frozen=True, eq=False)
class CsvPiece:
    """Consecutive rows: every column's cells, verbatim, and what the known channels say."""

    cells: list[tuple[str, ...]]
    stamps_ns: IntArray
    #: By channel, shape (n,): NaN where the cell is empty, and whether it is filled.
    values: dict[str, FloatArray]
    filled: dict[str, BoolArray]


class CsvRecording:
    """
    A CSV file with a header, read by ``pieces``; ``names`` says how a foreign log is read.

    Lines that begin with a sign of comments are skipped, unless one is the header; where a
    semicolon or a tab separates cells, a comma in a number is a decimal point.
    """

    def __init__(self, path: Path, names: LogMap | None = None) -> None:
        names = names or LogMap()
        self.path = path
        #: What was left out; complete when the pieces are through.
        self.warnings: list[str] = []
        #: A last line without line end.
        self._cut = ''
        #: The line of the header, verbatim, and how many lines stand above it.
        self.header, self._above = '', 0
        cells, *rows = self._first_rows()
        self.delimiter = delimiter_of(self.header)
        if not any(cells):
            raise RecordingError(
                f'{path.name} is empty; expected a header such as '
                'stamp_s,force_z,temperature_c and rows below it.'
            )
        #: As this package calls them; the file may call them otherwise.
        self.columns = tuple(names.names.get(cell, cell) for cell in cells)
        _refuse_chamber_table(path, self.columns)
        line = f'Line {self._above + 1} of {path.name}'
        if all(is_number(column) for column in self.columns if column):
            raise RecordingError(
                f'{line} must be a header naming the columns, such as '
                f'stamp_s,force_z,temperature_c; got {self.header.strip()[:60]!r}.'
            )
        others = [row for row in rows if len(row) != len(cells)]
        if 2 * len(others) > len(rows) and not {*STAMPS} & {*self.columns}:
            raise RecordingError(
                f'{line} ({self.header.strip()[:60]!r}) is no header of the lines below it, which '
                'have other numbers of cells. Put # before every line above the header.'
            )
        if absent := names.names.keys() - {*cells}:
            raise RecordingError(_absent(path.name, min(absent), cells, names))
        #: The column of every channel.
        self.channels = channels_in(path.name, self.columns)
        self._stamp = stamp_column(path.name, self.columns, whole_times=bool(names.stamp))
        unit_ns = STAMPS[self._stamp] * Decimal(repr(names.factors.get(self._stamp, 1.0)))
        self._factors, self._comma = names.factors, self.delimiter != ','
        #: Whether a number with a decimal comma was read.
        self._has_commas = False
        #: How a person may name another unit of the stamps.
        self._unit_remedy = 'Say --time {}.'
        if self._stamp in cells:
            self._unit_remedy = 'Name the column stamp_{}.'
        elif names.is_beside:
            self._unit_remedy = f'Write time: {{}} into {MAP_FILE}.'
        #: How the columns that are used are converted, and what they are expected to hold.
        self._expected: dict[str, tuple[Callable[[str], float], str]] = {
            self._stamp: (
                partial(nanoseconds, unit_ns=unit_ns) if unit_ns > 1 else int,
                f'a {"decimal" if unit_ns > 1 else "whole"} number',
            ),
            **dict.fromkeys(
                self.channels.values(), (self._number, 'a number with a decimal point')
            ),
        }
        if STAMP_NANOSEC in self.columns:
            # A table with gaps writes whole numbers as 123.0.
            self._expected[STAMP_NANOSEC] = partial(nanoseconds, unit_ns=1), 'nanoseconds'
        if names.stamp:
            self._expected[self._stamp] = names.stamp, 'a time as --time says'
        elif unit_ns > 1 and self._comma:
            _, expected = self._expected[self._stamp]
            self._expected[self._stamp] = partial(_with_comma, unit_ns), expected
        self.warnings += unknown_columns(path.name, self.columns)
        self.warnings += unclear_units(path.name, names.unclear)

    def _first_rows(self) -> list[list[str]]:
        """Read the header, which may be a line without line end, and the first rows below it."""
        with self._open() as text:
            header, self._above, rows = find_header(self._lines(text))
            self.header = (header or self._cut).rstrip('\n')
            return cells_of([self.header, *rows])

    def pieces(self, progress: Progress | None = None) -> Iterator[CsvPiece]:
        """Read ROWS rows at a time; RecordingError, naming the line, where one is bad."""
        width, is_empty = len(self.columns), True
        with self._open() as text:
            size = os.fstat(text.fileno()).st_size
            reader = self._rows(self._below_header(text))
            while rows := list(islice(reader, ROWS)):
                if set(map(len, rows)) != {width}:
                    rows = [row for row in rows if not _is_blank(row)]
                if rows:
                    is_empty = False
                    yield self._converted(rows)
                if progress:
                    progress(os.lseek(text.fileno(), 0, os.SEEK_CUR) / size)
            if self._cut and (last := self._last(reader.line_num + self._above + 2)):
                is_empty = False
                yield last
        if is_empty:
            raise RecordingError(
                f'{self.path.name} holds a header and no complete row; nothing was recorded.'
            )

    def cell(self, column: str, value: float) -> str:
        """Write a number as the column has them: its unit, and its decimal comma."""
        text = repr(value / self._factors.get(column, 1.0))
        return text.replace('.', ',') if self._has_commas else text

    def samples(self, progress: Progress | None = None) -> Iterator[Samples]:
        """Read as pieces do; a group that some rows fill in part comes channel by channel."""
        for piece in self.pieces(progress):
            yield from samples_of(piece.stamps_ns, piece.values, piece.filled)

    @contextmanager
    def _open(self) -> Iterator[TextIOWrapper]:
        """Open the file to be read as text; a byte order mark at its start is skipped."""
        try:
            with self.path.open(encoding='utf-8-sig') as text:
                yield text
        except UnicodeDecodeError as error:
            raise RecordingError(
                f'{self.path.name} is no UTF-8 text (byte {error.object[error.start]:#04x}); '
                'expected a CSV recording. Save it as UTF-8.'
            ) from error
        except OSError as error:
            raise RecordingError(f'{self.path} cannot be read: {error.strerror}.') from error
        except csv.Error as error:
            raise RecordingError(f'{self.path.name} is no CSV recording: {error}.') from error

    def _lines(self, text: TextIOWrapper) -> Iterator[str]:
        """Read whole lines; a last one without line end is only noted."""
        self._cut = ''
        while line := text.readline(LONGEST_LINE):
            if len(line) == LONGEST_LINE:
                raise RecordingError(
                    f'{self.path.name} has a line of more than {LONGEST_LINE} characters; '
                    'expected a CSV recording, a row on each line.'
                )
            if not line.endswith('\n'):
                self._cut = line
                return
            yield line

    def _below_header(self, text: TextIOWrapper) -> Iterator[str]:
        """Read the lines below the header; a comment is an empty line."""
        lines = islice(self._lines(text), self._above + 1, None)
        return ('\n' if is_comment(line) else line for line in lines)

    def _rows(self, lines: Iterable[str]) -> Any:
        return csv.reader(lines, delimiter=self.delimiter, skipinitialspace=self.delimiter == ' ')

    def _converted(self, rows: list[list[str]]) -> CsvPiece:
        """Convert rows, none of which is blank."""
        try:
            cells = list(zip(*rows, strict=True))
            if len(cells) != len(self.columns):
                raise self._refusal()
            convert, _ = self._expected[self._stamp]
            stamps = cells[self.columns.index(self._stamp)]
            stamps_ns = np.fromiter(map(convert, stamps), np.int64, len(stamps))
            if STAMP_NANOSEC in self.columns:
                more = cells[self.columns.index(STAMP_NANOSEC)]
                convert, _ = self._expected[STAMP_NANOSEC]
                stamps_ns += np.fromiter(map(convert, more), np.int64, len(more))
            values, filled = {}, {}
            for channel, column in self.channels.items():
                cut = cells[self.columns.index(column)]
                numbers, filled[channel] = _numbers(cut, self._number)
                numbers = numbers * self._factors.get(column, 1.0)
                values[channel] = in_channel_unit(column, numbers)
        except (ValueError, ArithmeticError) as error:
            raise self._refusal() from error
        return CsvPiece(cells, stamps_ns, values, filled)

    def _number(self, cell: str) -> float:
        """Convert a cell; an empty one is NaN."""
        text = cell.replace(',', '.') if self._comma else cell
        self._has_commas |= text != cell
        return float(text) if text.strip() else nan

    def _refusal(self) -> RecordingError:
        """Read again up to the first bad row; say where it is and what is wrong with it."""
        with self._open() as text:
            reader = self._rows(self._below_header(text))
            problem = next(filter(None, map(self._problem, reader)), ' changed while it was read.')
            where = f'Line {reader.line_num + self._above + 1} of {self.path.name}'
        return RecordingError(f'{where}{problem}')

    def _problem(self, row: list[str]) -> str:
        """Say what is wrong with a row, if anything; a blank line is none."""
        if _is_blank(row):
            return ''
        if len(row) != len(self.columns):
            return (
                f' has {len(row)} cells; the header names {len(self.columns)} columns. {_REPAIR}'
            )
        for column, (convert, expected) in self._expected.items():
            cell = row[self.columns.index(column)]
            try:
                np.array(convert(cell), np.int64 if column == self._stamp else float)
            except (ValueError, ArithmeticError):
                remedy = _REPAIR
                if column == self._stamp and expected.endswith('number'):
                    unit = time_unit(cell)
                    if unit and STAMPS[f'stamp_{unit}'] < STAMPS[column]:
                        return (
                            f', column {column}: {cell!r} is too large for '
                            f'{column.removeprefix("stamp_")}. {self._unit_remedy.format(unit)}'
                        )
                    remedy = _TIME_FORMS
                return f', column {column}: expected {expected}, got {cell[:60]!r}. {remedy}'
        return ''

    def _last(self, line: int) -> CsvPiece | None:
        """Convert a last line without line end; None where it is what a power failure left."""
        # Zeros are what a power failure may leave; before Python 3.11, csv refuses them.
        (row,) = self._rows([self._cut.replace('\0', '?')])
        where = f'Line {line} of {self.path.name}'
        if _is_blank(row):
            return None
        if self._problem(row):
            self.warnings.append(f'{where} is cut off in its middle; it was left out.')
            return None
        self.warnings.append(
            f'{where} has no line end; if it was cut off, its last value ({self.columns[-1]} = '
            f'{row[-1]!r}) is incomplete.'
        )
        return self._converted([row])


def _is_blank(row: Sequence[str]) -> bool:
    return len(row) < 2 and not ''.join(row).strip()


def _refuse_chamber_table(path: Path, columns: Sequence[str]) -> None:
    """Refuse a table of loads by temperatures, and say how a recording is made of it."""
    header = ','.join(columns)
    if re.search(r'\bload_\w+', header) and re.search(r'\boutput_at_[^,]+_c\b', header):
        words = 'python', _CONVERTER, str(path), '-o', f'{path.stem}_recording.csv'
        raise RecordingError(
            f'{path.name} is a table of a chamber test, which has no times. Make a recording of '
            f'it: {shlex.join(words)}'
        )


def _absent(name: str, column: str, cells: Sequence[str], names: LogMap) -> str:
    """Say that a map names a column that is not there, where that map stands, and what to do."""
    source, remedy = '--columns', 'Write it as the header does.'
    if names.is_beside:
        source = f'{MAP_FILE} beside it'
        remedy = (
            'Move one of them into another folder, or say by --columns what the columns of '
            f'{name} are.'
        )
    return (
        f'{name} has no column {column!r}, which {source} names; it has {", ".join(cells[:30])}. '
        f'{remedy}'
    )


def _with_comma(unit_ns: Decimal, text: str) -> int:
    return nanoseconds(text.replace(',', '.'), unit_ns)


def _numbers(cells: Sequence[str], number: Callable[[str], float]) -> tuple[FloatArray, BoolArray]:
    """Convert a channel's cells, and mark those that are filled."""
    count = len(cells)
    try:
        return np.fromiter(map(float, cells), float, count), np.ones(count, bool)
    except ValueError:  # a cell is empty, has a decimal comma, or worse
        filled = np.fromiter((bool(cell.strip()) for cell in cells), bool, count)
    return np.fromiter(map(number, cells), float, count), filled


def rewrite_csv(  # noqa: PLR0913, PLR0917 -- as rewrite_recording
    source: Path,
    target: Path,
    correct: Correction,
    external: Correction | None = None,
    progress: Progress | None = None,
    names: LogMap | None = None,
) -> tuple[str, ...]:
    """
    Copy a recording, its wrench corrected and all else verbatim; says what was left out.

    An empty column says that it is compensated. What ``external`` makes of the raw wrench comes in
    columns of its own.
    """
    recording = CsvRecording(source, names)
    columns = recording.columns
    require_column(source.name, columns, 'raw wrench', AXES)
    added = [f'external_{axis}' for axis in AXES if external and axis in columns]
    if twice := set(added) & set(columns):
        raise RecordingError(f'{source.name} holds {min(twice)} already; remove that column.')
    with target.open('x', encoding='utf-8', newline='') as file:
        file.write(f'{recording.delimiter.join((recording.header, COMPENSATED, *added))}\n')
        writer = csv.writer(file, delimiter=recording.delimiter, lineterminator='\n')
        for piece in recording.pieces(progress):
            cells: dict[str, Sequence[str]] = dict(zip(columns, piece.cells, strict=True))
            cells.update(_corrected(piece, correct, recording))
            more = [[''] * len(piece.stamps_ns)]
            if external:
                made = _corrected(piece, external, recording).values()
                more += [['' if cell == 'nan' else cell for cell in column] for column in made]
            writer.writerows(zip(*(cells[column] for column in columns), *more, strict=True))
    return tuple(recording.warnings)


def _corrected(
    piece: CsvPiece, correct: Correction, recording: CsvRecording
) -> dict[str, list[str]]:
    """Correct the wrench of the rows that have one; cells by channel, the empty ones empty."""
    absent = np.full(len(piece.stamps_ns), np.nan)
    wrench = np.stack([piece.values.get(axis, absent) for axis in AXES], 1)
    present = [axis for axis in AXES if axis in piece.values]
    rows = np.any([piece.filled[axis] for axis in present], axis=0)
    if rows.any():
        wrench[rows] = correct(piece.stamps_ns[rows], wrench[rows])
    return {
        axis: [
            recording.cell(axis, value) if filled else ''
            for value, filled in zip(*columns, strict=True)
        ]
        for axis in present
        for columns in [(wrench[:, AXES.index(axis)].tolist(), piece.filled[axis].tolist())]
    }


class CsvRecordingWriter:
    """Writes a CSV recording of channels, which survives a crash; RecordingError if it cannot."""

    #: Column of the stamps.
    stamp = 'stamp_ns'

    def __init__(self, path: Path, channels: Sequence[str], *, go_on: bool = False) -> None:
        self._path, self._width = path, len(channels)
        with writing(self._path):
            self._file = path.open('a' if go_on else 'x', encoding='utf-8', newline='')
        self._rows = csv.writer(self._file, lineterminator='\n')
        if go_on:
            return
        try:
            self._write((self.stamp, *channels))
        except RecordingError:
            with suppress(OSError):
                self._file.close()
            raise

    def append(self, stamp_ns: int, values: Sequence[float]) -> None:
        """Write a row, ns and a value per channel, to the operating system; NaN is no sample."""
        filled = *values, *[nan] * (self._width - len(values))
        self._write(self._cells(stamp_ns, filled))

    def _cells(self, stamp_ns: int, values: Sequence[float]) -> tuple[object, ...]:
        return (int(stamp_ns), *('' if isnan(value) else float(value) for value in values))

    def sync(self) -> None:
        """Wait until the disk holds everything, so that a power failure takes nothing of it."""
        with writing(self._path):
            os.fsync(self._file.fileno())
            self._require_name()

    def close(self) -> None:
        """Sync and close; a second call does nothing."""
        if self._file.closed:
            return
        try:
            self.sync()
        finally:
            with writing(self._path):
                self._file.close()

    def _write(self, row: Sequence[object]) -> None:
        """Write a row through to the operating system."""
        with writing(self._path):
            self._rows.writerow(row)
            self._file.flush()
            self._require_name()

    def _require_name(self) -> None:
        """Refuse to go on with a file that was deleted; nobody would find what is written."""
        if not os.fstat(self._file.fileno()).st_nlink:
            raise FileNotFoundError(errno.ENOENT, 'it was deleted in the meantime')
