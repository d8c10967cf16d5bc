"""What is fitted for an axis, which stretches are held out in turn, and how they are scored."""

import numpy as np
import pytest

from wrist_ft_comp.fit.axis_data import bin_cells
from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.folds import assign_folds, FOLDS, folds_within, simplest_good
from wrist_ft_comp.fit.result import rms_by_fold
from wrist_ft_comp.fit.settings import CalibrationSettings, IdentificationSettings

CELLS = 240
LOAD = 30 * np.random.default_rng(0).standard_normal(CELLS)
NOISE = np.random.default_rng(1).standard_normal(CELLS)


@pytest.mark.parametrize(('raw', 'load', 'reason'), [
    *(((1 + gain_error) * LOAD + 0.1 * NOISE, LOAD, '') for gain_error in (-0.5, 0.0, 4.0)),
    (LOAD / 30 + NOISE, LOAD / 30, 'less than 10 times the noise'),
    (NOISE, 0 * LOAD, 'varied by 0'),
    (LOAD, np.nan * LOAD, 'no reference wrench was recorded for this axis'),
])  # fmt: skip
def test_sensitivity_is_learnt_if_load_varies_more_than_noise(make_axis_data, raw, load, reason):
    data = make_axis_data([np.linspace(20, 40, CELLS)], [raw], [load])
    assert (data.load is None) == bool(reason)
    assert reason in data.no_sensitivity
    assert data.samples == np.isfinite(load).sum()


@pytest.mark.parametrize('cells', [1, 47, 240, 30000])
@pytest.mark.parametrize('period_s', [0.1, 10.0, 60.0])
def test_a_bin_lasts_ten_seconds_unless_a_fold_had_fewer_than_eight(cells, period_s):
    width = bin_cells(cells, period_s)
    assert 1 <= width <= max(1, 10.0 / period_s)
    assert width in {1, 100} or cells // (width + 1) < FOLDS * 8 <= cells // width


@pytest.mark.parametrize(
    ('squares', 'chosen'),
    [((9.0, 4.0, 1.0), 2), ((1.0, 0.86), 0), ((1.0, 0.84), 1), ((2.0, 1.0, 1.01), 1)],
)
def test_the_simplest_wins_within_15_percent_of_the_best(squares, chosen):
    assert simplest_good(squares) == chosen


def test_one_recording_is_cut_into_equal_times_or_at_plateaus(make_recording):
    (folds,) = assign_folds([make_recording(LOAD, {'force_x': LOAD})])
    assert (np.diff(folds) >= 0).all()
    assert len(np.unique(folds)) == FOLDS
    assert np.ptp(np.bincount(folds)) < 10  # they end at whole bins
    raw = np.where(np.arange(CELLS) % 60 < 20, 1.0, np.nan)
    stairs = np.repeat([20.0, 10.0, 30.0, 40.0], 60)
    (folds,) = assign_folds([make_recording(stairs, {'force_x': raw})])
    np.testing.assert_array_equal(folds[np.isfinite(raw)], np.repeat(range(4), 20))


@pytest.mark.parametrize('tau_cells', [24, 60, 1000])
def test_a_warm_up_is_cut_half_by_time_and_half_by_kelvin(make_recording, tau_cells):
    share = -np.expm1(-np.arange(720) / tau_cells)
    recording = make_recording(20 + 15 * share, {'force_y': 1.0})
    (folds,) = assign_folds([recording])
    ends = np.flatnonzero(np.diff(folds)) + 1
    passed = (ends / 720 + share[ends] / share[-1]) / 2
    np.testing.assert_allclose(passed, [1 / 3, 2 / 3], atol=0.05)
    recording.temperature_c[:] = 20.0
    (still,) = assign_folds([recording])
    np.testing.assert_array_equal(np.unique(still), [0, 1])


ROWS = 720


@pytest.fixture
def run(simulate):
    """Record a lag of 600 s with noise."""
    return lambda seed: simulate(seed, {600.0: 0.4}, noise=0.05, cells=ROWS)


def learn(recordings, method):
    settings = CalibrationSettings(identification=IdentificationSettings(method))
    return calibrate(recordings, settings).fits['force_z']


@pytest.mark.parametrize('method', ['pls', 'auto'])
@pytest.mark.parametrize('count', [1, 2])
def test_errors_stand_in_time_order_and_add_up_to_the_figures(method, count, run):
    recordings = [run(seed) for seed in range(count)]
    fit = learn(recordings, method)
    held_out = fit.held_out
    before, after = rms_by_fold(held_out)
    assert len(before) == (FOLDS if count == 1 else count)
    drift = [recording.wrench[:, 2] for recording in recordings]
    ends = np.flatnonzero(np.diff(held_out.fold)) + 1
    folds = drift if count > 1 else np.split(drift[0], ends)
    squares = [np.mean((fold - fold[:6].mean()) ** 2) for fold in folds]
    assert fit.rms_before == pytest.approx(np.mean(np.sqrt(squares)), rel=1e-9)
    whole = np.sqrt(np.mean((drift[0] - drift[0][:6].mean()) ** 2))
    factor = np.sqrt(whole / fit.rms_before) if count == 1 else 1.0
    stated = max(after.mean(), min(factor * after.mean(), fit.rms_before))
    assert fit.rms_after == pytest.approx(stated, rel=1e-9)
    rms = {candidate.name: candidate.rms for candidate in fit.candidates}
    assert rms['none'] == fit.rms_before
    assert method == 'auto' or rms[fit.chosen] == pytest.approx(fit.rms_after)
    assert set(held_out.recording.tolist()) == set(range(count))
    assert (np.diff(held_out.recording * ROWS + held_out.cell) > 0).all()
    assert held_out.cell.min() >= 0
    assert held_out.cell.max() < ROWS


@pytest.mark.parametrize('method', ['pls', 'auto'])
def test_a_fold_is_judged_by_a_model_that_never_saw_it(run, method):
    recording = run(3)
    last = np.arange(ROWS) >= ROWS - ROWS // FOLDS
    recording.wrench[:, 2] += np.where(last, 2.0 * np.sin(np.arange(ROWS) / 20), 0.0)
    held_out = learn([recording], method).held_out
    assert rms_by_fold(held_out).after[-1] > 1.0
    assert held_out.fold[-1] == FOLDS - 1


def test_plateaus_of_a_chamber_test_keep_the_constant_of_the_others(make_recording):
    """Between plateaus the drift is the difference of their means, so it has to stay in it."""
    temperature_c = np.repeat([10.0, 20.0, 30.0, 40.0], 60)
    wrench = np.where(np.arange(240) % 60 >= 50, temperature_c - 20, np.nan)
    held_out = learn([make_recording(temperature_c, {'force_z': wrench})], 'pls').held_out
    np.testing.assert_allclose(rms_by_fold(held_out).before, [20.0, 20 / 3, 20 / 3, 20.0])


@pytest.mark.parametrize(('warmer_k', 'apart'), [(20.0, True), (5.5, True), (2.0, False)])
def test_days_in_a_cold_and_in_a_hot_hall_are_held_out_in_stretches(
    make_recording, warmer_k, apart
):
    """Learnt from the other, each would be extrapolated, though both together know it."""
    days = []
    for seed, room_c in enumerate((10.0, 10.0 + warmer_k)):
        minutes = np.arange(720) / 6
        celsius = room_c + 10 * (1 - np.exp(-minutes / 30)) + np.sin(minutes / 7 + seed)
        drift = 0.3 * celsius + 0.02 * (celsius - 15) ** 2
        noise = np.random.default_rng(seed).normal(0, 0.02, len(drift))
        days.append(make_recording(celsius, {'force_z': drift + noise}, name=f'day{seed}'))
    assert (folds_within(days) is not None) == apart
    fit = calibrate(days).fits['force_z']
    assert not apart or fit.share_left < 0.1
