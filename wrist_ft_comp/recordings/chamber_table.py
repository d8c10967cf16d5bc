"""
Tables of static chamber tests: read from CSV, rewritten, their figures and their compensation.

The columns are ``step,load_<unit>,direction,output_at_<T>_c,…``: rows are load steps, with one
output column per chamber temperature, and no times. Other columns, such as the direction, are
copied and not interpreted. Where semicolons or tabs separate cells, a comma is a decimal point.
"""

from collections.abc import Callable
import csv
from dataclasses import dataclass, replace
from pathlib import Path
import re

import numpy as np

from wrist_ft_comp.drift.drift_model import correct, Drift, DriftModel
from wrist_ft_comp.errors import RecordingError, WristFtCompError
from wrist_ft_comp.recordings.columns import COMPENSATED
from wrist_ft_comp.recordings.csv_header import delimiter_of
from wrist_ft_comp.signals import (
    AXES,
    Correction,
    FloatArray,
    IntArray,
    NANOSECONDS,
    Recording,
    Samples,
)
from wrist_ft_comp.stored.documents import beginning
from wrist_ft_comp.stream.batch_grid import grid_samples
from wrist_ft_comp.stream.offline import simulate_drift

#: Residence at every temperature, s (4.2 of the paper).
RESIDENCE_S = 1800
#: Least time for which a load is held, s.
STEP_S = 30
#: T of eq. 23: the reference is the column nearest to it, °C.
REFERENCE_TEMPERATURE_C = 20.0
#: Unit of a table's outputs, which tables do not name.
OUTPUT_UNIT = 'output units'
#: The figures of a sensor for people, by their names in ChamberFigures.
FIGURE_TITLES = {
    'max_sensitivity_drift': 'max |K_s|, %FS/°C (eq. 23)',
    'zero_spread': 'zero spread, %FS',
    'max_deviation': 'max deviation, %FS',
    'accuracy': 'A, %FS (eq. 24)',
}
#: The axis a chamber table is read as.
_AXIS = AXES.index('force_z')
_OUTPUT = re.compile(r'output_at_([-+]?\d+(?:[.,]\d+)?)_c')
_LOAD = re.compile(r'load_(\w+)')
#: Most bytes of a table; published ones have 2 kB.
_LARGEST = 100_000


@dataclass(frozen=True, eq=False)
class ChamberTable:
    """A table of outputs, temperatures in the order in which they were visited."""

    name: str
    #: Chamber temperatures, °C, shape (P,).
    temperatures_c: FloatArray
    #: At each step, in load_unit such as ``kpa``, shape (S,); the first step is without load.
    load: FloatArray
    load_unit: str
    #: In the table's own unit, shape (S, P).
    output: FloatArray
    #: Temperatures whose column was left out, °C, each with the reason.
    left_out: tuple[tuple[float, str], ...] = ()

    def __post_init__(self) -> None:
        expected = (len(self.load), len(self.temperatures_c))
        if self.output.shape != expected or 0 in expected:
            raise RecordingError(
                f'{self.name} needs outputs of shape {expected}, at least one load step and one '
                f'temperature; got {self.output.shape}.'
            )
        if not all(np.isfinite(a).all() for a in (self.temperatures_c, self.load, self.output)):
            raise RecordingError(f'Loads, temperatures and outputs of {self.name} must be finite.')
        if max(self.load) == self.load[0]:
            raise RecordingError(
                f'{self.name} must begin without load and reach full load; every step has '
                f'{self.load[0]:g} {self.load_unit} or less.'
            )
        if self.full_scale == 0:
            raise RecordingError(
                f'{self.name} must respond to load: at {REFERENCE_TEMPERATURE_C:g} °C, or nearest '
                'to it, zero and full load read the same.'
            )
        if len(set(self.temperatures_c.tolist())) < len(self.temperatures_c):
            raise RecordingError(f'{self.name} must have one column per temperature.')

    @property
    def reference_column(self) -> int:
        """Number of the column nearest to 20 °C."""
        return int(np.argmin(np.abs(self.temperatures_c - REFERENCE_TEMPERATURE_C)))

    @property
    def spans(self) -> FloatArray:
        """Y_f(T_i) - Y_0(T_i) of eq. 23 at every temperature, shape (P,)."""
        return np.asarray(self.output[int(np.argmax(self.load))] - self.output[0])

    @property
    def full_scale(self) -> float:
        """Y_FS: the span at the reference temperature."""
        return float(self.spans[self.reference_column])

    @property
    def reference(self) -> FloatArray:
        """Load in units of output by the reference column's zero and full load, shape (S,)."""
        return np.asarray(self.load * self.full_scale / (self.load.max() - self.load[0]))

    @property
    def reading_stamps_ns(self) -> IntArray:
        """Nominal time of each reading, ns, (S, P): one step apart, at the end of its plateau."""
        ends = RESIDENCE_S * np.arange(1, len(self.temperatures_c) + 1)
        before_end = STEP_S * np.arange(len(self.load), 0, -1)
        stamps: IntArray = (ends[np.newaxis, :] - before_end[:, np.newaxis]).astype(np.int64)
        return stamps * NANOSECONDS

    def samples(self, reference: FloatArray | None = None) -> tuple[Samples, ...]:
        """
        Lay the table out in time, as force_z in the table's unit and its reference.

        Temperatures come at both ends of every 30 s along all plateaus, which are no slopes. Loads
        are in units of output: the table's own ``reference`` by default, so that the gain is 1 at
        the reference temperature.
        """
        steps = RESIDENCE_S // STEP_S
        temperature_c = np.repeat(self.temperatures_c, 2 * steps)[:-1]
        ends = (np.arange(len(temperature_c), dtype=np.int64) + 1) // 2 * STEP_S * NANOSECONDS
        temperature_stamps = ends - np.arange(len(temperature_c)) % 2
        readings = self.reading_stamps_ns.T.ravel()
        loads = self.reference if reference is None else reference
        repeated = np.tile(loads, len(self.temperatures_c))
        return (
            Samples(('temperature_c',), temperature_stamps, temperature_c[:, np.newaxis]),
            Samples(('force_z',), readings, self.output.T.reshape(-1, 1)),
            Samples(('reference_force_z',), readings, repeated[:, np.newaxis]),
        )


def leave_out_copies(table: ChamberTable) -> ChamberTable:
    """Leave out columns which repeat an earlier one digit for digit, and say so in left_out."""
    keep: list[int] = []
    left_out = list(table.left_out)
    for column, temperature in enumerate(table.temperatures_c.tolist()):
        same = [k for k in keep if np.array_equal(table.output[:, k], table.output[:, column])]
        if same:
            reason = (
                f'The column of {temperature:g} °C in {table.name} repeats that of '
                f'{table.temperatures_c[same[0]]:g} °C digit for digit, so it is no measurement.'
            )
            left_out.append((temperature, reason))
        else:
            keep.append(column)
    temperatures_c, output = table.temperatures_c[keep], table.output[:, keep]
    return replace(table, temperatures_c=temperatures_c, output=output, left_out=tuple(left_out))


def is_chamber_table(path: Path) -> bool:
    """Whether the file's first line names a load and outputs at temperatures."""
    line = beginning(path).lstrip('\ufeff').partition('\n')[0].strip()
    header = line.split(delimiter_of(line))
    return any(map(_OUTPUT.fullmatch, header)) and any(map(_LOAD.fullmatch, header))


def _read_rows(path: Path) -> tuple[list[list[str]], str]:
    """Read all cells, and what separates them; blank lines are skipped."""
    delimiter = delimiter_of(beginning(path).partition('\n')[0])
    try:
        if path.stat().st_size > _LARGEST:
            raise RecordingError(
                f'{path.name} has more than {_LARGEST} bytes, which no chamber table has. Name '
                'its columns as those of a CSV recording.'
            )
        with path.open(encoding='utf-8-sig', newline='') as file:
            rows = [row for row in csv.reader(file, delimiter=delimiter) if row]
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
    return rows, delimiter


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
    rows, delimiter = _read_rows(path)
    if delimiter != ',':
        rows = [[cell.replace(',', '.') for cell in row] for row in rows]
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
    wrench[:, _AXIS] = table.output.T.ravel()
    corrected = correct(stamps_ns, wrench)[:, _AXIS].reshape(table.output.T.shape)
    outputs = dict(zip(table.temperatures_c.tolist(), corrected.tolist(), strict=True))
    rows, delimiter = _read_rows(source)
    columns = list(zip(*rows, strict=True))
    for temperature, at in _output_columns(rows[0]):
        cells = list(map(repr, outputs.get(temperature, ())))
        if ',' in ''.join(columns[at]):
            cells = [cell.replace('.', ',') for cell in cells]
        columns[at] = (rows[0][at], *cells)
    columns.append((COMPENSATED, *[''] * (len(rows) - 1)))
    with target.open('x', encoding='utf-8', newline='') as file:
        kept = [column for column in columns if len(column) == len(rows)]
        csv.writer(file, delimiter=delimiter, lineterminator='\n').writerows(
            zip(*kept, strict=True)
        )
    return tuple(reason for _, reason in table.left_out)


def _output_columns(header: list[str]) -> list[tuple[float, int]]:
    """List temperature, °C, and position of the output columns."""
    matches = [(_OUTPUT.fullmatch(name.strip()), at) for at, name in enumerate(header)]
    return [(float(match[1].replace(',', '.')), at) for match, at in matches if match]


@dataclass(frozen=True)
class ChamberFigures:
    """How good a sensor is over temperature, % of full scale."""

    #: The largest |K_s| (eq. 23, per °C); NaN when there is only the reference temperature.
    max_sensitivity_drift: float
    #: Range of the output of the first step.
    zero_spread: float
    #: Largest difference from the output at the reference temperature.
    max_deviation: float
    #: A (eq. 24), the largest error over all loads and temperatures.
    accuracy: float


def chamber_figures(table: ChamberTable) -> ChamberFigures:
    """Compute all figures; accuracy holds drift, nonlinearity and hysteresis together."""
    full_scale = abs(table.full_scale)
    distance = table.temperatures_c - table.temperatures_c[table.reference_column]
    elsewhere = distance != 0
    change = (table.spans - table.full_scale)[elsewhere]
    k_s = np.abs(100 * change / (distance[elsewhere] * table.full_scale))  # eq. 23
    at_reference = table.output[:, [table.reference_column]]
    line = at_reference[0] + table.reference - table.reference[0]
    largest = np.abs(table.output - line[:, np.newaxis]).max()  # ΔA
    return ChamberFigures(
        max_sensitivity_drift=float(k_s.max()) if len(k_s) else float('nan'),
        zero_spread=float(100 * np.ptp(table.output[0]) / full_scale),
        max_deviation=float(100 * np.abs(table.output - at_reference).max() / full_scale),
        accuracy=float(100 * largest / full_scale),  # eq. 24
    )


def table_recording(
    table: ChamberTable, period_s: float, reference: FloatArray | None = None
) -> Recording:
    """Put a table's nominal course of test onto the thermal grid, of cells of at most 30 s."""
    recording = grid_samples(table.samples(reference), name=table.name, period_s=period_s)
    return replace(recording, unit=OUTPUT_UNIT)


def compensate_table(table: ChamberTable, model: DriftModel) -> ChamberTable:
    """Compensate a table by the model's free run; tared at the reference, without load."""
    at_readings = _drift_at_readings(table, model)
    output = correct(table.output, at_readings, _tare(table, at_readings))
    return replace(table, output=output)


def table_tare(table: ChamberTable, model: DriftModel) -> FloatArray:
    """Tare as compensate_table does: raw offset, shape (6,), zero but for the table's axis."""
    tare = np.zeros(len(AXES))
    tare[_AXIS] = _tare(table, _drift_at_readings(table, model))
    return tare


def _drift_at_readings(table: ChamberTable, model: DriftModel) -> Drift:
    """Simulate the test; drift at every reading, arrays of shape (S, P)."""
    recording = table_recording(table, model.period_ns / NANOSECONDS)
    simulated = simulate_drift(model, recording)
    cells = table.reading_stamps_ns // model.period_ns - recording.first_cell  # (S, P)
    return Drift(*(part[cells][..., _AXIS] for part in simulated))


def _tare(table: ChamberTable, at_readings: Drift) -> float:
    """Raw offset without load at the reference temperature."""
    reference = table.reference_column
    return float(table.output[0, reference] - at_readings.zero[0, reference])


def leave_one_temperature_out(
    table: ChamberTable, learn: Callable[[Recording], DriftModel], period_s: float
) -> ChamberTable | None:
    """Compensate each column by a model of the others; None where these allow no fit."""
    output: FloatArray = np.empty_like(table.output)
    for column in range(len(table.temperatures_c)):
        kept = np.arange(len(table.temperatures_c)) != column
        try:
            others = replace(
                table, temperatures_c=table.temperatures_c[kept], output=table.output[:, kept]
            )
            # Loads stay in the whole table's unit, also when its reference column is left out.
            model = learn(table_recording(others, period_s, table.reference))
        except WristFtCompError:
            return None
        output[:, column] = compensate_table(table, model).output[:, column]
    return replace(table, output=output)
