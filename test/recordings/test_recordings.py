"""The front door: every kind of recording onto the grid, rewritten, described."""

import numpy as np
import pytest

from wrist_ft_comp.cli.show import describe_recording
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recording import Topics
from wrist_ft_comp.recordings import bag as bag_file
from wrist_ft_comp.recordings.compensated_copy import rewrite_recording
from wrist_ft_comp.recordings.read import read_recording
from wrist_ft_comp.wire import cdr

Reader = pytest.importorskip('rosbags.rosbag2').Reader
pytestmark = pytest.mark.usefixtures('backend')
T0 = 1_723_248_197_000_000_000


def halve(stamps_ns, wrench):
    assert stamps_ns.shape == wrench.shape[:1]
    assert wrench.shape[1:] == (6,)
    return wrench / 2


def raw_messages(path):
    """Per topic: times of recording and bytes."""
    topics = {}
    with Reader(path) as reader:
        for connection, stamp, data in reader.messages():
            topics.setdefault(connection.topic, []).append((stamp, data))
    return topics


@pytest.mark.parametrize(('name', 'content', 'sentence'), [
    ('folder/notes.txt', b'x', 'folder is no bag: expected a folder with metadata.yaml'),
    ('old.bag', b'', 'ROS 1 bag'), ('bag.db3.zstd', b'', 'name the folder'),
    ('empty.csv', b'', 'empty.csv is empty'), ('a.db3', b'', 'a.db3 is empty'),
    ('a.mcap', b'', 'a.mcap is empty'),
    ('a.db3', b'not a database at all' * 100, 'a.db3 cannot be read as a bag'),
    ('a.mcap', b'not a bag at all' * 100, 'a.mcap cannot be read as a bag.*magic'),
])  # fmt: skip
def test_a_path_that_is_no_recording_is_refused(tmp_path, name, content, sentence):
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content)
    named = path if path.parent == tmp_path else path.parent
    for look in (read_recording, lambda path: describe_recording(path, Topics(), print)):
        with pytest.raises(RecordingError, match=sentence):
            look(named)


def test_a_rewritten_table_has_our_columns_and_what_was_empty_stays_empty(make_csv):
    log = 't;Fz [kN];T;x;Mx\n0,0;0,0015;20;;\n0,5;0,0025;;a;7\n1;;21;b;\n'
    source, seen = make_csv(log), []

    def look(stamps_ns, wrench):
        seen.append((stamps_ns.tolist(), np.isfinite(wrench).sum(axis=1).tolist()))
        return halve(stamps_ns, wrench)

    target = source.with_name('out.csv')
    topics = Topics(columns='stamp=t,force_z=Fz [kN],temperature_c=T,torque_x=Mx')
    (warning,) = rewrite_recording(source, target, look, topics=topics)
    assert 'not understood and not used: x.' in warning
    assert target.read_text() == (
        'stamp_ns,force_z,temperature_c,torque_x,compensated_by_wrist_ft_comp\n'
        '0,0.75,20.0,,\n500000000,1.25,,3.5,\n1000000000,,21.0,,\n'
    )
    assert source.read_text() == log
    assert seen == [([0, 500_000_000, 1_000_000_000], [1, 2, 0])], 'absent axes are NaN'


def test_a_wrench_of_a_bag_without_a_stamp_is_corrected_as_of_its_arrival(messages, tmp_path):
    times_ns, seen = [T0, T0 + 10**9, T0 + 2 * 10**9], []
    source = messages.write(tmp_path / 'bag', [
        ('/wrench_raw', messages.wrench_type, T0 + k * 10**9, messages.wrench(stamp_ns, range(6)))
        for k, stamp_ns in enumerate([T0, 0, times_ns[2]])
    ])  # fmt: skip

    def look(stamps_ns, wrench):
        seen.extend(stamps_ns.tolist())
        return wrench

    rewrite_recording(source, tmp_path / 'out', look)
    assert seen == times_ns
    stamps_ns, _ = cdr.decode_many(
        [d for _, d in raw_messages(tmp_path / 'out')['/wrench_without_drift']], 6
    )
    assert stamps_ns.tolist() == [T0, 0, times_ns[2]], 'its header stays as it was'


def test_a_rewritten_bag_has_each_message_and_the_corrected_wrench(make_bag, storage, monkeypatch):
    monkeypatch.setattr(bag_file, 'BATCH', 150)
    source = make_bag(*storage, count=400)
    target = source.with_name('out')
    fractions = []
    assert rewrite_recording(source, target, halve, progress=fractions.append) == ()
    before, after = raw_messages(source), raw_messages(target)
    added = after.pop('/wrench_without_drift')
    assert after == before
    raw = before['/wrench_raw']
    assert [stamp for stamp, _ in added] == [stamp for stamp, _ in raw]
    stamps, values = cdr.decode_many([data for _, data in raw], 6)
    stamps_out, values_out = cdr.decode_many([data for _, data in added], 6)
    np.testing.assert_array_equal(stamps_out, stamps)
    np.testing.assert_array_equal(values_out, values / 2)
    assert values.any()
    assert fractions[-1] == 1.0
    names = {path.name.replace('bag', 'out').removesuffix('.zstd') for path in source.iterdir()}
    assert {path.name for path in target.iterdir()} == names
    assert [p.name for p in source.parent.iterdir() if p.name.startswith('.')] == []
    again = read_recording(target, topics=Topics(wrench='/wrench_without_drift'))
    np.testing.assert_allclose(again.wrench, read_recording(source).wrench / 2)
