"""The script that turns a table of a chamber test into a recording."""

from pathlib import Path
import subprocess
import sys

import numpy as np
import pytest

from wrist_ft_comp.cli.main import main
from wrist_ft_comp.recordings.read import read_recording

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / 'examples/paper/chamber_table.py'
KELLER = ROOT / 'data/keller_pa10'
#: Published tables of two sensors, and how many of their columns were measured.
TABLES = {'table1_sensor_a_raw.csv': 7, 'table2_sensor_b_raw.csv': 8}


def convert(*words):
    """Run the script; what it printed, and what it refused with."""
    command = [sys.executable, SCRIPT, *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.stdout, done.stderr


def figures(path):
    """Largest |K_s| (eq. 23), %FS/°C, and spread of the zero, %FS, of a recording of a test."""
    rows = np.genfromtxt(path, delimiter=',', names=True)
    readings = rows[np.isfinite(rows['force_z'])].reshape(-1, 9)
    zero, full = readings['force_z'][:, 0], readings['force_z'][:, 4]
    span, celsius = full - zero, readings['temperature_c'][:, 0]
    at = list(celsius).index(20.0)
    change = np.delete(span / span[at] - 1, at) / np.delete(celsius - 20.0, at)
    return 100 * np.abs(change).max(), 100 * np.ptp(zero) / span[at]


@pytest.mark.parametrize('method', ['auto', 'pls'])
@pytest.mark.parametrize(('table', 'columns'), TABLES.items())
def test_a_table_becomes_a_recording_learnt_on_its_plateaus(table, columns, method, tmp_path):
    """By default the gain is left alone; pls meets what the paper's sensors are required to."""
    raw, model, out = (tmp_path / name for name in ('raw.csv', 'model.yaml', 'out.csv'))
    printed, refused = convert(KELLER / table, '-o', raw)
    assert not refused
    assert ('The column of 50 °C in table1' in printed) is (columns == 7)
    recording = read_recording(raw)
    assert recording.duration_s == 1800 * columns
    assert not recording.warnings
    words = ['--reference', 'recorded', '--features', 'hats', '--method', method]
    assert main(['calibrate', str(raw), '-o', str(model), *words]) == 0
    tare = ['--tare', '29']  # on the first reading
    assert main(['compensate', str(model), str(raw), '-o', str(out), *tare]) == 0
    (k_s_before, spread_before), (k_s, spread) = figures(raw), figures(out)
    assert spread < min(0.3, 0.05 * spread_before)
    if method == 'auto':
        assert k_s == pytest.approx(k_s_before)
    else:
        assert k_s <= 0.01


@pytest.mark.parametrize('comma', [False, True])
def test_the_gain_is_one_at_20_degrees_and_temperatures_are_plateaus(comma, tmp_path):
    table = 'step;load_kpa;output_at_0_c;output_at_21.5_c\n0;0;1.5;2\n1;4;4;6\n2;0;2.5;3\n'
    path, out = tmp_path / 'table.csv', tmp_path / 'out.csv'
    path.write_text(table.replace('.', ',') if comma else table)
    convert(path, '-o', out)
    rows = [line.split(',') for line in out.read_text().splitlines()]
    assert [row for row in rows if row[2]] == [
        ['stamp_s', 'temperature_c', 'force_z', 'reference_force_z'],
        ['1710', '0.0', '1.5', '0.0'],
        ['1740', '0.0', '4.0', '4.0'],
        ['1770', '0.0', '2.5', '0.0'],
        ['3510', '21.5', '2.0', '0.0'],
        ['3540', '21.5', '6.0', '4.0'],
        ['3570', '21.5', '3.0', '0.0'],
    ]
    temperature_c = read_recording(out).temperature_c[:, 0]
    assert set(temperature_c[:1800]) == {0.0}
    assert set(temperature_c[2400:]) == {21.5}


@pytest.mark.parametrize(
    ('table', 'sentence'),
    [
        ('step,output_at_20_c\n0,1\n', 'one column load_<unit>'),
        ('load_n,output_at_20_c\n0,1\n0,2\n', 'reach full load'),
        ('load_n,output_at_20_c\n0,1\n5,nan\n', 'must be finite'),
        ('load_n,output_at_20_c\n0,1\n5\n', 'cannot be converted: load step 2 has 1 cells of 2'),
    ],
)
def test_what_is_no_chamber_table_is_refused_and_nothing_is_written(table, sentence, tmp_path):
    path = tmp_path / 'table.csv'
    path.write_text(table)
    assert sentence in convert(path, '-o', tmp_path / 'out.csv')[1]
    assert list(tmp_path.iterdir()) == [path]


def test_a_copied_column_may_be_kept_and_no_file_is_overwritten(tmp_path):
    table, out = KELLER / 'table1_sensor_a_raw.csv', tmp_path / 'out.csv'
    convert(table, '-o', out, '--keep-copied-columns')
    kept = out.read_text()
    assert read_recording(out).duration_s == 1800 * 8
    assert 'exists' in convert(table, '-o', out)[1]
    assert out.read_text() == kept
