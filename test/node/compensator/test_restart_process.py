"""Processes that are killed in the middle of a warm-up, and started again."""

import itertools
import signal

import numpy as np
import pytest

from wrist_ft_comp.stored.state_file import load_state
from wrist_ft_comp.stream.compensator import Compensator, StreamSettings

#: A node that saves often.
SOURCE = """
from wrist_ft_comp.node import compensator_node, state_keeper
state_keeper.SAVE_PERIOD_S = 0.1
compensator_node.main()
"""
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


def test_a_killed_node_goes_on_with_its_drift_and_its_tare(
    bench, peer, executable, make_model, tmp_path
):
    stored, tare_n = make_model('m.yaml', {'force_z': (-3.0, 0.0, 600.0)}), 11.0
    expected, data = drifts_of(stored.model, BACK + 60), tmp_path / 'data'
    for life in range(2):
        name = f'sensor_{life}'
        process = executable(
            '',
            *('-r', f'__ns:=/{name}', '-r', f'__node:={name}'),
            *('-p', f'data_directory:={data}', '-p', f'model_file:={stored.path}'),
            *('-p', 'tare.duration:=0.1'),
            source=SOURCE,
            may_be_killed=True,
        )
        bench.wait_for_node(name)
        (warm_up if life == 0 else goes_on)(peer(f'/{name}', name), expected, tare_n)

        # What a node logs about its start comes before it saves what it saw since then.
        def saved(end=START + (BACK + 50 if life else 90) * SECOND):
            state = load_state(data / 'state.json')
            return state and state.thermal and state.thermal.end_ns >= end and state.tare.any()

        bench.wait_until(saved, 'a state')
        code, errors = process.end(signal.SIGINT if life else signal.SIGKILL)
        assert code == (0 if life else -signal.SIGKILL), errors
        assert 'Traceback' not in errors
        assert 'terminate called' not in errors
    assert errors.count('the drift goes on from the thermal state saved') == 1
    assert errors.count('compensating 1 axis with ') == 1


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
