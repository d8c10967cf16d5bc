"""
Tables read by pandas: CSV and its relatives in blocks, workbooks, parquet, columns in memory.

A block of rows, all as wide as they should be, is converted by pandas as a whole; any other one is
cut by csv first, which knows the lines. A last line without a line end may be cut off; where it is
incomplete, it is left out.
"""

import bz2
from codecs import BOM_UTF16_BE, BOM_UTF16_LE, getincrementaldecoder
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
import csv
from functools import partial
import gzip
from io import StringIO, TextIOWrapper
import lzma
from pathlib import Path
import re
from typing import Any
import zlib

import numpy as np

from wrist_ft_comp.channels import AXES, GROUPS
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recording import Samples
from wrist_ft_comp.recordings import column_map, table_format
from wrist_ft_comp.recordings.column_map import Column, Placed
from wrist_ft_comp.recordings.table_format import COMMENTS, cut_line, DAY_NS, exact_ns, Header
from wrist_ft_comp.series import FloatArray, IntArray, NANOSECONDS, Progress
from wrist_ft_comp.units import STAMP, TIME_UNITS_NS

#: Characters of the longest line that a table may have.
LONGEST_LINE = 1_000_000
#: Characters in memory at once.
BLOCK = 1_000_000
#: Rows of a workbook or a parquet file in memory at once.
_BATCH_ROWS = 20_000
#: Bytes that show how a text is encoded.
_START = 200_000
#: Rows of a table that show what its columns are: of its first block, and of each other one.
_SHOWN_ROWS, _SHOWN_LATER, _GOLDEN = 3000, 100, 0.6180339887
#: A clock begins anew where this many rows after a step back, all in order, are before as many
#: that were in order before it; fewer are samples that came late.
_SURE_ROWS = 10
#: A row may come later than those of the next day by this, ns.
_LATEST_NS = 60 * NANOSECONDS
_PACKED = (b'\x1f\x8b', gzip), (b'BZh', bz2), (b'\xfd7zXZ', lzma)
#: What a cell that cannot be converted raises.
_BAD = ValueError, ArithmeticError, TypeError, AttributeError
#: What is no text, and the library that reads it.
_LIBRARIES = {'.xlsx': 'openpyxl', '.xlsm': 'openpyxl', '.parquet': 'pyarrow'}
#: Name of the stamps in Rows.
STAMP_NS = 'stamp_ns'
#: A pandas.DataFrame of consecutive rows, by the numbers of their lines in the file: STAMP_NS, and
#: by channel what it says, in its unit, NaN where a cell is empty.
Rows = Any


class Table:
    """A table in a file; ``header`` says how it is laid out."""

    def __init__(self, path: Path, columns_before: int = 0) -> None:
        self.path, self.name = path, path.name
        #: What was left out; complete when all rows were read.
        self.warnings: list[str] = []
        self.header = Header()
        lines: list[str] = []
        for _, text in self._texts():
            if '\0' in text and text.endswith('\n'):
                raise RecordingError(f'{self.name} is no text; expected a bag, or a table as CSV.')
            lines += text.removesuffix('\n').split('\n')
            if len(lines) >= table_format.FIRST_LINES:
                break
        if not any(map(str.strip, lines)):
            raise RecordingError(
                f'{self.name} is empty; expected rows below stamp_s,force_z,temperature_c.'
            )
        lines = lines[: table_format.FIRST_LINES]
        self.header = table_format.find_header(lines, columns_before, self.name)

    def _pieces(self, progress: Progress | None) -> Iterator[str]:
        """Read the text, about BLOCK characters at a time."""
        if library := _LIBRARIES.get(self.path.suffix.lower()):
            yield from _by_library(self.path, library)
            return
        size = max(self.path.stat().st_size, 1)
        with self.path.open('rb') as raw:
            magic = raw.peek(8)
            opened = [module.open(raw) for sign, module in _PACKED if magic.startswith(sign)]
            packed: Any = opened[0] if opened else raw
            file = TextIOWrapper(packed, _encoding_of(packed.read(_START)), errors='replace')
            packed.seek(0)
            while piece := file.read(BLOCK):
                yield piece
                if progress:
                    progress(min(raw.tell() / size, 1.0))

    def _texts(self, progress: Progress | None = None) -> Iterator[tuple[int, str]]:
        """Read whole lines below the header, and the number of the first; a cut one is alone."""
        number, rest, lines_above = 1, '', self.header.lines_above
        try:
            for piece in self._pieces(progress):
                rest += piece
                end = rest.rfind('\n') + 1
                if rest.count('"', 0, end) % 2:  # a cell in quotes goes on in the next line
                    end = rest.rfind('\n', 0, rest.rfind('"', 0, end)) + 1 or end
                text, rest = rest[:end], rest[end:]
                if len(rest) > LONGEST_LINE:
                    raise RecordingError(
                        f'{self.name} has a line of more than {LONGEST_LINE} characters: no table.'
                    )
                above = max(lines_above + 1 - number, 0)
                if below := text.split('\n', above)[-1]:
                    yield number + above, self.header.plain_text(below)
                number += text.count('\n')
        except (OSError, EOFError, lzma.LZMAError, zlib.error) as error:
            what = getattr(error, 'strerror', None) or error
            raise RecordingError(f'{self.path} cannot be read: {what}.') from error
        if rest and number > lines_above:
            yield number, self.header.plain_text(rest)

    def shown_rows(self) -> list[list[str]]:
        """Read some rows from all over the table, as texts, each as wide as the names."""
        rows: list[list[str]] = []
        for _, text in self._texts():
            lines = text.split('\n') if text.endswith('\n') else []
            share = (_SHOWN_LATER if rows else _SHOWN_ROWS) / max(len(lines), 1)
            # Evenly spread and in no step: rows may come in turn from several channels.
            for line in (line for k, line in enumerate(lines) if k * _GOLDEN % 1 < share):
                row = [] if line.startswith(COMMENTS) else cut_line(line, self.header.delimiter)
                if len(row) >= self.header.width and self.header.is_sample(row):
                    rows.append([*row, ''][: len(self.header.names)])
        return rows

    def rows(self, placed: Placed, progress: Progress | None = None) -> Iterator[Rows]:
        """Read the columns that are used; RecordingError where a row is bad or out of order."""
        import pandas  # noqa: PLC0415 -- what reads no table does not wait for it

        convert, n = _RowConverter(placed), _SURE_ROWS
        held: Rows = None
        for number, text in self._texts(progress):
            is_whole, where = text.endswith('\n'), f'Line {number} of {self.name}'
            try:
                # Zeros are what a power failure may leave; before Python 3.11, csv refuses them.
                rows = self._read(text if is_whole else text.replace('\0', '?'), number, convert)
            except RecordingError:
                if is_whole:
                    raise
                self.warnings.append(f'{where} is cut off in its middle; it was left out.')
                continue
            if not len(rows):
                continue
            if not is_whole:
                cell = cut_line(text, self.header.delimiter)[-1]
                self.warnings.append(
                    f'{where} has no line end; if it was cut off, its last value '
                    f'({self.header.names[-1]} = {cell!r}) is incomplete.'
                )
            held = rows if held is None else pandas.concat([held.iloc[-2 * n :], rows])
            back = np.diff(held[STAMP_NS]) < 0
            if len(back) > n and back.all():
                raise RecordingError(f'{self.name} has its newest row first. Sort it by time.')
            for k in (np.flatnonzero(back) + 1).tolist():
                around, line = held.iloc[max(k - n, 0) : k + n], held.index[k]
                steps_ns = np.diff(around[STAMP_NS])
                is_sure = len(steps_ns) == 2 * n - 1 and (steps_ns < 0).sum() == 1
                # Other channels may stand below the first ones, as pandas.concat puts them.
                filled = np.isfinite(around.drop(columns=STAMP_NS).to_numpy())
                goes_on = (filled[:n].any(axis=0) & filled[n:].any(axis=0)).any()
                if is_sure and goes_on and steps_ns.sum() < 0:
                    raise RecordingError(
                        f'The clock of {self.name} begins anew in line {line}. Where another '
                        'recording begins there, make it a file of its own, below the same '
                        'header. Where the clock was set or ran over, and rows come at a fixed '
                        'rate, count them: stamp=#*0.01 is a hundred a second.'
                    )
            yield rows
        if held is None:
            raise RecordingError(f'{self.name} holds no complete row; nothing was recorded.')

    def _read(self, text: str, number: int, convert: '_RowConverter') -> Rows:
        """Convert lines, of which the first has a number; RecordingError where one is bad."""
        import pandas  # noqa: PLC0415 -- what reads no table does not wait for it

        sign, width = self.header.delimiter, self.header.width
        texts = text.removesuffix('\n').split('\n')
        cells = {len(line.split()) if sign == ' ' else line.count(sign) + 1 for line in texts}
        is_odd = cells != {width} or table_format.NO_SAMPLE.search(f'\n{text}')
        if text.endswith('\n') and not is_odd:
            with suppress(RecordingError, *_BAD):
                frame = pandas.read_csv(
                    StringIO(text), sep=r'\s+' if sign == ' ' else sign, header=None,
                    names=range(width), usecols=[k for k in convert.places if k < width],
                    index_col=False, dtype=convert.types, skipinitialspace=True,
                    skip_blank_lines=False, float_precision='high', low_memory=False,
                    decimal=self.header.decimal,
                )  # fmt: skip
                return convert(frame.set_axis(range(number, number + len(texts))))

        # Line by line: some are comments, repeat the header, are empty or bad.
        texts = ['' if line.startswith(COMMENTS) else line for line in texts]
        rows: dict[int, list[str]] = {}
        reader = csv.reader(texts, delimiter=sign, skipinitialspace=True)
        try:
            for row in reader:
                found = [cell.strip() for cell in row]
                line, count = number + reader.line_num - 1, len(found)
                if not self.header.is_sample(found):
                    if self.header.is_other(found):
                        raise RecordingError(
                            f'Line {line} of {self.name} names other columns, or in another '
                            'order: another log begins there. Cut it there, and name both files.'
                        )
                    continue
                if not width <= count <= len(self.header.names) and any(found[width:] or ['x']):
                    raise RecordingError(
                        f'Line {line} of {self.name} has {count} cells; the others have {width}. '
                        'Repair or remove the line.'
                    )
                rows[line] = found
        except csv.Error as error:
            raise RecordingError(f'{self.name} is no table: {error}.') from error
        return convert(pandas.DataFrame.from_dict(rows, 'index', str).fillna(''))


class TableInMemory:
    """Columns in memory, read as a table in a file is: they are a single block of it."""

    def __init__(self, columns: Any, name: str) -> None:
        self._columns, self.name, self.warnings = columns, name, list[str]()
        self.header = Header(names=tuple(map(str, columns.keys())))

    def shown_rows(self) -> list[list[str]]:
        """Show no rows: only names are looked at."""
        return []

    def rows(self, placed: Placed, _progress: Progress | None = None) -> Iterator[Rows]:
        """Give all rows at once; RecordingError where a column holds something else."""
        import pandas  # noqa: PLC0415 -- as above

        convert = _RowConverter(placed)
        cells = {place: self._columns[self.header.names[place]] for place in convert.places}
        try:
            frame = pandas.DataFrame({place: np.asarray(cells[place]) for place in cells})
        except ValueError as error:
            raise RecordingError(
                f'The columns of {self.name} must have one value per row: {error}.'
            ) from error
        yield convert(frame.set_axis(range(1, len(frame) + 1)))


class _RowConverter:
    """Converts the rows of a table, block by block."""

    def __init__(self, placed: Placed) -> None:
        self._name, self._columns, self._header = placed.table, placed.columns, placed.header
        self._channels, self._stamp = placed.channels, placed.columns[STAMP]
        #: The places of all columns that are used.
        self.places = sorted({c.place for c in placed.columns.values()} - {column_map.ROW})
        stamps = [c.place for c in self._columns.values() if c.channel in column_map.STAMP_COLUMNS]
        #: What pandas reads stamps as, by place: texts, which are exact, but whole nanoseconds.
        self.types = dict.fromkeys(stamps, np.int64 if self._stamp.unit == 'ns' else str)
        #: The unit or form of stamps; empty until it is found.
        self._form = self._stamp.unit
        #: The last stamp, ns, and how many rows were converted.
        self._last_ns, self._count = 0, 0

    def __call__(self, frame: Any) -> Rows:
        """Convert columns by their places, numbers or texts, of rows by their lines."""
        frame = frame.reindex(columns=self.places)  # a header may name more than rows hold
        if self._stamp.place in frame and _is_empty(frame[self._stamp.place]).any():
            # Of two groups of columns with their own clocks, one is shorter.
            frame = frame[~_is_empty(frame).all(axis=1)]
        lines, values = frame.index.to_numpy(), {}
        for column in self._channels:
            cells = frame[column.place].to_numpy()
            if cells.dtype.kind not in 'iuf':
                cells = self._convert(self._numbers, cells.tolist(), column, lines)
            values[column.channel] = column.to_channel(cells.astype(float))
        stamps_ns = self._stamps_of(frame, lines)
        self._count += len(lines)
        return frame[[]].assign(**{STAMP_NS: stamps_ns}, **values)

    def _numbers(self, cells: Sequence[Any]) -> FloatArray:
        return np.array([self._header.number_in(str(cell)) for cell in cells], float)

    def _convert(
        self, convert: Callable[[Any], Any], cells: Sequence[Any], column: Column, lines: IntArray
    ) -> Any:
        """Convert the cells of a column; RecordingError that names the line where one is bad."""
        try:
            return convert(cells)
        except _BAD as error:
            if len(cells) > 1:
                for k in range(len(cells)):
                    self._convert(convert, cells[k : k + 1], column, lines[k : k + 1])
            wanted, remedy = 'a number', 'Repair or remove the line.'
            if column is self._stamp:
                wanted = f'a time ({self._form})'
                remedy = (
                    'If every line has such a time, say what it is: --time iso, ms, or a form '
                    'such as --time "%d.%m.%Y %H:%M:%S". If not, repair or remove the line.'
                )
            raise RecordingError(
                f'Line {lines[0]} of {self._name}, column {column.name}: expected {wanted}, got '
                f'{str(cells[0])[:60]!r}. {remedy}'
            ) from error

    def _stamps_of(self, frame: Any, lines: IntArray) -> IntArray:
        """Convert the columns of stamps; the form is found where nobody said it."""
        factor, count = self._stamp.factor, len(lines)
        if not count or self._stamp.place == column_map.ROW:
            row_ns = (factor or 1.0) * TIME_UNITS_NS.get(self._form, NANOSECONDS)
            return np.asarray(np.rint((self._count + np.arange(count)) * row_ns).astype(np.int64))

        def cells_of(column: Column) -> Any:
            cells = frame[column.place]
            return cells.fillna('').tolist() if cells.dtype == object else cells.to_numpy()

        stamps = cells_of(self._stamp)
        if date := self._columns.get(column_map.STAMP_DATE):
            stamps = [f'{day} {time}' for day, time in zip(cells_of(date), stamps, strict=True)]
        if isinstance(stamps, list):
            stamps = list(map(self._header.without_thousands, stamps))
        if not self._form and isinstance(stamps, list) and factor is None:
            self._form = table_format.find_form(stamps, month_first=self._header.delimiter == ',')
        form = self._form = self._form or 's'
        times = partial(exact_ns, form=form, factor=factor or 1.0)
        stamps_ns = self._convert(times, stamps, self._stamp, lines)
        if nanosec := self._columns.get(column_map.STAMP_NANOSEC):
            if form == 's' and factor is None and (stamps_ns % NANOSECONDS).any():
                raise RecordingError(
                    f'{self._stamp.name} of {self._name} has decimals, to which {nanosec.name} '
                    'would be added; expected whole seconds. Leave stamp_nanosec out.'
                )
            convert = partial(exact_ns, form='ns')
            stamps_ns = stamps_ns + self._convert(convert, cells_of(nanosec), nanosec, lines)
        if form.startswith(('%H', '%I')):
            day, time_ns = divmod(self._last_ns, DAY_NS)
            stamps_ns = stamps_ns % DAY_NS
            steps_ns = np.diff(stamps_ns, prepend=time_ns if self._count else stamps_ns[0])
            # Midnight passed; or a row is late, and of the day before.
            days = (steps_ns < -DAY_NS // 2) * 1 - (steps_ns > DAY_NS - _LATEST_NS)
            stamps_ns = stamps_ns + (day + np.cumsum(days)) * DAY_NS
            self._last_ns = int(stamps_ns[-1])
        return np.asarray(stamps_ns)


def _is_empty(cells: Any) -> Any:
    return cells.isna() | (cells == '')


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


def _by_library(path: Path, library: str) -> Iterator[str]:
    """Read the longest sheet of a workbook, or a parquet file, as CSV, some rows at a time."""
    import pandas  # noqa: PLC0415 -- what reads no table does not wait for it

    try:
        if library == 'openpyxl':
            sheets = pandas.read_excel(path, None, header=None, dtype=object, engine=library)
            longest = max(sheets.values(), key=len)
            # A log may go on in another sheet, below the same header; others begin anew.
            alike = [sheet for sheet in sheets.values() if sheet[:1].equals(longest[:1])]
            frame = pandas.concat(alike) if all(map(_goes_on, alike, alike[1:])) else longest
        else:
            frame = pandas.read_parquet(path, library)
            if any(frame.index.names):  # most often the time
                frame = frame.reset_index()
        for k in range(0, len(frame), _BATCH_ROWS):
            header = k == 0 and library != 'openpyxl'
            yield frame[k : k + _BATCH_ROWS].to_csv(header=header, index=False)
    except Exception as error:
        what = ' '.join(str(error).split())[:200].rstrip('.')
        raise RecordingError(
            f'{path.name} cannot be read by {library} ({what}). Save the table as CSV, or run '
            f"'pip install {library}' if it is not installed."
        ) from error


def _goes_on(sheet: Any, following: Any) -> bool:
    """Whether the first row of numbers of another sheet is later than the last of one."""
    last = sheet.iloc[-1, 0]
    kind = (int, float) if isinstance(last, int) else type(last)
    later = (value > last for value in following.iloc[1:, 0] if isinstance(value, kind))
    return bool(next(later, False))


def samples_of(rows: Rows) -> list[Samples]:
    """Make blocks of samples, as they begin; a group is split where a row holds a part of it."""
    blocks = list[Samples]()
    alone = [(channel,) for channel in rows if channel.startswith('temperature')]
    for whole in (AXES, *alone, *GROUPS[1:]):
        group = tuple(channel for channel in whole if channel in rows)
        if not group:
            continue
        filled = rows[[*group]].notna().to_numpy()
        together = (filled == filled[:, :1]).all()
        for channels in [group] if together else [(channel,) for channel in group]:
            at, block = rows[channels[0]].notna().to_numpy(), rows[[*channels]].to_numpy()
            blocks.append(Samples(channels, rows[STAMP_NS].to_numpy()[at], block[at]))
    return sorted(blocks, key=lambda samples: samples.stamps_ns[:1].tolist())
