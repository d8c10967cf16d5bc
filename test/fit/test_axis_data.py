"""What is fitted for one axis: residuals, loads, stretches and folds."""

import numpy as np
import pytest

from wrist_ft_comp.fit.axis_data import assign_folds, build_axis_data, FOLDS

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


@pytest.mark.parametrize('cells', [1, 7, 39, 40, 200, 3600, 30000])
@pytest.mark.parametrize('period_s', [0.1, 1.0, 10.0, 60.0])
def test_bins_that_are_judged_are_whole_bins_that_are_fitted(make_recording, cells, period_s):
    recording = make_recording(np.zeros(cells), {'force_x': 0.0}, period_s=period_s)
    folds = assign_folds([recording])
    fitted, judged = build_axis_data([recording], 'force_x', 'unloaded', folds).bin_cells
    assert fitted >= 1
    assert judged % fitted == 0
    assert judged * period_s <= max(30.0, period_s)
    assert fitted * period_s <= max(10.0, period_s)
    assert judged == 1 or cells // judged >= FOLDS * 8


class TestFolds:
    def test_several_recordings_are_held_out_whole(self, make_recording):
        recordings = [make_recording(np.ones(n), {'force_x': 1.0}) for n in (50, 60, 70)]
        for number, folds in enumerate(assign_folds(recordings)):
            np.testing.assert_array_equal(folds, np.full(50 + 10 * number, number))

    def test_one_recording_is_cut_into_equal_times_or_at_plateaus(self, make_recording):
        (folds,) = assign_folds([make_recording(LOAD, {'force_x': LOAD})])
        assert (np.diff(folds) >= 0).all()
        assert len(np.unique(folds)) == FOLDS
        assert np.ptp(np.bincount(folds)) < 10  # they end at whole bins
        raw = np.where(np.arange(CELLS) % 60 < 20, 1.0, np.nan)
        stairs = np.repeat([20.0, 10.0, 30.0, 40.0], 60)[:CELLS]
        (folds,) = assign_folds([make_recording(stairs, {'force_x': raw})])
        np.testing.assert_array_equal(folds[np.isfinite(raw)], np.repeat(range(4), 20))

    @pytest.mark.parametrize('tau_cells', [24, 60, 1000])
    def test_a_warm_up_is_cut_half_by_time_and_half_by_kelvin(self, make_recording, tau_cells):
        share = -np.expm1(-np.arange(720) / tau_cells)
        recording = make_recording(20 + 15 * share, {'force_y': 1.0})
        (folds,) = assign_folds([recording])
        ends = np.flatnonzero(np.diff(folds)) + 1
        passed = (ends / 720 + share[ends] / share[-1]) / 2
        np.testing.assert_allclose(passed, [1 / 3, 2 / 3], atol=0.05)
        recording.temperature_c[:] = 20.0
        (still,) = assign_folds([recording])
        np.testing.assert_array_equal(np.unique(still), [0, 1])

    def test_a_recording_that_is_held_out_loses_its_samples_only(self, make_axis_data):
        data = make_axis_data([LOAD] * 3, [LOAD] * 3)
        assert data.fold_numbers == [0, 1, 2]
        part = data.without(1)
        assert np.isnan(part.residual[1]).all()
        np.testing.assert_array_equal(part.residual[2], LOAD)
        assert part.temperature_c is data.temperature_c
        assert part.fold_numbers == [0, 2]
        assert np.isfinite(data.residual[1]).all()
