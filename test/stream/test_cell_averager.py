import math

import numpy as np
import pytest

from wrist_ft_comp.recording import Samples
from wrist_ft_comp.stream.batch_grid import grid_samples
from wrist_ft_comp.stream.clock import Sample
from wrist_ft_comp.stream.drift_tracker import DriftTracker
from wrist_ft_comp.stream.stream_grid import CellAverager, row_channels, ThermalCell

SECOND = 1_000_000_000
NAN = math.nan


class Node:
    """Feeds a tracker and an averager as the node does."""

    def __init__(self, thermometers=1, patience_s=3.0):
        self.tracker = DriftTracker(thermometers, SECOND, patience_s, 10.0)
        self.averager = CellAverager(SECOND, thermometers)

    def heat(self, at_s, *celsius):
        for j, value in enumerate(celsius):
            if value is not None:
                self.averager.add_cells(self.tracker.add(Sample(j, round(at_s * SECOND), value)))

    def raw(self, at_s, value):
        self.averager.add_raw(round(at_s * SECOND), [value] * 6)

    def reference(self, at_s, value):
        self.averager.add_reference(round(at_s * SECOND), [value] * 6)


def cells(rows):
    """Cell, force_x, reference_force_x and temperatures of each row."""
    return [(stamp // SECOND, row[0], row[6], *row[12:]) for stamp, row in rows]


def test_a_row_waits_for_wrenches_of_a_later_cell_and_for_references_once_there_is_one():
    node = Node()
    node.raw(0.2, 1.0)
    node.heat(0.5, 20.0)
    node.heat(1.5, 21.0)
    node.raw(0.9, 3.0)
    assert node.averager.rows() == []
    node.raw(1.0, 9.0)
    np.testing.assert_equal(cells(node.averager.rows()), [(0, 2.0, NAN, 20.0)])
    node.reference(1.1, 5.0)
    node.heat(2.5, 22.0)
    node.raw(2.5, 2.0)
    assert node.averager.rows() == []
    node.reference(1.9, 7.0)
    node.reference(2.1, 0.0)
    np.testing.assert_equal(cells(node.averager.rows()), [(1, 9.0, 6.0, 21.0)])


@pytest.mark.parametrize('other', [25.0, None])
def test_a_held_temperature_is_not_written_as_measured(other):
    node = Node(thermometers=2)
    node.heat(0.5, 20.0, 26.0)
    for second in range(1, 12):
        node.raw(second, 1.0)
        node.heat(second + 0.5, 20.0, other)
    rows = cells(node.averager.rows(final=True))
    expected = NAN if other is None else other
    np.testing.assert_equal(rows[1], (1, 1.0, NAN, 20.0, expected))


def test_a_gap_in_everything_leaves_no_empty_rows():
    node = Node()
    for second in (0, 1, 100_000, 100_001):
        node.raw(second + 0.1, 1.0)
        node.heat(second + 0.2, 20.0)
    rows = cells(node.averager.rows(final=True))
    assert [row[0] for row in rows] == [0, 1, 100_000]


def as_read(rows):
    """The recording that a reader makes of one axis, its reference and the temperature."""
    stamps = np.array([stamp for stamp, _ in rows])
    table = np.array([values for _, values in rows])
    blocks = []
    for channel, column in (('force_x', 0), ('reference_force_x', 6), ('temperature_c', 12)):
        filled = ~np.isnan(table[:, column])
        blocks.append(Samples((channel,), stamps[filled], table[filled, column : column + 1]))
    return grid_samples(blocks)


@pytest.mark.parametrize('silent', [(3, 15), (300, 2500), (300, 2000)])
def test_nothing_is_lost_and_nothing_piles_up_while_a_thermometer_is_silent(silent):
    node, rows, expected, kept = Node(), [], [], []
    for second in range(2600):
        wrench, reference = float(second % 7), float(second % 11)
        celsius = 20.0 + second / 100
        heard = not silent[0] <= second < silent[1]
        stamp = second * SECOND + SECOND // 2
        node.raw(second + 0.1, wrench)
        node.reference(second + 0.1, reference)
        if heard:
            node.heat(second + 0.2, celsius)
        rows += node.averager.rows()
        kept.append(len(node.averager._cells))
        expected.append((stamp, [wrench] * 6 + [reference] * 6 + [celsius if heard else NAN]))
    assert max(kept) <= 600
    rows += node.averager.rows(final=True)
    seen, whole = as_read(rows), as_read(expected[:-1])
    for part in ('wrench', 'reference', 'temperature_c', 'measured'):
        np.testing.assert_array_equal(getattr(seen, part), getattr(whole, part))
    assert seen.warnings == ()


@pytest.mark.parametrize('behind_s', [-100_000, 100_000])
def test_a_reference_of_another_clock_does_not_pile_up_without_temperatures(behind_s):
    node, rows = Node(), []
    for second in range(100_000, 101_000):
        node.raw(second + 0.1, 1.0)
        node.reference(second - behind_s + 0.1, 1.0)
        rows += node.averager.rows()
        assert len(node.averager._cells) <= 600
    expected = [(at, 1.0, NAN, NAN) for at in range(100_000, 100_400)]
    np.testing.assert_equal(cells(rows), expected)


def test_a_wrench_that_comes_after_its_row_is_dropped_and_one_for_the_next_is_not():
    node = Node()
    for second in range(700):
        node.raw(second + 0.1, 1.0)
    assert [row[0] for row in cells(node.averager.rows())] == list(range(100))
    node.raw(99.5, 9.0)
    node.raw(100.5, 3.0)
    node.raw(700.5, 1.0)
    np.testing.assert_equal(cells(node.averager.rows()), [(100, 2.0, NAN, NAN)])


def test_wrenches_before_the_first_temperature_are_left_out():
    node = Node()
    for second in (-1e6, 8, 9, 10, 11):
        node.raw(second + 0.1, 1.0)
    for second in (10, 11):
        node.heat(second + 0.2, 20.0)
    assert [row[0] for row in cells(node.averager.rows(final=True))] == [10]


def test_specific_force_is_a_mean_and_speed_of_rotation_a_root_mean_square():
    averager, rows = CellAverager(SECOND, 1, with_force=True), []
    assert row_channels(1, with_force=True)[-5:] == (
        'temperature_c',
        *(f'linear_acceleration_{axis}' for axis in 'xyz'),
        'rotation_speed',
    )
    for cell, force, speed in ((5, 9.0, 3.0), (5, 11.0, None), (5, 10.0, 4.0), (6, 8.0, None)):
        averager.add_force(cell * SECOND, (0.0, 1.0, force), speed)
        averager.add_raw(cell * SECOND, [1.0] * 6)
    for cell in (5, 6, 7):
        averager.add_cells([ThermalCell(cell, np.array([20.0]), (0,))])
        rows += averager.rows()
    rows += averager.rows(final=True)
    np.testing.assert_allclose(rows[0][1][-5:], [20, 0, 1, 10, math.sqrt(12.5)])
    np.testing.assert_allclose(rows[1][1][-5:], [20, 0, 1, 8, NAN])
    np.testing.assert_allclose(rows[2][1][-5:], [20, NAN, NAN, NAN, NAN])


@pytest.mark.parametrize('late_s', [0.0, 2.5])
def test_a_time_that_begins_anew_goes_on_being_averaged(late_s):
    """Also where wrenches come some cells after their temperatures, and after a stray stamp."""
    node, rows, sent = Node(), [], []
    for second in (*range(100, 110), *range(150)):
        node.heat(second + 0.2, 20.0)
        sent += [(second + 0.1, float(second)), (second + 0.6, second + 1.0)]
        while sent and sent[0][0] <= second - late_s + 0.7:
            node.raw(*sent.pop(0))
        if second == 30:
            node.raw(1e6, 0.0)
        rows += node.averager.rows()
        sent = [wrench for wrench in sent if wrench[0] <= second + 1]  # of the time before
    seen = {row[0]: row[1] for row in cells(rows)}  # of the later time, where both had a cell
    expected = {second: second + 0.5 for second in (*range(27), *range(31, 145))}
    assert {second: seen[second] for second in expected} == expected, 'but for the stray one'
