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
from wrist_ft_comp.identification.axis_data import assign_folds, build_axis_data
from wrist_ft_comp.identification.output_error import fit_columns
from wrist_ft_comp.model import drift_model
from wrist_ft_comp.model.drift_model import DriftModel
from wrist_ft_comp.model.signals import AXES

Z = AXES.index('force_z')
CELLS = 300
CASES = [(loaded, thermometers) for loaded in (False, True) for thermometers in (1, 2)]
KNOTS_C = (20.0, 27.0, 35.0, 45.0)


@pytest.fixture(scope='module')
def make_problem(make_recording, warm_up, lagged):
    """Drift of N/K behind each time constant, with a square, noise and a few gaps."""

    def make(truth, *, loaded=False, thermometers=1, noise=0.05, cells=CELLS):
        recordings = []
        for i in range(2):
            rng = np.random.default_rng([i, 5])
            both = np.stack([warm_up(cells, i + 100 * j) for j in range(thermometers)], axis=1)
            seen = both.mean(axis=1)
            relaxed = {tau: lagged(seen, tau) - 30 for tau in truth}
            zero = sum(
                gain * (relaxed[tau] + 0.02 * relaxed[tau] ** 2) for tau, gain in truth.items()
            )
            load = 40 * rng.standard_normal(cells)
            raw = (1 + 2e-3 * zero) * load * loaded + zero + noise * rng.standard_normal(cells)
            raw[rng.uniform(size=cells) < 0.05] = np.nan
            recordings.append(make_recording(both, {'force_z': raw}, {'force_z': load}))
        blocks = assign_folds(recordings)
        return build_axis_data(recordings, 'force_z', 'recorded' if loaded else 'unloaded', blocks)

    return make


def running(problem, axis):
    """Zero and sensitivity drift of force z as the node makes them, shapes (N_i, M)."""
    thermometers = problem.temperature_c[0].shape[1]
    model = DriftModel(round(problem.period_s * 1e9), thermometers, {'force_z': axis})
    found = []
    for temperature_c in problem.temperature_c:
        state = drift_model.start(model, temperature_c[0])
        rows = []
        for row in temperature_c:
            state, now = drift_model.step(model, state, row)
            rows.append([now.zero[Z], now.sensitivity[Z]][: axis.outputs])
        found.append(np.array(rows))
    return found


def features_behind(features, temperature_c, tau, lagged):
    relaxed = [lagged(column, tau) if tau else column for column in temperature_c.T]
    return features.expand(np.stack(relaxed, axis=1))


def of_terms(problem, features, fit, lagged):
    """The fit's columns times its gains, term by term."""
    found = []
    for temperature_c in problem.temperature_c:
        total = np.zeros((len(temperature_c), 1 + (problem.load is not None)))
        for term in fit.terms:
            x = features_behind(features, temperature_c, term.time_constant_s, lagged)
            column = x[:, features.names.index(term.feature)]
            total[:, OUTPUTS.index(term.output)] += term.gain * column
        found.append(total)
    return found


def assert_same_up_to_a_constant(found, expected):
    ours, theirs = np.concatenate(found), np.concatenate(expected)
    assert ours.shape == theirs.shape
    assert (np.ptp(theirs, axis=0) > 0).all()
    difference = ours - theirs
    np.testing.assert_array_less(np.ptp(difference, axis=0), 1e-9 * np.ptp(theirs, axis=0))


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
        grid = moments.time_constants_s
        names = []
        for structure in structures(settings, features, grid):
            score = cross_validate(data, structure)
            fitted = _fit(data, score)
            assert fitted.model is not None
            found = running(problem, anchor(problem, fitted.model))
            of = data.features_of(structure)
            if not structure.bank_s:
                assert len(fitted.time_constants_s) == structure.free_time_constants
                expected = of_terms(problem, of, fitted, lagged)
            else:
                _, coefficients = fit_columns(
                    moments, structure, np.ones(2, dtype=bool), data.inputs(structure)
                )
                gains = coefficients[score.strength][: len(coefficients[0]) - loaded]
                expected = [
                    np.concatenate(
                        [features_behind(of, t, tau, lagged) for tau in structure.bank_s], axis=1
                    )
                    @ gains.reshape(1 + loaded, -1).T
                    for t in problem.temperature_c
                ]
            assert_same_up_to_a_constant(found, expected)
            names.append(structure.name)
        assert any('PLS' in name for name in names)
        assert any('ridge' in name for name in names)
        assert len(names) == (6 if kind == 'hats' else 11)

    @pytest.mark.parametrize(('loaded', 'thermometers'), CASES)
    @pytest.mark.parametrize(
        ('method', 'truth', 'chosen'),
        [
            ('auto', {1e-6: 0.5}, 'static'),
            ('auto', {300.0: 0.5}, '1 time constant'),
            ('arx_pls_oe', {300.0: 0.5}, '1 time constant'),
            ('arx_pls_oe', {100.0: 0.6, 900.0: -0.5}, '2 time constants'),
        ],
        ids=str,
    )
    def test_of_the_winner(  # noqa: PLR0913, PLR0917
        self, make_problem, lagged, method, truth, chosen, loaded, thermometers
    ):
        problem = make_problem(truth, loaded=loaded, thermometers=thermometers)
        fit = identify_axis(problem, IdentificationSettings(method))
        assert fit.chosen == f'{chosen}, degree 2'
        assert fit.model is not None
        assert not fit.doubts
        features = build_features(problem.temperature_c, IdentificationSettings())
        assert_same_up_to_a_constant(
            running(problem, fit.model), of_terms(problem, features, fit, lagged)
        )
        count = max(len(fit.time_constants_s), 1)
        assert len(fit.terms) == count * 2 * thermometers * (1 + loaded)
        for found, error, true in zip(
            fit.time_constants_s, fit.time_constant_errors_s, truth, strict=chosen != 'static'
        ):
            assert not abs(found - true) > max(4 * error, 0.2 * true)


class TestTooSlow:
    @pytest.mark.parametrize('method', ['arx_pls_oe', 'auto'])
    def test_a_drift_that_goes_on_for_longer_than_the_recordings_is_refused_with_numbers(
        self, make_problem, method
    ):
        problem = make_problem({1e5: 20.0}, noise=0.01)
        fit = identify_axis(problem, IdentificationSettings(method))
        assert fit.model is None
        assert fit.chosen == 'none'
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
        assert fit.model is not None
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
