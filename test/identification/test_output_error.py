"""Fits on the free-run error, judged on blocks they did not see: against refitting by hand."""

from collections.abc import Callable
from itertools import combinations

import numpy as np
import pytest

from wrist_ft_comp.calibration.cross_validation import _score_fold, uncompensated_errors
from wrist_ft_comp.identification.axis_data import AxisData
from wrist_ft_comp.identification.bins import bin_axis_data
from wrist_ft_comp.identification.moments import accumulate, bank_inputs, Moments
from wrist_ft_comp.identification.output_error import fit_columns, Structure
from wrist_ft_comp.identification.pls import fit_pls
from wrist_ft_comp.identification.regression import MAX_LATENTS, RIDGE_STRENGTHS, TINY_RIDGE
from wrist_ft_comp.model.features import Features

Array = np.ndarray
Bank = Callable[..., list[Array]]
Stack = Callable[..., tuple[Array, Array, Array]]
Centre = Callable[[Array, Array], Array]
Solve = Callable[[Array, Array, float], Array]
FEATURES = Features('powers', np.array([30.0]), np.zeros(1), np.full(1, 99.0), degree=2)
GRID = np.array([0.0, 50.0, 150.0, 400.0, 1200.0])
PARTS = 3
STRUCTURES = [
    Structure('static', 2),
    Structure('static, degree 1', 1),
    Structure('ridge', 2, bank_s=(50.0, 400.0), regression='ridge'),
    Structure('PLS', 1, bank_s=(0.0, 50.0, 400.0), regression='PLS'),
    Structure('one', 1, free_time_constants=1),
    Structure('one, degree 2', 2, free_time_constants=1),
    Structure('two', 1, free_time_constants=2),
]


def moments_of(problem: AxisData, parts: int = 1) -> Moments:
    cells = bin_axis_data(problem, 1)
    return accumulate(cells, bank_inputs(cells, FEATURES, GRID), GRID, parts)


def choices(structure: Structure) -> list[tuple[float, ...]]:
    """List the time constants that are tried."""
    if structure.free_time_constants:
        return list(combinations(GRID[1:], structure.free_time_constants))
    return [structure.bank_s or (0.0,)]


def regress(structure: Structure, x: Array, y: Array, solve: Solve) -> list[Array]:
    """Regress by hand, with every strength."""
    if structure.regression == 'ridge':
        return [solve(x, y, strength) for strength in RIDGE_STRENGTHS]
    if structure.regression == 'PLS':
        scale = np.linalg.norm(x, axis=0)
        fits = [
            fit_pls(x / scale, y[:, np.newaxis], latents)
            for latents in range(1, min(MAX_LATENTS, x.shape[1]) + 1)
        ]
        thetas = [fit.coefficients[:, 0] / scale for fit in fits]
        return thetas + [thetas[-1]] * (MAX_LATENTS - len(thetas))
    return [solve(x, y, TINY_RIDGE)]


@pytest.mark.parametrize('structure', STRUCTURES, ids=lambda structure: structure.name)
def test_held_out_errors_are_those_of_refitting_without_each_block(  # noqa: PLR0913, PLR0917
    noisy_problem: AxisData,
    textbook_bank: Bank,
    stack_samples: Stack,
    centre: Centre,
    augmented_ridge: Solve,
    structure: Structure,
) -> None:
    moments, judged = moments_of(noisy_problem), moments_of(noisy_problem, PARTS)
    scores = [_score_fold(moments, judged, structure, structure.degree, fold) for fold in range(3)]
    found = np.concatenate(scores, axis=1)
    expected = []
    for block in range(3):
        fits = []
        for taus in choices(structure):
            banked = textbook_bank(noisy_problem, np.array(taus), structure.degree)
            x, y, recordings = stack_samples(noisy_problem, banked, {0, 1, 2} - {block})
            x, y = centre(x, recordings), centre(y, recordings)
            thetas = regress(structure, x, y, augmented_ridge)
            fits.append((np.sum((y - x @ thetas[0]) ** 2), banked, thetas))
        _, banked, thetas = min(fits, key=lambda fit: fit[0])
        x, y, _ = stack_samples(noisy_problem, banked, {block})
        left = y[:, np.newaxis] - x @ np.stack(thetas, axis=1)
        parts = np.array_split((left - left.mean(axis=0)) ** 2, PARTS)
        expected.append(np.stack([part.mean(axis=0) for part in parts], axis=1))
    np.testing.assert_allclose(found, np.concatenate(expected, axis=1), rtol=1e-5)


def test_without_compensation_a_recording_is_left_around_its_mean(
    noisy_problem: AxisData,
) -> None:
    found = uncompensated_errors(moments_of(noisy_problem, PARTS))
    expected = []
    for values in noisy_problem.residual:
        seen = values[np.isfinite(values)]
        expected += [part.mean() for part in np.array_split((seen - seen.mean()) ** 2, PARTS)]
    np.testing.assert_allclose(found, expected, rtol=1e-8)


def test_the_combination_that_leaves_least_is_taken(
    noisy_problem: AxisData,
    textbook_bank: Bank,
    stack_samples: Stack,
    centre: Centre,
    augmented_ridge: Solve,
) -> None:
    moments = moments_of(noisy_problem)
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
