"""The drift of one axis, against the textbook loop, and of a sensor; what a model refuses."""

from dataclasses import replace

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.drift import drift_model
from wrist_ft_comp.drift.arx_pls import Arx, ArxPls, free_run, relaxation, static_gain
from wrist_ft_comp.drift.drift_model import AxisModel, ThermometerPrediction
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.errors import ModelFileError

#: Per axis: gain of zero drift, of sensitivity drift, time constant.
TRUTH = {'force_x': (0.5, 1e-3, 40.0), 'force_z': (-2.0, 0.0, 300.0), 'torque_y': (0.03, 2e-3, 9)}


def test_drift_is_the_textbook_lag_on_its_axes_and_zero_on_others(make_model, lagged):
    model = make_model(TRUTH, thermometers=2)
    temperature_c = 20 + np.cumsum(np.random.default_rng(0).standard_normal((80, 2)), axis=0)
    _, track = drift_model.run(model, drift_model.start(model, temperature_c[0]), temperature_c)
    mean_theta = temperature_c.mean(axis=1) - 20
    for i, axis in enumerate(AXES):
        zero, sensitivity, tau = TRUTH.get(axis, (0.0, 0.0, 1.0))
        moved = lagged(mean_theta, tau, period_s=1.0)
        np.testing.assert_allclose(track.zero[:, i], zero * moved, atol=1e-10)
        np.testing.assert_allclose(track.sensitivity[:, i], sensitivity * moved, atol=1e-10)


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


#: Of static gain 1: two relaxations, and one that is of second order and late.
FILTERS = (
    relaxation(30.0, 10.0),
    relaxation(400.0, 10.0),
    Arx(np.array([-1.2, 0.5]), np.array([0.2, 0.1]), 2),
)
LATENTS = (static_gain(), relaxation(100.0, 10.0), Arx(np.array([-0.7]), np.array([0.5, 0.2]), 1))
LOWER_C, UPPER_C = np.array([15.0, 18.0]), np.array([45.0, 38.0])


def make_axis(filters=FILTERS, latents=LATENTS, outputs=2):
    """Two thermometers, two powers of each filtered temperature, random gains."""
    rng = np.random.default_rng([len(filters), len(latents), outputs])
    count = max(len(filters), 1)
    celsius = [30.0, 25.0], LOWER_C, UPPER_C
    reference_c, lower_c, upper_c = (np.tile(of_two, count) for of_two in celsius)
    inputs = 4 * count
    dynamics = ArxPls(
        input_mean=rng.standard_normal(inputs), input_weight=rng.uniform(0.1, 1.0, inputs),
        rotations=rng.standard_normal((inputs, len(latents))), latents=latents,
        output_loadings=rng.standard_normal((outputs, len(latents))),
        output_weight=rng.uniform(0.5, 2.0, outputs), output_mean=rng.standard_normal(outputs),
    )  # fmt: skip
    features = Features('powers', reference_c, lower_c, upper_c, degree=2)
    return AxisModel(features, dynamics, filters)


@pytest.fixture(scope='module')
def wandering_c():
    """Wandering, and at first and for some time outside what was calibrated, on both sides."""
    steps = np.random.default_rng(0).standard_normal((120, 2))
    track = 28 + np.cumsum(steps, axis=0)
    track[0], track[30:35], track[80:85] = (500.0, -500.0), -60.0, 130.0
    return track


every_form = pytest.mark.parametrize(
    ('filters', 'latents'),
    [
        ((), LATENTS), (FILTERS, (static_gain(),)), (FILTERS, LATENTS), ((), (static_gain(),)),
        (FILTERS[:1], (static_gain(), static_gain(0.3))), ((static_gain(), FILTERS[1]), LATENTS),
    ],
    ids=['paper', 'relaxations', 'both', 'static', 'one relaxation', 'static and relaxed'],
)  # fmt: skip


@every_form
@pytest.mark.parametrize('outputs', [1, 2])
def test_a_run_is_the_textbook_loop(wandering_c, filters, latents, outputs):
    """Clamp, filter, take powers, score, run the latents, load; one after the other."""
    axis = make_axis(filters, latents, outputs)
    assert (axis.thermometers, axis.outputs) == (2, outputs)
    _, track = axis.run(axis.start(wandering_c[0]), wandering_c)
    margin = 3 * (UPPER_C - LOWER_C)
    held = np.minimum(np.maximum(wandering_c, LOWER_C - margin), UPPER_C + margin)
    filtered = [free_run(one, held[:, j]) for one in filters or (static_gain(),) for j in (0, 1)]
    x = axis.features.expand(np.stack(filtered, axis=1))  # see test_features
    dynamics = axis.dynamics
    t = ((x - dynamics.input_mean) * dynamics.input_weight) @ dynamics.rotations
    u = np.stack([free_run(h, t[:, r]) for r, h in enumerate(latents)], axis=1)
    expected = dynamics.output_mean + u @ dynamics.output_loadings.T / dynamics.output_weight
    assert track.shape == (120, outputs)
    np.testing.assert_allclose(track, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())


@every_form
@settings(max_examples=15, derandomize=True)
@given(cuts=st.sets(st.integers(1, 119), max_size=4))
def test_a_run_split_anywhere_is_the_fold_of_cells(wandering_c, filters, latents, cuts):
    axis = make_axis(filters, latents)
    state = first = axis.start(wandering_c[0])
    rows = []
    for row in wandering_c:
        state, one = axis.run(state, row[np.newaxis])
        rows.append(one[0])
    again, parts = first, []
    for part in np.split(wandering_c, sorted(cuts)):
        again, drift = axis.run(again, part)
        parts.append(drift)
    scale = np.abs(rows).max()
    np.testing.assert_allclose(np.concatenate(parts), rows, rtol=1e-12, atol=1e-13 * scale)
    np.testing.assert_allclose(again, state, rtol=1e-11, atol=1e-12 * scale)
    for cells in (1, 3):
        end, _ = axis.run(first, np.repeat(wandering_c, cells, axis=0))
        skipped = axis.skip(first, wandering_c, cells)
        np.testing.assert_allclose(skipped, end, rtol=1e-9, atol=1e-11 * scale)


def test_the_excess_is_counted_in_calibrated_ranges_of_at_least_a_kelvin():
    span, axis = UPPER_C - LOWER_C, make_axis()
    at = np.array([LOWER_C, LOWER_C - [0.1 * span[0], 0], UPPER_C + [0.2, 2.0] * span])
    np.testing.assert_allclose(axis.beyond_range(at), [[0, 0], [0.1, 0], [0.2, 2]], atol=1e-12)
    features = axis.features
    still = replace(axis, features=replace(features, upper_c=features.lower_c))
    assert still.beyond_range(LOWER_C + 5.0).tolist() == [5.0, 5.0]


def test_predicted_thermometers_and_outputs_that_do_not_fit_are_refused():
    parts = np.zeros(1), np.zeros((2, 1, 2)), np.zeros(2), *np.ones((3, 2))
    assert ThermometerPrediction(*parts).predict(np.ones((1, 2))).tolist() == [0, 0]
    with pytest.raises(ModelFileError, match='shape of still_k'):
        ThermometerPrediction(*parts[:3], np.ones(3), *parts[4:])
    with pytest.raises(ModelFileError, match='number of outputs'):
        make_axis(outputs=3)
