"""Candidates of one axis compete: the choice, the sentence that says why, and hats."""

from dataclasses import replace

import numpy as np
import pytest

from wrist_ft_comp.drift.arx import relaxation, static_gain
from wrist_ft_comp.drift.arx_pls import ArxPls
from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.calibrate import identify_axis
from wrist_ft_comp.fit.cross_validation import FoldBins, simplest_good
from wrist_ft_comp.fit.named_methods import anchor, finish
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
