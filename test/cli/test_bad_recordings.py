"""
One table of bad recordings: whatever door they come through, one sentence, and nothing is lost.

A refusal is exit code 1 and one line on standard error; what is only dropped or doubted is a
warning of ``calibrate``, beside its model. Columns in memory are tested in
test/recordings/test_in_memory.py, a running node in test/node/compensator/test_input_faults.py.
"""

import json
import re
import resource
import subprocess
import sys

import numpy as np
import pytest

ROWS = 600
EPOCH_S = 1_723_248_197.0
ALL = ('csv', 'mcap')
COLUMNS = ('csv',)
#: Of one storage: that all hold the same is tested in test/recordings.
BAGS = ('mcap',)


def good():
    """A warm-up of ten minutes at 1 Hz, unloaded."""
    t = np.arange(ROWS, dtype=float)
    warm = 21 + 12 * (1 - np.exp(-t / 150)) + 2 * np.sin(t / 40)
    force = 1.5 * (warm - 21) + np.random.default_rng(0).normal(0, 0.02, ROWS)
    return {'stamp_s': EPOCH_S + t, 'force_x': force / 2, 'force_z': force, 'temperature_c': warm}


def put(channel, value, *places):
    """Give a channel, or its samples at some places, a value, or a function of what they were."""

    def change(table):
        values = table.setdefault(channel, np.zeros(ROWS))
        at = list(places) if places else slice(None)
        values[at] = value(values[at]) if callable(value) else value

    return change


def rename(channel, name, function=lambda values: values):
    """Give a column another name, and perhaps another unit."""

    def change(table):
        items = [(name, function(v)) if c == channel else (c, v) for c, v in table.items()]
        table.clear()
        table.update(items)

    return change


def without(*channels):
    return lambda table: [table.pop(channel) for channel in channels]


def both(*changes):
    return lambda table: [change(table) for change in changes]


def plus(offset):
    return lambda values: values + offset


def frozen(first, last):
    """Let force z keep its value for some rows."""
    return put('force_z', lambda values: values[0], *range(first, last + 1))


EVERY_TENTH = range(0, ROWS, 10)
#: Name: change, pattern of the sentence, doors. These are refused …
REFUSED = {
    'kelvin in °C': (
        put('temperature_c', plus(273.15)),
        r'600 of 600 .* Check its unit: .* a topic :temperature:K\.$',
        ALL,
    ),
    'absolute zero in a tenth': (
        put('temperature_c', -273.15, *EVERY_TENTH), '60 of 600 .* such as -273.1 °C', ALL),
    'temperature never a number': (put('temperature_c', np.inf), '600 of 600 .* not finite', ALL),
    'a wrench that overflows': (put('force_z', 1e300), 'are outside -1e\\+09 to 1e\\+09', ALL),
    'stamps run back': (
        put('stamp_s', lambda v: np.roll(v[::-1], 1)), '598 of 600 .* ran back', ALL),
    'stamps of years out of few rows': (
        put('stamp_s', plus(3e8), ROWS - 1), r'span 3\S*e\+08 s; at most \d+ thermal cells', ALL),
    'a first stamp of 1970': (
        put('stamp_s', 1.0, 0), r'span 1.72\d+e\+09 s; at most', ALL),
    'milliseconds called seconds': (
        put('stamp_s', lambda v: 1e5 * (v - EPOCH_S)),
        r'span 5.99\S*e\+07 s.*by the column, such as stamp_ms, or, .* by --time ms', COLUMNS),
    'microseconds called nanoseconds': (
        rename('stamp_s', 'stamp_ns', lambda v: ((v - EPOCH_S) * 1000).astype(int)),
        r'600 samples within 0.000599 s.*such as stamp_ms', COLUMNS),
    'no stamp': (
        without('stamp_s'), 'no stamp column; expected stamp_s .or .* got f', COLUMNS),
    'time instead of a stamp': (
        rename('stamp_s', 'time'), "say what they are, such as --columns 'stamp=time'", COLUMNS),
    'no wrench': (
        without('force_x', 'force_z'),
        'no raw wrench column; expected any of force_x, .*force_z=…', COLUMNS),
    'a wrench that is never read': (
        both(put('force_x', np.nan), put('force_z', np.nan)),
        'holds no wrench. .* of force_x, .*; got temperature_c', COLUMNS),
    'no temperature': (
        without('temperature_c'), 'no temperature column; expected temperature_c.*, got', COLUMNS),
    'a second thermometer without a first': (
        rename('temperature_c', 'temperature_2_c'), 'no temperature column', COLUMNS),
    'one thermometer in two units': (
        put('temperature_k', 3e2), 'temperature_c twice, in the columns temp', COLUMNS),
    'a gap in the numbers of thermometers': (
        put('temperature_3_c', 20.0), 'no usable temperature_2_c', COLUMNS),
    'two clocks': (None, r'17232\d+ s ahead of .*; all drivers must use one clock', BAGS),
    'a thermometer of another clock': (None, 'are 240 s behind those of /wrench_raw', BAGS),
    'no stamp at all': (None, 'header stamp 0', BAGS),
    'thermometer without a stamp': (
        None, 'header stamp 0.* /temperature:temperature takes', BAGS),
    'two sensors on one topic': (None, 'left and right come by turns, and are mixed', BAGS),
    'a stamp taken for a temperature': (None, 'such as 1.72\\d+e\\+09 °C', BAGS),
    'hands on it all the time': (
        put('force_z', plus(30.0), *[row for row in range(5, ROWS) if row % 40 < 4]),
        r'moves by up to 3.* for 9 % of the time, although the load was declared unl', COLUMNS),
    'every axis dead': (
        both(put('force_z', 0.0), put('force_x', 0.0)), 'keeps one value throughout', COLUMNS),
    'every axis dead, or frozen for minutes': (
        both(frozen(400, 599), put('force_x', 0.0)), 'freezes at .*up to 5 % can', COLUMNS),
}  # fmt: skip
#: … and these give a model, with a warning.
WARNED = {
    'a tare of the driver': (
        put('force_z', plus(30.0), *range(300, ROWS)),
        r'steps at 0:0\d:\d\d \(2024-08-10 00:0\d:\d\d UTC\): .*force_z by [23]\d.* new', COLUMNS),
    'one spike': (
        put('force_z', plus(60.0), 300),
        r'force_z of .* stands out by up to \d\d.* N for 1 s in all, first at 0:05:00', COLUMNS),
    'a reading of 85 °C, as of a thermometer that was not ready': (
        put('temperature_c', 85.0, 300),
        r'1 of 600 samples changed faster than metal can, .* with 85.0 °C; left out', ALL),
    'columns that nobody knows': (
        both(put('note', 1.0), put('Torque_Z', 1.0), put('force_y_kn', 1.0)),
        r'used: note, Torque_Z, force_y_kn. .*force_y=force_y_kn:kN,torque_z=Torque_Z', COLUMNS),
    'a thermometer more': (
        put('temp_motor', 30.0), 'temperature_2_c=temp_motor', COLUMNS),
    'a week': (
        put('stamp_s', lambda v: 1020 * (v - EPOCH_S)), r'lasts 7.1 days', COLUMNS),
    'a wrench without a stamp': (None, '1 of 600 samples have no stamp', BAGS),
    'a dead axis': (put('force_y', 0.1), 'force_y reads 0.1 N throughout: the', COLUMNS),
    'an axis frozen for minutes': (
        frozen(400, 599), r'force_z of .* freezes at 1\S+ N: (200|199) s .* left out', COLUMNS),
    'an axis at its end for a minute': (
        put('force_z', lambda v: np.minimum(v, 16.0)),
        r'force_z of .* saturates at 16 N: .* without any change, .*; force_z is left', COLUMNS),
    'an axis frozen for seconds': (
        frozen(200, 229), r'force_z of .* freezes at \S+ N: 30 s .*; left out\.', COLUMNS),
    'a thermometer that stands still': (
        put('temperature_2_c', 24.0), 'Thermometer 2 reads 24.0 °C all the time', COLUMNS),
    'a thermometer that never reports': (
        put('temperature_2_c', np.nan), 'temperature_2_c of .* holds no sample; it is', COLUMNS),
    'an IMU that feels no gravity': (
        both(*(put(f'linear_acceleration_{axis}', 0.0) for axis in 'xyz')),
        'does not feel gravity, and counts as absent', COLUMNS),
}  # fmt: skip


#: What ``show`` cannot know, which looks at samples one by one.
UNSEEN = (
    'one spike', 'a tare', 'a dead axis', 'an axis', 'a thermometer that stands',
)  # fmt: skip


def cases(rows):
    return [(kind, door) for kind, (_, _, doors) in rows.items() for door in doors]


def thermometers(table):
    return [f'/{name[:-2]}' for name in table if name.startswith('temperature')]


def parts(tell, table, kind):
    """Make wrenches and temperatures, received when they should have been measured."""
    for k, values in enumerate(zip(*table.values(), strict=True)):
        row = dict(zip(table, values, strict=True))
        at_ns, received_ns = round(row['stamp_s'] * 1e9), round((EPOCH_S + k) * 1e9)
        wrench_ns = at_ns - round(EPOCH_S * 1e9) if kind == 'two clocks' else at_ns
        if kind == 'no stamp at all' or (kind == 'a wrench without a stamp' and not k):
            wrench_ns = 0
        stamp_ns = 0 if kind == 'thermometer without a stamp' else at_ns
        stamp_ns -= 240 * 10**9 if kind == 'a thermometer of another clock' else 0
        force = [row['force_x'], row.get('force_y', 0.1), row['force_z']]
        if not np.isnan(force).any():
            frame = 'right' if kind == 'two sensors on one topic' and k % 2 else 'left'
            data = tell.wrench(wrench_ns, [*force, 0.01, 0.02, 0.03], frame)
            yield '/wrench_raw', tell.wrench_type, received_ns, data
        for topic in thermometers(table):
            value = row[f'{topic[1:]}_c']
            if not np.isnan(value):
                data = tell.temperature(stamp_ns, value)
                yield topic, tell.temperature_type, received_ns + 1000, data


@pytest.fixture
def write(make, messages, tmp_path):
    """Write a bad recording; gives the words that name it, and the pattern of what is said."""

    def write_bad(rows, kind, form):
        table = good()
        change, pattern, _ = rows[kind]
        if change:
            change(table)
        if form == 'csv':
            return [make.csv(tmp_path / 'day.csv', table)], pattern
        path = messages.write(tmp_path / 'day', parts(messages, table, kind), form)
        topics = ['/temperature:header.stamp.sec'] if 'taken for' in kind else thermometers(table)
        return [path, *(w for topic in topics for w in ('--temperature-topic', topic))], pattern

    return write_bad


@pytest.mark.parametrize(('kind', 'form'), cases(REFUSED))
def test_a_bad_recording_is_refused_in_one_sentence(kind, form, write, run, tmp_path):
    words, pattern = write(REFUSED, kind, form)
    before = sorted(tmp_path.rglob('*'))
    command = ['calibrate', *words, '--method', 'pls', '-o', tmp_path / 'model.yaml']
    assert re.search(pattern, run(*command).sentence)
    assert sorted(tmp_path.rglob('*')) == before


@pytest.mark.parametrize(
    'kind', ['kelvin in °C', 'a first stamp of 1970', 'milliseconds called seconds', 'two clocks']
)
def test_show_proposes_nothing_that_is_bound_to_be_refused(kind, write, run):
    words, pattern = write(REFUSED, kind, REFUSED[kind][2][0])
    shown = run('show', *words).out
    assert re.search(f'Nothing can be learnt from it( with these topics)?. .*{pattern}', shown)
    assert 'wrist_ft_comp calibrate' not in shown
    document = json.loads(run('show', *words, '--json').out)
    assert re.search(pattern, document['refusal'])
    assert not any(document['refusal'].endswith(warning) for warning in document['warnings'])


@pytest.mark.parametrize(('kind', 'form'), cases(WARNED))
def test_dropped_samples_and_doubts_are_warnings(kind, form, write, done, tmp_path):
    words, pattern = write(WARNED, kind, form)
    commands = [['calibrate', *words, '-o', tmp_path / 'model.yaml', '--method', 'pls', '--json']]
    if not kind.startswith(UNSEEN):
        commands.append(['show', *words, '--json'])
    for command in commands:
        warnings = json.loads(done(*command))['warnings']
        assert any(re.search(pattern, warning) for warning in warnings)


HEADER = 'stamp_s,force_z,temperature_c\n'
MANY = ','.join(f'temperature_{j}_c' for j in range(2, 99))
ROW = ','.join(['20'] * 97)
HUNGRY = {
    'a line without an end': (b'\0', 3 << 30, 'more than 1000000 characters'),
    'hundred thermometers, a week': (
        f'{HEADER.strip()},{MANY}\n0,1,20,{ROW}\n600000,1,30,{ROW}\n'.encode(), 0, 'at most'),
    'three weeks in two rows': (f'{HEADER}0,1,20\n1800000,2,30\n'.encode(), 0, 'at least 24'),
    'a temperature beyond all': (
        (HEADER + ''.join(f'{k},{k % 7},{k / 9}\n' for k in range(200))
         + '200,1,1e10\n').encode(), 0, ''),
}  # fmt: skip


@pytest.mark.parametrize('kind', HUNGRY)
def test_memory_is_bounded_whatever_a_file_holds(kind, tmp_path):
    content, size, sentence = HUNGRY[kind]
    path = tmp_path / 'hungry.csv'
    with path.open('wb') as file:
        file.write(content)
        file.truncate(max(size, len(content)))  # a hole, which takes no room on the disk
    command = [sys.executable, '-m', 'wrist_ft_comp', 'calibrate', path, '-o', tmp_path / 'm.yaml']

    def one_gigabyte():
        resource.setrlimit(resource.RLIMIT_DATA, (1 << 30, 1 << 30))

    done = subprocess.run(
        [*command, '--report', tmp_path / 'm.html'], stderr=subprocess.PIPE, text=True,
        timeout=100, check=False, preexec_fn=one_gigabyte)  # fmt: skip
    assert 'Traceback' not in done.stderr
    assert done.returncode == (1 if sentence else 0), done.stderr
    assert sentence in done.stderr
