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


@pytest.mark.parametrize('reference', ['unloaded', 'constant'])
def test_without_a_reference_the_raw_wrench_is_the_residual(build, reference):
    data = build(LOAD, reference=reference)
    np.testing.assert_array_equal(data.residual[0], LOAD)
    assert data.load is None
    assert data.no_sensitivity == f'the reference was declared {reference}'
    assert data.period_s == 10.0


def test_a_recorded_reference_is_subtracted(build):
    raw = 1.02 * LOAD + 5
    raw[7] = np.nan
    data = build(raw)
    np.testing.assert_allclose(data.residual[0], 0.02 * LOAD + 5 + 0 * raw, atol=1e-12)
    assert data.load is not None
    assert data.no_sensitivity == ''
    assert data.samples == CELLS - 1


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


def test_a_recording_that_is_held_out_loses_its_samples_only(make_axis_data):
    data = make_axis_data([LOAD] * 3, [LOAD] * 3)
    assert data.fold_numbers == [0, 1, 2]
    part = data.without(1)
    assert np.isnan(part.residual[1]).all()
    np.testing.assert_array_equal(part.residual[2], LOAD)
    assert part.temperature_c is data.temperature_c
    assert part.fold_numbers == [0, 2]
    assert np.isfinite(data.residual[1]).all()
