"""Averages over thermal cells as a stream: against the batch, in trouble, and as rows."""

import math

import numpy as np
import pytest

from wrist_ft_comp.recording import Samples
from wrist_ft_comp.recordings.sample_checks import grid_samples
from wrist_ft_comp.stream import thermal_cells
from wrist_ft_comp.stream.clock import Sample
from wrist_ft_comp.stream.drift_tracker import DriftTracker

SECOND = 1_000_000_000


def feed(grid, stream):
    return [cells for sample in stream for cells in grid.add(*sample)]


def seconds(thermometer, *pairs):
    return [(thermometer, round(s * SECOND), value) for s, value in pairs]


@pytest.mark.parametrize(('second', 'first'), [(1999.6, 1999), (1990.6, 1996)])
def test_a_thermometer_that_never_reported_is_waited_for_without_hoarding(second, first):
    grid = thermal_cells.ThermalGrid(SECOND, 2, patience_s=3.0)
    assert not feed(grid, seconds(0, *((k + 0.5, 20.0 + k) for k in range(2000))))
    assert len(grid._open) < 100
    late = [*seconds(1, (second, 5.0)), *seconds(0, (2000.5, 2020.0)), *seconds(1, (2000.5, 5.0))]
    started = feed(grid, late)
    assert started[0].number == first
    assert started[0].temperature_c == pytest.approx([20.0 + first, 5.0])


@pytest.mark.parametrize('later_s', [0, 1, 4, 9])
@pytest.mark.parametrize('every_s', [10, 60])
def test_of_thermometers_that_report_seldom_in_turn_each_report_is_measured(every_s, later_s):
    grid = thermal_cells.ThermalGrid(SECOND, 2, patience_s=5.0)
    both = zip(
        seconds(0, *((every_s * k, 20.0) for k in range(40))),
        seconds(1, *((every_s * k + later_s, 30.0) for k in range(40))), strict=True,
    )  # fmt: skip
    done = feed(grid, [sample for pair in both for sample in pair])
    assert (np.sum([cell.measured for cell in done], axis=0) >= 35).all()


@pytest.mark.parametrize(('back_s', 'number', 'last_c'), [(1.0, 31, 52.0), (9.0, 30, 50.0)])
def test_after_an_outage_the_others_are_waited_for_with_patience(back_s, number, last_c):
    grid = thermal_cells.ThermalGrid(SECOND, 2, patience_s=3.0)
    feed(grid, seconds(0, (0.5, 20.0)) + seconds(1, (0.5, 50.0)))
    both = [*seconds(0, *((30.5 + k, 30.0 + k) for k in range(20)))]
    both += seconds(1, *((30.7 + back_s + k, 52.0) for k in range(20)))
    before, first, *_ = feed(grid, sorted(both, key=lambda sample: sample[1]))
    assert before.number == 0
    assert first.number == number
    assert first.temperature_c == pytest.approx([number, last_c])


@pytest.mark.parametrize(('every_s', 'late_s'), [(60, 30), (1, 30), (10, 110)])
@pytest.mark.parametrize('patience_s', [5.0, 120.0])
def test_what_comes_late_counts_when_it_comes(patience_s, every_s, late_s):
    grid = thermal_cells.ThermalGrid(SECOND, 2, patience_s)
    quick = seconds(0, *((s + 0.5, 20.0) for s in range(610)))
    late = seconds(1, *((float(s), float(s)) for s in range(30, 600 - late_s, every_s)))
    stream = sorted([*quick, *late], key=lambda one: one[1] + one[0] * late_s * SECOND)
    last = feed(grid, stream)[-1].temperature_c.tolist()
    assert last == pytest.approx([20.0, late[-1][2]], abs=5.0)
    assert grid.rejected == 0


NAN = math.nan


class Node:
    """Feeds a tracker and an averager as the node does."""

    def __init__(self, thermometers=1, patience_s=3.0):
        self.tracker = DriftTracker(thermometers, SECOND, patience_s)
        self.averager = thermal_cells.CellAverager(SECOND, thermometers)

    def heat(self, at_s, *celsius):
        for j, value in enumerate(celsius):
            if value is not None:
                self.averager.add_cells(self.tracker.add(Sample(j, round(at_s * SECOND), value)))

    def raw(self, at_s, value):
        self.averager.add(thermal_cells.RAW, round(at_s * SECOND), [value] * 6)

    def reference(self, at_s, value):
        self.averager.add(thermal_cells.REFERENCE, round(at_s * SECOND), [value] * 6)


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


def test_thermal_cells_that_are_shorter_than_a_row_give_their_mean():
    averager = thermal_cells.CellAverager(SECOND, 1)
    for cell in range(3):
        averager.add(thermal_cells.RAW, cell * SECOND, [1.0] * 6)
        for warm in (20.0, 22.0):
            averager.add_cells(
                [thermal_cells.ThermalCell(cell, np.array([warm]), np.array([True]))]
            )
    assert [row[12] for _, row in averager.rows()] == [21.0, 21.0]


def test_wrenches_that_came_after_the_first_temperature_are_kept_until_it_is_averaged():
    """Thermal cells of a model of 10 s are complete when the next one begins."""
    averager, rows = thermal_cells.CellAverager(SECOND, 1), []
    for second in range(108, 160):
        averager.add(thermal_cells.RAW, second * SECOND, [float(second)] * 6)
        if second % 10 == 0:
            middle = thermal_cells.ThermalCell(second - 5, np.array([20.0]), np.array([True]))
            averager.add_cells([middle])
        rows += averager.rows()
    rows += averager.rows(final=True)
    assert [row[1] for row in cells(rows) if not math.isnan(row[1])] == list(range(108, 146))


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


def test_specific_force_may_come_without_a_speed_of_rotation_or_not_at_all():
    averager = thermal_cells.CellAverager(SECOND, 1, with_force=True)
    for cell, *numbers in ((5, 9.0, 9.0), (5, 11.0), (5, 10.0, 16.0), (6, 8.0)):  # speed squared
        averager.add(thermal_cells.FORCE, cell * SECOND, (0.0, 1.0, *numbers))
        averager.add(thermal_cells.RAW, cell * SECOND, [1.0] * 6)
    for cell in (5, 6, 7):
        averager.add_cells([thermal_cells.ThermalCell(cell, np.array([20.0]), np.array([True]))])
    assert thermal_cells.row_channels(1, with_force=True)[12::4][1] == 'rotation_speed'
    expected = [20, 0, 1, 10, math.sqrt(12.5)], [20, 0, 1, 8, NAN], [20, *[NAN] * 4]
    for (_, row), end in zip(averager.rows(final=True), expected, strict=True):
        np.testing.assert_allclose(row[-5:], end)


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
