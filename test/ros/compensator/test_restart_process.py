"""Processes that are killed in the middle of a warm-up, and started again."""

from contextlib import suppress
import itertools
import queue
import signal

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='the node tests need ROS 2 (rclpy)')

from geometry_msgs.msg import WrenchStamped
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Temperature
from std_srvs.srv import Trigger

from wrist_ft_comp.files.state_file import load_state
from wrist_ft_comp.ros.messages import wrench_message
from wrist_ft_comp.stream.compensator import Compensator, StreamSettings

MODULE = 'wrist_ft_comp.ros.compensator_node'
SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
TIMEOUT_S = 60.0


def warming(second):
    return 20.0 + 20.0 * (1 - np.exp(-second / 300))


def drifts_of(model, seconds):
    """Zero drift of force z in a node that is never killed, N."""
    twin, found = Compensator(1, StreamSettings(), model), []
    for second in range(seconds):
        twin.add_temperature(0, START + second * SECOND, warming(second))
        found.append(twin.compensation.zero[2])
    return found


class Sensor:
    """Sends a node one temperature per second of stamps, and wrenches; hears what it answers."""

    def __init__(self, bench, namespace, name):
        self.service = f'{namespace}/{name}/tare'
        self._heat = bench.publisher(Temperature, f'{namespace}/temperature')
        self._raw = bench.publisher(WrenchStamped, f'{namespace}/wrench_raw')
        self._drifts = bench.listen(
            WrenchStamped, f'{namespace}/{name}/drift', QoSProfile(depth=1000)
        )
        self._outputs = bench.listen(WrenchStamped, f'{namespace}/wrench')

    def send(self, second):
        message = Temperature(temperature=float(warming(second)))
        message.header.stamp.sec = START // SECOND + second
        self._heat.publish(message)

    def drift(self, second):
        """Send until the drift of that second comes; None when its message was lost."""
        for _ in range(10):
            self.send(second)
            with suppress(queue.Empty):
                while True:
                    message = self._drifts.get(timeout=0.2)
                    if message.header.stamp.sec == START // SECOND + second:
                        return message.wrench.force.z
        return None

    def force_z(self, second, newton):
        """Send a raw wrench until its output comes."""
        sent = wrench_message(START + round(second * SECOND), 'tool0', [newton] * 6)
        for _ in range(100):
            self._raw.publish(sent)
            with suppress(queue.Empty):
                while True:
                    message = self._outputs.get(timeout=0.2)
                    if message.header == sent.header:
                        return message.wrench.force.z
        return pytest.fail('no output')


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGTERM])
def test_a_killed_node_goes_on_within_2_percent_of_one_that_never_was(
    bench, executable, make_model, tmp_path, number
):
    """Stamps run faster than the clock: 250 s of warm-up, 10 s of absence, 50 s more."""
    stored = make_model('m.yaml', {'force_z': (2.0, 0.0, 600.0)})
    data = tmp_path / 'data'
    expected = drifts_of(stored.model, 310)
    found = {}
    for life, seconds in enumerate([range(250), range(260, 310)]):
        name = f'life_{life}_{int(number)}'
        process = executable(
            MODULE,
            *('-r', f'__ns:=/{name}', '-r', f'__node:={name}', '-p', f'data_directory:={data}'),
            *('-p', f'model_file:={stored.path}', '-p', 'save_period:=0.1'),
            may_be_killed=True,
        )
        bench.wait_for_node(name)
        sensor = Sensor(bench, f'/{name}', name)
        sensor.send(seconds[0])
        for second in seconds[1:]:
            found[second] = sensor.drift(second)

        # The state may be as old as the parameter's default of 5 s lets it be.
        def late_enough(end=START + (seconds[-1] - 5) * SECOND):
            state = load_state(data / 'state.json')
            return state is not None and state.thermal.end_ns >= end

        bench.wait_until(late_enough, 'a save')
        code, errors = process.end(number if life == 0 else signal.SIGINT)
        assert code == (-signal.SIGKILL if life == 0 and number == signal.SIGKILL else 0), errors
    assert 'the drift goes on from the thermal state saved' in errors
    later = [second for second, value in found.items() if second > 260 and value is not None]
    assert len(later) >= 45
    for second in later:
        assert found[second] == pytest.approx(expected[second], rel=0.02), second
    cold = 2.0 * (warming(261) - 20.0)
    assert cold > 1.5 * expected[261], 'without the state it would be far off'


def test_every_sensor_of_a_killed_process_goes_on_with_its_own_drift_and_tare(
    bench, executable, make_model, tmp_path
):
    gains, tares = {'left': 2.0, 'right': -3.0}, {'left': 7.0, 'right': 11.0}
    stored = {
        side: make_model(f'{side}.yaml', {'force_z': (gain, 0.0, 600.0)})
        for side, gain in gains.items()
    }
    expected = {side: drifts_of(each.model, 160) for side, each in stored.items()}
    data, file = tmp_path / 'data', tmp_path / 'parameters.yaml'
    for life in range(2):
        name = f'sensors_{life}'
        file.write_text(
            ''.join(
                f'/{name}/{side}/{name}: {{ros__parameters: {{model_file: "{each.path}"}}}}\n'
                for side, each in stored.items()
            )
        )
        process = executable(
            MODULE,
            *('-r', f'__ns:=/{name}', '-r', f'__node:={name}', '--params-file', str(file)),
            *('-p', 'sensors:=[left, right]', '-p', f'data_directory:={data}'),
            *('-p', 'save_period:=0.1', '-p', 'tare.duration:=0.1'),
            may_be_killed=True,
        )
        bench.wait_for_node(name)
        sensors = {side: Sensor(bench, f'/{name}/{side}', name) for side in gains}
        for side, sensor in sensors.items():
            (warm_up if life == 0 else goes_on)(bench, sensor, expected[side], tares[side])

        # What a node logs about its start comes before it saves what it saw since then.
        def saved(end=START + (150 if life else 90) * SECOND):
            states = [load_state(data / side / 'state.json') for side in gains]
            return all(
                each and each.thermal and each.thermal.end_ns >= end and each.tare.any()
                for each in states
            )

        bench.wait_until(saved, 'a state of each')
        code, errors = process.end(signal.SIGINT if life else signal.SIGKILL)
        assert code == (0 if life else -signal.SIGKILL), errors
    assert errors.count('the drift goes on from the thermal state saved') == len(gains)


def warm_up(bench, sensor, expected, tare_n):
    """Warm up for 100 s, and tare under a load."""
    for second in range(100):
        sensor.drift(second) if second else sensor.send(second)
    client = bench.helper.create_client(Trigger, sensor.service)
    assert client.wait_for_service(timeout_sec=TIMEOUT_S)
    answers = queue.Queue()
    client.call_async(Trigger.Request()).add_done_callback(lambda each: answers.put(each.result()))
    raw, seconds = expected[99] + tare_n, itertools.count(100.0, 0.01)
    while answers.empty():
        sensor.force_z(next(seconds), raw)
    assert answers.get().success


def goes_on(_bench, sensor, expected, tare_n):
    """What is subtracted is right before the first temperature, and after it."""
    raw = 50.0 + expected[99] + tare_n
    # The clock tells how long the node was away, and a slow machine takes its time.
    assert sensor.force_z(105, raw) == pytest.approx(50.0, abs=1.5)
    sensor.send(110)
    for second in range(111, 160):
        found = sensor.drift(second)
        assert found is None or found == pytest.approx(expected[second], rel=0.02)
    assert sensor.force_z(160, raw) == pytest.approx(50.0 + expected[99] - expected[159], abs=0.3)
