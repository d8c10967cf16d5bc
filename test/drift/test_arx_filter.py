"""The inner model: its free run, regressors, least squares and poles."""

import numpy as np
import pytest

from wrist_ft_comp.drift.arx_filter import (
    Arx,
    fit_one_step,
    free_run,
    MAX_POLE_RADIUS,
    mean_relaxation,
    regressors,
    relaxation,
    stabilise,
)
from wrist_ft_comp.errors import TooShortError

#: n, m, first lag; with a direct term (0), without (1), as the paper's first H(z) (2), and later.
ORDERS = [(0, 1, 0), (1, 1, 0), (1, 1, 1), (2, 1, 0), (2, 2, 1), (2, 2, 2), (3, 2, 0), (1, 3, 4)]
orders = pytest.mark.parametrize(('order', 'inputs', 'first_lag'), ORDERS)


def seeded_arx(order, inputs, first_lag, seed=0):
    """A stable system: real poles and complex pairs well inside the unit circle."""
    rng = np.random.default_rng([seed, order, inputs, first_lag])
    poles: list[complex] = []
    while len(poles) < order:
        if order - len(poles) > 1 and rng.uniform() < 0.5:
            pole = rng.uniform(0.5, 0.9) * np.exp(1j * rng.uniform(0.3, 2.5))
            poles += [pole, np.conj(pole)]
        else:
            poles.append(rng.uniform(0.3, 0.9))
    a = np.real(np.atleast_1d(np.poly(poles)))[1:]
    return Arx(a, rng.uniform(0.5, 2.0, inputs), first_lag)


def seeded_input(samples, seed=0):
    return np.cumsum(np.random.default_rng(seed).standard_normal(samples))


def textbook_output(arx, t, before=0.0):
    """The module's equation, term by term; before the first sample all inputs are `before`."""
    resting = before * sum(arx.b) / (1 + sum(arx.a))
    u = np.zeros(len(t))
    for k in range(len(t)):
        for j, a in enumerate(arx.a, start=1):
            u[k] -= a * (u[k - j] if k >= j else resting)
        for i, b in enumerate(arx.b):
            lag = arx.first_lag + i
            u[k] += b * (t[k - lag] if k >= lag else before)
    return u


@orders
def test_regressors_are_the_rows_of_eq_20(order, inputs, first_lag):
    t, u = seeded_input(30), seeded_input(30, 1)
    phi, target = regressors(t, u, order, inputs, first_lag)
    longest = max(order, first_lag + inputs - 1)
    assert phi.shape == (30 - longest, order + inputs)
    for row, k in enumerate(range(longest, 30)):
        expected = [u[k - j] for j in range(1, order + 1)]
        expected += [t[k - first_lag - i] for i in range(inputs)]
        np.testing.assert_array_equal(phi[row], expected)
        assert target[row] == u[k]
    assert len(regressors(t[: longest + 1], u[: longest + 1], order, inputs, first_lag)[0]) == 1
    with pytest.raises(TooShortError, match=f'longest lag of {longest} cells .* got {longest}'):
        regressors(t[:longest], u[:longest], order, inputs, first_lag)


@orders
def test_recordings_with_different_offsets_and_gaps_are_fitted_together(order, inputs, first_lag):
    true = seeded_arx(order, inputs, first_lag)
    segments = []
    for seed, offset in enumerate((0.0, 1e3, -40.0)):
        t = np.random.default_rng(seed).standard_normal(80 + 30 * seed)
        segments.append((t, textbook_output(true, t) + offset))
        segments[-1][1][[10, 11, 50, 79]] = np.nan
    fitted = fit_one_step(segments, order, inputs, first_lag)
    np.testing.assert_allclose(fitted.a, true.a, atol=1e-8)
    np.testing.assert_allclose(fitted.b, true.b, atol=1e-8)
    assert fitted.first_lag == first_lag


def test_too_few_complete_rows_are_refused():
    t = np.random.default_rng(0).standard_normal(40)
    u = t.copy()
    u[::3] = np.nan
    with pytest.raises(TooShortError, match='needs more runs of 4 consecutive cells'):
        fit_one_step([(t, u)], 2, 3, 1)
    with pytest.raises(TooShortError) as refusal:
        fit_one_step([(t[:6], t[:6])], 2, 2, 1)
    assert str(refusal.value) == (
        'An ARX with 4 coefficients needs more runs of 3 consecutive cells with samples than '
        'that. Record without gaps, use a longer thermal period, or choose a static method.'
    )


@orders
def test_the_free_run_feeds_back_its_own_outputs(order, inputs, first_lag):
    arx, t = seeded_arx(order, inputs, first_lag), seeded_input(60)
    expected = textbook_output(arx, t, before=t[0])
    np.testing.assert_allclose(free_run(arx, t), expected, rtol=1e-10, atol=1e-10)
    both = free_run(arx, np.stack((t, 2 * t + 1), axis=1))
    np.testing.assert_allclose(both.T, (expected, 2 * expected + arx.gain), rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize('time_constant_s', [0.0, 7.0, 300.0])
def test_a_mean_relaxation_gives_the_means_of_bins(time_constant_s):
    bins = seeded_input(30)
    cells = free_run(relaxation(time_constant_s, 2.0), np.repeat(bins, 5))
    means = free_run(mean_relaxation(time_constant_s, 2.0, 5), bins)
    np.testing.assert_allclose(means, cells.reshape(30, 5).mean(axis=1), atol=1e-10)


@pytest.mark.parametrize('time_constant_s', [0.0, 5.0, 300.0, 7200.0])
def test_a_relaxation_follows_a_step_as_the_continuous_one(time_constant_s):
    lag = relaxation(time_constant_s, 2.0)
    step = np.concatenate(([0.0], np.ones(5000)))
    elapsed = 2.0 * np.arange(5001)  # end of each cell after the step
    expected = 1 - np.exp(-elapsed / max(time_constant_s, 1e-9))
    np.testing.assert_allclose(free_run(lag, step)[1:], expected[1:], atol=1e-10)
    assert lag.longest_lag == bool(time_constant_s), 'a gain has no memory'


@pytest.mark.parametrize(
    'poles',
    [
        [1.2 * np.exp(0.7j), 1.2 * np.exp(-0.7j)],
        [1.0 * np.exp(0.1j), 1.0 * np.exp(-0.1j)],
        [-1.3, 0.5],
        [1.5, 1.1, 0.0],
        [3.0 * np.exp(2j), 3.0 * np.exp(-2j), 0.9],
    ],
)
def test_unstable_poles_come_inside_and_the_static_gain_stays(poles):
    unstable = Arx(np.real(np.poly(poles))[1:], np.array([0.3, 0.4]), 1)
    mended, moved = stabilise(unstable)
    assert moved
    assert np.abs(mended.poles).max() < 1
    assert mended.gain == pytest.approx(unstable.gain, rel=1e-3)
    assert mended.first_lag == 1
    assert np.abs(free_run(mended, np.ones(3000))).max() < 1e6


@pytest.mark.parametrize('pole', [1.2, 1.0, 1.0 + 1e-9, 1.0 - 1e-9, 1.0 - 1e-12])
def test_a_pole_at_or_beyond_one_comes_inside_and_the_response_stays_that_of_an_integrator(pole):
    """There is no static gain to keep: what counts is how the output sets out."""
    mended, moved = stabilise(Arx(np.array([-pole]), np.array([0.01])))
    assert moved
    assert 0 < mended.poles[0] <= MAX_POLE_RADIUS
    set_out = free_run(mended, np.concatenate(([0.0], np.ones(10))))
    assert 0.008 <= set_out[1] <= 0.0101


@orders
def test_a_stable_system_is_left_alone(order, inputs, first_lag):
    slowest = Arx(np.array([-MAX_POLE_RADIUS]), np.ones(1))
    for arx in (seeded_arx(order, inputs, first_lag), slowest):
        mended, moved = stabilise(arx)
        assert mended is arx
        assert not moved
