"""What commands print: tables, sentences, warnings, bars, and the same as JSON for scripts."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
import json
import re
import sys
import textwrap
from typing import Any, TYPE_CHECKING

from wrist_ft_comp.report.report_content import MOST_ADVICE, ReportContent
from wrist_ft_comp.report.verdict import LEVEL_NAMES
from wrist_ft_comp.series import Progress
from wrist_ft_comp.stored.own_file import to_plain

if TYPE_CHECKING:
    from rich.table import Table as RichTable

# rich is imported where something is drawn: most of what scripts ask for needs none of it.

#: Letters in a line; narrower terminals get narrower tables.
WIDTH = 80
#: Wider than any table, letters.
_UNLIMITED = 10_000
#: Colours of words that judge, where a terminal has any.
_STYLES = {
    **dict.fromkeys(LEVEL_NAMES.values(), 'dim'),
    LEVEL_NAMES['good']: 'bold green', LEVEL_NAMES['weak']: 'bold yellow',
    LEVEL_NAMES['harmful']: 'bold red', 'ok': 'green', 'WARNING': 'bold yellow',
    'ERROR': 'bold red', 'STALE': 'bold red',
}  # fmt: skip
_NUMBER = re.compile(r'-?\d+(\.\d+)?|[-–]|')


@dataclass(frozen=True)
class Table:
    """Texts in rows: words to the left, numbers to the right, aligned at their points."""

    titles: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclass(frozen=True)
class Result:
    """The result of a command."""

    #: Lines, printed as they are, and tables.
    words: Sequence[str | Table]
    #: All of it, and what else a script may want.
    document: Mapping[str, object]
    #: What a person should know besides; a script finds it in the document.
    warnings: Sequence[str] = ()


def print_result(result: Result, *, as_json: bool) -> None:
    """Print a result, in words or as JSON."""
    if as_json:
        print_json(result.document)
        return
    print_words(result.words)
    # Of two warnings that begin alike, the longer one only.
    distinct = dict.fromkeys(result.warnings)
    for sentence in distinct:
        if not any(other != sentence and other.startswith(sentence) for other in distinct):
            print(f'warning: {sentence}', file=sys.stderr)


def print_words(words: Iterable[str | Table]) -> None:
    """Print lines as they are, so that commands can be copied, and tables."""
    from rich.console import Console  # noqa: PLC0415 -- see above

    console = Console(highlight=False)
    width = min(WIDTH, console.width)
    with console.capture() as text:  # what rich writes itself ends the process at a broken pipe
        for part in renderables(words):
            if hasattr(part, 'add_row'):
                # Names, which people copy, may make it as wide as they are.
                names = any(column.overflow == 'ignore' for column in part.columns)
                console.width = _UNLIMITED if names else width
                console.print(part, width=console.measure(part).maximum)
            else:
                console.print(part, soft_wrap=True)
    print(re.sub(' +$', '', text.get(), flags=re.MULTILINE), end='')


def renderables(words: Iterable[str | Table]) -> Iterator[Any]:
    """Give what rich draws: lines in the colour of their first word, and tables."""
    from rich.text import Text  # noqa: PLC0415 -- see above

    for part in words:
        if isinstance(part, str):
            yield Text(part, _STYLES.get(part.partition(' ')[0], ''))
        else:
            yield rich_table(part)


def print_json(value: object) -> None:
    """Print JSON for scripts; numbers that are not finite become null."""
    print(json.dumps(to_plain(value), indent=1, allow_nan=False, default=str))


def content_words(
    content: ReportContent, *, verbose: bool = False, advice: int = MOST_ADVICE
) -> list[str | Table]:
    """Say whether it is good, and what to do next: the first things, or all and why."""
    sparks = [axis.series.sparkline() for axis in content.axes]
    rows = [[*row, spark] for row, spark in zip(content.rows, sparks, strict=True)]
    words: list[str | Table] = [Table([*content.titles, 'left over time'], rows)]
    words.append(filled(f'before, left: root mean square. {content.conditions}'))
    words += map(filled, content.payloads.lines() if content.payloads else ())
    if verbose:
        words += ['', *(filled(a.verdict.sentence, f'{a.axis}: ') for a in content.axes)]
        words += ['', filled(content.explanation)]
    steps = content.advice if verbose else content.advice[:advice]
    if steps:
        words += ['', 'What to do next:']
        words += [filled(sentence, f'{n}. ') for n, sentence in enumerate(steps, start=1)]
    return words


def filled(sentence: str, begin: str = '') -> str:
    """Break a sentence at the width, indented below its beginning; commands in it stay whole."""
    indent = ' ' * len(begin)
    head, *commands = sentence.splitlines() or ['']
    whole = textwrap.fill(
        begin + head, WIDTH, subsequent_indent=indent,
        break_long_words=False, break_on_hyphens=False)  # fmt: skip
    return '\n'.join([whole, *(indent + command for command in commands)])


def rich_table(table: Table) -> 'RichTable':
    """Lay a table out for rich."""
    from rich.table import Table as RichTable  # noqa: PLC0415 -- see above
    from rich.text import Text  # noqa: PLC0415

    columns = [list(column) for column in zip(*table.rows, strict=True)]
    columns = columns or [[] for _ in table.titles]
    drawn = RichTable(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style='bold')
    for title, cells in zip(table.titles, columns, strict=True):
        words = any(re.match(r'[^-–\d]', cell) for cell in cells)
        names = any('/' in cell for cell in cells)  # which people copy
        if cells and all(map(_NUMBER.fullmatch, cells)):
            # As wide as one another, so that points are below points.
            places = [len(cell.partition('.')[2]) + ('.' in cell) for cell in cells]
            padded = [c + ' ' * (max(places) - n) for c, n in zip(cells, places, strict=True)]
            width = max(map(len, [title, *padded]))
            cells[:] = [cell.rjust(width) for cell in padded]
            drawn.add_column(title.rjust(width), no_wrap=True)
        else:
            drawn.add_column(
                title, justify='left' if words else 'right', no_wrap=names,
                overflow='ignore' if names else 'fold')  # fmt: skip
    for row in zip(*columns, strict=True):
        drawn.add_row(*(Text(cell, _STYLES.get(cell, '')) for cell in row))
    return drawn


@contextmanager
def progress_bar(what: str) -> Iterator[Progress]:
    """Show a bar where a terminal is; yields what is told the share that is done."""
    with _bar(what, 1.0) as update:
        yield lambda share: update(completed=share)


@contextmanager
def waiting(what: str) -> Iterator[Callable[[str], None]]:
    """Show what is waited for, and how long already; yields what is told how it goes on."""
    with _bar(what, None) as update:
        yield lambda text: update(description=text[: WIDTH - 40])


@contextmanager
def _bar(what: str, total: float | None) -> Iterator[Callable[..., None]]:
    """Show a bar that is wiped away in the end, with lines of a log above it."""
    if not sys.stderr.isatty():
        yield lambda **_: None
        return
    from rich import progress  # noqa: PLC0415 -- see above
    from rich.console import Console  # noqa: PLC0415

    columns = [progress.TextColumn('{task.description}', markup=False), progress.BarColumn()]
    if total is not None:
        columns.append(progress.TaskProgressColumn())
    columns.append(progress.TimeElapsedColumn())
    with progress.Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=total)
        yield lambda **news: bar.update(task, **news)
