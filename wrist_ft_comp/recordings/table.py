"""
Tables read by pandas: CSV and its relatives in blocks, workbooks, parquet.

A block of rows that is as it should be is converted by pandas as a whole; any other one is gone
through row by row, which tells what is wrong in which line. A last line without a line end may be
cut off; where it is incomplete, it is left out.
"""

import bz2
from codecs import BOM_UTF16_BE, BOM_UTF16_LE, getincrementaldecoder
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
import csv
from dataclasses import dataclass
from decimal import Decimal
import gzip
from io import StringIO, TextIOWrapper
from itertools import islice
import lzma
from math import nan
from pathlib import Path
from typing import Any
import zlib

import numpy as np

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recordings.column_map import Column, Placed, STAMP, STAMP_NANOSEC, TIME_UNITS_NS
from wrist_ft_comp.recordings.table_header import (
    COMMENTS,
    cut_line,
    find_header,
    FIRST_LINES,
    MISSING,
    NUMBER,
    number_in,
)
from wrist_ft_comp.series import FloatArray, IntArray, NANOSECONDS, Progress

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
#: What is no text, and the library that reads it by rows.
_LIBRARIES = {'.xlsx': 'openpyxl', '.xlsm': 'openpyxl', '.parquet': 'pyarrow'}
#: Forms that are understood without a word. Day and month are told by what makes times follow.
_FORMS = (
    'iso', '%d.%m.%Y %H:%M:%S', '%d.%m.%Y %H:%M:%S.%f', '%d.%m.%Y %H:%M', '%d.%m.%y %H:%M:%S',
    '%m/%d/%Y %H:%M:%S', '%d/%m/%Y %H:%M:%S', '%m/%d/%Y %H:%M', '%d/%m/%Y %H:%M',
    '%m/%d/%Y %H:%M:%S.%f', '%d/%m/%Y %H:%M:%S.%f', '%m/%d/%Y %I:%M:%S %p',
    '%Y/%m/%d %H:%M:%S', '%Y/%m/%d %H:%M:%S.%f', '%d-%b-%Y %H:%M:%S', '%H:%M:%S', '%H:%M:%S.%f',
    '%H:%M', '%I:%M:%S %p',
)  # fmt: skip
#: Stamps that are looked at for their form.
_LOOKED_AT = 500
_DAY_NS = 86_400 * NANOSECONDS
#: Stamps from 2001 on have at least this size in seconds, and up to 9.2 times as much, where
#: nanoseconds of 64 bits end; in a smaller unit they are as much larger.
_EPOCH_S, _EPOCH_RANGE = 1e9, 9.2


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
        for _, text in self._texts():
            if '\0' in text and text.endswith('\n'):
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

    def _texts(self, progress: Progress | None = None) -> Iterator[tuple[int, str]]:
        """
        Read whole lines, about BLOCK characters at a time, and the number of the first of them.

        A last line without a line end comes alone.
        """
        if self.path.suffix.lower() in _LIBRARIES:
            number = 1
            for text in _by_library(self.path):
                yield number, text
                number += text.count('\n')
            return
        try:
            with self.path.open('rb') as raw:
                magic = raw.read(8)
                raw.seek(0)
                packed: Any = raw
                for sign, module in _PACKED:
                    packed = module.open(raw) if magic.startswith(sign) else packed
                start = packed.read(_START)
                packed.seek(0)
                is_utf16 = start.startswith((BOM_UTF16_LE, BOM_UTF16_BE))
                encoding = 'utf-16' if is_utf16 else 'utf-8-sig'
                try:  # the last character may be cut
                    getincrementaldecoder(encoding)().decode(start)
                except UnicodeDecodeError:
                    encoding = 'cp1252'
                file = TextIOWrapper(packed, encoding, errors='replace')
                size, number, rest = max(self.path.stat().st_size, 1), 1, ''
                while piece := file.read(BLOCK):
                    rest += piece
                    end = rest.rfind('\n') + 1
                    if rest.count('"', 0, end) % 2:  # a cell in quotes goes on in the next line
                        end = rest.rfind('\n', 0, rest.rfind('"', 0, end)) + 1 or end
                    text, rest = rest[:end], rest[end:]
                    if len(rest) > LONGEST_LINE:
                        raise RecordingError(
                            f'{self.name} has a line of more than {LONGEST_LINE} characters; '
                            'expected a table, a row on each line.'
                        )
                    if text:
                        yield number, text
                        number += text.count('\n')
                    if progress:
                        progress(min(raw.tell() / size, 1.0))
                if rest:
                    yield number, rest
        except OSError as error:
            raise RecordingError(
                f'{self.path} cannot be read: {error.strerror or error}.'
            ) from error
        except (EOFError, lzma.LZMAError, zlib.error) as error:
            raise RecordingError(f'{self.path} cannot be unpacked: {error}.') from error

    def _row_texts(self, progress: Progress | None = None) -> Iterator[tuple[int, str]]:
        """Read as _texts does, without the lines above the first row."""
        for number, text in self._texts(progress):
            above = max(self.header.lines_above + 1 - number, 0)
            rest = text.split('\n', above)[-1]
            if rest and (text.endswith('\n') or not above):
                yield number + above, rest

    def shown_rows(self) -> list[list[str]]:
        """Read some rows from all over the table, as texts, each as wide as the names."""
        rows: list[list[str]] = []
        for _, text in self._row_texts():
            lines = text.split('\n') if text.endswith('\n') else []
            count = _SHOWN_LATER if rows else _SHOWN_ROWS
            for line in lines[:: max(len(lines) // count, 1)]:
                row = [] if line.startswith(COMMENTS) else cut_line(line, self.header.delimiter)
                if len(row) >= self.header.width and tuple(row) not in self.header.rows_above:
                    rows.append([*row, ''][: len(self.names)])
        return rows

    def rows(self, placed: Placed, progress: Progress | None = None) -> Iterator[Rows]:
        """Read the columns that are used; RecordingError, naming the line, where a row is bad."""
        reader, is_empty = _RowReader(self, placed), True
        for number, text in self._row_texts(progress):
            is_whole, where = text.endswith('\n'), f'Line {number} of {self.name}'
            try:
                # Zeros are what a power failure may leave; before Python 3.11, csv refuses them.
                rows = reader.read(text if is_whole else text.replace('\0', '?'), number)
            except RecordingError:
                if is_whole:
                    raise
                self.warnings.append(f'{where} is cut off in its middle; it was left out.')
                continue
            if len(rows.stamps_ns):
                is_empty = False
                yield rows
                if not is_whole:
                    cell = cut_line(text, self.header.delimiter)[-1]
                    self.warnings.append(
                        f'{where} has no line end; if it was cut off, its last value '
                        f'({self.names[-1]} = {cell!r}) is incomplete.'
                    )
        if is_empty:
            raise RecordingError(
                f'{self.name} holds a header and no complete row; nothing was recorded.'
            )


class _RowReader:
    """Converts the rows of a table, block by block."""

    def __init__(self, table: Table, placed: Placed) -> None:
        self._name, self._header, self._most = table.name, table.header, len(table.names)
        self._values, self._stamp = placed.channels, placed.columns[STAMP]
        self._nanosec = placed.columns.get(STAMP_NANOSEC)
        #: The unit or form of stamps; empty until it is found.
        self._form = self._stamp.unit
        #: How often a time of day passed midnight, and the last one, ns.
        self._days, self._last_ns = 0, 0

    def read(self, text: str, number: int) -> Rows:
        """Convert lines, of which the first has a number; RecordingError where one is bad."""
        stamps_ns, values = self._read_block(text) or self._read_rows(text, number)
        pairs = zip(self._values, values, strict=True)
        return Rows(stamps_ns, {column.channel: column.to_channel(v) for column, v in pairs})

    def _read_block(self, text: str) -> tuple[IntArray, list[FloatArray]] | None:
        """Convert lines by pandas; None where it may not understand all of them."""
        import pandas  # noqa: PLC0415 -- what reads no table does not wait for it

        sign, width, lines = self._header.delimiter, self._header.width, text.count('\n')
        cells = len(text.split()) if sign == ' ' else text.count(sign) + lines
        if cells != lines * width or not self._form:
            return None
        kinds: dict[int, object] = {column.place: float for column in self._values}
        kinds[self._stamp.place] = np.int64 if self._form == 'ns' else str
        if self._nanosec:
            kinds[self._nanosec.place] = float
        # What is no number must not become an integer.
        with suppress(*_BAD, KeyError), np.errstate(invalid='raise'):
            frame = pandas.read_csv(
                StringIO(text), sep=r'\s+' if sign == ' ' else sign, header=None,
                names=range(width), usecols=[k for k in kinds if k < width], dtype=kinds,
                na_values=[*MISSING], index_col=False, skipinitialspace=True,
                float_precision='round_trip',
                decimal=',' if sign != ',' and ',' in text else '.')  # fmt: skip
            if len(frame) != lines:
                return None
            more = 0
            if self._nanosec:
                more = np.rint(frame[self._nanosec.place].to_numpy()).astype(np.int64)
            stamps_ns = self._read_stamps(frame[self._stamp.place].to_numpy()) + more
            absent = np.full(lines, nan)
            places = [column.place for column in self._values]
            return stamps_ns, [frame[k].to_numpy() if k < width else absent for k in places]
        return None

    def _read_rows(self, text: str, number: int) -> tuple[IntArray, list[FloatArray]]:
        """Convert lines row by row; RecordingError where one is bad."""
        sign, width = self._header.delimiter, self._header.width
        lines = [
            '' if line.startswith(COMMENTS) else line.strip() if sign == ' ' else line
            for line in text.split('\n')
        ]
        rows: list[tuple[int, list[str]]] = []
        reader = csv.reader(lines, delimiter=sign, skipinitialspace=True)
        try:
            for row in reader:
                cells = [cell.strip() for cell in row]
                if not any(cells) or tuple(cells) in self._header.rows_above:
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

        def converted(column: Column, convert: Callable[[list[str]], Any]) -> Any:
            """Convert a column, or name the first line that cannot be converted."""
            with suppress(*_BAD):
                return convert([row[column.place] for _, row in rows])
            wanted, remedy = 'a number', 'Repair or remove the line.'
            if column.channel == STAMP:
                wanted = f'a time ({self._form})'
                remedy = (
                    'If every line has such a time, say what it is: --time iso, ms, or a form '
                    'such as --time "%d.%m.%Y %H:%M:%S". If not, repair or remove the line.'
                )
            for line, row in rows:
                try:
                    convert([row[column.place]])
                except _BAD as error:  # noqa: PERF203 -- it ends the loop
                    raise RecordingError(
                        f'Line {line} of {self._name}, column {column.name}: expected {wanted}, '
                        f'got {row[column.place][:60]!r}. {remedy}'
                    ) from error
            raise RecordingError(
                f'{self._name} has a column {column.name} in which not every cell is {wanted}. '
                f'{remedy}'
            )

        stamps_ns = converted(self._stamp, self._read_stamps)
        if self._nanosec:
            stamps_ns += converted(self._nanosec, lambda cells: exact_ns(cells, 'ns'))
        return stamps_ns, [
            converted(c, lambda cells: np.array([number_in(cell, sign) for cell in cells], float))
            for c in self._values
        ]

    def _read_stamps(self, stamps: Any) -> IntArray:
        """Convert texts, or whole ns; the form is found where nobody said it."""
        self._form = self._form or find_form(stamps) or 's'
        stamps_ns = exact_ns(stamps, self._form)
        if self._stamp.factor is not None:
            stamps_ns = np.rint(stamps_ns * self._stamp.factor).astype(np.int64)
        if self._form.startswith(('%H', '%I')) and len(stamps_ns):
            stamps_ns = stamps_ns % _DAY_NS
            has_passed = np.diff(stamps_ns, prepend=self._last_ns) < -_DAY_NS // 2
            self._last_ns = int(stamps_ns[-1])
            days = self._days + np.cumsum(has_passed)
            self._days = int(days[-1])
            stamps_ns = stamps_ns + days * _DAY_NS
        return stamps_ns


def exact_ns(stamps: Any, form: str) -> IntArray:
    """Convert stamps of a form; ValueError, ArithmeticError or TypeError where one is bad."""
    if form == 'ns' and getattr(stamps, 'dtype', None) == np.int64:
        return np.asarray(stamps)
    if unit_ns := TIME_UNITS_NS.get(form):
        if any('_' in stamp for stamp in stamps):
            raise ValueError('1_000 is no number of a table')
        numbers = (Decimal(stamp.replace(',', '.')) * unit_ns for stamp in stamps)
        return np.fromiter(map(round, numbers), np.int64, len(stamps))
    import pandas  # noqa: PLC0415 -- what reads no table does not wait for it

    texts = [stamp.strip().replace(',', '.').removesuffix(' UTC') for stamp in stamps]
    times = pandas.to_datetime(texts, format='ISO8601' if form == 'iso' else form, utc=True)
    if times.hasnans:
        raise ValueError('a stamp is missing')
    return np.asarray(times.as_unit('ns').asi8)


def find_form(stamps: Sequence[str]) -> str:
    """Find the unit of numbers by their size, or the form of dates; empty where there is none."""
    some = stamps[:: max(len(stamps) // _LOOKED_AT, 1)]
    filled = [text for text in some if text.lower() not in MISSING]
    if not filled:
        return ''
    if all(map(NUMBER.fullmatch, filled)):
        size = abs(float(filled[0].replace(',', '.'))) / _EPOCH_S
        units = 's', 'ms', 'us', 'ns'
        return next((u for k, u in enumerate(units) if 1 <= size / 1000**k < _EPOCH_RANGE), 's')
    disorder: dict[str, int] = {}
    for form in _FORMS if filled[0][:1].isdigit() else ():
        with suppress(ValueError, ArithmeticError):
            stamps_ns = exact_ns(filled, form)
            runs_back = int(np.count_nonzero(np.diff(stamps_ns) < 0))
            disorder[form] = runs_back * 10**19 + int(np.ptp(stamps_ns))
    return min(disorder, key=disorder.__getitem__) if disorder else ''


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
