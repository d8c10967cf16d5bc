"""How a table is written: delimiter, header, units, numbers, and the forms of its times."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
import csv
from dataclasses import dataclass, field
from datetime import datetime
from decimal import Decimal
from math import nan
import re
from statistics import mode
from typing import Any

import numpy as np

from wrist_ft_comp import units
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.series import FloatArray, IntArray, NANOSECONDS
from wrist_ft_comp.units import plain_unit, TIME_UNITS_NS

#: Lines in which the header is looked for, and the last of them that show what rows are like.
FIRST_LINES, _LIKE_ROWS = 300, 30
COMMENTS = '#', '%', '//'
#: What may stand between cells.
_SIGNS = ',;\t| '
#: What stands in a cell that has no value, in small letters.
MISSING = frozenset({
    '', '-', '--', '---', 'nan', '-nan', 'na', 'n/a', '#n/a', 'null', 'none', '?', '<na>', 'nat',
})  # fmt: skip
NUMBER = re.compile(r'[-+]?(\d+([.,]\d*)?|[.,]\d+)([eE][-+]?\d+)?|[-+]?inf(inity)?', re.IGNORECASE)
#: A number with one sign in it, or with two, of which the last one is that of decimals.
_DECIMALS = re.compile(
    r'[-+]?\d*(?:(?P<other>[.,])\d+)?(?P<last>[.,])(?P<digits>\d*)(?:[eE][-+]?\d+)?'
)
#: A number with thousands, and their sign.
_WITH_THOUSANDS = re.compile(
    r'[-+]?[1-9]\d{0,2}(?P<sign>[.,])\d{3}(?:(?P=sign)\d{3})*(?:(?!(?P=sign))[.,]\d*)?'
)
#: 3.1 N: a number, and what stands behind it.
_WITH_UNIT = re.compile(rf'(?:{NUMBER.pattern})(?: ?(?P<unit>[^\d\s.,:;+-]\D*))?', re.IGNORECASE)
#: What looks like a time: digits, signs between some of them, and words of up to three letters.
_TIME = re.compile(
    r'(?=.*\d[-/:]\w|.*\d\.\d+\.\d|\d{8}T)'
    r'[\d\s:./,+_-]*(?:[A-Z]{1,3}(?![A-Z])[\d\s:./,+_-]*)*', re.IGNORECASE)  # fmt: skip
#: Forms of days, by what comes first in them, and of times of day.
_DAY_FIRST = (
    '%d.%m.%Y', '%d/%m/%Y', '%d-%m-%Y', '%d-%b-%Y', '%d %b %Y', '%Y/%m/%d', '%Y-%m-%d',
    '%d.%m.%y', '%d/%m/%y', '%d-%m-%y', '%d-%b-%y', '%y-%m-%d', '%y/%m/%d',
)  # fmt: skip
_MONTH_FIRST = '%m/%d/%Y', '%m-%d-%Y', '%m/%d/%y', '%m-%d-%y'
_CLOCKS = (
    '%H:%M:%S', '%H:%M:%S.%f', '%H:%M:%S:%f', '%H:%M', '%H.%M.%S', '%I:%M:%S %p',
    '%I:%M:%S.%f %p', '%I:%M:%S%p', '%I:%M %p',
)  # fmt: skip
#: A day, what joins it, and a time of day.
_DAY_AND_CLOCK = re.compile(r'(?:(\d[\w ./-]*?\d)(\. |[T /_-]))?(\d{1,2}[:.]\d\d.*)')
#: Words of rows below a header, or below the samples, that say what was made of the samples.
_STATISTICS = {
    'avg', 'smp', 'min', 'max', 'std', 'mean', 'ts', 'rn', 'count', 'median', 'tot', 'average',
    'minimum', 'maximum', 'stdev', 'std dev', 'rms', 'mittelwert', 'standardabweichung',
}  # fmt: skip
#: What tells, behind a line end, a line that may hold statistics or a comment, whatever its cells.
NO_SAMPLE = re.compile(rf'\n(?!\d)(?:[#%]|//|\W*(?i:{"|".join(_STATISTICS)})\b)')
#: Lines above the header that say in which unit, or how many counts, forces or torques are.
_UNIT_LINE = re.compile(r'(force|torque) units?\W+([a-z-]+)', re.IGNORECASE)
_COUNTS_LINE = re.compile(r'counts per (?:unit )?(force|torque)\W+([\d.]+)', re.IGNORECASE)
_SCALE = re.compile(r'counts?\s*(/|per|=)|(?<!full )\bscal(e|ing)|skalier|faktor', re.IGNORECASE)
_UNIT_ROW = re.compile(r'(y_)?(units?|einheit(en)?)(_label)?', re.IGNORECASE)
#: Lines above that say what a column is, by its number: COL 2: FX (N).
_NUMBERED = re.compile(
    r'\W*(?:chan(?:nel)?|ch|col(?:umn)?|kanal|spalte)?[ ._]*(\d+)\W+(\S.*)', re.IGNORECASE
)
#: A label in a cell: Fz=12.3, T: 25.1C.
_LABEL = re.compile(r'(?<![^\s,;|"])([^\W\d]\w*) ?[=:] ?(?=[-+.]?\d)')
#: What is replaced in all lines, by what, and how often the last one has it at least: arrows by
#: the sign between the cells behind it, blanks behind a sign of numbers, and labels.
_REPLACED = (
    (re.compile(r' -> (?=[^,;|\t\n]*([;|\t]))'), r'\1', 1),
    (re.compile(r' -> (?=[^,\n]*$)', re.MULTILINE), ' ', 1), (re.compile(' -> '), ',', 1),
    (re.compile('(?<=[,;\t"])([-+]) +(?=[\\d.])'), r'\1', 1), (_LABEL, '', 2),
)  # fmt: skip
#: A time since the beginning, which has no more than minutes and seconds, or any number of hours.
_ELAPSED = re.compile(r'\d+:\d\d(:\d\d)?([.,]\d+)?')
#: Stamps that are looked at for their form.
_LOOKED_AT = 500
#: Stamps from 2001 on have at least this size in seconds, and up to 9.2 times as much, where
#: nanoseconds of 64 bits end; in a smaller unit they are as much larger.
_EPOCH_S, _EPOCH_RANGE, _SMALLER = 1e9, 9.2, ('s', 'ms', 'us', 'ns')
#: When a log was probably written: from 2010 to 2040, days since 1970.
LIKELY_DAYS = 14_610, 25_567
DAY_NS = 86_400 * NANOSECONDS


@dataclass(frozen=True)
class Header:
    """How a table is laid out."""

    delimiter: str = ','
    #: Number of cells in a row; names may be one more, which have no cells.
    width: int = 0
    #: How many lines stand above the first row.
    lines_above: int = 0
    #: What the columns are called: by their numbers, from 1 on, where no line names them.
    names: tuple[str, ...] = ()
    #: How many columns other tables, which are joined before it, have; numbers go on.
    columns_before: int = 0
    #: By place: units in a row of their own, or behind the numbers of the first row.
    units: Mapping[int, str] = field(default_factory=dict)
    #: What lines above the rows begin with, and rows do not; some recorders repeat them.
    words_above: frozenset[str] = frozenset()
    #: Place of the first cell that has a value in most rows, such as a time; in statistics none.
    first_value: int = 0
    #: What lines above say of 'force' and 'torque', as a map has it behind a column: *1e-06:N.
    said: Mapping[str, str] = field(default_factory=dict)
    #: A line above that tells of another unit than N and N m, or of a scale, but not of whose.
    doubt: str = ''
    #: By place: what lines above, or labels in cells, say of a column.
    told: Mapping[int, str] = field(default_factory=dict)
    #: What is written otherwise elsewhere: arrows of a terminal, labels and units in cells.
    replaced: tuple[tuple[re.Pattern[str], str], ...] = ()
    #: The sign before decimals, and the one between thousands; empty where it is not known.
    decimal: str = '.'
    thousands: str = ''

    def plain_text(self, text: str) -> str:
        """Write numbers and cells as they are written elsewhere."""
        text = text.replace('\u2212', '-')  # a minus as it is printed
        for pattern, plain in self.replaced:
            text = pattern.sub(plain, text)
        return text

    def is_sample(self, row: Sequence[str]) -> bool:
        """Whether a row is neither empty, nor a header that is repeated, nor statistics."""
        first = next(filter(None, row), '')
        begins = filter(None, row[: self.first_value + 1])
        is_told = first.lower().rstrip(':') in _STATISTICS and not any(map(_is_value, begins))
        return bool(first) and not is_told and first not in self.words_above

    def is_other(self, row: Sequence[str]) -> bool:
        """Whether a row is a header, but not this one that is repeated."""
        words, names = [*filter(None, row)], [*filter(None, self.names)]
        return words[:1] == names[:1] and words != names

    def title(self, place: int) -> str:
        """Give all that is said of a column: its name, if it has one, and what is told."""
        name, told = self.names[place], self.told.get(place, '')
        return told if told and name.isdecimal() else f'{name} {told}'.strip()

    def without_thousands(self, cell: str) -> str:
        """Leave the signs between thousands out, where they are some."""
        if not self.thousands or self.thousands not in cell:
            return cell
        match = _WITH_THOUSANDS.fullmatch(cell)
        is_theirs = match and match['sign'] == self.thousands
        return cell.replace(self.thousands, '') if is_theirs else cell

    def number_in(self, cell: str) -> float:
        """Read a number; a missing one is NaN. ValueError where it is none."""
        if cell.lower() in MISSING:
            return nan
        plain = self.without_thousands(cell)
        if not NUMBER.fullmatch(plain) or (self.thousands and self.thousands in plain):
            raise ValueError(cell)
        return float(plain.replace(',', '.'))


def find_header(as_written: Sequence[str], columns_before: int, table: str) -> Header:
    """Find how a table is laid out from its first lines; RecordingError if decimals are cells."""
    last_line = next(line for line in reversed(as_written) if line.strip())
    replaced = [(what, by) for what, by, n in _REPLACED if len(what.findall(last_line)) >= n]
    lines = [Header(replaced=tuple(replaced)).plain_text(line) for line in as_written]
    at = [k for k, line in enumerate(lines) if line.strip() and not line.startswith(COMMENTS)]
    last_lines = [lines[k] for k in at[-_LIKE_ROWS:]]
    alike = {sign: _of_one_width([cut_line(line, sign) for line in last_lines]) for sign in _SIGNS}

    # How well lines are rows of values, or of anything.
    def fit(delimiter: str) -> float:
        cells = [cell for row in alike[delimiter] for cell in row if len(row) > 1]
        width = max(map(len, alike[delimiter]), default=0)
        return sum(map(_is_value, cells)) / max(len(last_lines) * width, 1) or 1e-6 * width

    delimiter = max(_SIGNS, key=fit)
    rows, last = [cut_line(line, delimiter) for line in lines], alike[delimiter]
    columns = list(zip(*last, strict=True))
    width = len(columns)

    # The first row is as wide and has a value wherever most of the last lines have one.
    values = [sum(map(_is_value, filter(None, cells))) for cells in columns]
    must = [place for place, count in enumerate(values) if 2 * count >= len(last)]

    def is_row(cells: list[str]) -> bool:
        has_number = any(unit_behind(cell) is not None for cell in cells)
        return len(cells) == width and has_number and all(_is_value(cells[k]) for k in must)

    first = next((k for k in at if is_row(rows[k])), len(lines))

    lines_above = [line for line in lines[:first] if line.strip('-=+|_ \t')]
    told = _numbered(lines_above, width)
    filled = max((k + 1 for k, cells in enumerate(columns) if any(cells)), default=0)
    above = _rows_above([] if told else lines_above, filled, width, delimiter)
    names = next(filter(_is_of_names, above), above[-1] if above else [])
    widest = max(map(len, rows[:first]), default=width)
    has_points = any('.' in cell for row in last for cell in row if NUMBER.fullmatch(cell))
    # A decimal comma makes two cells of one.
    are_cut = delimiter == ',' and not has_points and widest + 1 < filled <= 2 * widest
    if names and are_cut:
        raise RecordingError(
            f'Rows of {table} have {width} cells below {widest} names, and no decimal points. If '
            'its decimal signs are commas, save it with points, or with semicolons between '
            'cells; if not, name every column.'
        )
    in_cells = [unit_behind(cell) or '' for row in rows[first : first + 1] for cell in row]
    others = [k for k in range(first) if [*filter(None, rows[k])] != [*filter(None, names)]]
    labelled = [['', *row[1:]] for row in rows[:first] if row and _UNIT_ROW.fullmatch(row[0])]
    said = [
        max((row for row in above if row is not names), key=_units_in, default=[]),
        *labelled,
        in_cells,
        # A cell that is merged in a spreadsheet tells of those behind it, which are empty.
        *(_merged_units(rows[k]) for k in others if len(rows[k]) == width),
    ]
    said_units = next(filter(_units_in, said), labelled[0] if labelled else [])
    doubts = (lines[k] for k in others if rows[k] != said_units and _is_doubtful(lines[k]))
    for row in rows[:first]:
        if len(row) > 1 and row[0] and row[0] in names and row not in above:
            unit = next((f' [{cell}]' for cell in row[2:] if _units_in([cell])), '')
            told[names.index(row[0])] = row[1] + unit
    arrows = Header(replaced=tuple(pair for pair in replaced if pair[0] is not _LABEL))
    for line in as_written[first : first + 1]:
        cells = cut_line(_LABEL.sub(r'\1=', arrows.plain_text(line)), delimiter)
        labels = {k: cell.partition('=')[0] for k, cell in enumerate(cells) if '=' in cell}
        told |= labels if len(labels) > 1 else {}
    if words := '|'.join({*map(re.escape, in_cells)} - {''}):
        replaced.append((re.compile(rf'(?<=\d) ?(?:{words})(?=["{delimiter}\s])'), ''))
    numbers = [str(columns_before + k + 1) for k in range(width)]
    names = [*names, *[''] * (width - len(names))] if names else numbers
    decimal, thousands = _find_decimals([cell for row in last for cell in row])
    text = '\n'.join(lines[:first])
    begins = [next(filter(None, row), '') for row in rows]
    of_rows = {begins[k] for k in at if is_row(rows[k])}
    counts = {word.lower(): f'*{1 / float(n):g}' for word, n in _COUNTS_LINE.findall(text)}
    return Header(
        delimiter=delimiter, width=width, lines_above=first, names=tuple(names), told=told,
        columns_before=columns_before, replaced=tuple(replaced), first_value=min(must, default=0),
        units={place: unit.strip('()') for place, unit in enumerate(said_units) if unit},
        words_above=frozenset(word for word in begins[:first] if not _is_value(word)) - of_rows,
        said={
            word.lower(): f'{counts.get(word.lower(), "")}:{plain_unit(unit)}'
            for word, unit in _UNIT_LINE.findall(text) if plain_unit(unit) in units.UNIT_WORDS
        },
        doubt=next(doubts, ''), decimal=decimal, thousands=thousands)  # fmt: skip


def _rows_above(lines: Sequence[str], filled: int, width: int, delimiter: str) -> list[list[str]]:
    """Cut those next to the first row that are as wide: of units, of statistics, and of names."""
    above: list[list[str]] = []
    for line in reversed(lines):
        is_comment = line.startswith(COMMENTS)
        cells = cut_line(line.lstrip('#%/') if is_comment else line, delimiter)
        # What has fewer cells than the rows have values lacks those of the first columns.
        cells = cells if len(cells) < 2 else [*[''] * (filled - len(cells)), *cells]
        while cells and not cells[-1]:
            cells.pop()
        if cells and filled <= len(cells) <= width + 1:
            above.append(cells)
        elif cells and (above or not is_comment):
            break
    return above


def _numbered(lines: Sequence[str], width: int) -> dict[int, str]:
    """Find what the last lines say of columns, by numbers; a time, the first, may have none."""
    for count in (width, width - 1) if width > 2 else ():
        found = [_NUMBERED.fullmatch(line) for line in lines[-count:]]
        if [match and int(match[1]) for match in found] == list(range(1, count + 1)):
            return {k + width - count: match[2] for k, match in enumerate(found) if match}
    return {}


def _of_one_width(rows: list[list[str]]) -> list[list[str]]:
    """Keep the rows that have as many cells as most."""
    width = mode(map(len, rows)) if rows else 0
    return [row for row in rows if len(row) == width]


def _is_of_names(row: list[str]) -> bool:
    """Whether most cells are no units, no values, and no words of statistics."""
    words = _STATISTICS | {'v', 'mv'}
    told = [_units_in([c]) or c.lower() in words or _is_value(c) for c in row if c]
    return 2 * sum(told) < len(told)


def _find_decimals(cells: Sequence[str]) -> tuple[str, str]:
    """Find the sign of decimals, and that of thousands, or '' where none is there for sure."""
    signs = [match for match in map(_DECIMALS.fullmatch, cells) if match and match[1] != match[2]]
    decimals = {match['last'] for match in signs if match['other'] or len(match['digits']) != 3}
    if len(decimals) != 1:
        has_points = not signs or any(match['last'] == '.' for match in signs)
        return '.' if has_points else ',', ''
    (decimal,) = decimals
    return decimal, '.' if decimal == ',' else ','


def cut_line(line: str, delimiter: str) -> list[str]:
    """Cut a line into cells."""
    text = line.strip() if delimiter == ' ' else line
    with suppress(csv.Error):
        for row in csv.reader([text], delimiter=delimiter, skipinitialspace=True):
            return [cell.strip() for cell in row]
    return []


def unit_behind(cell: str) -> str | None:
    """Find the unit behind a number, empty where there is none; None where it is no number."""
    match = _WITH_UNIT.fullmatch(cell)
    unit = (match['unit'] or '') if match else '?'
    return unit if not unit or plain_unit(unit) in units.UNIT_WORDS else None


def _is_value(cell: str) -> bool:
    """Whether a cell holds a number or a time, or says that it holds none."""
    is_missing = not cell.strip('-=:') or cell.lower() in MISSING
    forms = _TIME, _WITH_THOUSANDS
    return is_missing or unit_behind(cell) is not None or any(f.fullmatch(cell) for f in forms)


def _merged_units(row: Sequence[str]) -> list[str]:
    found: list[str] = []
    for cell in row:
        words = [*map(plain_unit, units.said_units(cell)), '']
        held = found[-1] if found and not cell else ''
        found.append(held or next(word for word in words if word in {*units.UNIT_WORDS, ''}))
    return found


def _is_doubtful(line: str) -> bool:
    others = {*units.units_of('force_x'), *units.units_of('torque_x')} - {'N', 'Nm', 'g'}
    is_scaled = any(float(n) != 1 for n in re.findall(r'\d+(?:\.\d+)?', line))
    words = map(plain_unit, re.findall(rf'[^\W\d_]+(?:[{units.TIMES}][^\W\d_]+)?', line))
    return not others.isdisjoint(words) or (is_scaled and _SCALE.search(line) is not None)


def _units_in(row: Sequence[str]) -> int:
    return sum(plain_unit(cell) in units.UNIT_WORDS for cell in row)


def exact_ns(cells: Any, form: str, factor: float = 1.0) -> IntArray:
    """
    Convert texts, numbers or dates exactly to ns; texts raise Value- or ArithmeticError.

    Numbers are multiplied with the factor first, also those that are too large without.
    """
    if isinstance(cells, np.ndarray):
        if cells.dtype.kind in 'iu' and factor == 1:
            return np.asarray(cells.astype(np.int64) * TIME_UNITS_NS[form])
        is_date = cells.dtype.kind == 'M'
        scale = 1.0 if is_date else TIME_UNITS_NS[form] * factor
        numbers = cells if is_date else np.rint(cells.astype(float) * scale)
        if not np.isfinite(numbers).all():
            raise ValueError('a stamp is missing')
        return np.asarray((numbers.astype('M8[ns]') if is_date else numbers).astype(np.int64))
    texts, day = [text.replace(',', '.') for text in cells], units.DAYS_TO_1970.get(form, 0)
    if unit_ns := TIME_UNITS_NS.get('d' if day else form):
        if any('_' in text for text in texts):
            raise ValueError('1_000 is no number of a table')
        unit = unit_ns * Decimal(str(factor))
        return np.array([round((Decimal(text) - day) * unit) for text in texts], np.int64)
    import pandas  # noqa: PLC0415 -- what reads no table does not wait for it

    texts = [text.strip().removesuffix(' UTC') for text in texts]
    if form == '%H%M%S':  # a number has lost its zeros, and may have decimals
        texts, form = [f'{Decimal(text):016.9f}' for text in texts], '%H%M%S.%f'
    if form == units.TIMEDELTA:
        texts = [f'0:{text}' if text.count(':') == 1 else text for text in texts]
        return np.asarray(pandas.to_timedelta(texts).as_unit('ns').asi8)
    form = 'ISO8601' if form == 'iso' else form.replace(',', '.')
    times = pandas.to_datetime(texts, format=form, utc=True)
    if times.hasnans:
        raise ValueError('a stamp is missing')
    return np.asarray(times.as_unit('ns').asi8)


def epoch_unit(number: float) -> str:
    """Find the unit of a number since 1970 by its size; empty where it is none."""
    size = abs(number) / _EPOCH_S
    return next((u for k, u in enumerate(_SMALLER) if 1 <= size / 1000**k < _EPOCH_RANGE), '')


def find_form(stamps: Sequence[str], *, month_first: bool = False) -> str:
    """Find the unit of numbers by their size, or the form of dates; empty where there is none."""
    some = stamps[:: max(len(stamps) // _LOOKED_AT, 1)]
    filled = [text for text in some if text.lower() not in MISSING]
    if not filled:
        return ''
    if all(map(NUMBER.fullmatch, filled)):
        numbers = np.array([text.replace(',', '.') for text in filled], float)
        return epoch_unit(numbers[0]) or ('%H%M%S' if _are_clocks(numbers) else 's')
    if re.match(r'-?\d+ days?\b', filled[0]):
        return units.TIMEDELTA
    for form in ('iso', '%a %b %d %H:%M:%S %Y'):
        with suppress(ValueError):
            exact_ns(filled[:1], form)
            return form

    text = filled[0].replace(',', '.').removesuffix(' UTC')
    match = _DAY_AND_CLOCK.fullmatch(text)
    day, joint, clock = match.groups('') if match else (text, '', '')
    clocks = [f'{form}{zone}' for form in _CLOCKS for zone in ('', '%z', ' %z')]
    if not (clocks := [form for form in clocks if _is_in_form(clock, form)]):
        day, joint, clocks = text, '', ['']
    # Day and month are told by what makes times follow; where both do, by month_first.
    month_first |= '%p' in clocks[0]
    days = [*_MONTH_FIRST, *_DAY_FIRST] if month_first else [*_DAY_FIRST, *_MONTH_FIRST]
    days = [form for form in days if _is_in_form(day, form)] if day else ['']
    disorder: dict[str, int] = {}
    for form in (f'{form}{joint}{clocks[0]}' for form in days):
        with suppress(ValueError, ArithmeticError):
            stamps_ns = exact_ns(filled, form)
            runs_back = int(np.count_nonzero(np.diff(stamps_ns) < 0))
            is_odd = bool(day) and not LIKELY_DAYS[0] < stamps_ns[0] // DAY_NS < LIKELY_DAYS[1]
            disorder[form] = (10 * runs_back + is_odd) * 10**19 + int(np.ptp(stamps_ns))
    if not disorder and all(map(_ELAPSED.fullmatch, filled)):
        return units.TIMEDELTA
    return min(disorder, key=disorder.__getitem__, default='')


def _is_in_form(text: str, form: str) -> bool:
    with suppress(ValueError):
        return bool(datetime.strptime(text, form))
    return False


def _are_clocks(numbers: FloatArray) -> bool:
    """Whether numbers are 70002 at 7:00:02: they leave 60 to 99 out, by even steps of a clock."""
    if len(numbers) < 20 or not 0 <= numbers.min() <= numbers.max() < 240_000:
        return False
    hours, minutes, seconds = numbers // 10_000, numbers // 100 % 100, numbers % 100
    if (minutes >= 60).any() or (seconds >= 60).any():
        return False
    steps = np.diff(hours * 3600 + minutes * 60 + seconds) % 86_400
    return bool(np.ptp(steps) < np.ptp(np.diff(numbers)) - 1)


def unit_of_times(numbers: FloatArray) -> str:
    """Tell the unit of times that nobody named: since 1970, of a clock, or since a beginning."""
    if unit := epoch_unit(float(numbers[0])) or ('%H%M%S' if _are_clocks(numbers) else ''):
        return unit
    # Days of a spreadsheet, which are no seconds: nothing is sampled so fast.
    if len(numbers) > 100 and 0 <= numbers.min() <= numbers.max() < 1:
        return 'd' if np.median(np.diff(numbers)) < 10 / 86_400 else 's'
    steps, lasts = np.diff(numbers), float(np.ptp(numbers))
    step = float(np.median(steps)) if len(steps) else 0.0
    # A recording lasts less than three days, or its rows are minutes apart.
    if 300 <= step <= 7200 and step % 60 == 0:
        return 's'
    return next((u for k, u in enumerate(_SMALLER) if lasts / 1000**k < 3 * 86_400), 's')
