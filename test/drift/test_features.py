"""What the outer model sees of the temperatures."""

import numpy as np
import pytest

from wrist_ft_comp.drift.features import Features


def test_powers_are_ordered_by_power_then_thermometer():
    features = Features('powers', np.array([20.0, 30.0]), np.zeros(2), np.full(2, 99.0), degree=3)
    assert features.expand(np.array([22.0, 33.0])).tolist() == [2.0, 3.0, 4.0, 9.0, 8.0, 27.0]
    assert features.thermometers == 2


def test_hats_interpolate_coefficients_and_are_exact_at_the_knots():
    knots, one = [-40.0, -15.0, 0.0, 20.0, 100.0], np.ones(1)
    features = Features('hats', 20 * one, -100 * one, 200 * one, knots_c=(np.array(knots),))
    coefficients = np.array([3.0, -1.0, 4.0, 1.0, -5.0])
    np.testing.assert_array_equal(features.expand(np.array(knots)[:, np.newaxis]), np.eye(5))
    for temperature in np.linspace(-40, 100, 57):
        right = next(i for i in range(1, 5) if temperature <= knots[i])
        share = (temperature - knots[right - 1]) / (knots[right] - knots[right - 1])
        expected = coefficients[right - 1] * (1 - share) + coefficients[right] * share
        seen = features.expand(np.array([temperature])) @ coefficients
        assert seen == pytest.approx(expected, abs=1e-12)


class TestTangents:
    """10 to 40 °C were calibrated, T_ref is 20 °C: θ from -10 to 20 K, curved for 9.9 K more."""

    FEATURES = Features('powers', np.array([20.0]), np.array([10.0]), np.array([40.0]), 4)

    def powers(self, theta):
        celsius = self.FEATURES.clamp(20.0 + np.reshape(theta, (-1, 1)))
        return self.FEATURES.expand(celsius)

    def test_inside_the_range_features_are_powers(self):
        theta = np.linspace(-10, 20, 61)
        np.testing.assert_allclose(self.powers(theta), theta[:, np.newaxis] ** np.arange(1, 5))

    @pytest.mark.parametrize(('edge', 'sign'), [(20.0, 1), (-10.0, -1)])
    def test_outside_the_range_all_but_squares_go_on_straight(self, edge, sign):
        """Squares stay curved for a third of the range; three ranges farther all is held."""
        excess, power = sign * np.array([0.0, 3.0, 9.9, 12.0, 90.0, 150.0]), np.arange(1, 5)
        outside = self.powers(edge + excess)
        excess[-1] = excess[-2]
        tangents = edge**power + excess[:, np.newaxis] * power * edge ** (power - 1)
        np.testing.assert_allclose(outside[:, [0, 2, 3]], tangents[:, [0, 2, 3]])
        curved = edge + sign * np.minimum(np.abs(excess), 9.9)
        squares = curved**2 + 2 * curved * (edge + excess - curved)
        np.testing.assert_allclose(outside[:, 1], squares)
