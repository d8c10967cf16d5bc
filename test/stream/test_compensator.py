"""The stream: what comes out for a wrench, when models change and when things go wrong."""

from dataclasses import replace
import pickle

import numpy as np
import pytest

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.drift.drift_model import Drift
from wrist_ft_comp.errors import RecordingError, SettingsError
from wrist_ft_comp.recording import Samples
from wrist_ft_comp.recordings.sample_checks import grid_samples
from wrist_ft_comp.stream.compensator import Compensator, StreamSettings
from wrist_ft_comp.stream.drift_limits import axis_limits, Limits
from wrist_ft_comp.stream.drift_of_recordings import correct_many, track_drift
from wrist_ft_comp.stream.drift_warnings import seldom_doubts

SECOND = 1_000_000_000
LOAD = np.array([50.0, -20.0, 100.0, 3.0, -1.0, 2.0])
#: Zero drift of force z of 0.4 N/K and of torque x; sensitivity drift of force z of 0.1 %/K.
TRUTH = {'force_z': (0.4, 1e-3, 30.0), 'torque_x': (0.01, 0.0, 5.0)}
OTHER = {'force_z': (-1.0, -2e-3, 60.0), 'force_x': (0.2, 5e-4, 10.0)}


@pytest.fixture(scope='module')
def model(make_model):
    return make_model(TRUTH)


def warming(stamp_ns):
    """0.05 K per second from 20 °C, with a faster wave."""
    seconds = stamp_ns / SECOND
    return 20.0 + 0.05 * seconds + float(np.sin(seconds / 7.0))


def stream(compensator, span_s, raw=LOAD, temperature=warming):
    """50 wrenches and 2 temperatures a second; stamps, wrenches and external ones."""
    stamps = np.arange(round(span_s[0] * 50), round(span_s[1] * 50)) * (SECOND // 50)
    outputs, newest = [], None
    for k, stamp in enumerate(stamps.tolist()):
        if k % 25 == 0:
            for j in range(compensator.thermometers):
                compensator.add_temperature(j, stamp, temperature(stamp), newest)
        newest = stamp, raw.tolist()
        outputs.append(compensator.correct(*newest) + compensator.correct(*newest, external=True))
    return stamps, np.array(outputs)


def newest_before(second):
    """What ``stream`` sent last, until a second."""
    return round(second * SECOND) - SECOND // 50, LOAD.tolist()


def steps(outputs):
    return np.abs(np.diff(outputs, axis=0)).max(axis=0)


def test_the_output_is_the_equation_with_the_drift_of_its_time(model):
    compensator = Compensator(1, StreamSettings(), model)
    compensator.restore_tare(LOAD / 2, LOAD / 4, tared=True)
    stamps, outputs = stream(compensator, (0, 120))
    temperatures = np.arange(240) * SECOND // 2
    celsius = np.array([[warming(stamp)] for stamp in temperatures.tolist()])
    raw = np.tile(LOAD, (len(stamps), 1))
    both = Samples(('temperature_c',), temperatures, celsius), Samples(AXES, stamps, raw)
    recording = grid_samples(both)
    expected = correct_many(track_drift(model, recording), stamps, raw, LOAD / 2)
    settled = stamps >= 2 * SECOND
    np.testing.assert_allclose(outputs[settled, :6], expected[settled], atol=1e-6)
    assert np.ptp(outputs[settled, 2]) > 1.5


@pytest.mark.parametrize('silent_s', [1, 600])
def test_a_clock_that_is_set_leaves_the_thermal_state(make_model, silent_s):
    model, drifts = make_model({'force_z': (2.0, 0.0, 600.0)}, thermometers=2), []
    for moved_s in (0, -50_000, -30, 8, 90):
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
    assert drifts == pytest.approx(5 * drifts[:1], abs=0.03)


def test_wrong_first_readings_are_forgotten_and_it_is_said(make_model):
    compensator = Compensator(2, model=make_model({'force_z': (2.0, 0.0, 600.0)}, thermometers=2))
    for second in range(100):
        compensator.add_temperature(0, second * SECOND, 27.0)
        compensator.add_temperature(1, second * SECOND, 0.0 if second < 15 else 27.0)
    assert compensator.tracker.forgot
    assert 'readings of thermometer 2, such as 0.0 °C, were wrong' in compensator.tracker.origin
    assert compensator.tracker.drift.zero[2] == pytest.approx(14.0)


def test_cells_of_a_minute_are_said_to_be_behind(make_model):
    model = make_model({'force_z': (2.0, 0.0, 1.0)}, period_s=60.0)
    compensator = Compensator(1, model=model)
    for second in range(600):
        compensator.add_temperature(0, second * SECOND, 20.0 + second / 120.0)  # 1 N a minute
    (doubt,) = seldom_doubts(compensator.tracker, compensator.moves)
    assert 'followed every 60 s, so that the drift of force_z may be 1 N behind' in doubt
    compensator.tracker.model = replace(model, deviation={'force_z': 0.5})
    assert not seldom_doubts(compensator.tracker, compensator.moves), 'within what it states'


@pytest.mark.parametrize('rounded_k', [0.0, 0.5])
def test_seldom_reports_are_followed_on_a_ramp_and_said_how_far_behind(make_model, rounded_k):
    """1 K, or 2 N, in 30 s: reported each 30 s, or when it has changed by half a kelvin."""
    compensator = Compensator(1, model=make_model({'force_z': (2.0, 0.0, 1.0)}))
    drifts, last_c = [], 0.0
    for second in range(600):
        celsius = 20.0 + second / 30.0
        if rounded_k:
            celsius = round(celsius / rounded_k) * rounded_k
        if celsius != last_c and (rounded_k or second % 30 == 0):
            compensator.add_temperature(0, second * SECOND, celsius, arrival_ns=second * SECOND)
            last_c = celsius
        drifts.append(compensator.compensation_at(second * SECOND).zero[2])
        if second > 200:
            behind = compensator.moves[0][2]
            spacing_s = 15 if rounded_k else 30
            assert abs(2.0 * second / 30.0 - drifts[-1]) <= behind + 0.1 < 2.3 * spacing_s / 15
            (doubt,) = seldom_doubts(compensator.tracker, compensator.moves)
            assert f'is followed every {spacing_s} s' in doubt
            assert f'force_z may be {behind:.2g} N behind' in doubt
    assert np.abs(np.diff(drifts))[200:].max() < 0.1, 'a step of 2 N otherwise'
    assert not compensator.limits.too_fast


@pytest.mark.parametrize('timeout_s', [5.0, 3600.0])
def test_one_that_reports_each_second_is_followed_beside_a_seldom_one(make_model, timeout_s):
    """The first warms by 1 K, or 1 N, a minute; the second is read each five minutes."""
    model = make_model({'force_z': (2.0, 0.0, 1.0)}, thermometers=2)
    compensator = Compensator(2, StreamSettings(temperature_timeout_s=timeout_s), model)
    for second in range(2000):
        compensator.add_temperature(0, second * SECOND, 20.0 + second / 60)
        if second % 300 == 0:
            compensator.add_temperature(1, second * SECOND, 20.0)
        drift_n = compensator.compensation_at(second * SECOND).zero[2]
        assert second < 12 or second / 60 - drift_n < 0.05


def test_clocks_that_are_set_back_are_followed_however_long_a_silence_is_allowed(make_model):
    model = make_model({'force_z': (1.0, 0.0, 1.0)})
    compensator = Compensator(1, StreamSettings(temperature_timeout_s=3600.0), model)
    for second in range(0, 1200, 20):
        at = (2000 + second - 1500 * (second >= 600)) * SECOND
        compensator.add_temperature(0, at, 20.0 + second / 60, arrival_ns=second * SECOND)
        compensator.correct(at, LOAD.tolist())
    assert compensator.compensation_at(at + 30 * SECOND).zero[2] == pytest.approx(20.0, abs=1.0)


@pytest.mark.parametrize(('first_s', 'until_s'), [(1, 300), (60, 3000)], ids=['dead', 'seldom'])
def test_of_seldom_ones_all_reports_count_and_the_drift_moves_on_ramps(
    make_model, first_s, until_s
):
    model = make_model({'force_z': (2.0, 0.0, 1.0)}, thermometers=2)
    compensator = Compensator(2, StreamSettings(temperature_timeout_s=300.0), model)
    cells, drifts = [], []
    for second in range(3000):
        if second % first_s == 0 and second < until_s:
            cells += compensator.add_temperature(0, second * SECOND, 20.0 + second / 60)
        if second % 60 == 5:
            cells += compensator.add_temperature(1, second * SECOND, 20.0 + second / 60)
        drifts.append(compensator.compensation_at(second * SECOND).zero[2])
    reports = np.sum([cell.measured for cell in cells], axis=0)
    assert reports.tolist() == pytest.approx([until_s / first_s, 50], abs=6)
    assert np.abs(np.diff(drifts))[600:].max() < 0.1
    assert drifts[-1] > 45.0


def test_the_force_path_has_no_memory(model):
    compensator = Compensator(1, StreamSettings(), model)
    stream(compensator, (0, 10))
    before = pickle.dumps(compensator)
    for wrench in (LOAD, 1e4 * LOAD, np.full(6, np.nan)):
        for stamp in (0, 10 * SECOND, 12 * SECOND):
            compensator.correct(stamp, wrench.tolist())
    assert pickle.dumps(compensator) == before


@pytest.mark.parametrize('sign', [-1.0, 1.0])
def test_a_drift_moves_as_far_as_its_rate_allows_in_the_time(sign):
    limits, drift = Limits(200.0, 2.0), Drift(np.arange(6.0), np.full(6, 0.1))
    for share, reached, too_fast in ((0.9, 0.9, ()), (1.0, 1.0, ()), (1e3, 1.0, AXES)):
        rates = sign * 2.5 * axis_limits(2.0), sign * 2.5 * 0.01
        target = Drift(*(part + share * rate for part, rate in zip(drift, rates, strict=True)))
        moved = limits.rate_limit(target, drift, 2.5)
        np.testing.assert_allclose(moved.zero - drift.zero, reached * rates[0])
        np.testing.assert_allclose(moved.sensitivity - 0.1, reached * rates[1])
        assert limits.too_fast == too_fast


def test_a_drift_is_as_large_as_its_limit_at_most_and_nothing_where_it_is_no_number():
    limits, largest = Limits(30.0, 1.0), Drift([30.0] * 3 + [3.0] * 3, [0.5] * 6)
    for share, reached in ((-1e3, -1), (0.9, 0.9), (1, 1), (np.inf, 1)):
        target = Drift(*(share * np.array(part) for part in largest))
        for part, limit in zip(limits.saturate(target), largest, strict=True):
            np.testing.assert_allclose(part, reached * np.array(limit))
        assert limits.too_large == (AXES if abs(share) > 1 else ())
    one = np.where(np.arange(6) == 3, np.nan, 1.0)
    np.testing.assert_array_equal(limits.saturate(Drift(one, one / 4)).zero, [1, 1, 1, 0, 1, 1])
    assert limits.too_large == ('torque_x',)


def test_thermometers_that_report_each_second_are_followed_within_one(make_model):
    compensator = Compensator(1, model=make_model({'force_z': (2.0, 0.0, 1.0)}))
    for second in (*range(40), *(k for k in range(100, 200) if k % 4)):
        compensator.add_temperature(0, second * SECOND, 20.0 + second / 1000)
        assert seldom_doubts(compensator.tracker, compensator.moves) == []
        begun = compensator.compensation_at((second + 1) * SECOND).zero
        np.testing.assert_array_equal(begun, compensator.compensation.zero)


class TestModelSwap:
    @pytest.mark.parametrize('tared', [False, True])
    @pytest.mark.parametrize(
        ('when_s', 'period_s'), [(40.0, 1.0), (40.5, 1.0), (40.99, 0.5), (40.2, 2.0), (40.0, None)]
    )
    def test_going_live_moves_no_loaded_output(self, make_model, model, when_s, period_s, tared):
        other = make_model(OTHER, period_s=period_s) if period_s else None
        compensator = Compensator(1, StreamSettings(), model)
        stream(compensator, (0, 30))
        if tared:
            compensator.set_tare(LOAD / 2, 30 * SECOND, LOAD / 4)
        _, before = stream(compensator, (30, when_s))
        compensator.go_live(other, newest_before(when_s))
        assert compensator.model is other
        _, after = stream(compensator, (when_s, 80))
        both = np.concatenate((before, after))
        calm = np.maximum(steps(before), steps(after))
        assert (steps(both) <= calm + 1e-9).all()
        assert (np.ptp(after[:, 2]) > 0.5) == (other is not None)

    @pytest.mark.parametrize('live_s', [10.5, 63.2, 200.0])
    def test_a_model_that_goes_live_later_has_the_drift_of_one_from_the_start(self, model, live_s):
        early = Compensator(1, StreamSettings(), model)
        late = Compensator(1, StreamSettings())
        stream(early, (0, live_s))
        stream(late, (0, live_s))
        late.go_live(model, newest_before(live_s))
        assert late.compensating
        np.testing.assert_allclose(late.compensation, early.compensation, atol=1e-9)
        _, expected = stream(early, (live_s, live_s + 60))
        _, outputs = stream(late, (live_s, live_s + 60))
        # Without sensitivity drift the two differ by the tare alone, whatever happens.
        np.testing.assert_allclose((outputs - expected)[100:, 3], -late.tare[3], atol=1e-9)

    @pytest.mark.parametrize(('period_s', 'silent_s'), [(1.0, 0), (2.0, 0), (0.5, 90), (7.0, 600)])
    def test_a_thermometer_that_died_is_not_waited_for_by_another_model(
        self, make_model, period_s, silent_s
    ):
        """Also where the others are silent while it goes live."""
        axes = {'force_z': (1.0, 0.0, 0.1)}
        first, other = (make_model(axes, thermometers=2, period_s=s) for s in (1.0, period_s))
        compensator = Compensator(2, StreamSettings(), first)

        def heat(seconds, *thermometers):
            for second in seconds:
                for j in thermometers:
                    compensator.add_temperature(j, second * SECOND, 20.0 + second / 100)

        heat(range(100), 0, 1)
        heat(range(100, 300), 0)
        compensator.go_live(other)
        heat(range(300 + silent_s, 700 + silent_s), 0)
        last_c = compensator.tracker.temperature_c
        assert last_c == pytest.approx([27.0 + silent_s / 100, 21.0], abs=0.2)
        assert compensator.memory().silent[1] * period_s == pytest.approx(600 + silent_s, abs=20)
        assert ('thermal state is' in compensator.tracker.origin) == (silent_s == 600)

    def test_what_does_not_fit_changes_nothing(self, make_model, make_recording, warm_up, model):
        compensator = Compensator(1, StreamSettings(), model)
        stream(compensator, (0, 30))
        before, recording = pickle.dumps(compensator), make_recording(warm_up(60, 1), {})
        two = make_model(TRUTH, thermometers=2)
        for refused, error, words in (
            (lambda: compensator.go_live(two), SettingsError, 'expects 2 .* node has 1 '),
            (lambda: compensator.add_temperature(1, 9, 20.0), SettingsError, '0 to 0; got 1'),
            (lambda: track_drift(model, recording), RecordingError, r'10\.0 s, .* on 1\.0 s'),
            (lambda: Compensator(2, None, model), SettingsError, 'expects 1 .* node has 2 '),
        ):
            with pytest.raises(error, match=words):
                refused()
        assert pickle.dumps(compensator) == before


class TestTare:
    def test_the_tared_wrench_reads_zero_at_once_and_without_gain_drift_for_ever(self, make_model):
        model = make_model({'force_z': (0.4, 0.0, 30.0)})
        compensator = Compensator(1, StreamSettings(), model)
        for k in range(200):
            stamp = k * SECOND // 2
            compensator.add_temperature(0, stamp, warming(stamp))
            zero = compensator.compensation_at(stamp).zero
            if k == 50:
                tare = compensator.set_tare(LOAD + zero, stamp, LOAD / 4)
                np.testing.assert_allclose(tare, LOAD, atol=1e-12)
                external = compensator.correct(stamp, (LOAD + zero).tolist(), external=True)
                np.testing.assert_allclose(external, LOAD / 4, atol=1e-12)
            if k >= 50:
                corrected = compensator.correct(stamp, (LOAD + zero).tolist())
                np.testing.assert_allclose(corrected, 0, atol=1e-9)
        assert abs(zero[2]) > 1
        compensator.reset_tare()
        np.testing.assert_allclose(compensator.correct(stamp, (LOAD + zero).tolist()), LOAD)

    @pytest.mark.parametrize(('late_s', 'doubts'), [(20, 0), (60, 1)])
    def test_a_tare_long_before_the_temperatures_is_doubted(self, model, late_s, doubts):
        compensator = Compensator(1, StreamSettings(), model)
        compensator.set_tare(LOAD, 0)
        for second in range(late_s, late_s + 10):
            compensator.add_temperature(0, second * SECOND, 35.0, (0, LOAD.tolist()))
        assert len(compensator.zero_doubts) == doubts
        compensator.set_tare(LOAD, (late_s + 10) * SECOND)
        assert compensator.zero_doubts == []

    @pytest.mark.parametrize(('tared_s', 'off_n'), [(3, 24.0), (9, 0.0)])
    def test_a_tare_by_first_readings_that_were_wrong_is_doubted(self, make_model, tared_s, off_n):
        model = make_model({'force_z': (0.4, 0.0, 30.0)})
        compensator = Compensator(1, StreamSettings(max_drift_rate_n_s=10.0), model)
        for second in range(60):
            celsius = 85.0 if second < 4 else 25.0
            compensator.add_temperature(0, second * SECOND, celsius, (0, LOAD.tolist()))
            if second == tared_s:
                compensator.set_tare(LOAD, second * SECOND)
        assert np.ptp(compensator.correct(60 * SECOND, LOAD.tolist())) == pytest.approx(off_n)
        assert ['read 85.0 °C' in why for why in compensator.zero_doubts] == [True] * (off_n > 0)

    def test_a_tare_while_the_drift_moves_at_its_limit_ends_that(self, make_model):
        model = make_model({'force_z': (0.4, 0.0, 30.0)})
        compensator = Compensator(1, StreamSettings(max_drift_rate_n_s=0.05), model)
        for second in range(300):
            compensator.add_temperature(0, second * SECOND, 20.0 + min(second, 20))
            raw = LOAD + compensator.tracker.drift.zero
            off = np.abs(compensator.correct(second * SECOND, raw.tolist())).max()
            if second == 150:
                assert abs(off - LOAD.max()) > 0.5
                compensator.set_tare(raw, second * SECOND)
            assert second <= 150 or off < 0.01

    @pytest.mark.parametrize(('waited_s', 'doubts'), [(20, 0), (60, 1), (None, 1)])
    def test_a_tare_long_before_the_model_is_doubted(self, model, waited_s, doubts):
        compensator = Compensator(1, StreamSettings())
        if waited_s is None:
            compensator.restore_tare(LOAD, LOAD, tared=True, before_drift=True)
        stream(compensator, (0, 100))
        if waited_s:
            compensator.set_tare(LOAD, (100 - waited_s) * SECOND)
        compensator.go_live(model, newest_before(100))
        said = ['before the model went live' in why for why in compensator.zero_doubts]
        assert sum(said) == doubts

    @pytest.mark.parametrize(('taken_s', 'doubts'), [(10, 1), (None, 0)])
    def test_a_tare_holds_what_axes_drifted_of_which_the_model_before_knew_nothing(
        self, make_model, model, taken_s, doubts
    ):
        compensator = Compensator(1, StreamSettings(), make_model({'force_x': (0.4, 0.0, 30.0)}))
        stream(compensator, (0, 100))
        if taken_s:
            compensator.set_tare(LOAD, taken_s * SECOND)
        compensator.go_live(model, newest_before(100))
        said = ['knew nothing of force_z' in why for why in compensator.zero_doubts]
        assert sum(said) == doubts

    def test_a_tare_while_a_thermometer_is_silent_is_doubted(self, make_model):
        model = make_model({'force_z': (0.4, 0.0, 30.0)}, thermometers=2)
        compensator = Compensator(2, StreamSettings(temperature_timeout_s=300.0), model)
        for second in range(500):
            for j in (0,) if 100 <= second < 400 else (0, 1):
                compensator.add_temperature(j, second * SECOND, 20.0 + second / 100)
            if second in {120, 300, 405, 499}:
                compensator.set_tare(LOAD, second * SECOND)
                said = ['thermometer 2 was silent' in why for why in compensator.zero_doubts]
                assert any(said) == (second == 300)
        compensator.set_tare(LOAD, 600 * SECOND)
        said = ['before the next temperatures' in why for why in compensator.zero_doubts]
        assert any(said), 'for a restart, too'

    def test_a_tare_while_all_are_silent_waits_though_one_of_them_always_pauses(self, make_model):
        model = make_model({'force_z': (0.4, 0.0, 30.0)}, thermometers=2)
        compensator = Compensator(2, StreamSettings(), model)
        for second in (*range(600), *range(690, 700)):
            for j in (0,) if second % 60 else (0, 1):
                compensator.add_temperature(j, second * SECOND, 20.0 + second / 100)
            if second == 599:
                compensator.set_tare(LOAD, 640 * SECOND)
        assert any('holds what drifted since' in why for why in compensator.zero_doubts)

    @pytest.mark.parametrize('timeout_s', [5.0, 300.0])
    def test_of_few_reports_temperature_timeout_says_how_long_a_pause_is(self, model, timeout_s):
        compensator = Compensator(1, StreamSettings(temperature_timeout_s=timeout_s), model)
        for second in (0, 1, 5):  # reports when it has changed
            compensator.add_temperature(0, second * SECOND, 20.0 + second / 10)
        compensator.set_tare(LOAD, 200 * SECOND)
        assert bool(compensator.zero_doubts) == (timeout_s < 200)

    def test_a_model_of_longer_cells_goes_on_from_the_history(self, make_model):
        fine, coarse = (make_model({'force_z': (0.4, 0.0, 900.0)}, period_s=s) for s in (1, 10))
        compensator = Compensator(1, StreamSettings(), fine)
        for second in range(1800):
            compensator.add_temperature(0, second * SECOND, 20.0 + second / 100)
        before = compensator.tracker.drift.zero[2]
        compensator.go_live(coarse, (1800 * SECOND, LOAD.tolist()))
        assert compensator.tracker.drift.zero[2] == pytest.approx(before, rel=0.02)

    def test_a_tare_within_two_long_cells_of_a_warm_start_is_doubted(self, make_model):
        model = make_model({'force_z': (1.0, 0.0, 1200.0)}, period_s=600, range_c=(20.0, 50.0))
        compensator = Compensator(1, model=model)
        for second in range(0, 3000, 5):
            compensator.add_temperature(0, second * SECOND, 40.0)
            if second == 900:
                compensator.set_tare(LOAD, second * SECOND)
        assert ['the tare was taken while' in why for why in compensator.zero_doubts] == [True]

    @pytest.mark.parametrize('back', [True, False])
    def test_thermometers_that_were_exchanged_are_said_until(self, make_model, back):
        model = make_model({'force_z': (0.4, 0.0, 30.0)}, thermometers=2)
        compensator = Compensator(2, model=model)
        for second in range(900):
            exchanged = second >= 300 and not (back and second >= 600)
            for j in (0, 1):
                apart_k = 8.0 - 4.0 * min(max(second - 400, 0) / 100, 1)  # they come nearer
                compensator.add_temperature(j, second * SECOND, 28.0 - apart_k * (j == exchanged))
            if second == 650 and not back:
                compensator.reset_tare()
            if second in {400, 700}:
                compensator.set_tare(LOAD, second * SECOND)
            if second in {399, 500, 800}:
                said = '1 and 2 jumped at once, one up as far' in ''.join(compensator.zero_doubts)
                assert said == (second < 600)

    @pytest.mark.parametrize(('before', 'after'), [(1, 0), (0, 1), (0, 0)])
    def test_thermometers_that_are_exchanged_while_the_node_is_off_are_said(
        self, make_model, before, after
    ):
        model = make_model({'force_z': (0.4, 0.0, 30.0)}, thermometers=2)
        first, second = (Compensator(2, model=model) for _ in range(2))
        for compensator, order, begin in ((first, before, 0), (second, after, 400)):
            for at in range(begin, begin + 100):
                for j in (0, 1):
                    celsius = 28.0 - 8.0 * (j == order) + at / 400
                    compensator.add_temperature(j, at * SECOND, celsius)
            if begin == 0:
                second.resume(first.memory(), 0.0)
        said = '1 and 2 jumped at once, one up as far' in ''.join(second.zero_doubts)
        assert said == (before != after)

    def test_a_drift_that_lags_is_tared_by_the_model_and_doubted_at_a_change(self, model):
        compensator = Compensator(1, StreamSettings(max_drift_rate_n_s=0.01), model)
        for second in range(60):
            compensator.add_temperature(0, second * SECOND, 20.0 + second)
        at = 59 * SECOND
        np.testing.assert_array_equal(compensator.tared_with(at), compensator.target)
        assert np.abs(compensator.target.zero - compensator.compensation_at(at).zero).max() > 1
        compensator.go_live(replace(model, day_limits={}), (at, LOAD.tolist()))
        assert 'lagged behind when the model was changed' in compensator.zero_doubts[0]

    def test_a_tare_is_kept_by_cells_of_its_own_time(self, model):
        compensator = Compensator(1, StreamSettings(), model)
        stream(compensator, (0, 60))
        compensator.set_tare(LOAD, 400 * SECOND)
        for at in (60 * SECOND, 61 * SECOND, *range(410 * SECOND, 425 * SECOND, SECOND)):
            compensator.add_temperature(0, at, warming(at), (at, LOAD.tolist()))
        np.testing.assert_allclose(compensator.correct(at, LOAD.tolist()), 0, atol=0.1)

    def test_a_temperature_moves_the_tare_only_to_keep_an_output_as_the_drift_begins(self, model):
        tared, alone, free = (Compensator(1, StreamSettings(), model) for _ in range(3))
        swapped = Compensator(1, StreamSettings())
        swapped.go_live(model, (0, LOAD.tolist()))
        tared.set_tare(LOAD, 0, LOAD / 4)
        alone.set_tare(LOAD, 0, LOAD / 4)
        for second in range(4):
            before = tared.tare
            tared.add_temperature(0, second * SECOND, 35.0, (0, LOAD.tolist()))
            assert (tared.tare != before).any() == (second == 1)
            alone.add_temperature(0, second * SECOND, 35.0)  # no wrench has come: unloaded
            for compensator in (free, swapped):
                compensator.add_temperature(0, second * SECOND, 35.0, (0, LOAD.tolist()))
        np.testing.assert_allclose(swapped.correct(4 * SECOND, LOAD.tolist()), LOAD)
        np.testing.assert_allclose(tared.correct(4 * SECOND, LOAD.tolist()), 0, atol=1e-9)
        external = tared.correct(4 * SECOND, LOAD.tolist(), external=True)
        np.testing.assert_allclose(external, LOAD / 4)
        assert swapped.tare.any()
        assert (tared.tared, swapped.tared) == (True, False), 'an offset that nobody took'
        np.testing.assert_allclose(alone.tare, tared.tare)
        assert not free.tare.any()


def test_doubts_of_two_thermometers_stay_apart():
    compensator, doubts = Compensator(1), [f'thermometer {j} was silent' for j in (1, 2)]
    for why in doubts * 2:
        compensator.doubt_zero(why)
    assert compensator.zero_doubts == doubts


@pytest.mark.parametrize('load_n', [0.0, 80.0])
def test_another_gain_that_goes_live_under_a_load_doubts_the_tare(make_model, load_n):
    compensator = Compensator(1, model=make_model({'force_z': (0.0, 0.0, 1e-9)}))
    for second in range(3):
        compensator.add_temperature(0, second * SECOND, 40.0)
    compensator.set_tare(np.zeros(6), 2 * SECOND)
    model = make_model({'force_z': (0.0, 0.0009, 1e-9)})
    compensator.go_live(model, (2 * SECOND, [0.0, 0.0, 1.018 * load_n, 0.0, 0.0, 0.0]))
    assert any('under a load' in why for why in compensator.zero_doubts) == (load_n > 0)
