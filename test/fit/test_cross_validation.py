"""How candidates are scored, against refitting by hand, and that what is drawn is what is said."""

from dataclasses import replace

import numpy as np
import pytest

from wrist_ft_comp.drift.arx import relaxation
from wrist_ft_comp.drift.arx_pls import ArxPls
from wrist_ft_comp.drift.axis_model import AxisModel
from wrist_ft_comp.drift.features import Features
from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.folds import fold_bins, FOLDS, part_errors, unexplained
from wrist_ft_comp.fit.result import rms_by_fold
from wrist_ft_comp.fit.settings import CalibrationSettings, IdentificationSettings, METHODS

CELLS = 720
LOAD = 30 * np.random.default_rng(0).standard_normal(CELLS)
TEMPERATURE_C = np.linspace(20, 40, CELLS)


def test_the_remainder_is_the_measurement_minus_the_free_run(make_axis_data, lagged):
    features = Features('powers', np.array([20.0]), np.zeros(1), np.full(1, 99.0))
    noise = np.random.default_rng(4).standard_normal(CELLS)
    moved = lagged(TEMPERATURE_C - 20, 300.0)
    sensitivity = 0.01 + 2e-3 * moved
    raw = (1 + sensitivity) * LOAD + 0.5 * moved + noise
    data = make_axis_data([TEMPERATURE_C], [raw], [LOAD])
    np.testing.assert_array_equal(unexplained(data, None)[0], data.residual[0])
    for outputs, remainder in ((2, noise), (1, noise + sensitivity * LOAD)):
        loadings, mean = np.array([[0.5], [2e-3]]), np.array([0.0, 0.01])
        dynamics = ArxPls(
            np.zeros(1), np.ones(1), np.ones((1, 1)), (relaxation(300.0, 10.0),),
            loadings[:outputs], np.ones(outputs), mean[:outputs],
        )  # fmt: skip
        model = AxisModel(features, dynamics)
        np.testing.assert_allclose(unexplained(data, model)[0], remainder, atol=1e-9)


@pytest.mark.parametrize('tared', [True, False])
def test_a_fold_is_scored_in_parts_around_a_constant_per_recording(make_axis_data, tared):
    """Of means over 30 s, from the first minute on; plateaus around the mean of all else."""
    rng = np.random.default_rng(5)
    folds = [rng.integers(0, 3, CELLS) for _ in range(2)]
    data = make_axis_data([TEMPERATURE_C] * 2, [TEMPERATURE_C] * 2, folds=folds)
    data = replace(data, tared=tared)
    remainders = [rng.standard_normal(CELLS) + 100 * i for i in range(2)]
    remainders[0][::7] = np.nan
    for fold in range(3):
        expected = []
        for numbers, values in zip(folds, remainders, strict=True):
            bins, others = {}, []
            for cell, (n, v) in enumerate(zip(numbers, values, strict=True)):
                if n == fold and np.isfinite(v):
                    bins.setdefault(cell // 3, []).append(v)
                elif np.isfinite(v):
                    others.append(v)
            inside = [sum(values) / len(values) for values in bins.values()]
            constant = np.mean(inside[:2] if tared else others)
            parts = np.array_split(inside, 4)
            expected += [np.mean([(v - constant) ** 2 for v in part]) for part in parts]
        assert part_errors(fold_bins(data, remainders, fold)) == pytest.approx(expected)


@pytest.fixture(scope='module')
def run(make_recording, warm_up, lagged):
    """Record a lag of 600 s with noise."""

    def make(seed):
        temperature_c = warm_up(CELLS, seed)
        noise = np.random.default_rng(seed).normal(0, 0.05, CELLS)
        drift = 0.4 * (lagged(temperature_c, 600.0) - 20) + noise
        return make_recording(temperature_c, {'force_z': drift})

    return make


def learn(recordings, method):
    settings = CalibrationSettings(identification=IdentificationSettings(method))
    return calibrate(recordings, settings).fits['force_z']


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('count', [1, 2])
def test_errors_stand_in_time_order_and_add_up_to_the_figures(method, count, run):
    """By every method alike: the same folds, means of a cell of 10 s, and the same widening."""
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
    assert fit.rms_after in {*rms.values()} or method == 'auto'
    assert set(held_out.recording.tolist()) == set(range(count))
    assert (np.diff(held_out.recording * CELLS + held_out.cell) > 0).all()
    assert held_out.cell.min() >= 0
    assert held_out.cell.max() < CELLS


def test_a_fold_is_judged_by_a_model_that_never_saw_it(run):
    """What is added to the last fold alone can't be explained by a fit to the others."""
    recording = run(3)
    last = np.arange(CELLS) >= CELLS - CELLS // FOLDS
    recording.wrench[:, 2] += np.where(last, 2.0 * np.sin(np.arange(CELLS) / 20), 0.0)
    held_out = learn([recording], 'pls').held_out
    assert rms_by_fold(held_out).after[-1] > 1.0
    assert held_out.fold[-1] == FOLDS - 1


def test_plateaus_of_a_chamber_test_keep_the_constant_of_the_others(make_recording):
    """Between plateaus the drift is the difference of their means, so it has to stay in it."""
    temperature_c = np.repeat([10.0, 20.0, 30.0, 40.0], 60)
    wrench = np.where(np.arange(240) % 60 >= 50, temperature_c - 20, np.nan)
    held_out = learn([make_recording(temperature_c, {'force_z': wrench})], 'pls').held_out
    np.testing.assert_allclose(rms_by_fold(held_out).before, [20.0, 20 / 3, 20 / 3, 20.0])
