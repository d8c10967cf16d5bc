"""Thermometers that lie: found by the others, replaced without a step, believed again."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.settings import CalibrationSettings, IdentificationSettings
from wrist_ft_comp.stored.model_file import load_model, save_model
from wrist_ft_comp.stored.state_file import load_state, save_state, SavedState
from wrist_ft_comp.stream.agreement import Agreement
from wrist_ft_comp.stream.compensator import Compensator, StreamSettings
from wrist_ft_comp.stream.offline import lies, simulate_drift, thermometer_doubts

PERIOD_S, CELLS, BEGIN = 10.0, 1080, 400
FORCE_Z = 2
METHOD = IdentificationSettings('filtered_pls')
FIRST_NS = 1_700_000_000_000_000_000


def lagged(values, tau_s):
    pole = np.exp(-PERIOD_S / tau_s)
    return lfilter([1 - pole], [1, -pole], values, zi=[pole * values[0]])[0]


def temperatures(seed):
    """A motor, a flange behind it and a sensor between both, °C, (N, 3)."""
    rng = np.random.default_rng(seed)
    heat = 22.0 + 25.0 * np.repeat(rng.random(CELLS // 90), 90)
    motor = lagged(heat, 300.0)
    flange = lagged(motor, 900.0)
    middle = 0.5 * lagged(motor, 200.0) + 0.5 * flange
    return np.stack((motor, flange, middle), axis=1) + rng.normal(0, 0.02, (CELLS, 3))


def drift(temperature_c):
    """Zero drift of force z, N: mostly of the flange's temperature."""
    return 0.8 * (temperature_c[:, 1] - 22.0) + 0.3 * (lagged(temperature_c[:, 0], 200.0) - 22.0)


@pytest.fixture(scope='module')
def make_day(make_recording):
    def make(seed, thermometers=3):
        values = temperatures(seed)
        noise = np.random.default_rng(seed + 99).normal(0, 0.05, CELLS)
        wrench = {'force_z': drift(values) + noise}
        return make_recording(values[:, :thermometers], wrench, first_cell=FIRST_NS // 10**10)

    return make


@pytest.fixture(scope='module')
def learn(make_day):
    found = {}

    def calibration(thermometers):
        if thermometers not in found:
            days = [make_day(seed, thermometers) for seed in (1, 2, 3)]
            found[thermometers] = calibrate(days, CalibrationSettings(identification=METHOD))
        return found[thermometers]

    return calibration


def off(day, error_k, j=1):
    """Let a thermometer be off by an error of cells, K."""
    temperature_c = day.temperature_c.copy()
    temperature_c[:, j] += error_k
    return replace(day, temperature_c=temperature_c)


def lying(day, fault, j=1, begin=BEGIN, end=CELLS):
    temperature_c, measured = day.temperature_c.copy(), day.measured.copy()
    lie = slice(begin, end)
    if fault == 'loose':
        temperature_c[lie, j] -= 4.0
    else:
        temperature_c[lie, j] = temperature_c[begin - 1, j]
        measured[lie, j] = fault == 'frozen'
    return replace(day, temperature_c=temperature_c, measured=measured)


def stream(compensator, day, begin=0, end=CELLS):
    """Send a day, cell by cell; drift of force z after every completed cell."""
    seen = {}
    for k in range(begin, end):
        for j in np.flatnonzero(day.measured[k]):
            stamp_ns = FIRST_NS + round((k + 0.3 + 0.1 * j) * PERIOD_S * 1e9)
            for cells in compensator.add_temperature(j, stamp_ns, day.temperature_c[k, j]):
                last = cells.first_cell + cells.count - 1 - day.first_cell
                seen[last] = compensator.tracker.drift.zero[FORCE_Z]
    return seen


def left(day, model):
    true = drift(temperatures(7))
    error = true - simulate_drift(model, day).zero[:, FORCE_Z]
    return np.sqrt(np.mean((error - error[:6].mean()) ** 2))


FAULTS = [(2, 'dead'), (2, 'frozen'), (3, 'dead'), (3, 'frozen')]


@pytest.mark.parametrize(('thermometers', 'fault'), FAULTS)
def test_a_lie_is_found_and_replaced_without_a_step(learn, make_day, thermometers, fault):
    model, healthy = learn(thermometers).model, make_day(7, thermometers)
    day = lying(healthy, fault)
    (found,) = lies(model, day)
    assert found.startswith('thermometer 2 ')
    assert left(day, model) < 0.5 * left(day, replace(model, prediction=None))
    zero, usual = (simulate_drift(model, run).zero[:, FORCE_Z] for run in (day, healthy))
    assert np.abs(np.diff(zero[BEGIN + 2 :])).max() < 2 * np.abs(np.diff(usual)).max()


@pytest.mark.parametrize(('thermometers', 'fault'), FAULTS[1:3])
def test_the_stream_does_what_the_file_does(learn, make_day, thermometers, fault):
    model, day = learn(thermometers).model, lying(make_day(7, thermometers), fault)
    compensator = Compensator(thermometers, StreamSettings(temperature_timeout_s=60.0), model)
    seen = stream(compensator, day)
    simulated = simulate_drift(model, day).zero[:, FORCE_Z]
    assert compensator.tracker.agreement.findings == lies(model, day)
    cells = sorted(seen)
    assert len(cells) > CELLS - 10
    np.testing.assert_allclose([seen[k] for k in cells], simulated[cells], atol=1e-9)


@pytest.mark.parametrize('fault', ['dead', 'frozen'])
def test_a_lie_is_found_where_the_others_move_by_1_k(learn, make_day, fault):
    day = make_day(7)
    noise_k = np.random.default_rng(0).normal(0, 0.02, (CELLS, 3))
    warmer_k = np.clip((np.arange(CELLS) - BEGIN) / 60, 0.0, 1.0)[:, np.newaxis]
    quiet = replace(day, temperature_c=day.temperature_c[0] + warmer_k + noise_k)
    (found,) = lies(learn(3).model, lying(quiet, fault))
    assert found.startswith('thermometer 2 ')


def test_healthy_thermometers_are_believed(learn, make_day):
    for thermometers in (2, 3):
        model = learn(thermometers).model
        for seed in range(10, 20):
            assert thermometer_doubts(model, make_day(seed, thermometers)) == {}


def test_one_that_is_coarse_and_misses_a_minute_at_rest_is_believed(learn, make_day):
    day = make_day(7)
    rest = replace(day, temperature_c=np.tile(day.temperature_c[:1], (CELLS, 1)))
    assert lies(learn(3).model, lying(rest, 'dead', begin=500, end=512)) == []


def test_a_day_that_begins_before_the_body_has_soaked_is_not_doubted(learn, make_day):
    settling = 2.5 * np.exp(-np.arange(CELLS) * PERIOD_S / 150.0)
    assert thermometer_doubts(learn(3).model, off(make_day(10), settling)) == {}


def test_one_that_comes_loose_shows_by_the_jump_where_errors_wander(make_day):
    """On days of 3 h with an error of 0.8 K that no other thermometer explains."""
    phases = 2 * np.pi * np.arange(CELLS) / CELLS
    days = [off(make_day(seed), 0.8 * np.sin(phases + seed)) for seed in (1, 2, 3, 7)]
    model = calibrate(days[:3], CalibrationSettings(identification=METHOD)).model
    assert thermometer_doubts(model, days[3]) == {}
    ((words, share),) = thermometer_doubts(model, off(days[3], 2.0 * (phases > np.pi))).items()
    assert '2 contradict' in words
    assert 0.45 < share < 0.5


def test_one_thermometer_predicts_nothing(learn, make_day):
    calibration, day = learn(1), make_day(7, 1)
    assert calibration.model.prediction is None
    assert lies(calibration.model, lying(day, 'frozen', 0)) == []


@pytest.mark.parametrize('thermometers', [2, 3])
def test_thermometers_that_contradict_are_not_replaced(learn, make_day, thermometers):
    day = lying(make_day(7, thermometers), 'loose')
    compensator = Compensator(thermometers, model=learn(thermometers).model)
    stream(compensator, day)
    assert compensator.tracker.agreement.findings == []
    assert 'thermometers 1, 2 contradict' in compensator.tracker.agreement.doubt


def test_a_thermometer_that_agrees_again_is_believed_again_without_a_step(learn, make_day):
    model, healthy = learn(3).model, make_day(7)
    day = lying(healthy, 'frozen', end=700)
    compensator = Compensator(3, model=model)
    seen = stream(compensator, day)
    assert compensator.tracker.agreement.findings == []
    assert len(lies(model, day)) == 1
    zero, usual = (simulate_drift(model, run).zero[:, FORCE_Z] for run in (day, healthy))
    assert np.abs(np.diff(zero[BEGIN + 2 :])).max() < 2 * np.abs(np.diff(usual)).max()
    assert seen[CELLS - 2] == pytest.approx(usual[CELLS - 2], abs=0.1)


@pytest.mark.parametrize('fault', ['dead', 'frozen'])
def test_a_restart_goes_on_without_the_liar(learn, make_day, tmp_path, fault):
    model, day, path = learn(3).model, lying(make_day(7), fault), tmp_path / 'state.json'
    whole, before, after = (Compensator(3, model=model) for _ in range(3))
    stream(before, day, end=800)
    tare = np.zeros(6)
    save_state(path, SavedState(0, 'f' * 64, tare, before.memory()))
    after.resume(load_state(path).thermal, 0.0)
    seen, unbroken = stream(after, day, 801), stream(whole, day)
    assert after.tracker.agreement.replaced == before.tracker.agreement.replaced != {}
    worst = max(abs(seen[k] - unbroken[k]) for k in seen if k > 802)
    assert worst < 0.02 * np.ptp(list(unbroken.values()))


def test_a_frozen_thermometer_is_found_between_restarts(learn, make_day, tmp_path):
    """None of the streams lives for the three minutes for which it has to stand still."""
    model, day, path = learn(3).model, lying(make_day(7), 'frozen'), tmp_path / 'state.json'
    stream(compensator := Compensator(3, model=model), day, end=BEGIN)
    for begin in range(BEGIN, 600, 14):
        save_state(path, SavedState(0, 'f' * 64, np.zeros(6), compensator.memory()))
        compensator = Compensator(3, model=model)
        compensator.resume(load_state(path).thermal, 0.0)
        stream(compensator, day, begin + 1, begin + 14)
    assert set(compensator.tracker.agreement.replaced) == {1}


def test_after_a_restart_another_lie_is_found(learn, make_day):
    model, day = learn(3).model, lying(lying(make_day(7), 'dead'), 'dead', j=2, begin=850)
    before, after = (Compensator(3, model=model) for _ in range(2))
    stream(before, day, end=800)
    after.resume(before.memory(), 0.0)
    stream(after, day, 801)
    assert set(after.tracker.agreement.replaced) == {1, 2}


def test_a_clock_that_leaps_by_years_takes_no_time(learn, make_day, monkeypatch):
    """Silent bins of a minute would be half an hour of work."""
    day, compensator = make_day(7), Compensator(3, model=learn(3).model)
    stream(compensator, day, end=60)
    bins, close = [], Agreement._close
    monkeypatch.setattr(Agreement, '_close', lambda self: bins.append(1) or close(self))
    leapt = replace(day, first_cell=day.first_cell + 10**8)
    for k in (61, 62, 63):
        for j in range(3):
            stamp_ns = FIRST_NS + round((10**8 + k + 0.1 * j) * PERIOD_S * 1e9)
            compensator.add_temperature(j, stamp_ns, leapt.temperature_c[k, j])
    assert 1 < len(bins) < 10_000
    assert np.isfinite(compensator.tracker.drift.zero[FORCE_Z])


def test_a_model_file_keeps_predictions(learn, tmp_path):
    calibration, path = learn(3), tmp_path / 'm.yaml'
    stored = save_model(path, calibration)
    for name, part in vars(calibration.model.prediction).items():
        np.testing.assert_array_equal(getattr(stored.model.prediction, name), part)
    text = path.read_text('utf-8')
    path.write_text(text.replace('prediction:', 'unknown:'), 'utf-8')
    assert load_model(path).model.prediction is None
