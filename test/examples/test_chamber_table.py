"""The script that turns a table of a chamber test into a recording."""

import json
from pathlib import Path
import shlex
import subprocess
import sys

import pytest

from wrist_ft_comp.cli.main import main
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recordings.recordings import describe_recording, read_recording

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / 'examples/paper/chamber_table.py'
KELLER = ROOT / 'data/keller_pa10'
#: Held out, as a chamber table's own calibration gave them up to 0.2.0: before and after.
TABLES = {
    'table1_sensor_a_raw.csv': (7, 2.730682269886814, 1.0926994655187774),
    'table2_sensor_b_raw.csv': (8, 3.123568277577484, 1.8212354990519741),
}


def convert(*words, folder='.'):
    """Run the script; what it printed, and what it refused with."""
    command = [sys.executable, SCRIPT, *map(str, words)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    return done.stdout, done.stderr


@pytest.mark.parametrize(('table', 'expected'), TABLES.items())
def test_a_table_becomes_a_recording_that_is_learnt_on_its_plateaus(
    table, expected, tmp_path, capsys
):
    columns, before, after = expected
    path, model = tmp_path / 'oven.csv', tmp_path / 'model.yaml'
    printed, refused = convert(KELLER / table, '-o', path)
    assert not refused
    assert ('The column of 50 °C in table1' in printed) is (columns == 7)
    recording = read_recording(path)
    assert recording.duration_s == 1800 * columns
    assert not recording.warnings
    words = ['--reference', 'recorded', '--features', 'hats', '--json']
    assert main(['calibrate', str(path), '-o', str(model), *words]) == 0
    fit = json.loads(capsys.readouterr().out)['axes']['force_z']
    assert fit['chosen'] == 'zero drift in hats'
    assert [fit['rms_before'], fit['rms_after']] == pytest.approx([before, after])


@pytest.mark.parametrize('comma', [False, True])
def test_the_gain_is_one_at_20_degrees_and_temperatures_are_steps(comma, tmp_path):
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
    assert temperature_c.tolist() == [0.0] * 1800 + [21.5] * 1800


@pytest.mark.parametrize(
    ('table', 'sentence'),
    [
        ('step,output_at_20_c\n0,1\n', 'one column load_<unit>'),
        ('load_n,output_at_20_c\n0,1\n0,2\n', 'reach full load'),
        ('load_n,output_at_20_c\n0,1\n5,nan\n', 'must be finite'),
        ('load_n,output_at_20_c\n0,1\n5\n', 'cannot be converted'),
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


@pytest.mark.parametrize('door', [read_recording, describe_recording])
def test_a_table_is_refused_with_a_command_that_converts_it(door, tmp_path):
    table = tmp_path / 'of a "chamber".csv'
    table.write_bytes((KELLER / 'table2_sensor_b_raw.csv').read_bytes())
    with pytest.raises(RecordingError, match='is a table of a chamber test') as refused:
        door(table)
    python, script, *words = shlex.split(str(refused.value).split('Make a recording of it: ')[1])
    assert (python, script) == ('python', SCRIPT.relative_to(ROOT).as_posix())
    folder = tmp_path / 'empty'
    folder.mkdir()
    assert not convert(*words, folder=folder)[1]
    (made,) = folder.iterdir()
    assert read_recording(made).duration_s == 1800 * 8


@pytest.mark.parametrize(
    'words',
    [
        'calibrate {} -o {out}.yaml',
        'show {}', 'evaluate {model} {}', 'compensate {model} {} -o {out}',
    ],
)  # fmt: skip
def test_every_command_refuses_a_table(words, tmp_path, capsys):
    model, out, recording = (tmp_path / name for name in ('model.yaml', 'out.csv', 'oven.csv'))
    table = KELLER / 'table2_sensor_b_raw.csv'
    if 'model' in words:
        convert(table, '-o', recording)
        learnt = ['--reference', 'recorded', '--method', 'pls', '-o', str(model)]
        assert main(['calibrate', str(recording), *learnt]) == 0
    capsys.readouterr()
    assert main(words.format(table, model=model, out=out).split()) == 1
    (sentence,) = capsys.readouterr().err.splitlines()
    assert f'examples/paper/chamber_table.py {table} -o table2_sensor_b_raw_rec' in sentence
    assert not list(tmp_path.glob('out*'))
