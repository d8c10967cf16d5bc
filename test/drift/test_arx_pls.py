"""Outer and inner model together; test_reproduce.py runs the model that the paper publishes."""

import numpy as np
import pytest

from wrist_ft_comp.drift.arx import Arx
from wrist_ft_comp.drift.arx_pls import ArxPls


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
