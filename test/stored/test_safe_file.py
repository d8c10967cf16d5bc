"""Own files: the old one or the new one, what is not replaced, and records in plain values."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
import errno
from functools import partial
import json
import os
from pathlib import Path
import re
import threading
from typing import Literal, NamedTuple

import numpy as np
import pytest

from wrist_ft_comp.errors import OutputError, WristFtCompError
from wrist_ft_comp.learning import days
from wrist_ft_comp.series import FloatArray
from wrist_ft_comp.stored import model_file, payload_file, safe_file, state_file
from wrist_ft_comp.stored.node_folder import HistoryEntry, NodeFolder
from wrist_ft_comp.stored.payload_file import load_payloads
from wrist_ft_comp.stored.safe_file import FileWriter, from_plain, Output, replace_file
from wrist_ft_comp.stored.state_file import load_state, save_state, SavedState

TIMEOUT_S = 20.0
STATE = SavedState(1, None, np.zeros(6), None)


@pytest.fixture
def target(tmp_path):
    path = tmp_path / 'file.txt'
    path.write_text('old')
    return path


def test_the_old_file_is_there_until_the_new_one_is_whole_and_is_not_swept(target, monkeypatch):
    seen = []

    def look(_):
        others = [path for path in target.parent.iterdir() if path != target]
        seen.append((target.read_text(), [path.read_text() for path in others]))
        safe_file.remove_leftovers(target.parent)  # but not what somebody is writing

    monkeypatch.setattr(os, 'fsync', look)
    target.chmod(0o640)
    replace_file(target, 'new')
    assert seen == [('old', ['new']), ('new', [])], 'first the file is synced, then its folder'
    assert target.stat().st_mode & 0o777 == 0o640


@pytest.mark.parametrize(('fails', 'content'), [(os.path.isdir, 'new'), (os.path.isfile, 'old')])
def test_only_a_file_must_reach_the_disk_or_the_old_one_stays(target, monkeypatch, fails, content):
    def sync(handle):
        if fails(f'/proc/self/fd/{handle}'):
            raise OSError(errno.EINVAL, 'Invalid argument')

    monkeypatch.setattr(os, 'fsync', sync)
    with suppress(OSError):
        replace_file(target, 'new')
    assert target.read_text() == content
    assert list(target.parent.iterdir()) == [target]


@pytest.mark.parametrize('content', ['text', b'PNG'])
def test_a_target_that_cannot_be_written_is_a_sentence(content, target, monkeypatch):
    def refuse(_):
        raise OSError(errno.ENOSPC, 'No space left on device')

    kind = Output(name='sheet', begins='old', endings='')
    kind.write(target, content)
    assert target.read_bytes() in {b'text', b'PNG'}
    with pytest.raises(OutputError, match=r'file\.txt is no folder'):
        kind.write(target / 'a.out', content)
    monkeypatch.setattr(os, 'fsync', refuse)
    target.write_text('old')
    with pytest.raises(OutputError, match=r'file\.txt cannot be written: No space left'):
        kind.write(target, 'new')
    assert target.read_text() == 'old'


@pytest.mark.parametrize(('name', 'write'), [
    ('state.json', lambda folder: save_state(folder / 'state.json', STATE)),
    ('learning.json', lambda folder: days.save_memory(folder, days.Memory())),
    ('days/diary.json', lambda folder: days.save_diary(folder, days.Diary())),
    ('active.json', lambda folder: NodeFolder(folder).activate([HistoryEntry(None)])),
])  # fmt: skip
@pytest.mark.parametrize(
    'foreign', [b'{"format": "other", "of": []}', b'{', bytes(9), 'older', 'damaged']
)
def test_a_foreign_file_is_moved_aside_once(name, write, foreign, tmp_path):
    path = tmp_path / name
    for _ in range(2):
        write(tmp_path)
    written = path.read_bytes()
    if foreign == 'older':
        foreign = re.sub(rb'"version": \d+', b'"version": 0', written)
    if foreign == 'damaged':  # in one letter of a key; a state is replaced every 5 s
        foreign = b'{' if name == 'state.json' else re.sub(rb'(\w+)(": [^:]+})$', rb'x\2', written)
    path.write_bytes(foreign)
    write(tmp_path)
    kept = path.with_name(f'{path.name}.kept')
    assert (path.read_bytes(), kept.read_bytes()) == (written, foreign)
    path.write_bytes(b'also mine')
    with pytest.raises(WristFtCompError, match=f'{name} cannot be written: it exists and is'):
        write(tmp_path)
    assert (path.read_bytes(), kept.read_bytes()) == (b'also mine', foreign)
    path.write_bytes(written[:40])  # cut off by a disk
    write(tmp_path)
    assert (path.read_bytes(), kept.read_bytes()) == (written, foreign)


#: What reads each kind of file, and the kind where it has had an older version.
READERS = {
    'model.yaml': (model_file.load_model, model_file.KIND),
    'payloads.json': (load_payloads, payload_file.KIND),
    'state.json': (load_state, state_file.KIND),
    'learning.json': (lambda path: days.load_memory(path.parent), days.MEMORY),
    'days/diary.json': (lambda path: days.DIARY.load(days.Diary, path), days.DIARY),
    'active.json': (lambda path: NodeFolder(path.parent).history(), None),
}
BROKEN = [
    b'', b'{', b'{}', b'[]', b'[[]]', b'3', b'nul', b'null', b'"a.yaml"', b'\xff\xfe', b'\x00',
    b'[' * 100_000, b'{"format":' * 50_000, b'9' * 100_000, b'[null' + b',null' * 10**6 + b']',
    b'{"format": "other"}', b'{"format": NaN}', b'{"format": 1e999}', bytes(range(256)),
    b'just text', b'- 1\n- 2\n', b'a: [1, 2', b'a: !!python/object/apply:os.system [true]',
    b'? [1]\n: 2', b'a: !!timestamp soon', b'a: !!bool maybe', b'a: !!int ""', b'a: !!float x',
    b'a: !!binary "."', b'a: 2024-13-45', b'a: ' + b'9' * 10_000,
]  # fmt: skip


@pytest.mark.parametrize('name', READERS)
def test_a_broken_file_is_refused_by_its_name_and_stays(name, tmp_path):
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    for content in BROKEN:
        path.write_bytes(content)
        with pytest.raises(WristFtCompError, match=f'{path.name}') as refused:
            READERS[name][0](path)
        assert len(str(refused.value)) < 600
        assert path.read_bytes() == content


@pytest.mark.parametrize('name', [name for name, (_, kind) in READERS.items() if kind])
def test_a_file_of_an_older_version_is_refused_and_stays(name, tmp_path):
    (load, kind), path = READERS[name], tmp_path / name
    path.parent.mkdir(exist_ok=True)
    old = json.dumps({'format': kind.says, 'version': 1, 'since': 'then'})
    path.write_text(old)
    with pytest.raises(WristFtCompError) as refused:
        load(path)
    assert str(refused.value) == (
        f'{path} was written by an older version of wrist_ft_comp (format 1); this one reads '
        f'format {kind.version}. {kind.renewed_by}, or install that one.'
    )
    assert path.read_text() == old


@pytest.mark.parametrize('content', ['mine', 'stamp_s,force_z\n1.0,2.0\n'])
def test_a_day_that_the_node_did_not_write_stays(content, tmp_path):
    path = tmp_path / 'days/day_00007.csv'
    path.parent.mkdir()
    path.write_text(content)
    files = days.DayFiles(tmp_path, ('force_x', 'temperature_c'), 1e9)
    files.append(10**18, (1.0, 20.0))
    files.close()
    assert path.read_text() == content
    assert (tmp_path / 'days/day_00008.csv').exists()


class Pair(NamedTuple):
    number: int
    text: str = ''


@dataclass(frozen=True, eq=False)
class Sheet:
    kind: Literal['a', 'b']
    share: float
    table: FloatArray
    pairs: tuple[Pair, ...]
    ends: tuple[float, float]
    cells: tuple[tuple[int, ...], ...]
    by_name: Mapping[str, bool]
    path: Path | None = None


#: To plain values and back it goes; tuples with names are written by who owns them.
PLAIN = {
    'kind': 'a', 'share': None, 'table': [[1.0, 0.0], [0.0, 1.0]], 'pairs': [{'number': 1}],
    'ends': [1, 2.0], 'cells': [[1, 2]], 'by_name': {'x': True},
}  # fmt: skip
SHEET = Sheet('a', np.nan, np.eye(2), (Pair(1),), (1.0, 2.0), ((1, 2),), {'x': True})


def test_a_record_comes_back_from_plain_values():
    values = {**PLAIN, 'path': 'a/b'}
    back = from_plain(Sheet, values)
    assert np.isnan(back.share)
    np.testing.assert_array_equal(back.table, SHEET.table)
    assert (back.pairs, back.ends, back.cells) == (SHEET.pairs, SHEET.ends, SHEET.cells)
    assert (back.by_name, back.path) == ({'x': True}, Path('a/b'))
    assert from_plain(Sheet, PLAIN).path is None
    for known, sentence in ((None, 'share must be a finite'), (1.0, 'named values with text')):
        with pytest.raises(ValueError, match=sentence):
            from_plain(Sheet, {**PLAIN, 'share': known}, whole=True)


@pytest.mark.parametrize(('change', 'sentence'), [
    ({'kind': 'c'}, 'kind must be one of a, b'), ({'share': '1'}, 'share must be a finite'),
    ({'share': True}, 'share must be a finite'), ({'table': [[1.0], [1.0, 2.0]]}, 'length'),
    ({'table': [1.0, None]}, 'table must be finite numbers'),
    ({'table': [10**400]}, 'finite numbers'), ({'pairs': [{'number': 1.5}]}, 'pairs/0/number'),
    ({'pairs': [{'text': 'x'}]}, 'named values with number'), ({'ends': [1.0]}, '2 values'),
    ({'cells': [['1']]}, 'cells/0/0 must be an integer'), ({'by_name': {'x': 1}}, 'true or'),
    ({'path': 'a\0b'}, 'path must be a path'), ({'path': '\ud800'}, 'path must be a path'),
    ({'more': 1}, 'must be without more'),
])  # fmt: skip
def test_values_of_another_type_are_named_with_their_place(change, sentence):
    with pytest.raises(ValueError, match=sentence):
        from_plain(Sheet, {**PLAIN, **change})


def test_a_slow_disk_delays_nobody_and_of_a_file_the_newest_is_written(tmp_path, monkeypatch):
    """The disk answers when the test lets it; put returns before."""
    answers, asked, fsync, told = threading.Event(), threading.Event(), os.fsync, []

    def slow(handle):
        asked.set()
        assert answers.wait(TIMEOUT_S)
        fsync(handle)

    monkeypatch.setattr(os, 'fsync', slow)
    writer, path, written = FileWriter(), tmp_path / 'a.txt', []

    def write(number):
        written.append(number)
        replace_file(path, str(number))

    for number in range(10):
        writer.put('a', partial(write, number), told.append)
        assert asked.wait(TIMEOUT_S)
    assert not writer.end(0.0)
    writer.poll()
    assert (writer.problems, told) == ({}, [])
    monkeypatch.setattr(safe_file, '_HANGS_S', 0.0)
    writer.poll()
    assert writer.problems['a'].startswith('a is not written: the disk does not answer; until')
    answers.set()
    assert writer.end(TIMEOUT_S)
    writer.poll()
    assert (path.read_text(), told, len(written)) == ('9', [''] * 10, 2)
    refused = Output(name='sheet', endings='', begins='x')
    for write in (partial(refused.write, path, ''), lambda: 1 / 0):
        writer.put('a', write, told.append)
    assert 'a.txt cannot be written: it exists and is no sheet' in told[-2]
    assert 'by a fault of this program: ZeroDivisionError' in told[-1]
    assert told[-1] == writer.problems['a']
    ended = FileWriter()
    assert ended.end(0.0)
    ended.put('a', partial(replace_file, path, 'last'), told.append)
    assert (path.read_text(), told[-1]) == ('last', ''), 'after the end at once'
