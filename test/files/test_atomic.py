"""Files that are the old one or the new one, and what must not be replaced at all."""

import os

import numpy as np
import pytest

from wrist_ft_comp.errors import RecordingError, StateFileError
from wrist_ft_comp.files.documents import (
    beginning,
    remove_leftovers,
    replace_file,
    write_report,
)
from wrist_ft_comp.files.state_file import save_state, SavedState


@pytest.fixture
def target(tmp_path):
    path = tmp_path / 'file.txt'
    path.write_text('old')
    return path


def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(target, monkeypatch):
    def refuse(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, 'fsync', refuse)
    with pytest.raises(KeyboardInterrupt):
        replace_file(target, 'new')
    assert target.read_text() == 'old'
    assert list(target.parent.iterdir()) == [target]


def test_the_old_file_is_there_until_the_new_one_is_whole_and_is_not_swept(target, monkeypatch):
    seen = []

    def look(_):
        others = [path for path in target.parent.iterdir() if path != target]
        seen.append((target.read_text(), [path.read_text() for path in others]))
        assert remove_leftovers(target.parent) == 0, 'somebody is writing it'

    monkeypatch.setattr(os, 'fsync', look)
    replace_file(target, 'new')
    assert seen == [('old', ['new']), ('new', [])], 'first the file is synced, then its folder'


def test_permissions_of_the_old_file_stay(target):
    target.chmod(0o640)
    replace_file(target, 'new')
    assert target.stat().st_mode & 0o777 == 0o640


def test_a_device_or_a_pipe_is_not_replaced(tmp_path):
    """As root, a model written to /dev/null would take the device's place."""
    pipe = tmp_path / 'state.json'
    os.mkfifo(pipe)
    with pytest.raises(StateFileError, match=r'state\.json cannot be written: It is no regular'):
        save_state(pipe, SavedState(1, None, np.zeros(6), None))
    assert pipe.is_fifo()
    assert list(tmp_path.iterdir()) == [pipe]


@pytest.mark.parametrize('content', ['text', b'PNG'])
def test_what_cannot_be_written_is_a_sentence(content, target):
    write_report(target, content)
    assert target.read_bytes() in {b'text', b'PNG'}
    with pytest.raises(RecordingError, match=r'The report .*a\.out cannot be .*: Not a directory'):
        write_report(target / 'a.out', content)


def test_what_is_no_file_has_no_beginning(target):
    target.write_bytes(b'old \xff' + b'x' * 10_000)
    assert beginning(target).startswith('old \ufffd')
    for path in (target.parent, target / 'below', target.with_name('x' * 300)):
        assert beginning(path) == ''
