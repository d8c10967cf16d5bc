"""Still loads: what stands out is left out, steps begin segments, what moves is said."""

from dataclasses import replace
import re

import numpy as np
import pytest

from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.outliers_and_steps import segment
from wrist_ft_comp.fit.settings import CalibrationSettings
from wrist_ft_comp.report.evaluation import evaluate, tared_errors

CELLS = 3600
NOISE = 0.02


@pytest.fixture
def day(make_recording):
    """An hour of cells of 1 s; force z drifts by some newtons, torque x hardly."""

    def make(seed=0, add=0.0, clock_s=0, period_s=1.0, cells=CELLS):
        rng = np.random.default_rng(seed)
        time_s = period_s * np.arange(cells)
        temperature_c = 20 + 15 * (1 - np.exp(-time_s / (1200 + 300 * seed)))
        temperature_c += 2 * np.sin(time_s / 400 + seed)
        force = 0.3 * temperature_c + NOISE * rng.standard_normal(cells)
        torque = 0.01 * temperature_c + 1e-3 * rng.standard_normal(cells)
        recording = make_recording(
            temperature_c, {'force_z': force + add, 'torque_x': torque}, period_s=period_s,
            name=f'day{seed}.csv')  # fmt: skip
        return replace(recording, first_cell=round(clock_s / period_s))

    return make


def stepped(*steps, cells=CELLS):
    values = np.zeros(cells)
    for cell, size in steps:
        values[cell:] += size
    return values


@pytest.mark.parametrize('period_s', [1.0, 10.0])
@pytest.mark.parametrize(('size', 'gap_s'), [(2.0, 0), (-20.0, 0), (-20.0, 400)])
def test_a_step_is_named_with_time_of_day_size_and_axis(day, size, gap_s, period_s):
    cells = round(CELLS / period_s)
    at = round(2000 / period_s)
    form = {'period_s': period_s, 'cells': cells}
    made = day(add=stepped((at, size), cells=cells), clock_s=1_700_000_000, **form)
    made.wrench[at - round(gap_s / period_s) : at] = np.nan
    ((found,), (sentence,)) = segment([made], 'unloaded')
    assert len(found.steps) == 1
    assert abs(found.steps[0] - at) * period_s <= 30
    assert sentence.startswith('day0.csv steps at 0:33:')
    assert '(2023-11-14 22:46:' in sentence
    named = re.search(r'UTC\): force_z by (\S+) N\. ', sentence)
    near = (5 + gap_s / 20) * NOISE  # drift moves in a gap
    assert float(named[1]) == pytest.approx(size, abs=near)
    assert sentence.endswith('. A new segment begins there, as after a tare.')
    plain = day(**form)
    error = found.wrench[:, 2] - plain.wrench[:, 2]
    assert np.nanmax(np.abs(error[: at - 30])) == 0
    assert np.abs(np.median(error[at + 30 :])) < near


CELL = np.arange(CELLS)


@pytest.mark.parametrize('size', [0.0, 5.0])
@pytest.mark.parametrize('away', [
    *(CELL % every_s > 0 for every_s in (5, 20, 31, 60)), abs(CELL - 2025) <= 20,
    abs(CELL - 1975) <= 20, (CELL >= 1970) & (CELL < 2040) & (abs(CELL - 2004) > 1),
    (CELL[:, np.newaxis] >= 1800) & (np.arange(6) == 3),
    (CELL[:, np.newaxis] < 900) & (np.arange(6) == 2),
])  # fmt: skip
def test_a_step_is_found_once_among_few_wrenches_and_beside_pauses(day, away, size):
    made, plain = day(add=stepped((2000, size))), day()
    made.wrench[away] = np.nan
    ((found,), sentences) = segment([made], 'unloaded')
    assert [' steps at 0:3' in sentence for sentence in sentences] == [True] * (size > 0)
    assert abs(np.nanmedian((found.wrench - plain.wrench)[2000:, 2])) < 0.2


def test_a_calibration_and_an_evaluation_go_on_after_steps(day):
    plain, calibration = (
        calibrate([day(1, add), day(2)]) for add in (0.0, stepped((900, 8.0), (2500, -3.0)))
    )
    assert sum('A new segment begins there' in warning for warning in calibration.warnings) == 2
    usual = evaluate(plain.model, [day(3)])['force_z']
    for steps in (
        [(1500, 5.0)], [(1500, 9.0), (1580, -9.0)], [(900, 60.0), (2000, 1.5)],
        [(900, 60.0), (1500, 9.0), (1525, -9.0)], [(1500, 0.6), (1525, -0.6)],
    ):  # fmt: skip
        judged = day(3, stepped(*steps))
        left, without = (evaluate(of.model, [judged])['force_z'] for of in (calibration, plain))
        assert left.rms_after < 1.2 * without.rms_after + NOISE, steps
        *found, last = tared_errors(plain.model, judged, 'unloaded').warnings
        is_stepped = any('A new segment' in said for said in found)
        assert ('is judged as if ~/tare had been called at each step' in last) == is_stepped
        assert left.rms_before == pytest.approx(usual.rms_before, rel=0.02)
        assert left.rms_after < 0.1 * left.rms_before


@pytest.mark.parametrize(('begin', 'end'), [(1200, 2500), (20, 400), (90, 200), (3400, 3550)])
@pytest.mark.parametrize('zeroed_n', [0.0, 3.0, -20.0])
def test_after_a_pause_a_new_segment_begins_if_the_driver_was_tared(day, zeroed_n, begin, end):
    """In a long one, or one that is near the start or the end, where nothing else can tell."""
    days = [day(seed, stepped((end, zeroed_n))) for seed in (1, 2)]
    for recording in days:
        recording.wrench[begin:end] = np.nan
    calibration = calibrate(days)
    said = 'after a pause' in '\n'.join(calibration.warnings)
    assert said == bool(zeroed_n)
    assert calibration.fits['force_z'].rms_after < 2 * NOISE
    assert evaluate(calibration.model, [day(3)])['force_z'].rms_after < 2 * NOISE


def test_slow_drift_that_no_thermometer_shows_is_no_tare_in_each_pause(day):
    """The verdict and the limit would be of the stretches between the pauses."""
    cells = 4 * CELLS
    creep = 3 * (1 - np.exp(-np.arange(cells) / cells))
    days = [day(seed, sign * creep, cells=cells) for seed, sign in ((1, 1), (2, -1), (4, 0.5))]
    whole = calibrate(days).fits['force_z']
    for recording in days:
        for hour in (1, 2, 3):
            recording.wrench[hour * CELLS : hour * CELLS + 900] = np.nan
    paused = calibrate(days)
    assert 'after a pause' not in '\n'.join(paused.warnings)
    assert paused.fits['force_z'].rms_after > 0.9 * whole.rms_after
    days[0].wrench[2 * CELLS :] += 20.0  # one of the pauses, with a tare
    tared = calibrate(days)
    assert ''.join(tared.warnings).count('after a pause') == 1
    assert tared.fits['force_z'].rms_after > 0.5 * whole.rms_after


def test_where_the_load_is_recorded_a_tare_of_the_driver_is_found_beside_it(day):
    days = [day(1, stepped((1500, 4.0))), day(2)]
    for number, recording in enumerate(days):
        recording.reference[:] = 20 * np.sin(np.arange(CELLS) / 300 + number)[:, np.newaxis]
        recording.wrench[:] += recording.reference
    calibration = calibrate(days, CalibrationSettings('recorded'))
    assert 'day1.csv steps at 0:25:' in '\n'.join(calibration.warnings)
    assert calibration.fits['force_z'].rms_after < 2 * NOISE
    assert evaluate(calibration.model, [day(3)])['force_z'].rms_after < 2 * NOISE


@pytest.mark.parametrize('what', ['read again', 'thinner', 'tared', 'rounded'])
def test_other_samples_of_one_day_are_no_other_day(day, what):
    other = replace(day(1), name='export.csv')
    noise = np.array([NOISE] * 3 + [1e-3] * 3)
    other.wrench[:] += np.random.default_rng(5).normal(0, 1, (CELLS, 6)) * noise
    if what == 'thinner':
        other.wrench[np.arange(CELLS) % 10 > 0] = np.nan
    if what == 'tared':
        other.wrench[:] -= 5.0
    if what == 'rounded':
        other.temperature_c[:] = other.temperature_c.round()
    with pytest.raises(CalibrationRefusedError, match='the same day, or a part of it'):
        calibrate([day(1), other])


def test_a_recording_that_was_broken_off_on_the_cold_robot_is_none_of_that_day(day):
    rng, first, parts = np.random.default_rng(6), day(1), ('temperature_c', 'wrench')
    noise = np.array([NOISE] * 3 + [1e-3] * 3)
    for part in parts:
        vars(first)[part][:900] = vars(first)[part][0]
    parts = (*parts, 'measured', 'reference')
    cold = replace(first, **{part: vars(first)[part][:900].copy() for part in parts})
    for recording in (first, cold):
        recording.wrench[:900] += rng.normal(0, 1, (900, 6)) * noise
    calibrate([first, cold, day(2)])


def test_what_froze_is_no_step_of_what_is_judged(day):
    model, frozen = calibrate([day(1), day(2)]).model, day(3)
    frozen.wrench[1200:2300, 2] = frozen.wrench[1200, 2]
    judged = tared_errors(model, frozen, 'unloaded')
    assert judged.warnings[0].startswith('force_z of day3.csv freezes at')
    assert np.isfinite(judged.after).any(axis=0).nonzero()[0].tolist() == [3]
    frozen.wrench[1200:2300] = frozen.wrench[1200]
    with pytest.raises(CalibrationRefusedError, match='Check the range and the driver'):
        tared_errors(model, frozen, 'unloaded')


def test_each_segment_of_what_is_held_out_is_tared(day):
    both = [[day(seed, add) for seed in (1, 2)] for add in (0.0, stepped((1000, 30.0)))]
    for recording in (*both[0], *both[1]):  # what drifted in the pause is guessed
        recording.wrench[400:1000] = np.nan
    usual, left = (calibrate(days).fits['force_z'].rms_after for days in both)
    assert 0 < left == pytest.approx(usual, abs=NOISE / 2)


def test_what_is_between_the_plateaus_of_a_chamber_test_is_no_step(make_recording):
    cells = np.arange(8 * 120)
    temperature_c = np.repeat([20.0, 30, 40, 50, 35, 25, 15, 45], 120)
    rng = np.random.default_rng(0)
    wrench = 0.2 * temperature_c + NOISE * rng.standard_normal(len(cells))
    wrench[cells % 120 >= 90] = np.nan
    (chamber,) = [make_recording(temperature_c, {'force_z': wrench}, period_s=10.0)]
    assert segment([chamber], 'constant') == ([chamber], [])


@pytest.mark.parametrize(
    ('period_s', 'first', 'last'), [(1.0, 1700, 1701), (1.0, 1700, 1740), (60.0, 100, 101)]
)
def test_a_spike_or_a_touch_is_left_out_and_nothing_else(day, period_s, first, last):
    cells = CELLS if period_s == 1.0 else 300
    add = np.zeros(cells)
    add[first:last] = 15.0
    made = day(add=add, period_s=period_s, cells=cells)
    ((found,), (sentence,)) = segment([made], 'constant')
    assert np.flatnonzero(np.isnan(found.wrench[:, 2])).tolist() == list(range(first, last))
    assert np.isfinite(found.wrench[:, 3]).all()
    assert sentence.startswith('force_z of day0.csv stands out by up to 1')
    assert f' for {(last - first) * period_s:.0f} s in all, first at ' in sentence
    assert found.steps == ()


@pytest.mark.parametrize('period_s', [40.0, 240.0, 1500.0])
def test_a_robot_that_swings_is_said_to_move(day, period_s):
    swings = [8.0 * np.sin(2 * np.pi * (np.arange(CELLS) / period_s + 0.3 * n)) for n in (0, 1)]
    said = ' '.join(calibrate([day(n, swing) for n, swing in enumerate(swings)]).warnings)
    assert re.search(r'force_z \d\.?\d* N\. The load was declared unloaded: did the robot', said)


@pytest.mark.parametrize('tare', [0.0, -80.0])
def test_a_tare_does_not_hide_that_something_vibrates(day, tare):
    vibrates = np.random.default_rng(0).normal(0, 3.0, CELLS)
    _, (said, *_) = segment([day(add=vibrates + stepped((1800, tare)))], 'unloaded')
    assert said.startswith('day0.csv swings around its levels of 120 s, RMS: force_z by 3')


def test_a_recording_that_steps_all_the_time_is_refused(day):
    steps = [(cell, 5.0 * (-1) ** n) for n, cell in enumerate(range(200, 3500, 250))]
    with pytest.raises(CalibrationRefusedError, match=r'day0.csv steps 1\d times, from 0:03:2'):
        segment([day(add=stepped(*steps))], 'unloaded')


def test_a_loose_wire_of_one_axis_is_no_fault_of_the_others(day):
    made, rng = day(), np.random.default_rng(0)
    levels = np.repeat(rng.normal(0, 5, 15), 250)[:CELLS]
    made.wrench[:, 5] = np.where(CELL % 250 < 220, levels + rng.normal(0, 0.01, CELLS), np.nan)
    ((found,), sentences) = segment([made], 'unloaded')
    assert (found.steps, sentences) == ((), [])


def test_heat_rounding_and_dead_axes_are_no_steps(day):
    heat = 4.0 * (1 - np.exp(-np.maximum(np.arange(CELLS) - 1500, 0) / 60.0))
    coarse = day()
    coarse.wrench[:, 2] = np.round(coarse.wrench[:, 2])
    dead = day()
    dead.wrench[:, 4] = 3.0
    still = day()
    still.wrench[:, 4] = np.round(np.random.default_rng(0).normal(3.12, 0.03, CELLS), 1)
    large = day()
    large.wrench[:] *= 100.0
    for made in (day(add=heat), coarse, dead, still, large):
        ((found,), sentences) = segment([made], 'unloaded')
        assert (found.steps, sentences) == ((), [])


def test_a_load_that_is_known_is_left_alone(day):
    recording = day(add=stepped((1800, 12.0)))
    for reference in 'recorded', 'payload':
        assert segment([recording], reference) == ([recording], [])


def test_a_row_in_ten_minutes_is_no_fault(day):
    slow = day(period_s=600.0, cells=60, add=stepped((30, 50.0), cells=60))
    (still,), _ = segment([slow], 'unloaded')
    assert len(still) == 60
