"""Channels that do not measure: dead, stuck, or thermometers that say nothing of their own."""

from dataclasses import replace

import numpy as np
import pytest

from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.fit.data_checks import (
    drop_stuck_cells,
    idle_thermometers,
    jumping_thermometers,
    silent_stretches,
)

CELLS = 1000


@pytest.fixture
def record(make_recording, warm_up):
    """Record a lively force x, some of whose cells are means of one value, beside other axes."""

    def make(cells=slice(0), value=0.0, **axes):
        lively = np.random.default_rng(0).standard_normal(CELLS)
        lively[cells] = value
        lively[cells][::2] += np.spacing(value)
        return make_recording(warm_up(CELLS, 0), {'force_x': lively, **axes}, name='a.csv')

    return make


@pytest.mark.parametrize(('value', 'verb'), [(9.0, 'saturates'), (0.5, 'freezes')])
def test_a_stuck_stretch_is_left_out_and_named(record, value, verb):
    recording = record(slice(200, 240), value)
    (sound,), sentences = drop_stuck_cells([recording], ['force_x'])
    assert sentences == [
        (
            f'force_x of a.csv {verb} at {value:g} N: 400 s (4.0 %) without any change, first '
            'at 0:33:20; left out.'
        )
    ]
    np.testing.assert_array_equal(
        np.flatnonzero(np.isnan(sound.wrench[:, 0])), np.arange(200, 240)
    )
    assert np.isfinite(recording.wrench[:, 0]).all()


def test_a_short_stretch_and_a_coarse_channel_are_not_stuck(record):
    coarse = np.round(np.linspace(0, 5, CELLS))
    recording = record(slice(200, 209), 9.0, force_y=coarse)
    assert drop_stuck_cells([recording], ['force_x', 'force_y']) == ([recording], [])


def test_too_long_a_stretch_is_refused(record):
    with pytest.raises(CalibrationRefusedError, match=r'510 s \(5.1 %\).* up to 5 % can be left'):
        drop_stuck_cells([record(slice(200, 251), 9.0)], ['force_x'])


def test_an_axis_that_is_stuck_for_long_is_learnt_from_other_recordings(record):
    stuck, sound = record(slice(200, 900), 9.0), record()
    (left, whole), (sentence,) = drop_stuck_cells([stuck, sound], ['force_x'])
    assert np.isnan(left.wrench[:, 0]).all()
    assert whole is sound
    assert '7000 s (70.0 %) without any change, first at 0:33:20; it is not learnt' in sentence


def test_a_thermometer_that_jumps_is_named(record):
    recording = record()
    assert jumping_thermometers([recording]) == []
    recording.temperature_c[300, 0] += 60.0
    (sentence,) = jumping_thermometers([recording])
    assert 'Thermometer 1 of a.csv jumps faster than metal can: by 60' in sentence
    recording.measured[200:300] = recording.measured[301:700] = False
    assert jumping_thermometers([recording]) == []


def test_a_thermometer_is_idle_when_it_stands_still_or_repeats_another(record):
    first = record().temperature_c[:, 0]
    wander = np.cumsum(np.random.default_rng(1).standard_normal(CELLS))
    still_c = 21.0 + np.spacing(21.0) * (np.arange(CELLS) % 2)
    columns = (first, still_c, 2 * first + 5, wander)
    temperature_c = np.stack(columns, axis=1)
    four = replace(record(), temperature_c=temperature_c, measured=temperature_c > -np.inf)
    still, same = idle_thermometers([four])
    assert still.startswith('Thermometer 2 reads 21.0 °C throughout')
    assert same.startswith('Thermometers 1 and 3 say the same')


def test_a_wrench_that_is_missing_for_long_is_named_unless_between_plateaus(record):
    recording = record(slice(200, 290), np.nan)
    (sentence,) = silent_stretches([recording], 600.0)
    assert sentence.startswith('The raw wrench of a.csv is missing for 900 s')
    assert silent_stretches([recording], 900.0) == []
    recording.wrench[600:690] = np.nan  # three stretches of a warm-up are no plateaus
    assert len(silent_stretches([recording], 600.0)) == 1
    stairs = np.repeat([10.0, 20.0, 30.0], [245, 400, 355])[:, np.newaxis]
    assert silent_stretches([replace(recording, temperature_c=stairs)], 600.0) == []
