import numpy as np
import pytest

from wrist_ft_comp.drift.arx_pls import Arx, free_run, relaxation

PAIR = 0.8 * np.exp([0.7j, -0.7j])
#: Poles, gains on inputs, and first lag: 0 is a direct term, 2 the paper's first H(z).
EVERY = [
    Arx(np.real(np.poly(poles))[1:] if len(poles) else np.zeros(0), np.array(b), first_lag)
    for poles, b, first_lag in (
        ([], [1.5], 0), ([0.7], [0.8], 0), ([0.7], [0.8], 1), ([0.9, 0.4], [1.0, 0.6], 2),
        (PAIR, [1.2], 0), ([*PAIR, 0.5], [0.5, 0.9], 0), ([0.6], [0.7, 1.1, 0.4], 4),
    )
]  # fmt: skip


def seeded_input(samples, seed=0):
    return np.cumsum(np.random.default_rng(seed).standard_normal(samples))


@pytest.mark.parametrize('arx', EVERY)
def test_the_free_run_feeds_back_its_own_outputs(arx):
    t = seeded_input(60)
    resting = t[0] * sum(arx.b) / (1 + sum(arx.a))
    expected = np.zeros(60)
    for k in range(60):  # the module's equation, term by term; before, all inputs were t[0]
        for j, a in enumerate(arx.a, start=1):
            expected[k] -= a * (expected[k - j] if k >= j else resting)
        for lag, b in enumerate(arx.b, start=arx.first_lag):
            expected[k] += b * (t[k - lag] if k >= lag else t[0])
    np.testing.assert_allclose(free_run(arx, t), expected, rtol=1e-10, atol=1e-10)
    both = free_run(arx, np.stack((t, 2 * t + 1), axis=1))
    np.testing.assert_allclose(both.T, (expected, 2 * expected + arx.gain), rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize('time_constant_s', [0.0, 7.0, 300.0])
def test_a_mean_relaxation_gives_the_means_of_bins(time_constant_s):
    bins = seeded_input(30)
    cells = free_run(relaxation(time_constant_s, 2.0), np.repeat(bins, 5))
    means = free_run(relaxation(time_constant_s, 2.0, 5), bins)
    np.testing.assert_allclose(means, cells.reshape(30, 5).mean(axis=1), atol=1e-10)


@pytest.mark.parametrize('time_constant_s', [0.0, 5.0, 300.0, 7200.0])
def test_a_relaxation_follows_a_step_as_the_continuous_one(time_constant_s):
    lag = relaxation(time_constant_s, 2.0)
    step = np.concatenate(([0.0], np.ones(5000)))
    elapsed = 2.0 * np.arange(5001)  # end of each cell after the step
    expected = 1 - np.exp(-elapsed / max(time_constant_s, 1e-9))
    np.testing.assert_allclose(free_run(lag, step)[1:], expected[1:], atol=1e-10)
    assert lag.longest_lag == bool(time_constant_s), 'a gain has no memory'
