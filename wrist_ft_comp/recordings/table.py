"""
Tables read by pandas: CSV and its relatives in blocks, workbooks, parquet.

A block of rows that is as it should be is converted by pandas as a whole; any other one is gone
through row by row, which tells what is wrong in which line. A last line without a line end may be
cut off; where it is incomplete, it is left out.
"""

import bz2
from codecs import BOM_UTF16_BE, BOM_UTF16_LE, getincrementaldecoder
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, suppress
import csv
from dataclasses import dataclass
import gzip
from io import StringIO, TextIOWrapper
from itertools import islice, pairwise
import lzma
from math import nan
from pathlib import Path
import re
from typing import Any
import zlib

import numpy as np

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recordings.read_options import (
    Column,
    EXCEL,
    Placed,
    ROW,
    STAMP,
    STAMP_DATE,
    STAMP_NANOSEC,
    TIME_UNITS_NS,
)
from wrist_ft_comp.recordings.table_form import (
    COMMENTS,
    cut_line,
    DIGITS,
    exact_ns,
    find_form,
    find_header,
    FIRST_LINES,
    MISSING,
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
#: A clock begins anew where this many rows after a step back, all in order, are before as many
#: that were in order before it; fewer are samples that came late.
_SURE_ROWS = 10
_PACKED = (b'\x1f\x8b', gzip), (b'BZh', bz2), (b'\xfd7zXZ', lzma)
#: What a cell cannot be converted with.
_BAD = ValueError, ArithmeticError, TypeError, AttributeError
#: What is no text, and the library that reads it by rows.
_LIBRARIES = {'.xlsx': 'openpyxl', '.xlsm': 'openpyxl', '.parquet': 'pyarrow'}
_DAY_NS = 86_400 * NANOSECONDS


@dataclass(frozen=True, eq=False)
class Rows:
    """Consecutive rows: stamps, and what the channels say, NaN where a cell is empty."""

    stamps_ns: IntArray
    #: By channel, in its unit, shape (n,).
    values: dict[str, FloatArray]
    #: Numbers of their lines in the file.
    lines: IntArray

    def part(self, begin: int, end: int) -> 'Rows':
        """Take some of the rows."""
        values = {channel: column[begin:end] for channel, column in self.values.items()}
        return Rows(self.stamps_ns[begin:end], values, self.lines[begin:end])


class Table:
    """A table in a file; ``names`` and ``units`` say what its columns are called."""

    def __init__(self, path: Path) -> None:
        self.path, self.name = path, path.name
        #: What was left out; complete when all rows were read.
        self.warnings: list[str] = []
        #: What some programs write, and what is read in its place.
        self._replaced: dict[str, str] = {}
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
        last = next(line for line in reversed(lines) if line.strip())
        if ' -> ' in last:  # of a terminal: a time, an arrow, and what was sent
            self._replaced[' -> '] = ','
        if last.startswith("'"):
            self._replaced["'"] = '"'
        for old, new in self._replaced.items():
            lines = [line.replace(old, new) for line in lines]
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
                file = TextIOWrapper(packed, _encoding_of(start), errors='replace')
                size, number, rest = max(self.path.stat().st_size, 1), 1, ''
                while piece := file.read(BLOCK):
                    for old, new in self._replaced.items():
                        piece = piece.replace(old, new)
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
                    for place, (label, unit) in self.header.affixes.items():
                        row[place] = row[place].removeprefix(label).removesuffix(unit)
                    rows.append([*row, ''][: len(self.names)])
        return rows

    def rows(
        self, placed: Placed, progress: Progress | None = None, part: int | None = None
    ) -> Iterator[Rows]:
        """
        Read the columns that are used.

        Where the clock begins anew, a new part of the file begins; RecordingError where it has
        several and none was named, from 1 on. RecordingError, naming the line, where a row is bad.
        """
        earlier_ns: IntArray = np.empty(0, np.int64)
        begins: list[int] = []
        for rows in self._blocks(placed, progress):
            seen_ns = np.concatenate([earlier_ns, rows.stamps_ns])
            steps, n = np.diff(seen_ns), _SURE_ROWS
            # A step back near the end of a block is seen with the next one.
            cuts = [
                max(k - len(earlier_ns), 0)
                for k in (np.flatnonzero(steps < 0) + 1).tolist()
                if max(n, len(earlier_ns) - n + 1) <= k <= len(seen_ns) - n
                and (steps[k - n : k - 1] >= 0).all()
                and (steps[k : k + n - 1] >= 0).all()
                and seen_ns[k + n - 1] < seen_ns[k - n]
            ]
            earlier_ns = seen_ns[-2 * _SURE_ROWS :]
            for piece, (begin, end) in enumerate(pairwise([0, *cuts, len(rows.stamps_ns)])):
                if piece:
                    begins.append(int(rows.lines[begin]))
                if end > begin and len(begins) + 1 == (part or 1):
                    yield rows if end - begin == len(rows.lines) else rows.part(begin, end)
        if part and not 0 < part <= len(begins) + 1:
            raise RecordingError(
                f'{self.name} has {len(begins) + 1} parts, and none with the number {part}.'
            )
        if begins and not part:
            named = ' '.join(f'{self.path}@{k + 1}' for k in range(len(begins) + 1))
            raise RestartError(
                f'The clock of {self.name} begins anew in line {", ".join(map(str, begins))}: '
                f'another recording begins there. Name {named}, its parts, one by one.',
                len(begins) + 1,
            )

    def _blocks(self, placed: Placed, progress: Progress | None) -> Iterator[Rows]:
        """Read rows block by block."""
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


class RestartError(RecordingError):
    """Says that a file holds several recordings, one behind the other."""

    def __init__(self, sentence: str, parts: int) -> None:
        super().__init__(sentence)
        self.parts = parts


class _RowReader:
    """Converts the rows of a table, block by block."""

    def __init__(self, table: Table, placed: Placed) -> None:
        self._name, self._header, self._most = table.name, table.header, len(table.names)
        self._values, self._stamp = placed.channels, placed.columns[STAMP]
        self._nanosec = placed.columns.get(STAMP_NANOSEC)
        self._date = placed.columns.get(STAMP_DATE)
        #: The unit or form of stamps; empty until it is found.
        self._form = self._stamp.unit
        #: How often a time of day passed midnight, and the last one, ns.
        self._days, self._last_ns = 0, 0
        #: How many rows were read.
        self._count = 0

    def read(self, text: str, number: int) -> Rows:
        """Convert lines, of which the first has a number; RecordingError where one is bad."""
        stamps_ns, values, lines = self._read_block(text, number) or self._read_rows(text, number)
        self._count += len(stamps_ns)
        pairs = zip(self._values, values, strict=True)
        return Rows(
            stamps_ns, {column.channel: column.to_channel(v) for column, v in pairs}, lines
        )

    def _read_block(
        self, text: str, number: int
    ) -> tuple[IntArray, list[FloatArray], IntArray] | None:
        """Convert lines by pandas; None where it may not understand all of them."""
        import pandas  # noqa: PLC0415 -- what reads no table does not wait for it

        sign, width, lines = self._header.delimiter, self._header.width, text.count('\n')
        data = np.frombuffer(text.encode(errors='replace'), np.uint8)
        ends = np.flatnonzero((data == ord(sign)) | (data == ord('\n')))
        cells = len(text.split()) if sign == ' ' else len(ends)
        if cells != lines * width or not lines or (not self._form and self._stamp.place != ROW):
            return None
        # Numbers of few digits are read exactly in a faster way.
        longest = np.full(width, LONGEST_LINE)
        if sign != ' ':
            longest = np.diff(ends, prepend=-1).reshape(lines, width).max(axis=0) - 1
        kinds: dict[int, object] = {column.place: float for column in self._values}
        is_short = 'e' not in text and 'E' not in text
        is_short &= all(longest[k] <= DIGITS for k in kinds if k < width)
        if self._stamp.place != ROW:
            is_float = self._form in {*TIME_UNITS_NS, EXCEL}
            is_float &= bool(longest[self._stamp.place] <= DIGITS)
            kinds[self._stamp.place] = float if is_float and self._date is None else str
            if self._form == 'ns':
                kinds[self._stamp.place] = np.int64
        for column, kind in ((self._nanosec, float), (self._date, str)):
            if column is not None:
                kinds[column.place] = kind
        # What is no number must not become an integer.
        with suppress(*_BAD, KeyError), np.errstate(invalid='raise'):
            frame = pandas.read_csv(
                StringIO(text), sep=r'\s+' if sign == ' ' else sign, header=None,
                names=range(width), usecols=[k for k in kinds if k < width], dtype=kinds,
                na_values=[*MISSING], index_col=False, skipinitialspace=True,
                float_precision='high' if is_short else 'round_trip',
                decimal=',' if sign != ',' and ',' in text else '.')  # fmt: skip
            if len(frame) != lines:
                return None
            columns = {place: frame[place].to_numpy() for place in frame}
            absent = np.full(lines, nan)
            values = [columns.get(column.place, absent) for column in self._values]
            line_numbers = number + np.arange(lines)
            return self._stamps_of(columns, lines), values, line_numbers
        return None

    def _read_rows(self, text: str, number: int) -> tuple[IntArray, list[FloatArray], IntArray]:
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

        affixes = self._header.affixes

        def cells_of(part: list[list[str]], column: Column) -> list[str]:
            label, unit = affixes.get(column.place, ('', ''))
            return [row[column.place].removeprefix(label).removesuffix(unit) for row in part]

        def converted(column: Column, convert: Callable[[list[list[str]]], Any]) -> Any:
            """Convert a column of rows, or name the first line that cannot be converted."""
            with suppress(*_BAD):
                return convert([row for _, row in rows])
            wanted, remedy = 'a number', 'Repair or remove the line.'
            if column.channel == STAMP:
                wanted = f'a time ({self._form})'
                remedy = (
                    'If every line has such a time, say what it is: --time iso, ms, or a form '
                    'such as --time "%d.%m.%Y %H:%M:%S". If not, repair or remove the line.'
                )
            for line, row in rows:
                try:
                    convert([row])
                except _BAD as error:  # noqa: PERF203 -- it ends the loop
                    raise RecordingError(
                        f'Line {line} of {self._name}, column {column.name}: expected {wanted}, '
                        f'got {row[column.place][:60]!r}. {remedy}'
                    ) from error
            raise RecordingError(
                f'{self._name} has a column {column.name} in which not every cell is {wanted}. '
                f'{remedy}'
            )

        columns: dict[int, Any] = {}
        if nanosec := self._nanosec:
            columns[nanosec.place] = converted(
                nanosec, lambda part: exact_ns(cells_of(part, nanosec), 'ns')
            )
        others = [self._stamp] if self._stamp.place != ROW else []
        others += [self._date] if self._date else []

        def read_stamps(part: list[list[str]]) -> IntArray:
            columns.update((column.place, cells_of(part, column)) for column in others)
            return self._stamps_of(columns, len(part))

        stamps_ns = converted(self._stamp, read_stamps)

        def read_numbers(column: Column) -> FloatArray:
            def convert(part: list[list[str]]) -> FloatArray:
                return np.array([number_in(cell, sign) for cell in cells_of(part, column)], float)

            return np.asarray(converted(column, convert))

        values = [*map(read_numbers, self._values)]
        return stamps_ns, values, np.array([line for line, _ in rows], np.int64)

    def _stamps_of(self, columns: Mapping[int, Any], count: int) -> IntArray:
        """Convert the columns of stamps; the form is found where nobody said it."""
        factor = self._stamp.factor
        if self._stamp.place == ROW:
            unit_ns = TIME_UNITS_NS[self._form or 's']
            numbers = self._count + np.arange(count)
            return np.asarray(np.rint(numbers * (factor or 1.0) * unit_ns).astype(np.int64))
        stamps = columns[self._stamp.place]
        if self._date:
            dates = columns[self._date.place]
            stamps = [f'{date} {time}' for date, time in zip(dates, stamps, strict=True)]
        month_first = self._header.delimiter == ','
        self._form = self._form or find_form(stamps, month_first=month_first) or 's'
        stamps_ns = exact_ns(stamps, self._form)
        if factor is not None:
            stamps_ns = np.rint(stamps_ns * factor).astype(np.int64)
        if self._nanosec:
            stamps_ns = stamps_ns + np.rint(columns[self._nanosec.place]).astype(np.int64)
        if self._form.startswith(('%H', '%I')) and len(stamps_ns):
            stamps_ns = stamps_ns % _DAY_NS
            has_passed = np.diff(stamps_ns, prepend=self._last_ns) < -_DAY_NS // 2
            self._last_ns = int(stamps_ns[-1])
            days = self._days + np.cumsum(has_passed)
            self._days = int(days[-1])
            stamps_ns = stamps_ns + days * _DAY_NS
        return stamps_ns


def _encoding_of(start: bytes) -> str:
    """Find how a text is encoded by its first bytes."""
    if start.startswith((BOM_UTF16_LE, BOM_UTF16_BE)):
        return 'utf-16'
    # In other texts of Windows an umlaut may look like a single sign of Japanese or Chinese.
    for encoding, signs in (
        ('utf-8-sig', ''), ('cp932', '[\u3040-\u9fff]{2}'), ('gb18030', '[\u4e00-\u9fff]{2}'),
    ):  # fmt: skip
        with suppress(UnicodeDecodeError):  # the last character may be cut
            if re.search(signs, getincrementaldecoder(encoding)().decode(start)):
                return encoding
    return 'cp1252'


def _by_library(path: Path) -> Iterator[str]:
    """Read the longest sheet of a workbook, or a parquet file, as CSV, some rows at a time."""
    import pandas  # noqa: PLC0415 -- what reads no table does not wait for it

    library = _LIBRARIES[path.suffix.lower()]
    try:
        if library == 'pyarrow':
            from pyarrow.parquet import ParquetFile  # noqa: PLC0415 -- rarely there

            for number, batch in enumerate(ParquetFile(path).iter_batches(_BATCH_ROWS)):
                yield batch.to_pandas().to_csv(header=not number, index=False)
            return
        from openpyxl import load_workbook  # noqa: PLC0415 -- the same

        with closing(load_workbook(path, read_only=True, data_only=True)) as book:
            rows = max(book.worksheets, key=lambda sheet: sheet.max_row or 0).values
            while some := list(islice(rows, _BATCH_ROWS)):
                yield pandas.DataFrame(some, dtype=object).to_csv(header=False, index=False)
    except ImportError as error:
        raise RecordingError(
            f"{path.name} needs {library}, which is not installed. Run 'pip install {library}', "
            'or save the table as CSV.'
        ) from error
    except Exception as error:
        what = ' '.join(str(error).split())[:200].rstrip('.')
        raise RecordingError(
            f'{path.name} cannot be read by {library} ({what}). Save the table as CSV.'
        ) from error
