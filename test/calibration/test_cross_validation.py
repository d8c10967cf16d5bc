"""What is drawn is what is said: the errors on held-out blocks and the figures made of them."""

import numpy as np
import pytest

from wrist_ft_comp.calibration.calibrate import calibrate
from wrist_ft_comp.calibration.result import rms_by_fold
from wrist_ft_comp.calibration.settings import CalibrationSettings, IdentificationSettings, METHODS
from wrist_ft_comp.identification.axis_data import JUDGED_PARTS

CELLS = 720


def lagging(make_recording, warm_up, lagged, seed, *, loaded=False, **more):
    rng = np.random.default_rng(seed)
    temperature = warm_up(CELLS, seed)
    drift = 0.4 * (lagged(temperature, 600.0) - 20) + rng.normal(0, 0.05, CELLS)
    load = 10 * np.sin(np.arange(CELLS) / 7) if loaded else np.zeros(CELLS)
    reference = {'force_z': load} if loaded else None
    return make_recording(temperature, {'force_z': drift + load}, reference, **more)


@pytest.fixture(scope='module')
def run(make_recording, warm_up, lagged):
    def make(seed, **more):
        return lagging(make_recording, warm_up, lagged, seed, **more)

    return make


def learn(recordings, method='auto', reference='unloaded'):
    settings = CalibrationSettings(reference, identification=IdentificationSettings(method))
    return calibrate(recordings, settings).fits['force_z']


def total(held_out, errors):
    """Add up as a score does: mean squares of the parts of every block."""
    squares = []
    for recording in np.unique(held_out.recording):
        for block in np.unique(held_out.fold):
            own = errors[(held_out.recording == recording) & (held_out.fold == block)]
            if len(own):
                squares += [np.mean(part**2) for part in np.array_split(own, JUDGED_PARTS)]
    return np.sqrt(np.mean(squares))


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('count', [1, 2])
def test_the_errors_add_up_to_the_figures(method, count, run):
    fit = learn([run(seed) for seed in range(count)], method)
    held_out = fit.held_out
    assert len(rms_by_fold(held_out).before) == (5 if count == 1 else count)
    assert total(held_out, held_out.before) == pytest.approx(fit.rms_before, rel=1e-6)
    assert total(held_out, held_out.after) == pytest.approx(fit.rms_after, rel=1e-6)


def test_loaded_recordings_add_up_too(run):
    fit = learn([run(seed, loaded=True) for seed in range(2)], reference='recorded')
    held_out = fit.held_out
    assert len(fit.model.dynamics.output_mean) == 2
    assert total(held_out, held_out.before) == pytest.approx(fit.rms_before, rel=1e-6)
    assert total(held_out, held_out.after) == pytest.approx(fit.rms_after, rel=1e-6)


def test_a_long_recording_is_judged_beside_its_trend(make_recording):
    """Nine hours: creep is not counted against a candidate, neither here nor in its score."""
    hours = np.arange(540) / 60
    temperature = 30 + 8 * np.sin(hours * 2)
    noise = np.random.default_rng(2).normal(0, 0.01, 540)
    drift = 0.3 * (temperature - 30) + 0.2 * hours + noise
    fit = learn([make_recording(temperature, {'force_z': drift}, period_s=60.0)])
    held_out = fit.held_out
    assert held_out.detrended
    assert total(held_out, held_out.before) == pytest.approx(fit.rms_before, rel=1e-6)
    assert total(held_out, held_out.after) == pytest.approx(fit.rms_after, rel=1e-6)


def test_without_compensation_nothing_changes(make_recording, warm_up):
    noise = np.random.default_rng(5).normal(0, 1, CELLS)
    fit = learn([make_recording(warm_up(CELLS, 1), {'force_z': noise})])
    assert fit.model is None
    np.testing.assert_array_equal(fit.held_out.before, fit.held_out.after)


def test_bins_stand_in_time_order_within_their_recording(run):
    held_out = learn([run(0), run(1)]).held_out
    assert set(held_out.recording.tolist()) == {0, 1}
    assert (np.diff(held_out.recording) >= 0).all()
    for number in (0, 1):
        cells = held_out.cell[held_out.recording == number]
        assert (np.diff(cells) > 0).all()
        assert cells[0] >= 0
        assert cells[-1] < CELLS


def test_a_block_is_judged_by_a_model_that_never_saw_it(run):
    """What is added to the last block alone can't be explained by a fit to the others."""
    recording = run(3)
    last = np.arange(CELLS) >= CELLS * 4 // 5
    bump = np.where(last, 2.0 * np.sin(np.arange(CELLS) / 20), 0.0)
    recording.wrench[:, 2] += bump
    held_out = learn([recording], 'pls').held_out
    after = rms_by_fold(held_out).after
    assert after[-1] > 1.0
    assert held_out.fold[-1] == 4


def test_plateaus_of_a_chamber_test_keep_the_constant_of_the_others(make_recording):
    """Between plateaus the drift is the difference of their means, so it has to stay in it."""
    temperature = np.repeat([10.0, 20.0, 30.0, 40.0], 60)
    wrench = np.where(np.arange(240) % 60 >= 50, temperature - 20, np.nan)
    held_out = learn([make_recording(temperature, {'force_z': wrench})], 'pls').held_out
    before = rms_by_fold(held_out).before
    np.testing.assert_allclose(before, [20.0, 20 / 3, 20 / 3, 20.0])
