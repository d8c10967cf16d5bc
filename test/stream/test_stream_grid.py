"""The thermal grid as a stream, against the batch and in trouble."""

from itertools import pairwise
import math

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from wrist_ft_comp.signals import Samples, temperature_channel
from wrist_ft_comp.stream.batch_grid import grid_samples
from wrist_ft_comp.stream.drift_tracker import DriftTracker
from wrist_ft_comp.stream.stream_grid import ThermalGrid

SECOND = 1_000_000_000
FOREVER_S = 1e6


def feed(grid, stream):
    return [cells for sample in stream for cells in grid.add(*sample)]


def seconds(thermometer, *pairs):
    return [(thermometer, round(s * SECOND), value) for s, value in pairs]


def dense(completed):
    """One row per cell; the cells must follow each other without gap or overlap."""
    for before, after in pairwise(completed):
        assert after.first_cell == before.first_cell + before.count
    return (
        np.concatenate([np.tile(cells.temperature_c, (cells.count, 1)) for cells in completed]),
        np.concatenate([np.tile(cells.measured, (cells.count, 1)) for cells in completed]),
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
    tracker = DriftTracker(thermometers, SECOND, FOREVER_S, 1000.0)
    grid, completed = tracker.grid, feed(tracker, stream)
    usable = [
        [s for s in stream if s[0] == j and math.isfinite(s[2]) and s[2] != 1e6]
        for j in range(thermometers)
    ]
    assert grid.rejected == len(stream) - sum(map(len, usable))
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
    # All but the cells that a thermometer may still deliver to.
    ready = min(samples[-1][1] // SECOND for samples in usable) - batch.first_cell
    if ready <= 0:
        assert not completed
        return
    held_c, measured = dense(completed)
    assert completed[0].first_cell == batch.first_cell
    assert len(held_c) == ready
    np.testing.assert_array_equal(measured, batch.measured[:ready])
    np.testing.assert_allclose(held_c[measured], batch.temperature_c[:ready][measured], atol=1e-10)
    # On a line as far as its end has come.
    ended = ready - max(completed[-1].silent)
    bridged_c = tracker.history.temperature_c[: max(ended, 0)]
    np.testing.assert_allclose(bridged_c, batch.temperature_c[: len(bridged_c)], atol=1e-10)


@settings(deadline=None, max_examples=200, derandomize=True)
@given(drawn=streams(), patience_s=st.floats(0.1, 5.0))
def test_an_impatient_stream_still_gives_every_cell_once(drawn, patience_s):
    thermometers, stream = drawn
    grid = ThermalGrid(SECOND, thermometers, patience_s)
    completed = feed(grid, stream)
    assert len(grid._open) <= math.ceil(patience_s) + 1
    if completed:
        temperature_c, _ = dense(completed)
        assert np.isfinite(temperature_c).all()


def test_a_cell_is_complete_with_the_first_sample_of_the_next():
    grid = ThermalGrid(SECOND, 1, 5.0)
    assert not feed(grid, seconds(0, (0.2, 20.0), (0.999999999, 22.0)))
    (cells,) = grid.add(0, SECOND, 24.0)
    assert feed(grid, seconds(0, (2.2, 26.0), (3.2, 28.0))), 'which change nothing behind'
    assert (cells.first_cell, cells.count, cells.measured) == (0, 1, (True,))
    assert cells.temperature_c == pytest.approx([21.0])


def test_a_silent_thermometer_is_waited_for_and_then_held():
    grid = ThermalGrid(SECOND, 2, patience_s=3.0)
    assert not feed(grid, seconds(0, (0.5, 20.0)))
    assert not feed(grid, seconds(1, (0.5, 50.0)))
    assert not feed(grid, seconds(0, (1.5, 21.0), (2.5, 22.0), (3.5, 23.0)))
    (first,) = feed(grid, seconds(0, (4.5, 24.0)))
    assert first.temperature_c == pytest.approx([20.0, 50.0])
    (second,) = feed(grid, seconds(0, (5.5, 25.0)))
    assert second.temperature_c == pytest.approx([21.0, 50.0])
    assert second.measured == (True, False)
    back = feed(grid, seconds(1, (5.6, 50.8)))
    temperature_c, measured = dense([first, second, *back])
    np.testing.assert_allclose(temperature_c[2:], [[22, 50], [23, 50], [24, 50]])
    np.testing.assert_array_equal(measured[2:, 1], False)
    (last,) = feed(grid, seconds(0, (6.5, 26.0)) + seconds(1, (6.5, 52.0)))
    assert last.temperature_c == pytest.approx([25.0, 50.8])


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
    assert started[0].first_cell == first
    assert started[0].temperature_c == pytest.approx([20.0 + first, 5.0])


def test_samples_for_completed_cells_are_counted():
    grid = ThermalGrid(SECOND, 2, patience_s=1.0)
    feed(grid, seconds(0, (0.5, 20.0)) + seconds(1, (0.5, 20.0)))
    feed(grid, seconds(0, (9.5, 20.0)))
    assert not feed(grid, seconds(1, (3.5, 99.0), (4.5, 99.0)))
    assert grid.rejected == 2


@pytest.mark.parametrize('stamp_s', [5.5, 5.2, 1.5, 0.0])
def test_a_stamp_that_does_not_increase_is_counted(stamp_s):
    grid = ThermalGrid(SECOND, 1, 5.0)
    feed(grid, seconds(0, *((k + 0.5, 20.0) for k in range(6))))
    assert not feed(grid, seconds(0, (stamp_s, 99.0)))
    assert (grid.rejected, grid.restarts) == (1, 0)
    (cells,) = feed(grid, seconds(0, (6.5, 20.0)))
    assert cells.temperature_c == pytest.approx([20.0])


def test_time_that_ran_back_restarts_the_grid_there():
    grid = ThermalGrid(SECOND, 2, patience_s=5.0)
    both = [s for k in range(100, 120) for j in (0, 1) for s in seconds(j, (k + 0.5, 20.0 + j))]
    again = [s for k in range(10) for j in (0, 1) for s in seconds(j, (k + 0.5, 30.0 + j))]
    feed(grid, [*both, *again, *both])
    completed = feed(grid, again)
    assert grid.restarts == 2
    temperature_c, _ = dense(completed)
    assert completed[0].first_cell == 0
    np.testing.assert_allclose(temperature_c, np.tile([30.0, 31.0], (9, 1)))


def test_time_that_runs_back_in_the_first_cell_leaves_no_gap_in_temperatures():
    grid = ThermalGrid(SECOND, 2, patience_s=5.0)
    both = [s for k in range(10) for j in (0, 1) for s in seconds(j, (k + 0.5, 30.0 + j))]
    completed = feed(grid, [*seconds(0, (100.1, 20.0)), *seconds(1, (100.2, 21.0)), *both])
    temperature_c, _ = dense(completed)
    np.testing.assert_allclose(temperature_c, np.tile([30.0, 31.0], (9, 1)))


def test_a_huge_gap_gives_held_cells_in_one_piece():
    grid = ThermalGrid(SECOND, 1, 5.0)
    completed = feed(grid, seconds(0, (0.5, 20.0), (1e9, 30.0), (1e9 + 1, 31.0)))
    assert len(completed) == 3
    assert [cells.count for cells in completed] == [1, 10**9 - 1, 1]
    assert [float(cells.temperature_c[0]) for cells in completed] == [20.0, 20.0, 30.0]
    assert [cells.measured for cells in completed] == [(True,), (False,), (True,)]
    assert not grid._open or len(grid._open) == 1
