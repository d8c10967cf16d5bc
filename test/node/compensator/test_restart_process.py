"""Processes that are killed in the middle of a warm-up, and started again."""

import itertools
import signal

import numpy as np
import pytest

from wrist_ft_comp.stored.state_file import load_state
from wrist_ft_comp.stream.compensator import Compensator, StreamSettings

MODULE = 'wrist_ft_comp.node.compensator'
SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
#: When the node is back, s after the start: it may move the drift by a newton a second.
BACK = 130


def warming(second):
    """Stand still while the node is away: how long that is, the clock of a slow machine tells."""
    heated = min(second, 100) + max(second - BACK, 0)
    return 20.0 + 20.0 * (1 - np.exp(-heated / 300))


def drifts_of(model, seconds):
    """Zero drift of force z in a node that is never killed, N."""
    twin, drifts = Compensator(1, StreamSettings(), model), []
    for second in range(seconds):
        twin.add_temperature(0, START + second * SECOND, warming(second))
        drifts.append(twin.compensation.zero[2])
    return drifts


def test_every_sensor_of_a_killed_process_goes_on_with_its_own_drift_and_tare(
    bench, peer, executable, make_model, tmp_path
):
    gains, tares = {'left': 2.0, 'right': -3.0}, {'left': 7.0, 'right': 11.0}
    stored = {
        side: make_model(f'{side}.yaml', {'force_z': (gain, 0.0, 600.0)})
        for side, gain in gains.items()
    }
    expected = {side: drifts_of(model.model, BACK + 60) for side, model in stored.items()}
    data, file = tmp_path / 'data', tmp_path / 'parameters.yaml'
    for life in range(2):
        name = f'sensors_{life}'
        file.write_text(
            ''.join(
                f'/{name}/{side}/{name}: {{ros__parameters: {{model_file: "{model.path}"}}}}\n'
                for side, model in stored.items()
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
        sensors = {side: peer(f'/{name}/{side}', name) for side in gains}
        for side, sensor in sensors.items():
            (warm_up if life == 0 else goes_on)(sensor, expected[side], tares[side])

        # What a node logs about its start comes before it saves what it saw since then.
        def saved(end=START + (BACK + 50 if life else 90) * SECOND):
            states = [load_state(data / side / 'state.json') for side in gains]
            return all(
                state and state.thermal and state.thermal.end_ns >= end and state.tare.any()
                for state in states
            )

        bench.wait_until(saved, 'a state of each')
        code, errors = process.end(signal.SIGINT if life else signal.SIGKILL)
        assert code == (0 if life else -signal.SIGKILL), errors
        assert 'Traceback' not in errors
        assert 'terminate called' not in errors
    assert errors.count('the drift goes on from the thermal state saved') == len(gains)
    assert errors.count('compensating 1 axis with ') == len(gains)


def warm_up(sensor, expected, tare_n):
    """Warm up for 100 s, and tare under a load."""
    for second in range(100):
        sensor.drift(second, warming(second)) if second else sensor.send(second, warming(second))
    answer = sensor.ask('tare')
    raw, seconds = expected[99] + tare_n, itertools.count(100.0, 0.01)
    while answer.empty():
        sensor.force_z(next(seconds), raw)
    assert answer.get().success


def goes_on(sensor, expected, tare_n):
    """What is subtracted is right before the first temperature, and after it."""
    raw = 50.0 + expected[99] + tare_n
    assert sensor.force_z(105, raw) == pytest.approx(50.0, abs=1.5)
    sensor.send(BACK, warming(BACK))
    for second in range(BACK + 1, BACK + 60):
        drift = sensor.drift(second, warming(second))
        assert drift is None or drift == pytest.approx(expected[second], rel=0.02)
    still = 50.0 + expected[99] - expected[-1]
    assert sensor.force_z(BACK + 60, raw) == pytest.approx(still, abs=0.3)
