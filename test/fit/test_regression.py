"""Regression from moments is that on the samples."""

from itertools import combinations

import numpy as np
import pytest

from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.bins import bin_axis_data
from wrist_ft_comp.fit.moments import accumulate, bank_inputs
from wrist_ft_comp.fit.regression import least_squares, TINY_RIDGE

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


def test_equal_columns_share_their_gain(products, samples):
    x, y = samples
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


def test_a_constant_column_gets_no_gain_and_changes_no_other():
    rng = np.random.default_rng(0)
    both = rng.standard_normal((60, 5)) * [1e-3, 1.0, 1e2, 10.0, 1.0]
    products = both.T @ both
    silent = np.insert(np.insert(products, 2, 0.0, axis=0), 2, 0.0, axis=1)
    gains, _ = least_squares(silent, np.arange(5))
    assert gains[2] == 0
    np.testing.assert_allclose(np.delete(gains, 2), least_squares(products, np.arange(4))[0])
