"""Bags of every storage and compression, whole, cut off and wrong."""

from contextlib import closing
import shutil
import sqlite3

from bag_samples import read
import numpy as np
import pytest

from wrist_ft_comp.channels import AXES, REFERENCE_CHANNELS
from wrist_ft_comp.errors import RecordingError, SettingsError
from wrist_ft_comp.recording import Topics
from wrist_ft_comp.recordings import bag as bag_file
from wrist_ft_comp.recordings.read import read_recording

Reader = pytest.importorskip('rosbags.rosbag2').Reader
pytestmark = pytest.mark.usefixtures('backend')
by_rosbags = pytest.mark.parametrize('backend', ['rosbags'], indirect=True)


@pytest.mark.parametrize('storage', ['sqlite3', 'mcap'])
def test_a_bare_file_and_a_folder_without_metadata_read_like_the_bag(make_bag, storage):
    path = make_bag(storage, count=500)
    whole, _ = read(path)
    (file,) = (f for f in path.iterdir() if f.suffix in bag_file.SUFFIXES)
    bare, _ = read(file)
    (path / 'metadata.yaml').unlink()
    killed, _ = read(path)
    for channels, samples in whole.items():
        for other in (bare, killed):
            np.testing.assert_equal(other[channels], samples)


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
    stamps = read(first)[0][AXES][0]
    assert len(stamps) == 500
    assert (np.diff(stamps) > 0).all()
    metadata.unlink()
    for packed in ('', '.zstd'):
        (first / file.name).rename(first / f'{file.name}{packed}')
        with pytest.raises(RecordingError, match=r'holds 2 storage files.*ros2 bag reindex'):
            read(first)


@pytest.fixture
def write(tmp_path, messages):
    """Write a bag of topics and messages; None stands for none."""

    def make(*rows):
        kinds = {True: messages.wrench_type, False: messages.temperature_type}
        parts = [(t, kinds['wrench' in t], *(at or [0]), content) for t, content, *at in rows]
        return messages.write(tmp_path / 'few', parts)

    return make


def test_reference_and_further_thermometers_are_read_where_they_are_named(write, messages):
    t = 1_723_248_197_000_000_000
    path = write(
        ('/ft/wrench', messages.wrench(t, range(6))),
        ('/wrench_reference', messages.wrench(t + 1, range(6, 12), little=False)),
        ('/temperature', messages.temperature(t + 2, 20.0)),
        ('/flange', messages.temperature(t + 3, 30.0, 'flange', little=False)),
    )
    parts, _ = read(path, Topics('ft/wrench', ('temperature', '/flange')))
    assert parts[AXES][1].tolist() == [list(range(6))]
    assert parts[REFERENCE_CHANNELS][1].tolist() == [list(range(6, 12))]
    assert parts[('temperature_c',)][1].tolist() == [[20.0]]
    assert parts[('temperature_2_c',)][0].tolist() == [t + 3]
    assert parts[('temperature_2_c',)][1].tolist() == [[30.0]]


@pytest.mark.parametrize(
    ('is_cut', 'sentence'), [(True, 'is damaged.*6 doubles'), (False, 'holds no messages')]
)
def test_messages_that_are_no_wrenches_are_refused(write, messages, is_cut, sentence):
    wrench = messages.wrench(1, range(6))[:-3] if is_cut else None
    path = write(('/wrench_raw', wrench), ('/temperature', messages.temperature(1, 20.0)))
    with pytest.raises(RecordingError, match=f'/wrench_raw of few {sentence}'):
        read(path)


def test_a_part_is_counted_from_the_first_message_with_a_stamp(write, messages):
    times = range(1000 * 10**9, 1100 * 10**9, 10**9)
    path = write(
        *(('/wrench_raw', messages.wrench(at, range(6)), at) for at in times[10:]),
        *(('/temperature', messages.temperature(at, 20.0), at) for at in (0, *times)),
    )
    assert len(read_recording(path, topics=Topics(begin='60'))) == 40


@pytest.mark.parametrize(('topics', 'sentence'), [
    (Topics(temperatures=('/temperature', 'temperature')), 'named twice'),
    (Topics(reference='/ati'), 'no topic /ati for the reference'),
    (Topics('/temperature'), r'is sensor_msgs/\S+; the raw wrench must be geometry_msgs'),
    (Topics('/raw_wrench'), r'/raw_wrench for the raw wrench; it holds .*/wrench_raw.*\. Name'),
])  # fmt: skip
def test_topics_that_the_bag_does_not_hold_are_refused(make_bag, topics, sentence):
    path = make_bag(count=100)
    assert REFERENCE_CHANNELS not in read(path)[0], 'by its default name it may be missing'
    with pytest.raises((RecordingError, SettingsError), match=sentence):
        read(path, topics)


def test_a_bare_file_with_compressed_messages_sends_to_the_folder(make_bag):
    path = make_bag('mcap', 'message', count=100)
    with pytest.raises(RecordingError, match=r"compressed and the bag's folder was not named"):
        read(path / 'bag.mcap')


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


@by_rosbags
def test_a_second_publisher_that_sent_nothing_is_no_doubt(make_bag):
    file = make_bag(count=100) / 'bag.db3'
    with closing(sqlite3.connect(file)) as database, database:
        (silent,) = database.execute("SELECT * FROM topics WHERE name = '/wrench_raw'")
        marks = ', '.join('?' * len(silent[1:]))
        database.execute(f'INSERT INTO topics VALUES (9, {marks})', silent[1:])  # noqa: S608
    assert len(read(file)[0][AXES][0]) == 100


@by_rosbags
def test_a_cut_off_mcap_is_read_up_to_its_last_complete_chunk(make_bag):
    path = make_bag('mcap', count=30_000)
    whole, _ = read(path)
    file = path / 'bag.mcap'
    content = file.read_bytes()
    file.write_bytes(content[: int(len(content) * 0.6)])
    (path / 'metadata.yaml').unlink()
    parts, warnings = read(path)
    stamps, values = parts[AXES]
    assert 9000 < len(stamps) < 20_000
    np.testing.assert_array_equal(stamps, whole[AXES][0][: len(stamps)])
    np.testing.assert_array_equal(values, whole[AXES][1][: len(stamps)])
    assert 'bag is cut off' in warnings[0]
    file.write_bytes(content[:5000])
    with pytest.raises(RecordingError, match='cut off before its first complete chunk'):
        read(file)


def test_a_file_cut_anywhere_raises_nothing_but_recording_errors(make_bag, storage):
    path = make_bag(*storage, count=400)
    (file,) = (f for f in path.iterdir() if f.name != 'metadata.yaml')
    content = file.read_bytes()
    rng = np.random.default_rng(2)
    refused = 0
    for end in (*rng.integers(1, len(content), 12), 1, 8, 40, len(content) - 1):
        file.write_bytes(content[:end])
        try:
            read(path)
        except RecordingError:
            refused += 1
    assert refused
