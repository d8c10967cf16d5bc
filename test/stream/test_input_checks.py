"""Readings that no sensor makes: frozen, saturated, with wrong stamps, jumping, in kelvins."""

import math

import numpy as np
import pytest

from wrist_ft_comp.signals import is_plausible
from wrist_ft_comp.stream.input_checks import LOOKS, SensorWatch, ThermometerWatch
from wrist_ft_comp.stream.stream_grid import ThermalCell
from wrist_ft_comp.wire.units import other_unit

SECOND = 1_000_000_000
RAW = [1.0, 2.0, 3.0, 0.1, 0.2, 0.0]


def look(watch, readings):
    for number, reading in enumerate(np.atleast_2d(readings).tolist(), 1):
        watch.look(number * SECOND, reading)


def noisy(count):
    return RAW + np.random.default_rng(0).normal(0, 1, (count, 6)) * [1, 1, 1, 1, 1, 0]


def test_a_reading_that_stays_is_frozen_until_a_bit_changes():
    watch = SensorWatch()
    for number in range(1, LOOKS + 1):
        watch.look(number, RAW)
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
    readings = noisy(4 * LOOKS)
    look(watch, readings[:LOOKS])
    assert watch.saturated == ()
    readings[:, 1:3] = stays_at
    look(watch, readings[LOOKS:])
    assert watch.saturated == saturated
    assert not watch.frozen


def test_stamps_are_judged_by_their_steps():
    """A simulation that runs hundreds of times as fast as the clock does not leap."""
    watch = SensorWatch()
    at = 3600 * SECOND
    for step_ns, ran_back, leapt in (
        (0, 0, 0), (SECOND, 0, 0), (0, 0, 0), (60 * SECOND, 0, 0), (SECOND, 0, 0),
        (60 * SECOND + 1, 0, 1), (-SECOND, 1, 1), (120 * SECOND, 1, 2), (1100 * SECOND, 1, 2),
        (-1, 2, 2),
    ):  # fmt: skip
        at += step_ns
        watch.look(at, RAW)
        assert (watch.ran_back, watch.leapt) == (ran_back, leapt)
        assert not watch.stamps_stand_still
        assert not watch.unstamped
    watch.look(0, RAW)
    assert watch.unstamped
    watch.look(at, RAW)
    assert not watch.unstamped


def test_stamps_stand_still_from_the_sixth_at_the_same_time():
    watch = SensorWatch()
    assert not watch.unstamped
    for stamps in ([7] * 6, [8] * 6):
        seen = []
        for stamp_ns in stamps:
            watch.look(stamp_ns, RAW)
            seen.append(watch.stamps_stand_still)
        assert seen == [False] * 5 + [True]


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


@pytest.mark.parametrize(
    ('step_k', 'silent', 'period_s', 'jumps'),
    [(2.1, 0, 1, 0), (2.3, 0, 1, 1), (-3, 0, 1, 1), (20, 99, 1, 0), (4, 0, 10, 0), (-5, 0, 10, 1)],
)  # fmt: skip
def test_a_jump_is_more_than_metal_can_do_in_the_time(step_k, silent, period_s, jumps):
    watch, period_ns, cell = ThermometerWatch(2), period_s * SECOND, 10**9
    for number, reading in enumerate((0.0, step_k, 0.0)):
        if number and silent:
            held = np.array([20.0, step_k * (number - 1)])
            watch.look(ThermalCell(cell + silent, held, (0, silent)), period_ns)
        cell += silent + 1
        watch.look(ThermalCell(cell, np.array([20.0, reading]), (0, 0)), period_ns)
        assert watch.jumps.tolist() == [0, jumps * number]
    assert watch.last_jump_k == pytest.approx([0.0, -step_k * jumps])
    watch.look(ThermalCell(cell + 1, np.array([99.0, 0.0]), (0, 0)), SECOND, {0, 1})
    watch.look(ThermalCell(3, np.array([98.0, 1.0]), (0, 0)), SECOND)  # a clock was set back
    assert watch.jumps.tolist() == [0, 2 * jumps]
