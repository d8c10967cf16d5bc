"""Small pieces of HTML; all text is escaped here."""

from collections.abc import Iterable, Mapping, Sequence
from html import escape
import re

#: A number and its unit stay on one line.
_UNITS = re.compile(r'(?<=\d) (?=(?:N m|N|°C|K|%|h|min|s)(?!\w))')


def text(tag: str, content: str, **attributes: str) -> str:
    """
    Write an element that holds text.

    Parameters
    ----------
    tag : str
        Its name.
    content : str
        Plain text.
    **attributes : str
        By name; ``class_`` stands for class.

    Returns
    -------
    str
        HTML.

    """
    joined = _UNITS.sub('\N{NO-BREAK SPACE}', content).replace('N m', 'N\N{NO-BREAK SPACE}m')
    return element(tag, escape(joined), **attributes)


def element(tag: str, inside: str, **attributes: str) -> str:
    """Write an element around HTML; attributes as for text."""
    written = ''.join(
        f' {name.rstrip("_")}="{escape(value)}"' for name, value in attributes.items()
    )
    return f'<{tag}{written}>{inside}</{tag}>'


def bullets(sentences: Iterable[str]) -> str:
    """Write a list of sentences."""
    return element('ul', ''.join(text('li', sentence) for sentence in sentences))


def facts(pairs: Mapping[str, str]) -> str:
    """Write names and what they stand for."""
    return element('dl', ''.join(text('dt', k) + text('dd', v) for k, v in pairs.items()))


def table(
    caption: str, header: Sequence[str], rows: Iterable[Sequence[str]], **attributes: str
) -> str:
    """
    Write a table whose first column names the rows.

    Parameters
    ----------
    caption : str
        What it holds.
    header : sequence of str
        Column titles.
    rows : iterable of sequences of str
        Cells.
    **attributes : str
        As for text.

    Returns
    -------
    str
        HTML.

    """
    titles = ''.join(text('th', title, scope='col') for title in header)
    lines = (
        text('th', first, scope='row') + ''.join(text('td', cell) for cell in cells)
        for first, *cells in rows
    )
    body = ''.join(element('tr', line) for line in lines)
    head = element('thead', element('tr', titles))
    inside = text('caption', caption) + head + element('tbody', body)
    return element('table', inside, **attributes)


def number(value: float) -> str:
    """Write a number with four digits that count, as the command line does."""
    if value != value:  # noqa: PLR0124 -- NaN
        return '–'
    return f'{value:.0f}' if abs(value) >= 1000 else f'{value:.4g}'


def duration(seconds: float, error: float | None = None) -> str:
    """Write a time for people, and its standard error in the same unit."""
    unit, size, digits = 's', 1, 0
    if seconds >= 120:
        unit, size, digits = ('min', 60, 1) if seconds < 7200 else ('h', 3600, 1)
    spread = '' if error is None else f' ± {error / size:.{digits}f}'
    return f'{seconds / size:.{digits}f}{spread} {unit}'
