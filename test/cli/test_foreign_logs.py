"""Logs of other programs: from ``show`` to a judged model, and what their loggers write."""

from datetime import datetime, timedelta
import json
import re
import shlex

import numpy as np
import pytest

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.recordings.columns import recording_from_columns
from wrist_ft_comp.recordings.excerpt import parse_part, Part
from wrist_ft_comp.recordings.foreign_log import iso_nanoseconds, log_map
from wrist_ft_comp.recordings.recordings import read_recording
from wrist_ft_comp.signals import AXES, Topics

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


def write(path, header, rows, delimiter=',', comma=False):
    """Write cells, texts as they are and numbers with seven digits."""
    lines = [header]
    for row in rows:
        cells = [cell if isinstance(cell, str) else f'{cell:.7f}' for cell in row]
        lines.append(delimiter.join(cell.replace('.', ',') if comma else cell for cell in cells))
    path.write_text('\n'.join(lines) + '\n', encoding='utf-8')
    return path


def foreign(path, seed, bump=False):
    """A log of ISO times, decimal commas, kN and °F, below a comment."""
    t, wrench, celsius = day(seed, bump)
    times = [f'{BEGIN + timedelta(seconds=s):%Y-%m-%dT%H:%M:%SZ}' for s in t.tolist()]
    scaled = np.column_stack((wrench[:, :3] / 1000, wrench[:, 3:], celsius * 1.8 + 32))
    rows = ([time, *row] for time, row in zip(times, scaled.tolist(), strict=True))
    return write(path, '# cell 3\ntime;fx;fy;fz;tx;ty;tz;temp', rows, ';', comma=True)


@pytest.fixture
def logs(tmp_path, monkeypatch):
    """Three days of a foreign log, the third with a bump."""
    monkeypatch.chdir(tmp_path)
    return [foreign(tmp_path / f'day_{n}.csv', n, bump=n == 3) for n in (1, 2, 3)]


def commands(shown):
    """What show proposes to run, as words behind the program's name."""
    return [shlex.split(line)[1:] for line in re.findall(r'(wrist_ft_comp (?:cal|ev).*)', shown)]


def test_three_commands_lead_from_a_log_to_a_judged_model(logs, done):
    """``show``, and the two that it prints."""
    shown = done('show', logs[0])
    calibrate, evaluate = commands(shown)
    assert 'temperature_c=temp:F' in shown
    assert 'force_z=fz:kN,torque_x=tx,' in shown
    assert '--time' in calibrate
    assert 'learnt from 1.00 h at 22.0 to 3' in done(*calibrate)
    words = [word.replace('another_day', 'day_2') for word in evaluate]
    axes = json.loads(done(*words, '--json'))['axes']
    assert all(axis['rms_after'] < 0.1 * axis['rms_before'] for axis in axes.values())
    assert axes['force_z']['rms_before'] > 1.0  # N: the map's units were used


@pytest.mark.parametrize(
    ('force', 'torque', 'kilo'),
    [(1, 1, False), (1, 1000, False), (1e-3, 1, True), (0.03, 1, True), (1e-3, 0, True)],
)
def test_kilonewtons_are_guessed_where_newtons_cannot_be(done, tmp_path, force, torque, kilo):
    """Not of torques in N mm; a force alone has to move by less than its noise would."""
    t, wrench, celsius = day(1)
    rows = np.column_stack((t, wrench[:, 2] * force, wrench[:, 3] * torque, celsius))
    log = write(tmp_path / 'log.csv', 'time,fz,tx,temp', rows.tolist())
    assert ('force_z=fz:kN' in done('show', log)) == kilo


def test_a_map_beside_the_recordings_is_written_once(logs, done, tmp_path):
    shown = done('show', logs[0])
    recipe = shown[shown.index('columns: ') :]
    (tmp_path / 'recording.yaml').write_text(recipe.split('\nwarning')[0])
    done('calibrate', *logs[:2], '-o', 'model.yaml', '--method', 'pls')
    compensated = tmp_path / 'compensated'
    compensated.mkdir()
    done('compensate', 'model.yaml', logs[1], '-o', compensated / 'day_2.csv', '--tare', '60')
    (compensated / 'recording.yaml').write_text((tmp_path / 'recording.yaml').read_text())
    header, row = (compensated / 'day_2.csv').read_text().splitlines()[:2]
    assert header.startswith('time;fx;fy;fz')
    assert abs(float(row.split(';')[3].replace(',', '.'))) < 1e-4  # kN, with a decimal comma


def test_a_bump_is_left_out_and_named_by_the_files_own_time(logs, done):
    """Also where a part is cut off, times count from the file's first stamp."""
    words = ['calibrate', logs[2], '-o', 'model.yaml', '--method', 'pls']
    words += commands(done('show', logs[2]))[0][4:]
    for cut in ([], ['--from', '600']):
        said = done(*words, *cut)
        assert re.search(r'stands out by up to \S+ N for \d+ s in all, first at 0:40:0', said), (
            said
        )


def test_a_name_with_a_sign_of_maps_has_to_be_another_one(tmp_path, run):
    log = write(tmp_path / 'log.csv', 'time,ft:fz,ft:temp', [[0.0, 1.0, 2.0]])
    said = run('calibrate', log, '-o', tmp_path / 'model.yaml').sentence
    assert said.endswith('or rename it; none of , : * = may be in its name.')


def test_a_part_behind_the_end_is_named_as_that(logs, run):
    words = ['calibrate', logs[0], '-o', 'model.yaml', '--from', '3h', '--time', 'iso']
    words += ['--columns', 'stamp=time,force_z=fz:kN,temperature_c=temp:F']
    assert 'day_1.csv, which lasts 3599 s: what counts begins at 10800 s' in run(*words).sentence


def test_a_part_without_any_wrench_or_temperature_is_named_as_that(run, make, tmp_path):
    path = make.csv(tmp_path / 'day.csv', make.drifting())
    words = ['calibrate', path, '-o', tmp_path / 'model.yaml']
    for given in (['--exclude', '0..3h'], ['--exclude', '0..5min', '--exclude', '4min..8min']):
        assert run(*words, *given).sentence.endswith(
            'Every wrench of day.csv, which lasts 399 s, is left out by --from, --until and '
            '--exclude. Leave some in.'
        )
    day = make.drifting()
    day['temperature_c'][:200] = [None] * 200
    make.csv(path, day)
    assert 'Every temperature of day.csv, which' in run(*words, '--until', '150').sentence


def test_a_map_beside_recordings_of_which_one_has_other_columns_is_named(logs, run, done, make):
    shown = done('show', logs[0])
    beside = logs[0].with_name('recording.yaml')
    beside.write_text(shown[shown.index('columns: ') :].split('\nwarning')[0])
    own = make.csv(logs[0].with_name('own.csv'), make.drifting())
    assert run('show', own).sentence.endswith(
        "own.csv has no column 'fx', which recording.yaml beside it names; it has stamp_s, "
        'temperature_c, force_z, torque_x. Move one of them into another folder, or say by '
        '--columns what the columns of own.csv are.'
    )
    done('show', own, '--columns', 'stamp=stamp_s')
    given = run('show', own, '--columns', 'stamp=t').sentence
    assert "no column 't', which --columns names; it has stamp_s, temp" in given
    (own.parent / 'other').mkdir()
    done('show', own.rename(own.parent / 'other/own.csv'))


#: Of an RTDE recording (record.py of Universal Robots' client): separated by spaces.
RTDE = ['timestamp', *(f'actual_TCP_force_{n}' for n in range(6)), 'joint_temperatures_5']
OURS = ['stamp', *AXES, 'temperature_c']
#: Forms in which logs come: header, delimiter, and the map where names alone do not tell it.
FORMS = {
    'RTDE': (' '.join(RTDE), ' ', ','.join(map('='.join, zip(OURS, RTDE, strict=True)))),
    'units in brackets': (
        'Time [s],Fx [N],Fy [N],Fz [N],Mx [Nm],My [Nm],Mz [Nm],Temperature [°C]', ',', ''),
    'units in parentheses': ('time;Fx(N);Fy(N);Fz(N);Tx(Nm);Ty(Nm);Tz(Nm);temp(C)', ';', ''),
    'tabs': ('Time\tFx\tFy\tFz\tTx\tTy\tTz\tTemp', '\t', ''),
    'underscores': ('timestamp,f_x,f_y,f_z,m_x,m_y,m_z,sensor_temperature', ',', ''),
}  # fmt: skip


#: A header, and how many of its units are a unit of this package: of stamps, forces and torques.
UNITS = {
    'ms and N*m': ('Time [ms],Fz [N],Tx [N*m],T [degC]', 1e3, 1, 1),
    'kN and N-mm': ('Time (sec),Fz (kN),Tx (N-mm),Temp (C)', 1, 1e-3, 1e3),
    'pounds': ('Time (seconds),Fz (lb),Tx (lbf-in),Temp (C)', 1, 1 / 4.4482216, 8.8507458),
    'us and N cm': ('time [µs],Fz [N],Mx [N cm],T1 [°C]', 1e6, 1, 100),
    'hours and cN': ('t (h),Fz [cN],Mx [N·m],T(deg C)', 1 / 3600, 100, 1),
    'minutes': ('Time [min],Fz [0] (N),Mx [N.m] (raw),Temp', 1 / 60, 1, 1),
    'kilopond': ('t,Fz[kgf],Mx[kgfm],T[C]', 1, 1 / 9.80665, 1 / 9.80665),
    'a unit behind time': ('time_ms,Fz,Mx,T', 1e3, 1, 1),
    'a unit behind t': ('t_us,Fz,Mx,T', 1e6, 1, 1),
    'hours behind time': ('time_h,Fz,Mx,T', 1 / 3600, 1, 1),
}


@pytest.mark.parametrize('form', UNITS)
def test_units_in_a_header_are_read_by_guess_and_by_a_map_that_names_none(form, done, tmp_path):
    """As the guess writes them, and where a person gives the columns alone."""
    header, *factors = UNITS[form]
    t, wrench, celsius = day(1)
    expected = np.column_stack((t, wrench[:, 2:4], celsius))
    path = write(tmp_path / 'log.csv', header, (expected * [*factors, 1]).tolist())
    words = commands(done('show', path))[0]
    guess = words[words.index('--columns') + 1], words[words.index('--time') + 1]
    ours = 'stamp', 'force_z', 'torque_x', 'temperature_c'
    given = ','.join(map('='.join, zip(ours, header.split(','), strict=True)))
    for columns, time in (guess, (given, '')):
        recording = read_recording(path, topics=Topics(columns=columns, time=time))
        assert recording.duration_s == pytest.approx(ROWS, abs=2)
        assert not recording.warnings
        # A thousandth of a second of rounding puts a sample into the neighbouring cell.
        for i, axis in enumerate((2, 3)):
            mean = np.nanmean(recording.wrench[:, axis])
            assert mean == pytest.approx(expected[:, 1 + i].mean(), rel=1e-3), columns


def test_a_unit_that_is_not_understood_is_named_with_the_one_that_is_taken(
    done, tmp_path, monkeypatch
):
    """By ``show`` and by ``calibrate``, until a person says what it is."""
    monkeypatch.chdir(tmp_path)
    t, wrench, celsius = day(1)
    rows = np.column_stack((t, wrench[:, 2:4], celsius)).tolist()
    path = write(tmp_path / 'log.csv', 't (days),Fz (N),Tx (N-foo),Temp (C)', rows)
    words = [*commands(done('show', path))[0], '--method', 'pls', '--json']
    said = (
        'log.csv names units that are not understood: t (days) is read in s, Tx (N-foo) is read '
        "in Nm. Put the right one, or a factor, behind the column, such as 'torque_x=Tx "
        "(N-foo):Nm' or 'torque_x=Tx (N-foo)*0.001'."
    )
    assert f'warning: {said}' in done('show', path)
    assert said in json.loads(done(*words))['warnings']
    torques = []
    for behind in (':Nm', '*0.001', ':Nmm'):
        given = [word.replace('(N-foo)', f'(N-foo){behind}') for word in words]
        given = [word.replace('t (days)', 't (days)*1') for word in given]
        printed = json.loads(done(*given))
        assert 'not understood' not in str(printed['warnings'])
        torques.append(printed['axes']['torque_x']['rms_before'])
    assert torques[1:] == pytest.approx([0.001 * torques[0]] * 2)


@pytest.mark.parametrize(('unit', 'size'), [('ms', 1e3), ('us', 1e6), ('ns', 1e9)])
def test_a_number_that_is_too_large_for_seconds_leads_to_its_unit(unit, size, run, done, tmp_path):
    t, wrench, celsius = day(1)
    times = [str(round(size * (1_700_000_000 + s))) for s in t.tolist()]
    rows = list(zip(times, wrench[:, 2].tolist(), celsius.tolist(), strict=True))
    path = write(tmp_path / 'log.csv', 'clock,Fz,Temp', rows)
    words = ['calibrate', path, '-o', tmp_path / 'model.yaml', '--method', 'pls']
    example = run(*words).sentence.split("such as --columns '")[1].split("'")[0]
    said = run(*words, '--columns', example).sentence
    assert f"column stamp_s: '{times[0]}' is too large for s. Say --time {unit}." in said
    done(*words, '--columns', example, '--time', unit)
    (tmp_path / 'recording.yaml').write_text(f'columns: {example}\n')
    assert f'is too large for s. Write time: {unit} into recording.yaml.' in run(*words).sentence
    (tmp_path / 'recording.yaml').write_text(f'columns: {example}\ntime: {unit}\n')
    done(*words)
    (tmp_path / 'recording.yaml').unlink()
    path = write(tmp_path / 'own.csv', 'stamp_s,force_z,temperature_c', rows)
    words[1] = path
    said = run(*words).sentence
    assert f"'{times[0]}' is too large for s. Name the column stamp_{unit}." in said
    write(path, f'stamp_{unit},force_z,temperature_c', rows)
    done(*words)


#: As ``rostopic echo -p`` writes the header.
ECHOED = ','.join(('%time,field.header.frame_id', *(
    f'field.wrench.{axis.replace("_", ".")}' for axis in AXES), 'field.temperature'))  # fmt: skip
#: Lines down to the header that stands behind a sign of comments, and what separates cells.
COMMENTED = {
    'rostopic': (ECHOED, ','),
    'numpy.savetxt': ('# cell 3\n# t Fx Fy Fz Tx Ty Tz T\n# s N N N Nm Nm Nm C', ' '),
    'semicolons': ('#t;Fx;Fy;Fz;Tx;Ty;Tz;T\n\n# begin', ';'),
}


@pytest.mark.parametrize('form', COMMENTED)
def test_a_header_behind_a_comment_sign_is_read_and_copied(form, done, tmp_path):
    header, delimiter = COMMENTED[form]
    t, wrench, celsius = day(1)
    rows = np.column_stack((t, wrench, celsius)).tolist()
    if form.startswith('rostopic'):
        rows = [[str(round((s + 1.7e9) * 1e9)), 'ft', *row] for s, *row in rows]
    path = write(tmp_path / 'log.csv', header, rows, delimiter, comma=delimiter == ';')
    calibrate, evaluate = commands(done('show', path))
    model = ['-o', tmp_path / 'model.yaml', '--method', 'pls']
    done(*(word for word in calibrate if word not in {'-o', 'model.yaml'}), *model)
    columns = evaluate[3:]
    copy = tmp_path / 'copy.csv'
    done('compensate', model[1], path, '-o', copy, '--tare', '60', *columns)
    recording, compensated = (
        read_recording(p, topics=Topics(columns=columns[1], time=columns[3])) for p in (path, copy)
    )
    np.testing.assert_allclose(recording.wrench, wrench, atol=1e-6)
    np.testing.assert_allclose(recording.temperature_c[:, 0], celsius, atol=1e-6)
    assert np.abs(compensated.wrench[:, 2]).max() < 0.2
    assert 'copy.csv was compensated already' in compensated.warnings[0]


@pytest.mark.parametrize('above', ['ATI Net F/T log\nSerial: FT12345\n', 'ATI log\nFT 123\n'])
def test_lines_above_a_header_have_to_be_comments(above, run, done, tmp_path):
    t, wrench, celsius = day(1)
    path = write(tmp_path / 'log.csv', 't,Fz,T', np.column_stack((t, wrench[:, 2], celsius)))
    rows = path.read_text()
    path.write_text(f'{above}\n{rows}')
    for command in (['show', path], ['calibrate', path, '-o', tmp_path / 'model.yaml']):
        assert run(*command).sentence.endswith(
            f'Line 1 of log.csv ({above.splitlines()[0]!r}) is no header of the lines below it, '
            'which have other numbers of cells. Put # before every line above the header.'
        )
    path.write_text(
        f'# {above.strip()}\n{rows}'.replace('\nSerial', '\n# S').replace('\nFT', '\n# ')
    )
    assert 'Learn from it' in done('show', path)


@pytest.mark.parametrize('form', FORMS)
def test_logs_of_many_forms_are_read_as_the_same_table(form, done, tmp_path):
    header, delimiter, columns = FORMS[form]
    t, wrench, celsius = day(1)
    rows = np.column_stack((t, wrench, celsius)).tolist()
    path = write(tmp_path / 'log.csv', header, rows, delimiter)
    words = commands(done('show', path, *(['--columns', columns] if columns else [])))[0]
    given = columns or words[words.index('--columns') + 1]
    time = words[words.index('--time') + 1] if '--time' in words else 's'
    recording = read_recording(path, topics=Topics(columns=given, time=time))
    np.testing.assert_allclose(recording.wrench, wrench, atol=1e-6)
    np.testing.assert_allclose(recording.temperature_c[:, 0], celsius, atol=1e-6)


def test_seconds_and_nanoseconds_in_two_columns_make_one_stamp(done, run, tmp_path):
    """As ROS messages come where fields are written one by one; seconds alone repeat."""
    t, wrench, celsius = day(1)
    ns = (t * 0.3 * 1e9).astype(np.int64) + 1_700_000_000_123_456_789
    names = ['stamp.sec', 'stamp.nanosec', 'wrench.force.z', 'temperature']
    rows = [
        [str(at // 10**9), f'{at % 10**9}.0', force, reading]
        for at, force, reading in zip(ns.tolist(), wrench[:, 2], celsius, strict=True)
    ]
    path = write(tmp_path / 'log.csv', ','.join(f'header.{name}' for name in names), rows)
    words = commands(done('show', path))[0]
    given = words[words.index('--columns') + 1]
    recording = read_recording(path, topics=Topics(columns=given))
    table = {
        'stamp_s': ns // 10**9, 'stamp_nanosec': ns % 10**9,
        'force_z': wrench[:, 2], 'temperature_c': celsius,
    }  # fmt: skip
    whole = {'stamp_ns': ns, 'force_z': wrench[:, 2], 'temperature_c': celsius}
    for expected in map(recording_from_columns, (table, whole)):
        assert recording.first_cell == expected.first_cell == 1_700_000_000
        np.testing.assert_allclose(recording.wrench, expected.wrench, atol=1e-6)
        np.testing.assert_allclose(recording.temperature_c, expected.temperature_c, atol=1e-6)
    given = given.replace('stamp=', 'stamp_ms=')
    sentence = run('show', path, '--columns', given).sentence
    assert 'nanoseconds beside stamps that are not in seconds' in sentence
    path.write_text(path.read_text().replace(rows[7][1], 'late'))
    sentence = run('show', path).sentence
    assert 'Line 9 of log.csv, column stamp_nanosec: expected nanoseconds, got' in sentence


def test_times_are_read_to_the_nanosecond_and_refused_where_they_are_none():
    expected = 1_795_161_600_123_456_789
    assert iso_nanoseconds('2026-11-20T08:00:00.123456789Z') == expected
    assert iso_nanoseconds('2026-11-20 09:00:00,123456789+01:00') == expected
    stamp = log_map('stamp=t', '%d.%m.%Y %H:%M:%S').stamp
    assert stamp('20.11.2026 08:00:00') == expected // 10**9 * 10**9
    for text in ("8 o'clock", '2026-13-01T00:00:00', ''):
        with pytest.raises(ValueError):  # noqa: PT011 -- the door makes a sentence of it
            iso_nanoseconds(text)


@pytest.mark.parametrize(
    ('columns', 'time', 'words'),
    [
        ('force_z', '', 'expected NAME=COLUMN'),
        ('force_w=fz', '', 'force_w is no name of a column'),
        ('force_z=fz:Nm', '', 'force_z may be in N, kN'),
        ('temperature_c=t:R', '', 'A temperature is in C, K or F'),
        ('stamp=t', 'days', '--time is ns, us, ms, s, min, h, iso'),
        ('stamp=t:days', '', 'A stamp is in ns, us, ms, s, min, h'),
        ('force_z=fz*-', '', 'A factor is a number'),
        ('force_z=fz*1e999', '', 'A factor is a number'),
    ],
)
def test_a_map_that_cannot_be_meant_so_is_refused(columns, time, words):
    with pytest.raises(SettingsError, match=re.escape(words)):
        log_map(columns, time)


@pytest.mark.parametrize(
    ('header', 'example'),
    [
        ('t,load_cell,celsius', 'stamp=t,temperature_c=celsius,force_z=load_cell'),
        ('a,b,c', 'stamp=a,force_z=b,temperature_c=c'),
        ('stamp_s,fz,gauge', 'force_z=fz,temperature_c=gauge'),
    ],
)
def test_where_no_columns_can_be_guessed_the_refusal_leads_to_a_map(
    header, example, tmp_path, run, done
):
    t, wrench, celsius = day(1)
    rows = np.column_stack((t, wrench[:, 2], celsius)).tolist()
    path = write(tmp_path / 'log.csv', header, rows)
    words = ['calibrate', path, '-o', tmp_path / 'model.yaml', '--method', 'pls']
    assert f"such as --columns '{example}'" in run(*words).sentence
    done(*words, '--columns', example)


@pytest.mark.parametrize(
    ('header', 'channels'),
    [
        ('"time", "Fz", "Temp"', 'stamp force_z temperature_c'),
        ('t,Fz,T_sensor,T_x,T1', 'stamp force_z temperature_c torque_x temperature_2_c'),
        ('time,T,Fz', 'stamp temperature_c force_z'),
        ('t,fz,force_z2,forcex,torque_y_raw,T', 'stamp force_z - force_x torque_y temperature_c'),
        # As PlotJuggler and others write a bag's topics.
        (
            '__time,/ft/wrench/force/x,/ft/wrench/torque/z,/true/wrench/force/x,/ft/temperature',
            'stamp force_x torque_z reference_force_x temperature_c',
        ),
    ],
)
def test_columns_are_what_their_names_say(header, channels, tmp_path, done):
    names = [name.strip(' "') for name in header.split(',')]
    rows = np.column_stack([23 + np.arange(9.0)] * len(names)).tolist()
    words = commands(done('show', write(tmp_path / 'log.csv', header, rows)))[0]
    given = words[words.index('--columns') + 1].split(',')
    meant = zip(channels.split(), names, strict=True)
    assert given == [f'{channel}={name}' for channel, name in meant if channel != '-']


def test_a_time_that_is_no_number_leads_to_a_form_of_times(tmp_path, run):
    t, wrench, celsius = day(1)
    times = [f'{BEGIN + timedelta(seconds=s):%d.%m.%Y %H:%M:%S}' for s in t.tolist()]
    rows = zip(times, wrench[:, 2].tolist(), celsius.tolist(), strict=True)
    log = write(tmp_path / 'log.csv', 'Zeit;Fz;Temperatur', rows, ';')
    example = '--columns', 'force_z=Fz,temperature_c=Temperatur,stamp=Zeit'
    assert ' '.join((example[0], f"'{example[1]}'")) in run('show', log).sentence
    sentence = run('show', log, *example).sentence
    assert 'say what it is: --time iso, or a form such as --time "%d.%m.%Y %H:%M:%S";' in sentence
    sentence = run('show', log, *example, '--time', 'iso').sentence
    assert 'Line 2 of log.csv' in sentence
    assert "expected a time as --time says, got '20." in sentence
    assert run('show', log, *example, '--time', '%d.%m.%Y %H:%M:%S').code == 0


def test_a_map_that_was_given_is_called_no_guess(logs, done):
    given = ['--columns', 'stamp=time,force_z=fz:kN,temperature_c=temp:F', '--time', 'iso']
    assert 'the map is a guess' in done('show', logs[0])
    shown = done('show', logs[0], *given)
    assert 'guess' not in shown
    assert 'columns: stamp=time,force_z=fz:kN,temperature_c=temp:F\ntime: iso' in shown
    recipe = shown[shown.index('columns: ') :].split('\nwarning')[0]
    (logs[0].parent / 'recording.yaml').write_text(recipe)
    assert 'guess' not in done('show', logs[0])


def test_a_part_is_chosen_in_every_way_of_writing_a_time(logs):
    assert parse_part('80min', '1.5h', ['1:20:00..81min']) == Part(4800, 5400, ((4800, 4860),))
    given = 'stamp=time,force_z=fz:kN,temperature_c=temp:F'
    part = Topics(columns=given, time='iso', begin='600', end='0:30:00', exclude=('700..800',))
    recording = read_recording(logs[0], topics=part)
    assert recording.duration_s == pytest.approx(1201, abs=1)
    measured = np.isfinite(recording.wrench[:, 2])
    assert (~measured).sum() == 101
    assert np.isfinite(recording.temperature_c).all()
    for bad in (('x', '', []), ('', '', ['5']), ('9', '3', []), ('', '', ['9..3'])):
        with pytest.raises(SettingsError):
            parse_part(*bad)
