from dataclasses import replace

import numpy as np
import pytest

from wrist_ft_comp.calibration.learning.entry import DayEntry, Decision, Diary, NONE
from wrist_ft_comp.files.days.diary import days, diary_path, load_diary, prune, save_diary

DAY = DayEntry(
    name='day_20260101T060000Z.csv',
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
    seconds=5.5,
    payloads=((1.5, 0.0, 0.001, 0.1),),
    rotation=(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
    noise=(0.1,) * 6,
)


def test_a_diary_comes_back_as_it_was_written(tmp_path):
    diary = Diary((DAY, DayEntry('day_2.csv')), (Decision(DAY.name, 'Learnt.'),), 'It was hit.')
    save_diary(tmp_path, diary)
    again = load_diary(tmp_path)
    assert repr(again.days[0]) == repr(replace(DAY, left=dict(DAY.left)))
    assert replace(again, days=again.days[1:]) == replace(diary, days=diary.days[1:])


def test_without_a_diary_there_are_no_days(tmp_path):
    assert load_diary(tmp_path) == Diary()


@pytest.mark.parametrize('content', ['', '{', '[]', '{"format": "other"}', '\x00', '[' * 10**5])
def test_a_broken_diary_is_begun_anew(tmp_path, content):
    save_diary(tmp_path, Diary((DAY,)))
    diary_path(tmp_path).write_text(content)
    assert load_diary(tmp_path) == Diary()


def test_a_year_is_small_and_three_are_the_most(tmp_path):
    many = [replace(DAY, name=f'day_{n}') for n in range(1200)]
    save_diary(tmp_path, Diary(tuple(many)))
    again = load_diary(tmp_path)
    assert [again.days[0].name, again.days[-1].name] == ['day_200', 'day_1199']
    assert diary_path(tmp_path).stat().st_size < 5e6


def test_days_are_listed_oldest_first(tmp_path):
    assert days(tmp_path) == []
    (tmp_path / 'days').mkdir()
    for name in ('day_20260102T000000Z.csv', 'day_20251231T000000Z.csv', 'diary.json'):
        (tmp_path / 'days' / name).touch()
    assert [each.name[4:12] for each in days(tmp_path)] == ['20251231', '20260102']


def recorded(folder, sizes):
    """Make recordings of so many bytes, and a diary of them that knows the same temperatures."""
    (folder / 'days').mkdir()
    for name, size in sizes.items():
        (folder / 'days' / name).write_bytes(b'x' * size)
    return Diary(tuple(replace(DAY, name=name, kind='') for name in sizes))


def test_no_more_days_are_kept_than_are_asked_for_and_the_newest_always(tmp_path):
    diary = recorded(tmp_path, {f'day_{n}.csv': 10 for n in range(6)})
    unique = replace(diary.days[0], known=frozenset({(99, 0)}))
    diary = replace(diary, days=(unique, *diary.days[1:]))
    assert prune(tmp_path, diary, 3, 500.0) == ['day_0.csv', 'day_4.csv', 'day_5.csv']
    assert [path.name for path in days(tmp_path)] == ['day_0.csv', 'day_4.csv', 'day_5.csv']
    assert prune(tmp_path, diary, 1, 500.0) == ['day_5.csv']


def test_bytes_are_bounded_with_room_for_another_day(tmp_path):
    diary = recorded(tmp_path, {f'day_{n}.csv': 1_000_000 for n in range(6)})
    assert len(prune(tmp_path, diary, 30, 16.1)) == 6
    assert len(prune(tmp_path, diary, 30, 13.5)) == 3
    assert prune(tmp_path, diary, 30, 1.0) == ['day_5.csv']


def test_a_recording_that_nobody_judged_stays(tmp_path):
    diary = recorded(tmp_path, {'day_1.csv': 10, 'day_2.csv': 10})
    assert prune(tmp_path, replace(diary, days=diary.days[:1]), 1, 500.0) == [
        'day_1.csv', 'day_2.csv']  # fmt: skip
