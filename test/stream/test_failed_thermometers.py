"""Thermometers that are dead or frozen, and replaced by what the others predict of them."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import lfilter

from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.settings import CalibrationSettings, IdentificationSettings
from wrist_ft_comp.fit.thermometer_prediction import exchanged_days
from wrist_ft_comp.stream import drift_of_recordings, failed_thermometers
from wrist_ft_comp.stream.compensator import Compensator, StreamSettings
from wrist_ft_comp.stream.drift_of_recordings import simulate_drift, thermometer_doubts
from wrist_ft_comp.stream.drift_warnings import frozen_doubts, gap_doubts

SECOND = 1_000_000_000
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
    @cache
    def calibration(thermometers):
        days = [make_day(seed, thermometers) for seed in (1, 2, 3)]
        return calibrate(days, CalibrationSettings(identification=METHOD))

    return calibration


def failing(day, fault, j=1, begin=BEGIN, end=CELLS):
    """Let a thermometer die or freeze for some cells; what it reads then is held."""
    temperature_c, measured = day.temperature_c.copy(), day.measured.copy()
    temperature_c[begin:end, j] = temperature_c[begin - 1, j]
    if fault == 'frozen':  # means of equal readings differ in the last bit
        temperature_c[begin:end:3, j] = np.nextafter(temperature_c[begin - 1, j], 0)
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


@pytest.mark.parametrize('thermometers', [2, 3])
@pytest.mark.parametrize('fault', ['dead', 'frozen'])
def test_a_failed_one_is_found_and_predicting_it_harms_less(learn, make_day, thermometers, fault):
    model, day = learn(thermometers).model, failing(make_day(7, thermometers), fault)
    (found,) = list(thermometer_doubts(model, day))
    assert found.startswith('thermometer 2 ')
    assert left(day, model) < 0.5 * left(day, replace(model, prediction=None))


@pytest.mark.parametrize('fault', ['dead', 'frozen'])
def test_two_that_failed_move_along_with_the_one_that_reports(learn, make_day, fault):
    begins, model, day = {1: BEGIN, 2: BEGIN + 7}, learn(3).model, make_day(7)
    for j, begin in begins.items():
        day = failing(day, fault, j, begin)
    *_, last = drift_of_recordings.judge(model, day.temperature_c, day.measured)
    assert last.replaced.tolist() == [False, True, True]
    for j, begin in begins.items():
        moved_k = day.temperature_c[-1, 0] - day.temperature_c[begin - 1, 0]
        assert last.believed_c[j] == pytest.approx(day.temperature_c[-1, j] + moved_k)


def test_healthy_thermometers_are_believed(learn, make_day, monkeypatch):
    monkeypatch.setattr(failed_thermometers, 'stands_s', lambda *_: np.array([np.inf]))
    for thermometers in (2, 3):
        model = learn(thermometers).model
        for seed in range(10, 15):
            assert thermometer_doubts(model, make_day(seed, thermometers)) == {}


@pytest.mark.parametrize(('stood_s', 'is_replaced'), [(30.0, True), (1200.0, False), (9e4, False)])
def test_one_that_stands_as_long_as_in_its_calibration_is_believed(
    learn, make_day, stood_s, is_replaced
):
    model = replace(learn(3).model, stands_s=(30.0, stood_s, 30.0))
    day = failing(make_day(6), 'frozen', begin=300, end=385)
    assert bool(thermometer_doubts(model, day)) == is_replaced


def test_healthy_thermometers_are_not_doubted(learn, make_day):
    compensator, day = Compensator(3, model=learn(3).model), make_day(10)
    for k in range(0, CELLS, 3):
        stream(compensator, day, k, k + 3)
        assert frozen_doubts(compensator.tracker) == []


def test_one_that_is_coarse_and_misses_a_minute_at_rest_is_believed(learn, make_day):
    day = make_day(7)
    rest = replace(day, temperature_c=np.tile(day.temperature_c[:1], (CELLS, 1)))
    assert not thermometer_doubts(learn(3).model, failing(rest, 'dead', begin=500, end=512))


@pytest.mark.parametrize('fault', ['dead', 'frozen'])
def test_one_that_agrees_again_for_half_an_hour_is_believed(learn, make_day, fault):
    model, healthy = learn(3).model, make_day(7)
    day = failing(healthy, fault, end=700)
    compensator = Compensator(3, model=model)
    seen = stream(compensator, day, end=870)
    assert len(findings(compensator)) == 1
    seen |= stream(compensator, day, 870)
    assert findings(compensator) == []
    tracker = compensator.tracker
    assert tracker.uncertainty.left(tracker.end_ns, 9000.0)[FORCE_Z] > 0.05, 'what was predicted'
    ((_, share),) = thermometer_doubts(model, day).items()
    assert 480 / CELLS > share > 400 / CELLS
    usual = simulate_drift(model, healthy).zero[:, FORCE_Z]
    assert seen[CELLS - 2] == pytest.approx(usual[CELLS - 2], abs=0.1)


@pytest.mark.parametrize(('fault', 'tau_s'), [('dead', 1.0), ('dead', 900.0), ('frozen', 900.0)])
def test_what_one_missed_while_it_failed_is_doubted_until_the_model_has_forgotten_it(
    learn, make_day, make_model, fault, tau_s
):
    begin, back, is_remembered = 451, 466, tau_s > 1.0  # the motor warms fast from the first on
    prediction, axes = learn(3).model.prediction, {'force_z': (2.0, 0.0, tau_s)}
    lag = make_model(
        axes, period_s=PERIOD_S, thermometers=3, range_c=(20.0, 50.0), prediction=prediction
    )
    model = replace(lag, deviation={'force_z': 0.1})
    compensator, day = Compensator(3, model=model), failing(make_day(7), fault, 0, begin, back)
    stream(compensator, day, end=back - 3)
    assert gap_doubts(compensator.tracker) == []
    seen = stream(compensator, day, back - 3, back + 4)
    knows = simulate_drift(model, make_day(7)).zero[:, FORCE_Z]
    off_n = max(abs(seen[k] - knows[k]) for k in seen if k > back)
    assert (off_n > 0.3) == is_remembered
    assert not compensator.tracker.replaced
    assert bool(gap_doubts(compensator.tracker)) == is_remembered


def test_what_one_read_before_it_was_replaced_is_remembered_at_a_tare(learn, make_day):
    model, day = learn(3).model, failing(make_day(7), 'dead', begin=BEGIN + 30)
    day.temperature_c[BEGIN : BEGIN + 30, 1] += 30.0
    compensator = Compensator(3, model=model)
    for k in range(BEGIN - 90, CELLS):
        stream(compensator, day, k, k + 1)
        if compensator.tracker.replaced:
            break
    spikes = compensator.tracker.spikes[1]
    assert (spikes.jump.by_k, spikes.jump.off_k) == (0.0, pytest.approx(30.0, abs=1.0))
    compensator.set_tare(np.zeros(6), compensator.tracker.end_ns)
    assert any('remembers that thermometer 2 jumped' in why for why in compensator.zero_doubts)


@pytest.mark.parametrize(
    ('fault', 'timeout_s', 'most_s'), [('frozen', 5.0, 60), ('dead', 3600.0, 150)]
)
def test_one_that_freezes_or_dies_is_doubted_soon(learn, make_day, fault, timeout_s, most_s):
    """A timeout of an hour is for those that report seldom."""
    begin = BEGIN - 38  # temperatures move fast from here on
    model, day = learn(3).model, failing(make_day(7), fault, begin=begin)
    chosen = StreamSettings(temperature_timeout_s=timeout_s)
    compensator, said, off_cells = Compensator(3, chosen, model=model), [], 0
    knows = simulate_drift(model, make_day(7)).zero[:, FORCE_Z]
    stream(compensator, day, end=begin)
    assert frozen_doubts(compensator.tracker) == []
    for k in range(begin, begin + 60):
        stream(compensator, day, k, k + 1)
        said += frozen_doubts(compensator.tracker)
        off_n = abs(compensator.tracker.drift.zero[FORCE_Z] - knows[k - 1])
        compensator.set_tare(np.zeros(6), compensator.tracker.end_ns)
        is_said = ['thermal state was uncertain' in why for why in compensator.zero_doubts]
        assert any(is_said) == bool(frozen_doubts(compensator.tracker)), 'the tare holds it, too'
        off_cells += off_n > 4 * model.deviation['force_z'] and not (said or findings(compensator))
    assert off_cells * PERIOD_S <= most_s
    assert said
    assert all('thermometer 2 has read the same for' in doubt for doubt in said)
    assert findings(compensator), 'and it is replaced'


def test_two_that_are_exchanged_are_named_until_that_is_mended(learn, make_day):
    """Where they are near each other, either order is as likely."""
    model, healthy = learn(3).model, make_day(7)
    temperature_c = healthy.temperature_c.copy()
    temperature_c[BEGIN:] = temperature_c[BEGIN:, [0, 2, 1]]
    for day, named in ((healthy, 0), (replace(healthy, temperature_c=temperature_c), 11)):
        compensator, said, since = Compensator(3, model=model), [], CELLS
        for k in range(0, CELLS, 10):
            stream(compensator, day, k, k + 10)
            said += compensator.tracker.thermometer_doubts
            since = min(since, k) if said else CELLS
        assert len(said) == (CELLS - since) / 10 >= named
        assert all('thermometers 2 and 3 read what is expected of each' in doubt for doubt in said)
        of_file = drift_of_recordings.exchange_doubts(model, day)
        assert list(of_file) == said[:1]
        assert sum(of_file.values()) == pytest.approx(10 * len(said) / CELLS, abs=0.03)


def test_a_day_of_several_on_which_two_were_exchanged_is_named_by_the_others(learn, make_day):
    days = [make_day(seed) for seed in (1, 2, 3, 4)]
    settings = CalibrationSettings(identification=METHOD)
    assert not [*exchanged_days(days, learn(3).model)]
    days[1] = replace(days[1], temperature_c=days[1].temperature_c[:, [1, 0, 2]], name='odd.csv')
    (named,) = (said for said in calibrate(days, settings).warnings if 'exchanged' in said)
    assert named.startswith('In odd.csv, thermometers 1 and 2 read what is expected of each')


def test_two_that_are_put_back_while_they_read_the_same_are_exchanged_no_more(learn, make_day):
    model, day, begin = learn(3).model, make_day(11), 520
    back = begin + int(np.argmin(np.abs(np.diff(day.temperature_c[begin:700, :2])[:, 0])))
    temperature_c = day.temperature_c.copy()
    temperature_c[begin:back] = temperature_c[begin:back, [1, 0, 2]]
    compensator, said = Compensator(3, model=model), {}
    for end in (back, back + 150, CELLS):
        stream(compensator, replace(day, temperature_c=temperature_c), max(said, default=0), end)
        said[end] = any('jumped at once, one up' in why for why in compensator.zero_doubts)
    assert list(said.values()) == [True, True, False]


def test_one_that_is_replaced_stays_so_under_another_model_and_over_a_restart(learn, make_day):
    model, day = learn(3).model, failing(make_day(7), 'frozen')
    compensator = Compensator(3, model=model)
    stream(compensator, day, end=800)
    believed_c = compensator.tracker.temperature_c
    compensator.go_live(replace(model, day_limits={}))
    assert compensator.tracker.replaced == [1]
    stream(compensator, day, 800, 810)
    assert compensator.tracker.temperature_c == pytest.approx(believed_c, abs=2.0)
    again = Compensator(3, model=compensator.model)
    again.resume(compensator.memory(), 0.0)
    stream(again, day, 810, 820)
    assert again.tracker.replaced == [1]


@pytest.mark.parametrize(
    ('moved_s', 'repeats_s', 'usual_s', 'still_s', 'said'),
    [
        (0, 5, None, 4000, False), (0, 5, 30.0, 590, False), (0, 5, 30.0, 650, True),
        (4000, 5, None, 590, False), (4000, 5, None, 650, True),
        (4000, 100, None, 950, False), (4000, 100, None, 1100, True),
        (4000, 100, 3000.0, 5900, False), (4000, 100, 3000.0, 6100, True),
        (4000, 50, 3000.0, 650, True),
    ],
)  # fmt: skip
def test_a_single_one_is_doubted_when_it_stands_still_longer_than_ever_or_in_its_calibration(
    moved_s, repeats_s, usual_s, still_s, said
):
    """In cells of 5 s, after an hour in which it moved every 5 s, or in coarse steps, or none."""
    moved_c = 20.0 + 0.1 * (np.arange(0, moved_s, 5) // repeats_s)
    readings_c = np.append(moved_c, np.full(still_s // 5, 70.0))
    assert failed_thermometers.too_still_s(readings_c, 5.0, usual_s) == (still_s if said else 0)


def test_all_that_freeze_together_are_doubted_by_their_own_stands(learn, make_day):
    compensator, day = Compensator(3, model=learn(3).model), make_day(6)
    for j in range(3):
        day = failing(day, 'frozen', j, begin=300)
    stream(compensator, day, end=358)
    assert frozen_doubts(compensator.tracker) == []
    stream(compensator, day, 358, 365)
    doubts = frozen_doubts(compensator.tracker)
    assert ['has read the same for 11 min' in doubt for doubt in doubts] == [True] * 3


@pytest.mark.parametrize(('stood_s', 'after_s'), [(None, 600), (20.0, 140), (60.0, 190)])
def test_one_that_freezes_on_a_quiet_robot_is_doubted_by_its_stands_before_or_in_its_calibration(
    learn, make_day, stood_s, after_s
):
    model = replace(learn(3).model, deviation={'force_z': 0.01}, stands_s=(stood_s,) * 3)
    compensator, day = Compensator(3, model=model), failing(make_day(6), 'frozen', begin=300)
    end = 300 + after_s // 10
    stream(compensator, day, end=end)
    assert frozen_doubts(compensator.tracker) == []
    stream(compensator, day, end, end + 1)
    (doubt,) = frozen_doubts(compensator.tracker)
    assert f'thermometer 2 has read the same for {after_s} s while the others show' in doubt
