from dataclasses import replace
import json

import numpy as np
import pytest

from wrist_ft_comp.learning.day_files import days
from wrist_ft_comp.learning.diary import (
    DayEntry,
    Diary,
    diary_path,
    diary_problem,
    good_days,
    load_diary,
    NONE,
    save_diary,
)
from wrist_ft_comp.learning.old_days import prune

DAY = DayEntry(
    name='day_00001.csv',
    first_ns=1_767_247_200_000_000_000,
    hours=2.5,
    temperature_c=((20.0, 31.5), (18.0, 25.0)),
    known=frozenset({(4, -1), (5, 0)}),
    left={NONE: (3.0, 2.0, 1.0, 0.1, 0.2, np.nan), 'abcdef012345': (0.5,) * 6},
    live='abcdef012345',
    verdict='The live model left 0.17 of the drift.',
    incident='The zero jumped by 5 N.',
    kind='zero',
    challenged=True,
    better='model_2.yaml',
    seconds=5.5,
    payloads=((1.5, 0.0, 0.001, 0.1),),
    rotation=(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
    noise=(0.1,) * 6,
)


def test_a_diary_comes_back_as_it_was_written(tmp_path):
    diary = Diary((DAY, DayEntry('day_00002.csv')), paused='It was hit.')
    save_diary(tmp_path, diary)
    again = load_diary(tmp_path)
    assert repr(again.days[0]) == repr(replace(DAY, left=dict(DAY.left)))
    assert replace(again, days=again.days[1:]) == replace(diary, days=diary.days[1:])


def test_no_day_is_forgotten_because_the_sensor_changed_later():
    kinds = ('', 'tool', 'sensor', 'zero', 'contacts', '')
    days = [DayEntry(f'day_0000{n}.csv', kind=kind) for n, kind in enumerate(kinds)]
    assert [int(day.name[8]) for day in good_days(days)] == [0, 1, 5]


@pytest.mark.parametrize('content', ['', '{', '[]', '{"format": "other"}', '\x00', '[' * 10**5])
def test_a_missing_or_broken_diary_is_begun_anew(tmp_path, content):
    assert load_diary(tmp_path) == Diary()
    save_diary(tmp_path, Diary((DAY,)))
    diary_path(tmp_path).write_text(content)
    assert load_diary(tmp_path) == Diary()


def test_a_year_is_small_and_three_are_the_most(tmp_path):
    many = [replace(DAY, name=f'day_{n:05d}.csv') for n in range(1, 1201)]
    save_diary(tmp_path, Diary(tuple(many)))
    again = load_diary(tmp_path)
    assert [again.days[0].name, again.days[-1].name] == ['day_00201.csv', 'day_01200.csv']
    assert diary_path(tmp_path).stat().st_size < 5e6


def test_days_are_listed_oldest_first_and_a_person_s_day_1_is_none(tmp_path):
    assert days(tmp_path) == []
    (tmp_path / 'days').mkdir()
    for name in ('day_00010.csv', 'day_00009.csv', 'day_1.csv', 'day_00011.csv~', 'diary.json'):
        (tmp_path / 'days' / name).touch()
    assert [path.name for path in days(tmp_path)] == ['day_00009.csv', 'day_00010.csv']


def recorded(folder, sizes):
    """Make recordings of some sizes, bytes, and a diary in which they share their temperatures."""
    (folder / 'days').mkdir()
    for name, size in sizes.items():
        (folder / 'days' / name).write_bytes(b'x' * size)
    return Diary(tuple(replace(DAY, name=name, kind='') for name in sizes))


def test_no_more_days_are_kept_than_are_asked_for_and_the_newest_always(tmp_path):
    diary = recorded(tmp_path, {f'day_0000{n}.csv': 10 for n in range(1, 7)})
    unique = replace(diary.days[0], known=frozenset({(99, 0)}))
    diary = replace(diary, days=(unique, *diary.days[1:]))
    assert prune(tmp_path, diary, 3, 500.0) == ['day_00001.csv', 'day_00005.csv', 'day_00006.csv']
    assert len(days(tmp_path)) == 3
    assert prune(tmp_path, diary, 1, 500.0) == ['day_00006.csv']


def test_bytes_are_bounded_with_room_for_another_day(tmp_path):
    diary = recorded(tmp_path, {f'day_0000{n}.csv': 1_000_000 for n in range(1, 7)})
    assert len(prune(tmp_path, diary, 30, 16.1)) == 6
    assert len(prune(tmp_path, diary, 30, 13.5)) == 3
    assert prune(tmp_path, diary, 30, 11.5) == ['day_00006.csv']
    assert prune(tmp_path, diary, 30, 10.5) == [], 'a day larger than its room stops nothing'


def test_a_recording_that_nobody_judged_stays(tmp_path):
    diary = recorded(tmp_path, {'day_00001.csv': 10, 'day_00002.csv': 10})
    assert prune(tmp_path, replace(diary, days=diary.days[:1]), 1, 500.0) == [
        'day_00001.csv', 'day_00002.csv']  # fmt: skip


@pytest.mark.parametrize(
    'change',
    [{'noise': [0.1]}, {'left': {'none': [1.0]}}, {'payloads': [[1.0]]}, {'rotation': [1.0] * 8}],
)
def test_an_entry_with_too_few_figures_is_damage(change, tmp_path):
    save_diary(tmp_path, Diary((DayEntry('day_00001.csv'),)))
    assert load_diary(tmp_path).days
    document = json.loads(diary_path(tmp_path).read_text())
    document['days'][0].update(change)
    diary_path(tmp_path).write_text(json.dumps(document))
    assert load_diary(tmp_path) == Diary()
    assert 'too few or too many figures' in diary_problem(tmp_path)
