"""Warm restarts: a stream that was killed and went on, against one that never stopped."""

from dataclasses import replace
import math

import numpy as np
import pytest

from wrist_ft_comp.drift.thermometer_prediction import ThermometerPrediction
from wrist_ft_comp.stream.compensator import Compensator, StreamSettings
from wrist_ft_comp.stream.thermal_memory import (
    belongs_to,
    LEAST_GAP_S,
    longest_gap_s,
    MOST_GAP_S,
)
from wrist_ft_comp.stream.thermometer_faults import start

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
AXES = {'force_z': (2.0, 1e-3, 600.0), 'force_x': (-0.5, 0.0, 0.0), 'torque_y': (0.1, 0.0, 300.0)}
SETTINGS = StreamSettings()


#: Two thermometers that read the same.
ALIKE = ThermometerPrediction(
    np.zeros(1), np.array([[[0.0, 1.0]], [[1.0, 0.0]]]), np.zeros(2), *np.ones((3, 2))
)


@pytest.fixture(scope='module')
def model(make_model):
    axes = {axis: (zero, gain, tau or 1e-3) for axis, (zero, gain, tau) in AXES.items()}
    return make_model(axes)


def warming(second):
    """20 K in an exponential with a time constant of five minutes, and motors that switch."""
    heat = 20.0 * (1 - math.exp(-second / 300)) if second > 0 else 0.0
    return 20.0 + heat + 0.5 * math.sin(second / 11.0)


def feed(compensator, first, end, rate_hz=2.0):
    """Send temperatures of the warm-up; the drift that is subtracted after each."""
    seen = []
    for k in range(round(first * rate_hz), round(end * rate_hz)):
        stamp = START + round(k / rate_hz * SECOND)
        compensator.add_temperature(0, stamp, warming(k / rate_hz))
        seen.append(compensator.compensation_at(stamp))
    return seen


def ran(model, seconds):
    compensator = Compensator(1, SETTINGS, model)
    feed(compensator, 0, seconds)
    return compensator


def memory_of(compensator):
    memory = compensator.memory()
    assert memory is not None
    return memory


def restarted(model, before, by_clock_s=0.0):
    after = Compensator(1, SETTINGS, model)
    after.resume(memory_of(before), by_clock_s)
    return after


def test_the_drift_is_subtracted_before_the_first_temperature(model):
    killed = ran(model, 400)
    again = restarted(model, killed)
    assert again.compensating
    assert again.tracker.awaited
    assert again.tracker.origin.startswith('the drift saved before the restart is held')
    raw = [10.0, 20.0, 50.0, 1.0, 2.0, 3.0]
    far = START + 10**6 * SECOND
    assert again.correct(0, raw) == pytest.approx(killed.correct(far, raw))
    assert again.memory() is not None
    assert restarted(model, again).compensation.zero[2] == again.compensation.zero[2]


@pytest.mark.parametrize(
    ('gap_s', 'by_clock_s', 'words'),
    [
        (-100, 0, '100 s ahead of the temperatures'),
        (-1e9, 0, 'ahead of the temperatures'),
        (1801, 0, '1801 s old and this model remembers 1800 s'),
        (1e9, 0, 'this model remembers 1800 s'),
        (10, 100, 'while 100 s passed since the thermal state was saved'),
    ],
)
def test_an_impossible_gap_starts_at_the_steady_state_and_says_why(
    model, gap_s, by_clock_s, words
):
    fast = StreamSettings(max_drift_rate_n_s=1e3)
    killed, again = (Compensator(1, fast, model) for _ in range(2))
    feed(killed, 0, 400)
    memory = memory_of(killed)
    again.resume(memory, by_clock_s)
    for second in range(3):
        again.add_temperature(0, memory.end_ns + (round(gap_s) + second) * SECOND, 30.0)
    assert words in again.tracker.origin
    assert again.compensation.zero[2] == pytest.approx(2.0 * 10.0)
    assert again.tracker.awaited is None


def test_the_longest_gap_follows_the_slowest_time_constant_within_bounds(model, make_model):
    assert longest_gap_s(model) == pytest.approx(1800.0)
    for axes in ({}, {'force_z': (1.0, 0.0, 1.0)}):
        assert longest_gap_s(make_model(axes)) == LEAST_GAP_S
    assert longest_gap_s(make_model({'force_z': (1.0, 0.0, 1e5)})) == MOST_GAP_S


def test_a_memory_belongs_to_models_of_its_form_only(model, make_model):
    killed = ran(model, 10)
    memory = memory_of(killed)
    assert belongs_to(model, memory)
    filters = memory.filters
    for change in (
        {'temperature_c': np.array([20.0, 20.0])},
        {'filters': {**filters, 'force_z': np.zeros((1, 2))}},
        {'filters': {'force_z': filters['force_z']}},
        {'filters': {axis: np.full(values.shape, 1.7e308) for axis, values in filters.items()}},
        {'history': ((np.zeros(2), 60),)},
        {'period_ns': 2 * SECOND},
        {'silent': (0, 0)},
        {'start_c': np.zeros((0, 1))},
        {'start_c': np.zeros((2, 1))},
        {'thermometers': start(ALIKE, np.zeros(2))},
    ):
        assert not belongs_to(model, replace(memory, **change))
    assert not belongs_to(make_model({'force_z': (1.0, 0.0, 1.0)}), memory)


def test_what_is_known_of_thermometers_belongs_to_models_that_predict_as_many(make_model):
    model = make_model({'force_z': (1.0, 0.0, 600.0)}, thermometers=2, prediction=ALIKE)
    compensator = Compensator(2, SETTINGS, model)
    for k in range(4):
        for j in range(2):
            compensator.add_temperature(j, START + k * SECOND, 20.0)
    memory = memory_of(compensator)
    assert belongs_to(model, memory)
    assert not belongs_to(replace(model, prediction=None), memory)
    short = replace(memory.thermometers, reasons=('',))
    for thermometers in (None, short):
        assert not belongs_to(model, replace(memory, thermometers=thermometers))


def test_a_model_that_goes_live_after_a_restart_has_the_history_before_it(model, make_model):
    """A calibration or a rollback behind a restart: the coarse history does as well."""
    other = make_model({'force_z': (-1.0, 0.0, 900.0)})
    never, killed = (Compensator(1, SETTINGS, model) for _ in range(2))
    feed(never, 0, 800)
    feed(killed, 0, 700)
    again = restarted(model, killed, 10.0)
    feed(again, 710, 800)
    for compensator in (never, again):
        compensator.go_live(other)
    expected = never.compensation.zero[2]
    assert again.compensation.zero[2] == pytest.approx(expected, rel=0.03)
    assert -1.0 * (warming(800) - 20.0) < 1.3 * expected, 'the steady state would be far off'
