"""What is fitted for one axis: residuals, loads and what is held out."""

import numpy as np
import pytest

CELLS = 240
LOAD = 30 * np.random.default_rng(0).standard_normal(CELLS)
NOISE = np.random.default_rng(1).standard_normal(CELLS)


@pytest.mark.parametrize(
    ('raw', 'load', 'reason'),
    [
        *(((1 + gain_error) * LOAD + 0.1 * NOISE, LOAD, '') for gain_error in (-0.5, 0.0, 4.0)),
        (LOAD / 30 + NOISE, LOAD / 30, 'less than 10 times the noise'),
        (NOISE, 0 * LOAD, 'varied by 0'),
        (LOAD, np.nan * LOAD, 'no reference wrench was recorded for this axis'),
    ],
)
def test_sensitivity_is_learnt_if_load_varies_more_than_noise(make_axis_data, raw, load, reason):
    data = make_axis_data([np.linspace(20, 40, CELLS)], [raw], [load])
    assert (data.load is None) == bool(reason)
    assert reason in data.no_sensitivity
    assert data.samples == np.isfinite(load).sum()
