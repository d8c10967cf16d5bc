"""Readings that no sensor makes: frozen, saturated, in kelvins."""

import numpy as np
import pytest

from wrist_ft_comp.stream.wrench_watch import LOOKS, SensorWatch

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
