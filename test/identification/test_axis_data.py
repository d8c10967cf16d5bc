"""What is fitted: residuals, loads, blocks, and drift observed directly."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from wrist_ft_comp.calibration.cross_validation import fold_errors, unexplained
from wrist_ft_comp.identification.axis_data import assign_folds, build_axis_data
from wrist_ft_comp.identification.pls_arx import OBSERVATION_WINDOW_S, observe_drift
from wrist_ft_comp.model.arx import relaxation
from wrist_ft_comp.model.arx_pls import ArxPls
from wrist_ft_comp.model.axis_model import AxisModel
from wrist_ft_comp.model.features import Features
from wrist_ft_comp.model.signals import noise_level, Recording, stretches

Array = np.ndarray
MakeRecording = Callable[..., Recording]
CELLS = 240


@pytest.fixture(scope='module')
def load() -> Array:
    return 30 * np.random.default_rng(0).standard_normal(CELLS)


@pytest.fixture(scope='module')
def temperature_c() -> Array:
    return np.linspace(20, 40, CELLS)


def one_block(recording: Recording) -> list[Array]:
    return [np.zeros(len(recording), dtype=np.int64)]


class TestResidualAndLoad:
    @pytest.mark.parametrize('reference', ['unloaded', 'constant'])
    def test_without_a_reference_the_raw_wrench_is_the_residual(
        self, make_recording: MakeRecording, temperature_c: Array, load: Array, reference: str
    ) -> None:
        recording = make_recording(temperature_c, {'force_y': load}, {'force_y': load})
        problem = build_axis_data([recording], 'force_y', reference, one_block(recording))
        np.testing.assert_array_equal(problem.residual[0], load)
        assert problem.load is None
        assert problem.no_sensitivity == f'the reference was declared {reference}'
        assert problem.period_s == 10.0

    def test_with_a_reference_it_is_taken_off(
        self, make_recording: MakeRecording, temperature_c: Array, load: Array
    ) -> None:
        raw = 1.02 * load + 5
        raw[7] = np.nan
        recording = make_recording(temperature_c, {'force_y': raw}, {'force_y': load})
        problem = build_axis_data([recording], 'force_y', 'recorded', one_block(recording))
        np.testing.assert_allclose(problem.residual[0], 0.02 * load + 5 + 0 * raw, atol=1e-12)
        assert problem.load is not None
        assert problem.no_sensitivity == ''
        assert problem.samples == CELLS - 1

    @pytest.mark.parametrize('gain_error', [-0.5, 0.0, 0.3, 4.0])
    def test_a_gain_error_is_not_mistaken_for_noise(
        self, make_recording: MakeRecording, temperature_c: Array, load: Array, gain_error: float
    ) -> None:
        raw = (1 + gain_error) * load + 0.1 * np.random.default_rng(1).standard_normal(CELLS)
        recording = make_recording(temperature_c, {'force_y': raw}, {'force_y': load})
        problem = build_axis_data([recording], 'force_y', 'recorded', one_block(recording))
        assert problem.no_sensitivity == ''

    def test_a_load_that_hardly_varies_teaches_no_sensitivity(
        self, make_recording: MakeRecording, temperature_c: Array, load: Array
    ) -> None:
        noise = np.random.default_rng(1).standard_normal(CELLS)
        for share, why in ((1 / 30, 'less than 10 times the noise'), (0.0, 'varied by 0')):
            recording = make_recording(
                temperature_c, {'force_y': share * load + noise}, {'force_y': share * load}
            )
            problem = build_axis_data([recording], 'force_y', 'recorded', one_block(recording))
            assert problem.load is None
            assert why in problem.no_sensitivity

    def test_an_axis_without_reference_teaches_nothing(
        self, make_recording: MakeRecording, temperature_c: Array, load: Array
    ) -> None:
        recording = make_recording(temperature_c, {'force_y': load}, {'force_x': load})
        problem = build_axis_data([recording], 'force_y', 'recorded', one_block(recording))
        assert problem.no_sensitivity == 'no reference wrench was recorded for this axis'
        assert problem.samples == 0


class TestNoise:
    def test_it_is_found_under_a_trend_steps_and_gaps(self) -> None:
        rng = np.random.default_rng(2)
        series = []
        for offset in (0.0, 1e3):
            values = offset + np.linspace(0, 50, 4000) + 0.3 * rng.standard_normal(4000)
            values[1000:] += 40
            values[rng.uniform(size=4000) < 0.2] = np.nan
            series.append(values)
        assert noise_level(series) == pytest.approx(0.3, rel=0.1)

    def test_nothing_has_no_noise(self) -> None:
        assert noise_level([np.full(5, np.nan), np.array([1.0])]) == 0.0


class TestBlocks:
    def test_stretches_are_cut_at_gaps(self) -> None:
        present = np.zeros(100, dtype=bool)
        present[0:20:2] = present[60:70:2] = present[95:] = True
        found = stretches(present, period_s=10.0)
        np.testing.assert_array_equal(found[present], [0] * 10 + [1] * 5 + [2] * 5)
        assert (np.diff(found) >= 0).all()
        assert found[40] == 0

    @pytest.mark.parametrize('cells', [1, 7, 39, 40, 200, 3600, 30000])
    @pytest.mark.parametrize('period_s', [0.1, 1.0, 10.0, 60.0])
    def test_bins_that_are_judged_are_whole_bins_that_are_fitted(
        self, make_recording: MakeRecording, cells: int, period_s: float
    ) -> None:
        recording = make_recording(np.zeros(cells), {'force_x': 0.0}, period_s=period_s)
        problem = build_axis_data([recording], 'force_x', 'unloaded', one_block(recording))
        fitted, judged = problem.bin_cells
        assert fitted >= 1
        assert judged % fitted == 0
        assert judged * period_s <= max(30.0, period_s)
        assert fitted * period_s <= max(10.0, period_s)
        assert judged == 1 or cells // judged >= 5 * 8

    @pytest.mark.parametrize('present', [np.zeros(5, dtype=bool), np.ones(5, dtype=bool)])
    def test_without_gaps_there_is_one(self, present: Array) -> None:
        np.testing.assert_array_equal(stretches(present, 1.0), np.zeros(5))

    def test_several_recordings_are_held_out_whole(
        self, make_recording: MakeRecording, temperature_c: Array
    ) -> None:
        recordings = [make_recording(temperature_c[:k], {'force_x': 0.0}) for k in (50, 60, 70)]
        blocks = assign_folds(recordings)
        for number, (block, recording) in enumerate(zip(blocks, recordings, strict=True)):
            np.testing.assert_array_equal(block, np.full(len(recording), number))

    def test_one_recording_is_cut_into_equal_times(
        self, make_recording: MakeRecording, temperature_c: Array
    ) -> None:
        (block,) = assign_folds([make_recording(temperature_c, {'force_x': 0.0})])
        np.testing.assert_array_equal(block, np.repeat(range(5), CELLS // 5))

    def test_plateaus_are_held_out_whole(
        self, make_recording: MakeRecording, temperature_c: Array
    ) -> None:
        raw = np.full(CELLS, np.nan)
        for start in (0, 60, 120, 180):
            raw[start : start + 20] = 1.0
        recording = make_recording(temperature_c, {'force_x': raw})
        (block,) = assign_folds([recording])
        np.testing.assert_array_equal(block[np.isfinite(raw)], np.repeat(range(4), 20))

    def test_a_block_that_is_held_out_loses_its_samples_only(
        self, make_recording: MakeRecording, temperature_c: Array, load: Array
    ) -> None:
        recordings = [make_recording(temperature_c, {'force_x': load}) for _ in range(3)]
        blocks = assign_folds(recordings)
        problem = build_axis_data(recordings, 'force_x', 'unloaded', blocks)
        assert problem.fold_numbers == [0, 1, 2]
        part = problem.without(1)
        assert np.isnan(part.residual[1]).all()
        np.testing.assert_array_equal(part.residual[2], load)
        assert part.temperature_c is problem.temperature_c
        assert part.fold_numbers == [0, 2]
        assert np.isfinite(problem.residual[1]).all()


class TestObservedDrift:
    def test_without_load_it_is_the_residual(
        self, make_recording: MakeRecording, temperature_c: Array, load: Array
    ) -> None:
        recording = make_recording(temperature_c, {'force_x': load})
        problem = build_axis_data([recording], 'force_x', 'unloaded', one_block(recording))
        np.testing.assert_array_equal(observe_drift(problem)[0], load[:, np.newaxis])

    def test_windows_do_not_cross_gaps(
        self, make_recording: MakeRecording, temperature_c: Array, load: Array
    ) -> None:
        """Drift jumps in the gap, which lies inside what would be one window."""
        cells = round(OBSERVATION_WINDOW_S / 10.0)
        before, after = slice(0, cells // 2), slice(cells // 2 + 10, None)
        sensitivity, zero, gap = np.full(CELLS, 0.02), np.full(CELLS, 3.0), np.zeros(CELLS)
        sensitivity[after], zero[after] = -0.03, -5.0
        gap[before.stop : after.start] = np.nan
        raw = (1 + sensitivity) * load + zero + gap
        recording = make_recording(temperature_c, {'force_x': raw}, {'force_x': load})
        problem = build_axis_data([recording], 'force_x', 'recorded', one_block(recording))
        (found,) = observe_drift(problem)
        seen = np.isfinite(found).all(axis=1)
        assert (~seen).sum() <= 10 + 2  # the gap, and at most a window of one or two cells
        np.testing.assert_allclose(found[seen, 0], zero[seen], atol=1e-9)
        np.testing.assert_allclose(found[seen, 1], sensitivity[seen], atol=1e-12)
        assert {0.02, -0.03} == set(np.round(found[seen, 1], 9))

    def test_slow_drift_is_followed(
        self, make_recording: MakeRecording, temperature_c: Array, load: Array
    ) -> None:
        theta = temperature_c - 30
        raw = (1 + 1e-3 * theta) * load + 0.2 * theta
        recording = make_recording(temperature_c, {'force_x': raw}, {'force_x': load})
        problem = build_axis_data([recording], 'force_x', 'recorded', one_block(recording))
        (found,) = observe_drift(problem)
        error = found - np.stack((0.2 * theta, 1e-3 * theta), axis=1)
        # A window spans 2.5 K: its slope is at most that far behind, plus what 0.2 N/K leaks.
        assert np.abs(error[:, 1]).max() < 0.2 * 2.5 / 30 / 2
        assert np.sqrt(np.mean(error[:, 0] ** 2)) < 0.2

    def test_windows_without_load_are_not_observed(
        self, make_recording: MakeRecording, temperature_c: Array, load: Array
    ) -> None:
        quiet = load.copy()
        quiet[120:180] = 5.0
        recording = make_recording(temperature_c, {'force_x': 1.1 * quiet}, {'force_x': quiet})
        problem = build_axis_data([recording], 'force_x', 'recorded', one_block(recording))
        (found,) = observe_drift(problem)
        np.testing.assert_array_equal(np.isnan(found[:, 1]), (load != quiet))


class TestScores:
    def test_what_a_model_leaves_is_the_measurement_minus_its_free_run(
        self,
        make_recording: MakeRecording,
        lagged: Callable[..., Array],
        temperature_c: Array,
        load: Array,
    ) -> None:
        dynamics = ArxPls(
            np.zeros(1), np.ones(1), np.ones((1, 1)), (relaxation(300.0, 10.0),),
            np.array([[0.5], [2e-3]]), np.ones(2), np.array([0.0, 0.01]),
        )  # fmt: skip
        features = Features('powers', np.array([20.0]), np.zeros(1), np.full(1, 99.0))
        noise = np.random.default_rng(4).standard_normal(CELLS)
        moved = lagged(temperature_c - 20, 300.0)
        raw = (1 + 0.01 + 2e-3 * moved) * load + 0.5 * moved + noise
        recording = make_recording(temperature_c, {'force_x': raw}, {'force_x': load})
        problem = build_axis_data([recording], 'force_x', 'recorded', one_block(recording))
        model = AxisModel(features, dynamics)
        np.testing.assert_allclose(unexplained(problem, model)[0], noise, atol=1e-9)
        np.testing.assert_array_equal(unexplained(problem, None)[0], problem.residual[0])
        zero_drift_only = replace(
            dynamics,
            output_loadings=np.array([[0.5]]),
            output_weight=np.ones(1),
            output_mean=np.zeros(1),
        )
        without = AxisModel(features, zero_drift_only)
        np.testing.assert_allclose(
            unexplained(problem, without)[0], noise + (0.01 + 2e-3 * moved) * load, atol=1e-9
        )

    @pytest.mark.parametrize('tared', [True, False])
    def test_a_block_is_scored_in_parts_around_a_constant_per_recording(
        self, make_recording: MakeRecording, temperature_c: Array, tared: bool
    ) -> None:
        """Of means over 30 s; plateaus, which are not tared, around the mean of all else."""
        recordings = [make_recording(temperature_c, {'force_x': 0.0}) for _ in range(2)]
        rng = np.random.default_rng(5)
        blocks = [rng.integers(0, 3, CELLS) for _ in range(2)]
        problem = replace(build_axis_data(recordings, 'force_x', 'unloaded', blocks), tared=tared)
        left = [rng.standard_normal(CELLS) + 100 * i for i in range(2)]
        left[0][::7] = np.nan
        for block in range(3):
            expected = []
            for numbers, values in zip(blocks, left, strict=True):
                bins: dict[int, list[float]] = {}
                others = []
                for cell, (n, v) in enumerate(zip(numbers, values, strict=True)):
                    if n == block and np.isfinite(v):
                        bins.setdefault(cell // 3, []).append(v)
                    elif np.isfinite(v):
                        others.append(v)
                inside = [sum(each) / len(each) for each in bins.values()]
                constant = np.mean(inside if tared else others)
                parts = np.array_split(inside, 4)
                expected += [np.mean([(v - constant) ** 2 for v in part]) for part in parts]
            assert fold_errors(problem, left, block) == pytest.approx(expected)

    def test_fewer_bins_than_parts_are_scored_one_by_one(
        self, make_recording: MakeRecording, temperature_c: Array
    ) -> None:
        recording = make_recording(temperature_c, {'force_x': 0.0})
        problem = build_axis_data([recording], 'force_x', 'unloaded', one_block(recording))
        left = np.full(CELLS, np.nan)
        left[[0, 1, 90]] = 1.0, 3.0, 6.0
        assert fold_errors(problem, [left], 0) == [4.0, 4.0]
        assert fold_errors(problem, [np.full(CELLS, np.nan)], 0) == []
