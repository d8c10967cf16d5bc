"""The search for time constants: known ones are found, and none runs away or meets another."""

import numpy as np
import pytest

from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.bins import bin_axis_data
from wrist_ft_comp.fit.standard_errors import fit_gains
from wrist_ft_comp.fit.time_constants import (
    residual_and_gradient,
    search_time_constants,
)

LINE = Features('powers', np.array([30.0]), np.zeros(1), np.full(1, 99.0))
SQUARE = Features('powers', np.array([30.0]), np.zeros(1), np.full(1, 99.0), degree=2)
CELLS = 360
LONGEST_S = CELLS * 10.0
RATIO = 1.5


@pytest.fixture(scope='module')
def temperatures(warm_up):
    return [warm_up(CELLS, 10 + i) for i in range(2)]


@pytest.fixture(scope='module')
def pose(make_axis_data, temperatures):
    """Pose the problem of a drift for each recording, in N, in single cells."""

    def make(drifts):
        raws = [drift_n + 50.0 * i for i, drift_n in enumerate(drifts)]
        return bin_axis_data(make_axis_data(temperatures, raws), 1)

    return make


@pytest.mark.parametrize('taus', [(0.0,), (250.0,), (90.0, 700.0)], ids=str)
def test_gains_and_remainder_are_those_of_least_squares_on_the_samples(
    noisy_problem, textbook_bank, stack_samples, whiten, taus
):
    projection = residual_and_gradient(bin_axis_data(noisy_problem, 1), SQUARE, np.array(taus))
    banked = textbook_bank(noisy_problem, np.array(taus))
    x, y, places = stack_samples(noisy_problem, banked, {0, 1, 2})
    x, y = (whiten(values, places, noisy_problem) for values in (x, y))
    theta, (rss,), _, _ = np.linalg.lstsq(x, y, rcond=None)
    assert projection.rss == pytest.approx(rss, rel=1e-8)
    np.testing.assert_allclose(projection.gains, theta, rtol=1e-3, atol=1e-6)
    assert projection.residual[-1] == 1.0


@pytest.mark.parametrize('taus', [(250.0,), (90.0, 700.0), (60.0, 200.0, 1500.0)], ids=str)
def test_slopes_are_finite_differences(noisy_problem, taus):
    cells, log_tau = bin_axis_data(noisy_problem, 1), np.log(taus)
    slopes = residual_and_gradient(cells, SQUARE, np.exp(log_tau)).gradient
    for step, slope in zip(1e-3 * np.eye(len(taus)), slopes, strict=True):
        up, down = (
            residual_and_gradient(cells, SQUARE, np.exp(log_tau + sign * step)).rss
            for sign in (1, -1)
        )
        assert slope == pytest.approx((up - down) / 2e-3, rel=1e-3)


@pytest.mark.parametrize(
    ('truth', 'start', 'features'),
    [
        ({300.0: (0.5, 0.02)}, (150.0,), SQUARE),
        ({300.0: (0.5, 0.02)}, (2500.0,), SQUARE),
        ({200.0: (0.5,), 1300.0: (-0.8,)}, (120.0, 900.0), LINE),
    ],
    ids=str,
)
def test_noise_free_ones_are_found_with_their_gains(  # noqa: PLR0913, PLR0917
    pose, lagged, temperatures, truth, start, features
):
    """A square behind the lag, too."""

    def drift(temperature_c):
        return sum(
            gain * (lagged(temperature_c, tau) - 30) ** power
            for tau, gains in truth.items()
            for power, gain in enumerate(gains, start=1)
        )

    problem = pose([drift(temperature_c) for temperature_c in temperatures])
    taus = search_time_constants(problem, features, np.array(start))
    np.testing.assert_allclose(taus, list(truth), rtol=5e-3)
    gains = fit_gains(problem, features, taus).gains
    np.testing.assert_allclose(gains[:, :, 0], list(truth.values()), rtol=2e-2)


@pytest.mark.parametrize('true', [1e6, 1e9])
@pytest.mark.parametrize('start', [(1500.0,), (100.0, 1500.0)])
def test_one_beyond_the_recording_ends_at_its_length(pose, lagged, temperatures, true, start):
    """All that is seen is an integral; a time constant of years would fit it and explode."""
    problem = pose([true / 1000 * lagged(t - t[0], true) for t in temperatures])
    taus = search_time_constants(problem, LINE, np.array(start))
    assert taus[-1] == pytest.approx(LONGEST_S, rel=1e-9)


@pytest.mark.parametrize('start', [(20.0,), (150.0,), (33.0, 400.0), (25.0, 60.0, 700.0)], ids=str)
@pytest.mark.parametrize('seed', range(4))
def test_one_that_is_quicker_than_a_cell_ends_at_a_cell(pose, temperatures, start, seed):
    rng = np.random.default_rng(seed)
    problem = pose([0.5 * t + 0.02 * rng.standard_normal(CELLS) for t in temperatures])
    taus = search_time_constants(problem, LINE, np.array(start))
    assert taus[0] == pytest.approx(10.0, rel=1e-9)


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
    taus = search_time_constants(problem, LINE, np.array(start))
    assert len(taus) == len(start)
    assert (taus[1:] >= RATIO * (1 - 1e-9) * taus[:-1]).all()
    assert taus[0] >= 10.0 * (1 - 1e-9)
    assert taus[-1] <= LONGEST_S * (1 + 1e-9)
