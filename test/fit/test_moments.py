"""Sums over samples: over bins, the columns they are of, and what no temperature explains."""

from dataclasses import replace

import numpy as np
import pytest

from wrist_ft_comp.drift.arx_filter import free_run, relaxation
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.axis_data import assign_folds, build_axis_data
from wrist_ft_comp.fit.column_pool import least_squares
from wrist_ft_comp.fit.moments import accumulate, bank_inputs, bin_axis_data

WIDTH = 10
#: With a last bin of 4 cells.
CELLS = 24 * WIDTH + 4
FEATURES = Features('powers', np.array([30.0]), np.zeros(1), np.full(1, 99.0), degree=2)
STATIC = np.zeros(1)
GRID = np.array([0.0, 50.0, 150.0, 400.0, 1200.0])


@pytest.fixture(scope='module', params=['unloaded', 'recorded'])
def problem(request, make_axis_data):
    """Temperatures that hold for 10 cells of 1 s, loads that change in every one, and gaps."""
    rng = np.random.default_rng(0)
    temperatures, raws, loads, folds = [], [], [], []
    for i in range(2):
        temperature_c = np.repeat(rng.uniform(20, 40, CELLS // WIDTH + 1), WIDTH)[:CELLS]
        load = 30 * rng.standard_normal(CELLS)
        raw = (1 + 1e-3 * temperature_c) * load + 0.5 * temperature_c + rng.standard_normal(CELLS)
        raw[rng.uniform(size=CELLS) < 0.1] = np.nan
        raw[3 * WIDTH : 4 * WIDTH] = np.nan
        temperatures.append(temperature_c)
        raws.append(raw)
        loads.append(load)
        folds.append(np.arange(CELLS) // (8 * WIDTH) + i)
    loads = loads if request.param == 'recorded' else None
    return make_axis_data(temperatures, raws, loads, folds=folds, period_s=1.0)


def test_every_sum_is_the_textbook_loop(problem):
    binned = bin_axis_data(problem, WIDTH)
    for i, sums in enumerate(binned.sums):
        for n in range(CELLS // WIDTH + 1):
            cells = range(n * WIDTH, min((n + 1) * WIDTH, CELLS))
            present = [k for k in cells if np.isfinite(problem.residual[i][k])]
            y = [problem.residual[i][k] for k in present]
            w = [0.0 if problem.load is None else problem.load[i][k] for k in present]
            expected = {
                'count': len(y),
                'load': sum(w),
                'load_square': sum(a * a for a in w),
                'residual': sum(y),
                'residual_square': sum(b * b for b in y),
                'product': sum(a * b for a, b in zip(w, y, strict=True)),
            }
            sums_of_bin = {name: getattr(sums, name)[n] for name in expected}
            assert sums_of_bin == pytest.approx(expected, rel=1e-12, abs=1e-9)


def test_a_last_bin_that_is_not_full_keeps_its_own_mean_temperature(make_axis_data):
    binned = bin_axis_data(make_axis_data([np.arange(25.0)], [np.zeros(25)], period_s=1.0), 10)
    np.testing.assert_allclose(binned.temperature_c[0][:, 0], [4.5, 14.5, 22.0])
    np.testing.assert_array_equal(binned.sums[0].count, [10, 10, 5])
    assert binned.period_s == 10.0


@pytest.mark.parametrize('tau', [3.0, 25.0, 400.0])
def test_a_bin_holds_the_mean_of_a_relaxation_and_a_cell_its_end(problem, tau):
    """Against the cells of every bin, one by one."""
    binned = bin_axis_data(problem, WIDTH)
    temperature_c = np.random.default_rng(1).uniform(20, 40, 30)
    state, means = temperature_c[0], []
    for t in temperature_c:
        cells = []
        for _ in range(WIDTH):
            state = t + (state - t) * np.exp(-1.0 / tau)
            cells.append(state)
        means.append(np.mean(cells))
    np.testing.assert_allclose(free_run(binned.relaxation(tau), temperature_c), means, atol=1e-10)
    at_end = bin_axis_data(problem, 1).relaxation(tau)
    np.testing.assert_array_equal(at_end.b, relaxation(tau, 1.0).b)
    assert binned.relaxation(tau).gain == pytest.approx(1.0, abs=1e-12)
    for static in (binned.relaxation(0.0), bin_axis_data(problem, 1).relaxation(0.0)):
        assert (len(static.a), static.b.tolist(), static.first_lag) == (0, [1.0], 0)


def moments_of(problem, grid=GRID):
    cells = bin_axis_data(problem, 1)
    return accumulate(cells, bank_inputs(cells, FEATURES, grid), len(grid))


@pytest.mark.parametrize('kept', [{0, 1, 2}, {0, 2}, {1}])
@pytest.mark.parametrize('kind', ['tared', 'soaked', 'plateaus'])
def test_products_are_those_of_generalised_least_squares(  # noqa: PLR0913, PLR0917
    noisy_problem, textbook_bank, stack_samples, whiten, kept, kind
):
    """Plateaus of a chamber test share one constant, and nothing else is a nuisance."""
    problem = replace(noisy_problem, tared=kind != 'plateaus')
    precision = bin_axis_data(problem, 1).nuisance_precision(soaked=kind == 'soaked')
    moments = replace(moments_of(problem), precision=precision)
    x, y, places = stack_samples(problem, textbook_bank(problem, GRID), kept)
    both = whiten(np.column_stack((x, y)), places, problem, soaked=kind == 'soaked')
    products = moments.centred(np.isin(range(3), [*kept]))
    np.testing.assert_allclose(products, both.T @ both, rtol=1e-8, atol=1e-6)


def test_columns_are_numbered_by_relaxation_then_feature(noisy_problem):
    moments = moments_of(noisy_problem)
    zero = [1 * 2, 3 * 2]
    expected = zero if noisy_problem.load is None else [*zero, 10 + 2, 10 + 6, 20]
    np.testing.assert_array_equal(moments.columns([1, 3], 1, 1), expected)


class TestNuisances:
    @pytest.fixture
    def still(self, make_axis_data):
        """Pose what is left of values when nothing but nuisances explains them."""

        def left(values, steps=(), **more):
            data = make_axis_data([np.full(400, 30.0)], [values])
            cells = bin_axis_data(replace(data, steps=(steps,)), 1)
            moments = accumulate(cells, bank_inputs(cells, FEATURES, STATIC), 1)
            moments = replace(moments, precision=cells.nuisance_precision(**more))
            return moments.centred()[-1, -1] / np.sum((values - values.mean()) ** 2)

        return left

    def test_cosines_are_a_random_walk(self, make_axis_data):
        """Its steps have a variance that grows as the time between them."""
        cells = bin_axis_data(make_axis_data([np.zeros(400)], [np.zeros(400)]), 1)
        cosines = cells.nuisances(0)[:, 1:17] / np.sqrt(cells.nuisance_precision()[1:17])
        for lag in (60, 100, 200, 300):
            steps = cosines[lag:] - cosines[:-lag]
            variance = (steps**2).sum(axis=1).mean()
            assert variance / (lag / 400) == pytest.approx(np.pi**2 / 2, rel=0.1)

    @pytest.mark.parametrize('tau', [300.0, 700.0, 2500.0])
    def test_a_start_that_was_not_soaked_is_no_drift_unless_it_was(self, still, tau):
        transient = np.exp(-10.0 * np.arange(400) / tau)
        assert still(transient) < 0.4 * still(transient, soaked=True)

    def test_a_constant_begins_anew_after_every_step(self, still):
        stepped = np.repeat([0.0, 7.0, -3.0], [150, 100, 150])
        assert still(stepped, steps=(150, 250)) < 1e-6
        assert still(stepped, steps=(250,)) > 0.01


def test_a_column_that_only_differs_between_recordings_holds_nothing(make_recording, warm_up):
    """A room thermometer that read 21.3, 24.7 and 22.9 °C explains nothing within a run."""
    recordings = []
    for i, room in enumerate((21.3, 24.7, 22.9)):
        temperature_c = np.stack([warm_up(150, i), np.full(150, room)], axis=1)
        raw = 0.5 * temperature_c[:, 0] + 7.0 * i
        recordings.append(make_recording(temperature_c, {'force_z': raw}))
    problem = build_axis_data(recordings, 'force_z', 'unloaded', assign_folds(recordings))
    features = Features('powers', np.full(2, 23.0), np.zeros(2), np.full(2, 99.0))
    taus = np.array([0.0, 300.0])
    cells = bin_axis_data(problem, 1)
    moments = accumulate(cells, bank_inputs(cells, features, taus), len(taus))
    products = moments.centred(np.ones(3, dtype=bool))
    room = [1, 3]
    assert not products[room].any()
    assert not products[:, room].any()
    assert (np.diagonal(products)[[0, 2, 4]] > 1).all()
    gains = least_squares(products)[0]
    np.testing.assert_array_equal(gains[room], 0.0)
    np.testing.assert_allclose(gains[[0, 2]].sum(), 0.5, rtol=1e-4)
