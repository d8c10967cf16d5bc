"""
Tables read by pandas: CSV and its relatives in blocks, workbooks, parquet.

A block of rows that is as it should be is converted by pandas as a whole; any other one is gone
through row by row, which tells what is wrong in which line. A last line without a line end may be
cut off; where it is incomplete, it is left out.
"""

import bz2
from codecs import BOM_UTF16_BE, BOM_UTF16_LE, getincrementaldecoder
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import csv
from dataclasses import dataclass
import gzip
from io import StringIO, TextIOWrapper
from itertools import islice
import lzma
from math import nan
from pathlib import Path
from typing import Any, BinaryIO
import zlib

import numpy as np

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recordings.column_map import Column, Placed, STAMP
from wrist_ft_comp.recordings.stamps import exact_ns, StampReader
from wrist_ft_comp.recordings.table_header import (
    COMMENTS,
    cut_line,
    find_header,
    FIRST_LINES,
    MISSING,
    number_in,
)
from wrist_ft_comp.series import FloatArray, IntArray, Progress

#: Characters of the longest line that a table may have.
LONGEST_LINE = 1_000_000
#: Characters in memory at once.
BLOCK = 1_000_000
#: Rows of a workbook or a parquet file in memory at once.
_BATCH_ROWS = 20_000
#: Bytes that show how a text is encoded.
_START = 200_000
#: Rows of a table that show what its columns are: of its first block, and of each other one.
_SHOWN_ROWS, _SHOWN_LATER = 3000, 100
_PACKED = (b'\x1f\x8b', gzip), (b'BZh', bz2), (b'\xfd7zXZ', lzma)
#: What a cell cannot be converted with.
_BAD = ValueError, ArithmeticError, TypeError


@dataclass(frozen=True, eq=False)
class Rows:
    """Consecutive rows: stamps, and what the channels say, NaN where a cell is empty."""

    stamps_ns: IntArray
    #: By channel, in its unit, shape (n,).
    values: dict[str, FloatArray]


class Table:
    """A table in a file; ``names`` and ``units`` say what its columns are called."""

    def __init__(self, path: Path) -> None:
        self.path, self.name = path, path.name
        #: What was left out; complete when all rows were read.
        self.warnings: list[str] = []
        lines: list[str] = []
        for _, text, is_whole in self._texts():
            if '\0' in text and is_whole:
                raise RecordingError(
                    f'{self.name} is no text; expected a table as CSV, or a bag. If it is a '
                    'table, save it as CSV.'
                )
            lines += text.removesuffix('\n').split('\n')
            if len(lines) >= FIRST_LINES:
                break
        if not any(map(str.strip, lines)):
            raise RecordingError(
                f'{self.name} is empty; expected a header such as stamp_s,force_z,temperature_c '
                'and rows below it.'
            )
        self.header = find_header(lines[:FIRST_LINES])
        self.names, self.units = self.header.names, self.header.units

    @contextmanager
    def _open(self) -> Iterator[tuple[BinaryIO, Any]]:
        """Open the file: raw, which tells how much was read, and as text."""
        try:
            with self.path.open('rb') as raw:
                magic = raw.read(8)
                raw.seek(0)
                packed: Any = raw
                for sign, module in _PACKED:
                    packed = module.open(raw) if magic.startswith(sign) else packed
                start = packed.read(_START)
                packed.seek(0)
                encoding = 'utf-8-sig'
                if start.startswith((BOM_UTF16_LE, BOM_UTF16_BE)):
                    encoding = 'utf-16'
                else:
                    try:  # the last character may be cut
                        getincrementaldecoder('utf-8')().decode(start)
                    except UnicodeDecodeError:
                        encoding = 'cp1252'
                yield raw, TextIOWrapper(packed, encoding, errors='replace')
        except OSError as error:
            raise RecordingError(
                f'{self.path} cannot be read: {error.strerror or error}.'
            ) from error
        except (EOFError, lzma.LZMAError, zlib.error) as error:
            raise RecordingError(f'{self.path} cannot be unpacked: {error}.') from error

    def _texts(self, progress: Progress | None = None) -> Iterator[tuple[int, str, bool]]:
        """
        Read whole lines, about BLOCK characters at a time, and the number of the first of them.

        A last line without a line end comes alone, with False.
        """
        if self.path.suffix.lower() in _LIBRARIES:
            number = 1
            for text in _by_library(self.path):
                yield number, text, True
                number += text.count('\n')
            return
        with self._open() as (raw, file):
            size, number, rest = max(self.path.stat().st_size, 1), 1, ''
            while piece := file.read(BLOCK):
                rest += piece
                end = rest.rfind('\n') + 1
                if rest.count('"', 0, end) % 2:  # a cell in quotes goes on in the next line
                    end = rest.rfind('\n', 0, rest.rfind('"', 0, end)) + 1 or end
                text, rest = rest[:end], rest[end:]
                if len(rest) > LONGEST_LINE:
                    raise RecordingError(
                        f'{self.name} has a line of more than {LONGEST_LINE} characters; expected '
                        'a table, a row on each line.'
                    )
                if text:
                    yield number, text, True
                    number += text.count('\n')
                if progress:
                    progress(min(raw.tell() / size, 1.0))
            if rest:
                yield number, rest, False

    def _row_texts(self, progress: Progress | None = None) -> Iterator[tuple[int, str, bool]]:
        """Read as _texts does, without the lines above the first row."""
        for number, text, is_whole in self._texts(progress):
            above = max(self.header.lines_above + 1 - number, 0)
            if rest := text.split('\n', above)[-1] if is_whole or not above else '':
                yield number + above, rest, is_whole

    def shown_rows(self) -> list[list[str]]:
        """Read some rows from all over the table, as texts, each as wide as the names."""
        rows: list[list[str]] = []
        for _, text, is_whole in self._row_texts():
            lines = text.split('\n') if is_whole else []
            count = _SHOWN_LATER if rows else _SHOWN_ROWS
            for line in lines[:: max(len(lines) // count, 1)]:
                row = [] if line.startswith(COMMENTS) else cut_line(line, self.header.delimiter)
                if len(row) >= self.header.width and tuple(row) not in self.header.rows_above:
                    rows.append([*row, ''][: len(self.names)])
        return rows

    def rows(self, placed: Placed, progress: Progress | None = None) -> Iterator[Rows]:
        """Read the columns that are used; RecordingError, naming the line, where a row is bad."""
        reader, is_empty = _RowReader(self, placed), True
        for number, text, is_whole in self._row_texts(progress):
            rows = reader.read(text, number) if is_whole else self._last(reader, text, number)
            if rows and len(rows.stamps_ns):
                is_empty = False
                yield rows
        if is_empty:
            raise RecordingError(
                f'{self.name} holds a header and no complete row; nothing was recorded.'
            )

    def _last(self, reader: '_RowReader', text: str, number: int) -> Rows | None:
        """Convert a last line without line end; None where it is what a power failure left."""
        where = f'Line {number} of {self.name}'
        try:
            # Zeros are what a power failure may leave; before Python 3.11, csv refuses them.
            rows = reader.read_slowly(text.replace('\0', '?'), number)
        except RecordingError:
            self.warnings.append(f'{where} is cut off in its middle; it was left out.')
            return None
        if len(rows.stamps_ns):
            self.warnings.append(
                f'{where} has no line end; if it was cut off, its last value ({self.names[-1]} = '
                f'{cut_line(text, self.header.delimiter)[-1]!r}) is incomplete.'
            )
        return rows


class _RowReader:
    """Converts the rows of a table, block by block."""

    def __init__(self, table: Table, placed: Placed) -> None:
        self._name, self.header, self._most = table.name, table.header, len(table.names)
        self._values, self._stamp = placed.channels, placed.columns[STAMP]
        self._more = [column for column in placed.stamps if column != self._stamp]
        self._stamps = StampReader(self._stamp.unit, self._stamp.factor)

    def read(self, text: str, number: int) -> Rows:
        """Convert whole lines, of which the first has a number."""
        import pandas  # noqa: PLC0415 -- what reads no table does not wait for it

        sign, width, lines = self.header.delimiter, self.header.width, text.count('\n')
        cells = len(text.split()) if sign == ' ' else text.count(sign) + lines
        if cells != lines * width or not self._stamps.form:
            return self.read_slowly(text, number)
        kinds: dict[int, object] = {c.place: float for c in (*self._values, *self._more)}
        kinds[self._stamp.place] = np.int64 if self._stamps.form == 'ns' else str
        try:
            with np.errstate(invalid='raise'):  # what is no number becomes no integer
                frame = pandas.read_csv(
                    StringIO(text), sep=r'\s+' if sign == ' ' else sign, header=None,
                    names=range(width), usecols=[k for k in kinds if k < width], dtype=kinds,
                    na_values=[*MISSING], index_col=False, skipinitialspace=True,
                    float_precision='round_trip',
                    decimal=',' if sign != ',' and ',' in text else '.')  # fmt: skip
                if len(frame) != lines:
                    return self.read_slowly(text, number)
                more = [np.rint(frame[c.place].to_numpy()).astype(np.int64) for c in self._more]
                stamps_ns = sum(more, self._stamps.read(frame[self._stamp.place].to_numpy()))
        except (*_BAD, KeyError):
            return self.read_slowly(text, number)
        absent = np.full(lines, nan)
        return self._made(
            stamps_ns,
            [frame[c.place].to_numpy() if c.place < width else absent for c in self._values],
        )

    def read_slowly(self, text: str, number: int) -> Rows:
        """Convert lines row by row; RecordingError where one is bad."""
        sign, width = self.header.delimiter, self.header.width
        lines = [
            '' if line.startswith(COMMENTS) else line.strip() if sign == ' ' else line
            for line in text.split('\n')
        ]
        rows: list[tuple[int, list[str]]] = []
        reader = csv.reader(lines, delimiter=sign, skipinitialspace=True)
        try:
            for row in reader:
                cells = [cell.strip() for cell in row]
                if not any(cells) or tuple(cells) in self.header.rows_above:
                    continue
                line = number + reader.line_num - 1
                if not width <= len(cells) <= self._most and any(cells[width:] or ['x']):
                    raise RecordingError(
                        f'Line {line} of {self._name} has {len(cells)} cells; the others have '
                        f'{width}. Repair or remove the line.'
                    )
                rows.append((line, cells + [''] * (self._most - len(cells))))
        except csv.Error as error:
            raise RecordingError(f'{self._name} is no table: {error}.') from error
        stamps_ns = self._converted(self._stamp, self._stamps.read, rows)
        for column in self._more:
            stamps_ns += self._converted(column, lambda cells: exact_ns(cells, 'ns'), rows)
        values = [
            self._converted(c, lambda cells: [number_in(cell, sign) for cell in cells], rows)
            for c in self._values
        ]
        return self._made(stamps_ns, [np.array(column, dtype=float) for column in values])

    def _converted(
        self, column: Column, convert: Callable[[Any], Any], rows: list[tuple[int, list[str]]]
    ) -> Any:
        """Convert the cells of a column; RecordingError, with the line, where one is bad."""
        cells = [row[column.place] for _, row in rows]
        try:
            return convert(cells)
        except _BAD as error:
            line, cell = next(
                (line, cell)
                for (line, _), cell in zip(rows, cells, strict=True)
                if _is_bad(cell, convert)
            )
            wanted, remedy = 'a number', 'Repair or remove the line.'
            if column.channel == STAMP:
                wanted = f'a time ({self._stamps.form})'
                remedy = (
                    'If every line has such a time, say what it is: --time iso, ms, or a form '
                    'such as --time "%d.%m.%Y %H:%M:%S". If not, repair or remove the line.'
                )
            raise RecordingError(
                f'Line {line} of {self._name}, column {column.name}: expected {wanted}, got '
                f'{cell[:60]!r}. {remedy}'
            ) from error

    def _made(self, stamps_ns: IntArray, values: Sequence[FloatArray]) -> Rows:
        pairs = zip(self._values, values, strict=True)
        return Rows(stamps_ns, {column.channel: column.to_channel(v) for column, v in pairs})


def _is_bad(cell: str, convert: Callable[[Any], Any]) -> bool:
    try:
        convert([cell])
    except _BAD:
        return True
    return False


#: What is no text, and the library that reads it by rows.
_LIBRARIES = {'.xlsx': 'openpyxl', '.xlsm': 'openpyxl', '.parquet': 'pyarrow'}


def _by_library(path: Path) -> Iterator[str]:
    """Read the first sheet of a workbook, or a parquet file, as CSV, some rows at a time."""
    import pandas  # noqa: PLC0415 -- what reads no table does not wait for it

    library = _LIBRARIES[path.suffix.lower()]
    try:
        if library == 'pyarrow':
            from pyarrow.parquet import ParquetFile  # noqa: PLC0415 -- rarely there

            for number, batch in enumerate(ParquetFile(path).iter_batches(_BATCH_ROWS)):
                yield batch.to_pandas().to_csv(header=not number, index=False)
            return
        from openpyxl import load_workbook  # noqa: PLC0415 -- the same

        rows = load_workbook(path, read_only=True, data_only=True).worksheets[0].values
        while some := list(islice(rows, _BATCH_ROWS)):
            yield pandas.DataFrame(some, dtype=object).to_csv(header=False, index=False)
    except ImportError as error:
        raise RecordingError(
            f"{path.name} needs {library}, which is not installed. Run 'pip install {library}', "
            'or save the table as CSV.'
        ) from error
    except Exception as error:
        what = ' '.join(str(error).split())[:200].rstrip('.')
        raise RecordingError(f'{path.name} cannot be read by {library}: {what}.') from error
