"""Which stretches are held out in turn, and in which bins they are judged."""

import numpy as np
import pytest

from wrist_ft_comp.fit.axis_data import build_axis_data
from wrist_ft_comp.fit.folds import assign_folds, FOLDS

CELLS = 240
LOAD = 30 * np.random.default_rng(0).standard_normal(CELLS)


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
