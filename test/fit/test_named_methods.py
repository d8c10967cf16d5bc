"""Candidates of one axis compete: the choice, why, the constants, and hats of a chamber test."""

from dataclasses import replace

import numpy as np
import pytest

from wrist_ft_comp.drift.arx import relaxation, static_gain
from wrist_ft_comp.drift.arx_pls import ArxPls
from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit import named_methods
from wrist_ft_comp.fit.folds import FoldBins, simplest_good
from wrist_ft_comp.fit.named_methods import anchor, compete

CELLS = 200


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


STEADY, WAVERING = np.full(4, 0.9), np.array([0.9, -0.5, 0.9, -0.5])
#: Parts differ a thousandfold in difficulty.
HARD = 10.0 ** np.arange(-3, 4)


@pytest.mark.parametrize(
    ('errors', 'chosen'),
    [
        *(([np.full(parts, error) for error in errors], chosen)
          for parts in (1, 5)  # a single part has no standard error
          for errors, chosen in (
              ((9.0, 4.0, 1.0), 2), ((1.0, 0.86), 0), ((1.0, 0.84), 1), ((2.0, 1.0, 1.01), 1))),
        ([np.full(4, 6.0), 1 + WAVERING, np.ones(4)], 1),
        ([np.full(4, 6.0), 1 + STEADY, np.ones(4)], 2),
        ([1.5 * HARD, HARD], 1),
        ([1.5 * HARD[::-1], HARD], 0),
    ],
)  # fmt: skip
def test_the_simplest_wins_within_15_percent_or_one_standard_error_of_the_best(errors, chosen):
    """Of the difference, part by part."""
    assert simplest_good(errors) == chosen


@pytest.mark.parametrize(
    ('errors', 'chosen', 'competing', 'why'),
    [
        ((4.0, 1.0, 0.25), 'lag', ['none', 'line', 'lag'], 'of 3 candidates it is the best'),
        ((9.0, 1.0, 0.9), 'line', ['none', 'line', 'lag'], 'the best of 3, lag, is better by no'),
        ((1.0, 4.0), 'line', ['line'], 'nothing else competed'),
    ],
)
def test_the_winner_says_what_it_leaves_and_why(  # noqa: PLR0913, PLR0917 -- a table's columns
    make_problem, monkeypatch, errors, chosen, competing, why
):
    bins = {}
    for name, square in zip(('none', 'line', 'lag'), errors, strict=False):
        left = np.full(4, np.sqrt(square))
        bins[name] = [FoldBins(i, i, np.arange(4), left, left) for i in range(2)]
    problem = replace(make_problem(), axis='torque_z')
    refits = {name: lambda _: (lag(), ('mended',)) for name in competing if name != 'none'}
    scores = iter(bins.values())
    monkeypatch.setattr(named_methods, 'refit_bins', lambda *_: next(scores))
    fit = compete(problem, refits, may_be_none='none' in competing)
    rms = {candidate.name: candidate.rms for candidate in fit.candidates}
    assert rms == pytest.approx(dict(zip(bins, np.sqrt(errors), strict=True)))
    assert (fit.chosen, fit.rms_before, fit.rms_after) == (chosen, rms['none'], rms[chosen])
    assert fit.reason.startswith(f'{chosen} leaves {rms[chosen]:.3g} N m RMS on held-out data, no')
    assert why in fit.reason
    assert fit.notes == ('mended', 'zero drift only: the reference was declared unloaded')
    assert fit.time_constants_s == pytest.approx((300.0,)), 'read from the poles'
    assert np.isnan(fit.time_constant_errors_s).all()


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
