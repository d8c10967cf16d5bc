"""What commands print: tables, sentences, warnings, bars, and the same as JSON for scripts."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
import json
import re
import sys
import textwrap

from rich import progress as bars
from rich.console import Console
from rich.table import Table
from rich.text import Text

from wrist_ft_comp.report.report_content import MOST_ADVICE, ReportContent
from wrist_ft_comp.report.verdict import LEVEL_NAMES
from wrist_ft_comp.series import Progress
from wrist_ft_comp.stored.safe_file import to_plain

#: Letters in a line.
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


def print_result(
    words: Iterable[str | Table], document: object, warnings: Iterable[str] = (), *, as_json: bool
) -> None:
    """Print the result of a command: lines and tables, and warnings; or JSON, which has it all."""
    if as_json:
        print_json(document)
        return
    print_words(words)
    for sentence in dict.fromkeys(warnings):
        print(f'warning: {sentence}', file=sys.stderr)


def print_words(words: Iterable[str | Table]) -> None:
    """Print lines as they are, so that commands can be copied, and tables."""
    console = Console(highlight=False, width=_UNLIMITED)
    with console.capture() as text:  # what rich writes itself ends the process at a broken pipe
        for part in coloured(words):
            # Names, which people copy, may make a table as wide as they are.
            wide = isinstance(part, Table) and any(column.no_wrap for column in part.columns)
            console.print(part, width=_UNLIMITED if wide else WIDTH, soft_wrap=True)
    print(re.sub(' +$', '', text.get(), flags=re.MULTILINE), end='')


def coloured(words: Iterable[str | Table]) -> Iterator[Text | Table]:
    """Give lines the colour of their first word."""
    for one in words:
        yield Text(one, _STYLES.get(one.partition(' ')[0], '')) if isinstance(one, str) else one


def print_json(value: object) -> None:
    """Print JSON for scripts; numbers that are not finite become null."""
    print(json.dumps(to_plain(value), indent=1, allow_nan=False, default=str))


def content_words(content: ReportContent, advice: int = MOST_ADVICE) -> list[str | Table]:
    """Say whether it is good, and the first things to do next."""
    words: list[str | Table] = [table(content.titles, content.rows), filled(content.footer)]
    words += map(filled, content.payloads.lines() if content.payloads else ())
    if steps := content.advice[:advice]:
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


def table(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    """Lay texts out: words to the left, numbers to the right."""
    drawn = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style='bold')
    columns = list(zip(titles, *rows, strict=True))
    names = any('/' in cell for row in rows for cell in row)  # which people copy
    for cells in columns:
        words = any(re.match(r'[^-–\d]', cell) for cell in cells[1:])
        drawn.add_column(
            cells[0], justify='left' if words else 'right', no_wrap=names,
            overflow='ignore' if names else 'fold')  # fmt: skip
    if sum(max(map(len, cells)) + 2 for cells in columns) - 2 > WIDTH:
        drawn.padding = (0, 1, 0, 0)
    for row in rows:
        drawn.add_row(*(Text(cell, _STYLES.get(cell, '')) for cell in row))
    return drawn


@contextmanager
def progress_bar(what: str) -> Iterator[Progress]:
    """Show a bar where a terminal is, and wipe it away; yields what is told the share done."""
    with bars.Progress(
        bars.TextColumn('{task.description}', markup=False), bars.BarColumn(),
        bars.TaskProgressColumn(), bars.TimeElapsedColumn(), console=Console(stderr=True),
        transient=True, disable=not sys.stderr.isatty(),
    ) as bar:  # fmt: skip
        task = bar.add_task(what, total=1.0)
        yield lambda share: bar.update(task, completed=share)
