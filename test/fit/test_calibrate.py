"""Calibration as a whole: what it refuses, what it warns of, what it hands back."""

from copy import deepcopy
from dataclasses import replace
import re

import numpy as np
import pytest

from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.fit.axis_data import MIN_SAMPLES
from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.result import AxisFit, Calibration
from wrist_ft_comp.fit.settings import CalibrationSettings, IdentificationSettings

STATIC = CalibrationSettings(identification=IdentificationSettings(method='pls'))
CELLS = 240


@pytest.fixture(scope='module')
def good(make_recording, warm_up):
    """Two runs of two axes: force x drifts, torque z does not."""
    runs = []
    for i in range(2):
        rng = np.random.default_rng(i)
        temperature_c = warm_up(CELLS, i)
        drifting = 0.5 * temperature_c + 0.05 * rng.standard_normal(CELLS)
        axes = {'force_x': drifting, 'torque_z': 0.01 * rng.standard_normal(CELLS)}
        runs.append(make_recording(temperature_c, axes, name=f'run{i}.csv'))
    return runs


def test_a_calibration_prints_a_line_per_axis_and_its_warnings():
    fits = {'force_z': AxisFit(None, 'pls', (), 12.34, 0.0123, 0.0, None, unit='N', day_limit=0.5)}
    assert str(Calibration(None, fits, np.zeros((1, 2)), 5400.0, ('One.',))).splitlines() == [
        'Calibration of 1.50 h, RMS of held-out errors:',
        'force_z: 12.3 -> 0.0123 N (pls), limit 0.5 N',
        'warning: One.',
    ]


def test_a_calibration_holds_the_model_and_its_evidence(good):
    shares, before = [], deepcopy(good)
    calibration = calibrate(good, CalibrationSettings(), shares.append)
    assert shares == [0.5, 1.0]
    for run, old in zip(good, before, strict=True):
        np.testing.assert_array_equal(run.wrench, old.wrench)
    assert set(calibration.model.axes) == {'force_x'}
    assert calibration.fits['torque_z'].chosen == 'none'
    assert calibration.duration_s == 2 * CELLS * 10.0
    seen_c = np.concatenate([run.temperature_c for run in good])
    assert calibration.temperature_range_c.tolist() == [[seen_c.min(), seen_c.max()]]
    fit = calibration.fits['force_x']
    assert fit.rms_after < 0.1 * fit.rms_before
    assert calibration.model.start_s == 10.0
    # Temperatures at which no wrench came are not learnt.
    cut = deepcopy(good)
    for run in cut:
        run.wrench[CELLS // 3 :] = np.nan
    calibration = calibrate(cut)
    highest_c = max(run.temperature_c[: CELLS // 3].max() for run in cut)
    assert calibration.temperature_range_c[0, 1] == highest_c
    assert calibration.model.axes['force_x'].features.upper_c[0] <= highest_c


def changed(run, **change):
    """A record with other fields; a function makes one from the old."""
    return replace(run, **{k: f(getattr(run, k)) if callable(f) else f for k, f in change.items()})


@pytest.mark.parametrize(('whose', 'change', 'sentence'), [
    ('both', {'wrench': lambda wrench: np.nan * wrench}, 'run0.csv, run1.csv holds no wrench'),
    ('last', {'period_ns': 2 * 10**10},
     'run0.csv is on thermal cells of 10.0 s and run1.csv on 20.0'),
])  # fmt: skip
def test_recordings_from_which_nothing_can_be_learnt_are_refused(good, whose, change, sentence):
    first = changed(good[0], **change) if whose == 'both' else good[0]
    with pytest.raises(CalibrationRefusedError, match=sentence):
        calibrate([first, changed(good[1], **change)], STATIC)


def test_a_smaller_span_may_be_chosen_and_of_none_nothing_is_learnt(good):
    calm = [changed(run, temperature_c=lambda t: 25 + 0.05 * (t - 30)) for run in good]
    calibrate(calm, replace(STATIC, min_temperature_span_k=0.5))
    with pytest.raises(CalibrationRefusedError, match='K at most within a recording, whose zero'):
        calibrate([calm[0], changed(calm[1], temperature_c=lambda t: t + 20)], STATIC)
    with pytest.raises(CalibrationRefusedError, match='at least one recording; got none'):
        calibrate([], STATIC)


@pytest.mark.parametrize('method', ['auto', 'pls'])
def test_an_axis_that_is_sound_in_one_recording_is_learnt_from_that_one(good, method):
    runs = deepcopy(good)
    runs[0].wrench[140:, 0] = runs[0].wrench[140, 0]  # it freezes
    settings = CalibrationSettings(identification=IdentificationSettings(method=method))
    calibration = calibrate(runs, settings)
    alone = calibrate([good[1]], settings).fits['force_x']
    fit = calibration.fits['force_x']
    assert fit.rms_before == pytest.approx(alone.rms_before)
    assert fit.rms_after == pytest.approx(alone.rms_after, rel=0.2)
    assert fit.rms_after < 0.2 * fit.rms_before
    assert set(fit.held_out.recording.tolist()) == {1}
    assert 'force_x is in one of 2 recordings only, and' in ' '.join(calibration.warnings)
    assert calibration.fits['torque_z'].chosen == calibrate(good, settings).fits['torque_z'].chosen
    runs[0].wrench[:, 5] = np.nan  # nothing is left of that recording
    assert calibrate(runs, settings).fits['force_x'].rms_after == fit.rms_after


def test_too_few_samples_are_refused_and_an_axis_without_any_is_not_there(good):
    runs = deepcopy(good)
    assert 'torque_x' not in calibrate(runs, STATIC).fits
    runs[0].wrench[: MIN_SAMPLES // 2, 3] = 0.01 * np.arange(MIN_SAMPLES // 2)
    runs[1].wrench[: MIN_SAMPLES // 2 - 1, 3] = 0.02 * np.arange(MIN_SAMPLES // 2 - 1) ** 1.5
    sentence = f'torque_x has {MIN_SAMPLES - 1} thermal cells .* at least {MIN_SAMPLES} in 2 bl'
    left = calibrate(runs, STATIC)
    assert set(left.fits) == {'force_x', 'torque_z'}, 'the other axes do not pay for it'
    assert any(re.match(sentence, warning) for warning in left.warnings)
    for run in runs:
        run.wrench[:, [0, 5]] = np.nan
    with pytest.raises(CalibrationRefusedError, match=sentence):
        calibrate(runs, STATIC)


def test_days_on_which_a_robot_repeats_its_program_are_no_single_day(good):
    swing = 8 * np.sin(np.arange(CELLS) / 2)
    runs = deepcopy(good)
    for run in runs:
        run.wrench[:, 0] = swing + 0.03 * run.temperature_c[:, 0]
        run.reference[:, 0], run.wrench[:, 5] = swing, np.nan
    assert calibrate(runs, replace(STATIC, reference='recorded')).fits['force_x'].rms_after < 0.1
    columns = {name: lambda v: v[15:] for name in ('temperature_c', 'measured', 'wrench')}
    part = changed(runs[0], **columns, reference=lambda v: v[15:])
    moved = runs[0].first_cell + 15
    for again in (runs[0], replace(part, first_cell=moved), replace(part, first_cell=moved - 15)):
        with pytest.raises(CalibrationRefusedError, match=r'again.csv holds readings of run0.csv'):
            calibrate(
                [*runs, replace(again, name='again.csv')], replace(STATIC, reference='recorded')
            )


@pytest.mark.parametrize(('minutes', 'cools', 'is_promise'), [
    (20, True, False), (45, True, False), (75, True, True), (75, False, False), (150, False, True),
])  # fmt: skip
def test_short_recordings_promise_nothing_nor_do_short_warm_ups(
    make_recording, minutes, cools, is_promise
):
    runs, time_s = [], 10.0 * np.arange(6 * minutes)
    for i in range(2):
        temperature_c = 20 + i + 15 * (1 - np.exp(-time_s / 900))
        temperature_c -= cools * 12 * np.clip(time_s / time_s[-1] - 0.6, 0, None)
        force = 0.5 * temperature_c + np.random.default_rng(i).normal(0, 0.05, len(time_s))
        runs.append(make_recording(temperature_c, {'force_z': force}, name=f'{i}.csv'))
    assert np.isfinite(calibrate(runs).fits['force_z'].day_limit) == is_promise


def test_a_recording_of_less_than_a_minute_does_no_harm_beside_longer_ones(good):
    runs = [changed(run, temperature_c=lambda t: np.hstack((t, t[:, :1] ** 0.5)),
                    measured=lambda m: np.tile(m, 2)) for run in good]  # fmt: skip
    parts = ('temperature_c', 'measured', 'wrench', 'reference')
    short = changed(runs[0], name='short.csv', **dict.fromkeys(parts, lambda values: values[:5]))
    prediction = calibrate([*runs, short], STATIC).model.prediction
    for name, values in vars(calibrate(runs, STATIC).model.prediction).items():
        if name != 'agree_k':  # three recordings show more of what is usual than two
            np.testing.assert_allclose(getattr(prediction, name), values)
