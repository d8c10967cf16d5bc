"""Chamber tables: the paper's own, laid out in time, and the figures that describe them."""

from dataclasses import astuple
from pathlib import Path

import numpy as np
import pytest

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recordings.chamber_table import (
    chamber_figures,
    ChamberTable,
    is_chamber_table,
    read_chamber_table,
)

DATA = Path(__file__).parents[2] / 'data' / 'keller_pa10'
#: Worked out from the printed tables by hand: max abs K_s, zero spread, largest deviation.
FIGURES = {
    'table1_sensor_a_raw.csv': (0.0687, 5.361, 5.198),
    'table2_sensor_b_raw.csv': (0.1444, 7.512, 8.561),
    'table3_sensor_a_compensated.csv': (0.0206, 0.237, 0.281),
    'table4_sensor_b_compensated.csv': (0.0137, 0.206, 0.256),
}


@pytest.mark.parametrize('keep', [True, False])
@pytest.mark.parametrize(('name', 'figures'), FIGURES.items())
def test_figures_of_the_published_tables(name, figures, keep):
    table = read_chamber_table(DATA / name, keep_copied_columns=keep)
    computed = chamber_figures(table)
    assert computed.max_sensitivity_drift == pytest.approx(figures[0], abs=6e-5)
    assert computed.zero_spread == pytest.approx(figures[1], abs=6e-4)
    assert computed.max_deviation == pytest.approx(figures[2], abs=6e-4)


def test_the_copied_column_of_sensor_a_is_left_out_with_its_reason():
    table = read_chamber_table(DATA / 'table1_sensor_a_raw.csv')
    assert table.temperatures_c.tolist() == [-40, -30, -15, 0, 20, 70, 100]
    ((temperature, reason),) = table.left_out
    assert temperature == 50.0
    assert 'repeats that of -40 °C digit for digit' in reason
    kept = read_chamber_table(DATA / 'table1_sensor_a_raw.csv', keep_copied_columns=True)
    assert kept.left_out == ()
    np.testing.assert_array_equal(kept.output[:, 0], kept.output[:, 5])
    assert all(
        read_chamber_table(DATA / name).left_out == () for name in FIGURES if 'table1' not in name
    )


def test_gain_between_reference_and_output_is_one_at_the_reference_temperature():
    table = read_chamber_table(DATA / 'table2_sensor_b_raw.csv')
    at = table.reference_column
    assert table.temperatures_c[at] == 20.0
    full = int(np.argmax(table.load))
    change = table.output[full, at] - table.output[0, at]
    assert table.reference[full] - table.reference[0] == pytest.approx(change)


def test_the_compensated_tables_are_no_function_of_output_and_temperature():
    """As docs/paper.md says."""
    tables = [read_chamber_table(DATA / name, keep_copied_columns=True) for name in FIGURES]
    for raw, compensated in (
        (tables[0].output, tables[2].output),
        (tables[1].output, tables[3].output),
    ):
        contradictions = 0
        for outputs, results in zip(raw.T.tolist(), compensated.T.tolist(), strict=True):
            contradictions += len(set(zip(outputs, results, strict=True))) - len(set(outputs))
        assert contradictions > 0


HEADER = 'step,load_kpa,output_at_20_c,output_at_50_c\n'


@pytest.mark.parametrize(
    ('text', 'sentence'),
    [
        (HEADER, 'no row below its header'),
        (HEADER + '0,0,1,2\n1,5,x,3\n', "Row 3 of t.csv, column output_at_20_c.*got 'x'"),
        (HEADER + '0,0,1,2\n1,5,3\n', 'Row 3 of t.csv has 3 cells'),
        (HEADER + '0,0,1,2\n1,0,3,4\n', 'reach full load'),
        (HEADER + '0,0,1,2\n1,5,nan,4\n', 'must be finite'),
        ('step,output_at_20_c\n0,1\n', 'one column load_<unit>'),
        ('load_n,output_at_20_c,output_at_20.0_c\n0,1,2\n5,2,3\n', 'one column per temperature'),
        (b'load_n,output_at_20_c\n\xff', 'UTF-8'),
    ],
)
def test_a_bad_table_is_refused_in_a_sentence(make_csv, text, sentence):
    with pytest.raises(RecordingError, match=sentence):
        read_chamber_table(make_csv(text, 't.csv'))


def test_only_chamber_tables_are_taken_for_chamber_tables(make_csv, tmp_path):
    assert is_chamber_table(DATA / 'table1_sensor_a_raw.csv')
    assert not is_chamber_table(make_csv('stamp_s,force_z,temperature_c\n'))
    assert not is_chamber_table(make_csv(b'\xff\xfe\0'))
    assert not is_chamber_table(tmp_path / 'no.csv')


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
