"""The drift of a sensor: step and run, the measurement equation, and what a model refuses."""

from dataclasses import replace

import numpy as np
import pytest

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.drift import drift_model
from wrist_ft_comp.drift.drift_model import Drift, ThermometerPrediction
from wrist_ft_comp.errors import ModelFileError

#: Per axis: gain of zero drift, of sensitivity drift, time constant.
TRUTH = {'force_x': (0.5, 1e-3, 40.0), 'force_z': (-2.0, 0.0, 300.0), 'torque_y': (0.03, 2e-3, 9)}


@pytest.fixture(scope='module')
def model(make_model):
    return make_model(TRUTH, thermometers=2)


@pytest.fixture(scope='module')
def temperature_c():
    return 20 + np.cumsum(np.random.default_rng(0).standard_normal((80, 2)), axis=0)


def test_drift_is_the_textbook_lag_on_its_axes_and_zero_on_others(model, temperature_c, lagged):
    _, track = drift_model.run(model, drift_model.start(model, temperature_c[0]), temperature_c)
    mean_theta = temperature_c.mean(axis=1) - 20
    for i, axis in enumerate(AXES):
        zero, sensitivity, tau = TRUTH.get(axis, (0.0, 0.0, 1.0))
        moved = lagged(mean_theta, tau, period_s=1.0)
        np.testing.assert_allclose(track.zero[:, i], zero * moved, atol=1e-10)
        np.testing.assert_allclose(track.sensitivity[:, i], sensitivity * moved, atol=1e-10)


def test_correct_inverts_the_measurement():
    rng = np.random.default_rng(0)
    wrench, zero, tare = rng.normal(0, 100, (4, 6)), rng.normal(0, 100, 6), rng.normal(0, 100, 6)
    drift = Drift(zero, rng.uniform(-0.4, 0.4, 6))
    raw = (1 + drift.sensitivity) * wrench + zero
    np.testing.assert_allclose(drift_model.correct(raw + tare, drift, tare), wrench, atol=1e-9)
    np.testing.assert_allclose(drift_model.correct(raw, drift), wrench, atol=1e-9)


def test_thermometers_outside_the_calibrated_range_are_named(make_model):
    model = make_model(TRUTH, thermometers=3)
    narrow = make_model({'force_z': TRUTH['force_z']}, thermometers=3, range_c=(10.0, 40.0))
    model = replace(model, axes={**model.axes, **narrow.axes})
    assert model.outside(np.array([10.0, 25.0, 40.0])) == []
    assert model.outside(np.array([9.9, 25.0, 40.1])) == [0, 2]


def test_uncertainty_is_what_the_model_leaves_and_grows_beyond_the_range(make_model):
    """Force x drifts, y does not, z was not calibrated; a third of the range is 10 K."""
    axes = {'force_x': (-0.5, 0.0, 10.0), 'force_z': (2.0, 0.0, 10.0)}
    model = make_model(axes, range_c=(10.0, 40.0))
    model = replace(model, deviation={'force_x': 0.3, 'force_y': 0.2})
    celsius = np.array([10, 33.3, 40, 9, -20, 40.3, 100])
    thirds = np.array([0, 0, 0, 0.1, 3, 0.03, 6])
    deviations = model.uncertainty(celsius[:, np.newaxis])
    np.testing.assert_allclose(deviations[:, 0], 0.3 * np.sqrt(1 + thirds**2))
    np.testing.assert_array_equal(deviations[:, 1:], [[0.2] + [np.nan] * 4] * 7)
    np.testing.assert_array_equal(model.uncertainty(celsius[4:5]), deviations[4])


def test_predicted_thermometers_that_do_not_fit_are_refused():
    parts = np.zeros(1), np.zeros((2, 1, 2)), np.zeros(2), *np.ones((3, 2))
    assert ThermometerPrediction(*parts).predict(np.ones((1, 2))).tolist() == [0, 0]
    with pytest.raises(ModelFileError, match='shape of still_k'):
        ThermometerPrediction(*parts[:3], np.ones(3), *parts[4:])
