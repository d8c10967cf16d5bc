"""Warm restarts: what goes on from the saved state, when it does not, and what is saved."""

from dataclasses import replace
import time
from types import SimpleNamespace

from moments import SECOND, START
import numpy as np
import pytest

from wrist_ft_comp.node.raw_wrench import Counts
from wrist_ft_comp.node.state_keeper import StateKeeper
from wrist_ft_comp.stored.safe_file import FileWriter
from wrist_ft_comp.stored.state_file import load_state, save_state, SavedState
from wrist_ft_comp.stream.compensator import Compensator, StreamSettings

LOAD = [0.0, 0.0, 50.0, 0.0, 0.0, 0.0]
TARE = np.array([0.0, 0.0, 7.0, 0.0, 0.0, 0.0])
HELD = 'the drift saved before the restart is held until a temperature comes'
STEADY = 'the drift starts at the steady state of the first temperatures'
OTHER_MODEL = 'belongs to another model, and so does its tare'
TOO_OLD = 's old and this model remembers 1800 s'


def warming(second):
    return 20.0 + 20.0 * (1 - np.exp(-second / 300))


@pytest.fixture
def stored(make_model):
    return make_model('m.yaml', {'force_z': (2.0, 0.0, 600.0)})


@pytest.fixture
def warm(stored):
    """A state in the middle of a warm-up, as a node would have saved it just now."""
    compensator = Compensator(1, StreamSettings(), stored.model)
    for second in range(400):
        compensator.add_temperature(0, START + second * SECOND, warming(second))
    return SavedState(time.time_ns(), stored.sha256, TARE, compensator.memory())


class Restarted:
    """The part for restarts beside a fake hub, after the first model went live."""

    def __init__(self, fake_hub, path, stored, **chosen):
        self.compensator = Compensator(1, StreamSettings())
        self.compensator.go_live(stored.model)
        self.keeper = StateKeeper(
            compensator=self.compensator,
            live=SimpleNamespace(sha256=stored.sha256, stored=stored),
            counts=Counts(), writer=FileWriter(), path=path,
        )  # fmt: skip
        self.hub = fake_hub(self.keeper, **chosen)
        self.keeper.start()

    def warm(self, seconds, celsius=warming):
        for second in seconds:
            self.compensator.add_temperature(0, START + second * SECOND, celsius(second))
        self.keeper.poll()

    def output(self, second, raw):
        return self.compensator.correct(START + second * SECOND, list(raw))[2]


@pytest.fixture
def restart(fake_hub, stored, tmp_path):
    """Restart after a state was saved, or after what stands at its place."""

    def start(state=None, **chosen):
        path = tmp_path / 'state.json'
        if state is not None:
            save_state(path, state)
        return Restarted(fake_hub, path, stored, **chosen)

    return start


def test_a_restarted_node_subtracts_drift_and_tare_at_once(rig, stored, warm, tmp_path, capfd):
    save_state(tmp_path / 'data/state.json', warm)
    node = rig(model=stored)
    held = warm.thermal.compensation.zero[2]
    assert held > 5.0
    assert node.ask_output(START, LOAD)[2] == pytest.approx(50.0 - held - 7.0, abs=0.1)
    assert node.diagnosis('temperature').values['state'] == HELD
    assert 'the tare from before the restart is active' in capfd.readouterr().err


def test_the_first_cell_gives_the_length_of_the_gap(restart, warm):
    restarted = restart(warm)
    restarted.warm(range(410, 413))
    said = 'the drift goes on from the thermal state saved 11 s before'
    assert restarted.compensator.tracker.origin == said
    assert said in restarted.hub.logged
    before, now = warm.thermal.compensation.zero, restarted.compensator.compensation.zero
    assert now[2] == pytest.approx(before[2], rel=0.05)


@pytest.mark.parametrize(
    ('change', 'words', 'tared'),
    [
        ({'model_sha256': 'f' * 64}, [OTHER_MODEL, STEADY], False),
        ({'model_sha256': None}, [OTHER_MODEL, STEADY], False),
        ({'filters': {'force_z': np.zeros(9)}}, ['does not fit the model', STEADY], True),
        ({'later_s': -240 * 3600}, [TOO_OLD, HELD], True),
    ],
)
def test_a_state_that_cannot_be_used_is_said_and_logged(restart, warm, change, words, tared):
    if 'filters' in change:
        change = {'thermal': replace(warm.thermal, **change)}
    if later_s := change.pop('later_s', 0):
        change = {'saved_ns': warm.saved_ns + later_s * SECOND}
    restarted = restart(replace(warm, **change))
    for word in words:
        assert word in restarted.compensator.tracker.origin
    np.testing.assert_array_equal(restarted.compensator.tare, TARE if tared else np.zeros(6))
    first = 400 + max(-later_s, 700)
    restarted.warm(range(first, first + 3))
    if words[1] == HELD:  # from what it was, at 1 N/s
        moved = restarted.compensator.compensation.zero - warm.thermal.compensation.zero
        assert 0.9 < moved[2] < 3.1
    assert words[0] in restarted.compensator.tracker.origin
    assert 'starts at the steady state of the' in restarted.compensator.tracker.origin
    assert any(words[0] in line for line in restarted.hub.logged)


def test_a_tare_that_is_made_before_the_first_temperature_stays_at_zero(restart, warm):
    restarted = restart(replace(warm, saved_ns=10**18))
    restarted.compensator.set_tare(np.array(LOAD), START + 700 * SECOND)
    for second in range(701, 730):
        restarted.warm([second], lambda _: 25.0)
        assert restarted.output(second, LOAD) == pytest.approx(0.0, abs=1e-9)


def test_a_tare_without_a_drift_keeps_the_output_over_a_restart(restart, stored):
    restarted = restart(SavedState(time.time_ns(), stored.sha256, TARE, None))
    assert restarted.output(0, TARE) == 0.0
    restarted.warm(range(5), lambda _: 30.0)
    assert restarted.compensator.compensation.zero[2] == pytest.approx(20.0)
    assert restarted.output(6, TARE) == pytest.approx(0.0)


def test_a_broken_state_is_said_and_replaced(restart, tmp_path):
    path = tmp_path / 'state.json'
    path.write_bytes(b'{')
    restarted = restart()
    assert 'state.json is not a state file' in restarted.compensator.tracker.origin
    restarted.warm(range(4))
    restarted.keeper.end()
    assert load_state(path).thermal is not None


def test_a_tare_that_is_not_saved_brings_back_no_older_one(restart, warm, tmp_path, monkeypatch):
    restarted, told = restart(warm), []
    monkeypatch.setattr('os.fsync', lambda _: (_ for _ in ()).throw(OSError(28, 'No space left')))
    restarted.keeper.save()
    restarted.compensator.set_tare(TARE + 1.0, START)
    restarted.keeper.save(told.append)
    restarted.keeper.end()
    assert 'state.json cannot be written: No space left' in told[0]
    assert not (tmp_path / 'state.json').exists()


@pytest.mark.parametrize('tared', [True, False])
def test_what_is_known_of_the_zero_and_the_driver_outlives_a_restart(restart, warm, tared):
    doubts = ('the frame was moved',)
    state = replace(warm, tared=tared, zero_doubts=doubts, drivers=('abc',), payload='day-1')
    restarted = restart(state)
    assert restarted.compensator.tared == tared
    assert restarted.compensator.zero_doubts == ['the frame was moved']
    counts = restarted.keeper.counts
    assert (counts.drivers, counts.payload) == ({'abc'}, 'day-1')


def test_without_temperature_or_tare_nothing_is_written(restart, tmp_path):
    restarted = restart()
    restarted.output(0, LOAD)
    restarted.keeper.end()
    assert list(tmp_path.glob('state*')) == []


@pytest.mark.parametrize(
    ('later_s', 'changed', 'saved'), [(4.9, '', 0), (5.1, '', 1), (0, 'tare', 1), (0, 'model', 1)]
)
def test_a_state_is_saved_every_five_seconds_and_with_tare_or_model_at_once(  # noqa: PLR0913, PLR0917
    restart, warm, monkeypatch, later_s, changed, saved
):
    now_s, puts = [1000.0], []
    monkeypatch.setattr('time.monotonic', lambda: now_s[0])
    restarted = restart(warm)
    restarted.keeper.writer.put = lambda *_: puts.append(1)
    restarted.warm(range(410, 413))
    now_s[0] += later_s
    if changed == 'tare':
        restarted.compensator.set_tare(TARE, START)
    if changed == 'model':
        restarted.keeper.live.sha256 = 'f' * 64
    restarted.keeper.poll()
    assert len(puts) == saved


@pytest.mark.usefixtures('haste')
def test_a_disk_that_refuses_is_a_warning_and_logged_and_the_stream_goes_on(rig, stored, capfd):
    node, state = rig(model=stored), 'state.json'
    (node.directory / state).mkdir()
    node.warm_up(30.0, 4)
    words = 'until then a restart loses the thermal state and the tare'
    status = node.diagnosis('model', words)
    assert (status.level, f'{state} cannot be written' in status.message) == (b'\1', True)
    assert node.ask_output(START, LOAD)[2] == pytest.approx(30.0)
    capfd.readouterr()
    node.bench.close()
    assert f'{state} cannot be written' in capfd.readouterr().err, 'also at the end'


def test_a_model_whose_file_is_gone_is_said_while_it_runs(rig, stored, haste):  # noqa: ARG001
    node = rig(model=stored)
    node.warm_up(30.0)
    assert 'is gone' not in node.diagnosis('model').message
    content = stored.path.read_bytes()
    stored.path.unlink()
    node.warm_up(31.0, first=3)
    node.diagnosis('model', 'm.yaml is gone, and after a restart drift model and tare are: put')
    stored.path.write_bytes(content)
    node.warm_up(32.0, first=6)
    node.diagnosis('model', lambda status: 'is gone' not in status.message)
