"""Sums over samples: the columns they are of, their centring, and scores from them."""

from dataclasses import replace

import numpy as np
import pytest

from wrist_ft_comp.identification.axis_data import assign_folds, build_axis_data
from wrist_ft_comp.identification.bins import bin_axis_data
from wrist_ft_comp.identification.moments import accumulate, bank_inputs
from wrist_ft_comp.identification.regression import least_squares
from wrist_ft_comp.model.features import Features

FEATURES = Features('powers', np.array([30.0]), np.zeros(1), np.full(1, 99.0), degree=2)
GRID = np.array([0.0, 50.0, 150.0, 400.0, 1200.0])


def moments_of(problem, parts=1):
    cells = bin_axis_data(problem, 1)
    return accumulate(cells, bank_inputs(cells, FEATURES, GRID), GRID, parts)


def test_the_bank_is_the_textbook_loop_and_powers_are_taken_behind_it(
    noisy_problem, textbook_bank
):
    cells = bin_axis_data(noisy_problem, 1)
    found = bank_inputs(cells, FEATURES, GRID)
    for one, expected in zip(found, textbook_bank(noisy_problem, GRID), strict=True):
        np.testing.assert_allclose(one, expected, atol=1e-9)


def test_entries_are_sums_over_the_samples_of_each_block(
    noisy_problem, textbook_bank, stack_samples
):
    moments = moments_of(noisy_problem)
    banked = textbook_bank(noisy_problem, GRID)
    np.testing.assert_array_equal(moments.fold, [0, 1, 2])
    for entry in range(3):
        x, y, _ = stack_samples(noisy_problem, banked, {entry})
        both = np.column_stack((x, y))
        np.testing.assert_allclose(moments.products[entry], both.T @ both, rtol=1e-9)
        np.testing.assert_allclose(moments.sums[entry], both.sum(axis=0), rtol=1e-9, atol=1e-7)
        assert moments.counts[entry] == len(y)


def test_parts_divide_a_block_in_time(noisy_problem):
    whole, parts = moments_of(noisy_problem), moments_of(noisy_problem, 4)
    np.testing.assert_array_equal(parts.fold, np.repeat([0, 1, 2], 4))
    assert np.ptp(parts.counts[:4]) <= 1
    for block in range(3):
        own = parts.fold == block
        np.testing.assert_allclose(parts.products[own].sum(axis=0), whole.products[block])
    # The first feature, T - 30 °C, rises during a warm-up.
    means = parts.sums[:4, 0] / parts.counts[:4]
    assert (np.diff(means) > 0).all()


def test_more_parts_than_samples_are_as_many_as_samples(noisy_problem):
    residual = tuple(np.full_like(values, np.nan) for values in noisy_problem.residual)
    residual[0][[5, 50]] = 1.0
    residual[2][7] = 2.0
    parts = moments_of(replace(noisy_problem, residual=residual), 4)
    np.testing.assert_array_equal(parts.fold, [0, 0, 2])
    np.testing.assert_array_equal(parts.counts, [1, 1, 1])


@pytest.mark.parametrize('kept', [{0, 1, 2}, {0, 2}, {1}])
def test_centring_takes_a_constant_out_of_every_recording(
    noisy_problem, textbook_bank, stack_samples, centre, kept
):
    found = moments_of(noisy_problem, 3).centred(np.isin(np.repeat(range(3), 3), [*kept]))
    x, y, recordings = stack_samples(noisy_problem, textbook_bank(noisy_problem, GRID), kept)
    both = centre(np.column_stack((x, y)), recordings)
    np.testing.assert_allclose(found, both.T @ both, rtol=1e-8, atol=1e-6)


def test_columns_are_numbered_by_relaxation_then_feature(noisy_problem):
    moments = moments_of(noisy_problem)
    zero = [1 * 2, 3 * 2]
    expected = zero if noisy_problem.load is None else [*zero, 10 + 2, 10 + 6, 20]
    np.testing.assert_array_equal(moments.columns([1, 3], 1), expected)


class TestScores:
    @pytest.fixture
    def thetas(self, noisy_problem):
        width = moments_of(noisy_problem).sums.shape[1]
        thetas = np.random.default_rng(0).standard_normal((3, width)) * 0.1
        thetas[:, -1] = 1.0
        return thetas

    def left(self, problem, bank, stack, thetas, blocks):
        x, y, recordings = stack(problem, bank(problem, GRID), blocks)
        return np.column_stack((x, y)) @ thetas.T, recordings

    def test_a_held_out_recording_is_scored_around_its_own_mean_part_by_part(
        self, noisy_problem, textbook_bank, stack_samples, thetas
    ):
        moments = moments_of(noisy_problem, 4)
        found = moments.mean_squares(moments.fold == 1, thetas)
        left, _ = self.left(noisy_problem, textbook_bank, stack_samples, thetas, {1})
        parts = np.array_split((left - left.mean(axis=0)) ** 2, 4)
        expected = np.stack([part.mean(axis=0) for part in parts], axis=1)
        assert found.shape == (3, 4)
        np.testing.assert_allclose(found, expected, rtol=1e-7)

    def test_a_plateau_is_scored_around_the_mean_of_the_others(
        self, noisy_problem, textbook_bank, stack_samples, thetas
    ):
        """Chamber tests are not tared: what differs between plateaus is the drift."""
        blocks = tuple(np.arange(len(values)) // 60 for values in noisy_problem.folds)
        chamber = replace(noisy_problem, folds=blocks, tared=False)
        moments = moments_of(chamber)
        assert not moments.tared
        found = moments.mean_squares(moments.fold == 1, thetas)
        inside, of = self.left(chamber, textbook_bank, stack_samples, thetas, {1})
        others, of_others = self.left(chamber, textbook_bank, stack_samples, thetas, {0, 2, 3})
        for i in range(3):
            constant = others[of_others == i].mean(axis=0)
            expected = np.mean((inside[of == i] - constant) ** 2, axis=0)
            np.testing.assert_allclose(found[:, i], expected, rtol=1e-7)


class TestSlowTrend:
    """Cells of 200 s make these recordings longer than 8 h."""

    @pytest.fixture
    def long(self, noisy_problem):
        return replace(noisy_problem, period_s=200.0)

    @pytest.fixture
    def by_hand(self, long, stack_samples):
        """Static columns and r - w of recording 1, and time from -1 to 1 where it is present."""
        powers = [np.column_stack((t - 30, (t - 30) ** 2)) for t in long.temperature_c]
        x, y, _ = stack_samples(long, powers, {1})
        time = np.linspace(-1, 1, len(long.residual[1]))
        return np.column_stack((x, y)), time[np.isfinite(long.residual[1])]

    def static(self, problem, parts=1):
        cells, taus = bin_axis_data(problem, 1), np.zeros(1)
        return accumulate(cells, bank_inputs(cells, FEATURES, taus), taus, parts)

    def test_it_is_taken_out_of_long_recordings_beside_the_constant(self, long, by_hand):
        both, time = by_hand
        nuisance = np.column_stack((np.ones(len(time)), time))
        left = both - nuisance @ np.linalg.lstsq(nuisance, both, rcond=None)[0]
        moments = self.static(long, 3)
        found = moments.centred(moments.fold == 1)
        np.testing.assert_allclose(found, left.T @ left, rtol=1e-8, atol=1e-6)
        squares = moments.mean_squares(moments.fold == 1, np.eye(both.shape[1])[-1:])
        parts = [np.mean(part**2) for part in np.array_split(left[:, -1], 3)]
        np.testing.assert_allclose(squares[0], parts, rtol=1e-8)

    def test_it_can_be_kept(self, long, by_hand):
        both, _ = by_hand
        centred = both - both.mean(axis=0)
        cells, taus = bin_axis_data(long, 1).without_trend(), np.zeros(1)
        summed = accumulate(cells, bank_inputs(cells, FEATURES, taus), taus)
        for moments in (summed, self.static(long).without_trend()):
            found = moments.centred(moments.fold == 1)
            np.testing.assert_allclose(found, centred.T @ centred, rtol=1e-8, atol=1e-6)

    def test_short_recordings_and_plateaus_have_none(self, noisy_problem, long):
        for problem in (noisy_problem, replace(long, tared=False)):
            assert not self.static(problem).nuisance_gram[:, 1].any()
        assert self.static(long).nuisance_gram[:, 1, 1].all()


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
