"""Gains behind filters in the form that runs."""

from collections.abc import Callable

import numpy as np
import pytest

from wrist_ft_comp.model.arx import Arx, relaxation, static_gain
from wrist_ft_comp.model.arx_pls import from_gains

Array = np.ndarray


@pytest.mark.parametrize('inputs', [1, 4])
@pytest.mark.parametrize('outputs', [1, 2])
def test_the_free_run_is_the_sum_of_filtered_gains(
    lagged: Callable[..., Array], inputs: int, outputs: int
) -> None:
    rng = np.random.default_rng([inputs, outputs])
    taus = (0.0, 40.0, 700.0)
    gains = rng.standard_normal((3, inputs, outputs))
    x = np.cumsum(rng.standard_normal((200, inputs)), axis=0) * [1e3, 1, 1e-3, 1][:inputs]
    mean, weight = x.mean(axis=0), 1 / x.std(axis=0)
    output_weight = np.array([2.0, 0.1])[:outputs]
    model = from_gains([relaxation(tau, 10.0) for tau in taus], gains, mean, weight, output_weight)
    assert model is not None
    _, found = model.run(model.start(x[0]), x)
    expected = np.zeros((200, outputs))
    for tau, gain in zip(taus, gains, strict=True):
        filtered = x - mean
        if tau:
            filtered = np.stack([lagged(column, tau) for column in filtered.T], axis=1)
        expected += filtered @ gain / output_weight
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
    assert np.abs(expected).max() > 1


def test_lost_rank_needs_fewer_latents() -> None:
    gains = np.zeros((2, 3, 2))
    gains[1] = np.outer([1.0, 2.0, 3.0], [1.0, -1.0])
    bank = [static_gain(), relaxation(10.0, 1.0)]
    model = from_gains(bank, gains, np.zeros(3), np.ones(3), np.ones(2))
    assert model is not None
    assert len(model.latents) == 1
    assert isinstance(model.latents[0], Arx)


def test_no_gain_at_all_is_no_model() -> None:
    bank = [static_gain()]
    assert from_gains(bank, np.zeros((1, 3, 2)), np.zeros(3), np.ones(3), np.ones(2)) is None
