"""What separates the cells of a table, which line names its columns, and where its rows begin."""

from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
import csv
from dataclasses import dataclass
from math import nan
import re

from wrist_ft_comp.recordings.column_map import plain_unit, UNIT_WORDS

#: Lines in which the header is looked for, and the last of them that show what rows are like.
FIRST_LINES, _LIKE_ROWS = 300, 30
COMMENTS = '#', '%', '//'
#: What stands in a cell that has no value, in small letters.
MISSING = frozenset({
    '', '-', '--', '---', 'nan', '-nan', 'na', 'n/a', '#n/a', 'null', 'none', '?', '<na>', 'nat',
})  # fmt: skip
NUMBER = re.compile(r'[-+]?(\d+([.,]\d*)?|[.,]\d+)([eE][-+]?\d+)?|[-+]?inf(inity)?', re.IGNORECASE)
_TIME = re.compile(
    r'(\d{1,4}[-./]\w{1,3}[-./]\d{1,4})?([T ]?\d{1,2}:\d\d(:\d\d([.,]\d+)?)?( ?[AP]M)?)?'
    r'(Z|[-+]\d\d:?\d\d)?'
)
#: Words of rows below a header that say what a recorder did to the samples.
_STATISTICS = {'avg', 'smp', 'min', 'max', 'std', 'mean', 'ts', 'rn', 'count', 'median', 'tot'}


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
    #: Units in a row of their own, or in a column behind that of the numbers; or empty.
    units: tuple[str, ...]
    #: The header and what stands between it and the rows; some recorders repeat it.
    rows_above: frozenset[tuple[str, ...]]


def find_header(lines: Sequence[str]) -> Header:
    """Find how a table is laid out from its first lines."""
    at = [k for k, line in enumerate(lines) if line.strip() and not line.startswith(COMMENTS)]
    last_lines = [lines[k] for k in at[-_LIKE_ROWS:]]
    delimiter = max(',;\t| ', key=lambda sign: _fit(last_lines, sign))
    last = [cut_line(line, delimiter) for line in last_lines]
    width = Counter(map(len, last)).most_common(1)[0][0] if last else 0
    last = [row for row in last if len(row) == width]
    columns = list(zip(*last, strict=True))

    # The first row is as wide and has a value wherever most of the last lines have one.
    must = [k for k, cells in enumerate(columns) if 2 * sum(map(_is_value, cells)) >= len(cells)]
    for first in at:
        row = cut_line(lines[first], delimiter)
        has_number = len(row) == width and any(map(NUMBER.fullmatch, row))
        if has_number and all(_is_value(row[place]) for place in must):
            break
    else:
        first = len(lines)

    # Above it are rows as wide: of units, of what was done to the samples, and one of names.
    above: list[list[str]] = []
    for line in reversed(lines[:first]):
        is_comment = line.startswith(COMMENTS)
        cells = cut_line(line.lstrip('#%/') if is_comment else line, delimiter)
        while cells and not cells[-1]:
            cells.pop()
        if cells and len(cells) <= width + 1 and not any(any(row[len(cells) :]) for row in last):
            above.append(cells)
        elif cells and (above or not is_comment):
            break
    names = next((row for row in above if not _says_units(row)), above[-1] if above else [])
    units = next((row for row in above if row is not names and _has_unit(row)), [])
    if not units:
        beside = (column[0] if len({*column}) == 1 else '' for column in columns[1:])
        units = [cell if _has_unit([cell]) else '' for cell in beside]
    size = max(width, len(names))
    names = [*names, *[''] * (size - len(names))] if names else [str(k + 1) for k in range(size)]
    rows_above = frozenset(map(tuple, above))
    return Header(delimiter, width, first, tuple(names), tuple(units), rows_above)


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
    if not NUMBER.fullmatch(cell):
        raise ValueError(cell)
    return float(cell if delimiter == ',' else cell.replace(',', '.'))


def _fit(lines: Sequence[str], delimiter: str) -> float:
    """Tell how well lines are rows of values, or of anything, if a sign separates their cells."""
    rows = [cut_line(line, delimiter) for line in lines]
    width = Counter(map(len, rows)).most_common(1)[0][0] if rows else 0
    values = sum(sum(map(_is_value, row)) for row in rows if len(row) == width > 1)
    return values / max(len(rows) * width, 1) or 1e-6 * width


def _is_value(cell: str) -> bool:
    """Whether a cell holds a number or a time, or says that it holds none."""
    return cell.lower() in MISSING or bool(NUMBER.fullmatch(cell) or _TIME.fullmatch(cell))


def _has_unit(row: Sequence[str]) -> bool:
    return any(plain_unit(cell) in UNIT_WORDS for cell in row)


def _says_units(row: Sequence[str]) -> bool:
    """Whether most of a row above the first one are units, statistics or numbers."""
    known = [_has_unit([c]) or c.lower() in _STATISTICS or _is_value(c) for c in row if c]
    return 2 * sum(known) >= len(known)
