"""Readings no sensor has, jumps no body makes, and units mixed up."""

import math

import numpy as np
import pytest

from wrist_ft_comp.stream.input_checks import is_plausible, other_unit, ThermometerWatch

SECOND = 1_000_000_000


@pytest.mark.parametrize('value', [-40.0, 0.0, 25.0, 85.0, 150.0])
def test_what_a_sensor_can_have_is_plausible(value: float) -> None:
    assert is_plausible(value)


@pytest.mark.parametrize('value', [-273.15, 0.0 + 273.15, 298.15, 1e9, math.nan, math.inf])
def test_absolute_zero_kelvins_and_no_numbers_are_not(value: float) -> None:
    assert not is_plausible(value)


@pytest.mark.parametrize(
    ('value', 'unit'),
    [(86.0, 'degrees Fahrenheit'), (303.15, 'kelvins'), (130.0, ''), (-50.0, '')],
)
def test_the_unit_is_guessed_where_it_explains_the_value(value: float, unit: str) -> None:
    assert other_unit(value, 15.0, 45.0) == unit


@pytest.mark.parametrize(
    ('step_k', 'cells', 'period_s', 'jumps'),
    [
        (2.1, 1, 1, 0),
        (2.3, 1, 1, 1),
        (-2.3, 1, 1, 1),
        (20.0, 100, 1, 0),
        (3.9, 1, 10, 0),
        (4.1, 1, 10, 1),
    ],
)
def test_a_jump_is_more_than_metal_can_do_in_the_time(
    step_k: float, cells: int, period_s: int, jumps: int
) -> None:
    watch = ThermometerWatch(2)
    watch.look(np.array([20.0, 30.0]), 1, period_s * SECOND)
    watch.look(np.array([20.0, 30.0 + step_k]), cells, period_s * SECOND)
    assert watch.jumps == [0, jumps]
    assert watch.last_jump_k[1] == pytest.approx(step_k if jumps else 0.0)
