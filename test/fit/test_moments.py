"""Sums over samples: the columns they are of, and what no temperature has to explain."""

from dataclasses import replace

import numpy as np
import pytest

from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.axis_data import assign_folds, build_axis_data
from wrist_ft_comp.fit.bins import bin_axis_data
from wrist_ft_comp.fit.moments import accumulate, bank_inputs
from wrist_ft_comp.fit.regression import least_squares

FEATURES = Features('powers', np.array([30.0]), np.zeros(1), np.full(1, 99.0), degree=2)
STATIC = np.zeros(1)
GRID = np.array([0.0, 50.0, 150.0, 400.0, 1200.0])


def moments_of(problem, grid=GRID):
    cells = bin_axis_data(problem, 1)
    return accumulate(cells, bank_inputs(cells, FEATURES, grid), grid)


@pytest.mark.parametrize('kept', [{0, 1, 2}, {0, 2}, {1}])
@pytest.mark.parametrize('kind', ['tared', 'soaked', 'plateaus'])
def test_products_are_those_of_generalised_least_squares(  # noqa: PLR0913, PLR0917
    noisy_problem, textbook_bank, stack_samples, whiten, kept, kind
):
    """Plateaus of a chamber test share one constant, and nothing else is a nuisance."""
    problem = replace(noisy_problem, tared=kind != 'plateaus')
    precision = bin_axis_data(problem, 1).nuisance_precision(soaked=kind == 'soaked')
    moments = replace(moments_of(problem), precision=precision)
    x, y, places = stack_samples(problem, textbook_bank(problem, GRID), kept)
    both = whiten(np.column_stack((x, y)), places, problem, soaked=kind == 'soaked')
    products = moments.centred(np.isin(range(3), [*kept]))
    np.testing.assert_allclose(products, both.T @ both, rtol=1e-8, atol=1e-6)


def test_columns_are_numbered_by_relaxation_then_feature(noisy_problem):
    moments = moments_of(noisy_problem)
    zero = [1 * 2, 3 * 2]
    expected = zero if noisy_problem.load is None else [*zero, 10 + 2, 10 + 6, 20]
    np.testing.assert_array_equal(moments.columns([1, 3], 1), expected)


class TestNuisances:
    @pytest.fixture
    def still(self, make_axis_data):
        """Pose what is left of values when nothing but nuisances explains them."""

        def left(values, steps=(), **more):
            data = make_axis_data([np.full(400, 30.0)], [values])
            cells = bin_axis_data(replace(data, steps=(steps,)), 1)
            moments = accumulate(cells, bank_inputs(cells, FEATURES, STATIC), STATIC)
            moments = replace(moments, precision=cells.nuisance_precision(**more))
            return moments.centred()[-1, -1] / np.sum((values - values.mean()) ** 2)

        return left

    def test_cosines_are_a_random_walk(self, make_axis_data):
        """Its steps have a variance that grows as the time between them."""
        cells = bin_axis_data(make_axis_data([np.zeros(400)], [np.zeros(400)]), 1)
        cosines = cells.nuisances(0)[:, 1:17] / np.sqrt(cells.nuisance_precision()[1:17])
        for lag in (60, 100, 200, 300):
            steps = cosines[lag:] - cosines[:-lag]
            variance = (steps**2).sum(axis=1).mean()
            assert variance / (lag / 400) == pytest.approx(np.pi**2 / 2, rel=0.1)

    @pytest.mark.parametrize('tau', [300.0, 700.0, 2500.0])
    def test_a_start_that_was_not_soaked_is_no_drift_unless_it_was(self, still, tau):
        transient = np.exp(-10.0 * np.arange(400) / tau)
        assert still(transient) < 0.4 * still(transient, soaked=True)

    def test_a_constant_is_new_after_each_step_that_is_told(self, still):
        stepped = np.repeat([0.0, 7.0, -3.0], [150, 100, 150])
        assert still(stepped, steps=(150, 250)) < 1e-6
        assert still(stepped, steps=(250,)) > 0.01


def test_a_column_that_only_differs_between_recordings_holds_nothing(make_recording, warm_up):
    """A room thermometer that read 21.3, 24.7 and 22.9 °C explains nothing within a run."""
    recordings = []
    for i, room in enumerate((21.3, 24.7, 22.9)):
        temperature_c = np.stack([warm_up(150, i), np.full(150, room)], axis=1)
        raw = 0.5 * temperature_c[:, 0] + 7.0 * i
        recordings.append(make_recording(temperature_c, {'force_z': raw}))
    problem = build_axis_data(recordings, 'force_z', 'unloaded', assign_folds(recordings))
    features = Features('powers', np.full(2, 23.0), np.zeros(2), np.full(2, 99.0))
    taus = np.array([0.0, 300.0])
    cells = bin_axis_data(problem, 1)
    moments = accumulate(cells, bank_inputs(cells, features, taus), taus)
    products = moments.centred(np.ones(3, dtype=bool))
    room = [1, 3]
    assert not products[room].any()
    assert not products[:, room].any()
    assert (np.diagonal(products)[[0, 2, 4]] > 1).all()
    gains, _ = least_squares(products, moments.columns([0, 1], 2))
    np.testing.assert_array_equal(gains[room], 0.0)
    np.testing.assert_allclose(gains[[0, 2]].sum(), 0.5, rtol=1e-4)
