"""Candidates of one axis compete: which one wins, and its constants."""

import numpy as np
import pytest

from wrist_ft_comp.drift.arx import relaxation, static_gain
from wrist_ft_comp.drift.arx_pls import ArxPls
from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.folds import simplest_good
from wrist_ft_comp.fit.named_methods import anchor

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


@pytest.mark.parametrize('error', [None, 0.0, 0.03, -0.2])
def test_a_sensor_soaked_at_the_reference_has_no_drift_but_the_least_squares_gain_error(
    make_problem, error
):
    load = 50 + 30 * np.random.default_rng(0).standard_normal(CELLS)
    problem = make_problem() if error is None else make_problem(load, error)
    expected = [0.0] if error is None else [0.0, error]
    anchored, soaked_c = anchor(problem, lag(len(expected), mean=5.0)), np.array([30.0])
    drift = anchored.run(anchored.start(soaked_c), soaked_c[np.newaxis])[1][0]
    assert drift == pytest.approx(expected, abs=1e-12 if error is None else 1e-6)
