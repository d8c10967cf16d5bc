"""The noise of slowly moving series."""

import numpy as np
import pytest

from wrist_ft_comp.model.signals import noise_level


def test_it_is_found_under_a_trend_steps_and_gaps() -> None:
    rng = np.random.default_rng(2)
    series = []
    for offset in (0.0, 1e3):
        values = offset + np.linspace(0, 50, 4000) + 0.3 * rng.standard_normal(4000)
        values[1000:] += 40
        values[rng.uniform(size=4000) < 0.2] = np.nan
        series.append(values)
    assert noise_level(series) == pytest.approx(0.3, rel=0.1)


def test_nothing_has_no_noise() -> None:
    assert noise_level([np.full(5, np.nan), np.array([1.0])]) == 0.0
