"""Thermometers that die or freeze: found by the others, replaced, believed again."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.settings import CalibrationSettings, IdentificationSettings
from wrist_ft_comp.stream import offline
from wrist_ft_comp.stream.compensator import Compensator
from wrist_ft_comp.stream.offline import simulate_drift, thermometer_doubts

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


def failing(day, fault, j=1, begin=BEGIN, end=CELLS):
    """Let a thermometer die or freeze for some cells; what it reads then is held."""
    temperature_c, measured = day.temperature_c.copy(), day.measured.copy()
    temperature_c[begin:end, j] = temperature_c[begin - 1, j]
    measured[begin:end, j] = fault == 'frozen'
    return replace(day, temperature_c=temperature_c, measured=measured)


def stream(compensator, day, begin=0, end=CELLS):
    """Send a day, cell by cell; drift of force z after each, of several at once after the last."""
    seen = {}
    for k in range(begin, end):
        for j in np.flatnonzero(day.measured[k]):
            stamp_ns = FIRST_NS + round((k + 0.3 + 0.1 * j) * PERIOD_S * 1e9)
            for cell in compensator.add_temperature(j, stamp_ns, day.temperature_c[k, j])[-1:]:
                seen[cell.number - day.first_cell] = compensator.tracker.drift.zero[FORCE_Z]
    return seen


def findings(compensator):
    return compensator.tracker.thermometers.sentences


def left(day, model):
    true = drift(temperatures(7))
    error = true - simulate_drift(model, day).zero[:, FORCE_Z]
    return np.sqrt(np.mean((error - error[:6].mean()) ** 2))


FAULTS = [(2, 'dead'), (2, 'frozen'), (3, 'dead'), (3, 'frozen')]


@pytest.mark.parametrize(('thermometers', 'fault'), FAULTS)
def test_one_that_fails_is_found_and_its_prediction_does_less_harm(
    learn, make_day, thermometers, fault
):
    model, day = learn(thermometers).model, failing(make_day(7, thermometers), fault)
    (found,) = list(thermometer_doubts(model, day))
    assert found.startswith('thermometer 2 ')
    assert left(day, model) < 0.5 * left(day, replace(model, prediction=None))


def test_healthy_thermometers_are_believed(learn, make_day, monkeypatch):
    """Also where they are judged in every cell."""
    monkeypatch.setattr(offline, '_stands_still', lambda *_: True)
    for thermometers in (2, 3):
        model = learn(thermometers).model
        for seed in range(10, 15):
            assert thermometer_doubts(model, make_day(seed, thermometers)) == {}


def test_one_that_is_coarse_and_misses_a_minute_at_rest_is_believed(learn, make_day):
    day = make_day(7)
    rest = replace(day, temperature_c=np.tile(day.temperature_c[:1], (CELLS, 1)))
    assert not thermometer_doubts(learn(3).model, failing(rest, 'dead', begin=500, end=512))


def test_one_thermometer_predicts_nothing(learn, make_day):
    calibration, day = learn(1), make_day(7, 1)
    assert calibration.model.prediction is None
    assert list(thermometer_doubts(calibration.model, failing(day, 'frozen', 0))) == []


@pytest.mark.parametrize('fault', ['dead', 'frozen'])
def test_one_that_agrees_again_for_half_an_hour_is_believed(learn, make_day, fault):
    model, healthy = learn(3).model, make_day(7)
    day = failing(healthy, fault, end=700)
    compensator = Compensator(3, model=model)
    seen = stream(compensator, day, end=870)
    assert len(findings(compensator)) == 1
    seen |= stream(compensator, day, 870)
    assert findings(compensator) == []
    ((_, share),) = thermometer_doubts(model, day).items()
    assert 480 / CELLS > share > 400 / CELLS
    usual = simulate_drift(model, healthy).zero[:, FORCE_Z]
    assert seen[CELLS - 2] == pytest.approx(usual[CELLS - 2], abs=0.1)


def test_one_that_is_replaced_stays_so_under_another_model(learn, make_day):
    model, day = learn(3).model, failing(make_day(7), 'frozen')
    compensator = Compensator(3, model=model)
    stream(compensator, day, end=800)
    believed_c = compensator.tracker.temperature_c
    compensator.go_live(replace(model, day_limits={}))
    assert compensator.tracker.replaced == [1]
    stream(compensator, day, 800, 810)
    assert compensator.tracker.temperature_c == pytest.approx(believed_c, abs=2.0)
