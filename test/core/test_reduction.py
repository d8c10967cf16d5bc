"""One row per thermal cell: what the node's own recording holds."""

import math

import numpy as np
import pytest

from wrist_ft_comp.core.recording import AXES, REFERENCE_CHANNELS, Samples
from wrist_ft_comp.core.reduction import StreamReducer, row_channels
from wrist_ft_comp.core.sampling import grid_samples
from wrist_ft_comp.core.thermal_grid import CompletedCells, ThermalGrid

SECOND = 1_000_000_000


def cells(
    first: int, temperature_c: float, *, measured: bool = True, count: int = 1
) -> CompletedCells:
    return CompletedCells(first, count, np.array([temperature_c]), (measured,))


def test_rows_read_back_as_the_samples_would() -> None:
    """Recording through rows or through all samples gives the same cells."""
    rng = np.random.default_rng(0)
    stamps = np.sort(rng.integers(0, 30 * SECOND, 2000))
    raw = np.cumsum(rng.standard_normal((2000, 6)), axis=0)
    heat = np.sort(rng.integers(0, 30 * SECOND, 90))
    celsius = 20 + np.cumsum(rng.standard_normal(90))
    reducer, grid = StreamReducer(SECOND), ThermalGrid(SECOND, 1, 5.0)
    events = [(int(s), 'raw', k) for k, s in enumerate(stamps)]
    events += [(int(s), 'heat', k) for k, s in enumerate(heat)]
    rows = []
    for stamp, kind, k in sorted(events):
        if kind == 'raw':
            reducer.add_raw(stamp, raw[k].tolist())
            reducer.add_reference(stamp, (-raw[k]).tolist())
        else:
            reducer.add_cells(grid.add(0, stamp, float(celsius[k])))
        rows += reducer.rows()
    rows += reducer.rows(final=True)
    found = grid_samples(
        Samples((channel,), np.array([s for s, _ in rows])[keep], values[keep, np.newaxis])
        for channel, values in zip(row_channels(1), np.array([v for _, v in rows]).T, strict=True)
        for keep in [np.isfinite(values)]
    )
    expected = grid_samples(
        [
            Samples(
                AXES, stamps[np.diff(stamps, prepend=-1) > 0], raw[np.diff(stamps, prepend=-1) > 0]
            ),
            Samples(('temperature_c',), heat, celsius[:, np.newaxis]),
        ]
    )
    shared = len(found)
    assert shared >= 28
    assert found.first_cell == expected.first_cell
    np.testing.assert_allclose(found.temperature_c, expected.temperature_c[:shared], atol=1e-9)
    np.testing.assert_allclose(found.wrench, expected.wrench[:shared], atol=1e-9)
    np.testing.assert_allclose(found.reference, -expected.wrench[:shared], atol=1e-9)


def test_columns_are_wrench_reference_temperatures() -> None:
    assert row_channels(2) == (*AXES, *REFERENCE_CHANNELS, 'temperature_c', 'temperature_2_c')


def test_what_is_missing_is_not_a_number() -> None:
    reducer = StreamReducer(SECOND)
    reducer.add_cells([cells(3, 20.0, measured=False)])
    reducer.add_raw(3 * SECOND + 1, [1.0] * 6)
    ((stamp, values),) = reducer.rows(final=True)
    assert stamp == 3 * SECOND + SECOND // 2
    assert values[:6] == [1.0] * 6
    assert len(values) == len(row_channels(1))
    assert all(math.isnan(value) for value in values[6:])


def test_a_cell_without_any_sample_is_no_row() -> None:
    reducer = StreamReducer(SECOND)
    reducer.add_cells([cells(3, 20.0, measured=False)])
    assert reducer.rows(final=True) == []


def test_wrenches_of_a_gap_in_the_temperature_are_kept() -> None:
    reducer = StreamReducer(SECOND)
    for second in range(3, 9):
        reducer.add_raw(second * SECOND, [float(second)] * 6)
    reducer.add_cells([cells(3, 20.0), cells(4, 20.0, measured=False, count=4), cells(8, 21.0)])
    rows = reducer.rows(final=True)
    assert [stamp // SECOND for stamp, _ in rows] == [3, 4, 5, 6, 7, 8]
    assert [values[2] for _, values in rows] == [3.0, 4.0, 5.0, 6.0, 7.0, 8.0]
    assert [math.isnan(values[12]) for _, values in rows] == [False] + [True] * 4 + [False]


def test_a_row_waits_for_the_wrenches_of_its_cell() -> None:
    reducer = StreamReducer(SECOND)
    reducer.add_cells([cells(3, 20.0)])
    reducer.add_raw(3 * SECOND, [1.0] * 6)
    assert reducer.rows() == []
    reducer.add_raw(3 * SECOND + SECOND // 2, [3.0] * 6)
    reducer.add_raw(4 * SECOND, [9.0] * 6)
    ((_, values),) = reducer.rows()
    assert values[:6] == pytest.approx([2.0] * 6)
    assert values[12] == 20.0
    assert reducer.rows() == []


def test_a_silent_sensor_does_not_hold_the_rows_for_ever() -> None:
    reducer = StreamReducer(SECOND)
    for cell in range(200):
        reducer.add_cells([cells(cell, 20.0)])
    rows = reducer.rows()
    assert 100 < len(rows) < 200
    assert [stamp // SECOND for stamp, _ in rows] == list(range(len(rows)))
