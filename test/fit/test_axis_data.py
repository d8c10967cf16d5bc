"""What is fitted for one axis: residuals, loads and what is held out."""

import numpy as np
import pytest

from wrist_ft_comp.fit.axis_data import build_axis_data

CELLS = 240
LOAD = 30 * np.random.default_rng(0).standard_normal(CELLS)


@pytest.fixture(scope='module')
def build(make_recording):
    """Build force y of one recording in one fold, of a raw wrench and a reference."""

    def make(raw, load=LOAD, reference='recorded', axis='force_y'):
        recording = make_recording(np.linspace(20, 40, CELLS), {'force_y': raw}, {axis: load})
        folds = [np.zeros(CELLS, dtype=np.int64)]
        return build_axis_data([recording], 'force_y', reference, folds)

    return make


@pytest.mark.parametrize('gain_error', [-0.5, 0.0, 0.3, 4.0])
def test_a_gain_error_is_not_mistaken_for_noise(build, gain_error):
    noise = 0.1 * np.random.default_rng(1).standard_normal(CELLS)
    assert build((1 + gain_error) * LOAD + noise).no_sensitivity == ''


@pytest.mark.parametrize(
    ('share', 'reason'), [(1 / 30, 'less than 10 times the noise'), (0.0, 'varied by 0')]
)
def test_a_load_that_hardly_varies_teaches_no_sensitivity(build, share, reason):
    noise = np.random.default_rng(1).standard_normal(CELLS)
    data = build(share * LOAD + noise, share * LOAD)
    assert data.load is None
    assert reason in data.no_sensitivity


def test_an_axis_without_reference_teaches_nothing(build):
    data = build(LOAD, axis='force_x')
    assert data.no_sensitivity == 'no reference wrench was recorded for this axis'
    assert data.samples == 0
