"""The folder of a node that learns by itself, as show tells of it."""

import json
from math import nan

import pytest

from wrist_ft_comp.learning.day_files import DayFiles
from wrist_ft_comp.learning.diary import diary_path, save_diary
from wrist_ft_comp.learning.entry import DayEntry, Decision, Diary
from wrist_ft_comp.learning.memory import Memory, save_memory

DAY = 86_400 * 10**9
START = 1_770_000_000 * 10**9


@pytest.fixture
def folder(tmp_path):
    """A node's folder: two judged days, one of them hit, and one that goes on."""
    folder = tmp_path / 'robots/left'
    left = {'none': (3.0,) * 6, 'abc': (0.3,) * 6, 'challenger': (0.2,) * 6}
    days = (
        DayEntry('day_00001.csv', START, 24.0, ((18.0, 25.0),), left=left, live='abc',
                 verdict='the challenger is better by chance only'),
        DayEntry('day_00002.csv', START + DAY, 23.5, ((24.0, 29.0),),
                 left={'none': (4.0, nan, nan, nan, nan, nan)}, live='abc',
                 incident='zero of force_z jumped by 4.1 N at 13:02'),
        DayEntry('day_00004.csv', START + 3 * DAY, 9.0, ((35.0, 40.0),), verdict='all is well'),
    )  # fmt: skip
    changes = (Decision('day_00001.csv', 'model_x.yaml was adopted'),)
    save_diary(folder, Diary(days, changes, 'zero of force_z jumped'))
    save_memory(folder, Memory(change='2026-05-02: model_x.yaml was adopted', offered='m.yaml'))
    files = DayFiles(folder, ('force_x', 'temperature_c'), 1e9, 'day_00004.csv')
    for hour in range(13):
        files.append(START + 4 * DAY + hour * 3600 * 10**9, (1.0, 20.0))
    files.close()
    return folder


def test_a_table_tells_of_every_day(done, folder):
    text = done('show', folder)
    lines = text.splitlines()
    assert lines[0].startswith(f'{folder}: days of a node that learns, 4')
    assert 'day_00001  2026-02-02   24.0     18.0 to 25.0         3        0.3' in text
    assert 'day_00002  2026-02-03   23.5     24.0 to 29.0         4          -' in text
    assert 'day_00005  2026-02-06   12.0' in text
    assert 'day_00001.csv: the challenger is better by chance only' in text
    assert 'day_00002.csv: zero of force_z jumped by 4.1 N at 13:02' in text
    assert 'day_00005.csv: not judged yet' in text
    assert 'after day_00001.csv: model_x.yaml was adopted' in text
    assert 'last change: 2026-05-02' in text
    assert 'known temperatures: thermometer 1: 18.0 to 29.0, 35.0 to 40.0 °C' in text
    assert 'offered: m.yaml' in text
    assert 'paused: zero of force_z jumped' in text
    assert max(map(len, lines[1:])) <= 80


def test_of_a_day_that_tells_nothing_neither_date_nor_length_is_told(done, folder):
    (folder / 'days/day_00006.csv').write_text('stamp_s,force_x\n')
    text = done('show', folder)
    assert '1970' not in text
    (line,) = (line for line in text.splitlines() if line.startswith('day_00006  '))
    assert line.split()[1:] == ['-'] * 6
    (document,) = json.loads(done('show', folder, '--json')).values()
    assert document['days'][-1]['first_ns'] is None
    assert document['days'][-1]['hours'] is None
    assert document['days'][0]['hours'] == 24.0


def test_the_days_themselves_and_a_folder_of_several_sensors_will_do(done, folder):
    assert done('show', folder / 'days') == done('show', folder)
    assert done('show', folder.parent) == done('show', folder)


@pytest.mark.parametrize('content', [None, '{', '{"format": "other"}'])
def test_without_a_diary_the_files_are_told(done, folder, content):
    path = diary_path(folder)
    path.unlink() if content is None else path.write_text(content)
    text = done('show', folder)
    assert 'that learns, 1\n' in text
    assert 'day_00005' in text


def test_json_has_what_the_table_leaves_out(done, folder):
    (document,) = json.loads(done('show', folder, '--json')).values()
    assert document['days'][0]['left']['abc'] == [0.3] * 6
    assert document['days'][1]['left']['none'][1] is None
    assert document['paused'] == 'zero of force_z jumped'


def test_a_picture_is_drawn(done, folder):
    path = folder / 'days.png'
    done('show', folder, '--picture', path)
    assert path.read_bytes().startswith(b'\x89PNG')


def test_a_folder_without_days_and_a_picture_of_none_are_sentences(run, folder, drift_csv):
    empty = folder / 'empty'
    empty.mkdir()
    (empty / 'state.json').write_text('{}')
    for words, sentence in (
        ([empty], 'holds no days. A node keeps them with the parameter learning'),
        ([drift_csv, '--picture', folder / 'a.png'], '--picture draws the days of a node'),
    ):
        outcome = run('show', *words)
        assert outcome.code == 1
        assert sentence in outcome.err
