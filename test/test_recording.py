"""What is read off a channel, ranges of settings, topics, and robust weights."""

import math

import numpy as np
import pytest

from wrist_ft_comp.errors import check_range, SettingsError
from wrist_ft_comp.recording import Topics
from wrist_ft_comp.series import noise_level, robust_cost, robust_weight, stretches


def test_noise_is_separated_from_slow_motion_and_steps():
    rng = np.random.default_rng(0)
    series = [np.cumsum(np.full(5000, 0.01)) + rng.normal(0, 0.3, 5000) for _ in range(2)]
    series[0][2000:] += 50.0
    series[1][::7] = np.nan
    assert noise_level(series) == pytest.approx(0.3, rel=0.03)
    assert noise_level([np.full(5, np.nan), np.array([1.0])]) == 0.0


def test_a_gap_of_ten_usual_distances_and_a_minute_begins_a_new_stretch():
    at = np.array([3, 5, 7, 9, 24, 26, 86, 88, 149, 151])
    present = np.isin(np.arange(160), at)
    every_minute, every_ten = stretches(present, 1.0), stretches(present, 10.0)
    np.testing.assert_array_equal(every_minute, np.repeat([0, 1], [149, 11]))
    np.testing.assert_array_equal(every_ten, np.repeat([0, 1, 2], [86, 63, 11]))
    assert every_minute.dtype == np.int64
    for few in ((), (5,), (0, 199)):
        assert not stretches(np.isin(np.arange(200), few), 1.0).any()


@pytest.mark.parametrize(
    ('bounds', 'right', 'wrong', 'words'),
    [
        ({'least': 0.0}, (0.0, 5.0), (-1.0,), 'of at least 0'),
        ({'least': 0.0, 'above': True}, (1e-9, 5.0), (0.0, -1.0), 'above 0'),
        ({'least': 0.1, 'most': 600.0}, (0.1, 600.0), (0.09, 601.0), 'from 0.1 to 600'),
        ({'least': 0.0, 'most': 5.0, 'above': True}, (1e-9, 5.0), (0.0, 5.1), 'from 0 to 5'),
        ({'least': -math.inf}, (-1e9, 1e9), (), 'that is finite'),
    ],
)
def test_a_number_outside_its_range_is_refused_with_the_range(bounds, right, wrong, words):
    for value in right:
        check_range('it', value, **bounds)
    for value in (*wrong, math.nan, math.inf, -math.inf):
        with pytest.raises(SettingsError, match=f'^it must be a number {words}; got {value}'):
            check_range('it', value, **bounds)


def test_one_name_in_the_place_of_several_topics_is_refused():
    with pytest.raises(SettingsError, match=r"Write \('/temperature',\)\.$"):
        Topics(temperatures='/temperature')


def test_the_weight_is_the_derivative_of_the_cost():
    square, step = np.array([0.0, 0.1, 1.0, 30.0]), 1e-6
    costs = [robust_cost(robust_weight(square + part)) for part in (step, 0.0)]
    np.testing.assert_allclose((costs[0] - costs[1]) / step, robust_weight(square), rtol=1e-3)
    assert robust_cost(robust_weight(np.array([0.0, np.inf]))).tolist() == [0.0, 1.0]
