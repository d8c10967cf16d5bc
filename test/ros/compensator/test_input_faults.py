"""Faults of sensor and thermometers, injected over DDS: what comes out, what is said and where."""

import math
import re

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='the node tests need ROS 2 (rclpy)')

from geometry_msgs.msg import WrenchStamped
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Temperature

from wrist_ft_comp.ros.compensator_node import CompensatorNode
from wrist_ft_comp.ros.diagnostics import diagnostics
from wrist_ft_comp.ros.messages import wrench_message
from wrist_ft_comp.stream.input_checks import SensorWatch

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
HOUR = 3600 * SECOND
OK, WARN, ERROR, STALE = b'\0', b'\1', b'\2', b'\3'
RAW = np.array([1.0, 2.0, 30.0, 0.1, 0.2, 0.3])
AXES = {'force_z': (0.5, 0.0, 300.0)}
executors = pytest.mark.parametrize('executor', ['default', 'events'])


@pytest.fixture
def log(capfd, rig):
    """Wait for words in the log; ``says`` looks only once."""
    seen = []

    def says(words):
        seen.append(capfd.readouterr().err)
        return re.search(words, ''.join(seen)) is not None

    def wait(node, words):
        node.bench.wait_until(lambda: says(words), f'{words!r} in the log')

    assert rig
    wait.says = says
    return wait


@pytest.fixture
def warm(rig, make_model):
    """Start a compensating node: 20 s at 30 °C, so force z drifts by 5 N."""

    def start(thermometers=1, **options):
        model = make_model('m.yaml', AXES, thermometers=thermometers, range_c=(15.0, 45.0))
        options.setdefault('parameters', {}).setdefault('temperature_timeout', 3600)
        options['parameters']['model_file'] = str(model.path)
        node = rig(thermometers=thermometers, **options)
        for second in range(20):
            node.warm(START + second * SECOND, *[30.0] * thermometers)
        assert node.node.compensator.compensation.zero[2] == pytest.approx(5.0)
        return node

    return start


@pytest.fixture
def quick(monkeypatch):
    """Look less often before a reading counts as suspicious, and look often."""
    monkeypatch.setattr(
        'wrist_ft_comp.stream.input_checks.SensorWatch', lambda: SensorWatch(looks=4)
    )
    monkeypatch.setattr('wrist_ft_comp.ros.compensator_node._HOUSEKEEPING_PERIOD_S', 0.01)


def unharmed(node, stamp=START + 30 * SECOND):
    """The drift is what it was, and contact still passes."""
    found = np.array(node.ask_output(stamp, RAW))
    np.testing.assert_allclose(found, RAW - [0, 0, 5.0, 0, 0, 0], atol=0.1)


def numbers(status):
    return {each.key: each.value for each in status.values}


class TestWrench:
    @executors
    def test_that_is_not_finite_is_dropped_counted_and_told(self, warm, log, executor):
        node = warm(executor=executor)

        def told(status):
            node.put(START, [0, 0, math.nan, 0, 0, 0])
            return 'unusable' in status.message

        status = node.diagnosis('input', told)
        assert (status.level, int(numbers(status)['dropped_not_finite']) > 0) == (WARN, True)
        log(node, 'input: all wrenches are unusable and dropped; check the driver')
        assert node.outputs.empty()
        unharmed(node)

    def test_that_is_malformed_is_dropped_counted_and_told(self, warm, log):
        node = warm()
        whole = serialize_message(wrench_message(START, 'tool0', RAW))

        def told(status):
            node.put_bytes(whole[:-8])
            return 'unusable' in status.message

        status = node.diagnosis('input', told)
        assert (status.level, int(numbers(status)['dropped_malformed']) > 0) == (WARN, True)
        log(node, 'input: all wrenches are unusable and dropped; check the driver')
        assert node.outputs.empty()
        unharmed(node)

    @pytest.mark.usefixtures('quick')
    def test_that_never_changes_by_a_bit_is_taken_for_frozen(self, warm, log):
        node = warm()
        stamps = iter(range(START + 20 * SECOND, START + 10**6 * SECOND, 10**6))

        def frozen(status):
            node.stream([next(stamps) for _ in range(20)], [RAW] * 20)
            return 'frozen' in status.message

        assert node.diagnosis('input', frozen).level == WARN
        log(node, 'input: the reading has not changed by a bit for seconds; is the sensor frozen')
        rng = np.random.default_rng(0)

        def well(status):
            noise = rng.normal(0, 0.01, (20, 6))
            node.stream([next(stamps) for _ in range(20)], RAW + noise)
            return status.level == OK and log.says(r'INFO.*input: \d+ wrenches per second')

        node.diagnosis('input', well)
        unharmed(node)

    @pytest.mark.usefixtures('quick')
    def test_that_stays_at_an_extreme_is_taken_for_saturated(self, warm, log):
        node = warm()
        stamps = iter(range(START + 20 * SECOND, START + 10**6 * SECOND, 10**6))
        rng = np.random.default_rng(0)

        def saturated(status):
            wrenches = RAW + rng.normal(0, 5.0, (20, 6))
            wrenches[:, 2] = np.minimum(wrenches[:, 2] + 1e3, 200.0)
            wrenches[:, 5] = 0.0  # an axis the sensor does not have
            node.stream([next(stamps) for _ in range(20)], wrenches)
            return 'saturated' in status.message

        # It has to have moved before, or it is an axis that is not there.
        moving = [1, 1, 1, 1, 1, 0] * (RAW + rng.normal(0, 5.0, (20, 6)))
        node.stream([next(stamps) for _ in range(20)], moving)
        node.bench.wait_until(lambda: node.node.health.sensor._received > 0, 'a look')
        assert node.diagnosis('input', saturated).level == WARN
        assert node.node.health.sensor.saturated == ('force_z',)
        log(node, 'input: force_z stays at its extreme; is the sensor saturated?')
        unharmed(node)

    @pytest.mark.usefixtures('quick')
    @pytest.mark.parametrize(
        ('stamps', 'words'),
        [
            ([0] * 40, 'wrenches come without stamps; the time of their arrival is taken'),
            ([START + 20 * SECOND] * 40, 'stamps stand still'),
            (range(START + 60 * SECOND, START + 20 * SECOND, -SECOND), 'stamps ran back'),
            (
                [START + k * SECOND + (k >= 40) * 5 * HOUR for k in range(20, 60)],
                'stamps leapt ahead',
            ),
        ],
        ids=['zero', 'repeated', 'backwards', 'hours ahead'],
    )
    def test_with_a_strange_stamp_is_corrected_all_the_same(self, warm, log, stamps, words):
        node = warm()
        rng = np.random.default_rng(0)
        for stamp in stamps:
            look = node.node.health.sensor._received
            found = node.ask_output(stamp, RAW + rng.normal(0, 0.001, 6))
            assert found[2] == pytest.approx(25.0, abs=0.1)
            node.bench.wait_until(lambda look=look: node.node.health.sensor._received > look, 'it')

        def told(status):
            node.ask_output(stamps[-1], RAW + rng.normal(0, 0.001, 6))
            return words in status.message

        assert node.diagnosis('input', told).level == WARN
        log(node, f'input: {words}')

    @pytest.mark.usefixtures('quick')
    def test_of_another_frame_is_told(self, warm, log):
        """A name of the same length, which no layout of bytes would tell."""
        node = warm()
        node.ask_output(START + 20 * SECOND, RAW)
        node.bench.wait_until(lambda: node.node.health.frame == 'tool0', 'a look')

        def told(status):
            node.put(START + 21 * SECOND, RAW, frame='tool1')
            (message,) = node.take()
            assert message.header.frame_id == 'tool1'
            return 'frame changed' in status.message

        status = node.diagnosis('input', told)
        assert status.message == "the frame changed from 'tool0' to 'tool1'; is it another sensor?"
        assert (status.level, numbers(status)['frame_changes']) == (WARN, '1')
        log(node, "the frame changed from 'tool0' to 'tool1'")

    def test_of_two_publishers_is_told(self, warm, log):
        node = warm()
        second = node.bench.helper.create_publisher(WrenchStamped, node.topic('wrench_raw'), 10)

        def told(status):
            node.ask_output(START + 20 * SECOND, RAW)
            return 'publishers' in status.message

        status = node.diagnosis('input', told)
        assert status.message == '2 publishers share the topic; their readings are mixed'
        assert status.level == WARN
        log(node, '2 publishers share the topic')
        node.bench.helper.destroy_publisher(second)
        node.diagnosis(
            'input',
            lambda each: node.ask_output(START + 20 * SECOND, RAW) and each.level == OK,
        )
        unharmed(node)


class TestTemperature:
    @pytest.mark.parametrize('value', [math.nan, math.inf, -273.15, 298.15, 1e9, -101.0])
    def test_that_no_sensor_reads_is_dropped_counted_and_told(self, warm, log, value):
        """0 K, kelvins, and what a broken wire gives."""
        node = warm()
        stamps = iter(range(START + 20 * SECOND, START + 10**6 * SECOND, SECOND))

        def told(status):
            node.warm(next(stamps), value)
            return 'dropped' in status.message

        status = node.diagnosis('temperature', told)
        assert status.level == WARN
        assert status.message.startswith(f'thermometer 1 reads {value:.4g} °C, which is dropped')
        assert int(numbers(status)['unusable']) > 0
        log(node, 'temperature: thermometer 1 reads .* which is dropped')
        assert node.node.compensator.tracker.temperature_c == pytest.approx([30.0])
        unharmed(node)

    def test_that_stops_leaves_the_drift_where_it_is_and_is_told(self, warm, log):
        node = warm(parameters={'temperature_timeout': 0.2})
        status = node.diagnosis('temperature', lambda each: 'silent' in each.message)
        assert status.message == 'thermometer 1 silent for more than 0.2 s; drift is held'
        log(node, 'temperature: thermometer 1 silent')
        unharmed(node, START + 10 * HOUR)

    def test_of_one_of_several_that_stops_is_held_and_the_others_go_on(self, warm, log):
        node = warm(thermometers=2, parameters={'temperature_timeout': 0.5})
        stamps = iter(range(START + 20 * SECOND, START + HOUR, SECOND))

        def told(status):
            node.put_temperature(next(stamps), 30.0)
            return '2 silent' in status.message

        status = node.diagnosis('temperature', told)
        assert status.message == 'thermometer 2 silent for more than 0.5 s; drift is held'
        log(node, 'temperature: thermometer 2 silent')
        assert node.node.compensator.tracker.grid._next > START // SECOND + 20
        unharmed(node)

    def test_that_jumps_moves_the_drift_no_faster_than_its_limit(self, warm, log):
        node = warm(parameters={'max_drift_rate': 0.01})
        for second in range(20, 26):
            node.warm(START + second * SECOND, 44.0)
        status = node.diagnosis('temperature', lambda each: 'jumped' in each.message)
        assert status.level == WARN
        assert 'thermometer 1 jumped by 14.0 K, faster than metal can' in status.message
        log(node, r'temperature: thermometer 1 jumped by 14\.0 K')
        status = node.diagnosis('output')
        assert 'drift of force_z moves at its limit (max_drift_rate)' in status.message
        log(node, 'output: drift of force_z moves at its limit')
        assert node.node.compensator.compensation.zero[2] == pytest.approx(5.05, abs=0.011)
        unharmed(node)

    def test_in_fahrenheit_is_clamped_and_the_unit_is_guessed(self, warm, log):
        node = warm()
        for second in range(20, 26):
            node.warm(START + second * SECOND, 86.0)
        status = node.diagnosis('temperature', lambda each: 'outside' in each.message)
        assert status.message == (
            'thermometer 1 outside the calibrated range; drift is less certain there, and held '
            'further out. In degrees Fahrenheit it would be inside: check the unit'
        )
        log(node, 'In degrees Fahrenheit it would be inside')
        for second in range(26, 3000):
            node.node.compensator.add_temperature(0, START + second * SECOND, 86.0)
        zero = node.node.compensator.compensation.zero[2]
        # A fifth of 15 to 45 °C beyond the range, and no further.
        assert zero == pytest.approx(0.5 * (45.0 + 6.0 - 20.0), abs=0.01)
        found = node.ask_output(START + 3000 * SECOND, RAW)
        np.testing.assert_allclose(found, RAW - [0, 0, zero, 0, 0, 0], atol=0.1)

    @pytest.mark.parametrize('leap', [5 * HOUR, -5 * HOUR], ids=['ahead', 'back'])
    def test_with_one_stray_stamp_does_not_move_the_drift(self, warm, log, leap):
        node = warm()
        memory = node.node.compensator.memory().filters['force_z'].copy()
        node.warm(START + 20 * SECOND + leap, 44.0)
        for second in range(20, 23):
            node.warm(START + second * SECOND, 30.0)
        assert node.node.compensator.tracker.timestamp_filter.strays == 1
        status = node.diagnosis('temperature', lambda each: 'was dropped' in each.message)
        assert (status.level, numbers(status)['stray_stamps']) == (WARN, '1')
        log(node, 'temperature: a temperature was dropped, because its stamp was far from those')
        np.testing.assert_allclose(node.node.compensator.memory().filters['force_z'], memory)
        unharmed(node)

    def test_whose_stamps_repeat_is_dropped_and_told(self, warm, log):
        node = warm()
        status = node.diagnosis(
            'temperature', lambda each: node.warm(START, 44.0) or 'stamps' in each.message
        )
        assert status.message == 'temperatures are dropped: their stamps do not increase'
        log(node, 'temperature: temperatures are dropped: their stamps do not increase')
        unharmed(node)

    def test_without_stamps_is_taken_at_the_node_s_time(self, warm, log):
        node = warm(parameters={'use_sim_time': True})
        clock = node.bench.publisher(Clock, '/clock')
        for second in range(20, 24):
            message = Clock()
            message.clock.sec = START // SECOND + second
            clock.publish(message)
            node.bench.wait_until(
                lambda now=message.clock.sec: node.node._now_ns() == now * SECOND, 'the clock'
            )
            node.warm(0, 30.0)
        assert node.node.compensator.tracker.grid._next == START // SECOND + 23
        status = node.diagnosis('temperature')
        words = 'thermometer 1 does not stamp its readings; the time of arrival is taken'
        assert (status.level, status.message) == (WARN, words)
        log(node, f'temperature: {words}')
        unharmed(node)
        unharmed(node)

    def test_of_a_simulation_that_begins_anew_goes_on_from_there(self, warm, log):
        node = warm()
        for second in range(5):
            node.warm(second * SECOND, 30.0)
        assert node.node.compensator.tracker.grid.restarts == 1
        words = 'stamps of temperatures leapt; was a clock set, or a simulation begun anew?'
        status = node.diagnosis('temperature', lambda each: each.message == words)
        assert (status.level, numbers(status)['stamps_restarted']) == (WARN, '1')
        log(node, 'temperature: stamps of temperatures leapt')
        unharmed(node, 10 * SECOND)

    def test_of_two_publishers_is_told(self, warm, log):
        node = warm()
        topic = node.topic('temperature')
        node.bench.helper.create_publisher(Temperature, topic, 10)
        status = node.diagnosis('temperature', lambda each: 'publishers' in each.message)
        assert status.message == 'thermometer 1 has 2 publishers; their readings are mixed'
        assert status.level == WARN
        log(node, 'temperature: thermometer 1 has 2 publishers')
        unharmed(node)


class TestQualityOfService:
    @executors
    def test_that_keeps_a_publisher_from_being_heard_is_told(
        self, bench, tmp_path, capfd, executor
    ):
        """The node was told to insist on reliable wrenches; the driver is best effort."""
        topic = f'/t_{executor}/wrench_raw'
        node = bench.start(
            CompensatorNode,
            namespace=f'/t_{executor}',
            executor=executor,
            parameters={
                'data_directory': str(tmp_path),
                f'qos_overrides.{topic}.subscription.reliability': 'reliable',
            },
        )
        best_effort = QoSProfile(depth=1, reliability=QoSReliabilityPolicy.BEST_EFFORT)
        bench.helper.create_publisher(WrenchStamped, topic, best_effort)
        bench.wait_until(lambda: 'wrench_raw' in node.health.incompatible, 'the event')
        assert node.health.incompatible == {'wrench_raw': 'reliability'}
        seen = []
        bench.wait_until(
            lambda: seen.append(capfd.readouterr().err) or 'offers less reliability' in str(seen),
            'the log',
        )
        assert diagnostics(node._snapshot())[0].message == (
            'no raw wrenches arrive: their publisher offers less reliability than is asked for'
        )

    def test_that_keeps_a_thermometer_from_being_heard_is_told(self, rig, log):
        override = 'qos_overrides./unheard/temperature.subscription.reliability'
        node = rig(namespace='/unheard', parameters={override: 'reliable'})
        best_effort = QoSProfile(depth=1, reliability=QoSReliabilityPolicy.BEST_EFFORT)
        node.bench.helper.create_publisher(Temperature, '/unheard/temperature', best_effort)
        status = node.diagnosis('temperature', lambda each: 'not heard' in each.message)
        assert status.level == WARN
        assert status.message == (
            'thermometer 1 is not heard: a publisher offers less reliability than is asked for; '
            'drift waits for it'
        )
        log(node, 'a publisher of temperature offers less reliability than is asked for')
        np.testing.assert_array_equal(node.ask_output(START, RAW), RAW)

    @executors
    def test_that_keeps_a_subscriber_from_hearing_is_told(self, warm, log, executor):
        node = warm(executor=executor)
        wants = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        node.bench.listen(WrenchStamped, node.topic('wrench'), wants)
        status = node.diagnosis('output', lambda each: 'durability' in each.message)
        assert status.level == WARN
        assert status.message == (
            'a subscriber of wrench asks for more durability than is offered and gets nothing'
        )
        log(node, 'a subscriber of wrench asks for more durability than is offered')
        unharmed(node)
