"""What ``auto`` does at the plateaus of a chamber test: piecewise linear drift."""

import numpy as np
import pytest

from wrist_ft_comp.fit.calibrate import identify_axis
from wrist_ft_comp.fit.settings import IdentificationSettings

CELLS = 50


@pytest.fixture(scope='module')
def chamber(make_axis_data):
    """Plateaus with the same steps of load at each, and silence between them."""

    def make(plateaus_c, zero, gain, noise=0.05):
        rng = np.random.default_rng(0)
        temperature_c = np.repeat(plateaus_c, CELLS).astype(float)
        load = np.tile(np.repeat(np.linspace(-50, 50, 10), CELLS // 10), len(plateaus_c))
        raw = zero(temperature_c) + (1 + gain(temperature_c)) * load
        raw = raw + noise * rng.standard_normal(len(raw))
        # The last fifth of a plateau is the way to the next.
        raw[np.arange(len(raw)) % CELLS >= CELLS * 4 // 5] = np.nan
        data = make_axis_data([temperature_c], [raw], [load])
        assert len(data.fold_numbers) == len(plateaus_c)
        assert not data.tared
        return data

    return make


def drift_at(fit, celsius):
    """Zero and gain drift of a sensor that has soaked, (n, M)."""
    rows = np.array(celsius, dtype=float)[:, np.newaxis]
    return np.stack([fit.model.step(fit.model.start(row), row)[1] for row in rows])


def test_piecewise_linear_zero_drift_is_learnt_and_the_gain_left_alone(chamber):
    """Of three plateaus the two at the ends foretell the gain little better than none."""
    data = chamber(
        [0, 30, 60], lambda t: 0.5 * t + 0.3 * np.maximum(t - 30, 0), lambda t: 1e-3 * (t - 30)
    )
    fit = identify_axis(data, IdentificationSettings())
    assert (fit.chosen, fit.model.outputs) == ('zero drift in hats', 1)
    assert any('gain drift held no better than none' in note for note in fit.notes)
    drift = drift_at(fit, [0, 15, 30, 45, 60])[:, 0]
    np.testing.assert_allclose(drift - drift[0], [0, 7.5, 15, 27, 39], atol=0.5)


def test_gain_drift_is_learnt_where_it_holds_at_temperatures_left_out(chamber):
    plateaus = np.arange(0, 66, 6)
    data = chamber(plateaus, lambda t: 0.5 * t, lambda t: 0.03 + 1e-3 * (t - 30))
    fit = identify_axis(data, IdentificationSettings())
    assert (fit.chosen, fit.model.outputs) == ('zero and gain drift in hats', 2)
    gains = drift_at(fit, [0, 15, 30, 45, 60])[:, 1]
    np.testing.assert_allclose(gains, [0, 0.015, 0.03, 0.045, 0.06], atol=1e-3)


def test_of_a_gain_that_does_not_drift_nothing_is_learnt(chamber):
    data = chamber(np.arange(0, 66, 6), lambda t: 0.5 * t, lambda t: 0.03 + 0 * t)
    assert identify_axis(data, IdentificationSettings()).model.outputs == 1


def test_noise_is_left_alone(chamber):
    data = chamber([0, 20, 40, 60], lambda t: 0 * t, lambda t: 0 * t, noise=1.0)
    fit = identify_axis(data, IdentificationSettings())
    assert (fit.model, fit.chosen) == (None, 'none')
