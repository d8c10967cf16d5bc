"""Sums over bins: nothing that least squares asks for is lost."""

import numpy as np
import pytest

from wrist_ft_comp.identification.axis_data import build_axis_data
from wrist_ft_comp.identification.bins import bin_axis_data
from wrist_ft_comp.identification.moments import accumulate, bank_inputs
from wrist_ft_comp.model.arx import free_run, relaxation
from wrist_ft_comp.model.features import Features

STATIC = np.zeros(1)
WIDTH = 10
#: With a last bin of 4 cells.
CELLS = 24 * WIDTH + 4


@pytest.fixture(scope='module', params=['unloaded', 'recorded'])
def problem(request, make_recording):
    """Temperatures that hold for 10 cells of 1 s, loads that change in every one, and gaps."""
    rng = np.random.default_rng(0)
    recordings, blocks = [], []
    for i in range(2):
        temperature_c = np.repeat(rng.uniform(20, 40, CELLS // WIDTH + 1), WIDTH)[:CELLS]
        load = 30 * rng.standard_normal(CELLS)
        raw = (1 + 1e-3 * temperature_c) * load + 0.5 * temperature_c + rng.standard_normal(CELLS)
        raw[rng.uniform(size=CELLS) < 0.1] = np.nan
        raw[3 * WIDTH : 4 * WIDTH] = np.nan
        recordings.append(
            make_recording(temperature_c, {'force_z': raw}, {'force_z': load}, period_s=1.0)
        )
        blocks.append(np.arange(CELLS) // (8 * WIDTH) + i)
    return build_axis_data(recordings, 'force_z', request.param, blocks)


def moments_of(binned, parts=1):
    features = Features('powers', np.array([30.0]), np.zeros(1), np.full(1, 99.0), degree=2)
    return accumulate(binned, bank_inputs(binned, features, STATIC), STATIC, parts)


def test_every_sum_is_the_textbook_loop(problem):
    binned = bin_axis_data(problem, WIDTH)
    for i, sums in enumerate(binned.sums):
        for n in range(CELLS // WIDTH + 1):
            cells = range(n * WIDTH, min((n + 1) * WIDTH, CELLS))
            there = [k for k in cells if np.isfinite(problem.residual[i][k])]
            y = [problem.residual[i][k] for k in there]
            w = [0.0 if problem.load is None else problem.load[i][k] for k in there]
            pairs = list(zip(w, y, strict=True))
            expected = (
                len(there), sum(w), sum(a * a for a in w), sum(y), sum(b * b for b in y),
                sum(a * b for a, b in pairs),
            )  # fmt: skip
            found = (
                sums.count, sums.load, sums.load_square, sums.residual, sums.residual_square,
                sums.product,
            )  # fmt: skip
            assert [part[n] for part in found] == pytest.approx(expected, rel=1e-12, abs=1e-9)


def test_means_count_each_bin_once(problem):
    binned = bin_axis_data(problem, WIDTH, means=True)
    for i, sums in enumerate(binned.sums):
        for n in range(CELLS // WIDTH + 1):
            y = problem.residual[i][n * WIDTH : (n + 1) * WIDTH]
            y = y[np.isfinite(y)]
            assert sums.count[n] == (len(y) > 0)
            if len(y):
                assert sums.residual[n] == pytest.approx(y.mean(), rel=1e-12)
                assert sums.residual_square[n] == pytest.approx(y.mean() ** 2, rel=1e-12)
                assert sums.product[n] == pytest.approx(sums.load[n] * y.mean(), rel=1e-12)
                assert sums.load_square[n] == pytest.approx(sums.load[n] ** 2, rel=1e-12)


def test_a_last_bin_that_is_not_full_keeps_its_own_mean_temperature(make_recording):
    temperature_c = np.arange(25.0)
    recording = make_recording(temperature_c, {'force_z': 0.0}, period_s=1.0)
    problem = build_axis_data([recording], 'force_z', 'unloaded', [np.zeros(25, dtype=int)])
    binned = bin_axis_data(problem, 10)
    np.testing.assert_allclose(binned.temperature_c[0][:, 0], [4.5, 14.5, 22.0])
    np.testing.assert_array_equal(binned.sums[0].count, [10, 10, 5])
    assert binned.period_s == 10.0


def test_a_block_that_is_held_out_loses_its_samples_only(problem):
    binned = bin_axis_data(problem, WIDTH)
    kept, expected = moments_of(binned.without(1)), moments_of(binned)
    here = expected.fold != 1
    assert here.any()
    assert not here.all()
    np.testing.assert_array_equal(kept.products, expected.products[here])
    np.testing.assert_array_equal(kept.fold, expected.fold[here])
    assert binned.without(1).temperature_c is binned.temperature_c
    assert binned.without(1).longest_s == binned.longest_s == 250.0


@pytest.mark.parametrize('tau', [3.0, 25.0, 400.0])
def test_a_bin_holds_the_mean_of_a_relaxation_and_a_cell_its_end(problem, tau):
    """Against the cells of every bin, one by one."""
    binned = bin_axis_data(problem, WIDTH)
    temperature_c = np.random.default_rng(1).uniform(20, 40, 30)
    state, means, ends = temperature_c[0], [], []
    for t in temperature_c:
        cells = []
        for _ in range(WIDTH):
            state = t + (state - t) * np.exp(-1.0 / tau)
            cells.append(state)
        means.append(np.mean(cells))
        ends.append(state)
    np.testing.assert_allclose(free_run(binned.relaxation(tau), temperature_c), means, atol=1e-10)
    np.testing.assert_allclose(free_run(relaxation(tau, WIDTH), temperature_c), ends, atol=1e-10)
    at_end = bin_axis_data(problem, 1).relaxation(tau)
    np.testing.assert_array_equal(at_end.b, relaxation(tau, 1.0).b)
    assert binned.relaxation(tau).gain == pytest.approx(1.0, abs=1e-12)


def test_a_bin_without_a_time_constant_holds_the_temperature_itself(problem):
    for width in (1, WIDTH):
        static = bin_axis_data(problem, width).relaxation(0.0)
        assert (len(static.a), static.b.tolist(), static.first_lag) == (0, [1.0], 0)
