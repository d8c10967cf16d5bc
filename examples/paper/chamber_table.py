"""
Convert a table of a chamber test to a recording; its output is written as if it were in N.

Columns are ``load_<unit>`` and ``output_at_<T>_c``, one per temperature; rows are load steps. It
has no times, so 4.2 of the paper gives them: 30 minutes at each temperature, a reading each 30 s.
"""

import argparse
import csv
from dataclasses import dataclass
from pathlib import Path
import re
import sys

import numpy as np
from numpy.typing import NDArray

#: Time at every temperature, and at every load at its end, s.
RESIDENCE_S, STEP_S = 1800, 30
#: Of the time at a temperature, what the sensor takes to get there: nothing is written of it, s.
CHANGE_S = 600
#: The gain is 1 in the column whose temperature is nearest to this one, °C (T of eq. 23).
REFERENCE_TEMPERATURE_C = 20.0


@dataclass(frozen=True, eq=False)
class ChamberTable:
    """Outputs of a sensor by load and temperature, temperatures in the order of the test."""

    name: str
    #: Chamber temperatures, °C, shape (P,).
    temperatures_c: NDArray[np.float64]
    #: Load of every step, in load_unit such as ``kpa``, shape (S,); the first step is unloaded.
    load: NDArray[np.float64]
    load_unit: str
    #: In the table's unit, shape (S, P).
    output: NDArray[np.float64]
    #: Why columns were left out, in sentences.
    left_out: tuple[str, ...]

    def __post_init__(self) -> None:
        """Refuse by ValueError what is no test of a sensor."""
        if not all(np.isfinite(a).all() for a in (self.temperatures_c, self.load, self.output)):
            raise ValueError(f'Loads, temperatures and outputs of {self.name} must be finite.')
        if max(self.load) == self.load[0] or len(self.load) > (RESIDENCE_S - CHANGE_S) // STEP_S:
            raise ValueError(
                f'{self.name} must begin without load and reach full load, in at most '
                f'{(RESIDENCE_S - CHANGE_S) // STEP_S} steps.'
            )

    @property
    def reference(self) -> NDArray[np.float64]:
        """Load in units of output, by the zero and full load of the reference column, (S,)."""
        output = self.output[:, np.abs(self.temperatures_c - REFERENCE_TEMPERATURE_C).argmin()]
        full_scale = output[np.argmax(self.load)] - output[0]
        return np.asarray(self.load * full_scale / (self.load.max() - self.load[0]))


def read_chamber_table(path: Path, *, keep_copied_columns: bool = False) -> ChamberTable:
    """Read a table; a column that repeats an earlier one is left out, unless it is to be kept."""
    with path.open(encoding='utf-8-sig', newline='') as file:
        lines = [line for line in file if line.strip() and not line.startswith('#')]
    # Where semicolons or tabs separate cells, a comma is a decimal point.
    delimiter = max(',;\t', key=''.join(lines[:1]).count)
    rows = csv.reader(lines, delimiter=delimiter)
    header, *steps = ([cell.strip().replace(',', '.') for cell in row] for row in rows)
    loads = [name for name in header if name.startswith('load_')]
    if len(loads) != 1 or not any(name.startswith('output_at_') for name in header):
        raise ValueError('expected one column load_<unit>, and columns output_at_<T>_c.')
    for number, step in enumerate(steps, 1):
        if len(step) != len(header):
            raise ValueError(f'load step {number} has {len(step)} cells of {len(header)}.')
    columns = dict(zip(header, zip(*steps, strict=True), strict=True))
    kept: dict[float, tuple[str, ...]] = {}
    left_out = []
    for name, cells in columns.items():
        if not (found := re.fullmatch(r'output_at_(.+)_c', name)):
            continue
        temperature_c = float(found[1])
        same = [earlier for earlier, others in kept.items() if others == cells]
        if same and not keep_copied_columns:
            left_out.append(
                f'The column of {temperature_c:g} °C in {path.name} repeats that of {same[0]:g} '
                '°C digit for digit, so it is no measurement. It was left out.'
            )
        else:
            kept[temperature_c] = cells
    return ChamberTable(
        path.name, np.array([*kept]), np.array(columns[loads[0]], float), loads[0][5:],
        np.array([*kept.values()], float).T, tuple(left_out))  # fmt: skip


def write_recording(table: ChamberTable, path: Path) -> None:
    """Write the course of the test as a CSV recording; an existing file is not overwritten."""
    with path.open('x', encoding='utf-8', newline='') as file:
        rows = csv.writer(file, lineterminator='\n')
        rows.writerow(('stamp_s', 'temperature_c', 'force_z', 'reference_force_z'))
        for column, temperature_c in enumerate(table.temperatures_c.tolist()):
            end_s = RESIDENCE_S * (column + 1)
            for stamp_s in range(end_s - RESIDENCE_S + (CHANGE_S if column else 0), end_s, STEP_S):
                step = len(table.load) - (end_s - stamp_s) // STEP_S
                reading = [table.output[step, column], table.reference[step]] if step >= 0 else []
                rows.writerow([stamp_s, temperature_c, *(reading or ['', ''])])
            # Temperature stands until the chamber changes it.
            rows.writerow([end_s - 1, temperature_c, '', ''])


def main() -> None:
    """Convert the table that the command line names."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').strip().splitlines()[0])
    parser.add_argument('table', type=Path, metavar='TABLE.csv')
    parser.add_argument('-o', '--output', required=True, type=Path, metavar='RECORDING.csv')
    parser.add_argument('--keep-copied-columns', action='store_true')
    given = parser.parse_args()
    try:
        table = read_chamber_table(given.table, keep_copied_columns=given.keep_copied_columns)
        write_recording(table, given.output)
    except (OSError, ValueError) as error:
        sys.exit(f'{given.table} cannot be converted: {error}')
    print(*table.left_out, f'wrote {given.output}', sep='\n')


if __name__ == '__main__':
    main()
