"""The search for time constants: known ones are found, and none runs away or meets another."""

import numpy as np
import pytest

from wrist_ft_comp.identification.axis_data import assign_folds, build_axis_data
from wrist_ft_comp.identification.bins import bin_axis_data
from wrist_ft_comp.identification.standard_errors import fit_gains
from wrist_ft_comp.identification.time_constants import (
    residual_and_gradient,
    search_time_constants,
)
from wrist_ft_comp.model.features import Features

LINE = Features('powers', np.array([30.0]), np.zeros(1), np.full(1, 99.0))
SQUARE = Features('powers', np.array([30.0]), np.zeros(1), np.full(1, 99.0), degree=2)
CELLS = 360
LONGEST_S = CELLS * 10.0
RATIO = 1.5


@pytest.fixture(scope='module')
def temperatures(warm_up):
    return [warm_up(CELLS, 10 + i) for i in range(2)]


@pytest.fixture(scope='module')
def pose(make_recording, temperatures):
    """Pose the problem of a drift for each recording, in N, in single cells."""

    def make(drifts):
        recordings = [
            make_recording(temperature_c, {'force_z': drift_n + 50.0 * i})
            for i, (temperature_c, drift_n) in enumerate(zip(temperatures, drifts, strict=True))
        ]
        blocks = assign_folds(recordings)
        return bin_axis_data(build_axis_data(recordings, 'force_z', 'unloaded', blocks), 1)

    return make


class TestTangent:
    @pytest.mark.parametrize('taus', [(0.0,), (250.0,), (90.0, 700.0)], ids=str)
    def test_what_is_left_is_that_of_least_squares_on_the_samples(
        self, noisy_problem, textbook_bank, stack_samples, centre, taus
    ):
        found = residual_and_gradient(bin_axis_data(noisy_problem, 1), SQUARE, np.array(taus))
        banked = textbook_bank(noisy_problem, np.array(taus))
        x, y, recordings = stack_samples(noisy_problem, banked, {0, 1, 2})
        x, y = centre(x, recordings), centre(y, recordings)
        theta, (left,), _, _ = np.linalg.lstsq(x, y, rcond=None)
        assert found.rss == pytest.approx(left, rel=1e-8)
        np.testing.assert_allclose(found.gains, theta, rtol=1e-3, atol=1e-6)
        assert found.residual[-1] == 1.0

    @pytest.mark.parametrize('taus', [(250.0,), (90.0, 700.0), (60.0, 200.0, 1500.0)], ids=str)
    def test_slopes_are_finite_differences_of_what_is_left(self, noisy_problem, taus):
        cells, log_tau = bin_axis_data(noisy_problem, 1), np.log(taus)
        slopes = residual_and_gradient(cells, SQUARE, np.exp(log_tau)).gradient
        for step, slope in zip(1e-3 * np.eye(len(taus)), slopes, strict=True):
            up, down = (
                residual_and_gradient(cells, SQUARE, np.exp(log_tau + sign * step)).rss
                for sign in (1, -1)
            )
            assert slope == pytest.approx((up - down) / 2e-3, rel=1e-3)


@pytest.mark.parametrize('start', [(150.0,), (2500.0,)])
def test_a_noise_free_one_is_found_with_its_gains(pose, lagged, temperatures, start):
    """A square behind the lag, too."""
    relaxed = [lagged(t, 300.0) - 30 for t in temperatures]
    problem = pose([0.5 * theta + 0.02 * theta**2 for theta in relaxed])
    found = search_time_constants(problem, SQUARE, np.array(start))
    np.testing.assert_allclose(found, [300.0], rtol=1e-3)
    gains = fit_gains(problem, SQUARE, found).gains
    np.testing.assert_allclose(gains[0, :, 0], [0.5, 0.02], rtol=1e-3)


def test_two_noise_free_ones_are_found_with_their_gains(pose, lagged, temperatures):
    problem = pose([0.5 * lagged(t, 200.0) - 0.8 * lagged(t, 1300.0) for t in temperatures])
    found = search_time_constants(problem, LINE, np.array([120.0, 900.0]))
    np.testing.assert_allclose(found, [200.0, 1300.0], rtol=5e-3)
    gains = fit_gains(problem, LINE, found).gains
    np.testing.assert_allclose(gains[:, 0, 0], [0.5, -0.8], rtol=2e-2)


@pytest.mark.parametrize('true', [1e6, 1e9])
@pytest.mark.parametrize('start', [(1500.0,), (100.0, 1500.0)])
def test_one_beyond_the_recording_ends_at_its_length(pose, lagged, temperatures, true, start):
    """All that is seen is an integral; a time constant of years would fit it and explode."""
    problem = pose([true / 1000 * lagged(t - 30, true) for t in temperatures])
    found = search_time_constants(problem, LINE, np.array(start))
    assert found[-1] == pytest.approx(LONGEST_S, rel=1e-9)


@pytest.mark.parametrize('start', [(20.0,), (150.0,), (33.0, 400.0), (25.0, 60.0, 700.0)], ids=str)
@pytest.mark.parametrize('seed', range(4))
def test_one_that_is_quicker_than_a_cell_ends_at_a_cell(pose, temperatures, start, seed):
    rng = np.random.default_rng(seed)
    problem = pose([0.5 * t + 0.02 * rng.standard_normal(CELLS) for t in temperatures])
    found = search_time_constants(problem, LINE, np.array(start))
    assert found[0] == pytest.approx(10.0, rel=1e-9)


@pytest.mark.parametrize(
    'start',
    [(100.0, 160.0), (299.0, 301.0), (290.0, 300.0, 310.0), (20.0, 3000.0, 3500.0), (1e5, 2e5)],
    ids=str,
)
@pytest.mark.parametrize('noise', [0.0, 0.3])
def test_they_keep_apart_within_their_bounds_wherever_they_start(
    pose, lagged, temperatures, start, noise
):
    """One lag is all there is: two would meet there, with gains that explode."""
    rng = np.random.default_rng(3)
    problem = pose(
        [0.5 * lagged(t, 300.0) + noise * rng.standard_normal(CELLS) for t in temperatures]
    )
    found = search_time_constants(problem, LINE, np.array(start))
    assert len(found) == len(start)
    assert (found[1:] >= RATIO * (1 - 1e-9) * found[:-1]).all()
    assert found[0] >= 10.0 * (1 - 1e-9)
    assert found[-1] <= LONGEST_S * (1 + 1e-9)


def test_a_search_never_ends_worse_than_it_began(noisy_problem):
    cells = bin_axis_data(noisy_problem, 1)
    for start in ((40.0,), (900.0,), (40.0, 900.0), (30.0, 200.0, 1200.0)):
        found = search_time_constants(cells, SQUARE, np.array(start))
        before = residual_and_gradient(cells, SQUARE, np.array(start)).rss
        assert residual_and_gradient(cells, SQUARE, found).rss <= before * (1 + 1e-9)
