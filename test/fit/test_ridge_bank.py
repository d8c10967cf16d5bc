"""The candidates of ``auto``, and the sums that they are fitted to, written out row by row."""

from dataclasses import replace

import numpy as np
import pytest

from wrist_ft_comp.drift.arx import free_run
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.axis_data import build_axis_data
from wrist_ft_comp.fit.folds import assign_folds
from wrist_ft_comp.fit.ridge_bank import (
    BANKS_S,
    bin_axis_data,
    candidates,
    DEGREE_PENALTY,
    Pool,
    POOL_S,
    sum_by_fold,
)

HIGHEST = 3


@pytest.fixture(scope='module')
def pooled(noisy_problem, textbook_bank, stack_samples, centre):
    """The pool of a problem with one thermometer, its sums, and all samples in rows."""
    banked = textbook_bank(noisy_problem, POOL_S, HIGHEST)
    sums = sum_by_fold(bin_axis_data(noisy_problem, 1), banked)
    x, y, places = stack_samples(noisy_problem, banked, {0, 1, 2})
    pool = Pool(HIGHEST, 1, noisy_problem.load is not None)
    return pool, sums.centred(sums.fold >= 0), centre(x, places), centre(y, places)


def test_there_are_ten_for_each_degree_and_the_simplest_comes_first():
    fits = candidates(HIGHEST)
    assert len(fits) == 30
    assert len(set(fits)) == 30
    assert fits[0].name == 'static, degree 1'
    assert [fit.degree for fit in fits] == [1] * 10 + [2] * 10 + [3] * 10
    assert {fit.bank_s for fit in fits} == {(0.0,), *BANKS_S.values()}


@pytest.mark.parametrize('candidate', candidates(HIGHEST)[::3], ids=str)
def test_ridge_is_least_squares_with_a_row_per_penalty(pooled, candidate):
    """Ten times the penalty with every power; the load and its products count as first powers."""
    pool, normal, x, y = pooled
    places = [int(np.flatnonzero(tau == POOL_S)[0]) for tau in candidate.bank_s]
    zero = [HIGHEST * k + power for k in places for power in range(candidate.degree)]
    half = HIGHEST * len(POOL_S)
    gain = [half + HIGHEST * k for k in places] if pool.loaded else []
    columns = [*zero, *gain, *([2 * half] if pool.loaded else [])]
    powers = np.array([1 + k % HIGHEST for k in zero] + [1] * (len(columns) - len(zero)))
    penalty = np.sqrt(candidate.strength * DEGREE_PENALTY ** (powers - 1.0))
    rows = np.diag(penalty * np.linalg.norm(x[:, columns], axis=0))
    stacked = np.concatenate((x[:, columns], rows))
    target = np.concatenate((y, np.zeros(len(columns))))
    expected = np.zeros(x.shape[1] + 1)
    expected[columns], expected[-1] = np.linalg.lstsq(stacked, target, rcond=None)[0], -1.0
    np.testing.assert_allclose(pool.fit(candidate, normal), expected, rtol=1e-5, atol=1e-9)


def test_equal_columns_share_their_gain_and_silent_ones_get_none():
    rng = np.random.default_rng(0)
    t, y = rng.standard_normal((2, 60))
    both = np.column_stack([t if tau in {0.0, 20.0, 60.0} else 0 * t for tau in POOL_S] + [y])
    line = candidates(1)[6]
    assert line == ('bank to 60 s, degree 1', (0.0, 20.0, 60.0), 1, 1e-6)
    gains = Pool(1, 1, loaded=False).fit(line, both.T @ both)[:-1]
    np.testing.assert_allclose(gains[np.isin(POOL_S, line.bank_s)], t @ y / (t @ t) / 3, rtol=1e-5)
    assert not gains[~np.isin(POOL_S, line.bank_s)].any()


WIDTH = 10
#: With a last bin of 4 cells.
CELLS = 24 * WIDTH + 4
FEATURES = Features('powers', np.array([30.0]), np.zeros(1), np.full(1, 99.0), degree=2)
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


def textbook_columns(problem, textbook_bank, segments, kept, stack_samples):
    """Stack columns and r - w of some folds, each segment centred by itself."""
    x, y, places = stack_samples(problem, textbook_bank(problem, GRID), kept)
    both = np.column_stack((x, y))
    numbers = np.array([10 * i + np.searchsorted(segments[i], k + 0.5) for i, k in places])
    for number in np.unique(numbers):
        both[numbers == number] -= both[numbers == number].mean(axis=0)
    return both


@pytest.mark.parametrize('kept', [{0, 1, 2}, {0, 2}, {1}])
@pytest.mark.parametrize('steps', [((), (), ()), ((40,), (), (70, 71, 120))], ids=['', 'stepped'])
def test_products_are_those_of_columns_that_are_centred_by_segment(
    noisy_problem, textbook_bank, stack_samples, kept, steps
):
    """A tare within a recording begins a segment with a constant of its own."""
    problem = replace(noisy_problem, steps=steps)
    sums = sum_by_fold(*columns_of(problem))
    expected = textbook_columns(problem, textbook_bank, steps, kept, stack_samples)
    products = sums.centred(np.isin(sums.fold, [*kept]))
    np.testing.assert_allclose(products, expected.T @ expected, rtol=1e-8, atol=1e-6)


def columns_of(problem):
    """Cells of a problem, and the features of its temperatures behind a bank."""
    cells = bin_axis_data(problem, 1)
    lags = [cells.relaxation(tau) for tau in GRID]
    columns = [
        np.concatenate([FEATURES.expand_within(free_run(lag, own_c)) for lag in lags], axis=1)
        for own_c in cells.temperature_c
    ]
    return cells, columns


def test_a_step_between_two_tares_is_no_drift(make_axis_data):
    stepped = np.repeat([0.0, 7.0, -3.0], [150, 100, 150])
    problem = make_axis_data([np.full(400, 30.0)], [stepped])
    for steps, share in (((150, 250), 0.0), ((250, 150), 0.0), ((), 1.0)):
        sums = sum_by_fold(*columns_of(replace(problem, steps=(steps,))))
        left = sums.centred(sums.fold >= 0)[-1, -1]
        assert left == pytest.approx(share * np.sum((stepped - stepped.mean()) ** 2), abs=1e-6)


def test_a_column_that_only_differs_between_recordings_holds_nothing(make_recording, warm_up):
    """A room thermometer that read 21.3, 24.7 and 22.9 °C explains nothing within a run."""
    recordings = []
    for i, room in enumerate((21.3, 24.7, 22.9)):
        temperature_c = np.stack([warm_up(150, i), np.full(150, room)], axis=1)
        raw = 0.5 * temperature_c[:, 0] + 7.0 * i
        recordings.append(make_recording(temperature_c, {'force_z': raw}))
    problem = build_axis_data(recordings, 'force_z', 'unloaded', assign_folds(recordings))
    cells = bin_axis_data(problem, 1)
    sums = sum_by_fold(cells, cells.temperature_c)
    products = sums.centred(sums.fold >= 0)
    assert not products[1].any()
    assert not products[:, 1].any()
    assert (np.diagonal(products)[[0, 2]] > 1).all()
