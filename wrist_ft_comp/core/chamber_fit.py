"""Chamber tables as recordings: fitting them, compensating them, and leaving a temperature out."""

from dataclasses import dataclass, replace

import numpy as np

from wrist_ft_comp import WristFtCompError
from wrist_ft_comp.core import drift
from wrist_ft_comp.core.calibration import calibrate, CalibrationSettings
from wrist_ft_comp.core.chamber import (
    accuracy,
    ChamberTable,
    max_deviation,
    OUTPUT_UNIT,
    sensitivity_drift,
    zero_spread,
)
from wrist_ft_comp.core.drift import Drift, DriftModel
from wrist_ft_comp.core.evaluation import simulate_drift
from wrist_ft_comp.core.recording import AXES, FloatArray, NANOSECONDS, Recording
from wrist_ft_comp.core.sampling import grid_samples

#: The figures of a sensor for people, by their names below.
FIGURE_TITLES = {
    'max_sensitivity_drift': 'max |K_s|, %FS/°C (eq. 23)',
    'zero_spread': 'zero spread, %FS',
    'max_deviation': 'max deviation, %FS',
    'accuracy': 'A, %FS (eq. 24)',
}
#: The axis a chamber table is read as.
_COLUMN = AXES.index('force_z')


@dataclass(frozen=True)
class ChamberFigures:
    """
    How good a sensor is over temperature.

    Attributes
    ----------
    max_sensitivity_drift : float
        Largest |K_s| (eq. 23), %FS/°C; NaN when there is only the reference temperature.
    zero_spread : float
        max - min over temperature without load, %FS.
    max_deviation : float
        Largest difference from the reference temperature at the same load, %FS.
    accuracy : float
        A (eq. 24), %FS.

    """

    max_sensitivity_drift: float
    zero_spread: float
    max_deviation: float
    accuracy: float


def chamber_figures(table: ChamberTable) -> ChamberFigures:
    """
    Compute all figures of a table.

    Parameters
    ----------
    table : ChamberTable
        Raw or compensated.

    Returns
    -------
    ChamberFigures
        In % of full scale.

    """
    k_s = np.abs(sensitivity_drift(table))
    known = k_s[np.isfinite(k_s)]
    return ChamberFigures(
        float(known.max()) if len(known) else float('nan'),
        zero_spread(table),
        max_deviation(table),
        accuracy(table),
    )


def table_recording(table: ChamberTable, period_s: float) -> Recording:
    """
    Put a table's nominal course of test onto the thermal grid.

    Parameters
    ----------
    table : ChamberTable
        Any.
    period_s : float
        Cell length, s; at most the 30 s between two readings.

    Returns
    -------
    Recording
        force_z, its reference, and one thermometer.

    """
    recording = grid_samples(table.samples(), name=table.name, period_s=period_s)
    return replace(recording, unit=OUTPUT_UNIT)


def compensate_table(table: ChamberTable, model: DriftModel) -> ChamberTable:
    """
    Compensate every reading of a table by the model's free run over the course of the test.

    The sensor is tared once, without load at the reference temperature, as a robot's would be.

    Parameters
    ----------
    table : ChamberTable
        Raw.
    model : DriftModel
        With one thermometer.

    Returns
    -------
    ChamberTable
        The same test with compensated outputs.

    """
    at_readings = _drift_at_readings(table, model)
    return table.with_output(drift.correct(table.output, at_readings, _tare(table, at_readings)))


def table_tare(table: ChamberTable, model: DriftModel) -> FloatArray:
    """
    Tare a table's sensor as compensate_table does.

    Parameters
    ----------
    table, model
        As for compensate_table.

    Returns
    -------
    ndarray, shape (6,)
        Raw offset, all zero but for the table's axis.

    """
    tare = np.zeros(len(AXES))
    tare[_COLUMN] = _tare(table, _drift_at_readings(table, model))
    return tare


def _drift_at_readings(table: ChamberTable, model: DriftModel) -> Drift:
    """Simulate the test; drift at every reading, arrays of shape (S, P)."""
    recording = table_recording(table, model.period_ns / NANOSECONDS)
    simulated = simulate_drift(model, recording)
    cells = table.reading_stamps_ns // model.period_ns - recording.first_cell  # (S, P)
    return Drift(*(part[cells][..., _COLUMN] for part in simulated))


def _tare(table: ChamberTable, at_readings: Drift) -> float:
    """Raw offset without load at the reference temperature."""
    reference = table.reference_column
    return float(table.output[0, reference] - at_readings.zero[0, reference])


def leave_one_temperature_out(
    table: ChamberTable, settings: CalibrationSettings, period_s: float
) -> ChamberTable | None:
    """
    Compensate every column by a model that was fitted to the others.

    Parameters
    ----------
    table : ChamberTable
        Raw.
    settings : CalibrationSettings
        As for the fit to all columns; hats get their knots at the columns that are left.
    period_s : float
        Cell length, s.

    Returns
    -------
    ChamberTable or None
        What a temperature between (or beyond) the calibrated ones may expect; None when the
        columns that are left do not allow a fit.

    """
    output: FloatArray = np.empty_like(table.output)
    for column in range(len(table.temperatures_c)):
        kept = np.arange(len(table.temperatures_c)) != column
        try:
            others = replace(
                table, temperatures_c=table.temperatures_c[kept], output=table.output[:, kept]
            )
            # Loads stay in the whole table's unit, also when its reference column is left out.
            recording = grid_samples(
                others.samples(table.reference), name=table.name, period_s=period_s
            )
            model = calibrate([recording], settings).model
        except WristFtCompError:
            return None
        output[:, column] = compensate_table(table, model).output[:, column]
    return table.with_output(output)
