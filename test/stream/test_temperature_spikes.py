"""Temperatures that metal cannot have gone to: what counts, live and in blocks."""

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from wrist_ft_comp.stream.thermometer_faults import SpikeFilter

SECOND = 1_000_000_000
LONG = [20.0] * 300


def counted(values_c, step_s=1.0):
    spikes = SpikeFilter()
    stamps_ns = [round(k * step_s * SECOND) for k in range(len(values_c))]
    admitted = [spikes.admit(*pair) for pair in zip(stamps_ns, values_c, strict=True)]
    return [value_c for value_c, counts in zip(values_c, admitted, strict=True) if counts], spikes


@pytest.mark.parametrize(
    ('values_c', 'expected', 'dropped', 'jumps'),
    [
        ([85.0, 20.1, 20.2], [20.1, 20.2], 1, 0),
        ([85.0, 20.1, -40.0, 20.2], [20.1, 20.2], 2, 0),
        ([22.3, 24.6, 26.9, 29.2, *[29.2] * 50], [29.2] * 19, 35, 1),
        ([40.0] * 100, [40.0] * 11, 89, 1),
        ([85.0, 60.0, 60.1, 20.0], [20.0], 3, 0),
        ([0.0] * 80 + [20.0], [20.0], 80, 0),
    ],
    ids=['a spike', 'two', 'a fast ramp', 'a step', 'a loose contact', 'a bus error'],
)
def test_what_metal_cannot_have_gone_to_is_left_out(values_c, expected, dropped, jumps):
    found, spikes = counted(LONG + values_c)
    assert found == LONG + expected
    assert (spikes.dropped, spikes.jumps) == (dropped, jumps)
    assert spikes.first == (300 * SECOND, values_c[0])
    assert not spikes.leaves_out


def test_a_jump_is_told_while_a_model_remembers_it():
    for time_constant_s, told_s in ((0.0, 23), (600.0, 1381)):
        _, spikes = counted(LONG + [40.0] * 90)
        end_ns = 389 * SECOND
        assert spikes.remembered_k(end_ns + told_s * SECOND, time_constant_s) == 20.0
        assert spikes.remembered_k(end_ns + (told_s + 2) * SECOND, time_constant_s) == 0.0


@pytest.mark.parametrize('wrong_c', [0.0, 85.0])
@pytest.mark.parametrize('wrong_s', [1, 15])
def test_first_readings_are_wrong_where_others_agree_for_longer(wrong_c, wrong_s):
    right_c = 21.0 + np.arange(40) / 100
    found, spikes = counted([wrong_c] * wrong_s + right_c.tolist())
    assert found == [wrong_c] * wrong_s + right_c[wrong_s:].tolist()
    assert (spikes.wrong_starts, spikes.first) == (1, (0, wrong_c))
    blocks = SpikeFilter()
    _, found_c = blocks.admit_all(
        np.arange(wrong_s + 40) * SECOND, np.concatenate(([wrong_c] * wrong_s, right_c))
    )
    np.testing.assert_array_equal(found_c, right_c[wrong_s:])
    assert blocks.dropped == spikes.dropped == 2 * wrong_s


def test_a_slow_thermometer_may_go_far_between_its_samples():
    assert counted([20.0, 70.0, 20.0], step_s=300.0)[0] == [20.0, 70.0, 20.0]


def test_a_clock_that_was_set_is_no_time_in_which_metal_can_go_anywhere():
    _, spikes = counted(LONG)
    spikes.shift_ns = 10**6 * SECOND
    assert not spikes.admit((10**6 + 301) * SECOND, 85.0)
    assert spikes.admit((10**6 + 302) * SECOND, 20.0)


@settings(deadline=None, derandomize=True)
@given(
    steps=st.lists(st.tuples(st.integers(1, 9 * SECOND), st.floats(-50, 150)), max_size=40),
    cuts=st.sets(st.integers(1, 39)),
)
def test_blocks_of_any_size_give_what_samples_one_by_one_give(steps, cuts):
    one, many = SpikeFilter(), SpikeFilter()
    stamps_ns = np.cumsum([0, *(step for step, _ in steps)])[1:]
    values_c = np.array([value_c for _, value_c in steps], dtype=float)
    expected, found = [], []
    for pair in zip(stamps_ns.tolist(), values_c.tolist(), strict=True):
        starts = one.wrong_starts
        counts = one.admit(*pair)
        expected = ([] if one.wrong_starts > starts else expected) + [pair] * counts
    ends = [*sorted(cut for cut in cuts if cut < len(steps)), len(steps)]
    for begin, end in zip([0, *ends[:-1]], ends, strict=True):
        if end > begin:
            starts = many.wrong_starts
            taken = many.admit_all(stamps_ns[begin:end], values_c[begin:end])
            found = [] if many.wrong_starts > starts else found
            found += zip(*(part.tolist() for part in taken), strict=True)
    assert found == expected
    assert (many.dropped, many.first) == (one.dropped, one.first)
