"""What was fitted to free time constants is what runs, and too slow a drift is refused."""

import numpy as np
import pytest

from wrist_ft_comp.calibration.calibrate import identify_axis
from wrist_ft_comp.calibration.cross_validation import build_candidate_data, cross_validate
from wrist_ft_comp.calibration.features import build_features
from wrist_ft_comp.calibration.free_relaxations import _fit, _structures
from wrist_ft_comp.calibration.result import OUTPUTS
from wrist_ft_comp.calibration.selection import anchor
from wrist_ft_comp.calibration.settings import IdentificationSettings
from wrist_ft_comp.model import drift_model
from wrist_ft_comp.model.drift_model import DriftModel
from wrist_ft_comp.model.signals import AXES

Z = AXES.index('force_z')
CELLS = 300
CASES = [(loaded, thermometers) for loaded in (False, True) for thermometers in (1, 2)]
OUTPUT_ERROR = IdentificationSettings('arx_pls_oe')
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
        problem = make_problem({250.0: 0.5}, loaded=loaded, thermometers=thermometers)
        knots = KNOTS_C if kind == 'hats' else ()
        settings = IdentificationSettings('arx_pls_oe', kind, hat_temperatures_c=knots)
        features = build_features(problem.temperature_c, settings)
        data = build_candidate_data(problem, features)
        structures = _structures(settings, features)
        assert len(structures) == (3 if kind == 'hats' else 5)
        for structure in structures:
            fitted = _fit(data, cross_validate(data, structure))
            assert len(fitted.time_constants_s) == structure.free_time_constants
            expected = drift_by_terms(problem, data.features_of(structure), fitted, lagged)
            assert_same_up_to_a_constant(run(problem, anchor(problem, fitted.model)), expected)

    @pytest.mark.parametrize(
        ('truth', 'chosen', 'loaded', 'thermometers'),
        [
            ({300.0: 0.5}, '1 time constant', True, 2),
            ({100.0: 0.6, 900.0: -0.5}, '2 time constants', False, 1),
        ],
        ids=str,
    )
    def test_of_the_winner(  # noqa: PLR0913, PLR0917
        self, make_problem, lagged, truth, chosen, loaded, thermometers
    ):
        problem = make_problem(truth, loaded=loaded, thermometers=thermometers)
        fit = identify_axis(problem, OUTPUT_ERROR)
        assert fit.chosen == f'{chosen}, degree 2'
        assert not fit.doubts
        features = build_features(problem.temperature_c, OUTPUT_ERROR)
        expected = drift_by_terms(problem, features, fit, lagged)
        assert_same_up_to_a_constant(run(problem, fit.model), expected)
        assert len(fit.terms) == len(truth) * 2 * thermometers * (1 + loaded)
        pairs = zip(fit.time_constants_s, fit.time_constant_errors_s, strict=True)
        for (tau, error), true in zip(pairs, truth, strict=True):
            assert not abs(tau - true) > max(4 * error, 0.2 * true)


class TestTooSlow:
    def test_a_drift_that_goes_on_for_longer_than_the_recordings_is_refused_with_numbers(
        self, make_problem
    ):
        problem = make_problem({1e5: 20.0}, noise=0.01)
        fit = identify_axis(problem, OUTPUT_ERROR)
        assert (fit.model, fit.chosen) == (None, 'none')
        assert fit.refusal.startswith('force_z drifts too slowly for these recordings: ')
        assert 'its slowest time constant is at least 3000 s, as long as' in fit.refusal
        assert fit.refusal.endswith('Record at least 1.7 h from cold, or choose the method pls')
        assert fit.reason == f'{fit.refusal}.'
        assert fit.rms_after == fit.rms_before

    def test_noise_alone_is_no_drift_that_could_be_too_slow(self, make_problem):
        problem = make_problem({}, thermometers=2, cells=200)
        fit = identify_axis(problem, OUTPUT_ERROR)
        assert (fit.model, fit.chosen, fit.refusal) == (None, 'none', '')
        assert fit.rms_after == fit.rms_before
        assert 'was left out: its slowest time constant is at least 2000 s' in fit.notes[-2]
        assert fit.reason.startswith('none leaves 0.0')
        assert 'of 2' in fit.reason
