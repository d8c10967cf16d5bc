"""Regressions from moments are those on the samples: least squares, ridge and PLS."""

from itertools import combinations

import numpy as np
import pytest

from wrist_ft_comp.identification.bins import bin_axis_data
from wrist_ft_comp.identification.moments import accumulate, bank_inputs
from wrist_ft_comp.identification.pls import fit_pls
from wrist_ft_comp.identification.regression import (
    least_squares,
    MAX_LATENTS,
    pls_path,
    ridge_path,
    RIDGE_STRENGTHS,
    TINY_RIDGE,
)
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
def samples(noisy_problem, textbook_bank, stack_samples, centre):
    """All columns and the target, centred within each recording."""
    banked = textbook_bank(noisy_problem, GRID)
    x, y, recordings = stack_samples(noisy_problem, banked, {0, 1, 2})
    return centre(x, recordings), centre(y, recordings)


def made_up(rows, inputs, rank):
    """Centred columns of very different units, of some rank, a target, and all their products."""
    rng = np.random.default_rng([rows, inputs, rank])
    mixed = rng.standard_normal((rows, rank)) @ rng.standard_normal((rank, inputs))
    x = mixed * 10.0 ** rng.uniform(-3, 3, inputs)
    y = mixed @ rng.standard_normal(inputs) + rng.standard_normal(rows)
    x, y = x - x.mean(axis=0), y - y.mean()
    both = np.column_stack((x, y))
    return x, y, both.T @ both


def test_every_strength_is_the_augmented_least_squares(
    moments, products, samples, augmented_ridge
):
    """Also the one that only keeps least squares solvable."""
    x, y = samples
    columns = moments.columns([1, 3], 2)
    assert len(columns) == (9 if moments.loaded else 4)
    assert list(RIDGE_STRENGTHS) == sorted(RIDGE_STRENGTHS, reverse=True)
    gains, rss = least_squares(products, columns)
    path = [*ridge_path(products, columns), gains]
    for strength, theta in zip((*RIDGE_STRENGTHS, TINY_RIDGE), path, strict=True):
        expected = augmented_ridge(x[:, columns], y, strength)
        np.testing.assert_allclose(theta, expected, rtol=1e-5, atol=1e-8)
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


@pytest.mark.parametrize(('inputs', 'rank'), [(4, 4), (20, 20), (8, 3), (1, 1)], ids=str)
def test_every_number_of_latents_is_nipals_on_the_samples(inputs, rank):
    x, y, products = made_up(150, inputs, rank)
    scale = np.linalg.norm(x, axis=0)
    path = pls_path(products, np.arange(inputs))
    assert path.shape == (MAX_LATENTS, inputs)
    for latents, gains in enumerate(path, start=1):
        outer = fit_pls(x / scale, y[:, np.newaxis], min(latents, rank))
        expected = outer.coefficients[:, 0]
        tolerance = 1e-8 * np.abs(expected).max()
        np.testing.assert_allclose(gains * scale, expected, rtol=1e-8, atol=tolerance)


@pytest.mark.parametrize('path', [ridge_path, pls_path])
class TestEveryPath:
    def test_units_of_the_columns_do_not_matter(self, path):
        _, _, products = made_up(60, 4, 4)
        units = np.array([1.0, 1e3, 1e-3, 60.0, 1.0])
        gains = path(products * units * units[:, np.newaxis], np.arange(4))
        np.testing.assert_allclose(gains * units[:-1], path(products, np.arange(4)), rtol=1e-7)

    def test_a_constant_column_gets_no_gain_and_changes_no_other(self, path):
        _, _, products = made_up(60, 4, 4)
        silent = np.insert(np.insert(products, 2, 0.0, axis=0), 2, 0.0, axis=1)
        gains = path(silent, np.arange(5))
        # Rounding over the weakest ridge is all that may be left, beside gains of 0.01 to 100.
        np.testing.assert_allclose(gains[:, 2], 0.0, atol=1e-6)
        np.testing.assert_allclose(
            np.delete(gains, 2, axis=1), path(products, np.arange(4)), rtol=1e-7
        )

    def test_a_target_that_nothing_explains_gets_no_gain(self, path):
        _, _, products = made_up(60, 4, 4)
        products[-1, :-1] = products[:-1, -1] = 0.0
        np.testing.assert_array_equal(path(products, np.arange(4)), 0.0)

    def test_what_is_left_falls_along_the_path(self, path):
        x, y, products = made_up(60, 8, 8)
        rss = [np.sum((y - x @ theta) ** 2) for theta in path(products, np.arange(8))]
        assert (np.diff(rss) <= 1e-9 * rss[0]).all()
        assert rss[-1] < 0.5 * rss[0]
