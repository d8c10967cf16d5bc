"""Readings that no sensor makes: frozen, saturated, zeroed by a driver."""

import numpy as np
import pytest

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.stream.drift_limits import axis_limits
from wrist_ft_comp.stream.wrench_faults import LOOKS, SensorWatch

RAW = [1.0, 2.0, 3.0, 0.1, 0.2, 0.0]


def look(watch, readings):
    for reading in np.atleast_2d(readings).tolist():
        watch.look(reading)


def test_a_reading_that_stays_is_frozen_until_bits_have_changed_for_some_time():
    watch = SensorWatch()
    look(watch, [RAW] * LOOKS)
    assert not watch.frozen
    look(watch, RAW)
    assert watch.frozen
    look(watch, [np.nextafter(RAW, 9), RAW] * 3)
    assert not watch.frozen


@pytest.mark.parametrize(
    ('stays_at', 'since', 'fine'),
    [((-500.0, 200.0), LOOKS, False), ((2.0, 3.0), LOOKS, True), ((2.0, 3.0), 0, True)],
    ids=['at their extremes', 'inside their range', 'since the start'],
)
def test_axes_that_repeat_one_value_while_another_one_moves_are_stuck(stays_at, since, fine):
    """One torque is 0 throughout, as of a sensor that has none."""
    watch = SensorWatch()
    noise = np.random.default_rng(0).normal(0, 1, (4 * LOOKS, 6)) * [1, 1, 1, 1, 1, 0]
    readings = RAW + (noise if fine else np.round(noise))
    readings[since:, 1:3] = stays_at
    look(watch, readings[:LOOKS])
    assert watch.stuck == ()
    look(watch, readings[LOOKS:])
    assert watch.stuck == ('force_y', 'force_z')
    assert not watch.frozen


@pytest.mark.parametrize(('step', 'found'), [(0.01, True), (0.5, False)])
def test_three_forces_that_hang_at_once_are_stuck_unless_their_steps_are_coarse(step, found):
    watch, noise = SensorWatch(), np.random.default_rng(0).normal(0, 0.3, (4 * LOOKS, 6))
    readings = np.round((RAW + noise) / step) * step
    readings[LOOKS:, :3] = np.round(np.array(RAW[:3]) / step) * step
    look(watch, readings)
    assert watch.stuck == (('force_x', 'force_y', 'force_z') if found else ())


@pytest.mark.parametrize('hanging', [slice(0, 3), slice(3, 6)], ids=['forces', 'torques'])
def test_what_hangs_since_the_start_is_stuck_once_a_load_moves_the_others(hanging):
    """Until then they may be coarse: nothing moved them. 20 N left a wrong force with all OK."""
    watch, noise = SensorWatch(), np.random.default_rng(0).normal(0, 1, (4 * LOOKS, 6))
    readings = RAW + noise * axis_limits(0.3)
    readings[2 * LOOKS :] += [0, 20, 0, 2, 0, 0]
    readings[:, hanging] = np.array(RAW)[hanging] + 1
    look(watch, readings[: 2 * LOOKS])
    assert watch.stuck == ()
    look(watch, readings[2 * LOOKS :])
    assert watch.stuck == AXES[hanging]


@pytest.mark.parametrize(
    ('whole', 'looks', 'share', 'soon'),
    [
        (True, 40, 2, 240),
        (True, 15, 2, 240),
        (False, 40, 2, 240),
        (False, 9, 2, 240),
        (False, 9, 4, 1000),
    ],
    ids=['frozen', 'held', 'long', 'short', 'seldom'],
)
def test_pulses_of_the_same_reading_are_found_by_their_share(whole, looks, share, soon):
    watch, rng = SensorWatch(), np.random.default_rng(0)
    found = []
    for _ in range(2 * soon // (share * looks)):
        readings = RAW + rng.normal(0, 1, (share * looks, 6))
        readings[-looks:, slice(None) if whole else 2] = 200.0
        for reading in readings:
            look(watch, reading)
            found.append(watch.frozen if whole else watch.stuck == ('force_z',))
    assert np.mean(found[soon:]) == 1.0


@pytest.mark.parametrize(
    ('free_n', 'now_n', 'moves', 'noise', 'found'),
    [
        (20.0, 0.0, 0.0, 0.1, 1), (0.8, 0.0, 0.0, 0.05, 1), (0.2, 0.0, 0.0, 0.1, 0),
        (20.0, 3.0, 0.0, 0.1, 0), (20.0, 0.0, 1.0, 0.1, 0), (20.0, 0.0, 0.0, 0.0, 0),
        (20.0, 0.0, 0.0, 0.8, 1), (20.0, 0.0, 6.0, 0.1, 0),
    ],
    ids=['zeroed', 'by less than 1 N', 'a load is let go', 'another load', 'in motion',
         'zeros of a broken sensor', 'of a noisy sensor', 'swings'],
)  # fmt: skip
def test_a_sensor_that_is_zeroed_by_its_driver_is_found_once(free_n, now_n, moves, noise, found):
    rng, scale = np.random.default_rng(1), np.array([1.0] * 3 + [0.1] * 3)
    readings = np.zeros((80, 6))
    readings[:40] = [20.0, -5.0, 3.0, 0.5, 0.1, 0.2]
    readings[40:, 1] = now_n
    readings[40:, 0] += moves * np.sin(np.arange(40) / 2)
    readings += noise * scale * rng.normal(size=(80, 6))
    watch, times = SensorWatch(), 0
    for reading in readings:
        look(watch, reading)
        tare = np.array([free_n, 0.0, 0.0, 0.0, 0.0, 0.0])
        times += bool(watch.zeroed(np.zeros(6), tare, 0.2 * scale / 3))
    assert times == found


@pytest.mark.parametrize(('rests_at_n', 'tared'), [(0.0, False), (0.0, True), (20.0, False)])
def test_a_contact_that_ends_where_the_reading_rested_at_zero_is_no_zeroing(rests_at_n, tared):
    """The driver zeroed the sensor in this pose, with a tool on it; ~/tare was in another one."""
    rng, scale, watch, times = np.random.default_rng(0), [1.0] * 3 + [0.1] * 3, SensorWatch(), 0
    for k, force_n in enumerate(np.repeat([rests_at_n, 20.0, 0.0], 40)):
        look(watch, np.append(force_n, np.zeros(5)) + 0.05 * rng.normal(size=6) * scale)
        tare = np.array([18.0 if tared and k >= 60 else 15.0, 0, 0, 0, 0, 0])
        times += bool(watch.zeroed(np.zeros(6), tare, 0.2 * np.array(scale) / 3))
    assert times == (rests_at_n > 0 or tared)


@pytest.mark.parametrize('every_s', [0, 15, 60])
def test_a_program_that_zeroes_in_each_cycle_is_found_before_much_drift_is_lost(every_s):
    """Drift of 0.2 N/min, noise of a common sensor, contacts between the zeroings; tared at 0."""
    rng, scale, watch = np.random.default_rng(0), np.array([1.0] * 3 + [0.1] * 3), SensorWatch()
    drift, zero, said_n = np.zeros(6), np.zeros(6), None
    for k in range(6000):
        drift[2] = 0.2 * k / 600
        if every_s and k % (10 * every_s) == 0:
            zero = drift + 0.005 * rng.normal(size=6) * scale
        touches = 20.0 * (50 < k % 150 < 100) * np.array([0.1, -0.2, -1.0, 0.02, 0.01, 0.0])
        look(watch, drift - zero + touches + 0.05 * rng.normal(size=6) * scale)
        if said_n is None and watch.zeroed(drift.copy(), np.zeros(6), 0.04 * scale):
            said_n = drift[2]
    assert (said_n is not None) == (every_s > 0)
    assert said_n is None or 0.15 < said_n < 0.4


@pytest.mark.parametrize(('step', 'looks'), [(1e-6, 1), (0.03, 1), (1e-6, 8)])
def test_a_sensor_with_coarse_steps_or_few_readings_lives(step, looks):
    watch, rng = SensorWatch(), np.random.default_rng(0)
    for reading in np.round(rng.normal(0.014, 0.01, (6000 // looks, 6)) / step) * step:
        for _ in range(looks):
            watch.look(reading.tolist())
            assert not watch.frozen
            assert not watch.stuck
