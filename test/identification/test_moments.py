"""Sums over samples: the columns they are of, and their centring."""

from dataclasses import replace

import numpy as np
import pytest

from wrist_ft_comp.identification.axis_data import assign_folds, build_axis_data
from wrist_ft_comp.identification.bins import bin_axis_data
from wrist_ft_comp.identification.moments import accumulate, bank_inputs
from wrist_ft_comp.identification.regression import least_squares
from wrist_ft_comp.model.features import Features

FEATURES = Features('powers', np.array([30.0]), np.zeros(1), np.full(1, 99.0), degree=2)
STATIC = np.zeros(1)
GRID = np.array([0.0, 50.0, 150.0, 400.0, 1200.0])


def moments_of(problem, grid=GRID):
    cells = bin_axis_data(problem, 1)
    return accumulate(cells, bank_inputs(cells, FEATURES, grid), grid)


def test_entries_are_sums_over_the_samples_of_each_fold(
    noisy_problem, textbook_bank, stack_samples
):
    cells = bin_axis_data(noisy_problem, 1)
    banked = textbook_bank(noisy_problem, GRID)
    for inputs, expected in zip(bank_inputs(cells, FEATURES, GRID), banked, strict=True):
        np.testing.assert_allclose(inputs, expected, atol=1e-9)
    moments = moments_of(noisy_problem)
    np.testing.assert_array_equal(moments.fold, [0, 1, 2])
    for entry in range(3):
        x, y, _ = stack_samples(noisy_problem, banked, {entry})
        both, one = np.column_stack((x, y)), np.ones((1, len(y)))
        np.testing.assert_allclose(moments.products[entry], both.T @ both, rtol=1e-9)
        sums = moments.nuisance_products[entry, :1]
        np.testing.assert_allclose(sums, one @ both, rtol=1e-9, atol=1e-7)
        assert moments.nuisance_gram[entry, 0, 0] == len(y)


@pytest.mark.parametrize('kept', [{0, 1, 2}, {0, 2}, {1}])
def test_centring_takes_a_constant_out_of_every_recording(
    noisy_problem, textbook_bank, stack_samples, centre, kept
):
    products = moments_of(noisy_problem).centred(np.isin(range(3), [*kept]))
    x, y, recordings = stack_samples(noisy_problem, textbook_bank(noisy_problem, GRID), kept)
    both = centre(np.column_stack((x, y)), recordings)
    np.testing.assert_allclose(products, both.T @ both, rtol=1e-8, atol=1e-6)


def test_columns_are_numbered_by_relaxation_then_feature(noisy_problem):
    moments = moments_of(noisy_problem)
    zero = [1 * 2, 3 * 2]
    expected = zero if noisy_problem.load is None else [*zero, 10 + 2, 10 + 6, 20]
    np.testing.assert_array_equal(moments.columns([1, 3], 1), expected)


class TestSlowTrend:
    """Cells of 200 s make these recordings longer than 8 h."""

    @pytest.fixture
    def long(self, noisy_problem):
        return replace(noisy_problem, period_s=200.0)

    def remainders(self, long, stack_samples, *, trend):
        """Columns and r - w of recording 1 without a constant, and a trend where asked."""
        powers = [np.column_stack((t - 30, (t - 30) ** 2)) for t in long.temperature_c]
        x, y, _ = stack_samples(long, powers, {1})
        both = np.column_stack((x, y))
        time = np.linspace(-1, 1, len(long.residual[1]))[np.isfinite(long.residual[1])]
        nuisance = np.column_stack((np.ones(len(time)), trend * time))
        return both - nuisance @ np.linalg.lstsq(nuisance, both, rcond=None)[0]

    def test_it_is_taken_out_of_long_recordings_unless_it_is_to_be_kept(self, long, stack_samples):
        kept = bin_axis_data(long, 1).without_trend()
        summed = accumulate(kept, bank_inputs(kept, FEATURES, STATIC), STATIC)
        moments = moments_of(long, STATIC)
        for each, trend in ((moments, True), (summed, False), (moments.without_trend(), False)):
            expected = self.remainders(long, stack_samples, trend=trend)
            products = each.centred(each.fold == 1)
            np.testing.assert_allclose(products, expected.T @ expected, rtol=1e-8, atol=1e-6)

    def test_short_recordings_and_plateaus_have_none(self, noisy_problem, long):
        for problem in (noisy_problem, replace(long, tared=False)):
            assert not moments_of(problem, STATIC).nuisance_gram[:, 1].any()
        assert moments_of(long, STATIC).nuisance_gram[:, 1, 1].all()


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
    moments = accumulate(cells, bank_inputs(cells, features, taus), taus)
    products = moments.centred(np.ones(3, dtype=bool))
    room = [1, 3]
    assert not products[room].any()
    assert not products[:, room].any()
    assert (np.diagonal(products)[[0, 2, 4]] > 1).all()
    gains, _ = least_squares(products, moments.columns([0, 1], 2))
    np.testing.assert_array_equal(gains[room], 0.0)
    np.testing.assert_allclose(gains[[0, 2]].sum(), 0.5, rtol=1e-4)
