"""
Reproduce the paper: its published model, its tables, and its methods side by side.

"Design of Temperature Compensation Module of the Industrial Robot Wrist Force Sensor Based on
Multivariate Regression Method", Sensors & Transducers, 2014. ``docs/paper.md`` goes through it
equation by equation. Tables are printed, figures are written to a folder.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
import textwrap
from typing import Any

from chamber_table import (
    ChamberTable,
    read_chamber_table,
    REFERENCE_TEMPERATURE_C,
    write_recording,
)
import matplotlib as mpl
from matplotlib.figure import Figure
import numpy as np
import yaml

import wrist_ft_comp as wfc
from wrist_ft_comp.channels import AXES
from wrist_ft_comp.drift.arx_pls import Arx, ArxPls, free_run, relaxation
from wrist_ft_comp.drift.drift_model import correct
from wrist_ft_comp.fit.settings import IdentificationSettings, Method, METHODS
from wrist_ft_comp.series import FloatArray
from wrist_ft_comp.stream.drift_of_recordings import simulate_drift

HERE = Path(__file__).resolve().parent
TABLES = HERE.parents[1] / 'data/keller_pa10'
#: Raw, and as the paper compensated it.
SENSORS = {
    'A': ('table1_sensor_a_raw.csv', 'table3_sensor_a_compensated.csv'),
    'B': ('table2_sensor_b_raw.csv', 'table4_sensor_b_compensated.csv'),
}
FORCE_Z = AXES.index('force_z')
#: Thermal cells of the tables, which have a reading each 30 s, and of the simulated days, s.
TABLE_CELL_S, DAY_CELL_S = 30.0, 10.0
#: A simulated day, h.
DAY_H = 3.0
#: Characters of a printed line.
WIDTH = 90


def main() -> None:
    """Run all three parts."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').strip().splitlines()[0])
    parser.add_argument('-o', '--output', type=Path, default=Path('out/paper'), metavar='FOLDER')
    folder = parser.parse_args().output
    folder.mkdir(parents=True, exist_ok=True)
    mpl.rcParams.update({'figure.constrained_layout.use': True, 'font.size': 9})
    reproduce_published_model(folder / 'published_model.png')
    reproduce_tables(folder / 'tables.png')
    compare_methods(folder / 'methods.png')


def print_not_reproduced(what: str) -> None:
    """Say what the paper does not allow to reproduce."""
    print(textwrap.fill(f'Not reproduced: {what}', WIDTH))


# The published model (4.2)


def read_published_model(path: Path) -> ArxPls:
    """Read P, Q, W_x, W_y and H(z) as they are printed: eq. 15, run by the package's own core."""
    printed: dict[str, Any] = yaml.safe_load(path.read_text(encoding='utf-8'))
    p, q, w_x, w_y = (np.array(printed[name], dtype=float) for name in ('P', 'Q', 'W_x', 'W_y'))
    # (β_0 z + β_1) / (z² + a_1 z + a_2) is (β_0 z⁻¹ + β_1 z⁻²) / (1 + a_1 z⁻¹ + a_2 z⁻²).
    latents = tuple(
        Arx(np.array(h['denominator'][1:]), np.array(h['numerator']), first_lag=1 + h['delay'])
        for h in printed['H']
    )
    return ArxPls(
        input_mean=np.zeros(len(w_x)), input_weight=w_x,
        rotations=np.linalg.inv(p).T,  # X = T Pᵀ with as many latents as inputs: T = X P⁻ᵀ
        latents=latents, output_loadings=q, output_weight=w_y,
        output_mean=np.zeros(len(w_y)))  # fmt: skip


def reproduce_published_model(picture: Path) -> None:
    """Run the published model on a step of each input and on a warm-up, and draw its answers."""
    model = read_published_model(HERE / 'published_model.yaml')
    print('The published model (P, Q, W_x, W_y, H(z) of 4.2)')
    print('latent   static gain   poles           first lag, samples')
    for r, h in enumerate(model.latents, 1):
        poles = ', '.join(f'{pole:.3f}' for pole in np.sort(h.poles.real)[::-1])
        print(f'{r:6d} {h.gain:13.3f}   {poles}    {h.first_lag}')
    samples = np.arange(60)
    figure = Figure(figsize=(9, 5.5))
    panels = figure.subplots(2, 3, sharex=True).ravel()
    steps = {f'step of input {j + 1}': np.eye(4)[j] * (samples >= 5)[:, None] for j in range(4)}
    warm_up = np.tile(1 - np.exp(-samples / 15.0), (4, 1)).T
    runs = {**steps, 'warm-up of all inputs': warm_up}
    for panel, (title, x) in zip(panels, runs.items(), strict=False):
        _, y = model.run(model.start(np.zeros(4)), x)
        panel.plot(samples, y, label=['output 1', 'output 2'])
        panel.set(title=title, xlabel='sample')
        print(f'{title}: ends at {y[-1, 0]:.3f} and {y[-1, 1]:.3f}')
    panels[0].legend()
    panels[-1].set_axis_off()
    figure.savefig(picture)
    print_not_reproduced(
        'Fig. 6 and 7. The paper neither names the inputs nor prints the course of the test.'
    )
    print(f'-> {picture}\n')


# Tables 1 to 4, and eq. 23 and 24


@dataclass(frozen=True, eq=False)
class Compensated:
    """A chamber test: as it was recorded, or compensated."""

    table: ChamberTable
    #: Shape (S, P).
    output: FloatArray

    @property
    def k_s(self) -> FloatArray:
        """K_s at every temperature, %FS per °C, shape (P,) (eq. 23)."""
        full = int(np.argmax(self.table.load))
        return wfc.thermal_sensitivity_drift(
            self.table.temperatures_c, self.output[0], self.output[full], REFERENCE_TEMPERATURE_C
        )

    @property
    def a(self) -> float:
        """A over all loads and temperatures, % of full scale (eq. 24)."""
        line = self.output[0, self.at_reference] + self.table.reference
        return wfc.accuracy(self.output, line[:, np.newaxis], self.table.reference.max())

    @property
    def zero_drift(self) -> FloatArray:
        """Output without load, counted from the reference temperature, %FS, shape (P,)."""
        zero = self.output[0] - self.output[0, self.at_reference]
        return np.asarray(100 * zero / self.table.reference.max())

    @property
    def at_reference(self) -> int:
        """Number of the column of the reference temperature."""
        return int(np.argmin(np.abs(self.table.temperatures_c - REFERENCE_TEMPERATURE_C)))


def reproduce_tables(picture: Path) -> None:
    """Learn from Tables 1 and 2, and put K_s and A beside those of Tables 3 and 4."""
    figure = Figure(figsize=(9, 6))
    panels = figure.subplots(2, 2, sharex=True)
    print('Tables 1 to 4: coefficients at discrete temperatures (3.2), K_s (eq. 23), A (eq. 24)')
    print(f'{"sensor":34}max |K_s|, %FS/°C   zero spread, %FS   A, %FS')
    for column, (sensor, (raw, theirs)) in enumerate(SENSORS.items()):
        table = read_chamber_table(TABLES / raw)
        rows = {
            'raw': Compensated(table, table.output),
            "the paper's result": as_printed(TABLES / theirs),
            'pcr': learn_from(table, 'pcr'),
            'pls': learn_from(table, 'pls'),
            'pls, each temperature left out': leave_each_out(table, 'pls'),
        }
        for name, row in rows.items():
            figures = (
                f'{np.nanmax(np.abs(row.k_s)):10.4f}{np.ptp(row.zero_drift):19.3f}{row.a:13.2f}'
            )
            print(f'{sensor}, {name:31}{figures}')
            if name != 'pcr':  # the same as pls: with all latents both are least squares
                panels[0, column].plot(row.table.temperatures_c, row.zero_drift, '.-', label=name)
                panels[1, column].plot(row.table.temperatures_c, row.k_s, '.-', label=name)
        for sentence in table.left_out:
            print(textwrap.fill(sentence, WIDTH))
        panels[0, column].set(title=f'sensor {sensor}', ylabel='zero drift, %FS')
        panels[1, column].set(xlabel='°C', ylabel='K_s, %FS/°C')
    panels[0, 0].legend()
    figure.savefig(picture)
    print_not_reproduced(
        'the numbers of Tables 3 and 4. At -40 °C sensor A reads -5.6 at the first and at the '
        'last step, where Table 3 has 3.949 and 3.918: no function of output and temperature. '
        'They bend with the load, too, which is most of their A.'
    )
    print(f'-> {picture}\n')


def as_printed(path: Path) -> Compensated:
    """Take a table as the paper prints it."""
    table = read_chamber_table(path)
    return Compensated(table, table.output)


def learn_from(table: ChamberTable, method: Method, left_out: int | None = None) -> Compensated:
    """Learn a table by a method, one of its temperatures left out or none, and compensate it."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / table.name
        write_recording(table, path)
        recording = wfc.read_recording(path, period_s=TABLE_CELL_S)
    learnt, cells = recording, np.flatnonzero(np.isfinite(recording.wrench[:, FORCE_Z]))
    readings = cells.reshape(len(table.temperatures_c), len(table.load)).T  # (S, P)
    if left_out is not None:
        wrench = recording.wrench.copy()
        wrench[readings[:, left_out]] = np.nan
        learnt = replace(recording, wrench=wrench)
    identification = IdentificationSettings(method=method, features='hats')
    settings = wfc.CalibrationSettings(reference='recorded', identification=identification)
    calibration = wfc.calibrate([learnt], settings)
    drift = simulate_drift(calibration.model, recording)
    at_reference = Compensated(table, table.output).at_reference
    tare = table.output[0, at_reference] - drift.zero[readings[0, at_reference], FORCE_Z]
    return Compensated(table, correct(recording.wrench, drift, tare)[readings, FORCE_Z])


def leave_each_out(table: ChamberTable, method: Method) -> Compensated:
    """Predict every temperature from the others."""
    columns = [
        learn_from(table, method, column).output[:, column]
        for column in range(len(table.temperatures_c))
    ]
    return Compensated(table, np.stack(columns, axis=1))


# The methods (eq. 3 to 22) on one simulated warm-up


def simulated_day(seed: int, duty: Sequence[float]) -> wfc.Recording:
    """
    Let an unloaded sensor warm up, whose zero follows its thermometer 5 and 25 minutes late.

    The duty cycle, one level for each part of the day, warms the thermometer by up to 30 K.
    """
    rng = np.random.default_rng(seed)
    elapsed_s = np.arange(0.0, 3600 * DAY_H, DAY_CELL_S)
    warming_k = 30 * np.repeat(duty, len(elapsed_s) // len(duty))
    temperature_c = 22 + free_run(relaxation(900, DAY_CELL_S), np.append(0.0, warming_k))[1:]
    soon, late = (free_run(relaxation(tau_s, DAY_CELL_S), temperature_c) for tau_s in (300, 1500))
    force_z = 0.3 * (soon - 22) + 0.5 * (late - 22) + rng.normal(0, 0.1, len(elapsed_s))
    return wfc.recording_from_columns(
        {'stamp_s': elapsed_s, 'temperature_c': temperature_c, 'force_z': force_z},
        name=f'day {seed}', period_s=DAY_CELL_S)  # fmt: skip


def compare_methods(picture: Path) -> None:
    """Learn two simulated days by all six methods, and draw a third like the paper's Fig. 6."""
    learnt = [simulated_day(1, (0.8, 0.3)), simulated_day(2, (0.4, 0.9, 0.0))]
    day = simulated_day(3, (0.9, 0.0, 0.6))
    actual = tared(day.wrench[:, FORCE_Z])
    print('The six methods: drift of force z on a day that they have not seen')
    print(f'{"":14}{"left, N RMS":>12}{"of":>7}   what was chosen')
    figure = Figure(figsize=(9, 6))
    panels = figure.subplots(2, 3, sharex=True, sharey=True).ravel()
    hours = day.elapsed_s / 3600
    for panel, method in zip(panels, METHODS, strict=True):
        settings = wfc.CalibrationSettings(identification=IdentificationSettings(method=method))
        calibration = wfc.calibrate(learnt, settings)
        fit = calibration.fits['force_z']
        predicted = tared(simulate_drift(calibration.model, day).zero[:, FORCE_Z])
        left, whole = (np.sqrt(np.nanmean(part**2)) for part in (actual - predicted, actual))
        print(f'{method:14}{left:12.3f}{whole:7.2f}   {fit.chosen}')
        for note in fit.notes:
            if note.startswith('latent'):
                print(f'{"":36}{note}')
        panel.plot(hours, actual, label='actual', color='0.6')
        panel.plot(hours, predicted, label='predicted')
        panel.set(title=f'{method}: {left:.2f} N left', xlabel='h')
    panels[0].legend()
    panels[0].set_ylabel('drift of force z, N')
    figure.savefig(picture)
    print(f'-> {picture}')


def tared(drift: FloatArray) -> FloatArray:
    """Count from the first minute, as people tare."""
    return np.asarray(drift - np.nanmean(drift[: round(60 / DAY_CELL_S)]))


if __name__ == '__main__':
    main()
