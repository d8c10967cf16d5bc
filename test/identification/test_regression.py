"""Regression from moments is that on the samples."""

from itertools import combinations

import numpy as np
import pytest

from wrist_ft_comp.identification.bins import bin_axis_data
from wrist_ft_comp.identification.moments import accumulate, bank_inputs
from wrist_ft_comp.identification.regression import least_squares, TINY_RIDGE
from wrist_ft_comp.model.features import Features

FEATURES = Features('powers', np.array([30.0]), np.zeros(1), np.full(1, 99.0), degree=2)
GRID = np.array([0.0, 50.0, 150.0, 400.0, 1200.0])


@pytest.fixture(scope='module')
def moments(noisy_problem):
    cells = bin_axis_data(noisy_problem, 1)
    return accumulate(cells, bank_inputs(cells, FEATURES, GRID), GRID)


@pytest.fixture(scope='module')
def products(moments):
    return moments.centred(np.ones(3, dtype=bool))


@pytest.fixture(scope='module')
def samples(noisy_problem, textbook_bank, stack_samples, whiten):
    """All columns and the target, beside each recording's nuisances."""
    banked = textbook_bank(noisy_problem, GRID)
    x, y, places = stack_samples(noisy_problem, banked, {0, 1, 2})
    return whiten(x, places, noisy_problem), whiten(y, places, noisy_problem)


def test_it_is_least_squares_with_just_enough_ridge(moments, products, samples, augmented_ridge):
    x, y = samples
    columns = moments.columns([1, 3], 2)
    assert len(columns) == (9 if moments.loaded else 4)
    gains, rss = least_squares(products, columns)
    expected = augmented_ridge(x[:, columns], y, TINY_RIDGE)
    np.testing.assert_allclose(gains, expected, rtol=1e-5, atol=1e-8)
    assert float(rss) == pytest.approx(np.sum((y - x[:, columns] @ gains) ** 2), rel=1e-9)


def test_nearly_collinear_columns_are_solved_and_equal_ones_share_their_gain(
    products, samples, augmented_ridge
):
    x, y = samples
    columns = np.array([0, 2, 4, 6, 8])  # one power behind five lags
    expected = augmented_ridge(x[:, columns], y, TINY_RIDGE)
    np.testing.assert_allclose(least_squares(products, columns)[0], expected, rtol=1e-5)
    slope = (x[:, 0] @ y) / (x[:, 0] @ x[:, 0])
    gains, rss = least_squares(products, np.array([0, 0, 0]))
    np.testing.assert_allclose(gains, slope / 3, rtol=1e-6)
    assert float(rss) == pytest.approx(np.sum((y - slope * x[:, 0]) ** 2))


def test_many_systems_are_solved_as_one_by_one(moments, products):
    choices = np.stack([moments.columns(pair, 1) for pair in combinations(range(1, 5), 2)])
    for columns, theta, rss in zip(choices, *least_squares(products, choices), strict=True):
        gains, alone = least_squares(products, columns)
        np.testing.assert_allclose(theta, gains, rtol=1e-8)
        assert rss == pytest.approx(float(alone))


class TestDegenerate:
    @pytest.fixture
    def products(self):
        """Products of four columns and a target."""
        rng = np.random.default_rng(0)
        both = rng.standard_normal((60, 5)) * [1e-3, 1.0, 1e2, 10.0, 1.0]
        both[:, -1] += both[:, :-1] @ [1e3, 1.0, 1e-2, 0.1]
        return both.T @ both

    def test_units_of_the_columns_do_not_matter(self, products):
        units = np.array([1.0, 1e3, 1e-3, 60.0, 1.0])
        gains, _ = least_squares(products * units * units[:, np.newaxis], np.arange(4))
        np.testing.assert_allclose(gains * units[:-1], least_squares(products, np.arange(4))[0])

    def test_a_constant_column_gets_no_gain_and_changes_no_other(self, products):
        silent = np.insert(np.insert(products, 2, 0.0, axis=0), 2, 0.0, axis=1)
        gains, _ = least_squares(silent, np.arange(5))
        assert gains[2] == 0
        np.testing.assert_allclose(np.delete(gains, 2), least_squares(products, np.arange(4))[0])

    def test_a_target_that_nothing_explains_gets_no_gain(self, products):
        products[-1, :-1] = products[:-1, -1] = 0.0
        gains, rss = least_squares(products, np.arange(4))
        np.testing.assert_array_equal(gains, 0.0)
        assert rss == products[-1, -1]
