"""Stamps that leap: one stray is dropped, a new time is followed."""

from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

from wrist_ft_comp.stream.timestamp_filter import TimestampFilter

SECOND = 1_000_000_000
HOUR = 3600 * SECOND


def feed(timestamps, stamps):
    return [sample[1] for stamp in stamps for sample in timestamps.admit(0, stamp, 20.0)]


@settings(deadline=None, max_examples=200, derandomize=True)
@given(steps=st.lists(st.integers(-30 * SECOND, 60 * SECOND), min_size=1, max_size=50))
def test_steps_that_are_no_leaps_pass_at_once(steps):
    timestamps, stamp = TimestampFilter(1), 0
    for step in steps:
        stamp += step
        assert timestamps.admit(0, stamp, 1.5) == [(0, stamp, 1.5)]
    assert (timestamps.strays, timestamps.leaps) == (0, 0)


START = [k * SECOND for k in range(5)]
GOES_ON = [k * SECOND for k in range(5, 10)]


@pytest.mark.parametrize('leap', [90 * SECOND, 5 * HOUR, -90 * SECOND, -5 * HOUR])
@pytest.mark.parametrize(
    ('strays', 'followed', 'leaps'),
    [
        ([1.0], [], 0),  # one stray, two that rise, two that do not
        ([1.0, 1.8], [], 0),
        ([2.0, 1.0], [], 0),
        ([], [1.0], 1),  # a leap, and a stray ahead of it
        ([2.0], [1.0], 1),
        ([], [1.0, 0.0], 2),  # there and back
        ([2.0], [1.0, 0.0], 2),
    ],
)
def test_strays_are_dropped_and_time_that_goes_on_elsewhere_is_followed(
    leap, strays, followed, leaps
):
    """Times are shares of the leap; those that are followed go on for five samples."""
    timestamps, dropped = TimestampFilter(1), 0
    assert feed(timestamps, START) == START
    for share in followed or [0.0]:
        offset = round(share * leap)
        sent = [3 * SECOND + round(stray * leap) for stray in strays]
        moved = [offset + stamp for stamp in GOES_ON]
        assert feed(timestamps, [*sent, *moved]) == moved
        dropped += len(strays)
        assert timestamps.strays == dropped
    assert timestamps.leaps == leaps


def test_a_slow_thermometer_is_heard_sample_by_sample():
    """Samples 100 s apart, or a simulation that is hundreds of times as fast as the clock."""
    timestamps = TimestampFilter(1)
    heard = [len(timestamps.admit(0, k * 100 * SECOND, 20.0)) for k in range(10)]
    assert heard == [1, 0, 2, 1, 1, 1, 1, 1, 1, 1]
    assert (timestamps.strays, timestamps.leaps) == (0, 0)


@pytest.mark.parametrize('gap_s', [10, 100, 5000])
def test_a_slow_thermometer_does_not_leap_after_a_restart(gap_s):
    timestamps = TimestampFilter(1)
    timestamps.expect(HOUR)
    stamps = [HOUR + (gap_s + 100 * k) * SECOND for k in range(10)]
    assert feed(timestamps, stamps) == stamps
    assert (timestamps.strays, timestamps.leaps) == (0, 0)


@pytest.mark.parametrize('step_s', [100, 1000])
def test_a_thermometer_that_becomes_slow_is_heard_with_all_its_samples(step_s):
    timestamps = TimestampFilter(1)
    stamps = [k * SECOND for k in range(5)]
    stamps += [(4 + k * step_s) * SECOND for k in range(1, 10)]
    heard = [feed(timestamps, [stamp]) for stamp in stamps]
    assert [stamp for passed in heard for stamp in passed] == stamps
    assert [len(passed) for passed in heard] == [1] * 5 + [0, 0, 3] + [1] * 6
    assert (timestamps.strays, timestamps.leaps) == (0, 1)


def test_thermometers_do_not_confirm_each_other():
    timestamps = TimestampFilter(2)
    for second in range(5):
        timestamps.admit(0, second * SECOND, 20.0)
        timestamps.admit(1, second * SECOND, 30.0)
    assert timestamps.admit(0, HOUR, 21.0) == []
    assert timestamps.admit(1, HOUR + SECOND, 31.0) == []
    assert timestamps.admit(0, 5 * SECOND, 22.0) == [(0, 5 * SECOND, 22.0)]


@pytest.mark.parametrize('leap', [5 * HOUR, -5 * HOUR])
def test_a_first_sample_far_from_where_stamps_ended_is_kept_back(leap):
    timestamps = TimestampFilter(1)
    timestamps.expect(9 * HOUR)
    assert feed(timestamps, [9 * HOUR + leap, 9 * HOUR + SECOND]) == [9 * HOUR + SECOND]
    assert timestamps.strays == 1
    follows = TimestampFilter(1)
    follows.expect(9 * HOUR)
    moved = [9 * HOUR + leap, 9 * HOUR + leap + SECOND]
    assert feed(follows, moved) == moved
    assert follows.leaps == 0, 'a restart is no leap'
