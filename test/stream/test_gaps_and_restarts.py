"""Gaps and warm restarts: what went on after them, against what never stopped."""

from dataclasses import replace
import math
import re

import numpy as np
import pytest

from wrist_ft_comp.drift.drift_model import ThermometerPrediction
from wrist_ft_comp.stored.state_file import belongs_to, load_state, save_state, SavedState
from wrist_ft_comp.stream.compensator import Compensator, StreamSettings
from wrist_ft_comp.stream.drift_warnings import gap_doubts
from wrist_ft_comp.stream.gaps_and_restarts import longest_gap_s

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
AXES = {'force_z': (2.0, 1e-3, 600.0), 'force_x': (-0.5, 0.0, 1e-3), 'torque_y': (0.1, 0.0, 300.0)}
#: Two thermometers that read the same.
ALIKE = ThermometerPrediction(
    np.zeros(1), np.array([[[0.0, 1.0]], [[1.0, 0.0]]]), np.zeros(2), *np.ones((3, 2))
)


@pytest.fixture(scope='module')
def model(make_model):
    return make_model(AXES)


def doubting(make_model, tau_s=600.0, range_c=(20.0, 60.0)):
    model = make_model({'force_z': (0.4, 0.0, tau_s)}, range_c=range_c)
    return replace(model, deviation={'force_z': 0.02})


def warming(second):
    """20 K in an exponential with a time constant of five minutes, and motors that switch."""
    heat = 20.0 * (1 - math.exp(-second / 300)) if second > 0 else 0.0
    return 20.0 + heat + 0.5 * math.sin(second / 11.0)


def feed(compensator, first, end):
    """Send temperatures of the warm-up, two a second."""
    for k in range(2 * first, 2 * end):
        compensator.add_temperature(0, START + k * SECOND // 2, warming(k / 2))


def heat(seconds, celsius, *compensators):
    """Send a temperature a second, or what a function says of the second."""
    for second in seconds:
        value = celsius(second) if callable(celsius) else celsius
        for compensator in compensators:
            compensator.add_temperature(0, START + second * SECOND, value)


def restarted(model, before, by_clock_s=0.0):
    after = Compensator(1, model=model)
    after.resume(before.memory(), by_clock_s)
    return after


@pytest.mark.parametrize(
    ('gap_s', 'by_clock_s', 'words'),
    [
        (-1e9, 0, '1000000000 s ahead of the temperatures'),
        (10, 100, 'while 100 s passed since the thermal state was saved'),
    ],
)
def test_an_impossible_gap_starts_at_steady_state_and_says_why(model, gap_s, by_clock_s, words):
    fast = StreamSettings(max_drift_rate_n_s=1e3)
    killed, again = (Compensator(1, fast, model) for _ in range(2))
    feed(killed, 0, 400)
    memory = killed.memory()
    again.resume(memory, by_clock_s)
    assert again.compensation.zero[2] == killed.compensation.zero[2]
    assert restarted(model, again).compensation.zero[2] == again.compensation.zero[2]
    for second in range(3):
        again.add_temperature(0, memory.end_ns + (round(gap_s) + second) * SECOND, 30.0)
    assert words in again.tracker.origin
    assert again.compensation.zero[2] == pytest.approx(2.0 * 10.0)
    assert again.tracker.awaited is None
    (doubt,) = gap_doubts(again.tracker)
    off_n = float(re.search(r'force_z may be (\S+) N off', doubt)[1])
    assert off_n >= 0.9 * (20.0 - killed.compensation.zero[2]), 'it may have gone on'


def test_the_longest_gap_follows_the_slowest_time_constant_within_bounds(model, make_model):
    assert longest_gap_s(model) == pytest.approx(1800.0)
    for axes in ({}, {'force_z': (1.0, 0.0, 1.0)}):
        assert longest_gap_s(make_model(axes)) == 60.0
    assert longest_gap_s(make_model({'force_z': (1.0, 0.0, 1e5)})) == 6 * 3600.0


def test_a_memory_belongs_to_models_of_its_form_only(make_model):
    model = make_model(AXES, thermometers=2, prediction=ALIKE)
    compensator = Compensator(2, model=model)
    for k in range(8):
        compensator.add_temperature(k % 2, START + k // 2 * SECOND, 20.0)
    memory = compensator.memory()
    assert belongs_to(model, memory)
    filters = memory.filters
    for change in (
        {'temperature_c': np.array([20.0])}, {'filters': {**filters, 'force_z': np.zeros((1, 2))}},
        {'filters': {'force_z': filters['force_z']}},
        {'filters': {axis: np.full(values.shape, 1.7e308) for axis, values in filters.items()}},
        {'history': ((np.zeros(1), 60),)}, {'period_ns': 2 * SECOND}, {'silent': (0,)},
        {'jumps': memory.jumps[:1]}, {'start_c': np.zeros((0, 2))}, {'start_c': np.zeros((2, 2))},
        {'thermometers': None}, {'thermometers': replace(memory.thermometers, reasons=('',))},
    ):  # fmt: skip
        assert not belongs_to(model, replace(memory, **change))
    for axes, prediction in ((AXES, None), ({'force_z': (1.0, 0.0, 1.0)}, ALIKE)):
        assert not belongs_to(make_model(axes, thermometers=2, prediction=prediction), memory)


def test_a_model_that_goes_live_after_a_restart_has_the_history_before_it(model, make_model):
    other = make_model({'force_z': (-1.0, 0.0, 900.0)})
    never, killed = (Compensator(1, model=model) for _ in range(2))
    feed(never, 0, 800)
    feed(killed, 0, 700)
    again = restarted(model, killed, 10.0)
    feed(again, 710, 800)
    for compensator in (never, again):
        compensator.go_live(other)
    expected = never.compensation.zero[2]
    assert again.compensation.zero[2] == pytest.approx(expected, rel=0.03)
    assert -1.0 * (warming(800) - 20.0) < 1.3 * expected, 'the steady state would be far off'


def test_what_nobody_knows_of_a_gap_is_said_until_the_model_has_forgotten_it(make_model):
    """Whatever temperatures did meanwhile, as fast as before: the drift is as near as is said."""
    model = doubting(make_model, 150.0, (15.0, 40.0))
    rng, stated = np.random.default_rng(0), set()
    before_c = 20.0 + np.interp(np.arange(300), [0, 150, 300], [0, 1.5, 0])
    for gap_s in (70, *[420] * 3):
        rates = 0.01 * rng.choice([-1, 1], gap_s // 25 + 1)
        path_c = 20.0 + np.cumsum(np.repeat(rates, 25)[:gap_s])
        all_c = np.concatenate((before_c, path_c, np.full(500, path_c[-1])))
        knows, compensator = (Compensator(1, model=model) for _ in range(2))
        for second, celsius in enumerate(all_c):
            knows.add_temperature(0, second * SECOND, celsius)
            if not 300 <= second < 300 + gap_s:
                compensator.add_temperature(0, second * SECOND, celsius)
            if second == 300 + gap_s + 5:
                doubts = gap_doubts(compensator.tracker)
                off_n = float(re.search(r'(\S+) N off', doubts[0])[1]) if doubts else 0.06
                stated.add(off_n > 0.06)
                apart = knows.compensation.zero - compensator.compensation.zero
                assert abs(apart[2]) <= 1.05 * off_n  # which is rounded
                compensator.set_tare(np.zeros(6), second * SECOND)
                said = ['uncertain; call ~/tare' in doubt for doubt in compensator.zero_doubts]
                assert said == [True] * len(doubts)
        assert gap_doubts(compensator.tracker) == []
    assert stated == {True, False}


@pytest.mark.parametrize('every_s', [1, 2, 7])
def test_what_moves_after_a_gap_is_doubted_however_often_thermometers_report(make_model, every_s):
    compensator = Compensator(1, model=doubting(make_model, 1200.0))
    for second in (*range(0, 1800, every_s), *range(2702, 2790, every_s)):
        heat([second], 20.0 + min(0.01 * second, 18.0) + 0.02 * max(second - 2702, 0), compensator)
    left_n = compensator.tracker.uncertainty.left(compensator.tracker.end_ns, 3600.0)[2]
    assert left_n == pytest.approx(4.0, rel=0.2)


@pytest.mark.parametrize('after_s', [1, 5, 9])
def test_a_model_of_longer_cells_may_go_live_right_after_a_gap(make_model, after_s):
    compensator = Compensator(1)
    heat((*range(1, 2000), *range(2300, 2300 + after_s)), 25.0, compensator)
    compensator.go_live(make_model({'force_z': (0.4, 0.0, 600.0)}, period_s=60))
    heat(range(2300 + after_s, 2500), 25.0, compensator)
    assert compensator.tracker.drift.zero[2] == pytest.approx(2.0)


@pytest.mark.parametrize('away_s', [70, 400])
def test_a_restart_within_a_cell_is_no_clock_that_was_set(make_model, away_s):
    model = make_model({'force_z': (0.4, 0.0, 3600.0)}, period_s=600)
    before, after = (Compensator(1, model=model) for _ in range(2))
    heat(range(0, 3650, 5), lambda second: 20.0 + second / 300, before)
    after.resume(before.memory(), float(away_s))
    heat(range(3650 + away_s, 5500, 5), lambda second: 20.0 + second / 300, before, after)
    was_n, is_n = (one.tracker.drift.zero[2] for one in (before, after))
    assert (is_n, after.tracker.forgot) == (pytest.approx(was_n, abs=0.1), False)
    assert was_n > 1.0


def test_a_slow_model_behind_a_quick_one_is_doubted_as_far_as_alone(make_model):
    both, alone = Compensator(1, model=doubting(make_model, 30.0)), Compensator(1)
    heat(range(900), lambda second: 35.0 + second / 300, both, alone)
    for compensator in (both, alone):
        compensator.go_live(doubting(make_model, 1200.0))
    assert gap_doubts(both.tracker) == gap_doubts(alone.tracker) != []


@pytest.mark.parametrize(('start_c', 'past_k_s', 'rate_k_s', 'is_said'), [
    (24.0, 0.0, 0.05, False), (24.0, 0.0, 0.0, False), (35.0, 0.05, 0.05, True),
    (35.0, -0.05, -0.05, True), (35.0, 0.02, 0.0, True),
], ids=['switched on', 'rests', 'warms for long', 'cools', 'stands still, warm'])  # fmt: skip
def test_a_start_at_temperatures_that_move_is_doubted_as_far_as_it_may_be_wrong(
    make_model, start_c, past_k_s, rate_k_s, is_said
):
    """For 200 s before the node started, temperatures had moved."""
    model = doubting(make_model)
    knows, starts, late = Compensator(1, model=model), Compensator(1, model=model), Compensator(1)
    heat(range(-200 if is_said else 0, 0), lambda second: start_c + past_k_s * second, knows)
    heat(range(75), lambda second: start_c + rate_k_s * second, knows, starts, late)
    late.go_live(model)
    apart_n = abs(knows.compensation.zero - starts.compensation.zero)[2]
    for compensator in (starts, late):
        doubts = gap_doubts(compensator.tracker)
        assert len(doubts) == is_said
        for doubt in doubts:
            off_n = float(re.search(r'(\S+) N off', doubt)[1])
            assert 0.95 * apart_n < off_n < 4 * apart_n
        compensator.set_tare(np.zeros(6), START + 75 * SECOND)
        assert ['uncertain' in d for d in compensator.zero_doubts] == [True] * is_said


@pytest.mark.parametrize('rate_k_s', [0.0, 0.02])
def test_cells_that_are_longer_than_the_model_remembers_move_the_drift(make_model, rate_k_s):
    model = make_model({'force_z': (0.4, 0.0, 10.0)}, period_s=180.0, range_c=(20.0, 60.0))
    compensator = Compensator(1, model=model)
    heat(range(0, 1800, 5), lambda second: 35.0 + rate_k_s * second, compensator)
    expected_c = compensator.tracker.temperature_c[0]
    assert expected_c == pytest.approx(35.0 + rate_k_s * 1600, abs=180 * rate_k_s)
    assert compensator.tracker.drift.zero[2] == pytest.approx(0.4 * (expected_c - 20.0), abs=0.1)


@pytest.mark.parametrize(('start_c', 'is_doubted'), [(24.0, False), (35.0, True)])
def test_a_zero_that_is_made_while_the_drift_may_be_off_is_doubted(
    make_model, start_c, is_doubted
):
    """A tare in the first minute, before the start is judged; a slow model that goes live."""
    for change, made in ((False, 'tare was taken'), (True, 'model went live')):
        compensator = Compensator(1, model=doubting(make_model, 200.0))
        for second in range(180):
            compensator.add_temperature(0, START + second * SECOND, start_c)
            if second == 20 and not change:
                compensator.set_tare(np.zeros(6), START + second * SECOND)
        if change:
            wrench = START + 180 * SECOND, [0.0] * 6
            compensator.go_live(doubting(make_model, 900.0), wrench)
        said = [f'{made} while the thermal state' in why for why in compensator.zero_doubts]
        assert said == [True] * is_doubted


@pytest.mark.parametrize(('away_s', 'morning_c', 'has_soaked', 'is_doubted'), [
    (40, 29.5, False, False), (40, 22.0, True, False),
    (43_200, 22.0, True, False), (43_200, 35.0, True, True),
], ids=['no night', 'a clock that stood still', 'a night', 'a warm morning'])  # fmt: skip
def test_a_sensor_as_cold_as_a_room_has_soaked_over_the_night(
    make_model, away_s, morning_c, has_soaked, is_doubted
):
    model = doubting(make_model, 1200.0)
    evening, morning, soaked = (Compensator(1, model=model) for _ in range(3))
    heat(range(1200), lambda second: 22.0 + second / 150, evening)
    morning.resume(evening.memory(), float(away_s))
    heat(range(1200 + away_s, 1270 + away_s), morning_c, morning)
    heat(range(70), morning_c, soaked)
    apart_n = abs(morning.tracker.drift.zero - soaked.tracker.drift.zero)[2]
    assert (apart_n < 0.01) == has_soaked
    assert bool(gap_doubts(morning.tracker)) == is_doubted


@pytest.mark.parametrize(('gap', 'allowed_s', 'moves', 'is_said'), [
    ((2500, 3300, 1), 5.0, lambda _: 0.0, False),
    ((2500, 3300, 1), 5.0, lambda at: max(at - 3300, 0), True),
    ((3000, 3000, 100), 5.0, lambda at: 400 * math.sin(at / 300), False),
    ((3000, 3500, 100), 5.0, lambda at: 400 * math.sin(at / 300), True),
    ((3000, 3500, 100), 3600.0, lambda at: 400 * math.sin(at / 300), False),
], ids=['quiet', 'moves after it', 'reports seldom', 'pauses', 'may pause'])  # fmt: skip
def test_a_gap_is_doubted_where_a_robot_moves(make_model, gap, allowed_s, moves, is_said):
    (end, begin, every_s), settings = gap, StreamSettings(temperature_timeout_s=allowed_s)
    compensator = Compensator(1, settings, doubting(make_model, 300.0))
    seconds = *range(0, end, every_s), *range(begin, begin + 500, every_s)
    heat(seconds, lambda second: 30.0 + moves(second) / 100, compensator)
    assert bool(gap_doubts(compensator.tracker)) == is_said


@pytest.mark.parametrize(
    ('allowed_s', 'after_c', 'is_gap'),
    [(5.0, 40.0, True), (3600.0, 40.5, False), (3600.0, 50.0, True)],
)
def test_a_silence_that_is_allowed_is_no_gap_and_time_in_which_the_model_forgets(
    make_model, allowed_s, after_c, is_gap
):
    """It remembers 15 min; the robot was warm at the start, and is silent for half an hour."""
    settings = StreamSettings(temperature_timeout_s=allowed_s)
    compensator = Compensator(1, settings, doubting(make_model, 300.0))
    heat(range(70), 40.0, compensator)
    assert gap_doubts(compensator.tracker)
    assert bool(gap_doubts(compensator.tracker, 1800 * SECOND + START)) == (allowed_s < 1800)
    heat(range(1870, 1873), lambda second: after_c - second / 1000, compensator)
    assert compensator.tracker.forgot == is_gap
    assert bool(gap_doubts(compensator.tracker)) == is_gap


@pytest.mark.parametrize('cell_s', [1, 120])
def test_a_stream_that_was_killed_after_a_first_cell_goes_on_after_minutes(make_model, cell_s):
    model, settings = make_model({'force_z': (0.4, 0.0, 600.0)}, period_s=cell_s), StreamSettings()
    first = Compensator(1, settings, model)
    heat(range(3 * cell_s), 20.0, first)
    memory = first.memory()
    for saved in (memory, replace(memory, history=())):
        second = Compensator(1, settings, model)
        second.resume(saved, 300.0)
        heat(range(300 + 3 * cell_s, 306 + 5 * cell_s), 25.0, second)
        assert second.tracker.awaited is None
        assert np.isfinite(second.compensation.zero).all()
        assert not any('nan' in doubt for doubt in gap_doubts(second.tracker))


def test_what_nobody_knows_of_a_gap_is_still_said_after_a_restart(make_model, tmp_path):
    """Restarted at once, and after another minute and a half without temperatures."""
    model = doubting(make_model)
    before, path = Compensator(1, model=model), tmp_path / 'state.json'
    heat(range(1200), lambda second: 20.0 + second / 100, before)
    end_s = 1200 + 1500
    heat(range(end_s, end_s + 5), 32.0, before)
    (expected,) = gap_doubts(before.tracker)
    save_state(path, SavedState(0, None, np.zeros(6), before.memory()))
    for away_s in (0, 90):
        after = Compensator(1, model=model)
        after.resume(load_state(path).thermal, 0.0)
        assert gap_doubts(after.tracker) == [expected]
        heat(range(end_s + 5 + away_s, end_s + 10 + away_s), 32.0, after)
        (said,) = gap_doubts(after.tracker)
        off_n, still_n = (float(re.search(r'(\S+) N off', s)[1]) for s in (expected, said))
        assert still_n > 0.8 * off_n
