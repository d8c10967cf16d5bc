"""Tables in Markdown."""

from collections.abc import Iterable, Sequence


def table(titles: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """
    Lay out a table.

    Parameters
    ----------
    titles : sequence of str
        Titles of the columns.
    rows : iterable of sequence of str
        Cells.

    Returns
    -------
    str
        Lines of Markdown.

    """
    lines = [titles, ['---'] * len(titles), *rows]
    escaped = ([cell.replace('|', '\\|') for cell in row] for row in lines)
    return '\n'.join(f'| {" | ".join(row)} |' for row in escaped)
