"""Method ``auto``: what it finds and leaves alone; its sums and fits, written out row by row."""

from dataclasses import replace

import numpy as np
import pytest

from wrist_ft_comp.fit import auto_method as ridges
from wrist_ft_comp.fit.result import HeldOut, rms_by_fold
from wrist_ft_comp.fit.settings import IdentificationSettings

CELLS = 300
LINE = IdentificationSettings(degree=1)
HIGHEST = 3
#: Steps of three recordings, in cells.
NONE, STEPPED = ((), (), ()), ((40,), (), (70, 71, 120))


@pytest.fixture
def pose(simulate, axis_data):
    """Pose an axis: drift in N/K behind a lag of 300 s, in recordings from a seed on."""

    def make(gain, *, days=2, seed=0, noise=0.01, **more):
        known = {'cells': CELLS, 'noise': noise, **more}
        recordings = [simulate(seed + i, {300.0: gain}, **known) for i in range(days)]
        return axis_data(recordings, 'recorded' if more else 'unloaded')

    return make


def run(model, temperature_c):
    return model.run(model.start(temperature_c[0]), temperature_c)[1]


class TestWhatIsFound:
    def test_an_axis_that_never_changes_has_a_drift_of_0(self, pose):
        still = pose(0.0, noise=0.0)
        still = replace(still, residual=tuple(r + 0.1 for r in still.residual))  # no sum is exact
        single = ridges.identify_auto(still, LINE)
        assert (single.chosen, single.rms_before, single.rms_after) == ('none', 0.0, 0.0)

    def test_a_day_that_drifts_much_decides_what_another_day_is_expected_to_keep(self, pose):
        made = pose(0.5, days=3)
        unseen = 2.0 * np.sin(np.arange(CELLS) / 15)
        calm = [0.2 * residual for residual in made.residual[:2]]
        unequal = replace(made, residual=(*calm, made.residual[2] + unseen))
        single = ridges.identify_auto(unequal, IdentificationSettings())
        kept = rms_by_fold(single.held_out).after
        assert kept[2] > 1.2
        assert 0.7 * kept[2] < single.expected_rms < 1.1 * kept[2]
        assert single.expected_rms > 1.1 * single.rms_after

    def test_a_day_under_one_load_beside_one_at_work_leaves_no_axis_alone(
        self, make_axis_data, warm_up
    ):
        """Fitted to that day alone, gain drift would predict the other day wildly."""
        rng, temperatures = np.random.default_rng(0), [warm_up(CELLS, 1), warm_up(CELLS, 2)]
        loads = [14 * rng.uniform(-1, 1, CELLS), 14 + 0.03 * rng.standard_normal(CELLS)]
        raws = [
            w + (0.4 + 1e-3 * w) * (c - 20) + 0.05 * rng.standard_normal(CELLS)
            for w, c in zip(loads, temperatures, strict=True)
        ]
        single = ridges.identify_auto(make_axis_data(temperatures, raws, loads), LINE)
        assert single.chosen == ridges.COMBINATION
        assert single.model.outputs == 2
        assert rms_by_fold(single.held_out).after.max() < 0.3

    def test_gain_drift_is_learnt_of_weights_that_differ_between_days(
        self, make_axis_data, warm_up
    ):
        temperatures = [warm_up(CELLS, seed) for seed in range(3)]
        loads = [np.full(CELLS, 50.0 * n) for n in range(3)]
        raws = [w + (0.4 + 1e-3 * w) * (c - 20) for w, c in zip(loads, temperatures, strict=True)]
        single = ridges.identify_auto(make_axis_data(temperatures, raws, loads), LINE)
        gains = np.diff(run(single.model, np.array([[30.0], [40.0]])), axis=0)
        np.testing.assert_allclose(gains, [[4.0, 0.01]], rtol=0.1)

    def test_an_idle_hour_beside_warm_ups_leaves_no_axis_alone(self, make_axis_data, warm_up):
        rng = np.random.default_rng(0)
        temperatures = [warm_up(CELLS, 1), warm_up(CELLS, 2), 20 + rng.normal(0, 0.2, CELLS)]
        drifts = [0.4 * temperatures[0], 0.4 * temperatures[1], np.zeros(CELLS)]
        raws = [drift + rng.normal(0, 0.02, CELLS) for drift in drifts]
        single = ridges.identify_auto(make_axis_data(temperatures, raws), LINE)
        before, after = rms_by_fold(single.held_out)
        assert after[2] > ridges.HARMFUL_FOLD * before[2]  # it follows the thermometer's noise
        assert after.max() < 0.1 * before.max()

    def test_a_single_lag_is_found_by_fits_with_memory(self, pose):
        single = ridges.identify_auto(pose(0.5, days=3), IdentificationSettings())
        assert single.chosen == ridges.COMBINATION
        assert single.rms_after < 1.3 * 0.01
        assert single.rms_before > 100 * single.rms_after
        weights = {fit.name: fit.weight for fit in single.candidates}
        assert sum(weights.values()) == pytest.approx(1.0)
        assert max(weights, key=weights.get) == 'bank to 3000 s, degree 1'

    def test_of_noise_next_to_nothing_is_learnt(self, pose):
        fits = []
        for seed, days in enumerate((1, 2, 1, 2)):
            problem = pose(0.0, days=days, noise=1.0, seed=seed)
            fits.append(ridges.identify_auto(problem, IdentificationSettings()))
        none = [fit for fit in fits if fit.model is None]
        assert len(none) >= 3
        for fit in none:
            assert (fit.chosen, fit.candidates[0].weight) == ('none', 1)
        assert all(0.95 < fit.rms_after / fit.rms_before <= 1 for fit in fits)


def test_the_model_is_anchored_at_rest(pose):
    loaded = ridges.identify_auto(pose(0.5, sensitivity={300.0: 1e-3}, gain_error=0.02), LINE)
    plain = ridges.identify_auto(pose(-1.0, seed=1), LINE)
    for fit in (loaded, plain):
        at_rest = run(fit.model, fit.model.reference_c[np.newaxis])[0]
        assert at_rest[0] == pytest.approx(0.0, abs=1e-12)
    gain_error = run(loaded.model, loaded.model.reference_c[np.newaxis])[0, 1]
    drift_at_rest = 1e-3 * (loaded.model.reference_c[0] - 30)
    assert gain_error == pytest.approx(0.02 + drift_at_rest, abs=3e-3)


class TestWeights:
    @staticmethod
    def weigh(*left):
        """Weigh fits that leave some RMS of every fold, where no compensation leaves 1."""
        errors = np.tile([1.0, *left], (40, 1)) * np.where(np.arange(40) % 2, 1, -1)[:, np.newaxis]
        fold = np.repeat([0, 1, 2], 40)
        held = HeldOut(0 * fold, fold, 1.0 * fold, np.tile(errors, (3, 1)), 10.0, tared=True)
        return ridges.weigh(held, [np.array([1.0, *left]) ** 2] * 3)

    def test_a_weight_falls_with_the_eighth_power_of_what_is_left(self):
        none, *weights = self.weigh(0.5, 0.25)
        assert none == 0
        assert weights[1] / weights[0] == pytest.approx(2.0**8)
        assert sum(weights) == pytest.approx(1.0)

    @pytest.mark.parametrize(('left', 'runs'), [(1.1, False), (0.99, False), (0.97, True)])
    def test_what_hardly_gains_is_not_run(self, left, runs):
        np.testing.assert_array_equal(self.weigh(left), [1 - runs, runs])


@pytest.fixture(scope='module', params=[False, True], ids=['unloaded', 'loaded'])
def problem(request, simulate, axis_data):
    """Three recordings with gaps, offsets and much noise, so that no fit is perfect."""
    rng, known = np.random.default_rng(0), {'noise': 2.0}
    if request.param:
        known['sensitivity'] = {300.0: 1e-3}
    recordings = [simulate(i, {300.0: 0.4}, cells=150 + 20 * i, **known) for i in range(3)]
    for recording in recordings:
        recording.wrench[rng.uniform(size=len(recording)) < 0.1] = np.nan
    return axis_data(recordings, 'recorded' if request.param else 'unloaded')


@pytest.fixture(scope='module')
def columns(problem, lagged):
    """Relax temperatures by the textbook loop, then take powers of T - 30 °C; by recording."""
    powers, all_columns = range(1, HIGHEST + 1), []
    for own_c in problem.temperature_c:
        relaxed = [lagged(own_c[:, 0], tau) if tau else own_c[:, 0] for tau in ridges.POOL_S]
        all_columns.append(np.stack([(t - 30) ** n for t in relaxed for n in powers], axis=1))
    return all_columns


def stacked(problem, columns, kept, steps=NONE):
    """Stack columns, with load w x and w, and r - w of some folds, centred by segment."""
    rows, segments = [], []
    for i, of_recording in enumerate(columns):
        for k, value in enumerate(problem.residual[i]):
            if np.isnan(value) or problem.folds[i][k] not in kept:
                continue
            x = np.insert(of_recording[k], 0, 1.0)
            if problem.load is not None:
                x = np.concatenate((x, problem.load[i][k] * x))
            rows.append(np.append(x, value))
            segments.append((i, sum(k >= step for step in steps[i])))
    rows, segments = np.array(rows), np.array(segments)
    for segment in np.unique(segments, axis=0):
        inside = (segments == segment).all(axis=1)
        rows[inside] -= rows[inside].mean(axis=0)
    return rows


def test_there_are_ten_for_each_degree_and_the_simplest_comes_first():
    fits = ridges.candidates(HIGHEST)
    assert len(set(fits)) == 30
    assert fits[0].name == 'static, degree 1'
    assert [fit.degree for fit in fits] == [1] * 10 + [2] * 10 + [3] * 10
    assert {fit.bank_s for fit in fits} == {(0.0,), *ridges.BANKS_S.values()}


def test_relaxations_last_no_longer_than_a_third_of_the_longest_recording():
    assert max(max(fit.bank_s) for fit in ridges.candidates(HIGHEST, 1200.0)) == 300.0


@pytest.mark.parametrize('candidate', ridges.candidates(HIGHEST)[::3], ids=str)
def test_ridge_is_least_squares_with_a_row_per_penalty(problem, columns, candidate):
    """Ten times the penalty with every power; the load and its products count as first powers."""
    everything = stacked(problem, columns, {0, 1, 2})
    x, y = everything[:, :-1], everything[:, -1]
    pool_s = ridges.POOL_S.tolist()
    places = [1 + HIGHEST * pool_s.index(tau) for tau in candidate.bank_s]
    zero = [k + power for k in places for power in range(candidate.degree)]
    half = 1 + HIGHEST * len(ridges.POOL_S)
    gain = [half, *(half + k for k in places)] if problem.load is not None else []
    used = [*zero, *gain]
    powers = np.array([1 + (k - 1) % HIGHEST for k in zero] + [1] * (len(used) - len(zero)))
    penalty = np.sqrt(candidate.strength * ridges.DEGREE_PENALTY ** (powers - 1.0))
    rows = np.diag(penalty * np.linalg.norm(x[:, used], axis=0))
    target = np.concatenate((y, np.zeros(len(used))))
    expected = np.zeros(x.shape[1] + 1)
    expected[used] = np.linalg.lstsq(np.concatenate((x[:, used], rows)), target, rcond=None)[0]
    expected[-1] = -1.0
    found = ridges.fit_ridge(candidate, HIGHEST, 1, everything.T @ everything)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-9)


def test_a_last_bin_that_is_not_full_keeps_its_own_mean_temperature(make_axis_data):
    data = make_axis_data([np.arange(25.0)], [np.zeros(25)], period_s=1.0)
    binned = ridges.bin_axis_data(data, 10)
    np.testing.assert_allclose(binned.temperature_c[0][:, 0], [4.5, 14.5, 22.0])
    np.testing.assert_array_equal(binned.moments[0][:, 0, 0], [10, 10, 5])


@pytest.mark.parametrize('kept', [{0, 1, 2}, {0, 2}, {1}])
@pytest.mark.parametrize('steps', [NONE, STEPPED], ids=['', 'stepped'])
def test_products_are_those_of_columns_that_are_centred_by_segment(problem, columns, kept, steps):
    """A tare within a recording begins a segment with a constant of its own."""
    sums = ridges.sum_by_fold(ridges.bin_axis_data(replace(problem, steps=steps), 1), columns)
    expected = stacked(problem, columns, kept, steps)
    products = sums.centred(np.isin(sums.fold, [*kept]))
    size = np.abs(expected).max(axis=0) + 1
    atol = 1e-8 * np.outer(size, size)
    np.testing.assert_array_less(np.abs(products - expected.T @ expected), atol)


def test_a_column_that_only_differs_between_recordings_holds_nothing(make_axis_data, warm_up):
    """A room thermometer that read 21.3, 24.7 and 22.9 °C explains nothing within a run."""
    temperatures = [
        np.stack([warm_up(150, i), np.full(150, room_c)], axis=1)
        for i, room_c in enumerate((21.3, 24.7, 22.9))
    ]
    cells = ridges.bin_axis_data(make_axis_data(temperatures, [t[:, 0] for t in temperatures]), 1)
    sums = ridges.sum_by_fold(cells, cells.temperature_c)
    products = sums.centred(sums.fold >= 0)
    assert not products[2].any()
    assert not products[:, 2].any()
    assert (np.diagonal(products)[[1, 3]] > 1).all()
