"""The thermal grid as a stream, against the batch and in trouble."""

from itertools import pairwise
import math

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from wrist_ft_comp.channels import temperature_channel
from wrist_ft_comp.recording import Samples
from wrist_ft_comp.stream.batch_grid import grid_samples
from wrist_ft_comp.stream.clock import Sample
from wrist_ft_comp.stream.drift_tracker import DriftTracker
from wrist_ft_comp.stream.stream_grid import ThermalGrid
from wrist_ft_comp.stream.thermal_memory import OUTAGE_S, reporting_cells

SECOND = 1_000_000_000


def feed(grid, stream):
    return [cells for sample in stream for cells in grid.add(*sample)]


def feed_tracker(tracker, stream):
    return [cells for sample in stream for cells in tracker.add(Sample(*sample))]


def seconds(thermometer, *pairs):
    return [(thermometer, round(s * SECOND), value) for s, value in pairs]


def table(completed):
    """Numbers, temperatures and who was heard, one row per cell; the numbers ascend."""
    numbers = [cell.number for cell in completed]
    assert all(before < after for before, after in pairwise(numbers))
    return (
        np.array(numbers),
        np.array([cell.temperature_c for cell in completed]),
        np.array([cell.measured for cell in completed]),
    )


@st.composite
def streams(draw):
    """Samples of one to three thermometers in order of time, with gaps and with faults."""
    thermometers = draw(st.integers(1, 3))
    step = st.one_of(st.integers(1, SECOND), st.integers(SECOND, 9 * SECOND))
    value = st.one_of(st.floats(19, 21), st.sampled_from([20.0, math.nan, math.inf]))
    drawn = draw(st.lists(st.tuples(st.integers(0, thermometers - 1), step, value), max_size=80))
    stamp, stream = draw(st.integers(0, 3 * SECOND)), []
    for thermometer, wait, temperature in drawn:
        stamp += wait
        stream.append((thermometer, stamp, temperature))
        if temperature == 20.0:
            stream.append((thermometer, stamp, 1e6))  # a stamp twice
    return thermometers, stream


@settings(deadline=None, max_examples=300, derandomize=True)
@given(drawn=streams())
def test_the_stream_gives_what_the_batch_gives(drawn):
    thermometers, stream = drawn
    tracker = DriftTracker(thermometers, SECOND, OUTAGE_S, 1000.0)
    completed = feed_tracker(tracker, stream)
    usable = [
        [s for s in stream if s[0] == j and math.isfinite(s[2]) and s[2] != 1e6]
        for j in range(thermometers)
    ]
    assert tracker.clocks.rejected == len(stream) - sum(map(len, usable))
    if not all(usable):
        assert not completed
        return
    blocks = [
        Samples(
            (temperature_channel(j),),
            np.array([stamp for number, stamp, _ in stream if number == j]),
            np.array([[value] for number, _, value in stream if number == j]),
        )
        for j in range(thermometers)
    ]
    wrench = Samples(('force_x',), blocks[0].stamps_ns[:1], np.zeros((1, 1)))
    batch = grid_samples([*blocks, wrench], max_bad_share=1.0)
    if not completed:
        return
    numbers, held_c, measured = table(completed)
    rows = numbers - batch.first_cell
    assert numbers[0] == batch.first_cell
    reported = reporting_cells(batch.measured, SECOND)
    np.testing.assert_array_equal(rows, reported[: len(rows)])
    # All but the cells that a thermometer may still deliver to.
    ready = min(samples[-1][1] // SECOND for samples in usable) - batch.first_cell
    assert np.count_nonzero(reported < ready) <= len(rows)
    np.testing.assert_array_equal(measured, batch.measured[rows])
    np.testing.assert_allclose(held_c, batch.temperature_c[rows], atol=1e-10)
    bridged_c = tracker.history_c
    np.testing.assert_allclose(bridged_c, batch.temperature_c[: len(bridged_c)], atol=1e-10)
    assert len(bridged_c) == rows[-1] + 1


@settings(deadline=None, max_examples=200, derandomize=True)
@given(drawn=streams(), patience_s=st.floats(0.1, 5.0))
def test_an_impatient_stream_still_gives_every_cell_once(drawn, patience_s):
    thermometers, stream = drawn
    tracker = DriftTracker(thermometers, SECOND, patience_s, 1000.0)
    completed = feed_tracker(tracker, stream)
    assert len(tracker.grid._open) <= math.ceil(patience_s) + 1
    if completed:
        assert np.isfinite(table(completed)[1]).all()


@pytest.mark.parametrize(
    ('patience_s', 'cells'), [(0.0, 1), (0.1, 1), (1.0, 1), (1.1, 2), (3.0, 3)]
)
def test_a_silent_thermometer_holds_the_others_up_for_its_patience(patience_s, cells):
    grid = ThermalGrid(SECOND, 2, patience_s)
    feed(grid, seconds(0, (0.5, 20.0)) + seconds(1, (0.5, 50.0)))
    emitted = [len(feed(grid, seconds(0, (k + 0.5, 20.0)))) for k in range(1, 6)]
    assert emitted == [0] * cells + [1] * (5 - cells)


@pytest.mark.parametrize(('second', 'first'), [(1999.6, 1999), (1990.6, 1996)])
def test_a_thermometer_that_never_reported_is_waited_for_without_hoarding(second, first):
    grid = ThermalGrid(SECOND, 2, patience_s=3.0)
    assert not feed(grid, seconds(0, *((k + 0.5, 20.0 + k) for k in range(2000))))
    assert len(grid._open) < 100
    late = [*seconds(1, (second, 5.0)), *seconds(0, (2000.5, 2020.0)), *seconds(1, (2000.5, 5.0))]
    started = feed(grid, late)
    assert started[0].number == first
    assert started[0].temperature_c == pytest.approx([20.0 + first, 5.0])


def test_samples_for_completed_cells_are_counted():
    grid = ThermalGrid(SECOND, 2, patience_s=1.0)
    feed(grid, seconds(0, (0.5, 20.0)) + seconds(1, (0.5, 20.0)))
    feed(grid, seconds(0, *((k + 0.5, 20.0) for k in range(1, 10))))
    assert not feed(grid, seconds(1, (3.5, 99.0), (4.5, 99.0)))
    assert grid.rejected == 2


@pytest.mark.parametrize(('back_s', 'number', 'last_c'), [(1.0, 31, 52.0), (9.0, 30, 50.0)])
def test_after_an_outage_the_others_are_waited_for_with_patience(back_s, number, last_c):
    """As at the start; one that stays away is held."""
    grid = ThermalGrid(SECOND, 2, patience_s=3.0)
    feed(grid, seconds(0, (0.5, 20.0)) + seconds(1, (0.5, 50.0)))
    both = [*seconds(0, *((30.5 + k, 30.0 + k) for k in range(20)))]
    both += seconds(1, *((30.7 + back_s + k, 52.0) for k in range(20)))
    before, first, *_ = feed(grid, sorted(both, key=lambda sample: sample[1]))
    assert before.number == 0
    assert first.number == number
    assert first.temperature_c == pytest.approx([number, last_c])
