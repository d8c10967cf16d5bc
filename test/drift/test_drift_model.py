"""The drift of a sensor: step and run, the measurement equation, and what a model refuses."""

from dataclasses import replace

import numpy as np
import pytest

from wrist_ft_comp.drift import drift_model
from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.drift.drift_model import Drift
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.errors import ModelFileError
from wrist_ft_comp.signals import AXES

#: Per axis: gain of zero drift, of sensitivity drift, time constant.
TRUTH = {
    'force_x': (0.5, 1e-3, 40.0),
    'force_z': (-2.0, 0.0, 300.0),
    'torque_y': (0.03, 2e-3, 9.0),
}


@pytest.fixture(scope='module')
def model(make_model):
    return make_model(TRUTH, thermometers=2)


@pytest.fixture(scope='module')
def temperature_c():
    return 20 + np.cumsum(np.random.default_rng(0).standard_normal((80, 2)), axis=0)


def test_the_drift_is_the_textbook_lag_on_its_axes_and_zero_on_the_others(
    model, temperature_c, lagged
):
    _, track = drift_model.run(model, drift_model.start(model, temperature_c[0]), temperature_c)
    mean_theta = temperature_c.mean(axis=1) - 20
    for i, axis in enumerate(AXES):
        zero, sensitivity, tau = TRUTH.get(axis, (0.0, 0.0, 1.0))
        moved = lagged(mean_theta, tau, period_s=1.0)
        np.testing.assert_allclose(track.zero[:, i], zero * moved, atol=1e-10)
        np.testing.assert_allclose(track.sensitivity[:, i], sensitivity * moved, atol=1e-10)


@pytest.mark.parametrize('cut', [1, 40, 79])
def test_run_is_the_fold_of_step_wherever_it_is_split(model, temperature_c, cut):
    first = drift_model.start(model, temperature_c[0])
    end, whole = drift_model.run(model, first, temperature_c)
    state, head = drift_model.run(model, first, temperature_c[:cut])
    rows = []
    for row in temperature_c[cut:]:
        state, one = drift_model.step(model, state, row)
        rows.append(one)
    for k, part in enumerate(whole):
        joined = np.concatenate((head[k], [row[k] for row in rows]))
        np.testing.assert_allclose(joined, part, atol=1e-12)
    assert set(state) == set(TRUTH)
    same_end, last = drift_model.run(model, first, temperature_c, last_only=True)
    for axis, value in end.items():
        np.testing.assert_allclose(state[axis], value, atol=1e-12)
        np.testing.assert_array_equal(same_end[axis], value)
    for part, whole_part in zip(last, whole, strict=True):
        np.testing.assert_allclose(part, whole_part[-1:], atol=1e-12)


def test_correct_inverts_the_measurement():
    rng = np.random.default_rng(0)
    wrench, zero, tare = rng.normal(0, 100, (4, 6)), rng.normal(0, 100, 6), rng.normal(0, 100, 6)
    drift = Drift(zero, rng.uniform(-0.4, 0.4, 6))
    raw = (1 + drift.sensitivity) * wrench + zero
    np.testing.assert_allclose(drift_model.correct(raw + tare, drift, tare), wrench, atol=1e-9)
    np.testing.assert_allclose(drift_model.correct(raw, drift), wrench, atol=1e-9)


def test_thermometers_outside_the_calibrated_range_are_named(
    make_model,
):
    model = make_model(TRUTH, thermometers=3)
    narrow = make_model({'force_z': TRUTH['force_z']}, thermometers=3, range_c=(10.0, 40.0))
    model = replace(model, axes={**model.axes, **narrow.axes})
    assert model.outside(np.array([10.0, 25.0, 40.0])) == []
    assert model.outside(np.array([9.9, 25.0, 40.1])) == [0, 2]


class TestUncertainty:
    @pytest.fixture
    def calibrated(self, make_model):
        """Force x drifts, force y does not, force z drifts but was not calibrated by us."""
        axes = {'force_x': (-0.5, 0.0, 10.0), 'force_z': (2.0, 0.0, 10.0)}
        model = make_model(axes, range_c=(10.0, 40.0))
        return replace(model, deviation={'force_x': 0.3, 'force_y': 0.2})

    def test_it_is_what_the_model_leaves_and_more_with_every_range_beyond(self, calibrated):
        """A range is 30 K here."""
        celsius = np.array([10, 33.3, 40, 9, -20, 40.3, 100])
        ranges = np.array([0, 0, 0, 1 / 30, 1, 0.01, 2])
        deviations = calibrated.uncertainty(celsius[:, np.newaxis])
        np.testing.assert_allclose(deviations[:, 0], 0.3 * np.sqrt(1 + ranges**2))
        np.testing.assert_array_equal(deviations[:, 1:], [[0.2] + [np.nan] * 4] * 7)
        np.testing.assert_array_equal(calibrated.uncertainty(celsius[4:5]), deviations[4])

    def test_without_any_calibration_nothing_is_known(self, make_model):
        assert np.isnan(make_model(TRUTH).uncertainty(np.array([25.0]))).all()


class TestRefusals:
    def test_an_unknown_axis(self, model):
        with pytest.raises(ModelFileError, match=r"Unknown axis 'force_q'; .* force_x, force_y, "):
            replace(model, axes={'force_q': model.axes['force_x']})

    def test_another_number_of_thermometers(self, model):
        with pytest.raises(ModelFileError, match='expects 2 thermometers, the model has 1'):
            replace(model, thermometers=1)

    def test_no_period_or_no_thermometer(self, model):
        assert replace(model, period_ns=1).period_ns == 1
        for period_ns, thermometers in ((0, 2), (10**9, 0)):
            with pytest.raises(ModelFileError) as refusal:
                replace(model, period_ns=period_ns, thermometers=thermometers)
            assert str(refusal.value) == (
                'A model needs a positive thermal period and at least one thermometer; got '
                f'{period_ns} ns and {thermometers}.'
            )

    def test_features_that_do_not_fit_the_dynamics(self, model):
        axis = model.axes['force_x']
        features = Features('powers', np.zeros(2), np.zeros(2), np.ones(2), degree=2)
        with pytest.raises(ModelFileError, match='features give 4 inputs, the dynamics expect 2'):
            AxisModel(features, axis.dynamics)

    def test_a_third_output(self, model):
        axis = model.axes['force_x']
        three = replace(
            axis.dynamics,
            output_loadings=np.ones((3, 1)),
            output_weight=np.ones(3),
            output_mean=np.zeros(3),
        )
        with pytest.raises(ModelFileError, match=r'^An axis has one output .* or two .* got 3\.$'):
            AxisModel(axis.features, three)
