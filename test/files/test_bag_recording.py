"""Bags of every storage and compression, whole, cut off and wrong."""

from pathlib import Path
import shutil
import struct

import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from rosbags.typesys import get_typestore, Stores

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.files import bag as bag_file
from wrist_ft_comp.files.bag import open_bag
from wrist_ft_comp.files.bag_recording import read_bag
from wrist_ft_comp.model.signals import AXES, REFERENCE_CHANNELS, Topics

WRENCH = 'geometry_msgs/msg/WrenchStamped'
TEMPERATURE = 'sensor_msgs/msg/Temperature'
STRING = 'std_msgs/msg/String'
STORAGES = [
    ('sqlite3', 'none'),
    ('sqlite3', 'file'),
    ('sqlite3', 'message'),
    ('mcap', 'none'),
    ('mcap', 'file'),
    ('mcap', 'message'),
    ('mcap', 'storage'),
]


def read(path, topics=None):
    """Stamps and values by channels, and the bag's warnings."""
    parts = {}
    with open_bag(Path(path)) as bag:
        for block in read_bag(bag, topics or Topics()):
            parts.setdefault(block.channels, []).append(block)
        warnings = bag.warnings
    joined = {
        channels: (
            np.concatenate([block.stamps_ns for block in blocks]),
            np.concatenate([block.values for block in blocks]),
        )
        for channels, blocks in parts.items()
    }
    return joined, warnings


def textbook(path):
    """Stamps and force z of the wrenches, deserialized one by one."""
    store = get_typestore(Stores.ROS2_JAZZY)
    stamps, forces = [], []
    with Reader(path) as reader:
        wanted = [c for c in reader.connections if c.topic == '/wrench_raw']
        for connection, _, data in reader.messages(wanted):
            message = store.deserialize_cdr(data, connection.msgtype)
            stamps.append(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)
            forces.append(message.wrench.force.z)
    return stamps, forces


@pytest.mark.parametrize(('storage', 'compression'), STORAGES)
def test_every_storage_gives_what_rosbags_gives_one_by_one(
    make_bag, storage, compression, monkeypatch
):
    monkeypatch.setattr(bag_file, 'BATCH', 700)
    path = make_bag(storage, compression, count=2000)
    found, warnings = read(path)
    stamps, forces = textbook(path)
    assert warnings == ()
    assert len(stamps) == 2000
    assert found[AXES][0].tolist() == stamps
    assert found[AXES][1][:, 2].tolist() == forces
    assert found[('temperature_c',)][1][:, 0].tolist() == pytest.approx(
        [25.0 + k * 1e-4 for k in range(0, 2000, 100)]
    )


@pytest.mark.parametrize('storage', ['sqlite3', 'mcap'])
def test_a_bare_file_and_a_folder_without_metadata_read_like_the_bag(make_bag, storage):
    path = make_bag(storage, count=500)
    whole, _ = read(path)
    (file,) = (f for f in path.iterdir() if f.suffix in bag_file.SUFFIXES)
    bare, _ = read(file)
    (path / 'metadata.yaml').unlink()
    killed, _ = read(path)
    for channels, (stamps, values) in whole.items():
        for other in (bare, killed):
            np.testing.assert_array_equal(other[channels][0], stamps)
            np.testing.assert_array_equal(other[channels][1], values)


@pytest.mark.parametrize('storage', ['sqlite3', 'mcap'])
def test_a_split_bag_is_read_in_order(make_bag, storage):
    first = make_bag(storage, count=300)
    second = make_bag(storage, count=200, name='more', start_ns=1_723_248_297_000_000_000)
    (file,) = (f for f in second.iterdir() if f.suffix in bag_file.SUFFIXES)
    shutil.copy(file, first / file.name)
    metadata = first / 'metadata.yaml'
    listed = f'- bag{file.suffix}\n'
    text = metadata.read_text()
    assert listed in text
    metadata.write_text(text.replace(listed, f'{listed}  - {file.name}\n', 1))
    found, _ = read(first)
    assert len(found[AXES][0]) == 500
    assert (np.diff(found[AXES][0]) > 0).all()
    metadata.unlink()
    with pytest.raises(RecordingError, match=r'holds 2 storage files.*ros2 bag reindex'):
        read(first)


def test_reference_and_further_thermometers_are_read_where_they_are_named(
    write_messages, messages
):
    t = messages.start_ns
    path = write_messages(
        ('/ft/raw', WRENCH, messages.wrench(t, range(6))),
        ('/wrench_reference', WRENCH, messages.wrench(t + 1, range(6, 12), little=False)),
        ('/temperature', TEMPERATURE, messages.temperature(t + 2, 20.0)),
        ('/flange', TEMPERATURE, messages.temperature(t + 3, 30.0, 'flange', little=False)),
    )
    found, _ = read(path, Topics('ft/raw', ('temperature', '/flange')))
    assert found[AXES][1].tolist() == [list(range(6))]
    assert found[REFERENCE_CHANNELS][1].tolist() == [list(range(6, 12))]
    assert found[('temperature_c',)][1].tolist() == [[20.0]]
    assert found[('temperature_2_c',)][0].tolist() == [t + 3]
    assert found[('temperature_2_c',)][1].tolist() == [[30.0]]


def test_a_named_reference_must_be_there_but_the_default_need_not(make_bag):
    path = make_bag(count=100)
    assert REFERENCE_CHANNELS not in read(path)[0]
    with pytest.raises(RecordingError, match='no topic /ati for the reference'):
        read(path, Topics(reference='/ati'))


def test_a_missing_topic_lists_what_is_there_and_suggests_the_nearest(make_bag):
    path = make_bag(count=100, wrench='/ft_sensor/wrench')
    with pytest.raises(RecordingError) as refusal:
        read(path)
    said = str(refusal.value)
    assert 'bag holds no topic /wrench_raw for the raw wrench' in said
    assert f'/temperature ({TEMPERATURE})' in said
    assert f'/log ({STRING})' in said
    assert 'Did you mean /ft_sensor/wrench?' in said


def test_a_topic_of_another_type_is_refused(make_bag):
    path = make_bag(count=100)
    with pytest.raises(RecordingError, match=f'/log of bag is {STRING}.*must be {WRENCH}'):
        read(path, Topics(wrench='/log'))


def test_a_topic_without_messages_is_refused(write_messages, messages):
    path = write_messages(
        ('/temperature', TEMPERATURE, messages.temperature(1, 20.0)), ('/wrench_raw', WRENCH, None)
    )
    with pytest.raises(RecordingError, match='/wrench_raw of few holds no messages'):
        read(path)


def test_a_topic_named_twice_is_refused(make_bag):
    path = make_bag(count=100)
    with pytest.raises(RecordingError, match='named twice'):
        read(path, Topics(temperatures=('/temperature', 'temperature')))


def test_messages_without_header_stamps_are_refused(write_messages, messages):
    path = write_messages(
        ('/temperature', TEMPERATURE, messages.temperature(1, 20.0)),
        ('/wrench_raw', WRENCH, messages.wrench(0, range(6))),
        ('/wrench_raw', WRENCH, messages.wrench(0, range(6))),
    )
    with pytest.raises(RecordingError, match=r'Every message on /wrench_raw.*header.stamp'):
        read(path)


def test_a_damaged_message_is_refused_with_its_topic(write_messages, messages):
    path = write_messages(
        ('/temperature', TEMPERATURE, messages.temperature(1, 20.0)),
        ('/wrench_raw', WRENCH, messages.wrench(1, range(6))[:-3]),
    )
    with pytest.raises(
        RecordingError, match=r'message on /wrench_raw of few is damaged.*6 doubles'
    ):
        read(path)


def test_a_bare_file_with_compressed_messages_sends_to_the_folder(make_bag):
    path = make_bag('mcap', 'message', count=100)
    with pytest.raises(RecordingError, match=r'compressed one by one.*folder'):
        read(path / 'bag.mcap')


@pytest.mark.parametrize(
    ('name', 'content', 'said'),
    [
        ('no.mcap', None, 'no.mcap does not exist'),
        ('a.db3', b'', 'a.db3 is empty'),
        ('a.mcap', b'', 'a.mcap is empty'),
        ('a.db3', b'not a database at all' * 100, 'a.db3 cannot be read as a bag'),
        ('a.mcap', b'not a bag at all' * 100, 'a.mcap cannot be read as a bag.*magic'),
        ('a.txt', b'text', 'a.txt is no bag'),
    ],
)
def test_what_is_no_bag_is_refused(tmp_path, name, content, said):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(RecordingError, match=said):
        read(tmp_path / name)


def test_a_folder_without_a_bag_is_refused(tmp_path):
    (tmp_path / 'notes.txt').write_text('x')
    with pytest.raises(RecordingError, match=r'is no bag: expected a folder with metadata.yaml'):
        read(tmp_path)


@pytest.mark.parametrize('text', ['', '{', 'a: b', 'rosbag2_bagfile_information: {version: 99}'])
def test_broken_metadata_is_refused(make_bag, text):
    path = make_bag(count=100)
    (path / 'metadata.yaml').write_text(text)
    with pytest.raises(RecordingError, match='bag cannot be read as a bag'):
        read(path)


def test_messages_still_in_the_write_ahead_log_are_not_silently_lost(make_bag):
    path = make_bag(count=100)
    (path / 'bag.db3-wal').write_bytes(b'x')
    for which in (path, path / 'bag.db3'):
        with pytest.raises(RecordingError, match=r'bag.db3-wal holds messages.*wal_checkpoint'):
            read(which)


def test_a_cut_off_mcap_is_read_up_to_its_last_complete_chunk(make_bag):
    path = make_bag('mcap', count=30_000)
    whole, _ = read(path)
    file = path / 'bag.mcap'
    content = file.read_bytes()
    file.write_bytes(content[: int(len(content) * 0.6)])
    (path / 'metadata.yaml').unlink()
    found, warnings = read(path)
    stamps, values = found[AXES]
    assert 9000 < len(stamps) < 20_000
    np.testing.assert_array_equal(stamps, whole[AXES][0][: len(stamps)])
    np.testing.assert_array_equal(values, whole[AXES][1][: len(stamps)])
    assert 'bag is cut off' in warnings[0]


def test_an_mcap_cut_before_its_first_chunk_is_refused(make_bag):
    path = make_bag('mcap', count=2000) / 'bag.mcap'
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(RecordingError, match='cut off before its first complete chunk'):
        read(path)


def refuses(path):
    """Read, and tell whether it was refused; any other error goes through."""
    said = ''
    try:
        read(path)
    except RecordingError as error:
        said = str(error)
    assert not said or 'bag' in said
    return bool(said)


@pytest.mark.parametrize(('storage', 'compression'), STORAGES)
def test_a_file_cut_anywhere_raises_nothing_but_recording_errors(make_bag, storage, compression):
    path = make_bag(storage, compression, count=400)
    (file,) = (f for f in path.iterdir() if f.name != 'metadata.yaml')
    content = file.read_bytes()
    rng = np.random.default_rng(2)
    refused = 0
    for end in (*rng.integers(1, len(content), 12), 1, 8, 40, len(content) - 1):
        file.write_bytes(content[:end])
        refused += refuses(path)
    assert refused


@pytest.mark.parametrize('storage', ['sqlite3', 'mcap'])
def test_random_damage_raises_nothing_but_recording_errors(make_bag, storage):
    path = make_bag(storage, count=300)
    (file,) = (f for f in path.iterdir() if f.name != 'metadata.yaml')
    content = file.read_bytes()
    rng = np.random.default_rng(3)
    for _ in range(40):
        damaged = bytearray(content)
        for place in rng.integers(len(content), size=20):
            damaged[place] = rng.integers(256)
        struct.pack_into('<Q', damaged, int(rng.integers(len(content) - 8)), 2**63 - 1)
        file.write_bytes(bytes(damaged))
        refuses(path)
