"""K_s and A (eq. 23, 24), worked out by hand; test_reproduce.py has the paper's tables."""

import numpy as np
import pytest

from wrist_ft_comp import accuracy, thermal_sensitivity_drift
from wrist_ft_comp.errors import SettingsError


def test_k_s_is_eq_23_term_by_term():
    """Y_f - Y_0 is 100 at 20 °C, 98 at 40 °C and 103 at 10 °C: -0.1 and -0.3 % per °C."""
    temperature_c = np.array([40.0, 20.0, 10.0])
    zero, full_scale = np.array([7.0, 5.0, 2.0]), np.full(3, 105.0)
    k_s = thermal_sensitivity_drift(temperature_c, zero, full_scale, 20.0)
    np.testing.assert_allclose(k_s, [-2 / 20, np.nan, 3 / -10], rtol=1e-12)


def test_a_is_the_largest_error_by_full_scale():
    output, expected = np.array([[1.0, 2.0], [3.5, np.nan]]), np.array([[1.0], [3.0]])
    assert accuracy(output, expected, 50.0) == pytest.approx(2.0)
    assert accuracy(output, expected, -50.0) == pytest.approx(2.0)


def test_a_reference_that_says_nothing_is_refused():
    for reference_c in (25.0, 40.0):  # not there, and without a span
        with pytest.raises(SettingsError, match=rf'one of \[20.0, 40.0\] .*{reference_c:g} °C'):
            thermal_sensitivity_drift(
                np.array([20.0, 40.0]), np.zeros(2), np.array([1.0, 0.0]), reference_c
            )
    with pytest.raises(SettingsError, match='must not be 0'):
        accuracy(np.ones(2), np.ones(2), 0.0)
