"""Logs of other programs: from ``show`` to a judged model, and what their loggers write."""

from datetime import datetime, timedelta
from itertools import zip_longest
import re
import shlex

import numpy as np
import pytest

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.recording import Topics
from wrist_ft_comp.recordings.column_map import parse_map
from wrist_ft_comp.recordings.read import read_recording
from wrist_ft_comp.recordings.read_options import parse_options
from wrist_ft_comp.units import known_unit

ROWS = 3600
BEGIN = datetime(2026, 11, 20, 8)


def day(seed, bump=False):
    """An hour of warming up at 1 Hz: seconds, wrench in N and N m, °C."""
    rng = np.random.default_rng(seed)
    t = np.arange(float(ROWS))
    celsius = 22 + 14 * (1 - np.exp(-t / 900)) + 1.5 * np.sin(t / (400 + seed))
    wrench = np.outer(celsius - 22, [0.3, 0.2, 0.5, 0.02, 0.01, 0.015])
    wrench += rng.normal(0, [0.02] * 3 + [0.001] * 3, wrench.shape)
    if bump:
        wrench[2400:2410, 2] += 25
    return t, wrench, celsius


#: A day without a bump.
T, WRENCH, CELSIUS = day(1)
FORCE, TORQUE = WRENCH.T[2:4]


def write(path, header, columns, delimiter=',', comma=False):
    """Write columns below a header, texts as they are and numbers with seven digits."""
    lines = [header]
    for row in zip(*columns, strict=True):
        cells = [cell if isinstance(cell, str) else f'{cell:.7f}' for cell in row]
        lines.append(delimiter.join(cell.replace('.', ',') if comma else cell for cell in cells))
    path.write_text('\n'.join(lines) + '\n', encoding='utf-8')
    return path


@pytest.fixture
def logs(tmp_path, monkeypatch):
    """Three days of ISO times, decimal commas, kN and °F, below a comment; a bump in the last."""
    monkeypatch.chdir(tmp_path)
    paths = [tmp_path / f'day_{n}.csv' for n in (1, 2, 3)]
    times = [f'{BEGIN + timedelta(seconds=s):%Y-%m-%dT%H:%M:%SZ}' for s in T.tolist()]
    for n, path in enumerate(paths, start=1):
        _, wrench, celsius = day(n, bump=n == 3)
        columns = times, *(wrench[:, :3] / 1000).T, *wrench[:, 3:].T, celsius * 1.8 + 32
        header = '# cell 3\ntime;fx;fy;fz;tx;ty;tz;temp'
        write(path, header, columns, ';', comma=True)
    return paths


GIVEN = ['--columns', 'stamp=time,force_z=fz:kN,temperature_c=temp:F']


def proposed(shown):
    """The map that show proposes for a calibration, and the form of times."""
    words = shlex.split(re.search('wrist_ft_comp calibrate .*', shown)[0])
    time = words[words.index('--time') + 1] if '--time' in words else ''
    return words[words.index('--columns') + 1], time


def test_a_map_beside_the_recordings_is_written_once(logs, done, run, make):
    """It counts for what has its columns, and not where --columns are given."""
    shown = done('show', logs[0])
    beside = logs[0].with_name('recording.yaml')
    beside.write_text(shown[shown.index('columns: ') :].split('\nwarning')[0])
    done('calibrate', *logs[:2], '-o', 'model.yaml', '--method', 'pls')
    done('compensate', 'model.yaml', logs[1], '-o', 'copy.csv', '--tare', '60')
    assert 'copy.csv was compensated already' in done('show', 'copy.csv')
    assert 'guess' not in done('show', logs[0])
    assert 'expected a time (ms)' in run('show', logs[0], '--time', 'ms').sentence
    other = make.csv(logs[0].with_name('own.csv'), {'t': [0, 1], 'fz': [1, 2], 'T': [20, 21]})
    said = run('show', other).sentence
    assert "own.csv has no column 'time', which recording.yaml beside it names; it has t," in said
    twice = 'stamp=t,force_x=fz,force_z=fz'
    assert 'twice: for force_x and for force_z' in run('show', other, '--columns', twice).sentence
    assert "no column 'x', which --columns" in run('show', other, '--columns', 'stamp=x').sentence
    for text, why in (('columns: a=b\nfrom: 9\n', 'must have the keys'), ('a: [', 'be read')):
        beside.write_text(text)
        assert why in run('show', other).sentence
        done('compensate', 'model.yaml', logs[0], '-o', f'{why}.csv', *GIVEN)


def test_a_bump_is_left_out_and_named_by_the_files_own_time(logs, run):
    words = ['calibrate', logs[2], '-o', 'model.yaml', '--method', 'pls', *GIVEN]
    for cut in ([], ['--from', '600']):
        said = ' '.join(run(*words, *cut).err.split())
        assert re.search(
            r'stands out by up to \S+ N for \d+ s in all, first at 0:40:0\d \(2026-11-20 08:40:0',
            said,
        ), said


def test_a_part_is_chosen_in_every_way_of_writing_a_time(logs, run):
    said = Topics(begin='80min', end='1.5h', exclude=('1:20:00..81min',))
    options = parse_options(said)
    assert (options.begin_s, options.end_s, *options.excluded_s) == (4800, 5400, (4800, 4860))
    part = Topics(columns=GIVEN[1], begin='600', end='0:30:00', exclude=('700..800',))
    recording = read_recording(logs[0], topics=part)
    assert recording.duration_s == pytest.approx(1201, abs=1)
    assert np.isnan(recording.wrench[:, 2]).sum() == 101
    assert np.isfinite(recording.temperature_c).all()
    for begin, end, exclude in (('x', '', ()), ('', '', '5'), ('9', '3', ()), ('', '', ['9..3'])):
        with pytest.raises(SettingsError):
            parse_options(Topics(begin=begin, end=end, exclude=tuple(exclude)))
    words = ['calibrate', logs[0], '-o', 'model.yaml', *GIVEN]
    for given, sentence in (
        (['--from', '3h'], 'Every wrench of .*, is left out by --from'),
        (['--exclude', '0..3h'], 'Every wrench of .*, is left out by --from, --until and --excl'),
        (['--exclude', '0..50min', '--exclude', '40min..80min'], 'Every wrench of '),
    ):
        said = run(*words, *given).sentence
        assert re.search(sentence, said), said
        assert 'begins at 2026-11-20 08:00:00 UTC and lasts 3599 s' in said


@pytest.mark.parametrize('form', ['Ty [%s]', 'Ty / %s', 'Ty/%s', 'Ty, %s', 'Ty %s', 'Ty_%s'])
def test_a_product_of_units_is_understood_wherever_it_stands(form):
    for unit in ('N·mm', 'N⋅mm', 'N*mm', 'N-mm', 'N.mm', 'N mm', 'N_mm', 'Nmm'):
        assert known_unit('torque_y', form % unit) == 'Nmm', unit
    assert known_unit('torque_y', form % 'in-lbf') == 'lbfin'
    assert known_unit('torque_y', 'Torque_C_Nm') == 'Nm', 'C is an axis'


def test_a_unit_that_is_not_understood_is_named_with_the_one_that_is_taken(done, tmp_path):
    header = 't,Fz (N),Tx (N-foo),Temp (C)'
    path = write(tmp_path / 'log.csv', header, (T, FORCE, TORQUE, CELSIUS))
    said = 'Tx (N-foo) of log.csv is in N-foo, a unit that is not understood, and is read in Nm.'
    assert f'warning: {said}' in done('show', path)
    columns, _ = proposed(done('show', path))
    spans = []
    for behind in ('', ':Nm', '*0.001', ':Nmm'):
        topics = Topics(columns=columns.replace('(N-foo)', f'(N-foo){behind}'))
        recording = read_recording(path, topics=topics)
        assert bool([w for w in recording.warnings if 'not understood' in w]) == (not behind)
        spans.append(np.nanmax(recording.wrench[:, 3]))
    np.testing.assert_allclose(spans, spans[0] * np.array([1, 1, 1e-3, 1e-3]))


@pytest.mark.parametrize(('begin', 'behind', 'doubt'), [
    (58, '', True), (58, ':C', False), (71, ':F', False), (22, '', False),
])  # fmt: skip
def test_degrees_that_nobody_named_are_celsius_and_doubted(begin, behind, doubt, done, tmp_path):
    """The first reading says nothing: a DS18B20 has 85.00 until it has converted."""
    celsius = np.concatenate(([85], CELSIUS[1:] - 22 + begin))
    path = write(tmp_path / 'log.csv', 't_s,fz,temp', (T, FORCE, celsius))
    columns, _ = proposed(done('show', path))
    assert columns == 'stamp=t_s,force_z=fz,temperature_c=temp'
    shown = ' '.join(done('show', path, '--columns', columns + behind).split())
    assert ('temp of log.csv says no unit and is read in °C: half of it' in shown) == doubt
    assert ('In °F that would be 2' in shown) == doubt


def test_counts_are_no_tenths_of_degrees_and_volts_of_a_bridge_no_newtons(run, tmp_path):
    for name in ('temp_counts', 'temp_adc', 'temp_raw'):
        path = write(tmp_path / 'log.csv', f't_s,fz,{name}', (T, FORCE, 476 + CELSIUS))
        assert proposed(run('show', path).out)[0] == 'stamp=t_s,force_z=fz,temperature_c=…'
    path = write(tmp_path / 'log.csv', 't_s,Fz_V,T', (T, FORCE, CELSIUS))
    assert 'Fz_V of log.csv is in v, a unit that is not understood' in run('show', path).out
    head = 'Y_Unit_Label,Digits,Volts\nt_s,Fz,T'
    path = write(tmp_path / 'log.csv', head, (T, FORCE, CELSIUS))
    assert 'Fz of log.csv is in Digits, a unit that is not understood' in run('show', path).out


@pytest.mark.parametrize(('line', 'is_doubt'), [
    ('# all forces in kN', True), ('# torques in N·mm', True), ('# Scale: 1000 counts/N', True),
    ('Channel 1: Fz kN', True),
    ('ScaleFactor,0.001,1', True), ('ScaleFactor,1,1', False), ('# cell 3, 100 N', False),
])  # fmt: skip
def test_a_line_above_that_tells_of_units_is_quoted(line, is_doubt, done, tmp_path):
    path = write(tmp_path / 'log.csv', f'{line}\n\nt_s,Fz,T', (T, FORCE, CELSIUS))
    columns, _ = proposed(done('show', path))
    for behind in ('', ':kN', '*0.001'):
        words = '--columns', columns.replace('Fz', f'Fz{behind}')
        shown = ' '.join(done('show', path, *words).split())
        quoted = f'read in N or N m, but a line above the rows says {line!r}'
        assert (quoted in shown) == (is_doubt and not behind)


@pytest.mark.parametrize('names', [['Fz', 'T'], ['Fx', 'Fz', 'T'], ['Fx', 'Fz', 'T1', 'T2']])
def test_channels_that_take_turns_in_a_long_log_are_found(names, run, tmp_path):
    cells = [(n, s, v) for s, *two in zip(T, FORCE, CELSIUS, strict=True)
             for n, v in zip(names, [two[n[0] == 'T'] for n in names], strict=True)]  # fmt: skip
    path = write(tmp_path / 'log.csv', 'name,time,value', zip(*cells, strict=True))
    said = run('show', path).sentence
    found = re.search(r'log.csv has a row for each channel \((.*)\); expected a column', said)[1]
    assert sorted(found.split(', ')) == names
    assert "pivot_table('value', 'time', 'name'" in said


@pytest.mark.parametrize(
    ('most', 'method', 'period_s'),
    [(1e6, 'auto', 1), (3600, 'auto', 10), (100, 'auto', 60), (1e6, 'pls', 60)],
)
def test_cells_of_a_slow_log_last_a_second_or_as_long_as_it_takes_to_fit(  # noqa: PLR0913, PLR0917
    most, method, period_s, done, tmp_path, monkeypatch
):
    monkeypatch.setattr('wrist_ft_comp.recordings.read._MOST_SLOW_CELLS', most)
    ten_hours = [column[:600] for column in (T, FORCE, CELSIUS)]
    path = write(tmp_path / 'log.csv', 't (min),fz (N),temp (C)', ten_hours)
    assert '--thermal-period' not in done('show', path)
    model, columns = tmp_path / 'model.yaml', ['--columns', proposed(done('show', path))[0]]
    done('calibrate', path, '-o', model, '--method', method, *columns)
    assert f'thermal period {period_s} s' in done('show', model)
    done('evaluate', model, path, *columns)


def test_what_a_person_says_counts_more_than_a_name_of_ours(make, tmp_path):
    log = {
        'stamp_s': [0, 1, 2], 'force_z': [1, 2, 3], 'cell': [4, 5, 6], 'temperature_c': 3 * [20],
    }  # fmt: skip
    path, topics = make.csv(tmp_path / 'log.csv', log), Topics(columns='force_z=cell', time='min')
    recording = read_recording(path, topics=topics, period_s=60)
    assert recording.wrench[:, 2].tolist() == [4, 5, 6]


@pytest.mark.parametrize(('columns', 'time', 'words'), [
    ('force_z', '', 'expected NAME=COLUMN'), ('force_w=fz', '', 'force_w is no name of a column'),
    ('force_z=fz:Nm', '', 'force_z may be in N, kN'),
    ('temperature_c=t:R', '', 'temperature_c may be in C, K, F'),
    ('stamp=t', 'weeks', 'A time is s, ns, us, ms, min, h, d, iso, excel, datenum'),
    ('stamp=t:weeks', '', 'A time is s, ns'),
])  # fmt: skip
def test_a_map_that_cannot_be_meant_so_is_refused(columns, time, words):
    with pytest.raises(SettingsError, match=re.escape(words)):
        parse_map(columns, time)


@pytest.mark.parametrize(('header', 'times'), [
    ('Time,Fz,Time,Temp', 600 + np.arange(3600.0)),
    ('Fz_x,Fz,Temp_x,Temp\n[s],[N],[s],[degC]', 600 + np.arange(3600.0)),
    ('Time (s),Fz,Time (s),T (C)', 10 * np.arange(360.0)),
])  # fmt: skip
def test_a_second_clock_is_named(header, times, run, tmp_path):
    celsius = 22 + 14 * (1 - np.exp(-times / 900))
    groups = [[f'{at:.2f},{value:.4f}' for at, value in zip(*group, strict=False)]
              for group in ((T, FORCE), (times, celsius))]  # fmt: skip
    rows = [','.join(row) for row in zip_longest(*groups, fillvalue=',')]
    path = tmp_path / 'log.csv'
    path.write_text('\n'.join([header, *rows, '']))
    shown = run('show', path)
    assert re.search('has another time before T.*, which differs from .* not used', shown.out)


def test_a_date_beside_seconds_and_a_stamp_that_a_temperature_has_are_no_second_clock(
    done, tmp_path
):
    dates = [f'{BEGIN + timedelta(seconds=s):%Y-%m-%dT%H:%M:%S}' for s in T]
    for header, second in (('Timestamp', dates), ('temp.header.stamp.secs', 1.7e9 + T - 0.3)):
        stamps = T if header == 'Timestamp' else 1.7e9 + T
        columns = stamps, FORCE, second, CELSIUS
        path = write(tmp_path / f'{header}.csv', f'Time (s),Fz (N),{header},T (C)', columns)
        assert 'another time' not in done('show', path, '--columns', (
            'stamp=1,force_z=2,temperature_c=4'))  # fmt: skip


def test_a_part_of_a_day_is_no_second(done, tmp_path):
    times = [f'{0.29 + s / 86_400:.9f}' for s in T]
    path = write(tmp_path / 'log.csv', 'Uhrzeit,Fz (N),T (C)', (times, FORCE, CELSIUS))
    columns, time = proposed(done('show', path))
    assert time == 'd'
    recording = read_recording(path, topics=Topics(columns=columns, time=time))
    assert recording.duration_s == pytest.approx(ROWS, abs=2)
