"""Candidates of one axis compete: the choice, the sentence that says why, hats and free lags."""

from dataclasses import replace

import numpy as np
import pytest

from wrist_ft_comp.drift.arx_filter import relaxation, static_gain
from wrist_ft_comp.drift.arx_pls import ArxPls
from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.calibrate import identify_axis
from wrist_ft_comp.fit.competition import anchor, finish, fit_lags, state_errors
from wrist_ft_comp.fit.cross_validation import FoldBins, simplest_good
from wrist_ft_comp.fit.model_building import build_features
from wrist_ft_comp.fit.moments import bin_axis_data
from wrist_ft_comp.fit.result import AxisFit, OUTPUTS
from wrist_ft_comp.fit.settings import IdentificationSettings

CELLS = 200
PLATEAU_CELLS = 50


@pytest.fixture(scope='module')
def make_problem(make_axis_data, warm_up):
    """One axis, loaded as asked, with a gain error at the reference temperature."""

    def make(load=None, error=0.0):
        raw = np.zeros(CELLS) if load is None else (1 + error) * load
        temperatures = [warm_up(CELLS, i) for i in range(2)]
        return make_axis_data(temperatures, [raw, raw + 3], None if load is None else [load] * 2)

    return make


def lag(outputs=1, mean=0.0):
    features = Features('powers', np.array([30.0]), np.zeros(1), np.full(1, 99.0), degree=2)
    dynamics = ArxPls(
        np.array([1.0, 50.0]), np.ones(2), np.array([[1.0], [0.1]]), (static_gain(),),
        np.full((outputs, 1), 1e-9), np.ones(outputs), np.full(outputs, mean),
    )  # fmt: skip
    return AxisModel(features, dynamics, (relaxation(300.0, 10.0),))


class TestChoice:
    @pytest.mark.parametrize('parts', [1, 5])
    @pytest.mark.parametrize(
        ('errors', 'chosen'),
        [((9.0, 4.0, 1.0), 2), ((1.0, 0.86), 0), ((1.0, 0.84), 1), ((2.0, 1.0, 1.01), 1)],
    )
    def test_the_best_wins_unless_it_gains_less_than_15_percent(self, errors, chosen, parts):
        """A single part has no standard error."""
        assert simplest_good([np.full(parts, error) for error in errors]) == chosen

    def test_the_simplest_within_one_standard_error_of_the_best_wins(self):
        best = np.ones(4)
        wavering = best + np.array([0.9, -0.5, 0.9, -0.5])
        steady = best + 0.9
        assert simplest_good([best + 5, wavering, best]) == 1
        assert simplest_good([best + 5, steady, best]) == 2

    def test_candidates_are_compared_part_by_part(self):
        """Parts differ a thousandfold in difficulty, candidates by half in every one."""
        best = 10.0 ** np.arange(-3, 4)
        assert simplest_good([1.5 * best, best]) == 1
        # The same errors, but not of the same parts: nobody knows.
        assert simplest_good([1.5 * best[::-1], best]) == 0


def choose(problem, errors, chosen, competing=None, model=None):
    """Finish from the mean squares of each candidate, in parts of a bin."""
    bins = {}
    for name, squares in errors.items():
        left = np.sqrt(squares)
        bins[name] = [FoldBins(i, i, np.arange(len(left)), left, left) for i in range(2)]
    return finish(problem, (model, ('mended',)), chosen, bins, competing or list(errors))


class TestReasons:
    def test_the_reason_says_that_the_best_won(self, make_problem):
        errors = {'none': np.full(4, 4.0), 'line': np.full(4, 1.0), 'lag': np.full(4, 0.25)}
        fit = choose(replace(make_problem(), axis='torque_z'), errors, 'lag')
        assert fit.reason == (
            'lag leaves 0.5 N m RMS on held-out data, no compensation 2 N m; of 3 candidates it '
            'is the best.'
        )
        assert (fit.chosen, fit.rms_before, fit.rms_after) == ('lag', 2.0, 0.5)
        assert {candidate.name: candidate.rms for candidate in fit.candidates} == pytest.approx(
            {'none': 2.0, 'line': 1.0, 'lag': 0.5}
        )

    def test_the_reason_says_that_a_simpler_one_is_as_good(self, make_problem):
        best = np.ones(4)
        line = best + np.array([0.95, -0.45, 0.95, -0.45])
        errors = {'none': np.full(4, 9.0), 'line': line, 'lag': best}
        assert choose(make_problem(), errors, 'line').reason == (
            'line leaves 1.12 N RMS on held-out data, no compensation 3 N; the best of 3, lag, '
            'is better by no more than chance, or than 15 % in mean square, and less simple.'
        )

    def test_the_reason_says_that_nothing_else_competed(self, make_problem):
        errors = {'none': np.ones(4), 'line': np.full(4, 4.0)}
        assert choose(make_problem(), errors, 'line', ['line']).reason == (
            'line leaves 2 N RMS on held-out data, no compensation 1 N; nothing else competed.'
        )


class TestFinish:
    ERRORS = {'none': np.ones(4), 'lag': np.full(4, 0.1)}  # noqa: RUF012 -- never changed

    def test_a_mended_model_is_noted_and_time_constants_are_read_from_the_poles(
        self, make_problem
    ):
        fit = choose(make_problem(), self.ERRORS, 'lag', model=lag())
        assert fit.notes == ('mended', 'zero drift only: the reference was declared unloaded')
        assert fit.time_constants_s == pytest.approx((300.0,))
        assert fit.time_constant_errors_s == pytest.approx((np.nan,), nan_ok=True)
        assert fit.terms == ()


@pytest.mark.parametrize('error', [None, 0.0, 0.03, -0.2])
def test_a_sensor_soaked_at_the_reference_has_no_drift_but_the_least_squares_gain_error(
    make_problem, error
):
    load = 50 + 30 * np.random.default_rng(0).standard_normal(CELLS)
    problem = make_problem() if error is None else make_problem(load, error)
    expected = [0.0] if error is None else [0.0, error]
    anchored, soaked_c = anchor(problem, lag(len(expected), mean=5.0)), np.array([30.0])
    drift = anchored.step(anchored.start(soaked_c), soaked_c)[1]
    assert drift == pytest.approx(expected, abs=1e-12 if error is None else 1e-6)


@pytest.fixture(scope='module')
def chamber(make_axis_data):
    """Plateaus with the same steps of load at each, and silence between them."""

    def make(plateaus_c, zero, gain, noise=0.05):
        rng = np.random.default_rng(0)
        temperature_c = np.repeat(plateaus_c, PLATEAU_CELLS).astype(float)
        load = np.tile(np.repeat(np.linspace(-50, 50, 10), PLATEAU_CELLS // 10), len(plateaus_c))
        raw = zero(temperature_c) + (1 + gain(temperature_c)) * load
        raw = raw + noise * rng.standard_normal(len(raw))
        # The last fifth of a plateau is the way to the next.
        raw[np.arange(len(raw)) % PLATEAU_CELLS >= PLATEAU_CELLS * 4 // 5] = np.nan
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


def test_a_gain_that_does_not_drift_is_not_learnt(chamber):
    data = chamber(np.arange(0, 66, 6), lambda t: 0.5 * t, lambda t: 0.03 + 0 * t)
    assert identify_axis(data, IdentificationSettings()).model.outputs == 1


def test_noise_is_left_alone(chamber):
    data = chamber([0, 20, 40, 60], lambda t: 0 * t, lambda t: 0 * t, noise=1.0)
    fit = identify_axis(data, IdentificationSettings())
    assert (fit.model, fit.chosen) == (None, 'none')


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


class TestFreeTimeConstants:
    @pytest.mark.parametrize(('loaded', 'thermometers'), [(False, 1), (True, 2)])
    @pytest.mark.parametrize('kind', ['powers', 'hats'])
    def test_stated_terms_give_the_drift_of_the_model_that_runs(
        self, pose_lags, lagged, loaded, thermometers, kind
    ):
        """Of every candidate."""
        problem = pose_lags({250.0: 0.5}, loaded=loaded, thermometers=thermometers)
        knots = (20.0, 27.0, 35.0, 45.0) if kind == 'hats' else ()
        settings = IdentificationSettings('arx_pls_oe', kind, hat_temperatures_c=knots)
        features = build_features(problem.temperature_c, settings)
        fits = fit_lags(bin_axis_data(problem, 1), features, problem.period_s)
        assert len(fits) == (3 if kind == 'hats' else 6)
        temperature_c = problem.temperature_c[0]
        for fit in fits.values():
            names = fit.features.names
            terms = state_errors(AxisFit(None, '', (), 1.0, 1.0), fit, [fit, fit]).terms
            assert len(terms) == len(fit.time_constants_s) * len(names) * (1 + loaded)
            expected = np.zeros((len(temperature_c), 1 + loaded))
            for term in terms:
                tau_s = term.time_constant_s
                behind = [lagged(column, tau_s) if tau_s else column for column in temperature_c.T]
                x = fit.features.expand(np.stack(behind, axis=1))[:, names.index(term.feature)]
                expected[:, OUTPUTS.index(term.output)] += term.gain * x
            _, drift = fit.model.run(fit.model.start(temperature_c[0]), temperature_c)
            spread = np.ptp(drift - expected, axis=0)
            np.testing.assert_array_less(spread, 1e-9 * np.ptp(expected, axis=0))

    @pytest.mark.parametrize('truth', [{300.0: 0.5}, {120.0: 0.5, 1500.0: -0.5}], ids=str)
    def test_time_constants_are_found_within_their_standard_errors(self, pose_lags, truth):
        fit = identify_axis(pose_lags(truth, days=3), IdentificationSettings('arx_pls_oe'))
        assert fit.chosen.startswith(f'{len(truth)} time constant')
        assert len(fit.time_constants_s) == len(truth)
        times = zip(truth, fit.time_constants_s, fit.time_constant_errors_s, strict=True)
        for true, tau_s, error_s in times:
            assert abs(tau_s - true) < 3 * error_s < 0.2 * true
        gains = [term for term in fit.terms if term.feature == 'θ1']
        for gain, term in zip(truth.values(), gains, strict=True):
            assert term.gain == pytest.approx(gain, abs=4 * term.error + 0.02)
            assert 0 < term.error < 0.05

    def test_a_drift_without_a_lag_is_static(self, make_axis_data, warm_up):
        rng, temperatures = np.random.default_rng(0), [warm_up(CELLS, i) for i in range(2)]
        raws = [0.5 * t + 0.05 * rng.standard_normal(CELLS) for t in temperatures]
        data = make_axis_data(temperatures, raws)
        fit = identify_axis(data, IdentificationSettings('arx_pls_oe'))
        assert fit.chosen.startswith('static, degree ')
        assert (fit.time_constants_s, fit.time_constant_errors_s) == ((), ())
        assert fit.terms[0].gain == pytest.approx(0.5, abs=0.01)

    def test_a_drift_that_lasts_longer_than_the_recordings_is_refused_with_numbers(
        self, pose_lags
    ):
        problem = pose_lags({1e5: 20.0}, noise=0.01)
        fit = identify_axis(problem, IdentificationSettings('arx_pls_oe'))
        assert (fit.model, fit.chosen) == (None, 'none')
        assert fit.refusal.startswith('force_z drifts too slowly for these recordings: ')
        assert 'its slowest time constant is at least 3000 s, as long as' in fit.refusal
        assert fit.refusal.endswith('Record at least 1.7 h from cold, or choose the method pls')
        assert fit.reason == f'{fit.refusal}.'
        assert fit.rms_after == fit.rms_before

    def test_the_longest_time_constant_that_is_searched_is_named(self, pose_lags):
        """In a recording that lasts longer still."""
        fit = identify_axis(pose_lags({3e4: 5.0}, cells=800), IdentificationSettings('arx_pls_oe'))
        note = 'its slowest time constant is the longest that is searched, 5629 s'
        assert note in fit.notes
        assert fit.rms_after < 0.1 * fit.rms_before
