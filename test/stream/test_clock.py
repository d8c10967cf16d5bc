"""Stamps that leap: one stray is dropped, a new time is followed; arrival shows what passed."""

from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

from wrist_ft_comp.stream.clock import APART_FOR_S, ClockComparison, Sample, SourceClocks

SECOND = 1_000_000_000
HOUR = 3600 * SECOND


def make(sources=1):
    return SourceClocks(sources)


def feed(clocks, stamps, source=0):
    samples = [Sample(source, stamp, 20.0) for stamp in stamps]
    return [given.stamp_ns for sample in samples for given in clocks.admit(sample)]


@settings(max_examples=200, derandomize=True)
@given(steps=st.lists(st.integers(-5 * SECOND, 60 * SECOND), min_size=1, max_size=50))
def test_steps_that_are_no_leaps_pass_at_once_if_they_are_later(steps):
    clocks, last = make(), 0
    feed(clocks, [0])
    for step in steps:
        assert feed(clocks, [last + step]) == ([last + step] if step > 0 else [])
        last += max(step, 0)
    assert (clocks.rejected, clocks.leaps) == (sum(step <= 0 for step in steps), 0)


START = [k * SECOND for k in range(5)]
GOES_ON = [k * SECOND for k in range(5, 10)]


@pytest.mark.parametrize('leap', [90 * SECOND, 5 * HOUR, -90 * SECOND, -5 * HOUR, -20 * SECOND])
@pytest.mark.parametrize(
    ('strays', 'followed', 'leaps'),
    [
        ([1.0], [], 0),  # one stray, or two
        ([2.0, 1.0], [], 0),
        ([], [1.0], 1),  # a leap, and a stray ahead of it
        ([2.0], [1.0], 1),
        ([], [1.0, 0.0], 2),  # there and back
        ([2.0], [1.0, 0.0], 2),
    ],
)
def test_strays_are_dropped_and_time_going_on_elsewhere_is_followed(leap, strays, followed, leaps):
    if abs(leap) < 60 * SECOND and (strays or len(followed) != 1):
        return  # back is a leap from 5 s on, ahead from 60 s on
    clocks, dropped = make(), 0
    assert feed(clocks, START) == START
    for share in followed or [0.0]:
        offset = round(share * leap)
        sent = [3 * SECOND + round(stray * leap) for stray in strays]
        moved = [offset + stamp for stamp in GOES_ON]
        assert feed(clocks, [*sent, *moved]) == moved
        dropped += len(strays)
        assert clocks.rejected == dropped
    assert clocks.leaps == leaps


@pytest.mark.parametrize(
    ('before', 'step_s', 'heard'),
    [(1, 100, [1, 0, 2, 1, 1, 1]), (5, 100, [1] * 5 + [0, 2, 1, 1])],
    ids=['slow', 'becomes slow'],
)
def test_a_slow_thermometer_is_heard_with_all_its_samples(before, step_s, heard):
    clocks = make()
    stamps = [k * SECOND for k in range(before)]
    stamps += [(before - 1 + k * step_s) * SECOND for k in range(1, len(heard) - before + 1)]
    assert [len(feed(clocks, [stamp])) for stamp in stamps] == heard
    assert clocks.rejected == 0


def test_a_thermometer_that_comes_back_is_no_clock_that_was_set():
    """Though its stamps leap, and arrival shows nothing of it, as where a bag is played fast."""
    clocks = make(2)
    for second in range(0, 900, 10):
        for source in range(1 if 30 < second < 800 else 2):
            clocks.admit(Sample(source, second * SECOND, 20.0, second * SECOND // 1000))
            assert clocks.leap is None
    assert (clocks.rejected, clocks.leaps) == (0, 1)


def compare(wrench_s, source_s, seconds, comparison=None, first=0):
    """Send a wrench and a sample of a source every second, whose clocks are ahead by so much."""
    comparison = comparison or ClockComparison()
    for second in range(first, first + seconds):
        now = second * SECOND
        comparison.note_wrench(now + round(wrench_s * SECOND), now)
        comparison.note('/t', now + round(source_s * SECOND), now + SECOND // 10, 2.0)
    return comparison


@pytest.mark.parametrize(
    ('wrench_s', 'source_s', 'ahead_s'),
    [(0, 1800, 1799.9), (1800, 0, -1800.1), (7200, 7200, None), (0, 2.0, None), (0, 2.2, 2.1)],
)
def test_two_clocks_are_told_by_stamps_and_arrival(wrench_s, source_s, ahead_s):
    assert compare(wrench_s, source_s, round(APART_FOR_S)).ahead_s == {}
    found = compare(wrench_s, source_s, round(APART_FOR_S) + 1).ahead_s
    assert found == ({} if ahead_s is None else {'/t': pytest.approx(ahead_s)})


def test_clocks_that_leap_together_are_one_and_one_that_is_set_right_is_too():
    comparison = compare(0, 0, 100)
    assert compare(3600, 3600, 100, comparison, 100).ahead_s == {}
    assert compare(3600, 0, 100, comparison, 200).ahead_s
    assert compare(3600, 3600, 1, comparison, 300).ahead_s == {}
    comparison.note('/t', 0, 400 * SECOND, 2.0)
    comparison.note('/t', 0, 500 * SECOND, 2.0)
    assert comparison.ahead_s == {}, 'the last wrench is long ago'
