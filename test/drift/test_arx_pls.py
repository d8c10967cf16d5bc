"""Outer and inner model together; test_reproduce.py runs the model that the paper publishes."""

import numpy as np
import pytest

from wrist_ft_comp.drift.arx import Arx, free_run, relaxation, static_gain
from wrist_ft_comp.drift.arx_pls import ArxPls, from_gains


def single(latent):
    """One latent, and nothing around it."""
    one = np.ones(1)
    return ArxPls(0 * one, one, np.eye(1), (latent,), np.eye(1), one, 0 * one)


@pytest.mark.parametrize('pole', [-0.7, 0.0, 1e-9, 0.5, np.exp(-1 / 30), np.exp(-1 / 3000)])
@pytest.mark.parametrize('cells', [1, 31, 32, 33, 1024, 1025, 5000])
def test_a_relaxation_runs_as_the_plain_recursion(pole, cells):
    t = 1.0 + np.random.default_rng(cells).standard_normal(cells)
    u, last = np.empty(cells), -3.0
    for k in range(cells):
        u[k] = last = 0.3 * t[k] + pole * last
    after, y = single(Arx(np.array([-pole]), np.array([0.3]))).run(
        np.array([[pole * -3.0]]), t[:, np.newaxis]
    )
    size = np.abs(u).max()
    np.testing.assert_allclose(y[:, 0], u, rtol=1e-12, atol=1e-12 * size)
    np.testing.assert_allclose(after, [[pole * last]], rtol=1e-12, atol=1e-12 * size)


@pytest.mark.parametrize('dead', [False, True], ids=['all inputs', 'one of weight 0'])
def test_a_sum_of_filtered_gains_is_written_exactly(*, dead):
    rng = np.random.default_rng(7)
    bank = [static_gain(), relaxation(5.0, 1.0), relaxation(50.0, 1.0)]
    gains, mean = rng.standard_normal((3, 4, 2)), rng.standard_normal(4)
    weight, output_weight = np.array([0.3, 2.0, 0.9, 8.0]), np.array([0.5, 20.0])
    gains[1], gains[2] = 0.0, np.outer(gains[2, :, 0], [1.0, -3.0])
    if dead:
        weight[3], gains[:, 3] = 0.0, 0.0
    model = from_gains(bank, gains, mean, weight, output_weight)
    assert model is not None
    assert len(model.latents) == 3, 'as many as the ranks of the gains'
    x = rng.standard_normal((40, 4))
    _, y = model.run(model.start(x[0]), x)
    parts = [free_run(h, x - mean) @ gain for h, gain in zip(bank, gains, strict=True)]
    np.testing.assert_allclose(y, sum(parts) / output_weight, atol=1e-10)
    tiny = from_gains(bank, 1e-13 * gains, mean, weight, output_weight)
    assert tiny is not None
    np.testing.assert_allclose(tiny.run(tiny.start(x[0]), x)[1] * 1e13, y, atol=1e-10)
    assert from_gains(bank, 0 * gains, mean, weight, output_weight) is None
    with pytest.raises(ValueError, match='longer'):
        from_gains(bank[:2], gains, mean, weight, output_weight)
