"""Files that are the old one or the new one, and what must not be replaced at all."""

import os
from pathlib import Path

import numpy as np
import pytest

from wrist_ft_comp.errors import StateFileError
from wrist_ft_comp.files.documents import remove_leftovers, replaced_on_success
from wrist_ft_comp.files.state_file import save_state, SavedState


def write(path: Path, text: str) -> None:
    with replaced_on_success(path) as neighbour:
        neighbour.write_text(text)


@pytest.fixture
def target(tmp_path: Path) -> Path:
    path = tmp_path / 'file.txt'
    path.write_text('old')
    return path


def test_a_block_that_raises_leaves_the_old_file_and_nothing_else(target: Path) -> None:
    def write_half() -> None:
        with replaced_on_success(target) as neighbour:
            neighbour.write_text('ne')
            raise ValueError('half')

    with pytest.raises(ValueError, match='half'):
        write_half()
    assert target.read_text() == 'old'
    assert list(target.parent.iterdir()) == [target]


def test_the_old_file_is_there_until_the_new_one_is_whole(target: Path) -> None:
    with replaced_on_success(target) as neighbour:
        neighbour.write_text('new')
        assert target.read_text() == 'old'
        assert neighbour.parent == target.parent, 'a rename must not cross file systems'
    assert target.read_text() == 'new'
    assert list(target.parent.iterdir()) == [target]


def test_permissions_of_the_old_file_stay(target: Path) -> None:
    target.chmod(0o640)
    write(target, 'new')
    assert target.stat().st_mode & 0o777 == 0o640


def test_a_device_or_a_pipe_is_not_replaced(tmp_path: Path) -> None:
    """As root, a model written to /dev/null would take the device's place."""
    pipe = tmp_path / 'pipe'
    os.mkfifo(pipe)
    with pytest.raises(OSError, match='no regular file'):
        write(pipe, 'new')
    assert pipe.is_fifo()
    assert list(tmp_path.iterdir()) == [pipe]


def test_whoever_writes_there_says_so_in_a_sentence(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'state.json')
    with pytest.raises(StateFileError, match=r'state\.json cannot be written: It is no regular'):
        save_state(tmp_path / 'state.json', SavedState(1, None, np.zeros(6), None))


def test_only_what_is_abandoned_is_swept(target: Path) -> None:
    with replaced_on_success(target) as neighbour:
        assert remove_leftovers(target.parent) == 0, 'somebody may be writing it'
        os.utime(neighbour, (1.0, 1.0))
        assert remove_leftovers(target.parent) == 1
        neighbour.write_text('new')
    assert remove_leftovers(target.parent / 'missing') == 0
