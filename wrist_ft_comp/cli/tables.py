"""Tables that fit 80 columns."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict

from wrist_ft_comp.core.chamber_fit import ChamberFigures


def table_text(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """
    Align a table, first column to the left, the others to the right.

    Parameters
    ----------
    header : sequence of str
        Column titles.
    rows : sequence of sequences of str
        Cells.

    Returns
    -------
    str
        Lines.

    """
    lines = [list(header), *(list(row) for row in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(header))]
    return '\n'.join(
        '  '.join(
            cell.ljust(width) if i == 0 else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    )


def chamber_table_text(columns: Mapping[str, ChamberFigures]) -> str:
    """
    Put the figures of several versions of a chamber table side by side.

    Parameters
    ----------
    columns : mapping of str to ChamberFigures
        By title.

    Returns
    -------
    str
        Lines.

    """
    rows = [
        ('max |K_s|, %FS/°C (eq. 23)', 'max_sensitivity_drift', '.4f'),
        ('zero spread, %FS', 'zero_spread', '.3f'),
        ('max deviation, %FS', 'max_deviation', '.3f'),
        ('A, %FS (eq. 24)', 'accuracy', '.3f'),
    ]
    return table_text(
        ['', *columns],
        [
            [title, *(format(getattr(figures, name), form) for figures in columns.values())]
            for title, name, form in rows
        ],
    )


def figures_json(
    tables: Mapping[str, Mapping[str, ChamberFigures]],
) -> dict[str, dict[str, dict[str, float]]]:
    """
    Turn the figures of chamber tables into plain values.

    Parameters
    ----------
    tables : mapping of str to mapping of str to ChamberFigures
        By path, then by title.

    Returns
    -------
    dict
        The same, %FS and %FS/°C.

    """
    return {
        path: {title: asdict(figures) for title, figures in columns.items()}
        for path, columns in tables.items()
    }
