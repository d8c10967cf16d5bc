import json
import os
from pathlib import Path
import subprocess
import sys

import pytest

from wrist_ft_comp.errors import ModelFileError, SettingsError
from wrist_ft_comp.stored import node_folder as stores
from wrist_ft_comp.stored.node_folder import HistoryEntry, MAX_RECORDINGS, NodeFolder


def entries(*paths):
    return [
        HistoryEntry(path, 'a' * 64, '2026-01-05T06:00:00+00:00', 'It is better.', 'learnt', 'd')
        for path in paths
    ]


@pytest.fixture
def store(tmp_path):
    return NodeFolder(tmp_path / 'data')


def test_nothing_is_made_before_something_is_written(store):
    assert store.history() == []
    assert store.recordings() == []
    assert (store.given(), store.newest_day()) == ('', '')
    assert store.new_model_path().parent == store.directory / 'models'
    assert not store.directory.exists()


def test_history_is_bounded_and_moves_with_its_folder_but_not_with_others(store, tmp_path):
    outside = [tmp_path / f'{k}.yaml' for k in range(100)]
    store.activate(entries(*outside, store.directory / 'models/a.yaml'))
    moved = store.directory.rename(tmp_path / 'moved')
    assert NodeFolder(moved).history() == entries(*outside[1:], moved / 'models/a.yaml')


def test_a_lock_of_another_user_locks_and_a_folder_that_may_not_be_entered_is_a_sentence(
    store, monkeypatch
):
    plain_open = os.open

    def refuse(path, flags, *more):
        if flags & os.O_RDWR:
            raise PermissionError(13, 'Permission denied')
        return plain_open(path, flags, *more)

    store.directory.mkdir()
    (store.directory / 'lock').touch()
    monkeypatch.setattr(os, 'open', refuse)
    assert store.take() == ''
    with pytest.raises(SettingsError, match='is in use'):
        NodeFolder(store.directory).take()

    def exists(_):
        raise PermissionError(13, 'Permission denied')

    (store.directory / 'active.json').touch()
    monkeypatch.setattr(Path, 'exists', exists)
    with pytest.raises(ModelFileError, match=r'active\.json cannot be read: Permission denied'):
        store.history()


def test_the_newest_recordings_are_listed_oldest_first_and_names_differ(store):
    paths = []
    for _ in range(MAX_RECORDINGS + 3):
        paths.append(store.new_recording_path())
        paths[-1].write_text('')
    (store.directory / 'recordings' / 'zzz.txt').write_text('')
    assert store.recordings() == sorted(paths)[-MAX_RECORDINGS:]
    assert len(set(paths)) == MAX_RECORDINGS + 3
    paths[0].with_name('recording_20990101T000000Z.csv').touch()  # then the clock ran back
    for _ in range(MAX_RECORDINGS + 3):
        paths.append(store.new_recording_path())
        paths[-1].touch()
    assert store.recordings() == paths[-MAX_RECORDINGS:]
    (store.directory / 'days').mkdir()
    for name in ('day_00010.csv', 'day_00009.csv', 'day_1.csv', 'day_00011.csv~'):
        (store.directory / 'days' / name).touch()
    assert store.newest_day() == 'day_00010.csv'
    store.discard(paths[0])
    assert not paths[0].exists()


def test_links_are_followed_before_a_path_counts_as_inside(store, tmp_path):
    (store.directory / 'models').mkdir(parents=True)
    outside = tmp_path / 'outside.yaml'
    outside.write_text('')
    (store.directory / 'link.yaml').symlink_to(outside)
    (store.directory / 'loop.yaml').symlink_to(store.directory / 'loop.yaml')
    (tmp_path / 'door').symlink_to(store.directory)
    for path in ('models/m.yaml', 'models/../m.yaml', '.', str(tmp_path / 'door/m.yaml')):
        store.require_inside('model_file', str(store.directory / path))
    for path in (
        'link.yaml', 'loop.yaml', '../m.yaml', 'models/../../m.yaml', '/etc/passwd',
        'bad\0name', f'{store.directory}_beside/m.yaml',
    ):  # fmt: skip
        with pytest.raises(SettingsError, match='must lie inside data_directory'):
            store.require_inside('model_file', str(store.directory / path))


def test_a_relative_name_is_looked_up_in_the_folder_first(store, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('HOME', str(tmp_path / 'home'))
    (store.directory / 'models').mkdir(parents=True)
    (store.directory / 'models/a.yaml').write_text('')
    assert store.locate('models/a.yaml') == store.directory / 'models/a.yaml'
    assert store.locate('b.yaml') == Path('b.yaml')
    assert store.locate('/x/a.yaml') == Path('/x/a.yaml')
    assert store.locate('~/a.yaml') == tmp_path / 'home/a.yaml'
    assert store.locate('~nobody_of_this_name/a.yaml') == Path('~nobody_of_this_name/a.yaml')


def test_the_list_is_readable_by_people_and_keeps_what_was_given(store):
    model = store.directory / 'models/a.yaml'
    history = entries(model)
    store.activate(history, given='abc')
    text = (store.directory / 'active.json').read_text()
    said = {
        'path': 'models/a.yaml', 'sha256': 'a' * 64, 'since': '2026-01-05T06:00:00+00:00',
        'why': 'It is better.', 'how': 'learnt', 'day': 'd', 'withdrawn': False,
    }  # fmt: skip
    assert json.loads(text) == {
        'format': 'wrist_ft_comp live models', 'version': 1, 'history': [said], 'given': 'abc',
    }  # fmt: skip
    assert len(text.splitlines()) > 3
    assert (store.history(), store.given()) == (history, 'abc')


def test_the_history_says_what_ran_on_a_day_and_when_a_person_decided_last():
    none, by_hand, learnt = (
        HistoryEntry(None),
        HistoryEntry(Path('a.yaml'), day='day_00002.csv'),
        HistoryEntry(Path('b.yaml'), how='learnt', day='day_00004.csv'),
    )
    history = [none, by_hand, learnt]
    ran = [stores.model_on(history, f'day_{n:05d}.csv') for n in range(1, 7)]
    assert ran == [none, none, by_hand, by_hand, learnt, learnt]
    assert stores.model_on([by_hand], 'day_00001.csv') is None
    assert stores.day_of_choice(history) == 'day_00002.csv'
    assert stores.day_of_choice([]) == ''


def test_leftovers_of_killed_processes_are_swept(store):
    store.activate([HistoryEntry(None)])
    source = (
        'import os, signal, sys; from pathlib import Path\n'
        'from wrist_ft_comp.stored.safe_file import replace_file\n'
        'os.fsync = lambda _: os.kill(os.getpid(), signal.SIGKILL)\n'
        'replace_file(Path(sys.argv[1]), "new")\n'
    )
    path = store.directory / 'active.json'
    before = path.read_text()
    assert subprocess.run([sys.executable, '-c', source, str(path)], check=False).returncode == -9
    assert path.read_text() == before
    (leftover,) = [file for file in store.directory.iterdir() if file != path]
    store.take()
    store.release()
    assert leftover.exists(), 'it may be somebody else in the middle of writing'
    os.utime(leftover, (0, 0))
    (store.directory / '.kept.tmp').write_text('not ours')
    store.take()
    assert sorted(file.name for file in store.directory.iterdir()) == [
        '.kept.tmp', 'active.json', 'lock',
    ]  # fmt: skip


@pytest.mark.parametrize(('home', 'base'), [('/somewhere', '/somewhere'), ('', '/home/user/.ros')])
def test_a_folder_is_absolute_and_by_default_below_ros_home(monkeypatch, home, base, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('HOME', '/home/user')
    monkeypatch.setenv('ROS_HOME', home)
    directory = stores.node_directory('', '/left/arm/wrist_ft_comp')
    assert directory == Path(base) / 'wrist_ft_comp/left__arm__wrist_ft_comp'
    assert stores.node_directory('data', 'left') == tmp_path / 'data'
    assert stores.node_directory('~/data') == Path('/home/user/data')
    assert stores.node_directory('x' * 300).name == 'x' * 300
    with pytest.raises(SettingsError, match='nobody here has a home of that name'):
        stores.node_directory('~nobody_here/data')
