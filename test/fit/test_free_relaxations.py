"""What was fitted to free time constants is what runs, and too slow a drift is refused."""

import numpy as np
import pytest

from wrist_ft_comp.fit.calibrate import identify_axis
from wrist_ft_comp.fit.cross_validation import build_candidate_data, cross_validate
from wrist_ft_comp.fit.feature_banks import build_features
from wrist_ft_comp.fit.free_relaxations import _fit, _structures
from wrist_ft_comp.fit.result import OUTPUTS
from wrist_ft_comp.fit.settings import IdentificationSettings

CELLS = 300
OUTPUT_ERROR = IdentificationSettings('arx_pls_oe')


@pytest.fixture(scope='module')
def make_problem(make_axis_data, warm_up, lagged):
    """Drift of N/K behind each time constant, with a square and noise."""

    def make(truth, *, loaded=False, thermometers=1, noise=0.05):
        temperatures, raws, loads = [], [], []
        for i in range(2):
            rng = np.random.default_rng([i, 5])
            both = np.stack([warm_up(CELLS, i + 100 * j) for j in range(thermometers)], axis=1)
            theta = [gain * (lagged(both.mean(axis=1), tau) - 30) for tau, gain in truth.items()]
            zero = sum(each + 0.02 * each**2 for each in theta)
            loads.append(40 * rng.standard_normal(CELLS))
            raw = (1 + 2e-3 * zero) * loads[-1] * loaded + zero
            temperatures.append(both)
            raws.append(raw + noise * rng.standard_normal(CELLS))
        return make_axis_data(temperatures, raws, loads if loaded else None)

    return make


@pytest.mark.parametrize(('loaded', 'thermometers'), [(False, 1), (True, 2)])
@pytest.mark.parametrize('kind', ['powers', 'hats'])
def test_what_was_fitted_is_what_runs(make_problem, lagged, loaded, thermometers, kind):
    """Of every candidate, by its terms."""
    problem = make_problem({250.0: 0.5}, loaded=loaded, thermometers=thermometers)
    knots = (20.0, 27.0, 35.0, 45.0) if kind == 'hats' else ()
    settings = IdentificationSettings('arx_pls_oe', kind, hat_temperatures_c=knots)
    data = build_candidate_data(problem, build_features(problem.temperature_c, settings))
    structures = _structures(settings, data.features)
    assert len(structures) == (3 if kind == 'hats' else 5)
    temperature_c = problem.temperature_c[0]
    for structure in structures:
        _, tau_s = cross_validate(data, structure)
        features, fitted = data.features_of(structure), _fit(data, structure, tau_s)
        assert len(fitted.time_constants_s) == structure.free_time_constants
        expected = np.zeros((CELLS, 1 + loaded))
        for term in fitted.terms:
            behind = [lagged(column, term.time_constant_s) for column in temperature_c.T]
            x = features.expand(np.stack(behind, axis=1))[:, features.names.index(term.feature)]
            expected[:, OUTPUTS.index(term.output)] += term.gain * x
        _, drift = fitted.model.run(fitted.model.start(temperature_c[0]), temperature_c)
        spread = np.ptp(drift - expected, axis=0)
        np.testing.assert_array_less(spread, 1e-9 * np.ptp(expected, axis=0))


def test_a_drift_that_goes_on_for_longer_than_the_recordings_is_refused_with_numbers(make_problem):
    fit = identify_axis(make_problem({1e5: 20.0}, noise=0.01), OUTPUT_ERROR)
    assert (fit.model, fit.chosen) == (None, 'none')
    assert fit.refusal.startswith('force_z drifts too slowly for these recordings: ')
    assert 'its slowest time constant is at least 3000 s, as long as' in fit.refusal
    assert fit.refusal.endswith('Record at least 1.7 h from cold, or choose the method pls')
    assert fit.reason == f'{fit.refusal}.'
    assert fit.rms_after == fit.rms_before
