"""State files: what comes back, and what is refused."""

from contextlib import suppress
from dataclasses import replace
import json

from hypothesis import given, HealthCheck, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from wrist_ft_comp.drift.drift_model import Drift
from wrist_ft_comp.errors import StateFileError
from wrist_ft_comp.stored.state_file import load_state, save_state, SavedState
from wrist_ft_comp.stream.drift_uncertainty import Uncertainty
from wrist_ft_comp.stream.failed_thermometers import ThermometerState
from wrist_ft_comp.stream.gaps_and_restarts import Block, ThermalMemory
from wrist_ft_comp.stream.temperature_jumps import Jump

number = st.floats(-1e99, 1e99)
six = st.lists(number, min_size=6, max_size=6).map(np.array)
filters = st.lists(number, max_size=12).map(np.array)
stamps = st.integers(-(2**63) + 1, 2**63 - 1)
blocks = st.lists(
    st.builds(Block, st.lists(number, max_size=3).map(np.array), st.integers(1, 1000)), max_size=9
).map(tuple)
by_thermometer = st.lists(number, min_size=1, max_size=5).map(np.array)
rows = st.lists(st.lists(number, min_size=2, max_size=2), min_size=1, max_size=3).map(np.array)
thermometers = st.builds(
    ThermometerState, by_thermometer, rows, rows, *[by_thermometer] * 7, number,
    st.lists(st.text(max_size=20), min_size=1, max_size=5).map(tuple),
)  # fmt: skip
memories = st.builds(
    ThermalMemory, stamps, st.integers(1, 600 * 10**9), by_thermometer,
    st.lists(st.integers(0, 1000), min_size=1, max_size=5).map(tuple),
    st.dictionaries(st.sampled_from(['force_x', 'force_z', 'torque_y']), filters),
    st.builds(Drift, six, six), rows, blocks, st.none() | thermometers,
    st.none() | st.builds(Uncertainty, stamps, six),
    st.lists(st.builds(Jump, number, st.none() | stamps, number), max_size=3).map(tuple),
)  # fmt: skip
sha256 = st.none() | st.just('f' * 64)
states = st.builds(SavedState, stamps, sha256, six, st.none() | memories, six)


def example():
    memory = ThermalMemory(
        5, 10, np.array([20.0]), (0,), {'force_z': np.ones(2)},
        Drift(np.ones(6), np.zeros(6)), np.array([[20.0]]),
        (Block(np.array([20.0]), 1), Block(np.array([21.0]), 60)),
    )  # fmt: skip
    return SavedState(7, 'a' * 64, np.arange(6.0), memory)


@settings(max_examples=40, derandomize=True, suppress_health_check=[*HealthCheck])
@given(state=states)
def test_a_state_comes_back_to_the_last_bit(tmp_path, state):
    path, again = tmp_path / 'new/state.json', tmp_path / 'again.json'
    save_state(path, state)
    back = load_state(path)
    save_state(again, back)
    assert again.read_bytes() == path.read_bytes()
    if state.thermal is not None:
        for axis, values in state.thermal.filters.items():
            assert back.thermal.filters[axis].shape == values.shape
    assert [file.name for file in path.parent.iterdir()] == ['state.json']


@pytest.mark.parametrize('value', [np.nan, np.inf, -np.inf, 1e101])
@pytest.mark.parametrize('place', range(9))
def test_a_state_of_impossible_numbers_is_written_so_that_it_can_be_read(tmp_path, place, value):
    known = ThermometerState(np.ones(1), *np.ones((2, 1, 1)), *np.ones((7, 1)), 1.0, ('silent',))
    thermal = replace(example().thermal, thermometers=known)
    state = replace(example(), external_tare=np.arange(6.0), thermal=thermal)
    zero, sensitivity = thermal.compensation
    filters, (mean, _) = thermal.filters['force_z'], thermal.history[1]
    arrays = [state.tare, state.external_tare, zero, sensitivity, filters, mean]
    arrays += [thermal.temperature_c, thermal.start_c, known.smooth_c]
    arrays[place][0] = value
    save_state(tmp_path / 'state.json', state)
    back = load_state(tmp_path / 'state.json')
    assert (back.tare.any(), back.external_tare.any()) == (place != 0, place != 1)
    assert (back.thermal is None) == (place > 1)


@pytest.mark.parametrize(('place', 'value'), [
    ('silent', [-1]),
    ('compensation', {'zero': [0.0] * 5, 'sensitivity': [0.0] * 6}),
    ('temperature_c', [1e101]), ('temperature_c', [None]),
    ('uncertainty', {'since_ns': 0, 'bound': [1.0]}),
    ('history', [{'temperature_c': [20.0], 'cells': 10**6}]),
])  # fmt: skip
def test_what_nothing_can_go_on_from_is_refused(tmp_path, place, value):
    path = tmp_path / 'state.json'
    save_state(path, example())
    document = json.loads(path.read_text())
    document['thermal'][place] = value
    path.write_text(json.dumps(document))
    with pytest.raises(StateFileError, match=r'is damaged: .* Remove it, or restore the file\.'):
        load_state(path)


def test_a_file_cut_or_flipped_anywhere_is_refused_or_whole(tmp_path):
    path = tmp_path / 'state.json'
    save_state(path, example())
    whole = path.read_bytes()
    for end in range(len(whole)):
        path.write_bytes(whole[:end])
        with pytest.raises(StateFileError):
            load_state(path)
        path.write_bytes(whole[:end] + b'7' + whole[end + 1 :])
        with suppress(StateFileError):
            load_state(path)
