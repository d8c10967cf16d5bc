"""
How a table is written: delimiter, header, units, numbers, and the forms of its times.

Our own recordings are written row by row: what the node records survives a crash.
"""

from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
import csv
from dataclasses import dataclass, field
from decimal import Decimal
import errno
from math import floor, isnan, log10, nan
import os
from pathlib import Path
import re
from typing import Any

import numpy as np

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recordings.read_options import DAYS_TO_1970, TIMEDELTA
from wrist_ft_comp.recordings.units import plain_unit, TIME_UNITS_NS, UNIT_WORDS
from wrist_ft_comp.series import FloatArray, IntArray, NANOSECONDS
from wrist_ft_comp.stored.own_file import writing

#: Lines in which the header is looked for, and the last of them that show what rows are like.
FIRST_LINES, _LIKE_ROWS = 300, 30
COMMENTS = '#', '%', '//'
#: What stands in a cell that has no value, in small letters.
MISSING = frozenset({
    '', '-', '--', '---', 'nan', '-nan', 'na', 'n/a', '#n/a', 'null', 'none', '?', '<na>', 'nat',
})  # fmt: skip
NUMBER = re.compile(r'[-+]?(\d+([.,]\d*)?|[.,]\d+)([eE][-+]?\d+)?|[-+]?inf(inity)?', re.IGNORECASE)
#: 1,234.5 or 1.234,5.
_THOUSANDS = re.compile(r'[-+]?\d{1,3}((,\d{3})+\.|(\.\d{3})+,)\d*')
_TIME = re.compile(
    r'(?P<date>\d{1,4}(?P<sign>[-./])\w{1,3}(?P=sign)\d{1,4}|\d{8}(?=T))?(?P<gap>, |[T /_-])?'
    r'(?P<time>\d{1,2}(?P<dot>[:.])\d\d((?P=dot)\d\d)?([.,:]\d+)?|\d{6})?(?P<half> ?[AP]M)?'
    r'(?P<zone> ?(Z|UTC|[-+]\d\d:?\d\d))?',
    re.IGNORECASE,
)
#: Words of rows below a header that say what a recorder did to the samples.
_STATISTICS = {'avg', 'smp', 'min', 'max', 'std', 'mean', 'ts', 'rn', 'count', 'median', 'tot'}
#: Lines above the header that say in which unit, or how many counts, forces or torques are.
_UNIT_LINE = re.compile(r'(force|torque) units?\W+([a-z-]+)', re.IGNORECASE)
_COUNTS_LINE = re.compile(r'counts per (?:unit )?(force|torque)\W+([\d.]+)', re.IGNORECASE)
_UNIT_ROW = re.compile(r'(y_)?(units?|einheit(en)?)(_label)?', re.IGNORECASE)
#: Stamps that are looked at for their form.
_LOOKED_AT = 500
#: Stamps from 2001 on have at least this size in seconds, and up to 9.2 times as much, where
#: nanoseconds of 64 bits end; in a smaller unit they are as much larger.
_EPOCH_S, _EPOCH_RANGE = 1e9, 9.2
#: When a log was probably written: from 2010 to 2040, ns since 1970.
_LIKELY_NS = 1_262_304_000 * NANOSECONDS, 2_208_988_800 * NANOSECONDS
#: Digits of a number that a double holds exactly.
DIGITS = 15


@dataclass(frozen=True)
class Header:
    """How a table is laid out."""

    delimiter: str
    #: Number of cells in a row; names may be one more, which have no cells.
    width: int
    #: How many lines stand above the first row.
    lines_above: int
    #: What the columns are called: by their numbers, from 1 on, where no line names them.
    names: tuple[str, ...]
    #: Units in a row of their own, or empty.
    units: tuple[str, ...]
    #: The header and what stands between it and the rows; some recorders repeat it.
    rows_above: frozenset[tuple[str, ...]]
    #: What lines above say of 'force' and 'torque': their unit, and counts per unit.
    said_units: dict[str, str] = field(default_factory=dict)
    said_counts: dict[str, float] = field(default_factory=dict)


def find_header(lines: Sequence[str]) -> Header:
    """Find how a table is laid out from its first lines."""
    at = [k for k, line in enumerate(lines) if line.strip() and not line.startswith(COMMENTS)]
    last_lines = [lines[k] for k in at[-_LIKE_ROWS:]]

    def fit(delimiter: str) -> float:
        """Tell how well lines are rows of values, or of anything."""
        rows = [cut_line(line, delimiter) for line in last_lines]
        width = Counter(map(len, rows)).most_common(1)[0][0] if rows else 0
        values = sum(sum(map(_is_value, row)) for row in rows if len(row) == width > 1)
        return values / max(len(rows) * width, 1) or 1e-6 * width

    delimiter = max(',;\t| ', key=fit)
    last = [cut_line(line, delimiter) for line in last_lines]
    width = Counter(map(len, last)).most_common(1)[0][0] if last else 0
    last = [row for row in last if len(row) == width]
    columns = list(zip(*last, strict=True))

    # The first row is as wide and has a value wherever most of the last lines have one.
    must = [k for k, cells in enumerate(columns) if 2 * sum(map(_is_value, cells)) >= len(cells)]
    for first in at:
        row = cut_line(lines[first], delimiter)
        has_number = any(map(NUMBER.fullmatch, row))
        if len(row) == width and has_number and all(_is_value(row[place]) for place in must):
            break
    else:
        first = len(lines)

    # Above it are rows as wide: of units, of what was done to the samples, and one of names.
    above: list[list[str]] = []
    for line in reversed([line for line in lines[:first] if line.strip('-=+|_ \t')]):
        is_comment = line.startswith(COMMENTS)
        cells = cut_line(line.lstrip('#%/') if is_comment else line, delimiter)
        while cells and not cells[-1]:
            cells.pop()
        if cells and len(cells) <= width + 1 and not any(any(row[len(cells) :]) for row in last):
            above.append(cells)
        elif cells and (above or not is_comment):
            break
    names = above[-1] if above else []
    for row in above:
        told = [_has_unit([c]) or c.lower() in _STATISTICS or _is_value(c) for c in row if c]
        if 2 * sum(told) < len(told):
            names = row
            break
    units = next((row for row in above if row is not names and _has_unit(row)), [])
    for row in (cut_line(line, delimiter) for line in lines[:first]):
        if not units and len(row) > 1 and _UNIT_ROW.fullmatch(row[0]) and _has_unit(row[1:]):
            units = ['', *(cell.strip('()') for cell in row[1:])]
    names = [*names, *[''] * (width - len(names))] if names else [str(k + 1) for k in range(width)]
    text = '\n'.join(lines[:first])
    return Header(
        delimiter, width, first, tuple(names), tuple(units), frozenset(map(tuple, above)),
        {word.lower(): unit for word, unit in _UNIT_LINE.findall(text)},
        {word.lower(): float(count) for word, count in _COUNTS_LINE.findall(text)})  # fmt: skip


def cut_line(line: str, delimiter: str) -> list[str]:
    """Cut a line into cells."""
    text = line.strip() if delimiter == ' ' else line
    with suppress(csv.Error):
        for row in csv.reader([text], delimiter=delimiter, skipinitialspace=True):
            return [cell.strip() for cell in row]
    return []


def number_in(cell: str, delimiter: str = ',') -> float:
    """Read a number; a missing one is NaN. ValueError where it is none."""
    if cell.lower() in MISSING:
        return nan
    if _THOUSANDS.fullmatch(cell):
        cell = cell.replace(',' if cell.rfind('.') > cell.rfind(',') else '.', '')
    if not NUMBER.fullmatch(cell):
        raise ValueError(cell)
    return float(cell if delimiter == ',' else cell.replace(',', '.'))


def _is_value(cell: str) -> bool:
    """Whether a cell holds a number or a time, or says that it holds none."""
    if not cell.strip('-=:') or cell.lower() in MISSING or NUMBER.fullmatch(cell):
        return True
    match = _TIME.fullmatch(cell)
    return bool(match and (match['date'] or match['time']))


def _has_unit(row: Sequence[str]) -> bool:
    return any(plain_unit(cell) in UNIT_WORDS for cell in row)


def exact_ns(texts: Any, form: str) -> IntArray:
    """
    Convert stamps of a form exactly to nanoseconds: texts, or numbers of up to DIGITS digits.

    ValueError, ArithmeticError or TypeError where one is bad.
    """
    if day := DAYS_TO_1970.get(form):
        return exact_ns([str(Decimal(text.replace(',', '.')) - day) for text in texts], 'd')
    together = '' if isinstance(texts, np.ndarray) else ''.join(texts)
    if ',' in together:
        texts = [text.replace(',', '.') for text in texts]
    if unit_ns := TIME_UNITS_NS.get(form):
        if '_' in together:
            raise ValueError('1_000 is no number of a table')
        if together and max(map(len, texts)) > DIGITS:
            numbers = (Decimal(text) * unit_ns for text in texts)
            return np.fromiter(map(round, numbers), np.int64, len(texts))
        # A double holds all of so few digits: as whole multiples of a power of ten they are kept.
        stamps = np.array(texts, float)
        largest = float(np.abs(stamps).max(initial=1e-9))
        if not largest * unit_ns <= np.iinfo(np.int64).max:
            raise ValueError('a stamp is missing, or is beyond what 64 bits of nanoseconds hold')
        digits = min(DIGITS - 1 - floor(log10(largest)), len(str(unit_ns)) - 1)
        whole, step_ns = np.rint(stamps * 10.0**digits), unit_ns / 10**digits
        if step_ns.is_integer():
            return np.asarray(whole.astype(np.int64) * int(step_ns))
        return np.asarray(np.rint(whole * step_ns).astype(np.int64))
    import pandas  # noqa: PLC0415 -- what reads no table does not wait for it

    texts = [text.strip().removesuffix(' UTC') for text in texts]
    if form == TIMEDELTA:
        return np.asarray(pandas.to_timedelta(texts).as_unit('ns').asi8)
    times = pandas.to_datetime(
        texts, format='ISO8601' if form == 'iso' else form.replace(',', '.'), utc=True
    )
    if times.hasnans:
        raise ValueError('a stamp is missing')
    return np.asarray(times.as_unit('ns').asi8)


def epoch_unit(number: float) -> str:
    """Find the unit of a number since 1970 by its size; empty where it is none."""
    size = abs(number) / _EPOCH_S
    units = 's', 'ms', 'us', 'ns'
    return next((u for k, u in enumerate(units) if 1 <= size / 1000**k < _EPOCH_RANGE), '')


def find_form(stamps: Sequence[str], *, month_first: bool = False) -> str:
    """
    Find the unit of numbers by their size, or the form of dates; empty where there is none.

    Day and month are told by what makes times follow; where both do, by ``month_first``.
    """
    some = stamps[:: max(len(stamps) // _LOOKED_AT, 1)]
    filled = [text for text in some if text.lower() not in MISSING]
    if not filled:
        return ''
    if all(map(NUMBER.fullmatch, filled)):
        return epoch_unit(float(filled[0].replace(',', '.'))) or 's'
    if re.match(r'-?\d+ days?\b', filled[0]):
        return TIMEDELTA
    match = _TIME.fullmatch(filled[0])
    if not match or not (match['date'] or match['time']):
        # Such as Thu Mar 05 07:00:00 2026.
        from pandas.tseries.api import guess_datetime_format  # noqa: PLC0415 -- as above

        form = guess_datetime_format(filled[0], not month_first) if ':' in filled[0] else None
        return form or ''
    date, gap, half = match['date'] or '', match['gap'] or '', match['half'] or ''
    # A time of day as its signs are: 7:00 PM, 19:00:00, 19:00:00.250, 19:00:00:250.
    signs = re.findall(r'[.,:]', match['time'] or '')
    clock = zip(['', *signs], ['%I' if half else '%H', '%M', '%S', '%f'], strict=False)
    end = ''.join(map(''.join, clock)) if signs else ''
    end += re.sub('[AP]M', '%p', half, flags=re.IGNORECASE)
    if match['zone'] not in {None, ' UTC'}:
        end += re.sub(r'\S+', '%z', match['zone'])
    # A date in every order of day, month and year.
    parts = date.split(match['sign']) if match['sign'] else []
    month = '%b' if any(map(str.isalpha, parts)) else '%m'
    year = '%Y' if any(len(part) == 4 for part in parts) else '%y'
    orders = [('%d', month, year), (month, '%d', year), (year, month, '%d')]
    if (month_first or half) and match['sign'] != '.':
        orders.insert(0, orders.pop(1))
    days = [match['sign'].join(order) for order in orders] if parts else ['']
    forms = [f'{day}{gap}{end}' for day in days]
    if date.isdecimal() or (date[4:5] == '-' and gap in {'', ' ', 'T'} and not half):
        forms = ['iso']
    disorder: dict[str, int] = {}
    for form in forms:
        with suppress(ValueError, ArithmeticError):
            stamps_ns = exact_ns(filled, form)
            runs_back = int(np.count_nonzero(np.diff(stamps_ns) < 0))
            is_odd = bool(date) and not _LIKELY_NS[0] < stamps_ns[0] < _LIKELY_NS[1]
            disorder[form] = (10 * runs_back + is_odd) * 10**19 + int(np.ptp(stamps_ns))
    return min(disorder, key=disorder.__getitem__) if disorder else ''


def unit_of_times(numbers: FloatArray) -> str:
    """
    Tell the unit of times that nobody named, by their sizes: s, or a smaller one.

    Since 1970, or from a beginning: then a recording lasts less than three days, or its rows are
    minutes apart.
    """
    if unit := epoch_unit(float(numbers[0])):
        return unit
    steps, lasts = np.diff(numbers), float(np.ptp(numbers))
    step = float(np.median(steps)) if len(steps) else 0.0
    if 300 <= step <= 7200 and step % 60 == 0:
        return 's'
    units = 's', 'ms', 'us', 'ns'
    return next((u for k, u in enumerate(units) if lasts / 1000**k < 3 * 86_400), 's')


def nanoseconds(text: str) -> int:
    """Convert a decimal number of seconds to nanoseconds exactly."""
    return round(Decimal(text) * NANOSECONDS)


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
