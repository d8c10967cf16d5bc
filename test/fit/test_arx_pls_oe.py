"""Method ``arx_pls_oe``: time constants and gains that are found, with errors, or refused."""

from dataclasses import replace

import numpy as np
import pytest

from wrist_ft_comp.fit.axis_data import build_features
from wrist_ft_comp.fit.calibrate import identify_axis
from wrist_ft_comp.fit.folds import unexplained
from wrist_ft_comp.fit.named_methods import fit_lags
from wrist_ft_comp.fit.settings import IdentificationSettings

CELLS = 200


@pytest.fixture(scope='module')
def pose_lags(make_axis_data, warm_up, lagged):
    """Drift of N/K behind each time constant, with a square and noise."""

    def make(truth, *, loaded=False, thermometers=1, noise=0.05, cells=300, days=2):  # noqa: PLR0913
        temperatures, raws, loads = [], [], []
        for i in range(days):
            rng = np.random.default_rng([40 + i, 5])
            both = np.stack(
                [warm_up(cells, 40 + i + 100 * j) for j in range(thermometers)], axis=1
            )
            mean_c = both.mean(axis=1)
            theta = [gain * (lagged(mean_c, tau) - 30) for tau, gain in truth.items()]
            zero = sum(part + 0.02 * part**2 for part in theta)
            loads.append(40 * rng.standard_normal(cells))
            raw = (1 + 2e-3 * zero) * loads[-1] * loaded + zero
            temperatures.append(both)
            raws.append(raw + noise * rng.standard_normal(cells))
        return make_axis_data(temperatures, raws, loads if loaded else None)

    return make


@pytest.mark.parametrize(('loaded', 'thermometers'), [(False, 1), (True, 2)])
@pytest.mark.parametrize('kind', ['powers', 'hats'])
def test_every_candidate_is_the_least_squares_fit_behind_its_relaxations(
    pose_lags, lagged, loaded, thermometers, kind
):
    """What is left is orthogonal to each feature, relaxed by the textbook loop."""
    problem = pose_lags({250.0: 0.5}, loaded=loaded, thermometers=thermometers)
    knots = (20.0, 27.0, 35.0, 45.0) if kind == 'hats' else ()
    settings = IdentificationSettings('arx_pls_oe', kind, hat_temperatures_c=knots)
    for count, degree in ((0, 1), (1, 2 if kind == 'powers' else 1), (2, 1)):
        features = build_features(problem.temperature_c, replace(settings, degree=degree))
        model, _ = fit_lags(features, count, problem)
        time_constants_s = -10.0 / np.log([-lag.a[0] for lag in model.filters])
        assert len(model.filters) == count
        columns = []
        for i, temperature_c in enumerate(problem.temperature_c):
            behind = [
                np.stack([lagged(t, tau) if tau else t for t in temperature_c.T], axis=1)
                for tau in time_constants_s.tolist() or [0.0]
            ]
            x = np.concatenate([features.expand(t) for t in behind], axis=1)
            x = (
                np.column_stack((x, x * problem.load[i][:, None], problem.load[i]))
                if loaded
                else x
            )
            columns.append(x - x.mean(axis=0))
        x, left = (
            np.concatenate(columns),
            np.concatenate([rest - rest.mean() for rest in unexplained(problem, model)]),
        )
        size = np.linalg.norm(x, axis=0)
        correlation = (left @ x)[size > 0] / size[size > 0] / np.linalg.norm(left)
        np.testing.assert_allclose(correlation, 0, atol=1e-6)


@pytest.mark.parametrize('truth', [{300.0: 0.5}, {120.0: 0.5, 1500.0: -0.5}], ids=str)
def test_time_constants_are_found_within_their_standard_errors(pose_lags, truth):
    fit = identify_axis(pose_lags(truth, days=3), IdentificationSettings('arx_pls_oe'))
    assert fit.chosen.startswith(f'{len(truth)} time constant')
    assert len(fit.time_constants_s) == len(truth)
    times = zip(truth, fit.time_constants_s, fit.time_constant_errors_s, strict=True)
    for true, tau_s, error_s in times:
        assert abs(tau_s - true) < 3 * error_s < 0.2 * true


def test_a_drift_without_a_lag_is_static(make_axis_data, warm_up):
    rng, temperatures = np.random.default_rng(0), [warm_up(CELLS, i) for i in range(2)]
    raws = [0.5 * t + 0.05 * rng.standard_normal(CELLS) for t in temperatures]
    data = make_axis_data(temperatures, raws)
    fit = identify_axis(data, IdentificationSettings('arx_pls_oe'))
    assert fit.chosen.startswith('static, degree ')
    assert (fit.time_constants_s, fit.time_constant_errors_s) == ((), ())
    assert fit.rms_after < 0.07


def test_a_drift_that_lasts_longer_than_the_recordings_is_refused_with_numbers(pose_lags):
    problem = pose_lags({1e5: 20.0}, noise=0.01)
    fit = identify_axis(problem, IdentificationSettings('arx_pls_oe'))
    assert (fit.model, fit.chosen) == (None, 'none')
    assert fit.refusal.startswith('force_z drifts too slowly for these recordings: ')
    assert 'its slowest time constant is at least 3000 s, as long as' in fit.refusal
    assert fit.refusal.endswith('Record at least 1.7 h from cold, or choose the method pls')
    assert fit.reason == f'{fit.refusal}.'
    assert fit.rms_after == fit.rms_before
