"""Faults of sensor and thermometers: what comes out, what is said and where."""

import math
import os
import re

from geometry_msgs.msg import WrenchStamped
import numpy as np
import pytest
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Temperature

from wrist_ft_comp.drift.thermometer_prediction import ThermometerPrediction
from wrist_ft_comp.node.inputs import Counts, WrenchInput
from wrist_ft_comp.ros.topics import wrench_message
from wrist_ft_comp.stream.wrench_watch import LOOKS, SensorWatch

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
HOUR = 3600 * SECOND
OK, WARN = b'\0', b'\1'
N = math.nan
RAW = np.array([1.0, 2.0, 30.0, 0.1, 0.2, 0.3])
AXES = {'force_z': (0.5, 0.0, 300.0)}
#: Two thermometers that read the same.
ALIKE = ThermometerPrediction(
    np.zeros(1), np.array([[[0.0, 1.0]], [[1.0, 0.0]]]), np.zeros(2),
    *np.array([[3], [600], [1]]) * np.ones((3, 2)))  # fmt: skip
#: The third of three is the mean of the others.
MIDDLE = ThermometerPrediction(
    np.zeros(1), np.array([[[0.0, -1.0, 2.0]], [[-1.0, 0.0, 2.0]], [[0.5, 0.5, 0.0]]]),
    np.zeros(3), *np.array([[3], [600], [1]]) * np.ones((3, 3)))  # fmt: skip
executors = pytest.mark.parametrize('executor', ['default', 'events'])


@pytest.fixture
def log(capfd):  # noqa: ARG001 -- which makes standard error a file
    """Wait for words in the log; readouterr would lose what comes while it reads."""

    def wait(node, words):
        def logged():
            return re.search(words, os.pread(2, 1 << 20, 0).decode()) is not None

        node.wait_until(logged, f'{words!r} in the log')

    return wait


@pytest.fixture
def warns(log):
    """Wait until a status warns in some words, and the log says the same; gives the status."""

    def wait(node, name, words):
        status = node.diagnosis(name, lambda s: s.level == WARN and words in s.message)
        log(node, f'{name}: .*{re.escape(words)}')
        return status

    return wait


@pytest.fixture
def warm(rig, make_model):
    """Make a compensating node: 20 s at 30 °C, so force z drifts by 5 N."""

    def start(thermometers=1, kind=rig, prediction=None, **options):
        more = {'thermometers': thermometers, 'prediction': prediction}
        model = make_model('m.yaml', AXES, range_c=(15.0, 45.0), **more)
        options.setdefault('parameters', {}).setdefault('temperature_timeout', 3600)
        node = kind(model=model, thermometers=thermometers, **options)
        node.warm_up(30.0, 20)
        assert node.node.compensator.compensation.zero[2] == pytest.approx(5.0)
        return node

    return start


@pytest.fixture
def quick(monkeypatch):
    """Look less often before a reading counts as suspicious."""
    monkeypatch.setattr('wrist_ft_comp.node.inputs.SensorWatch', lambda: SensorWatch(looks=4))


def unharmed(node, stamp=START + 30 * SECOND):
    """The drift is what it was, and contact still passes."""
    corrected = np.array(node.ask_output(stamp, RAW))
    np.testing.assert_allclose(corrected, RAW - [0, 0, 5.0, 0, 0, 0], atol=0.1)


def look_at(node, wrenches, stamps=None):
    """Send wrenches that the node looks at one by one."""
    for k, wrench in enumerate(wrenches):
        stamp = START + 20 * SECOND + k * 10**6 if stamps is None else stamps[k]
        assert node.ask_output(stamp, wrench)[2] == pytest.approx(wrench[2] - 5.0, abs=0.1)
        node.node.broadcast('poll')


def noisy(count, scale=0.01):
    return RAW + np.random.default_rng(0).normal(0, scale, (count, 6))


@pytest.mark.usefixtures('ros_domain')
def test_looks_without_a_new_wrench_do_not_count():
    data = serialize_message(wrench_message(START, 'tool0', RAW))
    wrenches = WrenchInput(Counts(wrenches=1), lambda: (START, RAW.tolist(), data))
    for _ in range(10 * LOOKS):
        wrenches.poll()
    assert wrenches.stamp_ns == START
    assert not wrenches.sensor.frozen
    assert not wrenches.sensor.stamps_stand_still


@pytest.mark.parametrize(
    ('before', 'raw', 'passes', 'counted'),
    [
        (None, [1, 2, 3, N, N, N], True, (0, 0)),
        ([1, 2, 3, N, N, N], [4, 5, 6, N, N, N], True, (0, 0)),
        ([1, 2, 3, N, N, N], [4, 5, 6, 0, N, N], True, (0, 0)),
        ([1, 2, 3, N, N, N], [4, N, 6, N, N, N], False, (1, 0)),
        ([1, 2, 3, N, N, N], [4, 5, math.inf, N, N, N], False, (1, 0)),
        ([1, 2, 3, N, N, N], [4, 5, -1e10, N, N, N], False, (0, 1)),
        ([1, 2, 3, 0, 0, 0], [4, 5, 6, N, N, N], False, (1, 0)),
        (None, [N] * 6, False, (1, 0)),
    ],
)
def test_only_axes_that_never_had_a_number_may_be_nan(before, raw, passes, counted):
    counts = Counts()
    wrenches = WrenchInput(counts, lambda: before and (START, before, b''))
    assert wrenches.admits(raw) is passes
    assert (counts.not_finite, counts.implausible) == counted


@pytest.mark.usefixtures('ros_domain')
def test_axes_without_numbers_are_named_and_the_others_are_watched():
    counts, newest = Counts(), []
    wrenches = WrenchInput(counts, lambda: newest[-1])
    for k in range(LOOKS + 1):
        raw = [1.0, 2.0, 30.0 + k, N, N, N]
        newest.append((START, raw, serialize_message(wrench_message(START, 'tool0', raw))))
        counts.wrenches += 1
        wrenches.poll()
    assert wrenches.absent == ['torque_x', 'torque_y', 'torque_z']
    assert not wrenches.sensor.frozen
    for _ in range(LOOKS + 1):
        counts.wrenches += 1
        wrenches.poll()
    assert wrenches.sensor.frozen


class TestWrench:
    def test_an_unusable_wrench_is_dropped_and_counted(self, warm, warns):
        node, whole = warm(), serialize_message(wrench_message(START, 'tool0', RAW))
        for bad in (math.nan, math.inf, -math.inf):
            node.put(START, [bad] * 6)
        node.put(START, [0, math.inf, -math.inf, 0, 0, 0])
        node.put(START, [1e10, -1e10, 0, 0, 0, 0])  # their sum is plausible
        for data in (whole[:-8], whole + bytes(8), b'\x07\x01' + whole[2:], whole[:20]):
            node.put_bytes(data)
        status = warns(node, 'input', 'all wrenches are unusable and dropped; check the driver')
        names = ('received', 'dropped_not_finite', 'dropped_implausible', 'dropped_malformed')
        assert [status.values[name] for name in names] == ['0', '4', '1', '4']
        assert node.outputs.empty()
        unharmed(node)
        node.put(START, [0, 0, math.nan, 0, 0, 0])
        words = 'some wrenches are unusable and dropped; check the driver: they are not finite'
        warns(node, 'input', words)

    @pytest.mark.usefixtures('quick')
    def test_a_wrench_that_never_changes_by_a_bit_is_taken_for_frozen(self, warm, warns, log):
        node = warm()
        look_at(node, [RAW] * 10)
        warns(
            node, 'input', 'the reading has not changed by a bit for seconds; is the sensor frozen'
        )
        look_at(node, noisy(30), [START + 21 * SECOND + k for k in range(30)])
        for k, wrench in enumerate(noisy(12)):
            look_at(node, [wrench], [START + (22 + k) * SECOND])
            assert node.diagnosis('input').level == OK
        log(node, r'INFO.*input: \d+ wrenches per second')
        unharmed(node)

    @pytest.mark.usefixtures('quick')
    def test_a_wrench_that_stays_at_an_extreme_is_taken_for_saturated(self, warm, warns):
        node = warm()
        wrenches = noisy(20, 5.0)
        wrenches[10:, 2] = 200.0
        wrenches[:, 5] = 0.0  # an axis the sensor does not have
        look_at(node, wrenches)
        warns(node, 'input', 'force_z stays at its extreme; is the sensor saturated?')
        assert node.node.wrench_input.sensor.saturated == ('force_z',)
        unharmed(node)

    @pytest.mark.usefixtures('quick')
    @pytest.mark.parametrize(
        ('stamps', 'words'),
        [
            ([0] * 40, 'wrenches come without stamps; the time of arrival is taken'),
            ([START + 20 * SECOND] * 40, 'stamps stand still'),
            (range(START + 60 * SECOND, START + 20 * SECOND, -SECOND), 'stamps ran back'),
            (
                [START + k * SECOND + (k >= 40) * 5 * HOUR for k in range(20, 60)],
                'stamps leapt ahead',
            ),
        ],
        ids=['zero', 'repeated', 'backwards', 'hours ahead'],
    )
    def test_a_wrench_with_a_strange_stamp_is_corrected(self, warm, warns, stamps, words):
        node = warm()
        look_at(node, noisy(40), stamps)
        warns(node, 'input', words)

    def test_a_wrench_without_a_stamp_or_a_clock_is_a_warning(self, warm, warns):
        node = warm(parameters={'use_sim_time': True})
        look_at(node, noisy(4), [0] * 4)
        words = 'the time of arrival is 0: use_sim_time is set, and nothing comes on /clock'
        warns(node, 'input', words)

    def test_a_wrench_of_another_frame_is_a_warning(self, warm, warns):
        """A name of the same length, which no layout of bytes would tell."""
        node = warm()
        look_at(node, [RAW])
        node.put(START + 21 * SECOND, RAW, frame='tool1')
        (message,) = node.take()
        assert message.header.frame_id == 'tool1'
        words = "the frame changed from 'tool0' to 'tool1'; is it another sensor?"
        assert warns(node, 'input', words).values['frame_changes'] == '1'

    def test_two_publishers_of_a_topic_are_a_warning(self, warm, log):
        node, stamp = warm(), START + 20 * SECOND
        for kind, topic, name, words in (
            (WrenchStamped, 'wrench_raw', 'input', '2 publishers share the topic; their readings'),
            (Temperature, 'temperature', 'temperature', 'thermometer 1 has 2 publishers; their'),
        ):
            both = [node.bench.helper.create_publisher(kind, node.topic(topic), 1) for _ in 'ab']

            def of_two(status, words=words):
                node.ask_output(stamp, RAW)
                return status.level == WARN and words in status.message

            node.diagnosis(name, of_two)
            log(node, f'{name}: {words}')
            node.bench.helper.destroy_publisher(both[0])
            node.diagnosis(name, lambda s: node.ask_output(stamp, RAW) and s.level == OK)
        unharmed(node)

    def test_a_driver_that_comes_back_is_a_warning_until_the_next_tare(self, warm, warns):
        node = warm()

        def publish():
            return node.bench.helper.create_publisher(WrenchStamped, node.topic('wrench_raw'), 1)

        first = publish()
        graph = node.node.count_publishers
        node.wait_until(lambda: graph(node.topic('wrench_raw')) == 1, 'the first driver')
        assert node.diagnosis('output').level == OK
        second = publish()
        node.wait_until(lambda: graph(node.topic('wrench_raw')) == 2, 'the second driver')
        assert node.diagnosis('output').level == OK
        node.bench.helper.destroy_publisher(first)
        warns(node, 'output', 'has left and another one came: its zero may be another one')
        node.node.compensator.set_tare(RAW, START)
        assert node.diagnosis('output').level == OK
        node.bench.helper.destroy_publisher(second)

    def test_two_nodes_of_one_name_warn_both(self, warm, monkeypatch, tmp_path):
        monkeypatch.setattr('wrist_ft_comp.node.drift_topic._TWINS_S', 0.2)
        node = warm()
        twin = warm(namespace=node.namespace, directory=tmp_path / 'other')
        for one in (node, twin):
            words = f'two nodes are called {node.namespace}/wrist_ft_comp, and both publish'
            assert one.diagnosis('output', words).level == WARN


class TestTemperature:
    @pytest.mark.parametrize(
        ('second', 'value', 'words', 'counts', 'good'),
        [
            (20, math.nan, '1 are dropped; they are not finite', {'unusable': '2'}, 3),
            (20, 298.15, 'In kelvins it would be 25.0 °C: then name it ', {'unusable': '2'}, 3),
            (20 + 18_000, 44.0, 'its stamp was far from those around', {'stray_stamps': '1'}, 3),
            (20 - 18_000, 44.0, 'its stamp was far from those around', {'stray_stamps': '1'}, 3),
            (
                20,
                85.0,
                'where metal cannot have gone from 30.0 °C; that is left out',
                {'spikes': '1'},
                3,
            ),
            (0, 44.0, 'dropped, because their stamps do not increase', {'stray_stamps': '0'}, 0),
        ],
        ids=['nan', 'kelvin', 'hours ahead', 'hours back', 'spike', 'stamp again'],
    )
    def test_one_bad_temperature_does_not_move_the_drift(  # noqa: PLR0913, PLR0917 -- a table
        self, warm, warns, second, value, words, counts, good
    ):
        node = warm()
        memory = node.node.compensator.memory().filters['force_z'].copy()
        node.diagnosis('temperature')
        node.put_temperature_bytes(0, b'\0\1\0\0 too short')
        node.warm(START + second * SECOND, value)
        node.warm_up(30.0, good, first=21)
        assert warns(node, 'temperature', words).values.items() >= counts.items()
        assert node.node.compensator.tracker.temperature_c == pytest.approx([30.0])
        np.testing.assert_allclose(node.node.compensator.memory().filters['force_z'], memory)
        unharmed(node)

    def test_a_temperature_that_stops_holds_the_drift_with_a_warning(self, warm, warns):
        node = warm(parameters={'temperature_timeout': 0.2})
        warns(node, 'temperature', 'thermometer 1 silent for more than 0.2 s; drift is held')
        unharmed(node, START + 10 * HOUR)

    def test_one_thermometer_that_stops_is_held_and_the_others_go_on(self, warm, log):
        node = warm(thermometers=2, parameters={'temperature_timeout': 0.5})
        stamps = iter(range(START + 20 * SECOND, START + HOUR, SECOND))

        def one_is_silent(status):
            node.put_temperature(next(stamps), 30.0)
            return '2 silent' in status.message

        status = node.diagnosis('temperature', one_is_silent)
        assert status.message == 'thermometer 2 silent for more than 0.5 s; drift is held'
        log(node, 'temperature: thermometer 2 silent')
        assert node.node.compensator.tracker.grid._next > START // SECOND + 20
        unharmed(node)

    def test_a_frozen_thermometer_is_replaced_with_a_warning(self, warm, warns):
        node = warm(thermometers=2, prediction=ALIKE)
        for second in range(20, 420):
            celsius = 30.0 + max(second - 60, 0) / 50
            node.warm(START + second * SECOND, celsius, min(celsius, 31.0))
        words = 'thermometer 2 stands still at 31.0 °C while the others show that it moved by 3.'
        status = warns(node, 'temperature', words)
        assert 'what the others predict of it is used until it agrees again' in status.message
        assert status.values['thermometer_2_c'] == '31.00'
        assert float(status.values['thermometer_2_believed_c']) == pytest.approx(celsius, abs=0.1)

    def test_two_of_three_that_were_silent_are_believed_after_half_an_hour(self, warm, warns):
        """The third is the mean of the others, so that one alone tells nothing of the two."""
        node = warm(3, prediction=MIDDLE, parameters={'temperature_timeout': 5.0})
        for second in range(20, 820, 10):
            node.put_temperature(START + second * SECOND, 30.0 + min(second, 400) / 100)
        status = warns(node, 'temperature', 'thermometer 3 is silent; what the others predict of')
        assert 'thermometer 2 is silent' in status.message
        believed_c = float(status.values['thermometer_2_believed_c'])
        assert believed_c == pytest.approx(34.0, abs=0.5), 'it moves along with the first'
        back, rng = second + 10, np.random.default_rng(0)
        for second in range(back, back + 3600, 10):
            ripple = rng.normal(0.0, 0.02, 3)
            node.warm(START + second * SECOND, *np.array([34.0, 36.0, 35.0]) + ripple)
        status = node.diagnosis('temperature', lambda status: 'silent' not in status.message)
        assert node.node.compensator.tracker.temperature_c == pytest.approx(
            [34.0, 36.0, 35.0], abs=0.1
        )

    def test_a_temperature_that_jumps_moves_the_drift_no_faster_than_its_limit(self, warm, warns):
        node = warm(parameters={'max_drift_rate': 0.01})
        node.warm_up(44.0, 26, first=20)
        words = 'thermometer 1 jumped by 14.0 K, faster than metal can'
        warns(node, 'temperature', words)
        warns(node, 'output', 'drift of force_z moves at its limit (max_drift_rate)')
        assert node.node.compensator.compensation.zero[2] == pytest.approx(5.05, abs=0.011)
        unharmed(node)

    def test_a_temperature_in_fahrenheit_is_clamped_and_its_unit_is_guessed(self, warm, warns):
        node = warm()
        node.warm_up(86.0, 24, first=20)
        words = (
            'thermometer 1 outside the calibrated range; drift is less certain there, and held '
            'further out. In degrees Fahrenheit it would be inside: check the unit'
        )
        warns(node, 'temperature', words)
        for second in range(44, 3000):
            node.node.compensator.add_temperature(0, START + second * SECOND, 86.0)
        zero = node.node.compensator.compensation.zero[2]
        # A fifth of 15 to 45 °C beyond the range, and no further.
        assert zero == pytest.approx(0.5 * (45.0 + 6.0 - 20.0), abs=0.01)
        answer = node.ask_output(START + 3000 * SECOND, RAW)
        np.testing.assert_allclose(answer, RAW - [0, 0, zero, 0, 0, 0], atol=0.1)

    def test_a_temperature_without_stamps_is_taken_at_the_node_s_time(self, wired, warm, warns):
        node = warm(kind=wired, parameters={'use_sim_time': True})
        clock = node.bench.publisher(Clock, '/clock')
        for second in range(20, 24):
            message = Clock()
            message.clock.sec = START // SECOND + second
            clock.publish(message)
            node.wait_until(
                lambda now=message.clock.sec: node.node.now_ns() == now * SECOND, 'the clock'
            )
            node.warm(0, 30.0)
        assert node.node.compensator.tracker.grid._next == START // SECOND + 23
        words = 'thermometer 1 does not stamp its readings; the time of arrival is taken'
        warns(node, 'temperature', words)
        unharmed(node)

    def test_the_stream_of_a_clock_that_begins_anew_goes_on_from_there(self, warm, warns):
        node = warm()
        for second in range(5):
            node.warm(second * SECOND, 30.0)
        tracker = node.node.compensator.tracker
        assert (tracker.clocks.restarts, tracker.forgot) == (1, False)
        words = 'stamps of temperatures leapt; was a clock set, or a simulation restarted?'
        assert warns(node, 'temperature', words).values['stamps_restarted'] == '1'
        unharmed(node, 10 * SECOND)


class TestQualityOfService:
    @executors
    def test_a_publisher_of_other_quality_is_a_warning(self, wired, log, executor):
        """The node insists on reliable messages; the drivers are best effort."""
        topics = {'wrench_raw': WrenchStamped, 'temperature': Temperature}
        name = f'/unheard_{executor}'
        overrides = {
            f'qos_overrides.{name}/{topic}.subscription.reliability': 'reliable'
            for topic in topics
        }
        node = wired(namespace=name, executor=executor, parameters=overrides)
        helper, best_effort = node.bench.helper, QoSReliabilityPolicy.BEST_EFFORT
        for publisher in (node._raw, *node._temperatures):
            helper.destroy_publisher(publisher)
        for topic, kind in topics.items():
            profile = QoSProfile(depth=1, reliability=best_effort)
            helper.create_publisher(kind, f'{name}/{topic}', profile)
            log(node, f'a publisher of {topic} offers less reliability than is asked for')
        assert node.node.incompatible == dict.fromkeys(topics, 'reliability')
        node.diagnosis(
            'input',
            'no raw wrenches arrive: their publisher offers less reliability than is asked for',
        )
        words = (
            'thermometer 1 is not heard: a publisher offers less reliability than is asked for; '
            'drift waits for it'
        )
        assert node.diagnosis('temperature', words).level == WARN

    @executors
    def test_a_subscriber_of_other_quality_is_a_warning(self, wired, warm, log, executor):
        node = warm(kind=wired, executor=executor)
        wants = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        node.bench.listen(WrenchStamped, node.topic('wrench'), wants)
        words = 'a subscriber of wrench asks for more durability than is offered and gets nothing'
        assert node.diagnosis('output', words).level == WARN
        log(node, 'a subscriber of wrench asks for more durability than is offered')
        unharmed(node)
