"""Recordings of days: where one begins and ends, what survives, and what the disk allows."""

from functools import partial

import numpy as np
import pytest

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.learning.day_files import DayFiles, goes_on

DAY, SECOND = 1440, 10**9
START = 1_700_000_000 * SECOND
CHANNELS = ('force_x', 'temperature_c')
TOPICS = ['/a/temperature', '/b/state:motors[0]*0.1:K']


@pytest.fixture
def write(tmp_path):
    """Write a row at each of some minutes, as one run of a node; rows of every day there is."""

    def write(minutes, values=(1.0, 20.0), max_bytes=1e9):
        files = DayFiles(tmp_path, CHANNELS, max_bytes)
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
        ([range(DAY + 20)], [DAY, 20]),
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
    files = DayFiles(tmp_path, CHANNELS, 1e9)
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
        days = DayFiles(tmp_path, channels, 1e9, sensor=sensor)
        for minute in range(60):
            days.append(START + (60 * hour + minute) * 60 * SECOND, [1.0, 20.0, 25.0])
        days.close()
    first, second = sorted((tmp_path / 'days').iterdir())
    assert first.read_text().count('\n') == 121
    assert goes_on(first, second)
    assert not goes_on(second, first)
    assert not goes_on(first, first.with_name('day_00003.csv'))
    assert 'temperature_topics=/b/state:motors[0]%2A0.1:K&' in second.read_text()
