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


CLOCK_SET_BACK = 's in the future: the system clock was set back'
TOO_OLD = 's old and this model remembers 1800 s'


@pytest.mark.parametrize(
    ('later_s', 'words'), [(3600, CLOCK_SET_BACK), (-6 * 3600, TOO_OLD), (-240 * 3600, TOO_OLD)]
)
def test_a_state_of_another_time_moves_the_output_by_the_rate_only(
    restart, warm, capfd, later_s, words
):
    node = restart(replace(warm, saved_ns=warm.saved_ns + later_s * SECOND))
    raw = [0.0, 0.0, 50.0 + warm.thermal.compensation.zero[2] + TARE[2], 0.0, 0.0, 0.0]
    first = warm.thermal.end_ns + max(-later_s, 700) * SECOND
    assert node.ask_output(first, raw)[2] == pytest.approx(50.0)
    status = node.diagnosis('temperature')
    assert words in status.values['state']
    assert origin(node).endswith(
        '; the drift saved before the restart is held until a temperature comes'
    )
    outputs = []
    for tenth in range(600):
        if tenth % 10 == 0:
            node.warm(first + tenth * SECOND // 10, 25.0)
        outputs.append(node.ask_output(first + tenth * SECOND // 10, raw)[2])
    assert np.abs(np.diff([50.0, *outputs])).max() < 0.11, 'at most 1 N/s'
    assert outputs[-1] == pytest.approx(50.0 + warm.thermal.compensation.zero[2] - 10.0)
    assert words in origin(node)
    assert 'starts at the steady state of the present temperatures' in origin(node)
    assert words in capfd.readouterr().err


def test_a_tare_that_is_made_before_the_first_temperature_stays_at_zero(restart, warm):
    node = restart(replace(warm, saved_ns=10**18), **{'tare.duration': 0.1})
    first, answers = warm.thermal.end_ns + 700 * SECOND, node.ask('tare')
    wobble = 1e-12 * (np.arange(20) % 2)[:, np.newaxis]  # a sensor that lives
    node.stream(first + np.arange(20) * SECOND // 100, np.tile(LOAD, (20, 1)) + wobble)
    assert answers.get(timeout=20.0).success
    for second in range(30):
        node.warm(first + second * SECOND, 25.0)
        assert node.ask_output(first + second * SECOND, LOAD)[2] == pytest.approx(0.0, abs=1e-9)


def test_a_tare_without_a_drift_keeps_the_output_over_a_restart(restart, stored):
    node = restart(SavedState(time.time_ns(), stored.sha256, TARE, None))
    assert node.ask_output(START, TARE)[2] == 0.0
    node.warm_up(30.0, 5)
    assert node.node.compensator.compensation.zero[2] == pytest.approx(20.0)
    assert node.ask_output(START + 6 * SECOND, TARE)[2] == pytest.approx(0.0)


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        ({'model_sha256': 'f' * 64}, 'belongs to another model, and so does its tare'),
        ({'model_sha256': None}, 'belongs to another model, and so does its tare'),
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


@pytest.mark.usefixtures('haste')
def test_a_broken_state_is_logged_and_replaced(rig, stored, tmp_path, capfd):
    path = tmp_path / 'data/state.json'
    path.write_bytes(b'{')
    node = rig(model=stored)
    assert 'state.json is not a state file' in origin(node)
    assert 'state.json is not a state file' in capfd.readouterr().err
    node.warm_up(30.0)
    node.diagnosis('model', lambda status: int(status.values['state_saves']) >= 1)
    assert load_state(path) is not None


def test_simulated_time_is_not_judged_by_the_system_s_clock(restart, warm):
    node = restart(replace(warm, saved_ns=10**18), use_sim_time=True)
    assert node.node.compensator.tracker.awaiting_gap


@pytest.mark.usefixtures('haste')
def test_a_disk_that_refuses_is_logged_and_the_stream_goes_on(rig, stored, capfd):
    node = rig(model=stored)
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
    (node.directory / 'state.json').unlink()
    (node.directory / 'state.json').mkdir()
    node.put_temperature(START + 8 * SECOND, 30.0)
    capfd.readouterr()
    node.bench.close()
    assert 'state.json cannot be written' in capfd.readouterr().err, 'also at the end'


@pytest.mark.usefixtures('haste')
def test_without_temperature_or_tare_nothing_is_written(rig, bench, tmp_path):
    node = rig()
    for number in range(20):
        node.ask_output(number, LOAD)
    assert node.diagnosis('output')
    bench.close()
    assert [file.name for file in (tmp_path / 'data').iterdir()] == ['lock']
