"""The competition: known truths are found, noise is left alone, every method runs."""

import numpy as np
import pytest

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.drift import drift_model
from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.fit.axis_data import build_features
from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.settings import CalibrationSettings, IdentificationSettings, METHODS, Orders
from wrist_ft_comp.report.evaluation import judge_errors, tared_errors

Z = AXES.index('force_z')
CELLS = 360
OF_CALIBRATION = {'reference', 'min_temperature_span_k'}


def settings(method, reference='unloaded', **more):
    return CalibrationSettings(reference, identification=IdentificationSettings(method, **more))


def drift_of(calibration, recording):
    """Zero and sensitivity drift of force z over a recording."""
    temperature_c = recording.temperature_c
    first = drift_model.start(calibration.model, temperature_c[0])
    _, drift = drift_model.run(calibration.model, first, temperature_c)
    return drift.zero[:, Z], drift.sensitivity[:, Z]


def centred(values):
    return values - values.mean()


class TestKnownTruth:
    def test_lags_are_found_in_a_record_that_was_not_seen(self, simulate, lagged):
        truth = {200.0: 0.6, 1500.0: -0.4}
        calibration = calibrate([simulate(i, truth) for i in range(3)], settings('auto'))
        new = simulate(9, truth, share=0.8)
        theta = new.temperature_c[:, 0] - 30
        expected = centred(sum(gain * lagged(theta, tau) for tau, gain in truth.items()))
        zero, sensitivity = drift_of(calibration, new)
        assert np.std(centred(zero) - expected) < 0.01 * np.std(expected)
        assert not sensitivity.any()

    def test_sensitivity_drift_is_found_beside_zero_drift(self, simulate, lagged):
        zero, sensitivity, gain_error = {600.0: 0.5}, {600.0: 1e-3}, 0.15
        recordings = [simulate(i, zero, sensitivity, gain_error=gain_error) for i in range(3)]
        calibration = calibrate(recordings, settings('arx_pls_oe', 'recorded'))
        new = simulate(9, zero, sensitivity, gain_error=gain_error, share=0.8)
        theta = lagged(new.temperature_c[:, 0] - 30, 600.0)
        fitted_zero, fitted_sensitivity = drift_of(calibration, new)
        np.testing.assert_allclose(centred(fitted_zero), centred(0.5 * theta), atol=0.02)
        np.testing.assert_allclose(fitted_sensitivity, gain_error + 1e-3 * theta, atol=2e-4)
        nearest = min(abs(tau / 600 - 1) for tau in calibration.fits['force_z'].time_constants_s)
        assert nearest < 1e-2


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize(
    ('thermometers', 'features', 'loaded'),
    [(2, 'powers', True), (2, 'hats', False), (1, 'hats', True)],
)
def test_every_method_removes_drift(simulate, method, thermometers, features, loaded):
    def record(seed, share=1.0):
        sensitivity = {200.0: 1e-3} if loaded else None
        drift = {200.0: 0.5}, sensitivity
        return simulate(seed, *drift, noise=0.1, thermometers=thermometers, share=share)

    chosen = settings(method, 'recorded' if loaded else 'unloaded', features=features)
    calibration = calibrate([record(i) for i in range(3)], chosen)
    fit = calibration.fits['force_z']
    assert fit.model.features.kind == features
    hats_by_auto = method == 'auto' and features == 'hats'  # which leave the gain alone
    assert fit.model.outputs == 1 + (loaded and not hats_by_auto)
    assert fit.rms_after < fit.rms_before
    errors = tared_errors(calibration.model, record(9, 0.8), chosen.reference)
    judged = judge_errors([errors])['force_z']
    dynamic = method in ('filtered_pls', 'arx_pls_oe', 'auto') and not hats_by_auto
    assert judged.rms_after < (0.35 if dynamic else 0.9) * judged.rms_before


#: Sums of arx_pls_oe are those of auto, and its constants are fixed as those of the others.
@pytest.mark.parametrize('method', [name for name in METHODS if name != 'arx_pls_oe'])
def test_loads_of_whole_recordings_give_no_wild_gain(make_recording, warm_up, method):
    """The gain error at T_ref cannot be separated from the constants then."""
    runs = []
    for i, payload in enumerate((0.0, 50.1, 20.3)):
        temperature_c = warm_up(CELLS, i)
        theta = temperature_c - 30
        raw = (1 + 1e-3 * theta) * payload + 0.5 * theta
        raw += 0.01 * np.random.default_rng(i).standard_normal(CELLS)
        runs.append(make_recording(temperature_c, {'force_z': raw}, {'force_z': payload}))
    _, sensitivity = drift_of(calibrate(runs, settings(method, 'recorded')), runs[0])
    assert np.abs(sensitivity).max() < 0.1


def test_hats_stand_on_the_plateaus():
    plateaus = np.repeat([20.0, -15.0, 50.0], 40)[:, np.newaxis]
    plateaus[::3] = np.nextafter(plateaus[::3], 99)  # means of different numbers of readings
    hats = IdentificationSettings(features='hats')
    slope = np.linspace(0, 50, 500)[:, np.newaxis]
    for temperature_c, knots in ((plateaus, [-15.0, 20.0, 50.0]), (slope, np.linspace(0, 50, 6))):
        np.testing.assert_allclose(build_features([temperature_c], hats).knots_c[0], knots)


@pytest.mark.parametrize(('change', 'sentence'), [
    ({'reference': 'none'}, "Unknown reference 'none'; .* unloaded, constant"),
    *(({'min_temperature_span_k': k}, 'at least 0; got') for k in (-0.1, np.nan, np.inf)),
    ({'method': 'magic'}, "Unknown method 'magic'; expected one of pcr"),
    ({'features': 'hat'}, "Unknown features 'hat'"), ({'n': -1, 'm': 1}, '^n must'),
    ({'n': 1, 'm': 0}, '^m must'), ({'n': 1, 'm': 1, 'd': -1}, '^d must'),
    *(({'degree': n}, f'between 1 and 4; got {n}') for n in (0, 5, 2.5, np.nan)),
])  # fmt: skip
def test_settings_outside_their_range_are_refused(change, sentence):
    kind = CalibrationSettings if OF_CALIBRATION & set(change) else IdentificationSettings
    if 'n' in change:
        kind = Orders
    with pytest.raises(SettingsError, match=sentence):
        kind(**change)
