"""Chamber tables as recordings, on made-up sensors whose truth is known."""

import numpy as np
import pytest

from wrist_ft_comp.calibration.calibrate import calibrate
from wrist_ft_comp.calibration.chamber import (
    chamber_figures,
    ChamberTable,
    compensate_table,
    leave_one_temperature_out,
    table_recording,
    table_tare,
)
from wrist_ft_comp.calibration.settings import CalibrationSettings, IdentificationSettings
from wrist_ft_comp.model.drift_model import DriftModel
from wrist_ft_comp.model.offline import correct_many, track_drift
from wrist_ft_comp.model.signals import AXES

TEMPERATURES = (-20.0, 0.0, 20.0, 40.0, 60.0)
LOAD = np.array([0.0, 5.0, 10.0, 15.0, 20.0, 15.0, 10.0, 5.0, 0.0])


def make_table(zero=0.05, gain=0.001, temperatures=TEMPERATURES, bend=0.0):
    """Output 6 per unit of load; zero moves by zero·θ + bend·θ², gain by gain·θ."""
    theta = np.array(temperatures) - 20.0
    output = np.outer(6.0 * LOAD, 1 + gain * theta) + zero * theta + bend * theta**2 + 0.7
    return ChamberTable('made.csv', np.array(temperatures), LOAD, 'kpa', output)


def learn(min_span_k=3.0, **more):
    identification = IdentificationSettings(**{'method': 'pls', 'features': 'hats', **more})
    settings = CalibrationSettings('recorded', min_span_k, identification=identification)
    return lambda recording: calibrate([recording], settings).model


def fit(table, **more):
    return learn(**more)(table_recording(table, 1.0))


@pytest.fixture(scope='module')
def table():
    return make_table()


@pytest.fixture(scope='module')
def model(table):
    return fit(table, features='powers', degree=1)


def test_the_figures_are_a_hand_computation(table):
    figures = chamber_figures(table)
    assert figures.max_sensitivity_drift == pytest.approx(0.1)  # 100 · 0.001
    assert figures.zero_spread == pytest.approx(100 * 0.05 * 80 / 120)
    assert figures.max_deviation == pytest.approx(100 * (0.05 * 40 + 120 * 0.001 * 40) / 120)
    assert figures.accuracy == pytest.approx(figures.max_deviation)  # no nonlinearity


def test_one_temperature_has_no_sensitivity_drift():
    figures = chamber_figures(make_table(temperatures=(20.0,)))
    assert np.isnan(figures.max_sensitivity_drift)
    assert figures.zero_spread == 0


def test_the_recording_holds_every_reading(table):
    recording = table_recording(table, 1.0)
    column = AXES.index('force_z')
    held = recording.wrench[:, column]
    np.testing.assert_allclose(held[np.isfinite(held)], table.output.T.ravel())
    assert recording.axes_present == ('force_z',)
    assert recording.thermometers == 1
    assert np.count_nonzero(np.isfinite(recording.reference[:, column])) == table.output.size
    at_readings = recording.temperature_c[np.isfinite(held), 0]
    np.testing.assert_array_equal(at_readings, np.repeat(TEMPERATURES, len(LOAD)))


@pytest.mark.parametrize('features', ['powers', 'hats'])
def test_a_sensor_without_curvature_is_compensated_fully(features, table):
    compensated = compensate_table(table, fit(table, features=features, degree=1))
    figures = chamber_figures(compensated)
    raw = chamber_figures(table)
    assert figures.max_sensitivity_drift < 0.1 * raw.max_sensitivity_drift
    assert figures.zero_spread < 0.05 * raw.zero_spread
    assert compensated.output[0, compensated.reference_column] == pytest.approx(0, abs=1e-12)


def test_a_model_without_axes_only_tares(table):
    idle = DriftModel(10**9, 1, {})
    compensated = compensate_table(table, idle)
    np.testing.assert_allclose(compensated.output, table.output - table.output[0, 2])
    np.testing.assert_array_equal(table_tare(table, idle)[:2], 0)


def test_the_tare_leaves_zero_at_the_reference_temperature(table, model):
    """A table rewritten as a stream gives what compensate_table gives."""
    track = track_drift(model, table_recording(table, 1.0))
    stamps = table.reading_stamps_ns
    raw = np.full((stamps.size, 6), np.nan)
    raw[:, AXES.index('force_z')] = table.output.ravel()
    streamed = correct_many(track, stamps.ravel(), raw, table_tare(table, model))
    expected = compensate_table(table, model).output
    found = streamed[:, AXES.index('force_z')].reshape(expected.shape)
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_a_left_out_column_is_predicted_by_the_others(table):
    """A straight drift is known everywhere from any two temperatures."""
    left_out = leave_one_temperature_out(table, learn(features='powers', degree=1), 1.0)
    fitted = compensate_table(table, fit(table, features='powers', degree=1))
    raw = chamber_figures(table)
    assert chamber_figures(fitted).max_deviation <= chamber_figures(left_out).max_deviation
    # Beyond the calibrated temperatures drift is held, so the two ends keep that of a neighbour.
    inner = slice(1, -1)
    kept = np.abs(left_out.output - left_out.output[:, [2]])[:, inner].max()
    assert kept < 0.1 * raw.max_deviation / 100 * table.full_scale
    assert left_out.output.shape == table.output.shape


def test_a_left_out_column_does_not_see_itself():
    """Whatever stands in a column, the others' models and so their outputs stay the same there."""
    spoilt = make_table().output.copy()
    spoilt[:, 1] += 30.0
    plain, odd = (
        leave_one_temperature_out(make_table().with_output(output), learn(), 1.0)
        for output in (make_table().output, spoilt)
    )
    np.testing.assert_allclose(odd.output[:, 1] - plain.output[:, 1], 30.0, rtol=0.1)


@pytest.mark.parametrize('temperatures', [(20.0,), (20.0, 60.0)])
def test_too_few_temperatures_leave_nothing_to_leave_out(temperatures):
    table = make_table(temperatures=temperatures)
    assert leave_one_temperature_out(table, learn(), 1.0) is None
    assert leave_one_temperature_out(table, learn(min_span_k=0.0), 1.0) is None


def test_hats_bend_where_a_line_cannot():
    table = make_table(bend=0.002)
    spreads = {
        features: chamber_figures(
            compensate_table(table, fit(table, features=features, degree=1))
        ).zero_spread
        for features in ('powers', 'hats')
    }
    assert spreads['hats'] < 0.2 * spreads['powers']
