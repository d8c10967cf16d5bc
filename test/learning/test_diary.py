from dataclasses import replace
import json

import numpy as np
import pytest

from wrist_ft_comp.learning import diary as diaries
from wrist_ft_comp.learning.day_files import days
from wrist_ft_comp.learning.diary import DayEntry, Diary, load_diary, NONE, save_diary
from wrist_ft_comp.learning.learning_plan import good_days, prune

DAY = DayEntry(
    name='day_00001.csv', first_ns=1_767_247_200_000_000_000, hours=2.5,
    temperature_c=((20.0, 31.5), (18.0, 25.0)), known=((4, -1), (5, 0)),
    left={NONE: (3.0, 2.0, 1.0, 0.1, 0.2, np.nan), 'abcdef012345': (0.5,) * 6},
    live='abcdef012345', verdict='The live model left 0.17 of the drift.',
    incident='The zero jumped by 5 N.', kind='zero', challenged=True, better='model_2.yaml',
    payloads=((1.5, 0.0, 0.001, 0.1),),
    rotation=(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), noise=(0.1,) * 6,
)  # fmt: skip


def test_a_diary_comes_back_as_it_was_written(tmp_path):
    save_diary(tmp_path, Diary((DAY, DayEntry('day_00002.csv')), paused='It was hit.'))
    again = load_diary(tmp_path)
    assert repr(again.days[0]) == repr(replace(DAY, left=dict(DAY.left)))
    assert (again.days[1], again.paused) == (DayEntry('day_00002.csv'), 'It was hit.')


def test_no_day_is_forgotten_because_the_sensor_changed_later():
    kinds = ('', 'tool', 'sensor', 'zero', 'contacts', '')
    entries = [DayEntry(f'day_0000{n}.csv', kind=kind) for n, kind in enumerate(kinds)]
    assert [int(day.name[8]) for day in good_days(entries)] == [0, 1, 5]
    entries[5] = replace(entries[5], temperature_c=((20.0, 30.0),))
    assert good_days(entries) == entries[5:], 'other thermometers are of another sensor'


@pytest.fixture
def recorded(tmp_path):
    """Six recordings of 1 MB, and their diary: only the first had its temperatures alone."""
    (tmp_path / 'days').mkdir()
    entries = []
    for n in range(1, 7):
        (tmp_path / f'days/day_0000{n}.csv').write_bytes(b'x' * 1_000_000)
        known = ((99, 0),) if n == 1 else DAY.known
        entries.append(replace(DAY, name=f'day_0000{n}.csv', kind='', known=known))
    return Diary(tuple(entries))


def test_bytes_are_bounded_and_a_recording_that_nobody_judged_stays(recorded, tmp_path):
    for max_mb, kept in (6.1, [1, 2, 3, 4, 5, 6]), (5.1, [1, 3, 4, 5, 6]), (3.5, [1, 5, 6]):
        prune(tmp_path, recorded, max_mb)
        assert [int(path.name[8]) for path in days(tmp_path)] == kept
    prune(tmp_path, replace(recorded, days=recorded.days[:1]), 0.5)
    assert len(days(tmp_path)) == 2


@pytest.mark.parametrize(
    'change',
    [{'noise': [0.1]}, {'left': {'none': [1.0]}}, {'payloads': [[1.0]]}, {'rotation': [1.0] * 8}],
)
def test_an_entry_with_too_few_figures_is_damage(change, tmp_path):
    save_diary(tmp_path, Diary((DayEntry('day_00001.csv'),)))
    assert load_diary(tmp_path).days
    document = json.loads(diaries.diary_path(tmp_path).read_text())
    document['days'][0].update(change)
    diaries.diary_path(tmp_path).write_text(json.dumps(document))
    assert load_diary(tmp_path).days == ()
    assert 'too few or too many figures' in load_diary(tmp_path).problem
