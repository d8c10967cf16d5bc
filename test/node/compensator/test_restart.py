"""Warm restarts: what is saved, what a restarted node does with it, and what it says."""

from dataclasses import replace
import time

import numpy as np
import pytest

from wrist_ft_comp.stored.state_file import load_state, save_state, SavedState
from wrist_ft_comp.stream.compensator import Compensator, StreamSettings

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
AXES = {'force_z': (2.0, 0.0, 600.0)}
LOAD = [0.0, 0.0, 50.0, 0.0, 0.0, 0.0]
TARE = np.array([0.0, 0.0, 7.0, 0.0, 0.0, 0.0])
WARN = b'\1'


def warming(second):
    return 20.0 + 20.0 * (1 - np.exp(-second / 300))


@pytest.fixture
def stored(make_model):
    return make_model('m.yaml', AXES)


@pytest.fixture
def warm(stored):
    """A state in the middle of a warm-up, as a node would have saved it just now."""
    compensator = Compensator(1, StreamSettings(), stored.model)
    for second in range(400):
        compensator.add_temperature(0, START + second * SECOND, warming(second))
    return SavedState(time.time_ns(), stored.sha256, TARE, compensator.memory())


@pytest.fixture
def restart(rig, stored, tmp_path):
    """Start a node that finds a state."""

    def start(state, **parameters):
        save_state(tmp_path / 'data/state.json', state)
        return rig(model=stored, parameters=parameters)

    return start


def origin(node):
    return node.diagnosis('temperature').values['state']


def test_drift_and_tare_are_subtracted_from_the_first_wrench_on(restart, warm, capfd):
    node = restart(warm)
    held = warm.thermal.compensation.zero[2]
    assert held > 5.0
    assert node.ask_output(START, LOAD)[2] == pytest.approx(50.0 - held - 7.0, abs=0.1)
    assert 'the tare from before the restart is active' in capfd.readouterr().err
    assert origin(node) == 'the drift saved before the restart is held until a temperature comes'


def test_the_first_cell_gives_the_length_of_the_gap(restart, warm, capfd):
    node = restart(warm)
    for second in range(410, 413):
        node.warm(START + second * SECOND, warming(second))
    sentence = 'the drift goes on from the thermal state saved 11 s before'
    status = node.diagnosis('temperature', lambda status: sentence in str(status.values))
    assert status.level == b'\0'
    assert sentence in capfd.readouterr().err
    assert node.node.compensator.compensation.zero[2] == pytest.approx(
        warm.thermal.compensation.zero[2], rel=0.05
    )
    model = node.node.compensator.model
    for following in (None, model):
        node.node.compensator.go_live(following)
        now = node.node.compensator.tracker.origin
        node.wait_until(lambda now=now: node.node.state_keeper._logged_origin == now, 'the log')
    assert origin(node) == sentence, 'also after a change of model'


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        ({'model_sha256': 'f' * 64}, 'belongs to another model, and so does its tare'),
        ({'model_sha256': None}, 'belongs to another model, and so does its tare'),
        ({'saved_ns': 4 * 10**18}, 's in the future'),
        ({'saved_ns': 10**18}, 's old and this model remembers 1800 s'),
        ({'thermal': {'filters': {'force_z': np.zeros(9)}}}, 'does not fit the model it names'),
    ],
)
def test_a_state_that_cannot_be_used_is_logged(restart, warm, capfd, change, words):
    if 'thermal' in change:
        change = {'thermal': replace(warm.thermal, **change['thermal'])}
    node = restart(replace(warm, **change))
    assert not node.node.compensator.compensating
    assert words in origin(node)
    assert 'steady state of the first temperatures' in origin(node)
    assert words in capfd.readouterr().err
    same = 'model_sha256' not in change
    np.testing.assert_array_equal(node.node.compensator.tare, TARE if same else np.zeros(6))


def test_a_broken_state_is_logged_and_replaced(rig, stored, tmp_path, capfd):
    path = tmp_path / 'data/state.json'
    path.write_bytes(b'{')
    node = rig(model=stored, parameters={'save_period': 0.1})
    assert 'state.json is not a state file' in origin(node)
    assert 'state.json is not a state file' in capfd.readouterr().err
    node.warm_up(30.0)
    node.wait_until(lambda: node.node.state_keeper.writer.written > 0, 'a save')
    assert load_state(path) is not None


def test_simulated_time_is_not_judged_by_the_system_s_clock(restart, warm):
    node = restart(replace(warm, saved_ns=10**18), use_sim_time=True)
    assert node.node.compensator.tracker.awaiting_gap


def test_the_saved_state_is_the_memory_of_the_stream(rig, stored):
    node = rig(model=stored, parameters={'save_period': 0.1})
    for second in range(20):
        node.warm(START + second * SECOND, warming(second))
    node.node.compensator.restore_tare(TARE, np.zeros(6))
    path = node.directory / 'state.json'
    expected = node.node.compensator.memory()

    def saved():
        state = load_state(path)
        return state is not None and state.tare.any() and state.thermal.end_ns == expected.end_ns

    node.wait_until(saved, 'the save')
    state = load_state(path)
    assert state.model_sha256 == stored.sha256
    assert state.thermal.filters['force_z'] == pytest.approx(expected.filters['force_z'])
    np.testing.assert_array_equal(state.tare, TARE)
    assert abs(time.time_ns() - state.saved_ns) < 60 * SECOND
    node.diagnosis('model', lambda status: int(status.values['state_saves']) >= 1)


def test_a_disk_that_refuses_is_logged_and_the_stream_goes_on(rig, stored, capfd):
    node = rig(model=stored, parameters={'save_period': 0.1})
    (node.directory / 'state.json').mkdir()
    node.warm_up(30.0, 4)
    status = node.diagnosis('model', lambda status: status.level == WARN)
    assert 'state.json cannot be written' in status.message
    assert 'until then a restart loses the thermal state and the tare' in status.message
    assert node.ask_output(START, LOAD)[2] == pytest.approx(30.0)
    log = []
    node.wait_until(
        lambda: log.append(capfd.readouterr().err) or 'cannot be written' in ''.join(log),
        'the log',
    )
    (node.directory / 'state.json').rmdir()
    for second in range(4, 8):
        node.warm(START + second * SECOND, 30.0)
    assert node.diagnosis('model', lambda status: status.level != WARN)


def test_without_temperature_or_tare_nothing_is_written(rig, bench, tmp_path):
    node = rig(parameters={'save_period': 0.1})
    for number in range(20):
        node.ask_output(number, LOAD)
    assert node.diagnosis('output')
    bench.close()
    assert [file.name for file in (tmp_path / 'data').iterdir()] == ['lock']
