"""The front door: every kind of recording onto the grid, rewritten, described."""

from pathlib import Path
import shutil

import numpy as np
import pytest
from rosbags.rosbag2 import Reader

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.files import bag as bag_file
from wrist_ft_comp.files import cdr
from wrist_ft_comp.files import csv_file as csv_text
from wrist_ft_comp.files.recordings import describe_recording, read_recording, rewrite_recording
from wrist_ft_comp.model.signals import AXES, NANOSECONDS, Topics

TABLE = Path(__file__).parents[2] / 'data' / 'keller_pa10' / 'table1_sensor_a_raw.csv'
CSV = (
    'stamp_s;note;force_z;temperature_c;torque_x\n0.0;"a;b";1.50;20.0;\n0.5;;2.50;;7\n1.0;c;;21;\n'
)
KINDS = [
    ('sqlite3', 'none'),
    ('sqlite3', 'file'),
    ('sqlite3', 'message'),
    ('mcap', 'none'),
    ('mcap', 'file'),
    ('mcap', 'message'),
    ('mcap', 'storage'),
]


def halve(stamps_ns, wrench):
    """A correction one can see."""
    assert stamps_ns.shape == wrench.shape[:1]
    assert wrench.shape[1:] == (6,)
    return wrench / 2


def raw_messages(path):
    """Per topic: times of recording and bytes."""
    found = {}
    with Reader(path) as reader:
        for connection, stamp, data in reader.messages():
            found.setdefault(connection.topic, []).append((stamp, data))
    return found


def test_the_same_data_as_csv_and_as_bag_give_the_same_recording(make_bag, make_csv):
    bag = make_bag(count=1500)
    wrench, stamps = [], []
    for _, data in raw_messages(bag)['/wrench_raw']:
        stamp, values = cdr.decode_many([data], 6)
        stamps.append(int(stamp[0]))
        wrench.append(values[0])
    rows = [
        f'{stamp // NANOSECONDS}.{stamp % NANOSECONDS:09},{",".join(map(repr, row.tolist()))},'
        f'{25.0 + k * 1e-4 if k % 100 == 0 else ""}'
        for k, (stamp, row) in enumerate(zip(stamps, wrench, strict=True))
    ]
    header = f'stamp_s,{",".join(AXES)},temperature_c'
    one = read_recording(bag)
    other = read_recording(make_csv('\n'.join((header, *rows, ''))))
    assert one.first_cell == other.first_cell
    np.testing.assert_array_equal(one.wrench, other.wrench)
    np.testing.assert_array_equal(one.temperature_c, other.temperature_c)


def test_period_and_share_of_bad_samples_are_passed_on(make_csv):
    rows = ''.join(f'{k},{"nan" if k == 7 else 1},20\n' for k in range(20))
    path = make_csv(f'stamp_s,force_z,temperature_c\n{rows}')
    with pytest.raises(RecordingError, match=r'run.csv: 1 of 20 samples'):
        read_recording(path)
    recording = read_recording(path, period_s=2.0, max_bad_share=0.1)
    assert len(recording) == 10
    assert len(recording.warnings) == 1


def test_an_absent_axis_stays_absent_and_a_cut_line_is_a_warning(make_csv):
    recording = read_recording(make_csv('stamp_s,force_z,temperature_c\n0,1,20\n1,2,21\n2,'))
    assert recording.axes_present == ('force_z',)
    assert recording.wrench[:, 2].tolist() == [1.0, 2.0]
    assert 'Line 4 of run.csv is cut off' in recording.warnings[0]


def test_a_chamber_table_is_a_recording_too():
    recording = read_recording(TABLE)
    assert recording.axes_present == ('force_z',)
    assert recording.duration_s == pytest.approx(7 * 1800, abs=30)
    assert np.isfinite(recording.wrench[:, 2]).sum() == 7 * 9
    assert np.isfinite(recording.reference[:, 2]).sum() == 7 * 9
    assert 'repeats that of -40 °C' in recording.warnings[0]
    kept = read_recording(TABLE, keep_copied_columns=True)
    assert kept.warnings == ()
    assert kept.duration_s > recording.duration_s


@pytest.mark.parametrize(
    ('name', 'said'),
    [
        ('nothing', 'nothing does not exist'),
        ('folder', 'folder is no bag'),
        ('old.bag', 'ROS 1 bag'),
        ('bag.db3.zstd', 'name the folder'),
        ('empty.csv', 'empty.csv is empty'),
    ],
)
def test_what_is_no_recording_is_refused(tmp_path, name, said):
    if name == 'folder':
        (tmp_path / name).mkdir()
    elif name != 'nothing':
        (tmp_path / name).touch()
    for look in (read_recording, describe_recording):
        with pytest.raises(RecordingError, match=said):
            look(tmp_path / name)


def test_a_rewritten_csv_differs_in_its_wrench_cells_only(make_csv, monkeypatch):
    monkeypatch.setattr(csv_text, 'CHUNK', 20)
    source = make_csv(CSV)
    target = source.with_name('out.csv')
    assert rewrite_recording(source, target, halve) == ()
    assert target.read_text() == CSV.replace('1.50', '0.75').replace('2.50', '1.25').replace(
        ';7\n', ';3.5\n'
    )
    assert source.read_text() == CSV


def test_a_correction_sees_nan_for_absent_axes_and_only_rows_with_a_wrench(make_csv):
    seen = []

    def look(stamps_ns, wrench):
        seen.append((stamps_ns.tolist(), np.isfinite(wrench).sum(axis=1).tolist()))
        return wrench

    source = make_csv(CSV)
    rewrite_recording(source, source.with_name('out.csv'), look)
    assert seen == [([0, 500_000_000], [1, 2])]


@pytest.mark.parametrize(('storage', 'compression'), KINDS)
def test_a_rewritten_bag_holds_every_message_and_the_corrected_wrench(
    make_bag, storage, compression, monkeypatch
):
    monkeypatch.setattr(bag_file, 'BATCH', 300)
    source = make_bag(storage, compression, count=1000)
    target = source.with_name('out')
    fractions = []
    assert rewrite_recording(source, target, halve, progress=fractions.append) == ()
    before, after = raw_messages(source), raw_messages(target)
    added = after.pop('/wrench')
    assert after == before
    raw = before['/wrench_raw']
    assert [stamp for stamp, _ in added] == [stamp for stamp, _ in raw]
    stamps, values = cdr.decode_many([data for _, data in raw], 6)
    stamps_out, values_out = cdr.decode_many([data for _, data in added], 6)
    np.testing.assert_array_equal(stamps_out, stamps)
    np.testing.assert_array_equal(values_out, values / 2)
    assert values.any()
    assert fractions[-1] == 1.0
    suffix = {'sqlite3': '.db3', 'mcap': '.mcap'}[storage]
    ending = '.zstd' if compression == 'file' else ''
    names = {path.name for path in target.iterdir()}
    assert names == {'metadata.yaml', f'out{suffix}{ending}'}
    assert [p.name for p in source.parent.iterdir() if p.name.startswith('.')] == []
    again = read_recording(target, topics=Topics(wrench='/wrench'))
    np.testing.assert_allclose(again.wrench, read_recording(source).wrench / 2)


@pytest.mark.parametrize(('storage', 'suffix'), [('sqlite3', '.db3'), ('mcap', '.mcap')])
def test_a_bare_file_may_be_rewritten_into_a_bare_file(make_bag, storage, suffix):
    source = make_bag(storage, count=200) / f'bag{suffix}'
    target = source.parents[1] / f'out{suffix}'
    rewrite_recording(source, target, halve, output_topic='cleaned')
    assert target.is_file()
    assert len(raw_messages(target)['/cleaned']) == 200
    other = {'.db3': '.mcap', '.mcap': '.db3'}[suffix]
    with pytest.raises(RecordingError, match=f'names another storage.*{storage}'):
        rewrite_recording(source, target.with_name(f'x{other}'), halve)


def test_a_rewritten_chamber_table_is_a_chamber_table(tmp_path):
    warnings = rewrite_recording(TABLE, tmp_path / 'out.csv', halve)
    assert 'digit for digit' in warnings[0]
    before, after = read_recording(TABLE), read_recording(tmp_path / 'out.csv')
    np.testing.assert_allclose(after.wrench, before.wrench / 2)


def sources(make_bag, make_csv, tmp_path):
    """One of each kind."""
    shutil.copy(TABLE, tmp_path / 'table.csv')
    return (
        make_bag(count=200),
        make_bag('mcap', count=200, name='m'),
        make_csv(CSV),
        (tmp_path / 'table.csv'),
    )


def test_a_failure_leaves_nothing_half_written(make_bag, make_csv, tmp_path):
    def fail(*_):
        raise ZeroDivisionError

    for source in sources(make_bag, make_csv, tmp_path):
        before = sorted(tmp_path.rglob('*'))
        with pytest.raises(ZeroDivisionError):
            rewrite_recording(source, tmp_path / 'out', fail)
        assert sorted(tmp_path.rglob('*')) == before


def test_a_target_that_exists_or_is_the_source_is_refused(make_bag, make_csv, tmp_path):
    for source in sources(make_bag, make_csv, tmp_path):
        with pytest.raises(RecordingError, match='is the source itself'):
            rewrite_recording(source, tmp_path / '..' / tmp_path.name / source.name, halve)
        existing = tmp_path / 'there'
        existing.write_text('mine')
        with pytest.raises(RecordingError, match='there exists already'):
            rewrite_recording(source, existing, halve)
        assert existing.read_text() == 'mine'
        with pytest.raises(RecordingError, match='is no folder'):
            rewrite_recording(source, tmp_path / 'no' / 'out', halve)


def test_an_output_topic_that_is_taken_is_refused(make_bag):
    source = make_bag(count=100)
    with pytest.raises(RecordingError, match='bag holds log already'):
        rewrite_recording(source, source.with_name('out'), halve, output_topic='log')
    assert not source.with_name('out').exists()


def test_a_bag_is_described_from_its_index(make_bag):
    summary = describe_recording(make_bag('mcap', 'file', count=1000))
    assert summary.kind == 'rosbag2, mcap, file compression'
    assert {(c.name, c.samples, c.role) for c in summary.channels} == {
        ('/wrench_raw', 1000, 'raw wrench'),
        ('/temperature', 10, 'temperature'),
        ('/log', 10, ''),
    }
    assert summary.first_ns is not None
    assert summary.last_ns is not None
    assert summary.last_ns - summary.first_ns == 999_000_000


def test_a_csv_recording_and_a_table_are_described_by_their_samples(make_csv):
    summary = describe_recording(make_csv(CSV))
    assert summary.kind == 'CSV recording'
    assert [(c.name, c.kind, c.samples, c.role) for c in summary.channels] == [
        ('force_z', 'N', 2, 'raw wrench'),
        ('torque_x', 'N m', 1, 'raw wrench'),
        ('temperature_c', '°C', 2, 'temperature'),
    ]
    assert (summary.first_ns, summary.last_ns) == (0, NANOSECONDS)
    table = describe_recording(TABLE)
    assert table.kind == 'chamber table'
    assert {c.name: c.samples for c in table.channels}['force_z'] == 63
    assert 'left out' in table.warnings[0]
