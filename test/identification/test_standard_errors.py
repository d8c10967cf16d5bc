"""Standard errors: over many repetitions, estimates scatter by as much as they say."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from wrist_ft_comp.identification.bins import bin_axis_data
from wrist_ft_comp.identification.standard_errors import by_relaxation, fit_gains
from wrist_ft_comp.identification.time_constants import search_time_constants
from wrist_ft_comp.model.features import Features

LINE = Features('powers', np.array([30.0]), np.zeros(1), np.full(1, 99.0))
CELLS = 720
PERIOD_S = 10.0
TAU_S, GAIN, SENSITIVITY = 400.0, 0.5, 1e-3
SIGMA = 0.2
REPETITIONS = 60
#: AR(1) noise is correlated over this time, s.
CORRELATED_S = 100.0


@pytest.fixture(scope='module', params=['unloaded', 'recorded'])
def clean(request, make_axis_data, warm_up, lagged):
    """Three recordings of 2 h of one lag, with a load that changes quickly, without noise."""
    rng = np.random.default_rng(0)
    temperatures, raws, loads = [warm_up(CELLS, i) for i in range(3)], [], []
    for i, temperature_c in enumerate(temperatures):
        theta = lagged(temperature_c, TAU_S) - 30
        load = 40 * rng.standard_normal(CELLS) * (request.param == 'recorded')
        raws.append((1 + SENSITIVITY * theta) * load + GAIN * theta + 7 * i)
        loads.append(load)
    return make_axis_data(temperatures, raws, loads if request.param == 'recorded' else None)


def noise(rng, correlated_s):
    """Noise of deviation SIGMA, from its steady state."""
    white = rng.standard_normal(CELLS + 200)
    if not correlated_s:
        return SIGMA * white[200:]
    pole = np.exp(-PERIOD_S / correlated_s)
    return SIGMA * np.sqrt(1 - pole**2) * signal.lfilter([1.0], [1.0, -pole], white)[200:]


def fit_noisy(clean, seed, correlated_s):
    rng = np.random.default_rng([seed, 1])
    residual = tuple(values + noise(rng, correlated_s) for values in clean.residual)
    cells = bin_axis_data(replace(clean, residual=residual), 1)
    return fit_gains(cells, LINE, search_time_constants(cells, LINE, np.array([300.0])))


def scatter(clean, correlated_s):
    """Root mean square of z-scores of τ and gains, and deviation of the estimates."""
    truth = np.array([TAU_S, GAIN, SENSITIVITY])
    estimates, stated = [], []
    for seed in range(REPETITIONS):
        fit = fit_noisy(clean, seed, correlated_s)
        estimates.append([fit.time_constants_s[0], *fit.gains[0, 0]])
        stated.append([fit.time_constant_errors_s[0], *fit.gain_errors[0, 0]])
    z = (np.array(estimates) - truth[: len(estimates[0])]) / np.array(stated)
    return np.sqrt(np.mean(z**2, axis=0)), np.std(estimates, axis=0)


def naive_errors(clean, lagged):
    """The textbook's for white noise of deviation SIGMA: σ² (JᵀJ)⁻¹, of τ and zero gain."""
    information = np.zeros((2, 2))
    for temperature_c in clean.temperature_c:
        slower, faster, here = (
            lagged(temperature_c[:, 0], tau) for tau in (TAU_S + 1, TAU_S - 1, TAU_S)
        )
        jacobian = np.stack((GAIN * (slower - faster) / 2, here), axis=1)
        jacobian -= jacobian.mean(axis=0)
        information += jacobian.T @ jacobian
    return SIGMA * np.sqrt(np.diagonal(np.linalg.inv(information)))


def test_with_white_noise_estimates_scatter_as_stated(clean):
    z, _ = scatter(clean, 0.0)
    assert len(z) == (2 if clean.load is None else 3)
    assert (z > 0.75).all()
    assert (z < 1.3).all()


def test_with_correlated_noise_they_scatter_by_little_more_where_the_textbook_fails(clean, lagged):
    z, scattered = scatter(clean, CORRELATED_S)
    assert (z > 0.75).all()
    assert (z < 1.6).all()
    # Sensitivity has its own column, whose quick load makes this noise white.
    assert (scattered[:2] > 2.5 * naive_errors(clean, lagged)).all()


class TestWhatCannotBeSaid:
    def test_too_few_stretches_give_no_errors(self, clean):
        """Six cells for three constants, two gains and a time constant leave nothing over."""
        short = replace(
            clean,
            temperature_c=tuple(values[:2] for values in clean.temperature_c),
            residual=tuple(values[:2] for values in clean.residual),
            load=None if clean.load is None else tuple(values[:2] for values in clean.load),
            folds=tuple(values[:2] for values in clean.folds),
        )
        fit = fit_gains(bin_axis_data(short, 1), replace(LINE, degree=2), np.array([TAU_S]))
        assert np.isnan(fit.time_constant_errors_s).all()
        assert np.isnan(fit.gain_errors).all()
        assert np.isfinite(fit.gains).all()

    def test_a_thermometer_that_stands_still_has_no_error(self, clean):
        rng = np.random.default_rng(0)
        both = replace(
            clean,
            temperature_c=tuple(
                np.column_stack((values, np.full(CELLS, 22.0))) for values in clean.temperature_c
            ),
            residual=tuple(values + noise(rng, 0.0) for values in clean.residual),
        )
        features = Features('powers', np.array([30.0, 20.0]), np.zeros(2), np.full(2, 99.0))
        fit = fit_gains(bin_axis_data(both, 1), features, np.array([TAU_S]))
        problem = bin_axis_data(replace(clean, residual=both.residual), 1)
        alone = fit_gains(problem, LINE, np.array([TAU_S]))
        assert np.isnan(fit.gain_errors[0, 1, 0])
        assert fit.gains[0, 1, 0] == 0
        # Beside a load its sensitivity still counts as a gain, of the few that 36 stretches allow.
        np.testing.assert_allclose(fit.gain_errors[0, 0], alone.gain_errors[0, 0], rtol=0.02)


@pytest.mark.parametrize('loaded', [False, True])
def test_values_are_sorted_by_relaxation_feature_and_output(loaded):
    """In the order of columns: output, relaxation, feature, and the load last."""
    named = [
        100 * m + 10 * k + f for m in range(1 + loaded) for k in range(2) for f in range(3)
    ] + [-1.0] * loaded
    values = by_relaxation(np.array(named, dtype=float), 2, 3, loaded=loaded)
    assert values.shape == (2, 3, 1 + loaded)
    for (k, f, m), value in np.ndenumerate(values):
        assert value == 100 * m + 10 * k + f
