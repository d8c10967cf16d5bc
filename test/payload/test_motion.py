"""A minute of motion is collected in cells."""

import numpy as np
import pytest

from wrist_ft_comp.payload.motion import DURATION_S, MotionCollector

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND + 1


def test_cells_are_means_over_a_quarter_of_a_second_of_stamps():
    collector = MotionCollector()
    assert collector.share == 0.0
    for k in range(12):
        wrench = [float(k)] * 6
        assert not collector.add(START + k * SECOND // 20, wrench, (1.0, 2.0, k), 3.0 * (k % 5))
    speed = 3.0 * np.sqrt(30 / 5)
    expected = [[2.0] * 6 + [1.0, 2.0, 2.0, speed], [7.0] * 6 + [1.0, 2.0, 7.0, speed]]
    np.testing.assert_allclose(collector.cells, expected)
    assert collector.share == pytest.approx(0.5 / DURATION_S)
    assert collector.add(START + round(DURATION_S * SECOND), [0.0] * 6, (1.0, 2.0, 3.0), 0.0)


def test_a_time_that_begins_anew_is_a_minute_that_begins_anew():
    collector = MotionCollector()
    for first in (START, START - 1000 * SECOND):
        for k in range(3):
            assert not collector.add(first + k * SECOND // 4, [float(k)] * 6, (1.0, 2.0, 3.0), 0.0)
        assert [cell[0] for cell in collector.cells] == [0.0, 1.0]
        assert collector.share == pytest.approx(0.5 / DURATION_S)
