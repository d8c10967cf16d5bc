"""The inner model's least squares: regressors, coefficients, J_r and poles."""

import numpy as np
import pytest

from wrist_ft_comp.drift.arx_pls import Arx, free_run
from wrist_ft_comp.errors import TooShortError
from wrist_ft_comp.fit.arx_pls import fit_one_step, MAX_POLE_RADIUS, stabilise
from wrist_ft_comp.fit.settings import Orders

#: Static, with a direct term and without, as the paper's first H(z) (d = 1), and later.
ORDERS = [
    Orders(0, 1, 0, direct=True), Orders(1, 1, 0, direct=True), Orders(1, 1, 0), Orders(2, 2, 0),
    Orders(2, 2, 1), Orders(3, 2, 0, direct=True), Orders(1, 3, 3), Orders(2, 1, 4, direct=True),
]  # fmt: skip


@pytest.mark.parametrize('orders', ORDERS, ids=str)
def test_recordings_with_different_offsets_and_gaps_are_fitted_together(orders):
    rng = np.random.default_rng([0, orders.n, orders.m, orders.d])
    a = np.atleast_1d(np.poly(rng.uniform(0.3, 0.9, orders.n)))[1:]
    true = Arx(a, rng.uniform(0.5, 2.0, orders.m), orders.first_lag)
    segments = []
    for seed, offset in enumerate((0.0, 1e3, -40.0)):
        t = np.random.default_rng(seed).standard_normal(80 + 30 * seed)
        segments.append((t, free_run(true, t) + offset))
        segments[-1][1][[10, 11, 50, 79]] = np.nan
    fitted, _ = fit_one_step(segments, orders)
    np.testing.assert_allclose(fitted.a, true.a, atol=1e-8)
    np.testing.assert_allclose(fitted.b, true.b, atol=1e-8)
    assert fitted.first_lag == orders.first_lag


def test_too_few_complete_rows_are_refused():
    t = np.random.default_rng(0).standard_normal(40)
    u = t.copy()
    u[::3] = np.nan
    with pytest.raises(TooShortError, match='stretches of 4 consecutive thermal cells'):
        fit_one_step([(t, u)], Orders(2, 3, 0))
    with pytest.raises(TooShortError, match='more than as many stretches of 3'):
        fit_one_step([(t[:6], t[:6])], Orders(2, 2, 0))
    with pytest.raises(TooShortError, match='4 coefficients'):
        fit_one_step([(t[:2], t[:2])], Orders(2, 2, 0))


@pytest.mark.parametrize(
    'poles', [1.2 * np.exp([0.7j, -0.7j]), [-1.3, 0.5], [1.5, 1.1, 0.0]], ids=str
)
def test_unstable_poles_come_inside_and_the_size_of_the_static_gain_stays(poles):
    unstable = Arx(np.real(np.poly(poles))[1:], np.array([0.3, 0.4]), 1)
    mended, moved = stabilise(unstable)
    assert moved
    assert np.abs(mended.poles).max() <= MAX_POLE_RADIUS
    assert abs(mended.gain) == pytest.approx(abs(unstable.gain), rel=1e-3)
    assert mended.first_lag == 1


@pytest.mark.parametrize('pole', [1.2, 1.0, 1.0 - 1e-9])
def test_a_pole_at_or_beyond_one_comes_inside_and_sets_out_as_it_did(pole):
    mended, moved = stabilise(Arx(np.array([-pole]), np.array([0.01])))
    assert moved
    assert 0 < mended.poles[0] <= MAX_POLE_RADIUS
    assert 0.008 <= free_run(mended, np.array([0.0, 1.0]))[1] <= 0.0101
