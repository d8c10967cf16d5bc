"""Stamps that leap: one stray is dropped, a new time is followed."""

from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

from wrist_ft_comp.core.leap_guard import LeapGuard

SECOND = 1_000_000_000
HOUR = 3600 * SECOND


def feed(guard: LeapGuard, stamps: list[int]) -> list[int]:
    return [sample[1] for stamp in stamps for sample in guard.admit(0, stamp, 20.0)]


@settings(deadline=None, max_examples=200, derandomize=True)
@given(steps=st.lists(st.integers(-30 * SECOND, 60 * SECOND), min_size=1, max_size=50))
def test_steps_that_are_no_leaps_pass_at_once(steps: list[int]) -> None:
    guard, stamp = LeapGuard(1), 0
    for step in steps:
        stamp += step
        assert guard.admit(0, stamp, 1.5) == [(0, stamp, 1.5)]
    assert (guard.strays, guard.leaps) == (0, 0)


@pytest.mark.parametrize('leap', [90 * SECOND, 5 * HOUR, -90 * SECOND, -5 * HOUR])
def test_one_stray_stamp_is_dropped(leap: int) -> None:
    guard = LeapGuard(1)
    stamps = [k * SECOND for k in range(10_000, 10_010)]
    stray = stamps[4] + leap
    assert feed(guard, [*stamps[:5], stray, *stamps[5:]]) == stamps
    assert (guard.strays, guard.leaps) == (1, 0)


@pytest.mark.parametrize('leap', [90 * SECOND, 5 * HOUR, -90 * SECOND, -5 * HOUR])
def test_time_that_goes_on_from_there_is_followed(leap: int) -> None:
    guard = LeapGuard(1)
    stamps = [k * SECOND for k in range(20_000, 20_010)]
    there = [stamp + leap for stamp in stamps]
    assert feed(guard, stamps[:5] + there[5:]) == stamps[:5] + there[5:]
    assert (guard.strays, guard.leaps) == (0, 1)


def test_a_slow_thermometer_is_heard_sample_by_sample() -> None:
    """Samples 100 s apart, or a simulation that is hundreds of times as fast as the clock."""
    guard = LeapGuard(1)
    heard = [len(guard.admit(0, k * 100 * SECOND, 20.0)) for k in range(10)]
    assert heard == [1, 0, 2, 1, 1, 1, 1, 1, 1, 1]
    assert (guard.strays, guard.leaps) == (0, 0)


@pytest.mark.parametrize('gap_s', [10, 100, 5000])
def test_a_slow_thermometer_does_not_leap_after_a_restart(gap_s: int) -> None:
    guard = LeapGuard(1)
    guard.expect(HOUR)
    stamps = [HOUR + (gap_s + 100 * k) * SECOND for k in range(10)]
    assert feed(guard, stamps) == stamps
    assert (guard.strays, guard.leaps) == (0, 0)


def test_two_rising_strays_are_no_new_clock() -> None:
    guard = LeapGuard(1)
    stamps = [k * SECOND for k in range(10)]
    assert feed(guard, [*stamps[:5], 5 * HOUR, 9 * HOUR, *stamps[5:]]) == stamps
    assert (guard.strays, guard.leaps) == (2, 0)


def test_a_stray_ahead_of_a_leap_is_dropped() -> None:
    guard = LeapGuard(1)
    stamps = [*(k * SECOND for k in range(5)), *(9 * HOUR + k * SECOND for k in range(5))]
    assert feed(guard, [*stamps[:5], 5 * HOUR, *stamps[5:]]) == stamps
    assert (guard.strays, guard.leaps) == (1, 1)


@pytest.mark.parametrize('step_s', [100, 1000])
def test_a_thermometer_that_becomes_slow_is_heard_with_all_its_samples(step_s: int) -> None:
    guard = LeapGuard(1)
    stamps = [k * SECOND for k in range(5)]
    stamps += [(4 + k * step_s) * SECOND for k in range(1, 10)]
    assert feed(guard, stamps) == stamps
    assert (guard.strays, guard.leaps) == (0, 1)


def test_thermometers_do_not_confirm_each_other() -> None:
    guard = LeapGuard(2)
    for second in range(5):
        guard.admit(0, second * SECOND, 20.0)
        guard.admit(1, second * SECOND, 30.0)
    assert guard.admit(0, HOUR, 21.0) == []
    assert guard.admit(1, HOUR + SECOND, 31.0) == []
    assert guard.admit(0, 5 * SECOND, 22.0) == [(0, 5 * SECOND, 22.0)]


def test_strays_that_differ_are_all_dropped() -> None:
    guard = LeapGuard(1)
    assert feed(guard, [0, SECOND, 9 * HOUR, 5 * HOUR, HOUR, 2 * SECOND]) == [
        0,
        SECOND,
        2 * SECOND,
    ]
    assert guard.strays == 3


@pytest.mark.parametrize('leap', [5 * HOUR, -5 * HOUR])
def test_a_first_sample_far_from_where_stamps_ended_is_kept_back(leap: int) -> None:
    guard = LeapGuard(1)
    guard.expect(9 * HOUR)
    assert feed(guard, [9 * HOUR + leap, 9 * HOUR + SECOND]) == [9 * HOUR + SECOND]
    assert guard.strays == 1
    follows = LeapGuard(1)
    follows.expect(9 * HOUR)
    there = [9 * HOUR + leap, 9 * HOUR + leap + SECOND]
    assert feed(follows, there) == there
    assert follows.leaps == 0, 'a restart is no leap'
