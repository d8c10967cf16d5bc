"""K_s and A (eq. 23, 24): worked out by hand, and what the paper's four tables come to."""

import csv
from pathlib import Path

import numpy as np
import pytest

from wrist_ft_comp import accuracy, thermal_sensitivity_drift
from wrist_ft_comp.errors import SettingsError

TABLES = Path(__file__).parents[2] / 'data/keller_pa10'


def test_k_s_is_eq_23_term_by_term():
    """Y_f - Y_0 is 100 at 20 °C, 98 at 40 °C and 103 at 10 °C: -0.1 and -0.3 % per °C."""
    temperature_c = np.array([40.0, 20.0, 10.0])
    k_s = thermal_sensitivity_drift(
        temperature_c, np.array([7.0, 5.0, 2.0]), np.array([105.0, 105.0, 105.0]), 20.0
    )
    np.testing.assert_allclose(k_s, [-2 / 20, np.nan, 3 / -10], rtol=1e-12)
    negative = thermal_sensitivity_drift(
        temperature_c, -np.ones(3), np.array([-3.0, -2, -2]), 20.0
    )
    np.testing.assert_allclose(negative, [100 / 20, np.nan, 0.0])


def test_a_is_the_largest_error_by_full_scale():
    output, expected = np.array([[1.0, 2.0], [3.5, np.nan]]), np.array([[1.0], [3.0]])
    assert accuracy(output, expected, 50.0) == pytest.approx(2.0)
    assert accuracy(output, expected, -50.0) == pytest.approx(2.0)


@pytest.mark.parametrize('reference_c', [25.0, 40.0])
def test_a_reference_that_says_nothing_is_refused(reference_c):
    with pytest.raises(
        SettingsError, match=rf'must be one of \[20.0, 40.0\] .*{reference_c:g} °C'
    ):
        thermal_sensitivity_drift(
            np.array([20.0, 40.0]), np.zeros(2), np.array([1.0, 0.0]), reference_c
        )
    with pytest.raises(SettingsError, match='must not be 0'):
        accuracy(np.ones(2), np.ones(2), 0.0)


@pytest.mark.parametrize(
    ('name', 'expected'),
    [
        ('table1_sensor_a_raw', 0.0687),
        ('table2_sensor_b_raw', 0.1444),
        ('table3_sensor_a_compensated', 0.0206),
        ('table4_sensor_b_compensated', 0.0137),
    ],
)
def test_the_papers_tables_have_the_k_s_that_a_pocket_calculator_gives(name, expected):
    """The figures stand in data/keller_pa10/README.md; row 5 is full load, row 1 none."""
    with (TABLES / f'{name}.csv').open(encoding='utf-8') as file:
        header, *rows = csv.reader(file)
    temperature_c = np.array([float(column.split('_')[2]) for column in header[3:]])
    output = np.array([[float(cell) for cell in row[3:]] for row in rows])
    k_s = thermal_sensitivity_drift(temperature_c, output[0], output[4], 20.0)
    assert np.nanmax(np.abs(k_s)) == pytest.approx(expected, abs=5e-5)
