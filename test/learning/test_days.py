"""Days: where one begins and ends, what survives, what the disk allows; and their diary."""

from dataclasses import replace
from functools import partial
import json

import numpy as np
import pytest

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.learning import days

MINUTES, SECOND = 1440, 10**9
START = 1_700_000_000 * SECOND
CHANNELS = ('force_x', 'temperature_c')
TOPICS = ['/a/temperature', '/b/state:motors[0]*0.1:K']
DAY = days.DayEntry(
    name='day_00001.csv', first_ns=1_767_247_200_000_000_000, hours=2.5,
    temperature_c=((20.0, 31.5), (18.0, 25.0)), known=((4, -1), (5, 0)),
    left={days.NONE: (3.0, 2.0, 1.0, 0.1, 0.2, np.nan), 'abcdef012345': (0.5,) * 6},
    live='abcdef012345', verdict='The live model left 0.17 of the drift.',
    incident='The zero jumped by 5 N.', kind='zero', challenged=True, better='model_2.yaml',
    payloads=((1.5, 0.0, 0.001, 0.1),),
    rotation=(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), noise=(0.1,) * 6,
)  # fmt: skip


@pytest.fixture
def write(tmp_path):
    """Write a row at each of some minutes, as one run of a node; rows of every day there is."""

    def write(minutes, values=(1.0, 20.0), max_bytes=1e9):
        files = days.DayFiles(tmp_path, CHANNELS, max_bytes)
        try:
            for minute in minutes:
                files.append(round(minute * 60 * SECOND), values)
        finally:
            files.close()
        paths = sorted((tmp_path / 'days').glob('*'))
        return [path.read_text().count('\n') - 1 for path in paths]

    return write


@pytest.mark.parametrize(
    ('runs', 'rows'),
    [
        ([range(MINUTES + 20)], [MINUTES, 20]),
        ([[*range(60), *range(60 + 114, 234)]], [120]),
        ([[*range(60), *range(60 + 132, 252)]], [60, 60]),
        ([[*range(200, 260), *range(60)]], [60, 59]),
        ([[*range(60), 30, *range(60, 70)]], [70]),
        ([range(60), range(60, 120)], [120]),
        ([range(60), range(300, 360)], [60, 60]),
        ([range(5), range(300, 360)], [60]),
        ([range(60), range(300, 360), range(600, 605), range(900, 960)], [60, 60, 60]),
    ],
    ids=[
        'a day', 'silent for 1.9 h', 'silent for 2.2 h', 'time ran back', 'a stray row',
        'a restart', 'a late restart', 'minutes only', 'minutes later on',
    ],
)  # fmt: skip
def test_a_day_ends_after_24_h_a_silence_of_2_h_and_where_time_ran_back(write, runs, rows):
    assert [write(run) for run in runs][-1] == rows


@pytest.mark.parametrize(('apart', 'days'), [(833, 2), (60, 1)])
def test_two_clocks_do_not_fill_the_folder_with_files(write, apart, days):
    both = (minute for pair in range(1000, 1050) for minute in (pair, pair + apart))
    rows = write([*range(1000), *both])
    assert len(rows) == days
    assert rows[0] >= 1000


def test_temperatures_from_before_a_silence_begin_no_day(tmp_path):
    files = days.DayFiles(tmp_path, CHANNELS, 1e9)
    for second in (*range(700), 100, 101, 102):
        files.append(second * SECOND, (1.0 if second > 102 else np.nan, 20.0))
    files.close()
    assert len(list((tmp_path / 'days').iterdir())) == 1


def test_a_killed_node_loses_the_last_row_at_most(write, tmp_path):
    write(range(20))
    path = tmp_path / 'days/day_00001.csv'
    whole = path.read_bytes()
    path.write_bytes(whole[:-9])
    assert write(range(20, 25)) == [24]
    assert path.read_bytes().startswith(whole[: whole[:-1].rindex(b'\n') + 1])


def test_the_days_never_take_more_than_their_room(write, tmp_path):
    (tmp_path / 'days').mkdir()
    with (tmp_path / 'days/day_00001.csv').open('wb') as file:
        file.truncate(50_000_010)
    with pytest.raises(RecordingError, match=r'as much as learning.max_mb allows \(50 MB\)'):
        write(range(1, 20), max_bytes=5e7)
    assert len(list((tmp_path / 'days').iterdir())) == 1


def test_a_restart_with_the_thermometers_in_another_order_begins_another_day(tmp_path):
    for hour, topics in enumerate((TOPICS, TOPICS, TOPICS[::-1])):
        channels = ('force_z', 'temperature_c', 'temperature_2_c')
        sensor = partial(dict, temperature_topics=topics)
        files = days.DayFiles(tmp_path, channels, 1e9, sensor=sensor)
        for minute in range(60):
            files.append(START + (60 * hour + minute) * 60 * SECOND, [1.0, 20.0, 25.0])
        files.close()
    first, second = sorted((tmp_path / 'days').iterdir())
    assert first.read_text().count('\n') == 121
    assert days.goes_on(first, second)
    assert not days.goes_on(second, first)
    assert not days.goes_on(first, first.with_name('day_00003.csv'))
    assert 'temperature_topics=/b/state:motors[0]%2A0.1:K&' in second.read_text()


def test_a_diary_comes_back_as_it_was_written(tmp_path):
    days.save_diary(
        tmp_path, days.Diary((DAY, days.DayEntry('day_00002.csv')), paused='It was hit.')
    )
    again = days.load_diary(tmp_path)
    assert repr(again.days[0]) == repr(replace(DAY, left=dict(DAY.left)))
    assert (again.days[1], again.paused) == (days.DayEntry('day_00002.csv'), 'It was hit.')


def test_no_day_is_forgotten_because_the_sensor_changed_later():
    kinds = ('', 'tool', 'sensor', 'zero', 'contacts', '')
    entries = [days.DayEntry(f'day_0000{n}.csv', kind=kind) for n, kind in enumerate(kinds)]
    assert [int(day.name[8]) for day in days.good_days(entries)] == [0, 1, 5]
    entries[5] = replace(entries[5], temperature_c=((20.0, 30.0),))
    assert days.good_days(entries) == entries[5:], 'other thermometers are of another sensor'


def test_bytes_are_bounded_and_a_recording_that_nobody_judged_stays(tmp_path):
    """Of six recordings of 1 MB only the first had its temperatures alone."""
    (tmp_path / 'days').mkdir()
    entries = []
    for n in range(1, 7):
        (tmp_path / f'days/day_0000{n}.csv').write_bytes(b'x' * 1_000_000)
        known = ((99, 0),) if n == 1 else DAY.known
        entries.append(replace(DAY, name=f'day_0000{n}.csv', kind='', known=known))
    recorded = days.Diary(tuple(entries))
    for max_mb, kept in (6.1, [1, 2, 3, 4, 5, 6]), (5.1, [1, 3, 4, 5, 6]), (3.5, [1, 5, 6]):
        days.prune(tmp_path, recorded, max_mb)
        assert [int(path.name[8]) for path in days.day_files(tmp_path)] == kept
    days.prune(tmp_path, replace(recorded, days=recorded.days[:1]), 0.5)
    assert len(days.day_files(tmp_path)) == 2


@pytest.mark.parametrize(
    'change',
    [{'noise': [0.1]}, {'left': {'none': [1.0]}}, {'payloads': [[1.0]]}, {'rotation': [1.0] * 8}],
)
def test_an_entry_with_too_few_figures_is_damage(change, tmp_path):
    days.save_diary(tmp_path, days.Diary((days.DayEntry('day_00001.csv'),)))
    assert days.load_diary(tmp_path).days
    document = json.loads(days.diary_path(tmp_path).read_text())
    document['days'][0].update(change)
    days.diary_path(tmp_path).write_text(json.dumps(document))
    assert days.load_diary(tmp_path).days == ()
    assert 'too few or too many figures' in days.load_diary(tmp_path).problem
