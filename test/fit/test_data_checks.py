"""Channels that do not measure: dead, stuck, or thermometers that say nothing of their own."""

import re

import numpy as np
import pytest

from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.data_checks import (
    drop_stuck_cells,
    drop_unknown_temperatures,
    frozen_at_the_end,
    idle_thermometers,
    jumping_thermometers,
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


def test_a_short_stretch_and_a_coarse_channel_are_not_stuck(record):
    recording = record(slice(200, 209), 9.0, force_y=np.round(np.linspace(0, 5, CELLS)))
    (sound,), sentences = drop_stuck_cells([recording])
    np.testing.assert_equal((sound.wrench, sentences), (recording.wrench, []))


def test_a_dead_axis_is_none_that_was_found_to_drift_little(record):
    calibration = calibrate([record(force_z=np.zeros(CELLS))])
    assert 'force_z reads 0 N throughout: the channel is dead' in '\n'.join(calibration.warnings)
    assert list(calibration.model.deviation) == ['force_x']


def test_an_axis_that_is_read_only_while_temperatures_are_unknown_is_said(record):
    recording = record(torque_z=np.where(np.arange(CELLS) < 100, np.arange(CELLS), np.nan))
    recording.measured[:150] = False
    assert 'torque_z has 0 thermal cells with both' in '\n'.join(calibrate([recording]).warnings)


def test_a_thermometer_that_reports_on_change_is_not_silent(record):
    recording, at = record(), np.arange(CELLS)
    warm_c = 20 + 10 * (1 - np.exp(-at / 100)) + 0.1 * np.maximum(at - 900, 0)
    for step_k, sentences in ((0.1, 0), (2.0, 1)):
        read_c = np.round(warm_c + step_k * (at >= 900), 1)
        recording.temperature_c[:, 0] = read_c
        recording.measured[1:, 0] = np.diff(read_c) != 0
        assert len(drop_unknown_temperatures([recording])[1]) == sentences


def test_a_thermometer_that_jumps_is_named(record):
    recording = record()
    assert not list(jumping_thermometers([recording]))
    recording.temperature_c[300, 0] += 60.0
    (sentence,) = jumping_thermometers([recording])
    assert 'Thermometer 1 of a.csv jumps faster than metal can: by 60' in sentence
    recording.measured[200:300] = recording.measured[301:700] = False
    recording.temperature_c[300, 0] -= 50.0
    assert not list(jumping_thermometers([recording]))


def test_zeros_of_a_thermometer_that_wakes_up_are_named(record):
    # A node leaves out what follows them until metal could have got there.
    recording = record()
    recording.temperature_c[:20, 0] = 0.0
    recording.measured[20:30] = False
    (sentence,) = jumping_thermometers([recording])
    assert 'jumps faster than metal can: by' in sentence


def test_a_thermometer_that_was_frozen_all_day_is_known_by_its_other_days(make_recording, warm_up):
    def day(name, *temperatures_c):
        noise = np.random.default_rng(len(name)).standard_normal(CELLS)
        return make_recording(np.stack(temperatures_c, axis=1), {'force_x': noise}, name=name)

    still = np.full(CELLS, 21.5)
    sound = day('sound', warm_up(CELLS, 1), warm_up(CELLS, 2))
    with pytest.raises(CalibrationRefusedError, match='Thermometer 2 of odd keeps one value for'):
        calibrate([sound, day('odd', warm_up(CELLS, 3), still)])
    # One of few digits keeps a value now and then, but not for hours while another moves.
    coarse = np.round(warm_up(CELLS, 2), 1)
    assert drop_unknown_temperatures([day('few digits', warm_up(CELLS, 3), coarse)])[1] == []
    frozen = coarse.copy()
    frozen[:350] = frozen[349]
    assert drop_unknown_temperatures([day('rests', warm_up(CELLS, 3), frozen)])[1] == []
    frozen = coarse.copy()
    frozen[100:350] = frozen[100] - 5.0
    assert abs(frozen[350] - frozen[349]) > 1.3
    (said,) = drop_unknown_temperatures([day('freezes', warm_up(CELLS, 3), frozen)])[1]
    assert said.startswith('Thermometer 2 of freezes keeps one value for 25')
    frozen = coarse.copy()
    frozen[40:] = frozen[40]
    (said,) = frozen_at_the_end([day('freezes', warm_up(CELLS, 3), frozen)])
    assert re.match('Thermometer 2 of freezes keeps one value from .* while it moved by', said)
    assert not list(frozen_at_the_end([day('healthy', warm_up(CELLS, 3), coarse), sound]))
    # A coarse one keeps a value while nothing moves.
    assert drop_unknown_temperatures([sound, day('rest', still, still)])[1] == []


def test_a_thermometer_that_stands_still_in_one_of_two_files_of_a_name_is_said(make_recording):
    moving, still = np.linspace(20.0, 30.0, 60), np.full(60, 21.5)
    days = [
        make_recording(np.stack((moving, second), axis=1), {'force_z': 1.0}, name='log.csv')
        for second in (still, moving)
    ]
    (said,) = idle_thermometers(days)
    assert said == 'Thermometer 2 reads 21.5 °C all the time in log.csv. Check its topic.'


def test_plateaus_that_no_temperature_explains_are_no_motion(make_recording):
    """A chamber test whose load was called none: what is left is large, and nothing moved."""
    level = np.repeat([0, 1, 2], 360)
    read_n = np.array([0.0, 5.0, 0.0])[level] + np.random.default_rng(0).normal(0, 0.02, 1080)
    raw = np.where(np.arange(1080) % 360 < 120, read_n, np.nan)
    found = calibrate([make_recording(20.0 + 20.0 * level, {'force_z': raw}, period_s=10.0)])
    assert found.fits['force_z'].rms_after > 1.0
    assert not any('did the robot move' in said for said in found.warnings)
