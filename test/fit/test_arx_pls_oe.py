"""Method ``arx_pls_oe``: time constants and gains that are found, with errors, or refused."""

import numpy as np
import pytest

from wrist_ft_comp.fit.calibrate import identify_axis
from wrist_ft_comp.fit.settings import IdentificationSettings


@pytest.fixture(scope='module')
def pose_lags(make_axis_data, warm_up, lagged):
    """Drift of N/K behind each time constant, with a square and noise."""

    def make(truth, *, noise=0.05, cells=300, days=2):
        temperatures = [warm_up(cells, 40 + i) for i in range(days)]
        raws = []
        for i, temperature_c in enumerate(temperatures):
            theta = [gain * (lagged(temperature_c, tau) - 30) for tau, gain in truth.items()]
            zero = sum(part + 0.02 * part**2 for part in theta)
            rng = np.random.default_rng([40 + i, 5])
            raws.append(zero + noise * rng.standard_normal((2, cells))[1])
        return make_axis_data(temperatures, raws)

    return make


@pytest.mark.parametrize('truth', [{300.0: 0.5}, {120.0: 0.5, 1500.0: -0.5}], ids=str)
def test_time_constants_are_found_within_their_standard_errors(pose_lags, truth):
    fit = identify_axis(pose_lags(truth, days=3), IdentificationSettings('arx_pls_oe'))
    assert fit.chosen.startswith(f'{len(truth)} time constant')
    assert len(fit.time_constants_s) == len(truth)
    times = zip(truth, fit.time_constants_s, fit.time_constant_errors_s, strict=True)
    for true, tau_s, error_s in times:
        assert abs(tau_s - true) < 3 * error_s < 0.2 * true


def test_a_drift_without_a_lag_is_static(pose_lags):
    fit = identify_axis(pose_lags({1e-3: 0.5}), IdentificationSettings('arx_pls_oe'))
    assert fit.chosen.startswith('static, degree ')
    assert (fit.time_constants_s, fit.time_constant_errors_s) == ((), ())
    assert fit.rms_after < 0.07


def test_a_drift_that_lasts_longer_than_the_recordings_is_refused_with_numbers(pose_lags):
    problem = pose_lags({1e5: 20.0}, noise=0.01)
    fit = identify_axis(problem, IdentificationSettings('arx_pls_oe'))
    assert (fit.model, fit.chosen) == (None, 'none')
    assert 'its slowest time constant is at least 3000 s' in fit.refusal
    assert 'Record at least 1.7 h from cold' in fit.refusal
    assert fit.rms_after == fit.rms_before
