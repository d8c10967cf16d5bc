"""A node that is started on what a node of version 0.1.0 left behind."""

import csv
import json
from pathlib import Path
import shutil

import pytest

HERE = Path(__file__).parents[2] / 'fixtures' / 'v0_1_0'
SECOND = 1_000_000_000
AXES = ('force_x', 'force_y', 'force_z', 'torque_x', 'torque_y', 'torque_z')
FIRST, LIVE = 'model_20261121T220509Z.yaml', 'model_20261121T220520Z.yaml'


@pytest.fixture
def node(rig, tmp_path):
    """Start it; by simulated time, or the state would be too old."""
    shutil.copytree(HERE / 'store', tmp_path / 'data')
    return rig(thermometers=2, parameters={'use_sim_time': True})


def close(expected):
    return pytest.approx(expected, abs=1e-9, rel=0)


def test_it_goes_on_from_the_saved_state(node):
    expected = json.loads((HERE / 'state.json').read_text(encoding='utf-8'))
    thermal = json.loads((HERE / 'store/state.json').read_text(encoding='utf-8'))['thermal']
    assert node.ask_output(thermal['end_ns'], [1.0] * 6) == close(expected['held'])
    with (HERE / 'input_2.csv').open(encoding='utf-8') as file:
        rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]
    first_ns = thermal['end_ns'] + 3 * thermal['period_ns']
    outputs = []
    for number, row in enumerate(rows[:16]):
        stamp = first_ns + round(row['stamp_s'] * SECOND)
        node.warm(stamp, row['temperature_c'], row['temperature_2_c'])
        if number % 4 == 3:
            outputs.append(node.ask_output(stamp + SECOND, [row[axis] for axis in AXES]))
    for output, wanted in zip(outputs, expected['stream'][:4], strict=True):
        assert output == close(wanted)


def test_it_goes_back_to_the_model_before_and_to_none(node):
    def live():
        return Path(node.diagnosis('model').values['file']).name

    assert live() == LIVE
    answer = node.call('rollback')
    assert answer.success
    assert FIRST in answer.message
    assert live() == FIRST
    answer = node.call('rollback')
    assert answer.success
    assert 'uncompensated' in answer.message
    assert not node.call('rollback').success
