"""Readings that no sensor makes: frozen, saturated, in kelvins."""

import math

import numpy as np
import pytest

from wrist_ft_comp.signals import is_plausible
from wrist_ft_comp.stream.wrench_watch import LOOKS, SensorWatch
from wrist_ft_comp.wire.temperature_source import other_unit

RAW = [1.0, 2.0, 3.0, 0.1, 0.2, 0.0]


def look(watch, readings):
    for number, reading in enumerate(np.atleast_2d(readings).tolist(), 1):
        watch.look(number * 10**9, reading)


def test_a_reading_that_stays_is_frozen_until_a_bit_changes():
    watch = SensorWatch()
    look(watch, [RAW] * LOOKS)
    assert not watch.frozen
    look(watch, RAW)
    assert watch.frozen
    look(watch, np.nextafter(RAW, 9))
    assert not watch.frozen


@pytest.mark.parametrize(
    ('stays_at', 'saturated'), [((-500.0, 200.0), ('force_y', 'force_z')), ((2.0, 3.0), ())]
)
def test_an_axis_that_stays_at_its_extreme_is_saturated_and_one_that_never_moved_is_not(
    stays_at, saturated
):
    watch = SensorWatch()
    noise = np.random.default_rng(0).normal(0, 1, (4 * LOOKS, 6)) * [1, 1, 1, 1, 1, 0]
    readings = RAW + noise
    look(watch, readings[:LOOKS])
    assert watch.saturated == ()
    readings[:, 1:3] = stays_at
    look(watch, readings[LOOKS:])
    assert watch.saturated == saturated
    assert not watch.frozen


def test_absolute_zero_kelvins_and_no_numbers_are_not_plausible():
    assert all(map(is_plausible, (-99.9, -40.0, 0.0, 25.0, 85.0, 150.0, 199.9)))
    strange = (-273.15, -100.0, 200.0, 273.15, 298.15, 1e9, math.nan, math.inf)
    assert not any(map(is_plausible, strange))


def test_the_unit_is_guessed_where_it_explains_the_value():
    for unit, values in (
        ('degrees Fahrenheit', (59.0, 86.0, 113.0)),
        ('kelvins', (288.15, 303.15, 318.15)),
        ('', (-50.0, 58.9, 113.1, 130.0, 288.1, 318.2)),
    ):
        assert [other_unit(value, 15.0, 45.0) for value in values] == [unit] * len(values)
