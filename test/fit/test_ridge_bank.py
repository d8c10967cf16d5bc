"""The candidates of ``auto``: ridge on columns of one pool, written out row by row."""

import numpy as np
import pytest

from wrist_ft_comp.fit.ridge_bank import (
    BANKS_S,
    bin_axis_data,
    candidates,
    DEGREE_PENALTY,
    Pool,
    POOL_S,
    sum_by_fold,
)

DEGREE = 3


@pytest.fixture(scope='module')
def posed(noisy_problem, textbook_bank, stack_samples, centre):
    """The pool of a problem with one thermometer, its sums, and all samples in rows."""
    banked = textbook_bank(noisy_problem, POOL_S, DEGREE)
    sums = sum_by_fold(bin_axis_data(noisy_problem, 1), banked)
    x, y, places = stack_samples(noisy_problem, banked, {0, 1, 2})
    pool = Pool(DEGREE, 1, noisy_problem.load is not None)
    return pool, sums.centred(sums.fold >= 0), centre(x, places), centre(y, places)


def test_there_are_ten_for_each_degree_and_the_simplest_comes_first():
    fits = candidates(DEGREE)
    assert len(fits) == 30
    assert len(set(fits)) == 30
    assert fits[0].name == 'static, degree 1'
    assert [fit.degree for fit in fits] == [1] * 10 + [2] * 10 + [3] * 10
    assert {fit.bank_s for fit in fits} == {(0.0,), *BANKS_S.values()}


@pytest.mark.parametrize('candidate', candidates(DEGREE)[::3], ids=str)
def test_ridge_is_least_squares_with_a_row_per_penalty(posed, candidate):
    """Ten times the penalty with every power; the load and its products count as first powers."""
    pool, normal, x, y = posed
    places = [int(np.flatnonzero(tau == POOL_S)[0]) for tau in candidate.bank_s]
    zero = [DEGREE * k + power for k in places for power in range(candidate.degree)]
    half = DEGREE * len(POOL_S)
    gain = [half + DEGREE * k for k in places] if pool.loaded else []
    columns = [*zero, *gain, *([2 * half] if pool.loaded else [])]
    powers = np.array([1 + k % DEGREE for k in zero] + [1] * (len(columns) - len(zero)))
    penalty = np.sqrt(candidate.strength * DEGREE_PENALTY ** (powers - 1.0))
    rows = np.diag(penalty * np.linalg.norm(x[:, columns], axis=0))
    stacked = np.concatenate((x[:, columns], rows))
    target = np.concatenate((y, np.zeros(len(columns))))
    expected = np.zeros(x.shape[1] + 1)
    expected[columns], expected[-1] = np.linalg.lstsq(stacked, target, rcond=None)[0], -1.0
    np.testing.assert_allclose(pool.fit(candidate, normal), expected, rtol=1e-5, atol=1e-9)


def test_equal_columns_share_their_gain_and_silent_ones_get_none():
    rng = np.random.default_rng(0)
    t, y = rng.standard_normal((2, 60))
    both = np.column_stack([t if tau in {0.0, 20.0, 60.0} else 0 * t for tau in POOL_S] + [y])
    line = candidates(1)[6]
    assert line == ('bank to 60 s, degree 1', (0.0, 20.0, 60.0), 1, 1e-6)
    gains = Pool(1, 1, loaded=False).fit(line, both.T @ both)[:-1]
    np.testing.assert_allclose(gains[np.isin(POOL_S, line.bank_s)], t @ y / (t @ t) / 3, rtol=1e-5)
    assert not gains[~np.isin(POOL_S, line.bank_s)].any()
