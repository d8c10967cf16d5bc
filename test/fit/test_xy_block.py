"""What the paper's methods are fitted to: observed drift, means and weights."""

import numpy as np
import pytest

from wrist_ft_comp.fit.xy_block import OBSERVATION_WINDOW_S, observe_drift, XyBlock

CELLS = 400
LOAD = 30 * np.random.default_rng(0).standard_normal(CELLS)


def test_blocks_are_centred_by_recording_and_scaled_by_their_deviation():
    rng = np.random.default_rng(1)
    inputs = tuple(rng.standard_normal((50, 3)) * [1.0, 40.0, 0.0] + 7.0 for _ in range(2))
    outputs = tuple(rng.standard_normal((50, 2)) * [1e-3, 5.0] + 100.0 * i for i in range(2))
    outputs[0][10, 1] = np.nan
    block = XyBlock(inputs, outputs)
    assert block.x.shape == (99, 3)
    for part in (slice(49), slice(49, None)):
        np.testing.assert_allclose(block.x[part].mean(axis=0), 0, atol=1e-9)
        np.testing.assert_allclose(block.y[part].mean(axis=0), 0, atol=1e-9)
    np.testing.assert_allclose(block.y.std(axis=0), 1)
    assert block.input_weight[2] == 0, 'a constant input has no weight'
    held_out = block.without((np.repeat([0, 1], 25), np.repeat([2, 3], 25)), 2)
    assert held_out.valid[1].tolist() == [False] * 25 + [True] * 25
    assert held_out.valid[0].sum() == 49
    assert np.isfinite(outputs[1]).all(), 'the block itself stays'


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

    def test_without_load_the_observed_drift_is_the_residual(self, observe):
        np.testing.assert_array_equal(observe(LOAD), LOAD[:, np.newaxis])

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

    def test_slow_drift_is_followed(self, observe):
        theta = np.linspace(-10, 10, CELLS)
        error = observe((1 + 1e-3 * theta) * LOAD + 0.2 * theta, LOAD)
        error -= np.stack((0.2 * theta, 1e-3 * theta), axis=1)
        # A window spans 1.5 K: its slope is at most that far behind, plus what 0.2 N/K leaks.
        assert np.nanmax(np.abs(error[:, 1])) < 0.2 * 1.5 / 30 / 2
        assert np.sqrt(np.nanmean(error[:, 0] ** 2)) < 0.2

    def test_windows_without_load_are_not_observed(self, observe):
        quiet = LOAD.copy()
        quiet[120:180] = 5.0
        observed = observe(1.1 * quiet, quiet)
        np.testing.assert_array_equal(np.isnan(observed[:, 1]), (quiet != LOAD))
