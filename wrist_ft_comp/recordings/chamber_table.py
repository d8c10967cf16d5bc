"""
Tables of static chamber tests as CSV: ``step,load_<unit>,direction,output_at_<T>_c,…``.

Rows are load steps, and there is one output column per chamber temperature; no times. Other
columns, such as the direction, are carried along and not interpreted.
"""

import csv
from pathlib import Path
import re

import numpy as np

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recordings.chamber import ChamberTable, leave_out_copies
from wrist_ft_comp.recordings.columns import COMPENSATED
from wrist_ft_comp.signals import AXES, Correction
from wrist_ft_comp.stored.documents import beginning

_OUTPUT = re.compile(r'output_at_([-+]?\d+(?:\.\d+)?)_c')
_LOAD = re.compile(r'load_(\w+)')
#: Bytes of a table: those that were published have 2 kB.
_LARGEST = 100_000


def is_chamber_table(path: Path) -> bool:
    """Whether the file's first line names a load and outputs at temperatures."""
    header = beginning(path).lstrip('\ufeff').partition('\n')[0].strip().split(',')
    return any(map(_OUTPUT.fullmatch, header)) and any(map(_LOAD.fullmatch, header))


def _read_rows(path: Path) -> list[list[str]]:
    """Read all cells; blank lines are skipped."""
    try:
        if path.stat().st_size > _LARGEST:
            raise RecordingError(
                f'{path.name} has more than {_LARGEST} bytes, which no chamber table has. Name '
                'its columns as those of a CSV recording.'
            )
        with path.open(encoding='utf-8-sig', newline='') as file:
            rows = [row for row in csv.reader(file) if row]
    except OSError as error:
        raise RecordingError(f'{path} cannot be read: {error.strerror}.') from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise RecordingError(f'{path.name} is no CSV table in UTF-8: {error}.') from error
    for line, row in enumerate(rows, 1):
        if len(row) != len(rows[0]):
            raise RecordingError(
                f'Row {line} of {path.name} has {len(row)} cells; the header names '
                f'{len(rows[0])} columns. Repair the row.'
            )
    if len(rows) < 2:
        raise RecordingError(f'{path.name} has no row below its header; expected load steps.')
    return rows


def _number(path: Path, rows: list[list[str]], row: int, column: int) -> float:
    """Read one cell as a number."""
    try:
        return float(rows[row][column])
    except ValueError:
        raise RecordingError(
            f'Row {row + 1} of {path.name}, column {rows[0][column]}: expected a number, got '
            f'{rows[row][column]!r}.'
        ) from None


def read_chamber_table(path: Path, *, keep_copied_columns: bool = False) -> ChamberTable:
    """Read a table; columns that repeat an earlier one are left out, unless they are to stay."""
    rows = _read_rows(path)
    loads = [c for c, name in enumerate(rows[0]) if _LOAD.fullmatch(name.strip())]
    outputs = _output_columns(rows[0])
    if len(loads) != 1 or not outputs:
        raise RecordingError(
            f'{path.name} must have one column load_<unit> and columns output_at_<temperature>_c; '
            f'got {", ".join(rows[0])}.'
        )
    unit = rows[0][loads[0]].strip().removeprefix('load_')
    steps = range(1, len(rows))
    table = ChamberTable(
        name=path.name,
        temperatures_c=np.array([temperature for temperature, _ in outputs]),
        load=np.array([_number(path, rows, row, loads[0]) for row in steps]),
        load_unit=unit,
        output=np.array([[_number(path, rows, row, c) for _, c in outputs] for row in steps]),
    )
    return table if keep_copied_columns else leave_out_copies(table)


def rewrite_table(source: Path, target: Path, correct: Correction) -> tuple[str, ...]:
    """Copy a table, its outputs corrected as force z; says which columns were left out."""
    table = read_chamber_table(source)
    stamps_ns = table.reading_stamps_ns.T.ravel()
    wrench = np.full((len(stamps_ns), len(AXES)), np.nan)
    wrench[:, AXES.index('force_z')] = table.output.T.ravel()
    corrected = correct(stamps_ns, wrench)[:, AXES.index('force_z')].reshape(table.output.T.shape)
    outputs = dict(zip(table.temperatures_c.tolist(), corrected.tolist(), strict=True))
    rows = _read_rows(source)
    columns = list(zip(*rows, strict=True))
    for temperature, at in _output_columns(rows[0]):
        columns[at] = (rows[0][at], *map(repr, outputs.get(temperature, ())))
    columns.append((COMPENSATED, *[''] * (len(rows) - 1)))
    with target.open('x', encoding='utf-8', newline='') as file:
        kept = [column for column in columns if len(column) == len(rows)]
        csv.writer(file, lineterminator='\n').writerows(zip(*kept, strict=True))
    return tuple(reason for _, reason in table.left_out)


def _output_columns(header: list[str]) -> list[tuple[float, int]]:
    """List temperature, °C, and position of the output columns."""
    matches = [(_OUTPUT.fullmatch(name.strip()), at) for at, name in enumerate(header)]
    return [(float(match[1]), at) for match, at in matches if match]
