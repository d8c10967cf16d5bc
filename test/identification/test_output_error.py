"""Fits on the free-run error: the combination of time constants that is taken."""

from itertools import combinations

import numpy as np

from wrist_ft_comp.identification.bins import bin_axis_data
from wrist_ft_comp.identification.moments import accumulate, bank_inputs
from wrist_ft_comp.identification.output_error import fit_columns, Structure
from wrist_ft_comp.identification.regression import TINY_RIDGE
from wrist_ft_comp.model.features import Features

FEATURES = Features('powers', np.array([30.0]), np.zeros(1), np.full(1, 99.0), degree=2)
GRID = np.array([0.0, 50.0, 150.0, 400.0, 1200.0])


def test_the_combination_that_leaves_least_is_taken(
    noisy_problem, textbook_bank, stack_samples, centre, augmented_ridge
):
    cells = bin_axis_data(noisy_problem, 1)
    moments = accumulate(cells, bank_inputs(cells, FEATURES, GRID), GRID)
    structure = Structure('two', 1, free_time_constants=2)
    columns, coefficients = fit_columns(moments, structure, np.ones(3, dtype=bool), 1)
    left = {}
    for pair in combinations(range(1, len(GRID)), 2):
        banked = textbook_bank(noisy_problem, GRID[list(pair)], 1)
        x, y, recordings = stack_samples(noisy_problem, banked, {0, 1, 2})
        x, y = centre(x, recordings), centre(y, recordings)
        theta = augmented_ridge(x, y, TINY_RIDGE)
        left[pair] = (np.sum((y - x @ theta) ** 2), theta)
    best = min(left, key=lambda pair: left[pair][0])
    np.testing.assert_array_equal(columns, moments.columns(best, 1))
    np.testing.assert_allclose(coefficients, left[best][1][np.newaxis], rtol=1e-5)
