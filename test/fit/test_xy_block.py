"""What the paper's methods are fitted to: observed drift, means and weights."""

import numpy as np
import pytest

from wrist_ft_comp.fit.pls import OBSERVATION_WINDOW_S, observe_drift

CELLS = 400
LOAD = 30 * np.random.default_rng(0).standard_normal(CELLS)


class TestObservedDrift:
    @pytest.fixture
    def observe(self, make_axis_data):
        """Observe the drift of a raw wrench beside a load, over a rise from 20 to 40 °C."""

        def make(raw, load=None):
            loads = None if load is None else [load]
            folds = [np.zeros(CELLS, dtype=np.int64)]
            rise_c = np.linspace(20, 40, CELLS)
            return observe_drift(make_axis_data([rise_c], [raw], loads, folds=folds))[0]

        return make

    def test_windows_do_not_cross_gaps(self, observe):
        """Drift jumps in the gap, which lies inside what would be one window."""
        cells = round(OBSERVATION_WINDOW_S / 10.0)
        before, after = slice(0, cells // 2), slice(cells // 2 + 10, None)
        sensitivity, zero, gap = np.full(CELLS, 0.02), np.full(CELLS, 3.0), np.zeros(CELLS)
        sensitivity[after], zero[after] = -0.03, -5.0
        gap[before.stop : after.start] = np.nan
        observed = observe((1 + sensitivity) * LOAD + zero + gap, LOAD)
        seen = np.isfinite(observed).all(axis=1)
        assert (~seen).sum() <= 10 + 10  # the gap, and at most a last window of few cells
        np.testing.assert_allclose(observed[seen, 0], zero[seen], atol=1e-9)
        np.testing.assert_allclose(observed[seen, 1], sensitivity[seen], atol=1e-12)
        assert {0.02, -0.03} == set(np.round(observed[seen, 1], 9))

    def test_windows_without_load_are_not_observed(self, observe):
        quiet = LOAD.copy()
        quiet[120:180] = 5.0
        observed = observe(1.1 * quiet, quiet)
        np.testing.assert_array_equal(np.isnan(observed[:, 1]), (quiet != LOAD))
