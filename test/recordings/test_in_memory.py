"""Recordings of columns in memory: what a CSV file of them gives; a sentence for bad ones."""

import numpy as np
import pytest

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recordings.read import compensate, read_recording, recording_from_columns

ROWS = 400
EPOCH = 1_723_248_197_123_456_789
STAMPS = EPOCH + 250_000_001 * np.arange(ROWS)
GOOD = {'stamp_ns': STAMPS, 'force_z': np.ones(ROWS), 'temperature_c': np.full(ROWS, 20.0)}


@pytest.fixture(scope='module')
def columns():
    """A table of every kind of channel; some have no sample in some rows, each in its own."""
    rng = np.random.default_rng(0)
    names = 'force_x', 'force_z', 'torque_y', *(f'temperature{j}_c' for j in ('', '_2', '_3'))
    table = {name: 20 + rng.standard_normal(ROWS) for name in (*names, 'reference_force_z')}
    for name in ('torque_y', 'temperature_2_c', 'reference_force_z'):
        table[name][rng.uniform(size=ROWS) < 0.7] = np.nan
    table['force_x'][:9] = np.nan
    return {'stamp_ns': STAMPS, **table, 'note': np.full(ROWS, 'x')}


def assert_same(one, other):
    for fact in ('name', 'period_ns', 'first_cell'):
        assert getattr(one, fact) == getattr(other, fact)
    assert sorted(one.warnings) == sorted(other.warnings)
    for array in ('temperature_c', 'measured', 'wrench', 'reference', 'origin_ns'):
        np.testing.assert_allclose(getattr(one, array), getattr(other, array), rtol=1e-13)


def test_columns_give_the_recording_of_a_csv_file_that_holds_them(columns, make, tmp_path):
    path = make.csv(tmp_path / 'table', columns)
    for period_s in (0.5, 10.0):
        read = read_recording(path, period_s=period_s)
        assert read.origin_ns == STAMPS[0]
        assert_same(recording_from_columns(columns, period_s=period_s), read)


def test_channels_may_come_in_tables_of_their_own(columns):
    parts = [{'stamp_ns': STAMPS, name: columns[name]} for name in columns if name != 'stamp_ns']
    parts[0] = {name: values[9:] for name, values in parts[0].items()}
    assert_same(recording_from_columns(*parts), recording_from_columns(columns))
    with pytest.raises(RecordingError, match='table has force_z in two tables'):
        recording_from_columns(GOOD, {'stamp_ns': STAMPS, 'force_z': np.ones(ROWS)})


def test_stamps_may_be_of_any_kind_and_temperatures_in_fahrenheit(columns):
    table = {name: columns[name] for name in ('force_z', 'temperature_c')}
    expected = recording_from_columns({'stamp_ns': STAMPS, **table})
    table['temperature_f'] = 1.8 * table.pop('temperature_c') + 32
    dates = STAMPS.astype('datetime64[ns]')
    for name, stamps in (
        ('stamp_ns', dates), ('stamp_s', dates),
        ('stamp_ns', STAMPS.tolist()), ('stamp_ns', STAMPS.astype(np.uint64)),
        ('stamp_ns', STAMPS.astype(float)), ('stamp_us', STAMPS / 1e3),
        ('stamp_ms', STAMPS / 1e6), ('stamp_s', STAMPS / 1e9),
    ):  # fmt: skip
        assert_same(recording_from_columns({name: stamps, **table}), expected)


@pytest.mark.parametrize(('change', 'sentence'), [
    ({'force_z': np.ones(9)}, 'columns of table must have one value per row: .* same length'),
    ({'force_z': np.ones((ROWS, 2))}, 'columns of table must have one value per row'),
    ({'stamp_ns': STAMPS.reshape(2, -1)}, 'columns of table must have one value per row'),
    ({'force_z': ['warm'] * ROWS}, "column force_z: expected a number, got 'warm'"),
    ({'force_z': [None, {}] * (ROWS // 2)}, 'Line 2 of table, column force_z: expected a num'),
    ({'stamp_ns': STAMPS * np.nan}, 'column stamp_ns: expected a time .ns., got'),
    ({'stamp_ns': ['NaT'] * ROWS}, 'column stamp_ns: expected a time'),
    ({'stamp_ns': np.full(ROWS, 'NaT', 'datetime64[s]')}, 'column stamp_ns: expected a time'),
])  # fmt: skip
def test_bad_columns_get_their_sentence(change, sentence):
    with pytest.raises(RecordingError, match=sentence):
        recording_from_columns({**GOOD, **change})


def test_compensated_columns_are_tared_on_the_first_seconds_alone(make_model):
    model = make_model({'force_z': (0.4, 0.0, 50.0)})
    table = {**GOOD, 'force_z': np.where(np.arange(ROWS) < 40, 3.0, 8.0)}
    compensated = compensate(model, table, tare_s=5.0)['force_z']
    np.testing.assert_allclose(compensated, table['force_z'] - 3.0, atol=1e-9)
