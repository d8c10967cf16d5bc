"""The sums that ``auto`` is fitted to, and its ridge fits, written out row by row."""

from dataclasses import replace

import numpy as np
import pytest

from wrist_ft_comp.fit import ridge_average as ridges
from wrist_ft_comp.fit.ridge_average import bin_axis_data, candidates, POOL_S, sum_by_fold

HIGHEST = 3
#: Steps of three recordings, in cells.
NONE, STEPPED = ((), (), ()), ((40,), (), (70, 71, 120))


@pytest.fixture(scope='module', params=[False, True], ids=['unloaded', 'loaded'])
def problem(request, make_axis_data, warm_up):
    """Three recordings with gaps, offsets and much noise, so that no fit is perfect."""
    rng = np.random.default_rng(0)
    temperatures, raws, loads = [warm_up(150 + 20 * i, i) for i in range(3)], [], []
    for i, temperature_c in enumerate(temperatures):
        load = 30 * rng.standard_normal(len(temperature_c))
        raw = 0.4 * temperature_c + 2 * rng.standard_normal(len(temperature_c)) + 100 * i
        raw += (1 + 1e-3 * temperature_c) * load * request.param
        raw[rng.uniform(size=len(raw)) < 0.1] = np.nan
        raws.append(raw)
        loads.append(load)
    return make_axis_data(temperatures, raws, loads if request.param else None)


@pytest.fixture(scope='module')
def columns(problem, lagged):
    """Relax temperatures by the textbook loop, then take powers of T - 30 °C; by recording."""
    return [
        np.stack(
            [
                ((lagged(own_c[:, 0], tau) if tau else own_c[:, 0]) - 30) ** power
                for tau in POOL_S
                for power in range(1, HIGHEST + 1)
            ],
            axis=1,
        )
        for own_c in problem.temperature_c
    ]


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
    fits = candidates(HIGHEST)
    assert len(set(fits)) == 30
    assert fits[0].name == 'static, degree 1'
    assert [fit.degree for fit in fits] == [1] * 10 + [2] * 10 + [3] * 10
    assert {fit.bank_s for fit in fits} == {(0.0,), *ridges.BANKS_S.values()}


@pytest.mark.parametrize('candidate', candidates(HIGHEST)[::3], ids=str)
def test_ridge_is_least_squares_with_a_row_per_penalty(problem, columns, candidate):
    """Ten times the penalty with every power; the load and its products count as first powers."""
    everything = stacked(problem, columns, {0, 1, 2})
    x, y = everything[:, :-1], everything[:, -1]
    places = [1 + HIGHEST * int(np.flatnonzero(tau == POOL_S)[0]) for tau in candidate.bank_s]
    zero = [k + power for k in places for power in range(candidate.degree)]
    half = 1 + HIGHEST * len(POOL_S)
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
    binned = bin_axis_data(make_axis_data([np.arange(25.0)], [np.zeros(25)], period_s=1.0), 10)
    np.testing.assert_allclose(binned.temperature_c[0][:, 0], [4.5, 14.5, 22.0])
    np.testing.assert_array_equal(binned.moments[0][:, 0, 0], [10, 10, 5])


@pytest.mark.parametrize('kept', [{0, 1, 2}, {0, 2}, {1}])
@pytest.mark.parametrize('steps', [NONE, STEPPED], ids=['', 'stepped'])
def test_products_are_those_of_columns_that_are_centred_by_segment(problem, columns, kept, steps):
    """A tare within a recording begins a segment with a constant of its own."""
    sums = sum_by_fold(bin_axis_data(replace(problem, steps=steps), 1), columns)
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
    cells = bin_axis_data(make_axis_data(temperatures, [t[:, 0] for t in temperatures]), 1)
    sums = sum_by_fold(cells, cells.temperature_c)
    products = sums.centred(sums.fold >= 0)
    assert not products[2].any()
    assert not products[:, 2].any()
    assert (np.diagonal(products)[[1, 3]] > 1).all()
