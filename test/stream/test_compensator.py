"""The stream: what comes out for a wrench, when models change and when things go wrong."""

from dataclasses import replace
import pickle

import numpy as np
import pytest

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.drift.drift_model import Drift
from wrist_ft_comp.errors import RecordingError, SettingsError
from wrist_ft_comp.recording import Samples
from wrist_ft_comp.stream.batch_grid import grid_samples
from wrist_ft_comp.stream.clock import Sample
from wrist_ft_comp.stream.compensator import (
    axis_limits,
    Compensator,
    Limits,
    MAX_SENSITIVITY,
    MAX_SENSITIVITY_RATE,
    StreamSettings,
)
from wrist_ft_comp.stream.drift_tracker import DriftTracker
from wrist_ft_comp.stream.offline import correct_many, simulate_drift, track_drift

SECOND = 1_000_000_000
LOAD = np.array([50.0, -20.0, 100.0, 3.0, -1.0, 2.0])
ZEROS = np.zeros(6)
#: Zero drift of force z of 0.4 N/K and of torque x; sensitivity drift of force z of 0.1 %/K.
TRUTH = {'force_z': (0.4, 1e-3, 30.0), 'torque_x': (0.01, 0.0, 5.0)}
OTHER = {'force_z': (-1.0, -2e-3, 60.0), 'force_x': (0.2, 5e-4, 10.0)}


@pytest.fixture(scope='module')
def model(make_model):
    return make_model(TRUTH)


@pytest.fixture(scope='module')
def other(make_model):
    return make_model(OTHER)


def warming(stamp_ns):
    """0.05 K per second from 20 °C, with a faster wave."""
    seconds = stamp_ns / SECOND
    return 20.0 + 0.05 * seconds + float(np.sin(seconds / 7.0))


def stream(compensator, span_s, raw=LOAD, temperature=warming):
    """50 wrenches a second and a temperature every half second; stamps and what came out."""
    stamps = np.arange(round(span_s[0] * 50), round(span_s[1] * 50)) * (SECOND // 50)
    outputs, newest = [], None
    for k, stamp in enumerate(stamps.tolist()):
        if k % 25 == 0:
            for j in range(compensator.thermometers):
                compensator.add_temperature(j, stamp, temperature(stamp), newest)
        newest = stamp, raw.tolist()
        outputs.append(compensator.correct(*newest))
    return stamps, np.array(outputs)


def newest_before(second):
    """What ``stream`` sent last, until a second."""
    return round(second * SECOND) - SECOND // 50, LOAD.tolist()


def steps(outputs):
    return np.abs(np.diff(outputs, axis=0)).max(axis=0)


@pytest.mark.parametrize(
    ('name', 'values'),
    [
        ('thermal_period_s', (0.0, 0.09, 600.1, -1.0)),
        ('temperature_timeout_s', (0.0, -1.0)),
        ('max_drift_n', (-5.0,)),
        ('max_drift_rate_n_s', (0.0, -1.0)),
        ('history_s', (0.0, -1.0)),
    ],
)
def test_settings_outside_their_range_are_refused(name, values):
    for value in (*values, np.nan, np.inf, -np.inf):
        with pytest.raises(SettingsError, match=f'^{name} must be a number .*; got {value}'):
            StreamSettings(**{name: value})
    for period_s in (0.1, 600.0):
        StreamSettings(thermal_period_s=period_s, max_drift_n=0.0)


@pytest.mark.parametrize('live', [False, True])
def test_the_wrench_passes_until_a_model_has_a_cell(model, *, live):
    compensator = Compensator(1, StreamSettings(), model if live else None)
    for second in range(3):
        assert compensator.compensating == (live and second > 1)
        assert compensator.correct(second, LOAD.tolist()) == LOAD.tolist() or second > 1
        compensator.add_temperature(0, second * SECOND, 30.0)
    assert compensator.tracker.temperature_c == pytest.approx([30.0])
    soaked = 0.4 * (30.0 - 20.0) if live else 0.0
    assert compensator.compensation.zero[2] == pytest.approx(soaked)


def test_the_output_is_the_equation_with_the_drift_of_its_time(model):
    """Temperatures come at the cells' borders, so the ramps of stream and batch are the same."""
    compensator = Compensator(1, StreamSettings(), model)
    stamps, outputs = stream(compensator, (0, 120))
    temperatures = np.arange(240) * SECOND // 2
    celsius = np.array([[warming(stamp)] for stamp in temperatures.tolist()])
    raw = np.tile(LOAD, (len(stamps), 1))
    recording = grid_samples(
        [Samples(('temperature_c',), temperatures, celsius), Samples(AXES, stamps, raw)]
    )
    expected = correct_many(track_drift(model, recording), stamps, raw)
    settled = stamps >= 2 * SECOND
    np.testing.assert_allclose(outputs[settled], expected[settled], atol=1e-6)
    assert np.ptp(outputs[settled, 2]) > 2.0


def fed_cell_by_cell(model, temperature_c):
    """The drift that a stream has after every cell of a second."""
    tracker, drifts = DriftTracker(1, SECOND, 10.0, 3600.0), []
    tracker.use(model)
    for second, celsius in enumerate([*temperature_c.tolist(), temperature_c[-1]]):
        if tracker.add(Sample(0, second * SECOND + SECOND // 2, celsius)):
            drifts.append(tracker.drift.zero[2])
    return np.array(drifts)


@pytest.mark.parametrize('start_s', [0.0, 10.0])
@pytest.mark.parametrize('cells', [1, 4, 9, 10, 11, 60])
def test_a_stream_starts_as_the_batch_after_any_cells(model, make_recording, cells, start_s):
    """Below, at and above the ten cells that a start averages."""
    model = replace(model, start_s=start_s)
    temperature_c = 20 + np.random.default_rng(0).normal(0, 0.5, cells) + np.arange(cells) / 5
    recording = make_recording(temperature_c, {'force_z': 0.0}, period_s=1.0)
    expected = simulate_drift(model, recording).zero[:, 2]
    np.testing.assert_allclose(fed_cell_by_cell(model, temperature_c), expected, atol=1e-12)


def test_seconds_of_nothing_leave_no_trace_and_are_said_as_long_as_they_last(make_model):
    """A bus error: 0 °C for 15 s."""
    compensator = Compensator(1, model=make_model({'force_z': (2.0, 0.0, 60.0)}))
    for second in range(200):
        compensator.add_temperature(0, second * SECOND, 0.0 if 100 <= second < 115 else 27.0)
        (spikes,) = compensator.tracker.spikes
        assert spikes.leaves_out == (100 <= second < 115)
        assert second < 2 or compensator.compensation.zero[2] == pytest.approx(14.0)
    assert (spikes.dropped, spikes.jumps) == (15, 0)


def test_wrong_first_readings_are_forgotten_and_it_is_said(make_model):
    compensator = Compensator(2, model=make_model({'force_z': (2.0, 0.0, 600.0)}, thermometers=2))
    for second in range(100):
        compensator.add_temperature(0, second * SECOND, 27.0)
        compensator.add_temperature(1, second * SECOND, 0.0 if second < 15 else 27.0)
    assert compensator.tracker.forgot
    assert compensator.tracker.origin == (
        'the first readings of thermometer 2, such as 0.0 °C, were wrong; so the drift starts at '
        'the steady state of the present temperatures'
    )
    assert compensator.tracker.drift.zero[2] == pytest.approx(14.0)
    assert len(compensator.tracker.history_c) < 75


@pytest.mark.parametrize('set_s', [-50_000, -300, -30, 90, 50_000])
@pytest.mark.parametrize('silent_s', [1, 600])
def test_a_clock_that_is_set_leaves_the_thermal_state(make_model, set_s, silent_s):
    """By arrival nothing passed, so the drift is what it would have been."""
    drifts = []
    for moved_s in (0, set_s):
        model = make_model({'force_z': (2.0, 0.0, 600.0)}, thermometers=2)
        compensator = Compensator(2, model=model)
        for second in (*range(300), *range(299 + silent_s, 500 + silent_s)):
            stamp_ns = (10**6 + second + moved_s * (second >= 300)) * SECOND + SECOND // 2
            for j in range(2):
                arrival_ns = second * SECOND + 7
                celsius = 20.0 + second / 50
                compensator.add_temperature(j, stamp_ns, celsius, arrival_ns=arrival_ns)
        drifts.append(compensator.tracker.drift.zero[2])
        assert not compensator.tracker.forgot
        assert compensator.tracker.end_ns == stamp_ns - SECOND // 2
    assert drifts[1] == pytest.approx(drifts[0], abs=0.03)
    words = f'leapt by {set_s + silent_s} s while {silent_s} s passed: their clock was set'
    assert words in compensator.tracker.origin


def test_the_force_path_has_no_memory(model):
    """Correcting a wrench, whatever it holds, leaves everything as it was."""
    compensator = Compensator(1, StreamSettings(), model)
    stream(compensator, (0, 10))
    before = pickle.dumps(compensator)
    for wrench in (LOAD, 1e4 * LOAD, np.full(6, np.nan)):
        for stamp in (0, 10 * SECOND, 12 * SECOND):
            compensator.correct(stamp, wrench.tolist())
    assert pickle.dumps(compensator) == before


class TestLimits:
    @pytest.mark.parametrize('sign', [-1.0, 1.0])
    def test_a_drift_moves_as_far_as_its_rate_allows_in_the_time(self, sign):
        limits, drift = Limits(200.0, 2.0), Drift(np.arange(6.0), np.full(6, 0.1))
        for share, reached, too_fast in ((0.9, 0.9, ()), (1.0, 1.0, ()), (1e3, 1.0, AXES)):
            rates = sign * 2.5 * axis_limits(2.0), sign * 2.5 * MAX_SENSITIVITY_RATE
            target = Drift(*(part + share * rate for part, rate in zip(drift, rates, strict=True)))
            moved = limits.rate_limit(target, drift, 2.5)
            np.testing.assert_allclose(moved.zero - drift.zero, reached * rates[0])
            np.testing.assert_allclose(moved.sensitivity - 0.1, reached * rates[1])
            assert limits.too_fast == too_fast

    def test_a_drift_is_as_large_as_its_limit_at_most_and_nothing_where_it_is_no_number(self):
        limits, largest = Limits(30.0, 1.0), Drift([30.0] * 3 + [3.0] * 3, [MAX_SENSITIVITY] * 6)
        for share, reached in ((-1e3, -1), (0.9, 0.9), (1, 1), (np.inf, 1)):
            target = Drift(*(share * np.array(part) for part in largest))
            for part, limit in zip(limits.saturate(target), largest, strict=True):
                np.testing.assert_allclose(part, reached * np.array(limit))
            assert limits.too_large == (AXES if abs(share) > 1 else ())
        one = np.where(np.arange(6) == 3, np.nan, 1.0)
        np.testing.assert_array_equal(
            limits.saturate(Drift(one, one / 4)).zero, [1, 1, 1, 0, 1, 1]
        )
        assert limits.too_large == ('torque_x',)


def sparse(kind):
    """Report 1 K in 30 s that often: stamps, s, and temperatures, °C; the last 10 min soaked."""
    seconds = np.arange(1200.0)
    celsius = 20.0 + np.minimum(seconds, 600.0) / 30.0
    if kind == 'each 30 s':
        return seconds[::30], celsius[::30]
    step_k = {'by 0.1 K': 0.1, 'by 0.5 K': 0.5}[kind]
    rounded = np.round(celsius / step_k) * step_k
    changed = np.flatnonzero(np.diff(rounded, prepend=0.0))
    return seconds[changed], rounded[changed]


@pytest.mark.parametrize('kind', ['each 30 s', 'by 0.1 K', 'by 0.5 K'])
def test_seldom_reports_are_followed_on_a_ramp_and_said_how_far_behind(make_model, kind):
    """Drift of 2 N in 30 s."""
    compensator = Compensator(1, model=make_model({'force_z': (2.0, 0.0, 1.0)}))
    stamps_s, celsius = sparse(kind)
    largest, drifts = np.diff(celsius[2:]).max() * 2.0, []
    for second in range(1200):
        for at in np.flatnonzero(stamps_s == second):
            compensator.add_temperature(
                0, second * SECOND, celsius[at], arrival_ns=second * SECOND
            )
        drifts.append(compensator.compensation_at(second * SECOND).zero[2])
        true = 2.0 * min(second, 600) / 30.0
        doubts = compensator.seldom_reports()
        if 200 < second < 590:
            ((spacing_s, behind),) = doubts.values()
            assert spacing_s in {3, 6, 15, 30}
            assert abs(true - drifts[-1]) <= behind[2] + 0.1
            assert behind[2] <= 2.1 * largest + 0.1
            (doubt,) = compensator.seldom_doubts()
            assert doubt == (
                f'thermometer 1 reports every {spacing_s:.3g} s, so that the drift of force_z may '
                f'be {behind[2]:.2g} N behind; let it report each second'
            )
    moves = np.abs(np.diff(drifts))[200:]
    assert moves.max() < 0.1, 'a step of 2 N otherwise'
    assert not compensator.limits.too_fast
    assert drifts[-1] == pytest.approx(40.0, abs=largest)


def test_thermometers_that_report_each_second_are_followed_within_one(make_model):
    """Also behind a gap of a minute, and where a report in four is missing."""
    compensator = Compensator(1, model=make_model({'force_z': (2.0, 0.0, 1.0)}))
    for second in (*range(40), *(k for k in range(100, 200) if k % 4)):
        compensator.add_temperature(0, second * SECOND, 20.0 + second / 1000)
        assert compensator.seldom_reports() == {}
        begun = compensator.compensation_at((second + 1) * SECOND).zero
        np.testing.assert_array_equal(begun, compensator.compensation.zero)


class TestModelSwap:
    @pytest.mark.parametrize('tared', [False, True])
    @pytest.mark.parametrize(
        ('when_s', 'period_s'), [(40.0, 1.0), (40.5, 1.0), (40.99, 0.5), (40.2, 2.0), (40.0, None)]
    )
    def test_going_live_leaves_the_loaded_output_where_it_was(
        self, make_model, model, when_s, period_s, tared
    ):
        """Whatever the period of the other model, and without one, too."""
        other = make_model(OTHER, period_s=period_s) if period_s else None
        compensator = Compensator(1, StreamSettings(), model)
        stream(compensator, (0, 30))
        if tared:
            compensator.set_tare(LOAD / 2, 30 * SECOND)
        _, before = stream(compensator, (30, when_s))
        compensator.go_live(other, newest_before(when_s))
        assert compensator.model is other
        _, after = stream(compensator, (when_s, 80))
        both = np.concatenate((before, after))
        calm = np.maximum(steps(before), steps(after))
        assert (steps(both) <= calm + 1e-9).all()
        assert (np.ptp(after[:, 2]) > 0.5) == (other is not None)

    @pytest.mark.parametrize('live_s', [10.5, 63.2, 200.0])
    def test_a_model_that_goes_live_later_has_the_drift_of_one_that_ran_from_the_start(
        self, model, live_s
    ):
        early = Compensator(1, StreamSettings(), model)
        late = Compensator(1, StreamSettings())
        stream(early, (0, live_s))
        stream(late, (0, live_s))
        late.go_live(model, newest_before(live_s))
        assert late.compensating
        for expected, corrected in zip(early.compensation, late.compensation, strict=True):
            np.testing.assert_allclose(corrected, expected, atol=1e-9)
        stamps, expected_outputs = stream(early, (live_s, live_s + 60))
        _, outputs = stream(late, (live_s, live_s + 60))
        settled = stamps > (live_s + 2) * SECOND
        gain = 1.0 + early.compensation.sensitivity
        offset = (outputs - expected_outputs)[settled] * gain
        np.testing.assert_allclose(offset, np.tile(-late.tare, (len(offset), 1)), atol=0.3)
        # Without sensitivity drift the two differ by the tare alone, whatever happens.
        np.testing.assert_allclose(offset[:, 3], -late.tare[3], atol=1e-9)

    def test_a_model_that_does_not_fit_is_refused_and_the_running_one_stays(
        self, make_model, model
    ):
        compensator = Compensator(1, StreamSettings(), model)
        stream(compensator, (0, 30))
        before = pickle.dumps(compensator)
        with pytest.raises(SettingsError, match=r'expects 2 .* node has 1 '):
            compensator.go_live(make_model(TRUTH, thermometers=2))
        assert pickle.dumps(compensator) == before
        with pytest.raises(SettingsError):
            Compensator(2, StreamSettings(), model)


class TestTare:
    def test_the_tared_wrench_reads_zero_at_once_and_without_sensitivity_drift_for_ever(
        self, make_model
    ):
        """The raw wrench drifts as the model says; what is left is the load, which was tared."""
        model = make_model({'force_z': (0.4, 0.0, 30.0)})
        compensator = Compensator(1, StreamSettings(), model)
        for k in range(200):
            stamp = k * SECOND // 2
            compensator.add_temperature(0, stamp, warming(stamp))
            zero = compensator.compensation_at(stamp).zero
            if k == 50:
                tare = compensator.set_tare(LOAD + zero, stamp)
                np.testing.assert_allclose(tare, LOAD, atol=1e-12)
            if k >= 50:
                corrected = compensator.correct(stamp, (LOAD + zero).tolist())
                np.testing.assert_allclose(corrected, 0, atol=1e-9)
        assert abs(zero[2]) > 1
        compensator.reset_tare()
        np.testing.assert_allclose(compensator.correct(stamp, (LOAD + zero).tolist()), LOAD)

    def test_a_temperature_moves_the_tare_only_to_keep_an_output_when_the_drift_begins(
        self, model
    ):
        """After a tare, or after a model went live under a wrench."""
        tared, alone, free = (Compensator(1, StreamSettings(), model) for _ in range(3))
        swapped = Compensator(1, StreamSettings())
        swapped.go_live(model, (0, LOAD.tolist()))
        tared.set_tare(LOAD, 0)
        alone.set_tare(LOAD, 0)
        for second in range(4):
            before = tared.tare
            tared.add_temperature(0, second * SECOND, 35.0, (0, LOAD.tolist()))
            assert (tared.tare != before).any() == (second == 1)
            alone.add_temperature(0, second * SECOND, 35.0)  # no wrench has come: unloaded
            for compensator in (free, swapped):
                compensator.add_temperature(0, second * SECOND, 35.0, (0, LOAD.tolist()))
        np.testing.assert_allclose(swapped.correct(4 * SECOND, LOAD.tolist()), LOAD)
        np.testing.assert_allclose(tared.correct(4 * SECOND, LOAD.tolist()), 0, atol=1e-9)
        assert swapped.tare.any()
        assert (tared.tared, swapped.tared) == (True, False), 'an offset that nobody took'
        np.testing.assert_allclose(alone.tare, tared.tare)
        assert not free.tare.any()


@pytest.mark.parametrize('thermometer', [-1, 1])
def test_a_thermometer_of_no_such_number_is_refused(make_model, thermometer):
    compensator = Compensator(1, model=make_model({'force_z': (1.0, 0.0, 10.0)}))
    with pytest.raises(SettingsError, match=f'from 0 to 0; got {thermometer}'):
        compensator.add_temperature(thermometer, 10**9, 20.0)


def test_a_recording_that_does_not_fit_is_refused(make_model, make_recording, warm_up):
    recording = make_recording(warm_up(60, 1), {'force_z': 1.0})
    slow, two = make_model(TRUTH), make_model(TRUTH, period_s=10.0, thermometers=2)
    with pytest.raises(RecordingError, match=r'^run is on .* 10\.0 s, .* on 1\.0 s\. .* model\.$'):
        track_drift(slow, recording)
    with pytest.raises(RecordingError, match=r'^run has 1 therm.*, .* expects 2\. .* with\.$'):
        track_drift(two, recording)
