"""What is left of the drift in recordings."""

from dataclasses import replace

import numpy as np
import pytest

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.report.evaluation import AxisEvaluation, judge_errors, tared_errors, TaredErrors
from wrist_ft_comp.stream.tare import initial_tare

X, Z, TORQUE_Z = (AXES.index(axis) for axis in ('force_x', 'force_z', 'torque_z'))
CELLS = 60


@pytest.fixture(scope='module')
def model(make_model):
    return make_model({'force_z': (0.4, 1e-2, 50.0)}, period_s=10.0)


@pytest.fixture(scope='module')
def moved(lagged):
    """Temperature behind the model's lag, K."""
    return lagged(np.linspace(0, 15, CELLS), 50.0)


@pytest.fixture(scope='module')
def loaded(make_recording, moved):
    """A sensor as the model says, with an offset and an error of its own."""
    rng = np.random.default_rng(0)
    load = 30 * rng.standard_normal(CELLS)
    raw = (1 + 1e-2 * moved) * load + 0.4 * moved + 7 + 0.1 * rng.standard_normal(CELLS)
    raw[[0, 1, 30]] = np.nan
    temperature_c = 20 + np.linspace(0, 15, CELLS)
    return make_recording(temperature_c, {'force_z': raw}, {'force_z': load}, first_cell=1000)


def in_operation(moved):
    """Give means over cells where what a cell shows is subtracted in the next one, on a ramp."""
    return np.array([(moved[max(k - 2, 0)] + moved[max(k - 1, 0)]) / 2 for k in range(len(moved))])


@pytest.mark.parametrize(('tare_s', 'tare_cells'), [(60.0, 6), (65.0, 7), (0.1, 1)])
def test_errors_are_what_a_hand_computes(model, loaded, moved, tare_s, tare_cells):
    raw, true = loaded.wrench[:, Z], loaded.reference[:, Z]
    measured = [k for k in range(CELLS) if np.isfinite(raw[k])]
    tared = range(measured[0], measured[0] + tare_cells)
    judged = judge_errors([tared_errors(model, loaded, 'recorded', tare_s)])
    assert set(judged) == {'force_z'}
    moved = in_operation(moved)
    for name, o, s in (('before', 0 * moved, 0 * moved), ('after', 0.4 * moved, 1e-2 * moved)):
        tare = np.mean([raw[k] - o[k] - (1 + s[k]) * true[k] for k in tared])
        values = [(raw[k] - o[k] - tare) / (1 + s[k]) - true[k] for k in measured]
        rms = np.sqrt(sum(v * v for v in values) / len(values))
        assert getattr(judged['force_z'], f'rms_{name}') == pytest.approx(rms, rel=1e-9)
        peak = max(abs(v) for v in values)
        assert getattr(judged['force_z'], f'max_{name}') == pytest.approx(peak, rel=1e-9)
    assert judged['force_z'].rms_after < 0.1 * judged['force_z'].rms_before


def test_short_cells_are_judged_in_means_over_ten_seconds(make_model, make_recording):
    raw = np.random.default_rng(2).standard_normal(125)
    raw[[3, *range(20, 30)]] = np.nan
    model = make_model({'force_z': (0.0, 0.0, 50.0)}, period_s=1.0)
    recording = make_recording(np.full(125, 20.0), {'force_z': raw}, period_s=1.0)
    tared = raw - np.nanmean(raw[:60])
    means = [np.nanmean(tared[k : k + 10]) for k in range(0, 125, 10) if k != 20]
    judged = judge_errors([tared_errors(model, recording, 'unloaded')])['force_z']
    assert judged.rms_after == pytest.approx(np.sqrt(np.mean(np.square(means))), rel=1e-9)
    assert judged.max_after == pytest.approx(max(map(abs, means)), rel=1e-9)


def test_an_axis_without_model_stays_as_it_was(model, make_recording):
    raw = np.random.default_rng(1).standard_normal(CELLS)
    recording = make_recording(np.linspace(20, 30, CELLS), {'torque_y': raw})
    before, after, _ = tared_errors(model, recording, 'unloaded')
    np.testing.assert_array_equal(before, after)
    assert np.nanmax(np.abs(before)) > 0


def test_nothing_to_compare_with_is_refused(model, loaded):
    bare = replace(loaded, reference=np.full_like(loaded.reference, np.nan))
    with pytest.raises(RecordingError, match='no cell with both wrench and reference'):
        tared_errors(model, bare, 'recorded')


def errors(axis, before, after):
    """Errors of one axis; the others have none."""
    table = np.full((2, len(before), len(AXES)), np.nan)
    table[:, :, axis] = before, after
    return TaredErrors(*table)


def test_recordings_are_pooled_by_the_cells_that_were_compared_axis_by_axis():
    nan = float('nan')
    long = errors(X, [5.0, nan, 3.0, nan, nan, nan, nan], [1.0, nan, nan, nan, 9.0, nan, nan])
    short = errors(X, [1.0, -7.0], [-2.0, 2.0])
    other = errors(TORQUE_Z, [4.0, 4.0], [2.0, 2.0])
    assert judge_errors([long, short, other]) == {
        'force_x': AxisEvaluation(5.0, 3**0.5, 7.0, 2.0),
        'torque_z': AxisEvaluation(4.0, 2.0, 4.0, 2.0),
    }


def test_the_initial_tare_is_the_raw_mean_behind_the_drift(model, loaded, moved):
    expected = np.mean((loaded.wrench[:, Z] - 0.4 * in_operation(moved))[2:5])
    assert initial_tare(model, loaded, 30.0)[Z] == pytest.approx(expected)
    assert not initial_tare(model, loaded, 0.0).any()
