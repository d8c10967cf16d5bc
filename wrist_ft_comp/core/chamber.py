"""
Static tests in a climate chamber: one column of outputs per temperature, one row per load step.

Equations 23 and 24 and the procedure (temperatures rising, 30 minutes of residence at each, every
load held for more than 30 s) are those of "Design of Temperature Compensation Module of the
Industrial Robot Wrist Force Sensor Based on Multivariate Regression Method", Sensors &
Transducers, 2014. The tables hold no times, so times here are nominal.
"""

from dataclasses import dataclass, replace

import numpy as np

from wrist_ft_comp import RecordingError
from wrist_ft_comp.core.recording import FloatArray, IntArray, NANOSECONDS, Samples

#: Residence at each temperature (the paper's 4.2), and the least time a load is held.
RESIDENCE_S = 1800
STEP_S = 30
#: T of eq. 23: the column nearest to this is the reference, °C.
REFERENCE_TEMPERATURE_C = 20.0
#: What a table's outputs are in, since tables do not name their unit.
OUTPUT_UNIT = 'output units'


@dataclass(frozen=True, eq=False)
class ChamberTable:
    """
    A table of outputs, temperatures in the order in which they were visited.

    Attributes
    ----------
    name : str
        Where it came from, for messages.
    temperatures_c : ndarray, shape (P,)
        Chamber temperatures, °C.
    load : ndarray, shape (S,)
        Load at each step, in load_unit; the first step is without load.
    load_unit : str
        Such as ``kpa``.
    output : ndarray, shape (S, P)
        The sensor's output; the table's own unit.
    left_out : tuple of (float, str)
        Temperatures whose column was left out, °C, each with the reason.

    """

    name: str
    temperatures_c: FloatArray
    load: FloatArray
    load_unit: str
    output: FloatArray
    left_out: tuple[tuple[float, str], ...] = ()

    def __post_init__(self) -> None:
        """Check shapes, finiteness and that there is a span to divide by."""
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
        spans: FloatArray = self.output[int(np.argmax(self.load))] - self.output[0]
        return spans

    @property
    def full_scale(self) -> float:
        """Y_FS: the span at the reference temperature."""
        return float(self.spans[self.reference_column])

    @property
    def reference(self) -> FloatArray:
        """Load in units of output by the reference column's zero and full load, shape (S,)."""
        reference: FloatArray = self.load * self.full_scale / (self.load.max() - self.load[0])
        return reference

    @property
    def reading_stamps_ns(self) -> IntArray:
        """
        Nominal time of each reading, ns, shape (S, P).

        Plateaus follow each other without a break; the readings end one step before a plateau's
        end, one step apart.
        """
        ends = RESIDENCE_S * np.arange(1, len(self.temperatures_c) + 1)
        before_end = STEP_S * np.arange(len(self.load), 0, -1)
        stamps: IntArray = (ends[np.newaxis, :] - before_end[:, np.newaxis]).astype(np.int64)
        return stamps * NANOSECONDS

    def samples(self, reference: FloatArray | None = None) -> tuple[Samples, ...]:
        """
        Lay the table out in time.

        Parameters
        ----------
        reference : ndarray, shape (S,), optional
            Loads in units of output; this table's own ``reference`` by default.

        Returns
        -------
        tuple of Samples
            temperature_c every 30 s along all plateaus; force_z, the output in the table's unit,
            and reference_force_z at the readings. The gain between them is 1 at the reference.

        """
        steps = RESIDENCE_S // STEP_S
        temperature_c = np.repeat(self.temperatures_c, steps)
        temperature_stamps = np.arange(len(temperature_c), dtype=np.int64) * STEP_S * NANOSECONDS
        readings = self.reading_stamps_ns.T.ravel()
        loads = self.reference if reference is None else reference
        repeated = np.tile(loads, len(self.temperatures_c))
        return (
            Samples(('temperature_c',), temperature_stamps, temperature_c[:, np.newaxis]),
            Samples(('force_z',), readings, self.output.T.reshape(-1, 1)),
            Samples(('reference_force_z',), readings, repeated[:, np.newaxis]),
        )

    def with_output(self, output: FloatArray) -> 'ChamberTable':
        """Return the same test with other outputs, shape (S, P)."""
        return replace(self, output=output)


def leave_out_copies(table: ChamberTable) -> ChamberTable:
    """
    Leave out columns which repeat an earlier one digit for digit: those were not measured.

    Columns stand in the order of measuring, so of two equal ones the earlier can have been
    measured and the later can only be the copy.

    Parameters
    ----------
    table : ChamberTable
        As read.

    Returns
    -------
    ChamberTable
        left_out says which columns went, and why.

    """
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
    return replace(
        table,
        temperatures_c=table.temperatures_c[keep],
        output=table.output[:, keep],
        left_out=tuple(left_out),
    )


def sensitivity_drift(table: ChamberTable) -> FloatArray:
    """
    Compute K_s, the coefficient of thermal sensitivity drift (eq. 23).

    Parameters
    ----------
    table : ChamberTable
        Raw or compensated.

    Returns
    -------
    ndarray, shape (P,)
        % of full scale per °C; NaN at the reference temperature T.

    """
    change = table.spans - table.full_scale
    distance = table.temperatures_c - table.temperatures_c[table.reference_column]
    k_s = np.full(len(distance), np.nan)
    np.divide(100 * change, distance * table.full_scale, out=k_s, where=distance != 0)  # eq. 23
    return k_s


def accuracy(table: ChamberTable) -> float:
    """
    Compute A (eq. 24): the largest error over all loads and temperatures, % of full scale.

    The error is counted from the straight line through zero and full load at the reference
    temperature, so it holds drift, nonlinearity and hysteresis together.

    Parameters
    ----------
    table : ChamberTable
        Raw or compensated.

    Returns
    -------
    float
        A, %.

    """
    line = table.output[0, table.reference_column] + table.reference - table.reference[0]
    largest = np.abs(table.output - line[:, np.newaxis]).max()  # ΔA
    return float(100 * largest / abs(table.full_scale))  # eq. 24


def zero_spread(table: ChamberTable) -> float:
    """
    Compute how far the zero moves: max - min over temperature of the first step's output.

    Parameters
    ----------
    table : ChamberTable
        Raw or compensated.

    Returns
    -------
    float
        % of full scale.

    """
    return float(100 * np.ptp(table.output[0]) / abs(table.full_scale))


def max_deviation(table: ChamberTable) -> float:
    """
    Compute the largest difference from the reference temperature's output at the same load step.

    Parameters
    ----------
    table : ChamberTable
        Raw or compensated.

    Returns
    -------
    float
        % of full scale.

    """
    at_reference = table.output[:, [table.reference_column]]
    return float(100 * np.abs(table.output - at_reference).max() / abs(table.full_scale))
