"""Figures of chamber tables, and the tables laid out in time."""

from dataclasses import astuple

import numpy as np
import pytest

from wrist_ft_comp.recordings.chamber_table import chamber_figures, ChamberTable


def ideal(**changes):
    """A sensor of gain 3 whose zero moves by 0.1 per °C."""
    fields = {
        'name': 'ideal',
        'temperatures_c': np.array([0.0, 20.0, 50.0]),
        'load': np.array([0.0, 1.0, 2.0, 1.0]),
        'load_unit': 'kpa',
        'output': 3.0 * np.array([[0.0], [1], [2], [1]]) + 0.1 * np.array([[0.0, 20, 50]]),
    }
    return ChamberTable(**{**fields, **changes})


def test_a_zero_that_moves_has_no_sensitivity_drift():
    figures = chamber_figures(ideal())
    assert figures.max_sensitivity_drift == pytest.approx(0.0, abs=1e-12)
    assert figures.zero_spread == pytest.approx(100 * 5 / 6)
    assert figures.max_deviation == pytest.approx(100 * 3 / 6)
    assert figures.accuracy == pytest.approx(100 * 3 / 6)


def test_a_gain_that_moves_is_the_sensitivity_drift():
    gain = 1 + 0.002 * (np.array([0.0, 20, 50]) - 20)
    figures = chamber_figures(ideal(output=np.array([[0.0], [1], [2], [1]]) * gain))
    assert figures.max_sensitivity_drift == pytest.approx(0.2)
    assert figures.zero_spread == 0.0


def test_units_of_the_output_change_no_figure():
    other = chamber_figures(ideal(output=-7.0 * ideal().output + 3.0))
    assert astuple(other) == pytest.approx(astuple(chamber_figures(ideal())), abs=1e-12)


def test_readings_stand_at_the_end_of_their_plateau():
    temperature, force, reference = ideal().samples()
    ends = [30 * 10**9 * k - before for k in range(180) for before in (1, 0)]
    assert temperature.stamps_ns.tolist() == ends[1:]
    assert temperature.values[:, 0].tolist() == [0.0] * 120 + [20.0] * 120 + [50.0] * 119
    first = [1680, 1710, 1740, 1770]
    expected = [(1800 * p + t) * 10**9 for p in range(3) for t in first]
    assert force.stamps_ns.tolist() == reference.stamps_ns.tolist() == expected
    assert ideal().reading_stamps_ns[:, 1].tolist() == expected[4:8]
    assert force.values[4:8, 0].tolist() == ideal().output[:, 1].tolist()
    assert reference.values[4:8, 0].tolist() == [0.0, 3.0, 6.0, 3.0]
