"""The pool: relaxations between its own, ridge, and time constants that several axes share."""

import numpy as np
import pytest

from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.column_pool import (
    FreeTimeConstants,
    GRID_S,
    interpolate,
    jackknife_errors,
    least_squares,
    Mixtures,
    near,
    RidgeBank,
)
from wrist_ft_comp.fit.moments import accumulate, bank_inputs, bin_axis_data

FEATURES = Features('powers', np.array([30.0]), np.zeros(1), np.full(1, 99.0), degree=3)
CELLS = 300


def moments_of(problem):
    cells = bin_axis_data(problem, 1)
    moments = accumulate(cells, bank_inputs(cells, FEATURES, GRID_S), len(GRID_S))
    return moments, moments.centred()


class TestInterpolation:
    def test_a_relaxation_of_the_grid_is_itself(self):
        for position, tau in enumerate(GRID_S[1:], start=1):
            (nodes,), (weights,), _ = interpolate(np.log([tau]))
            np.testing.assert_allclose(weights, nodes == position, atol=1e-9)

    @pytest.mark.parametrize('tau', [22.0, 40.0, 300.0, 1000.0, 5000.0])
    def test_one_between_is_nearly_its_mixture(self, warm_up, lagged, tau):
        temperature_c = warm_up(CELLS, 0)
        grid = np.stack([lagged(temperature_c, tau_s) for tau_s in GRID_S[1:]], axis=1)
        exact = lagged(temperature_c, tau)
        (nodes,), (weights,), _ = interpolate(np.log([tau]))
        assert np.abs(grid[:, nodes - 1] @ weights - exact).max() < 3e-3 * np.ptp(exact)

    @pytest.mark.parametrize('log_tau', np.log([21.0, 33.0, 300.0, 5500.0]))
    def test_its_slope_is_that_of_differences(self, log_tau):
        up, down = (interpolate(np.array([log_tau + step]))[1] for step in (1e-5, -1e-5))
        np.testing.assert_allclose(
            interpolate(np.array([log_tau]))[2], (up - down) / 2e-5, atol=1e-8
        )


def test_ridge_is_least_squares_with_a_row_per_penalty(
    noisy_problem, textbook_bank, stack_samples, whiten
):
    """Ten times the penalty with every power; the load and its products count as first powers."""
    strengths, bank, degree = (1e-1, 1e-2, 1e-4), near(0, 100, 600), 2
    moments, normal = moments_of(noisy_problem)
    x, y, places = stack_samples(noisy_problem, textbook_bank(noisy_problem, GRID_S, 3), {0, 1, 2})
    x, y = (whiten(values, places, noisy_problem) for values in (x, y))
    zero, gain = ([3 * k + p for k in bank for p in range(d)] for d in (degree, 1))
    half = 3 * len(GRID_S)
    columns = [*zero, *([half + k for k in gain] + [2 * half]) * moments.loaded]
    powers = np.array([1 + (k % 3) for k in zero] + [1] * (len(columns) - len(zero)))
    fits = RidgeBank(degree, 1, bank, strengths).fit(moments, normal)
    for strength, theta in zip(strengths, fits, strict=True):
        penalty = np.sqrt(strength * 10.0 ** (powers - 1)) * np.linalg.norm(x[:, columns], axis=0)
        rows = np.concatenate((x[:, columns], np.diag(penalty)))
        target = np.concatenate((y, np.zeros(len(columns))))
        expected = np.zeros(x.shape[1] + 1)
        expected[columns], expected[-1] = np.linalg.lstsq(rows, target, rcond=None)[0], -1.0
        np.testing.assert_allclose(theta, expected, rtol=1e-5, atol=1e-9)


def test_least_squares_has_just_enough_ridge(
    noisy_problem, textbook_bank, stack_samples, whiten, augmented_ridge
):
    """For chosen columns, and for mixtures of all."""
    moments, normal = moments_of(noisy_problem)
    x, y, places = stack_samples(noisy_problem, textbook_bank(noisy_problem, GRID_S, 3), {0, 1, 2})
    x, y = (whiten(values, places, noisy_problem) for values in (x, y))
    columns = moments.columns([3, 9], 2, 1)
    assert len(columns) == (7 if moments.loaded else 4)
    mixing = np.random.default_rng(0).standard_normal((3, len(columns)))
    for mixed_places, mixed in (
        (columns[:, np.newaxis], np.ones((len(columns), 1))),
        (np.tile(columns, (3, 1)), mixing),
    ):
        mixtures = np.zeros((x.shape[1], len(mixed)))
        np.put_along_axis(mixtures, mixed_places.T, mixed.T, axis=0)
        mixed_of_pool = Mixtures(mixed_places, mixed, mixed, np.zeros(len(mixed)))
        gains, error, rest = least_squares(normal, mixed_of_pool)
        expected = augmented_ridge(x @ mixtures, y, 1e-7)
        np.testing.assert_allclose(gains, expected, rtol=1e-4, atol=1e-7)
        left = y - x @ mixtures @ gains
        assert rest == pytest.approx(np.sum(left**2), rel=1e-7)
        np.testing.assert_allclose(error, -x.T @ left, atol=1e-6 * np.ptp(x.T @ y))


def test_equal_columns_share_their_gain_and_silent_ones_get_none():
    rng = np.random.default_rng(0)
    x, y = rng.standard_normal((2, 60))
    both = np.stack((x, x, 0 * x, x, y), axis=1)
    gains = least_squares(both.T @ both)[0]
    np.testing.assert_allclose(gains, x @ y / (x @ x) / 3 * np.array([1, 1, 0, 1]), rtol=1e-6)


def test_the_jackknife_of_means_is_the_standard_error_of_a_mean():
    blocks = np.random.default_rng(0).standard_normal((7, 2))
    without = [np.delete(blocks, n, axis=0).mean(axis=0) for n in range(7)]
    expected = blocks.std(axis=0, ddof=1) / np.sqrt(7)
    np.testing.assert_allclose(jackknife_errors(without), expected)


@pytest.fixture(scope='module', params=[(400.0,), (60.0, 1300.0)], ids=str)
def body(request, make_axis_data, warm_up, lagged):
    """Three axes behind the same lags: one loaded, one not, one that hardly drifts."""
    taus, rng = request.param, np.random.default_rng(0)
    temperatures = [warm_up(CELLS, 5 + i) for i in range(2)]
    axes = []
    for gain, loaded in ((0.5, True), (-2.0, False), (0.05, False)):
        drifts = [
            sum(
                g * (lagged(t, tau) - 30)
                for tau, g in zip(taus, (gain, -0.7 * gain), strict=False)
            )
            for t in temperatures
        ]
        loads = [20 * rng.standard_normal(CELLS) for _ in drifts] if loaded else None
        raws = [
            o + (0 if loads is None else (1.01 + 2e-3 * o) * loads[i]) + rng.normal(0, 0.02, CELLS)
            for i, o in enumerate(drifts)
        ]
        axes.append(moments_of(make_axis_data(temperatures, raws, loads)))
    return taus, *zip(*axes, strict=True)


def test_time_constants_that_axes_share_are_found_from_the_grid_on(body):
    taus, moments, normals = body
    free = FreeTimeConstants(1, 1, len(taus))
    guess = free.first_guess(moments, normals)
    found = free.search(moments, normals, guess)
    np.testing.assert_allclose(np.sort(np.exp(found)), taus, rtol=0.05)
    assert np.isin(np.round(guess, 9), np.round(np.log(GRID_S[1:]), 9)).all()

    def left(logs):
        fits = (free.fit(*pair, logs)[0] for pair in zip(moments, normals, strict=True))
        pairs = zip(fits, normals, strict=True)
        return sum(np.log(theta @ normal @ theta) for theta, normal in pairs)

    assert left(found) < left(guess)
    for step in 0.02 * np.concatenate((np.eye(len(taus)), -np.eye(len(taus)))):
        assert left(found) < left(found + step)
