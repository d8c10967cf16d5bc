"""Tables: exact stamps, what other programs write, cut-off files, a sentence for what is bad."""

import bz2
from contextlib import closing
from decimal import Decimal
import gzip
import lzma
import math
import sys

from hypothesis import given, HealthCheck, settings
from hypothesis import strategies as st
import numpy as np
import pandas
import pytest

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recording import Topics
from wrist_ft_comp.recordings import table as table_file
from wrist_ft_comp.recordings.read import open_recording, read_recording
from wrist_ft_comp.stored.recording_writer import CsvRecordingWriter

EPOCH = 1_723_248_197_123_456_789
HEADER = 'stamp_s,force_z,temperature_c\n'
UNSHARED = settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture])


def all_samples(path, columns='', time=''):
    """Stamps and values per channel, over all blocks; and what was left out."""
    channels = {}
    with open_recording(path, Topics(columns=columns, time=time)) as opened:
        for block in opened.samples():
            for column, channel in enumerate(block.channels):
                stamps, values = channels.setdefault(channel, ([], []))
                stamps.extend(block.stamps_ns.tolist())
                values.extend(block.values[:, column].tolist())
        return channels, opened.warnings


#: A stamp, its unit or form, and the nanoseconds.
STAMPS = [
    ('1723248197.123456789', 's', EPOCH), ('-0.5', 's', -500_000_000), ('.25', 's', 250_000_000),
    (' 3. ', 's', 3_000_000_000), ('1.5e3', 's', 1_500_000_000_000),
    ('0.30000000000000004', 's', 300_000_000), ('0.0000000009', 's', 1),
    ('1.7232481971234567e9', 's', 1_723_248_197_123_456_700),
    ('1723248197123.456789', 'ms', EPOCH), (str(EPOCH), 'ns', EPOCH),
    ('2024-08-10T00:03:17.123456789Z', 'iso', EPOCH),
    ('2024-08-10 01:03:17.123456789+01:00', 'iso', EPOCH),
    ('10.08.2024 00:03:17.123456789', '%d.%m.%Y %H:%M:%S.%f', EPOCH),
    ('2024-08-10', 'iso', EPOCH - EPOCH % (86_400 * 10**9)),
    (str(EPOCH), '*1e-9', EPOCH), ('1723248197123.456789', '*0.001', EPOCH),
]  # fmt: skip


@pytest.mark.parametrize(('text', 'time', 'ns'), STAMPS)
@pytest.mark.parametrize('count', [1, 3])
def test_stamps_become_nanoseconds_exactly(make_csv, text, time, ns, count):
    """A factor makes seconds of numbers, whatever their size."""
    path = make_csv('stamp_s,force_z\n' + f'{text},1\n' * count + '# end')
    said = (f'stamp=stamp_s{time},force_z=force_z',) if time[0] == '*' else ('', time)
    assert all_samples(path, *said)[0]['force_z'] == ([ns] * count, [1.0] * count)


@given(st.lists(st.integers(-(10**19) // 2, 10**19 // 2), min_size=1, max_size=30, unique=True))
@UNSHARED
def test_any_nanosecond_survives_being_written_as_seconds(make_csv, stamps):
    rows = '\n'.join(f'{Decimal(ns).scaleb(-9):f},1' for ns in stamps)
    assert all_samples(make_csv(f'stamp_s,force_z\n{rows}\n'))[0]['force_z'][0] == stamps


CELLS = st.one_of(st.floats(-1e9, 1e9), st.just(math.nan))


@given(st.lists(st.tuples(st.integers(0, 2**62), CELLS, CELLS, CELLS), min_size=1, max_size=20,
                unique_by=lambda row: row[0]))  # fmt: skip
@UNSHARED
def test_a_written_recording_is_read_back(tmp_path_factory, rows):
    path = tmp_path_factory.mktemp('csv') / 'own.csv'
    channels = ('force_x', 'force_y', 'temperature_c')
    with closing(CsvRecordingWriter(path, channels)) as writer:
        for stamp, *values in rows:
            writer.append(stamp, values)
        writer.close()
    samples, warnings = all_samples(path)
    assert warnings == ()
    for column, channel in enumerate(channels, 1):
        kept = [(row[0], row[column]) for row in rows if not math.isnan(row[column])]
        stamps, values = samples.get(channel, ((), ()))
        assert list(stamps) == [stamp for stamp, _ in kept]
        np.testing.assert_allclose(values, [value for _, value in kept], 1e-12, 1e-15)


#: The same six rows as other programs write them, and what has to be said of them.
SAID = 'stamp=t,force_z=Fz,temperature_c=T'
ROWS = [(0, 1.5, 20.25), (1, -2.5, 20.5), (2, 1e-3, 20.75), (3, 4.0, 21.0), (4, 5.5, 21.5),
        (5, 6.0, 22.0)]  # fmt: skip


def lines(  # noqa: PLR0913 -- it names what can vary
    delimiter=',', *, above='t,Fz,T', behind='', comma=False, end='\n', quote=''
):
    sign = ',' if comma else '.'
    rows = [[f'{quote}{value}{quote}'.replace('.', sign) for value in row] for row in ROWS]
    text = [above.replace(',', delimiter), *(delimiter.join(row) + behind for row in rows), '']
    return end.join(text)


FORMS = {
    'latin-1': (lines() + '# 5 °C\n').encode('latin-1'),
    'spaces': lines('   '),
    'spaces and decimal commas': lines(' ', behind=' ', comma=True),
    'a trailing delimiter in the header': lines(above='t,Fz,T,'),
    'a column without cells': lines('\t', above='t,Fz,T,Comment'),
    'comments': '# cell 3\n' + lines(above='% new\nt,Fz,T\n// begin'),
    'numpy.savetxt': lines(' ', above='# t,Fz,T\n#\n# begin'),
    'units and statistics': lines(above='"TOA5","CR1000"\nt,Fz,T\nTS,N,Deg C\n,Avg,Smp'),
    'missing ones': lines() + '6,NaN,N/A\n7,-,---\n8,null,\n9, ,  \n,,\n\n',
    'headers of segments': lines(above='Date,5/3,5/3\nt,Fz,T') + 'Date,6/3,6/3\nt,Fz,T\n\n',
    'a word before all': ('FT,' + lines(end='\nFT,') + ',,\n\n').replace('FT,3', 'mean,3'),
    'a text column': 't,Fz,note,T\n' + ''.join(
        f'{t},{force},"{note}",{reading}\n'
        for (t, force, reading), note in zip(
            ROWS, ('', 'a, b', 'c', 'two\nlines', '""', 'x'), strict=True)),
}  # fmt: skip


@pytest.mark.parametrize('header', ['t,T,Fz', 't,Fz,Tz,T'])
def test_a_log_that_goes_on_with_other_columns_is_refused(make_csv, header):
    path = make_csv(f'{lines()}{header}\n7,20.0,1.0\n')
    with pytest.raises(RecordingError, match=r'Line 8 of run\.csv names other columns, or'):
        all_samples(path, SAID)


@pytest.mark.parametrize('form', FORMS)
@pytest.mark.parametrize('block', [40, table_file.BLOCK])
def test_every_form_of_a_table_holds_the_same(make_csv, monkeypatch, form, block):
    monkeypatch.setattr(table_file, 'BLOCK', block)
    samples, warnings = all_samples(make_csv(FORMS[form]), SAID)
    stamps = [row[0] * 10**9 for row in ROWS]
    assert samples['force_z'] == (stamps, [row[1] for row in ROWS])
    assert samples['temperature_c'] == (stamps, [row[2] for row in ROWS])
    assert not [warning for warning in warnings if 'not understood' not in warning]


WRITTEN = st.fixed_dictionaries({
    'above': st.sampled_from(['t,Fz,T', 'logger °\nt,Fz,T', 'one\r\ntwo\r\nt,Fz,T']),
    'behind': st.booleans(), 'comma': st.booleans(), 'end': st.sampled_from(['\n', '\r\n']),
    'quote': st.sampled_from(['', '"']),
})  # fmt: skip
ENCODINGS = st.sampled_from(['utf-8', 'utf-8-sig', 'cp1252', 'utf-16'])


PACKED = st.sampled_from([bytes, gzip.compress, bz2.compress, lzma.compress])


@given(st.sampled_from(',;\t|'), WRITTEN, ENCODINGS, PACKED)
@UNSHARED
def test_a_table_is_the_same_whatever_it_is_written_with(make_csv, sign, form, encoding, pack):
    form = form | {'behind': sign * form['behind'], 'comma': form['comma'] and sign != ','}
    data = lines(sign, **form).encode(encoding)
    samples, _ = all_samples(make_csv(pack(data)), SAID)
    assert samples['force_z'] == ([row[0] * 10**9 for row in ROWS], [row[1] for row in ROWS])
    assert samples['temperature_c'][1] == [row[2] for row in ROWS]


def test_whole_numbers_may_have_empty_cells_behind_them(make_csv):
    rows = ''.join(f'{k},{k},20,,\n' for k in range(30))
    assert len(read_recording(make_csv(f'stamp_s,force_z,temperature_c\n{rows}'))) == 30


def test_channels_that_pandas_concat_puts_below_others_are_read(make_csv):
    parts = [pandas.DataFrame({'t': range(40), name: 20.5}) for name in ('Fz', 'T')]
    samples, _ = all_samples(make_csv(pandas.concat(parts).to_csv()), SAID)
    assert samples['force_z'] == ([k * 10**9 for k in range(40)], [20.5] * 40)
    assert samples['temperature_c'] == samples['force_z']


@pytest.mark.parametrize('index', [[], ['t'], ['t', 'Fz']])
def test_a_parquet_file_holds_the_same(make_csv, monkeypatch, index):
    """Its library is not among those of the tests; what pandas gives of it is."""
    frame = pandas.DataFrame(ROWS, columns=['t', 'Fz', 'T'])
    frame = frame.set_index(index) if index else frame
    monkeypatch.setattr(pandas, 'read_parquet', lambda *_: frame)
    path = make_csv(b'PAR1', 'log.parquet')
    assert all_samples(path, SAID)[0]['force_z'][1] == [row[1] for row in ROWS]


@pytest.mark.parametrize(('name', 'library'), [('a.xlsx', 'openpyxl'), ('a.parquet', 'pyarrow')])
def test_what_a_missing_library_reads_is_a_sentence(make_csv, monkeypatch, name, library):
    monkeypatch.setitem(sys.modules, library, None)
    monkeypatch.setitem(sys.modules, 'pyarrow.parquet', None)
    remedy = f"cannot be read by {library} .* 'pip install {library}' if"
    with pytest.raises(RecordingError, match=remedy):
        all_samples(make_csv(b'PK', name))


@pytest.mark.parametrize('line', ['#1,1,99,20', '//,1,99,20', 'Min,0,99,20', '"",Max:,99,20'])
def test_a_line_that_is_no_sample_is_none_where_its_first_cells_are_not_used(make_csv, line):
    path = make_csv(f',stamp_s,force_z,temperature_c\n0,0,1,20\n1,1,2,20\n{line}\n2,2,3,20\n')
    assert all_samples(path)[0]['force_z'] == ([0, 10**9, 2 * 10**9], [1.0, 2.0, 3.0])


@pytest.mark.parametrize('form', ['{0};{1:,.1f};{2}', '{0},"{1:,.1f}",{2}', '{0}\t{1:,.0f}\t{2}'])
@pytest.mark.parametrize(('first', 'step'), [(990, 1 / 40), (1030, -1 / 8)])
def test_thousands_that_are_in_the_first_or_in_the_last_rows_only_are_read(
    make_csv, form, first, step
):
    forces = [float(round(first + step * k)) for k in range(2000)]
    rows = '\n'.join(form.format(k, force, f'2{k % 7}.5') for k, force in enumerate(forces))
    header = form.format('stamp_s', 1, 'temperature_c').replace('1.0', '1').replace('"', '')
    path = make_csv(f'{header.replace("1", "force_z")}\n{rows}\n')
    assert all_samples(path)[0]['force_z'] == ([k * 10**9 for k in range(2000)], forces)


def test_rows_of_one_stamp_all_count(make_csv):
    path = make_csv(f'{HEADER}0,1,20\n0,3,21\n1,5,22\n2,7,\n2,9,24\n')
    recording = read_recording(path)
    assert recording.wrench[:, 2].tolist() == [2.0, 5.0, 8.0]
    assert recording.temperature_c[:, 0].tolist() == [20.5, 22.0, 24.0]


#: Times of day, and seconds since midnight; a row that is late there is of the day before.
NIGHTS = [
    ([f'{h}:{m:02}' for h in (22, 23, 0, 1) for m in range(0, 60, 10)], range(-7200, 7200, 600)),
    (['23:59:57', '23:59:59', '00:00:01', '23:59:58', '00:00:02'], [-3, -1, 1, -2, 2]),
]


@pytest.mark.parametrize(('times', 'seconds'), NIGHTS)
@pytest.mark.parametrize('block', [60, table_file.BLOCK])
def test_a_time_of_day_goes_on_after_midnight(make_csv, monkeypatch, times, seconds, block):
    monkeypatch.setattr(table_file, 'BLOCK', block)
    rows = ''.join(f'{at},{k},20\n' for k, at in enumerate(times))
    stamps, _ = all_samples(make_csv(f't,Fz,T\n{rows}'), SAID)[0]['force_z']
    assert stamps == [(86_400 + second) * 10**9 for second in seconds]


#: What is in the file, and words of the sentence: what was expected, and where.
BAD = [
    ('', 'run.csv is empty'),
    ('\n', 'run.csv is empty'),
    (HEADER, 'no complete row'),
    (HEADER.strip(), 'no complete row'),
    ('0.1,2,3\n0.2,2,3\n', 'no stamp .* got 1, 2, 3.*number of a column'),
    ('stamp_s,force_z,force_z,temperature_c\n0,1,1,1\n', 'force_z twice'),
    ('stamp_s,stamp_s,force_z\n0,1,1\n', 'stamp twice'),
    (HEADER + '0,1,20\n1,1\n2,1,20\n', 'Line 3 of run.csv has 2 cells.*3'),
    (HEADER + '0,1,20\n1,1\n2,7,1,20\n3,1,20\n', 'Line 3 of run.csv has 2 cells'),
    (HEADER + '0,1,20\n1,1,202,1,20\n\n3,1,20\n', 'Line 3 of run.csv has 5 cells'),
    (HEADER + '0,1,20\n\n1,1,2,3\n', 'Line 4 of run.csv has 4 cells'),
    (HEADER + '0,"1",20\n\n1,1\n', 'Line 4 of run.csv has 2 cells'),
    (HEADER + '0,1,20\n1,abc,20\n', "Line 3 of run.csv, column force_z.*number.*'abc'"),
    (HEADER + '0,1,20\n1,1_0,20\n', "Line 3 of run.csv, column force_z.*number.*'1_0'"),
    (HEADER + '0,1,20\n1,1,\n2,1,x\n', "Line 4 of run.csv, column temperature_c.*got 'x'"),
    ('stamp_s;force_z;temperature_c\n' + '0;1.5;20\n' * 300 + '1;1,5;20\n', "a number, got '1,5'"),
    (lines(comma=True), 'have 5 cells below 3 names, and no decimal points. If .* are commas'),
    ('stamp_s;force_z;temperature_c\n0;1,5,0;20\n', "expected a number, got '1,5,0'"),
    *((f'{HEADER}0,1,20\n{bad},1,20\n', f"Line 3 of run.csv, column stamp_s.*got '{bad}'")
      for bad in ('', '-', 'nan', '1e40', '1_0', '8 h')),
    ('stamp_ns,force_z,temperature_c\n99999999999999999999,1,2\n', "stamp_ns.*'9999"),
    ('stamp_ns,force_z,temperature_c\n1,1,2\nnan,1,2\n', "Line 3 .*column stamp_ns.*got 'nan'"),
    ('stamp_s,stamp_nanosec,force_z,temperature_c\n1,1,1,2\n2,,1,2\n', "stamp_nano.*got ''"),
    ('stamp_s,stamp_nanosec,force_z,temperature_c\n1.5,1,1,2\n', 'decimals, to which stamp_nan'),
    ('force_z,temperature_c,stamp_s\n1,20\n2,21\n', 'column stamp_s: expected a time'),
    (b'\x89PNG\r\n\x1a\n\0\0\r\n', 'is no text'),
]  # fmt: skip


@pytest.mark.parametrize(('text', 'sentence'), BAD)
def test_a_bad_file_is_refused_in_one_sentence_that_names_the_place(make_csv, text, sentence):
    with pytest.raises(RecordingError, match=sentence):
        read_recording(make_csv(text))


@pytest.mark.parametrize('tail', ['2,1', '2,1,-x', '2', '2,1,2x', '\0\0\0\0'])
def test_a_cut_off_last_line_is_left_out_with_a_warning_and_a_complete_one_kept(make_csv, tail):
    samples, (warning,) = all_samples(make_csv(f'{HEADER}0,1,20\n1,1,20\n{tail}'))
    assert samples['force_z'] == ([0, 10**9], [1.0, 1.0])
    assert 'Line 4 of run.csv is cut off' in warning
    samples, (warning,) = all_samples(make_csv(f'{HEADER}0,1,20\n1,1,2'))
    assert samples['temperature_c'][1] == [20.0, 2.0]
    assert "temperature_c = '2'" in warning


def test_a_file_cut_anywhere_keeps_every_complete_row(tmp_path, make_csv):
    path = tmp_path / 'own.csv'
    with closing(CsvRecordingWriter(path, ('force_z', 'temperature_c'))) as writer:
        for k in range(4):
            writer.append(EPOCH + k, [0.1 * k, 20.25 if k % 2 else math.nan])
    whole = path.read_bytes()
    begin = whole.index(b'\n') + 1
    for end in range(whole.index(b'\n', begin) + 1, len(whole)):
        samples, _ = all_samples(make_csv(whole[:end]))
        complete = whole[:end].count(b'\n') - 1
        assert samples['force_z'][0][:complete] == [EPOCH + k for k in range(complete)]


def test_the_writer_refuses_an_existing_file_and_a_missing_folder(tmp_path):
    path = tmp_path / 'own.csv'
    path.write_text('mine')
    for target, reason in ((path, 'File exists'), (tmp_path / 'no' / 'own.csv', 'No such')):
        with pytest.raises(RecordingError, match=f'cannot be written: {reason}'):
            CsvRecordingWriter(target, ('force_z',))
    assert path.read_text() == 'mine'
