"""Which line of a CSV file is its header, and how cells are separated."""

from collections import deque
from collections.abc import Iterable, Sequence
from contextlib import suppress
import csv
from itertools import islice
from pathlib import Path
import re

#: Characters of the longest line that a recording may have.
LONGEST_LINE = 1_000_000
#: Rows below a header, and comments above the first row, that tell which line is the header.
_FIRST_ROWS = 20


def is_comment(line: str) -> bool:
    """Tell whether a line begins with a sign of comments."""
    return line.startswith(('#', '%', '//'))


def is_number(cell: str) -> bool:
    """Tell whether a cell holds nothing but a number."""
    return bool(re.fullmatch(r'[-+.,\d]*\d[-+.,\deE]*', cell.strip()))


def find_header(lines: Iterable[str]) -> tuple[str, int, list[str]]:
    """
    Find the header, how many lines stand above it, and the first rows below it.

    The header is the first line that is no comment. Where that holds a number, it is a row, and
    the header is the first comment above it of as many cells, none of which is a number, if any.
    """
    comments: deque[tuple[str, int]] = deque(maxlen=_FIRST_ROWS)
    rest = iter(lines)
    for above, line in enumerate(rest):
        if is_comment(line):
            comments.append((line, above))
        elif line.strip():
            rows = list(islice((r for r in rest if r.strip() and not is_comment(r)), _FIRST_ROWS))
            for comment, at in comments:
                names, row = cells_of([comment, line])
                is_row = len(names) == len(row) > 1 and any(map(is_number, row))
                if is_row and not any(map(is_number, names)):
                    return comment, at, [line, *rows]
            return line, above, rows
    return '', 0, []


def _column_names(header: str) -> str:
    """Take the sign of comments off a header that stands behind one."""
    return (header.lstrip('#%/') if is_comment(header) else header).strip()


def cells_of(lines: Sequence[str]) -> list[list[str]]:
    """Cut a header and rows below it into cells."""
    header, *rows = lines
    cut = csv.reader(
        [_column_names(header), *rows], delimiter=delimiter_of(header), skipinitialspace=True
    )
    return [[cell.strip() for cell in row] for row in cut]


def delimiter_of(header: str) -> str:
    """Tell what separates cells: a comma, semicolon or tab; spaces where there is none of them."""
    names = _column_names(header)
    delimiter = max(',;\t', key=names.count)
    return delimiter if delimiter in names or ' ' not in names else ' '


def first_rows(path: Path) -> tuple[list[str], list[str]]:
    """Read the cells of a file's header and of its first row; none where there are none."""
    with path.open(encoding='utf-8-sig', errors='replace') as text, suppress(csv.Error):
        header, _, rows = find_header(line[:LONGEST_LINE] for line in text)
        cells = cells_of([header, *rows[:1]])
        return cells[0], cells[1] if rows else []
    return [], []
