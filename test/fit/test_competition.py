"""Candidates of one axis compete: which one wins, and its constants."""

import numpy as np
import pytest

from wrist_ft_comp.drift.arx import relaxation, static_gain
from wrist_ft_comp.drift.arx_pls import ArxPls
from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.competition import anchor, simplest_good

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


@pytest.mark.parametrize(
    ('squares', 'chosen'),
    [((9.0, 4.0, 1.0), 2), ((1.0, 0.86), 0), ((1.0, 0.84), 1), ((2.0, 1.0, 1.01), 1)],
)
def test_the_simplest_wins_within_15_percent_of_the_best(squares, chosen):
    assert simplest_good(squares) == chosen


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
