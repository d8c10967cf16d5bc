"""Faults of sensor and thermometers: what comes out, what is said and where."""

import math
import os
import re
import threading
from types import SimpleNamespace

from geometry_msgs.msg import WrenchStamped
from moments import OK, SECOND, START, WARN
import numpy as np
import pytest
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Temperature

from wrist_ft_comp.drift.drift_model import ThermometerPrediction
from wrist_ft_comp.node import raw_wrench
from wrist_ft_comp.node.raw_wrench import Counts, WrenchInput
from wrist_ft_comp.ros.topics import wrench_message
from wrist_ft_comp.stream.compensator import Compensator
from wrist_ft_comp.wire.cdr import WRENCH

HOUR = 3600 * SECOND
N = math.nan
RAW = np.array([1.0, 2.0, 30.0, 0.1, 0.2, 0.3])
AXES = {'force_z': (0.5, 0.0, 300.0)}
#: Two thermometers that read the same.
ALIKE = ThermometerPrediction(
    np.zeros(1), np.array([[[0.0, 1.0]], [[1.0, 0.0]]]), np.zeros(2),
    *np.array([[3], [600], [6]]) * np.ones((3, 2)))  # fmt: skip


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
    models = []

    def start(thermometers=1, kind=rig, prediction=None, **options):
        more = {'thermometers': thermometers, 'prediction': prediction}
        if not models:
            models.append(make_model('m.yaml', AXES, range_c=(15.0, 45.0), **more))
        options.setdefault('parameters', {}).setdefault('temperature_timeout', 3600)
        node = kind(model=models[0], thermometers=thermometers, **options)
        node.warm_up(30.0, 20)
        assert node.node.compensator.compensation.zero[2] == pytest.approx(5.0)
        return node

    return start


def unharmed(node, stamp=START + 30 * SECOND):
    """The drift is what it was, and contact still passes."""
    corrected = np.array(node.ask_output(stamp, RAW))
    np.testing.assert_allclose(corrected, RAW - [0, 0, 5.0, 0, 0, 0], atol=0.1)


def noisy(count, scale=0.01):
    return RAW + np.random.default_rng(0).normal(0, scale, (count, 6))


def held(axis, value, first, count):
    """Wrenches of which an axis stays at a value from one of them on."""
    wrenches = noisy(count, 5.0)
    wrenches[first:, axis] = value
    return wrenches


STAMPS = START + SECOND * np.arange(160)
#: Wrenches, their stamps, the frame from the tenth on, the level, and what is said.
LOOKED_AT = {
    'well': (noisy(80), STAMPS, 'tool0', OK, 'wrenches per second'),
    'frozen': ([RAW] * 80, STAMPS, 'tool0', WARN, 'not changed by a bit for seconds; is the sens'),
    'dies': (held(3, 0.0, 90, 160), STAMPS, 'tool0', WARN, 'torque_x repeats one value to the la'),
    'dead': (held(2, 0.0, 0, 80), STAMPS, 'tool0', WARN, 'force_z never read anything but'),
    'not there': (held(2, math.nan, 0, 80), STAMPS, 'tool0', WARN, 'force_z never read anything'),
    'missing': (held(3, 0.0, 0, 80), STAMPS, 'tool0', OK, '; torque_x never read anything but 0'),
    'unstamped': (noisy(40), 0 * STAMPS, 'tool0', WARN, 'without stamps; the time of arrival is'),
    'repeated': (noisy(40), START + 0 * STAMPS, 'tool0', WARN, 'stamps stand still; the correct'),
    'two drivers': (noisy(40), STAMPS, 'tool0', WARN, '2 publishers share the topic; their'),
    'moved': (noisy(40), STAMPS, 'tool1', WARN, 'frame_id was tool0 and is tool1 now'),
    'by turns': (noisy(40), STAMPS, 'tool0 or tool1', WARN, 'tool0 and tool1 come by turns, and'),
    'nameless': (noisy(40), STAMPS, '', WARN, 'frame_id was tool0 and is empty now'),
    'a chain': (noisy(40), STAMPS, 'tool0', WARN, 'comes from another compensator, /a/wrist'),
}  # fmt: skip


def test_a_force_that_comes_late_because_the_node_is_too_slow_is_said(wired, monkeypatch):
    node = wired(executor='events')
    correct, ended = node.node.compensator.correct, threading.Event()

    def correct_late(stamp, raw):
        if not ended.wait(0.02):
            node.put(stamp + SECOND, raw)  # for each that was corrected another one has come
        return correct(stamp, raw)

    monkeypatch.setattr(node.node.compensator, 'correct', correct_late)
    for k in range(20):
        node.put(START + k, RAW)
    late = node.diagnosis('input', lambda status: 'wrenches wait 0.' in status.message)
    assert late.level == WARN
    ended.set()
    node.diagnosis('input', lambda status: 'wrenches wait' not in status.message)


class Watched:
    """The part that looks at raw wrenches, beside a fake hub, with a clock and a compensator."""

    def __init__(self, fake_hub, monkeypatch):
        self.counts, self.stream, self.now_s = Counts(), Compensator(1), 0.0
        clock = SimpleNamespace(monotonic=lambda: self.now_s)
        monkeypatch.setattr(raw_wrench, 'time', clock)
        self.part = WrenchInput(self.counts, self.stream)
        self.hub = fake_hub(self.part)

    def send(self, stamp, wrench, arrival=0):
        """Let a wrench come, of the time of its arrival where it has no stamp."""
        data = serialize_message(wrench_message(stamp, self.hub.frame, wrench))
        self.counts.before = self.counts.newest
        self.counts.newest = stamp or arrival, list(wrench), data
        self.counts.wrenches += 1


@pytest.fixture
def watched(ros_domain, fake_hub, monkeypatch):  # noqa: ARG001
    return Watched(fake_hub, monkeypatch)


@pytest.mark.parametrize('name', LOOKED_AT)
def test_what_the_newest_wrenches_show_is_said(watched, name):
    wrenches, stamps, frame, level, words = LOOKED_AT[name]
    part, hub = watched.part, watched.hub
    watched.stream.tracker.model = SimpleNamespace(axes={'force_z': 1})
    hub.types['/wrench_raw'] = [WRENCH] * (2 if name == 'two drivers' else 1)
    hub.types['/driver/drift'], hub.types['/a/wrist_ft_comp/drift'] = [], [WRENCH]
    hub.publisher = '/a/wrist_ft_comp' if name == 'a chain' else '/driver'
    for k, (wrench, stamp) in enumerate(zip(wrenches, stamps.tolist(), strict=False)):
        by_turns = frame.split(' or ')
        hub.frame = by_turns[k % len(by_turns)] if k >= 10 else 'tool0'
        watched.send(stamp, wrench, START + k)
        if k % len(by_turns):
            continue  # every look meets the same one of two
        for _ in range(3):  # looks without a new wrench do not count
            part.poll()
    (found,) = part.statuses()
    assert (found.level, words in found.message) == (level, True), found.message
    # A restart forgets which frame was the first one, but no doubt of the tare.
    doubts = [why for why in watched.stream.zero_doubts if why.startswith('frame_id changed from')]
    assert len(doubts) == (name in {'moved', 'nameless'})


@pytest.mark.parametrize(('stamped_s', 'looks', 'is_said'), [
    (20, 40, True), (1, 40, False), (0, 40, True), (-1, 40, True), (4000, 40, True),
    (20, 0, False), ('first', 40, True), ('first, not tared', 40, False),
])  # fmt: skip
def test_a_silent_sensor_may_have_another_zero(watched, stamped_s, looks, is_said):
    """
    A simulation that was held up goes on with the next stamp; a node may be held up itself.

    A tare from before a restart is in doubt where the first wrench comes late.
    """
    if stamped_s != 'first, not tared':
        watched.stream.set_tare(RAW, START)
    first = isinstance(stamped_s, str)
    for at_s, stamp_s in [(20, 0)] if first else ((0, 0), (1, 1), (21, 1 + stamped_s)):
        for look_s in np.linspace(watched.now_s, at_s, looks, endpoint=False):
            watched.now_s = look_s
            watched.part.poll()
        watched.now_s = float(at_s)
        watched.send(START + stamp_s * SECOND, RAW)
        watched.part.poll()
    said = watched.stream.zero_doubts
    assert len(said) == is_said
    assert all('unusable ones, came for 20 s' in doubt for doubt in said)


@pytest.mark.parametrize(
    ('at_tare', 'times_s', 'said'),
    [
        (RAW, (0, 1, 2), ''),
        (RAW * [1, 1, 1, 0, 0, 0], (0, 1, 2), 'torque_x, torque_y, '),
        (RAW * [1, 1, 1, math.nan, 1, 1], (0, 1, 2), 'torque_x read nothing, or 0,'),
        (RAW, (1_700_000_000, 2, 9), 'stamps of the wrench began anew: if the sensor was off'),
        (RAW, (5000, 2, None), ''), (RAW, (5000, 4990, 2), ''), (RAW, (4295, 0, 0.1), ''),
    ],
    ids=['well', 'zeros', 'nothing', 'switched on', 'simulated', 'clock set', 'full'],
)  # fmt: skip
def test_what_begins_after_a_tare_is_not_zeroed_by_it(watched, at_tare, times_s, said):
    """Two stamps and a pause; a node may have been held up in it, and know of none."""
    *stamps_s, pause_s = times_s
    watched.hub.values['use_sim_time'] = pause_s is None
    watched.stream.set_tare(at_tare, stamps_s[0] * SECOND)
    for stamp_s in stamps_s:
        watched.now_s += pause_s or 2.0
        watched.send(stamp_s * SECOND, RAW)
        watched.part.poll()
    doubts = watched.stream.zero_doubts
    assert [why.startswith(said) for why in doubts] == ([True] if said else [])


@pytest.mark.parametrize(
    ('lasts_s', 'simulated', 'said'), [(0.5, False, 0), (2.0, False, 1), (2.0, True, 0)]
)
@pytest.mark.parametrize('sent', [0.0, math.nan, [math.nan, 2.0, 30.0, 0.1, 0.2, 0.3]])
def test_a_sensor_that_sent_nothing_sound_may_have_begun_anew(
    watched, sent, lasts_s, simulated, said
):
    watched.hub.values['use_sim_time'] = simulated
    watched.stream.set_tare(RAW, START)
    for k, at_s in enumerate(np.arange(10.0, 20.0, 0.1)):
        watched.now_s = float(at_s)
        is_odd = 12.0 <= at_s < 12.0 + lasts_s or 15.0 <= at_s < 15.0 + 1.5 * lasts_s
        reading = np.full(6, 1.0) * sent if is_odd else RAW + k / 1000
        if watched.part.admits(reading.tolist()):
            watched.send(START + k * SECOND // 10, reading)
        watched.part.poll()
    said = (said or lasts_s > 1) if np.isnan(sent).all() else said and np.size(sent) == 1
    found = [f'came for {lasts_s:.0f} s: if the' in why for why in watched.stream.zero_doubts]
    assert found == [True] * said


def test_a_first_wrench_without_numbers_after_a_restart_is_no_silence_of_hours(watched):
    watched.now_s = 9000.0
    part = WrenchInput(watched.counts, watched.stream)
    part.hub = watched.hub
    watched.stream.set_tare(RAW, START)
    assert not part.admits([math.nan] * 6)
    watched.now_s += 0.1
    watched.send(START, RAW)
    part.poll()
    assert not watched.stream.zero_doubts


@pytest.mark.parametrize(('doubts', 'jumped_k'), [([], 0.0), (['call ~/tare'], 0.0), ([], 8.0)])
def test_a_zero_that_another_program_sets_is_doubted_but_no_wrong_tare(watched, doubts, jumped_k):
    stream, rng = watched.stream, np.random.default_rng(0)
    stream.set_tare(RAW, START)
    stream.tracker.spikes[0].note_jump(START, jumped_k)  # a doubt that ends by itself
    for doubt in doubts:
        stream.doubt_zero(doubt)
    for k in range(80):
        watched.send(START + k, RAW * (k < 40) + rng.normal(0, 0.01, 6))
        watched.part.poll()
    found = [doubt.startswith('the raw wrench jumped to zero') for doubt in stream.zero_doubts]
    assert any(found) != bool(doubts)


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
        assert (status.values['received'], status.values['dropped']) == ('0', '9')
        assert node.outputs.empty()
        unharmed(node)
        node.put(START, [0, 0, math.nan, 0, 0, 0])
        words = 'some wrenches are unusable and dropped; check the driver: they are not finite'
        warns(node, 'input', words)

    def test_zeros_between_readings_of_a_tared_sensor_are_dropped(self, warm, warns):
        # As of a driver whose link failed for a moment; mock hardware sends nothing else.
        node, none = warm(), np.zeros(6)
        node.node.compensator.set_tare(RAW, START)
        for wrench, passes in ((none, True), (RAW, True), (none, False), (RAW, True)):
            node.put(START, wrench)
            if passes:
                node.outputs.get(timeout=20)
        warns(node, 'input', 'and dropped; check the driver: they are exactly zero on all axes')
        assert node.outputs.empty()
        node.node.tare.reset()  # as the sentence says of a sensor that reads so
        node.put(START, none)
        node.outputs.get(timeout=20)

    def test_a_driver_that_comes_back_is_a_warning_until_the_next_tare(self, warm, warns):
        node = warm()
        warns(node, 'output', 'no tare: wrench still holds the zero of the sensor; call ~/tare')
        words = 'has left and another one came: its zero may be another one; call ~/tare'
        for driver, another in enumerate((False, True, True)):
            kind = 'geometry_msgs/msg/WrenchStamped'
            gids = [SimpleNamespace(endpoint_gid=[driver] * 16, topic_type=kind)]
            node.node.get_publishers_info_by_topic = lambda _, gids=gids: gids
            if another:
                if driver == 1:
                    warns(node, 'output', words)
                node = warm(namespace=node.namespace)
                node.node.get_publishers_info_by_topic = lambda _, gids=gids: gids
                warns(node, 'output', words)
            node.node.compensator.set_tare(RAW, START)
            assert words not in node.diagnosis('output').message

    @pytest.mark.parametrize('name', ['wrench', 'wrist_ft_comp/drift'])
    def test_another_publisher_of_its_topics_warns(self, name, warm, warns, monkeypatch):
        # One of the same name, whose wrench is remapped, answers the same services.
        monkeypatch.setattr('wrist_ft_comp.node.drift_topic._TWINS_S', 0.2)
        node = warm()
        node.bench.helper.create_publisher(WrenchStamped, f'{node.namespace}/{name}', 1)
        warns(node, 'output', f'another node publishes {node.namespace}/{name}, too')


GOOD = [(second, 30.0) for second in range(21, 24)]
HOURS = 18_000
EARLIER = [(second - HOURS, 31.0) for second in range(20, 24)]
LEAP = 'stamps of temperatures leapt; was a clock set, or a simulation restarted?'
#: Temperatures after 20 s at 30 °C: seconds and values, what is said then, and the drift, N.
TEMPERATURES = {
    'nan': ([(20, math.nan), *GOOD], '1 are dropped; they are not finite', 5.0),
    'kelvin': ([(20, 298.15), *GOOD], 'Check its unit: a column takes :K', 5.0),
    'clock set': (EARLIER, LEAP, 5.0),
    'simulation again': (EARLIER, LEAP, 5.5),
    'simulated gap': (
        [(second, 44.0) for second in range(1520, 1540)],
        'a clock was set: the drift of force_z may be 1.4 N off',
        12.0,
    ),
    'seldom': (
        [(50, 30.0), (80, 30.0), (110, 37.0), (140, 44.0)],
        'is followed every 30 s, so that the drift of force_z may be 0.67 N behind',
        5.0 + 0.666,  # a ramp of 14 K in a minute, 7 N in the end, seen by a lag of 300 s
    ),
    'spike': ([(20, 85.0), *GOOD], 'faster than metal can, from 30.0 to 85.0 °C; that', 5.0),
    'frozen alone': (
        [(second, 30.0 + 0.01 * (min(second, 2000) % 7)) for second in range(20, 3000)],
        'has read the same for 17 min, far longer than before; is it frozen?',
        5.025,
    ),
    'stamp again': ([(18, 44.0)], 'dropped, because their stamps do not increase', 5.0),
    'fahrenheit': (
        [(second, 86.0) for second in (*range(20, 50), *range(50, 3000, 20))],
        'further out. In degrees Fahrenheit it would be inside: check the unit',
        0.5 * (86.0 - 20.0),
    ),
}


class TestTemperature:
    @pytest.mark.parametrize('name', TEMPERATURES)
    def test_a_bad_temperature_is_said_and_moves_the_drift_no_further(self, warm, warns, name):
        node = warm(parameters={'use_sim_time': name.startswith('simulat')})
        fed, words, drift_n = TEMPERATURES[name]
        node.diagnosis('temperature')
        node.put_temperature_bytes(0, b'\0\1\0\0 too short')
        for second, celsius in fed:
            node.node.inputs.take(0, START + second * SECOND, celsius)
        status = warns(node, 'temperature', words)
        assert int(status.values['unusable']) >= 1
        zero = node.node.compensator.compensation.zero[2]
        assert zero == pytest.approx(drift_n, abs=0.01)
        corrected = node.ask_output(START + 3000 * SECOND, RAW)
        np.testing.assert_allclose(corrected, RAW - [0, 0, zero, 0, 0, 0], atol=0.1)

    @pytest.mark.parametrize(('simulated', 'later_s', 'said'), [
        (False, 1, True), (True, 1, False), (True, 9000, True)])  # fmt: skip
    def test_in_a_slow_simulation_silence_counts_by_stamps(self, warm, simulated, later_s, said):
        node = warm(parameters={'use_sim_time': simulated})
        heard_ns = node.node.inputs.thermometers[0].heard_ns
        node.node.now_ns = lambda: heard_ns + later_s * SECOND
        node.node.inputs.thermometers[0].heard_s -= 9000.0
        assert ('silent for more than' in node.diagnosis('temperature').message) == said

    @pytest.mark.parametrize('each', [5, 1], ids=['the same reading', 'stamps in whole seconds'])
    def test_a_stamp_that_is_sent_again_until_the_next_one_is_no_fault(self, warm, each):
        node = warm()
        node.diagnosis('temperature')
        for message in range(20 * 5, 40 * 5):
            celsius = 30.0 + message // each * each / 5000
            node.node.inputs.take(0, START + message // 5 * SECOND, celsius)
        status = node.diagnosis('temperature')
        assert (status.level, status.message) == (OK, 'all thermometers report')

    def test_a_temperature_that_stops_holds_the_drift_with_a_warning(self, warm, warns):
        node = warm(parameters={'temperature_timeout': 0.2})
        warns(node, 'temperature', 'thermometer 1 silent for more than 0.2 s; drift is held')
        unharmed(node, START + 10 * HOUR)

    @pytest.mark.parametrize('repeats', [False, True])
    def test_however_long_others_may_be_silent_one_that_reports_as_time_passes_is_not(
        self, warm, repeats
    ):
        node = warm(thermometers=2, parameters={'temperature_timeout': 3600.0})
        for j in range(2):
            node.node.inputs.take(j, START + 20 * SECOND, 31.0)
            node.node.inputs.take(j, START + 21 * SECOND, 31.0 + j)
        first, second = node.node.inputs.thermometers
        second.repeats &= repeats  # it read 30 °C for 20 s
        first.heard_s -= 29.0
        second.heard_s -= 31.0
        said = node.diagnosis('temperature').message
        assert ('thermometer 2 silent for more than 30 s; drift is held' in said) == repeats

    def test_a_frozen_thermometer_is_replaced_with_a_warning(self, warm, warns):
        node = warm(thermometers=2, prediction=ALIKE)
        for second in range(20, 420):
            celsius = 30.0 + max(second - 60, 0) / 50
            for j, read_c in enumerate((celsius, min(celsius, 31.0))):
                node.node.inputs.take(j, START + second * SECOND, read_c)
            if second == 280:
                warns(node, 'temperature', 'thermometer 2 has read the same for 169 s while the')
        words = 'thermometer 2 stands still at 31.0 °C while the others show that it moved by 3.'
        status = warns(node, 'temperature', words)
        assert 'what is predicted of thermometer 2, the drift of force_z may be ' in status.message
        assert status.values['thermometer_2_c'] == '31.00'
        assert float(status.values['thermometer_2_believed_c']) == pytest.approx(celsius, abs=0.1)

    def test_a_temperature_that_jumps_moves_the_drift_no_faster_than_its_limit(self, warm, warns):
        node = warm(parameters={'max_drift_rate': 0.01})
        node.warm_up(44.0, 26, first=20)
        warns(node, 'output', 'thermometer 1 jumped by 14.0 K and stayed there')
        warns(node, 'output', 'drift of force_z moves at its limit (max_drift_rate)')
        assert node.node.compensator.compensation.zero[2] == pytest.approx(5.05, abs=0.011)
        unharmed(node)

    def test_temperatures_without_stamps_or_of_two_sources_are_a_warning(self, warm, warns):
        node = warm()
        for second, frame in enumerate(('tool0', 'motor'), start=START // SECOND + 20):
            message = Temperature(temperature=30.0)
            message.header.frame_id, message.header.stamp.sec = frame, second
            node.put_temperature_bytes(0, serialize_message(message))
        warns(node, 'temperature', 'temperatures of motor and tool0 come by turns, and are mixed')
        node.warm(0, 30.0)
        words = 'thermometer 1 does not stamp its readings; the time of arrival is taken'
        warns(node, 'temperature', words)
        assert node.node.compensator.tracker.clocks._clocks[0].kept.stamp_ns > START
        node.node.count_publishers = lambda _: 2
        warns(node, 'temperature', 'thermometer 1 has 2 publishers; their readings are mixed')


class TestQualityOfService:
    def test_a_publisher_of_other_quality_is_a_warning(self, wired):
        topics = {'wrench_raw': WrenchStamped, 'temperature': Temperature}
        name = '/unheard'
        override = f'qos_overrides.{name}/{{}}.subscription.reliability'
        overrides = {override.format(topic): 'reliable' for topic in topics}
        node = wired(namespace=name, executor='events', parameters=overrides)
        helper = node.bench.helper
        for publisher in (node._raw, *node._temperatures):
            helper.destroy_publisher(publisher)
        best_effort = QoSProfile(depth=1, reliability=QoSReliabilityPolicy.BEST_EFFORT)
        for topic, kind in topics.items():
            helper.create_publisher(kind, f'{name}/{topic}', best_effort)
        words = 'passes nothing, because its quality of service differs (Best effort publisher'
        node.diagnosis('input', f'no raw wrenches arrive: {name}/wrench_raw {words}')
        said = f'thermometer 1 has not reported: {name}/temperature {words}'
        assert node.diagnosis('temperature', said).level == WARN

    def test_a_subscriber_of_other_quality_is_a_warning_until_it_leaves(self, wired, warns):
        node = wired()
        wants = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        before = set(node.bench.helper.subscriptions)
        node.bench.listen(WrenchStamped, node.topic('wrench'), wants)
        words = 'passes nothing, because its quality of service differs (Volatile publisher'
        warns(node, 'output', words)
        (other,) = set(node.bench.helper.subscriptions) - before
        node.bench.helper.destroy_subscription(other)
        node.diagnosis('output', lambda status: words not in status.message)
