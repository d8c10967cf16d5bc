"""Tables in the forms of real recorders: what ``show`` prints leads to the right channels."""

from datetime import datetime, timedelta, timezone
from itertools import pairwise
import json
import os
from pathlib import Path
import re
import shlex
import subprocess
import sys

import numpy as np
import pytest
import yaml

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.recording import Topics
from wrist_ft_comp.recordings import table
from wrist_ft_comp.recordings.read import read_recording

ROWS, STEP_S = 360, 10
BEGIN = datetime(2026, 3, 5, 7, tzinfo=timezone.utc)
_LIST = Path(__file__).parents[1] / 'fixtures/logs/forms.yaml'
FORMS = {form['name']: form for form in yaml.safe_load(_LIST.read_text('utf-8'))}
#: What "holds" may say, as channels.
HELD = {
    'force': AXES[:3], 'torque': AXES[3:], 'T': ['temperature_c'], 'T2': ['temperature_2_c'],
}  # fmt: skip
#: The first stamp by "begin", s.
BEGINS_S = {'zero': 0, 'day': 7 * 3600, 'epoch': BEGIN.timestamp()}
#: What rounding in a table may cost, N, N m and °C.
TOLERANCES = {'force': 0.02, 'torque': 0.002, 'temperature': 0.06}


def hour(seed=0):
    """An hour of warming up: seconds, and by channel N, N m and °C."""
    rng = np.random.default_rng(seed)
    t = np.arange(ROWS) * float(STEP_S)
    temperature_c = 22 + 13 * (1 - np.exp(-t / 900)) + np.sin(t / (400 + 50 * seed))
    other_c = 24 + 9 * (1 - np.exp(-t / 1500)) + 0.7 * np.cos(t / 700)
    wrench = np.outer(temperature_c - 22, [0.3, 0.2, 0.9, 0.02, 0.01, 0.015])
    wrench += [12.5, -7.25, 31.0, 0.4, -0.3, 0.15]
    wrench += rng.normal(0, [0.02] * 3 + [0.001] * 3, wrench.shape)
    channels = dict(zip(AXES, wrench.T, strict=True))
    return t, {**channels, 'temperature_c': temperature_c, 'temperature_2_c': other_c}


def c(number, digits):
    return f'{number:.{digits}f}'.replace('.', ',')


def write(form, folder, seed=0):
    t, channels = hour(seed)
    row = compile(f'f{form["row"]!r}', form['name'], 'eval')
    short = ['fx', 'fy', 'fz', 'tx', 'ty', 'tz', 'T', 'T2']
    lines = []
    for k, values in enumerate(zip(t, *channels.values(), strict=True)):
        names = dict(zip(['t', *short], values, strict=True))
        later_s = names['t'] + 86_400 * seed + form.get('later', 0)
        at = BEGIN + timedelta(seconds=later_s)
        names.update(k=k, c=c, at=at, epoch=at.timestamp())
        lines.append(eval(row, names))  # noqa: S307 -- our own forms
    head, tail = ([form[part].rstrip('\n')] if form.get(part) else [] for part in ('head', 'tail'))
    lines = [*head, *lines, *tail]
    path = folder / form.get('file', 'log.csv')
    if path.suffix == '.xlsx':
        from openpyxl import Workbook  # noqa: PLC0415 -- rarely there

        book = Workbook()
        # A long log goes on in another sheet.
        head, *rows = (line.split(',') for line in lines)
        for sheet, part in ((book.active, rows[:900]), (book.create_sheet('2'), rows[900:])):
            sheet.append(head)
            sheet.append(['', 'N', 'N', 'N', '°C'])
            for cells in part:
                sheet.append([cells[0], *map(float, cells[1:])])
        book.save(path)
    else:
        path.write_bytes(('\n'.join(lines) + '\n').encode(form.get('encoding', 'utf-8')))
    return path


def truth(form):
    """Tell the first stamp, s, and the values by channel; None where nothing can be learnt."""
    begin = form.get('begin', 'epoch' if '{at:%' in form['row'] else 'zero')
    held = [x for word in form['holds'].split() for x in HELD.get(word, [word])]
    _, channels = hour()
    begin_s = BEGINS_S[begin] + form.get('offset', 0) + form.get('later', 0)
    return begin_s, {name: channels.get(name) for name in held}


def told(command):
    """What a command that show prints says of a table, as Topics take it."""
    words = shlex.split(command)
    options = dict(pairwise(words))
    return Topics(columns=options.get('--columns', ''), time=options.get('--time', ''))


def follow(said):
    """Run the command of a sentence, as a person does."""
    command = re.search('python3 -c ".*"|(?<=").*(?=")', said)[0]
    python = f'{Path(sys.executable).parent}{os.pathsep}{os.environ["PATH"]}'
    subprocess.run(command, shell=True, check=True, env={**os.environ, 'PATH': python})  # noqa: S602


@pytest.mark.parametrize('name', FORMS)
def test_what_is_printed_leads_to_right_channels_units_and_times(name, run, tmp_path, monkeypatch):
    form = FORMS[name]
    path = write(form, tmp_path)
    if mended := form.get('mended'):
        monkeypatch.chdir(tmp_path)
        follow(run('show', path).sentence)
        path = tmp_path / mended
    outcome = run('show', path, '--json')
    assert outcome.code == ('open' in form), 'nothing could be read'
    shown = json.loads(outcome.out)
    topics = told(shown['commands'][0])
    assert topics.columns == form.get('proposed', topics.columns)
    if 'open' in form:
        assert '…' in shown['commands'][0]
        assert 'in the place of …' in shown['refusal']
        words = ['calibrate', path, '-o', 'model.yaml']
        assert f"such as --columns '{topics.columns}'" in run(*words).sentence
        refused = run(*words, '--columns', topics.columns).sentence
        assert 'is left open: put its name, or its number' in refused
        text = run('show', path).out
        assert text.count(topics.columns) == 1
        assert 'samples' not in text, 'nothing of it was read'
        topics = Topics(columns=form['open'], time=topics.time)
    begin_s, channels = truth(form)
    maps = [topics, Topics(columns=form['said'])] if 'said' in form else [topics]
    for recording in (read_recording(path, topics=topics) for topics in maps):
        assert 'said' not in form or not recording.warnings
        assert recording.first_cell == pytest.approx(begin_s, abs=1)
        assert recording.duration_s == pytest.approx((ROWS - 1) * STEP_S, abs=2)
        assert set(recording.axes_present) == {*AXES} & {*channels}
        assert recording.thermometers == len(channels.keys() - {*AXES})
        columns = np.where(recording.measured, recording.temperature_c, np.nan).T
        found = dict(zip(['temperature_c', 'temperature_2_c'], columns, strict=False))
        found |= dict(zip(AXES, recording.wrench.T, strict=True))
        for channel, values in channels.items():
            read = found[channel][np.isfinite(found[channel])]
            tolerance = TOLERANCES[channel.split('_')[0]]
            np.testing.assert_allclose(read, values, atol=tolerance, err_msg=channel)


def test_there_are_many_forms_of_many_recorders():
    assert len(FORMS) >= 85
    assert len({form['recorder'].split()[0] for form in FORMS.values()}) >= 25
    assert all(form['source'] for form in FORMS.values())
    assert sum('open' not in form for form in FORMS.values()) >= 80


def test_what_is_replaced_in_lines_may_lie_across_blocks(tmp_path, monkeypatch):
    monkeypatch.setattr(table, 'BLOCK', 331)
    path = write(FORMS['arduino_monitor_labels'], tmp_path)
    topics = Topics(columns='stamp=1,force_z=3,temperature_c=4')
    assert len(read_recording(path, topics=topics, period_s=STEP_S)) == ROWS


@pytest.mark.parametrize('name', ['ur_rtde_record', 'excel_de', 'picolog'])
def test_a_model_is_learnt_and_judged_as_printed(name, done, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = write(FORMS[name], tmp_path)
    (tmp_path / 'another').mkdir()
    other = write(FORMS[name], tmp_path / 'another', seed=1)
    path = path.rename(tmp_path / f'run.2024-05-01{path.suffix}')
    calibrate, evaluate = json.loads(done('show', path, '--json'))['commands']
    assert f'ANOTHER_DAY{path.suffix}' in shlex.split(evaluate)
    *_, advice = json.loads(done(*shlex.split(calibrate)[1:], '--json'))['advice']
    for command in (evaluate, advice.splitlines()[-1]):
        words = [other if 'ANOTHER_DAY' in word else word for word in shlex.split(command)[1:]]
        axes = json.loads(done(*words, '--json'))['axes']
        assert axes['force_z']['rms_after'] < 0.2 * axes['force_z']['rms_before']


@pytest.mark.parametrize(('names', 'stamp'), [
    (('t;Kraft [kN];Flansch [°C]', 'Datum,Temp'), lambda at: f'{at:%d.%m.%Y %H:%M:%S}'),
    (('time;Kraft [kN];Temp', 'time,Temp'), datetime.timestamp),
])  # fmt: skip
def test_two_files_with_one_clock_are_one_recording(names, stamp, done, tmp_path):
    t, channels = hour()
    celsius = np.stack([channels['temperature_c'], channels['temperature_2_c']], axis=1)
    force, heat = ([name] for name in names)
    for second, n, (warm, other) in zip(t.tolist(), channels['force_z'], celsius, strict=True):
        at = BEGIN + timedelta(seconds=second)
        force.append(f'{at.timestamp() * 1e3:.0f};{n / 1e3:.7f};{warm:.2f}')
        heat.append(f'{stamp(at)},{other:.2f}')
    (tmp_path / 'force.csv').write_text('\n'.join([*force, '']))
    (tmp_path / 'heat.csv').write_text('\n'.join([*heat, '']))
    joined = tmp_path / 'force.csv+heat.csv'
    (command, _) = json.loads(done('show', joined, '--json'))['commands']
    recording = read_recording(joined, topics=told(command))
    np.testing.assert_allclose(recording.wrench[::10, 2], channels['force_z'], atol=1e-3)
    np.testing.assert_allclose(recording.temperature_c[::10], celsius, atol=0.01)
    words = shlex.split(command)[1:]
    words[words.index('force.yaml')] = str(tmp_path / 'model.yaml')
    done(*words, '--method', 'pls')
    options = words[words.index('--columns') :]
    done('compensate', tmp_path / 'model.yaml', joined, '-o', tmp_path / 'copy.csv', *options)
    stamps = np.loadtxt(tmp_path / 'copy.csv', delimiter=',', skiprows=1, usecols=0)
    assert len(stamps) == 2 * ROWS
    assert (np.diff(stamps) >= 0).all()


def test_numbers_of_columns_go_on_through_joined_tables(run, tmp_path):
    t, channels = hour()
    for name, channel in (('one', 'force_z'), ('two', 'temperature_c')):
        rows = zip(t, channels[channel], strict=True)
        text = ''.join(f'{at:.0f},{value:.4f}\n' for at, value in rows)
        (tmp_path / f'{name}.csv').write_text(text)
    joined = tmp_path / 'one.csv+two.csv'
    assert 'got 1, 2, 3, 4.' in run('show', joined).out
    assert 'join both' in run('show', tmp_path / 'one.csv').out
    assert 'twice: for stamp' in run('show', joined, '--columns', 'stamp=1,stamp=1:ms').sentence
    said = Topics(columns='stamp=1,force_z=2,stamp=3,temperature_c=4')
    recording = read_recording(joined, topics=said)
    np.testing.assert_allclose(recording.wrench[::10, 2], channels['force_z'], atol=1e-4)
    np.testing.assert_allclose(recording.temperature_c[::10, 0], channels['temperature_c'], 1e-4)


@pytest.mark.parametrize('block', [1234, table.BLOCK])
def test_a_file_whose_clock_begins_anew_is_refused(block, run, tmp_path, monkeypatch):
    monkeypatch.setattr(table, 'BLOCK', block)
    form = {**FORMS['dewesoft'], 'head': 'Time (s);Fx (N);Fy (N);Fz (N);T int (°C)'}
    days = [write(form, tmp_path, seed).read_text('utf-8') for seed in (0, 1)]
    path = tmp_path / 'days.csv'
    path.write_text(''.join(days), 'utf-8')
    assert f'days.csv begins anew in line {ROWS + 3}.' in run('show', path).sentence
    header, *rows = days[0].splitlines()
    path.write_text('\n'.join([header, *reversed(rows), '']), 'utf-8')
    assert 'has its newest row first. Sort it by time.' in run('show', path).sentence


def test_a_clock_that_ran_over_may_be_replaced_by_the_count_of_rows(run, tmp_path):
    form = {'name': 'micros', 'head': 'micros,Fz (N),Temp (C)'}
    path = write({**form, 'row': '{(epoch * 1e6) % 2**32:.0f},{fz:.3f},{T:.2f}'}, tmp_path)
    assert 'count them: stamp=#*0.01 is a hundred a second' in run('show', path).sentence
    columns = 'stamp=#*10,force_z=2,temperature_c=3'
    recording = read_recording(path, topics=Topics(columns=columns))
    assert recording.duration_s == pytest.approx(ROWS * STEP_S, abs=STEP_S)


def test_a_force_as_a_thermometer_and_a_reference_of_nothing_are_told(done, tmp_path):
    t, channels = hour()
    rows = zip(t, channels['force_x'], channels['force_z'], channels['temperature_c'], strict=True)
    lines = [f'{a:.0f},{x:.3f},{z:.3f},{T:.2f},0,0' for a, x, z, T in rows]
    names = 'Time s,Fx / N,Fz / N,T1 / °C,reference_force_x,reference_force_z'
    path = tmp_path / 'log.csv'
    path.write_text('\n'.join([names, *lines, '']), encoding='utf-8')
    said = done('show', path, '--columns', 'stamp=Time s,force_z=Fz / N,temperature_c=Fx / N')
    assert 'Fx / N of log.csv is in N, a unit that is not understood' in ' '.join(said.split())
    assert '--reference' not in done('show', path)
