"""CSV recordings: exact stamps, empty cells, cut-off files, and a sentence for everything bad."""

from contextlib import closing
from decimal import Decimal
import math

from hypothesis import given, HealthCheck, settings
from hypothesis import strategies as st
import pytest

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recordings import csv_file as csv_text
from wrist_ft_comp.recordings.csv_file import CsvRecording, CsvRecordingWriter
from wrist_ft_comp.recordings.recordings import read_recording

EPOCH = 1_723_248_197_123_456_789


def all_samples(path):
    """Stamps and values per channel, over all blocks."""
    recording = CsvRecording(path)
    channels = {}
    for block in recording.samples():
        for column, channel in enumerate(block.channels):
            stamps, values = channels.setdefault(channel, ([], []))
            stamps.extend(block.stamps_ns.tolist())
            values.extend(block.values[:, column].tolist())
    return channels, recording.warnings


@pytest.mark.parametrize(
    ('text', 'ns'),
    [
        ('1723248197.123456789', EPOCH),
        ('1723248197', 1_723_248_197_000_000_000),
        ('-0.5', -500_000_000),
        ('.25', 250_000_000),
        (' 3. ', 3_000_000_000),
        ('2.5 ', 2_500_000_000),
        ('1.5e3', 1_500_000_000_000),
        ('0.30000000000000004', 300_000_000),
        ('0.0000000009', 1),
        ('1.7232481971234567e9', 1_723_248_197_123_456_700),
    ],
)
def test_seconds_become_nanoseconds_exactly(make_csv, text, ns):
    samples, _ = all_samples(make_csv(f'stamp_s,force_z\n{text},1\n'))
    assert samples['force_z'][0] == [ns]


@given(st.lists(st.integers(-(10**19) // 2, 10**19 // 2), min_size=1, max_size=30))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_nanosecond_survives_being_written_as_seconds(make_csv, stamps):
    rows = '\n'.join(f'{Decimal(ns).scaleb(-9):f},1' for ns in stamps)
    samples, _ = all_samples(make_csv(f'stamp_s,force_z\n{rows}\n'))
    assert samples['force_z'][0] == stamps


@pytest.mark.parametrize('delimiter', [',', ';', '\t'])
@pytest.mark.parametrize('end', ['\n', '\r\n'])
@pytest.mark.parametrize('mark', ['', '\ufeff'])
def test_delimiters_line_ends_and_byte_order_marks_make_no_difference(
    make_csv, delimiter, end, mark
):
    rows = ('stamp_ns,force_x,torque_z,temperature_c', '5,1.5,-2,20', '', '6,nan,inf,21')
    path = make_csv(mark + end.join((*rows, '')).replace(',', delimiter))
    samples, warnings = all_samples(path)
    assert samples['temperature_c'] == ([5, 6], [20.0, 21.0])
    assert samples['force_x'][1][0] == 1.5
    assert math.isnan(samples['force_x'][1][1])
    assert samples['torque_z'][1] == [-2.0, math.inf]
    assert warnings == []


def test_empty_cells_are_no_samples_wherever_they_are(make_csv):
    path = make_csv(
        'stamp_ns,force_x,force_y,temperature_c,temperature_2_c,reference_force_x,note\n'
        '1,1,2,20, ,,a\n2,3,4,,,,b\n3,5,,21,30,,c\n4,,6,,,,d\n'
    )
    samples, _ = all_samples(path)
    assert samples == {
        'force_x': ([1, 2, 3], [1.0, 3.0, 5.0]),
        'force_y': ([1, 2, 4], [2.0, 4.0, 6.0]),
        'temperature_c': ([1, 3], [20.0, 21.0]),
        'temperature_2_c': ([3], [30.0]),
        'reference_force_x': ([], []),
    }


def test_a_group_that_is_full_or_empty_together_is_one_block(make_csv):
    path = make_csv('stamp_ns,force_x,force_y,temperature_c\n1,1,2,\n2,,,20\n3,3,4,21\n')
    blocks = list(CsvRecording(path).samples())
    assert [block.channels for block in blocks] == [('force_x', 'force_y'), ('temperature_c',)]
    assert blocks[0].values.tolist() == [[1.0, 2.0], [3.0, 4.0]]


def test_chunks_of_any_size_give_the_same_samples(make_csv, monkeypatch):
    rows = [f'{k},{k % 5},{20 + k if k % 3 == 0 else ""}' for k in range(200)]
    path = make_csv('\n'.join(('stamp_ns,force_z,temperature_c', *rows, '')))
    whole, _ = all_samples(path)
    monkeypatch.setattr(csv_text, 'ROWS', 7)
    assert all_samples(path)[0] == whole
    assert len(whole['force_z'][0]) == 200
    assert len(whole['temperature_c'][0]) == 67


def test_quoted_cells_are_read(make_csv):
    path = make_csv('stamp_ns,note,force_z,temperature_c\n1,"a, ""b""","2.5",20\n2,c,3,21\n')
    assert all_samples(path)[0]['force_z'] == ([1, 2], [2.5, 3.0])


HEADER = 'stamp_s,force_z,temperature_c\n'


@pytest.mark.parametrize(
    ('text', 'sentence'),
    [
        ('', 'run.csv is empty'),
        ('\n', 'run.csv is empty'),
        (HEADER, 'no complete row'),
        (HEADER.strip(), 'no complete row'),
        ('0.1,2,3\n0.2,2,3\n', 'Line 1 of run.csv must be a header'),
        ('stamp_s,force_z,force_z,temperature_c\n0,1,1,1\n', 'column force_z twice'),
        ('stamp_s,stamp_s,force_z\n0,1,1\n', 'column stamp_s twice'),
        (HEADER + '0,1,20\n1,1\n2,1,20\n', 'Line 3 of run.csv has 2 cells.*3 columns'),
        (HEADER + '0,1,20\n\n1,1,2,3\n', 'Line 4 of run.csv has 4 cells'),
        (HEADER + '0,"1",20\n\n1,1\n', 'Line 4 of run.csv has 2 cells'),
        (HEADER + '0,1,20\n1,abc,20\n', "Line 3 of run.csv, column force_z.*number.*'abc'"),
        (HEADER + '0,1,20\n1,1,\n2,1,x\n', "Line 4 of run.csv, column temperature_c.*got 'x'"),
        ('stamp_s;force_z;temperature_c\n0;1,5,0;20\n', "decimal point, got '1,5,0'"),
        (HEADER + '0,1,20\n,1,20\n', "Line 3 of run.csv, column stamp_s.*decimal number.*got ''"),
        (HEADER + '-,1,20\n', "column stamp_s.*'-'"),
        (HEADER + '. ,1,20\n', "column stamp_s.*'. '"),
        (HEADER + 'nan,1,20\n', "column stamp_s.*'nan'"),
        (HEADER + '1e40,1,20\n', "column stamp_s.*'1e40'"),
        ('stamp_ns,force_z,temperature_c\n1.5,1,20\n', "column stamp_ns.*whole.*'1.5'"),
        ('stamp_ns,force_z,temperature_c\n99999999999999999999,1,2\n', "stamp_ns.*'9999"),
        (b'stamp_s,force_z\n\xff\xfe,1\n', 'no UTF-8 text'),
        (b'\x89PNG\r\n\x1a\n\0\0', 'UTF-8'),
    ],
)
def test_a_bad_file_is_refused_in_one_sentence_that_names_the_place(make_csv, text, sentence):
    with pytest.raises(RecordingError, match=sentence):
        read_recording(make_csv(text))


@pytest.mark.parametrize('tail', ['2,1', '2,1,-', '2', '2,1,2x', '\0\0\0\0'])
def test_a_cut_off_last_line_is_left_out_with_a_warning(make_csv, tail):
    samples, warnings = all_samples(make_csv(f'{HEADER}0,1,20\n1,1,20\n{tail}'))
    assert samples['force_z'] == ([0, 10**9], [1.0, 1.0])
    assert len(warnings) == 1
    assert 'Line 4 of run.csv is cut off' in warnings[0]


def test_a_complete_last_line_without_line_end_is_kept_and_mentioned(make_csv):
    samples, warnings = all_samples(make_csv(f'{HEADER}0,1,20\n1,1,2'))
    assert samples['temperature_c'][1] == [20.0, 2.0]
    assert "temperature_c = '2'" in warnings[0]


CELLS = st.one_of(st.floats(allow_nan=False, width=64), st.just(math.nan))


@given(st.lists(st.tuples(st.integers(0, 2**62), CELLS, CELLS, CELLS), min_size=1, max_size=20))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_written_recording_is_read_back_exactly(tmp_path_factory, rows):
    path = tmp_path_factory.mktemp('csv') / 'own.csv'
    channels = ('force_x', 'force_y', 'temperature_c')
    with closing(CsvRecordingWriter(path, channels)) as writer:
        for stamp, *values in rows:
            writer.append(stamp, values)
        writer.sync()
        writer.close()
    samples, warnings = all_samples(path)
    assert warnings == []
    for column, channel in enumerate(channels, 1):
        kept = [(row[0], row[column]) for row in rows if not math.isnan(row[column])]
        assert list(zip(*samples.get(channel, ((), ())), strict=True)) == kept


def test_the_writer_refuses_an_existing_file_and_a_missing_folder(tmp_path):
    path = tmp_path / 'own.csv'
    path.write_text('mine')
    with pytest.raises(RecordingError, match=r'own.csv cannot be written: File exists'):
        CsvRecordingWriter(path, ('force_z',))
    assert path.read_text() == 'mine'
    with pytest.raises(RecordingError, match='cannot be written'):
        CsvRecordingWriter(tmp_path / 'no' / 'own.csv', ('force_z',))


def test_a_file_cut_anywhere_keeps_every_complete_row(tmp_path, make_csv):
    path = tmp_path / 'own.csv'
    with closing(CsvRecordingWriter(path, ('force_z', 'temperature_c'))) as writer:
        for k in range(8):
            writer.append(EPOCH + k, [0.1 * k, 20.25 if k % 2 else math.nan])
    whole = path.read_bytes()
    begin = whole.index(b'\n') + 1
    for end in range(whole.index(b'\n', begin) + 1, len(whole)):
        samples, _ = all_samples(make_csv(whole[:end]))
        complete = whole[:end].count(b'\n') - 1
        assert samples['force_z'][0][:complete] == [EPOCH + k for k in range(complete)]
