"""Sums over bins: nothing that least squares asks for is lost."""

import numpy as np
import pytest

from wrist_ft_comp.drift.arx import free_run, relaxation
from wrist_ft_comp.fit.bins import bin_axis_data

WIDTH = 10
#: With a last bin of 4 cells.
CELLS = 24 * WIDTH + 4


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
            there = [k for k in cells if np.isfinite(problem.residual[i][k])]
            y = [problem.residual[i][k] for k in there]
            w = [0.0 if problem.load is None else problem.load[i][k] for k in there]
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
