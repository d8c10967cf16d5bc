"""What the competition fitted is what runs, and a drift that is too slow is refused."""

import numpy as np
import pytest

from wrist_ft_comp.calibration.auto import _fit, choose_trend
from wrist_ft_comp.calibration.calibrate import identify_axis
from wrist_ft_comp.calibration.candidates import build_candidate_data, structures
from wrist_ft_comp.calibration.cross_validation import cross_validate
from wrist_ft_comp.calibration.features import build_features
from wrist_ft_comp.calibration.result import OUTPUTS
from wrist_ft_comp.calibration.selection import anchor
from wrist_ft_comp.calibration.settings import IdentificationSettings
from wrist_ft_comp.identification.output_error import fit_columns
from wrist_ft_comp.model import drift_model
from wrist_ft_comp.model.drift_model import DriftModel
from wrist_ft_comp.model.signals import AXES

Z = AXES.index('force_z')
CELLS = 300
CASES = [(loaded, thermometers) for loaded in (False, True) for thermometers in (1, 2)]
KNOTS_C = (20.0, 27.0, 35.0, 45.0)


@pytest.fixture(scope='module')
def make_problem(make_axis_data, warm_up, lagged):
    """Drift of N/K behind each time constant, with a square, noise and a few gaps."""

    def make(truth, *, loaded=False, thermometers=1, noise=0.05, cells=CELLS):
        temperatures, raws, loads = [], [], []
        for i in range(2):
            rng = np.random.default_rng([i, 5])
            both = np.stack([warm_up(cells, i + 100 * j) for j in range(thermometers)], axis=1)
            relaxed = {tau: lagged(both.mean(axis=1), tau) - 30 for tau in truth}
            zero = sum(
                gain * (relaxed[tau] + 0.02 * relaxed[tau] ** 2) for tau, gain in truth.items()
            )
            load = 40 * rng.standard_normal(cells)
            raw = (1 + 2e-3 * zero) * load * loaded + zero + noise * rng.standard_normal(cells)
            raw[rng.uniform(size=cells) < 0.05] = np.nan
            temperatures.append(both)
            raws.append(raw)
            loads.append(load)
        return make_axis_data(temperatures, raws, loads if loaded else None)

    return make


def run(problem, axis):
    """Zero and sensitivity drift of force z as the node makes them, all recordings, (N, M)."""
    thermometers = problem.temperature_c[0].shape[1]
    model = DriftModel(round(problem.period_s * 1e9), thermometers, {'force_z': axis})
    rows = []
    for temperature_c in problem.temperature_c:
        state = drift_model.start(model, temperature_c[0])
        for row in temperature_c:
            state, now = drift_model.step(model, state, row)
            rows.append([now.zero[Z], now.sensitivity[Z]][: axis.outputs])
    return np.array(rows)


def features_behind(problem, features, tau, lagged):
    """Features of the temperatures behind a lag, all recordings, (N, F)."""
    return np.concatenate(
        [
            features.expand(
                np.stack([lagged(column, tau) if tau else column for column in t.T], axis=1)
            )
            for t in problem.temperature_c
        ]
    )


def drift_by_terms(problem, features, fit, lagged):
    """The fit's columns times its gains, term by term, (N, M)."""
    drift = np.zeros((sum(map(len, problem.residual)), 1 + (problem.load is not None)))
    for term in fit.terms:
        x = features_behind(problem, features, term.time_constant_s, lagged)
        column = x[:, features.names.index(term.feature)]
        drift[:, OUTPUTS.index(term.output)] += term.gain * column
    return drift


def assert_same_up_to_a_constant(drift, expected):
    assert drift.shape == expected.shape
    assert (np.ptp(expected, axis=0) > 0).all()
    spread = np.ptp(drift - expected, axis=0)
    np.testing.assert_array_less(spread, 1e-9 * np.ptp(expected, axis=0))


class TestWhatWasFittedIsWhatRuns:
    @pytest.mark.parametrize(('loaded', 'thermometers'), CASES)
    @pytest.mark.parametrize('kind', ['powers', 'hats'])
    def test_of_every_candidate(self, make_problem, lagged, loaded, thermometers, kind):
        """Static, free time constants and banks; by the coefficients that were fitted."""
        problem = make_problem({250.0: 0.5}, loaded=loaded, thermometers=thermometers)
        knots = KNOTS_C if kind == 'hats' else ()
        settings = IdentificationSettings('auto', kind, hat_temperatures_c=knots)
        features = build_features(problem.temperature_c, settings)
        data = choose_trend(build_candidate_data(problem, features))
        moments = data.fitted_moments
        names = []
        for structure in structures(settings, features, moments.time_constants_s):
            score = cross_validate(data, structure)
            fitted = _fit(data, score)
            own_features, inputs = data.features_of(structure), data.inputs(structure)
            if structure.bank_s:
                _, coefficients = fit_columns(moments, structure, moments.everything, inputs)
                gains = coefficients[score.strength][: len(coefficients[0]) - loaded]
                columns = [
                    features_behind(problem, own_features, tau, lagged) for tau in structure.bank_s
                ]
                expected = np.concatenate(columns, axis=1) @ gains.reshape(1 + loaded, -1).T
            else:
                assert len(fitted.time_constants_s) == structure.free_time_constants
                expected = drift_by_terms(problem, own_features, fitted, lagged)
            assert_same_up_to_a_constant(run(problem, anchor(problem, fitted.model)), expected)
            names.append(structure.name)
        assert any('PLS' in name for name in names)
        assert any('ridge' in name for name in names)
        assert len(names) == (6 if kind == 'hats' else 11)

    @pytest.mark.parametrize(
        ('method', 'truth', 'chosen', 'loaded', 'thermometers'),
        [
            ('auto', {1e-6: 0.5}, 'static', True, 1),
            ('auto', {300.0: 0.5}, '1 time constant', False, 2),
            ('arx_pls_oe', {300.0: 0.5}, '1 time constant', True, 2),
            ('arx_pls_oe', {100.0: 0.6, 900.0: -0.5}, '2 time constants', False, 1),
        ],
        ids=str,
    )
    def test_of_the_winner(  # noqa: PLR0913, PLR0917
        self, make_problem, lagged, method, truth, chosen, loaded, thermometers
    ):
        problem = make_problem(truth, loaded=loaded, thermometers=thermometers)
        fit = identify_axis(problem, IdentificationSettings(method))
        assert fit.chosen == f'{chosen}, degree 2'
        assert not fit.doubts
        features = build_features(problem.temperature_c, IdentificationSettings())
        expected = drift_by_terms(problem, features, fit, lagged)
        assert_same_up_to_a_constant(run(problem, fit.model), expected)
        count = max(len(fit.time_constants_s), 1)
        assert len(fit.terms) == count * 2 * thermometers * (1 + loaded)
        pairs = zip(fit.time_constants_s, fit.time_constant_errors_s, strict=True)
        if chosen != 'static':
            for (tau, error), true in zip(pairs, truth, strict=True):
                assert not abs(tau - true) > max(4 * error, 0.2 * true)


class TestTooSlow:
    @pytest.mark.parametrize('method', ['arx_pls_oe', 'auto'])
    def test_a_drift_that_goes_on_for_longer_than_the_recordings_is_refused_with_numbers(
        self, make_problem, method
    ):
        problem = make_problem({1e5: 20.0}, noise=0.01)
        fit = identify_axis(problem, IdentificationSettings(method))
        assert (fit.model, fit.chosen) == (None, 'none')
        assert fit.refusal.startswith('force_z drifts too slowly for these recordings: 1 time')
        assert 'its slowest time constant is at least 3000 s, as long as' in fit.refusal
        assert fit.refusal.endswith('Record at least 1.7 h from cold, or choose the method pls')
        assert fit.reason == f'{fit.refusal}.'
        assert fit.rms_after == fit.rms_before

    def test_a_simpler_one_stands_in_where_it_does_nearly_as_well(self, make_problem):
        """One lag explains nearly all; what is left goes on for longer than the recordings."""
        problem = make_problem({300.0: 0.5, 1e5: 2.0}, noise=0.02)
        fit = identify_axis(problem, IdentificationSettings('arx_pls_oe'))
        assert fit.chosen == '1 time constant, degree 2'
        assert not fit.refusal
        (doubt,) = fit.doubts
        assert doubt == (
            '2 time constants, degree 2 was left out: its slowest time constant is at least '
            '3000 s, as long as the longest recording'
        )
        assert fit.rms_after < 0.1 * fit.rms_before

    def test_noise_alone_is_no_drift_that_could_be_too_slow(self, make_problem):
        problem = make_problem({}, thermometers=2, cells=200)
        fit = identify_axis(problem, IdentificationSettings('arx_pls_oe'))
        assert (fit.model, fit.chosen, fit.refusal) == (None, 'none', '')
        assert fit.rms_after == fit.rms_before
        assert 'was left out: its slowest time constant is at least 2000 s' in fit.notes[-2]
        assert fit.reason.startswith('none leaves 0.0')
        assert 'of 2' in fit.reason
