"""Temperatures that stand alone: what counts, live and in blocks."""

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from wrist_ft_comp.stream.temperature_spikes import SpikeFilter

SECOND = 1_000_000_000


def counted(values_c, step_s=1.0):
    spikes = SpikeFilter()
    samples = [
        sample
        for k, value_c in enumerate(values_c)
        for sample in spikes.admit(round(k * step_s * SECOND), value_c)
    ]
    return [value_c for _, value_c in samples], spikes


@pytest.mark.parametrize(
    ('values_c', 'expected', 'dropped'),
    [
        ([20.0, 85.0, 20.1, 20.2], [20.0, 20.1, 20.2], 1),
        ([20.0, 85.0, 20.1, -40.0, 20.2], [20.0, 20.1, 20.2], 2),
        ([20.0, 22.3, 24.6, 26.9, 29.2], [20.0, 22.3, 24.6, 26.9, 29.2], 0),
        ([20.0, 20.1, 40.0, 40.1], [20.0, 20.1, 40.0, 40.1], 0),
        ([20.0, 85.0, 60.0, 60.1], [20.0, 85.0, 60.0, 60.1], 0),
        ([20.0, 20.1, 85.0], [20.0, 20.1], 0),
    ],
    ids=['a spike', 'two', 'a fast ramp', 'a step', 'a loose contact', 'nothing behind it'],
)
def test_what_metal_cannot_have_gone_to_and_from_is_dropped(values_c, expected, dropped):
    found, spikes = counted(values_c)
    assert (found, spikes.dropped) == (expected, dropped)
    assert spikes.first == ((SECOND, 85.0) if dropped else None)


@pytest.mark.parametrize('first_c', [0.0, 85.0])
def test_a_first_reading_against_two_is_left_out_of_a_file(first_c):
    values_c = np.array([first_c, 21.0, 21.1, 21.2])
    spikes = SpikeFilter()
    _, found_c = spikes.admit_all(np.arange(4) * SECOND, values_c)
    assert found_c.tolist() == [21.0, 21.1, 21.2]
    assert (spikes.dropped, spikes.first) == (1, (0, first_c))


def test_a_slow_thermometer_may_go_far_between_its_samples():
    assert counted([20.0, 70.0, 20.0], step_s=300.0)[0] == [20.0, 70.0, 20.0]


@settings(deadline=None, derandomize=True)
@given(
    steps=st.lists(st.tuples(st.integers(1, 9 * SECOND), st.floats(-50, 150)), max_size=40),
    cuts=st.sets(st.integers(1, 39)),
)
def test_blocks_of_any_size_give_what_samples_one_by_one_give(steps, cuts):
    one, many = SpikeFilter(), SpikeFilter()
    stamps_ns = np.cumsum([0, *(step for step, _ in steps)])[1:]
    values_c = np.array([value_c for _, value_c in steps], dtype=float)
    expected = [
        sample
        for pair in zip(stamps_ns.tolist(), values_c.tolist(), strict=True)
        for sample in one.admit(*pair)
    ]
    found = []
    ends = [*sorted(cut for cut in cuts if cut < len(steps)), len(steps)]
    for begin, end in zip([0, *ends[:-1]], ends, strict=True):
        if end > begin:
            taken = many.admit_all(stamps_ns[begin:end], values_c[begin:end])
            found += zip(*(part.tolist() for part in taken), strict=True)
    # A first one that stood alone was given before the next two came, or not at all.
    assert [s for s in found if s != one.first] == [s for s in expected if s != one.first]
    assert (many.dropped, many.first) == (one.dropped, one.first)
